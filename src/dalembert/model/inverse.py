"""Methods of models for the loads of a motion: inverse dynamics, and its regressor by inertial parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from ..arrays import FloatArray
from ..codegen import backend_named
from ..codegen.base import Capability
from ..errors import CapabilityError, nesting_named
from ..starts import inputs as run_input
from .rows import parameters_with_inputs, require_states_given, rows_at, rows_of, traced

if TYPE_CHECKING:
    from ..analysis.inverse_kernel import InverseKernel
    from ..analysis.regressor import RegressorKernel
    from .model import CompiledModel


@nesting_named
def inverse_dynamics(
    self: CompiledModel,
    t: Any,
    q: Any,
    qdot: Any,
    qddot: Any,
    p: Any,
    *,
    inputs: Mapping[Any, Any] | None = None,
    states: Any = None,
) -> FloatArray:
    """Return the inputs of the scene that give the coordinates some second rates, or generalised forces.

    The inputs are loads, such as motor torques; those that `inputs` has are taken as they are, and the others are
    solved for. Where several values do, they are those of least norm. In a scene without inputs, or with all of them
    given, generalised forces along the coordinates are returned: of several that do, on closed loops and unit
    quaternions, those of least norm. Constraints, rolling included, hold whatever multipliers they need. Dry friction
    with a given normal load opposes the slip, or, at rest, the slip that the accelerations begin; stops must be open.

    Parameters
    ----------
    t, p, states
        As for `accelerations`; states of controllers that set inputs need not be given.
    q, qdot, qddot : array_like (n_q,) or (k, n_q)
        Coordinates, their rates and second rates.
    inputs : mapping, optional
        Inputs with given values, such as the height of a road.

    Returns
    -------
    ndarray (n_u,) or (k, n_u)
        In the order of ``layout.inputs`` without those given, inputs that controllers set first; generalised forces
        are (n_q,) or (k, n_q).

    Raises
    ------
    ValueInputError
        Where second rates contradict a constraint, or the inputs cannot produce them, with its name or the coordinates.
    CapabilityError
        For inputs that are no loads and not given, for contacts other than those above, and for values that JAX traces.

    Examples
    --------
    Computed torque: the torques with which an arm follows a motion q_d::

        wanted = qddot_d + k_d * (qdot_d - qdot) + k_p * (q_d - q)
        tau = model.inverse_dynamics(t, q, qdot, wanted, p)
    """
    from ..analysis.inverse_dynamics import inverse_dynamics_at

    inverse, (times, y, p, single) = _at(self, "inverse_dynamics", (t, q, qdot, qddot, p), inputs, states)
    found = inverse_dynamics_at(self, inverse, times, y, p)
    return found[0] if single else found


@nesting_named
def regressor(
    self: CompiledModel,
    t: Any,
    q: Any,
    qdot: Any,
    qddot: Any,
    p: Any,
    *,
    inputs: Mapping[Any, Any] | None = None,
    states: Any = None,
    loads: Iterable[Any] = (),
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the matrix W of which W @ pi are the values of `inverse_dynamics`, and the names of pi.

    The inertial parameters pi of a body "arm" are its mass "arm.m" [kg], first moments "arm.mc_x", ... [kg m] and
    moments of inertia "arm.I_xx", "arm.I_xy", ... [kg m^2], about the first point on the way to its mass centre that is
    fixed in the body, such as its joint, on the axes of the body's frame (products of inertia are entries of the
    matrix: I_xy is minus the integral of x y). A particle has its mass alone. Where the scene has loads beside gravity,
    the last name is "loads", with the factor 1.

    Second rates may contradict constraints and inputs, as measured ones do. W holds the equations along the directions
    that the constraints leave free, in the rows of `inverse_dynamics`.

    Parameters
    ----------
    t, q, qdot, qddot, p, inputs, states
        As for `inverse_dynamics`. Masses and inertias in p do not matter for W where there are no constraints and no
        inputs; lengths and coefficients of other loads do.
    loads : iterable of symbols or names, optional
        Parameters, such as coefficients of damping and of dry friction, that loads are linear in: each is a column.

    Returns
    -------
    W : ndarray (n_u, n_pi) or (k, n_u, n_pi)
    names : tuple of str

    Raises
    ------
    ValueInputError
        Where several values of the inputs do the same.
    CapabilityError
        As for `inverse_dynamics`; for scenes without positions, masses that change, and parameters that loads are not
        linear in.

    See Also
    --------
    inertial_parameters : pi at some parameters.
    dalembert.base_parameters : what of pi motions determine.
    dalembert.identify : pi from measurements.
    """
    from ..analysis.regressor import regressor_at

    inverse, (times, y, p, single) = _at(self, "regressor", (t, q, qdot, qddot, p), inputs, states)
    kernel = _regressor_kernel(self, inverse, loads)
    found = regressor_at(self, kernel, times, y, p)
    return (found[0] if single else found), kernel.names


@nesting_named
def inertial_parameters(
    self: CompiledModel, p: Any, *, inputs: Iterable[Any] = (), loads: Iterable[Any] = ()
) -> dict[str, float]:
    """Return the values of the parameters of `regressor` at parameters of the scene, by name.

    Parameters
    ----------
    p : mapping or array_like (n_p,)
        Parameters, by name or in the order of ``layout.parameters``.
    inputs, loads : iterable of symbols or names
        Names of the inputs that are given, and of the coefficients of loads, as for `regressor`.
    """
    from ..analysis.regressor import parameter_values

    given = run_input.resolve_names("input", inputs, self.layout.inputs, self.layout.aliases)
    kernel = _regressor_kernel(self, self.inverse_kernel(given), loads)
    values = self.parameter_vector(p) if isinstance(p, Mapping) else rows_of("p", p, len(self.layout.parameters))
    return parameter_values(kernel, values)


def _regressor_kernel(self: CompiledModel, inverse: InverseKernel, loads: Iterable[Any]) -> RegressorKernel:
    further = run_input.resolve_names("parameter", loads, self.layout.parameters, self.layout.aliases)
    return self.regressor_kernel(inverse.given, tuple(dict.fromkeys(further)))


def _at(
    self: CompiledModel, what: str, point: tuple[Any, Any, Any, Any, Any], inputs: Any, states: Any
) -> tuple[InverseKernel, tuple[FloatArray, FloatArray, FloatArray, bool]]:
    """Return the kernel of inverse dynamics for (t, q, qdot, qddot, p), and its arguments as `rows_at` returns them."""
    t, q, qdot, qddot, p = point
    traces = Capability.STATE_FUNCTIONS in backend_named(self.backend).capabilities
    if traces and traced(*point, inputs, states):
        raise CapabilityError(
            f"{what} takes numbers, not values that JAX traces: solve M q_ddot = forcing + B u with"
            " model.functions.mass_matrix and model.functions.forcing"
        )
    given = run_input.resolve_names("input", inputs or (), self.layout.inputs, self.layout.aliases)
    inverse = self.inverse_kernel(given)
    if isinstance(states, Mapping):
        states = {**dict.fromkeys(self.layout.held, 0.0), **states}
    elif states is None and inverse.reads_states:
        require_states_given(self, what)
    times, y, p, single = rows_at(self, {"q": q, "qdot": qdot, "qddot": qddot}, t, p, states)
    free = {name: 0.0 for name in self.layout.inputs if name not in given}
    return inverse, (times, y, parameters_with_inputs(self, p, times, {**(inputs or {}), **free}), single)
