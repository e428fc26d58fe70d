"""Methods of models that evaluate kernels: mass matrix, forcing, constraint Jacobian and accelerations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..arrays import FloatArray
from ..codegen import backend_named
from ..codegen.base import Capability
from ..errors import CapabilityError, nesting_named
from ..ir.interpret import unit_rates
from ..starts import inputs as run_input
from ..values import common_rows, times_of
from .rows import parameters_with_inputs, require_states, rows_at, rows_of, traced

if TYPE_CHECKING:
    from ..analysis.rate_jacobians import RateJacobians
    from ..codegen.engine import TracedEngine
    from .model import CompiledModel


@nesting_named
def mass_matrix(
    self: CompiledModel, q: Any, p: Any, *, t: Any = 0.0, inputs: Mapping[Any, Any] | None = None, states: Any = None
) -> FloatArray:
    """Return the mass matrix.

    Of a model on the jax backend, arguments may be traced by JAX, and what is returned is traced and differentiated.

    Parameters
    ----------
    q : array_like (n_q,) or (k, n_q)
        Coordinates.
    p : mapping or array_like (n_p,)
        Parameters, by name or in the order of ``layout.parameters``.
    t : float or array_like (k,)
        Time [s], where the geometry depends on it.
    inputs : mapping, optional
        Values of the inputs, as for `simulate`; not needed where an array p has them.
    states : mapping or array_like (n_z,) or (k, n_z), optional
        First-order states, by name or in the order of ``layout.states``; no mass matrix depends on them.

    Returns
    -------
    ndarray (n_q, n_q) or (k, n_q, n_q)
    """
    point = t, q, None, p
    return _evaluate(self, "mass_matrix", point, (states, inputs), (len(self.layout.coordinates),) * 2)


@nesting_named
def forcing(
    self: CompiledModel,
    t: Any,
    q: Any,
    qdot: Any,
    p: Any,
    *,
    inputs: Mapping[Any, Any] | None = None,
    states: Any = None,
) -> FloatArray:
    """Return the given actions and bias terms, (n_q,) or (k, n_q): M q_ddot = forcing + reactions.

    Parameters are those of `mass_matrix`; `states` are the first-order states that they depend on.
    """
    return _evaluate(self, "forcing", (t, q, qdot, p), (states, inputs), (len(self.layout.coordinates),))


@nesting_named
def constraint_jacobian(
    self: CompiledModel, t: Any, q: Any, p: Any, *, inputs: Mapping[Any, Any] | None = None, states: Any = None
) -> FloatArray:
    """Return the Jacobian of the velocity constraints, (n_c, n_q) or (k, n_c, n_q), holonomic rows first.

    Parameters are those of `mass_matrix`; `states` are the first-order states that it depends on.
    """
    shape = (len(self.layout.constraints), len(self.layout.coordinates))
    return _evaluate(self, "constraint_jacobian", (t, q, None, p), (states, inputs), shape)


@nesting_named
def accelerations(
    self: CompiledModel,
    t: Any,
    q: Any,
    qdot: Any,
    p: Any,
    *,
    inputs: Mapping[Any, Any] | None = None,
    states: Any = None,
) -> FloatArray:
    """Return the second rates of the coordinates, (n_q,) or (k, n_q), constraints included.

    Parameters are those of `mass_matrix`; `states` are the first-order states that they depend on.
    """
    return _evaluate(self, "accelerations", (t, q, qdot, p), (states, inputs), (len(self.layout.coordinates),))


@nesting_named
def rate_jacobians(
    self: CompiledModel, t: Any, y: Any, p: Any, *, inputs: Mapping[Any, Any] | None = None
) -> RateJacobians:
    """Return the exact derivatives of the rates of the state by state and inputs, y_dot = f(t, y, u).

    For a robot in formulation "minimal" they hold the gradients of the accelerations by coordinates, speeds and torques
    (J. Carpentier, N. Mansard, Robotics: Science and Systems 2018), by composite bodies
    (`dalembert.mechanics.inverse_dynamics_gradients`). They are one compiled kernel, made at the first call.

    Parameters
    ----------
    t : float or array_like (k,)
        Time [s].
    y : array_like (n_y,) or (k, n_y)
        State in the order of ``layout.state``, as of `state`; quaternions have length one.
    p : mapping or array_like (n_p,)
        Parameters, by name or in the order of ``layout.parameters``.
    inputs : mapping, optional
        Values of the inputs, as for `simulate`; not needed where an array p has them.

    Returns
    -------
    RateJacobians
        ``by_state`` (n_y, n_y) or (k, n_y, n_y) and ``by_inputs`` (n_y, n_u) or (k, n_y, n_u). Derivatives by a unit
        quaternion are those along the sphere. Inputs that a controller holds are components of the state.

    Raises
    ------
    CapabilityError
        For contacts that change (take those of ``mode(...)``), and values that JAX traces.

    See Also
    --------
    linearize : independent states of scenes with constraints, derivatives by parameters, outputs.

    Examples
    --------
    The gradients of the second rates of an arm whose state is q, q_dot::

        by_state, by_inputs = model.rate_jacobians(0.0, [*q, *qdot], p, inputs=torques)
        n = len(q)
        by_q, by_qdot, inverse_inertia = by_state[n:, :n], by_state[n:, n:], by_inputs[n:]
    """
    from ..analysis.inverse_dynamics import at_times
    from ..analysis.rate_jacobians import RateJacobians

    if self.modes is not None:
        raise CapabilityError(
            f"{self.name!r} has rates for each mode of its contacts: take mode(...).rate_jacobians of one of them"
        )
    if Capability.STATE_FUNCTIONS in backend_named(self.backend).capabilities and traced(t, y, p, inputs):
        raise CapabilityError(
            "rate_jacobians takes numbers, not values that JAX traces: take jax.jacfwd of model.vector_field"
        )
    kernel, size = self.jacobian_kernel, len(self.layout.state)
    times, rows = times_of("t", t), rows_of("y", y, size)
    single = rows.ndim == 1 and np.ndim(t) == 0
    rows = np.atleast_2d(rows)
    count = common_rows({"y": len(rows), "t": len(times)})
    rows, times = np.broadcast_to(rows, (count, size)), np.broadcast_to(times, (count,))
    values = self.parameter_vector(p) if isinstance(p, Mapping) else rows_of("p", p, len(self.layout.parameters))
    values = parameters_with_inputs(self, values, times, inputs)
    found = self.engine.rows(kernel.kernel, times, rows, at_times(self, times, values))
    by_state, by_inputs = kernel.matrices(found, rows)
    return RateJacobians(by_state[0], by_inputs[0]) if single else RateJacobians(by_state, by_inputs)


def _evaluate(
    self: CompiledModel,
    kernel: str,
    point: tuple[Any, Any, Any, Any],
    further: tuple[Any, Mapping[Any, Any] | None],
    shape: tuple[int, ...],
) -> FloatArray:
    """Return a kernel's outputs at (t, q, qdot, p) with (states, inputs), as users give them."""
    require_states(self, kernel, further[0])
    if self.modes is None and Capability.STATE_FUNCTIONS in backend_named(self.backend).capabilities:
        functions = cast("TracedEngine", self.engine).state_functions
        if traced(*point, *further):
            return cast("FloatArray", functions.at_coordinates(kernel, shape, point, further, self.inputs))
    (t, q, qdot, p), (states, inputs) = point, further
    times, y, p, single = rows_at(self, {"q": q, "qdot": qdot}, t, p, states)
    p = parameters_with_inputs(self, p, times, inputs)
    found = _outputs(self, kernel, times, y, p)
    out = np.zeros((len(times), *shape)) if found is None else found.reshape(len(times), *shape)
    return out[0] if single else out


def _outputs(self: CompiledModel, kernel: str, t: FloatArray, x: FloatArray, p: FloatArray) -> FloatArray | None:
    """Return outputs (k, n_out) at times (k,), variables x (k, 2 n_q + n_z) and parameters (n_p,) or (k, n_p).

    The variables are coordinates, rates and first-order states. None stands for zeros.
    """
    if self.modes is not None:
        return self.modes.decisions.evaluate(kernel, t, x, p)
    program = self.stages.program
    if kernel == "mass_matrix" and "momenta" in program:
        kernel, count = "momenta", len(self.layout.coordinates)
        t, x = unit_rates(count, t, x)
        p = p if p.ndim == 1 else np.repeat(p, count, axis=0)
    if kernel not in program:
        return None
    if p.ndim == 1:
        return self.engine.evaluate(kernel, t, x, run_input.constants(program, p))
    if program.conditions is not None:
        program.conditions.decide_at(p, t)
    return self.engine.rows(program.kernel(kernel), t, x, run_input.prepare_rows(program, p))


def monitors(self: CompiledModel, c: FloatArray, t: FloatArray, x: FloatArray) -> dict[str, FloatArray]:
    """Return the first integrals along a motion, as arrays (n_t,) by name.

    Parameters
    ----------
    c : ndarray (n_c,) or (n_t, n_c)
        Constants.
    t, x : ndarray (n_t,), (n_t, 2 n_q + n_z)
        Times [s]; coordinates, rates and first-order states.
    """
    from ..starts.first_integrals import conserved

    return conserved(self.stages.program, self.derived.invariants, c, t, x)
