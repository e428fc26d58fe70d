"""Methods of models that evaluate kernels: mass matrix, forcing, constraint Jacobian and accelerations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..arrays import FloatArray
from ..codegen import backend_named
from ..codegen.base import Capability
from ..errors import UnknownNameError, ValueInputError, list_names, nesting_named
from ..ir.program import coefficient_places
from ..starts import inputs as run_input
from ..starts.input_values import read_inputs
from ..starts.symbol_assumptions import ROUNDING, refuse_contradictions, rows_that_contradict
from ..stops.samples import Samples
from ..values import array_of, common_rows, times_of

if TYPE_CHECKING:
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


def _evaluate(
    self: CompiledModel,
    kernel: str,
    point: tuple[Any, Any, Any, Any],
    further: tuple[Any, Mapping[Any, Any] | None],
    shape: tuple[int, ...],
) -> FloatArray:
    """Return a kernel's outputs at (t, q, qdot, p) with (states, inputs), as users give them."""
    _require_states(self, kernel, further[0])
    if self.modes is None and Capability.STATE_FUNCTIONS in backend_named(self.backend).capabilities:
        functions = cast("TracedEngine", self.engine).state_functions
        if _traced(*point, *further):
            return cast("FloatArray", functions.at_coordinates(kernel, shape, point, further, self.inputs))
    (t, q, qdot, p), (states, inputs) = point, further
    size, at = len(self.layout.coordinates), times_of("t", t)
    q = rows_of("q", q, size)
    qdot = np.zeros_like(q) if qdot is None else rows_of("qdot", qdot, size)
    z = _states(self, states)
    single = q.ndim == 1 and qdot.ndim == 1 and z.ndim == 1 and np.ndim(t) == 0
    q, qdot, z = np.atleast_2d(q), np.atleast_2d(qdot), np.atleast_2d(z)
    count = common_rows({"q": len(q), "qdot": len(qdot), "t": len(at), "states": len(z)})
    y = np.empty((count, 2 * size + z.shape[1]))
    y[:, :size], y[:, size : 2 * size], y[:, 2 * size :] = q, qdot, z
    times = np.ascontiguousarray(np.broadcast_to(at, (count,)))
    if isinstance(p, Mapping):
        p = self.parameter_vector(p)
    p = rows_of("p", p, len(self.layout.parameters))
    if p.ndim > 1:
        raise ValueInputError(f"p must have shape ({len(self.layout.parameters)},), not {p.shape}: one for all states")
    _refuse_contradictions(self, q, p)
    p = _with_inputs(self, p, times, inputs)
    found = _outputs(self, kernel, times, y, p)
    out = np.zeros((count, *shape)) if found is None else found.reshape(count, *shape)
    return out[0] if single else out


def _traced(*given: Any) -> bool:
    """Return whether JAX traces a value in the arguments, mappings and records included; for models in JAX."""
    from ..jax.runs.precision import is_traced

    values = [each for value in given for each in (value.values() if isinstance(value, Mapping) else (value,))]
    records = [array for value in values if isinstance(value, Samples) for array in (value.t, value.values)]
    return is_traced(*values, *records)


def _with_inputs(self: CompiledModel, p: FloatArray, t: FloatArray, inputs: Mapping[Any, Any] | None) -> FloatArray:
    """Return parameters (n_p,), or (k, n_p) at times (k,), with the values of inputs."""
    places = [place + 1 for place in coefficient_places(self.layout.parameters, self.layout.inputs)]
    if inputs is None and not np.any(np.isnan(p[places])):
        return p
    given = read_inputs(self.layout, self.inputs, inputs, t)
    if given is None:
        return p
    rows = np.tile(p, (len(t), 1))
    given.write(self.layout, rows, t)
    return rows if given.sampled else rows[0]


def _require_states(self: CompiledModel, kernel: str, given: Any) -> None:
    """Refuse to evaluate a kernel that depends on first-order states where none are given.

    Raises
    ------
    ValueInputError
    """
    names = self.layout.states
    if given is None and names and _depends_on_states(self, kernel):
        raise ValueInputError(
            f"{kernel} depends on the first-order states of the scene; give states={{...}} for {list_names(names)}"
        )


def _depends_on_states(self: CompiledModel, kernel: str) -> bool:
    """Whether the outputs of a kernel depend on first-order states."""
    if self.modes is not None:
        return kernel != "mass_matrix"
    program, first = self.stages.program, 2 * len(self.layout.coordinates)
    loads = program.kernel(kernel).loads if kernel in program else ()
    return any(load.array == "y" and load.index is not None and load.index >= first for load in loads)


def _outputs(self: CompiledModel, kernel: str, t: FloatArray, x: FloatArray, p: FloatArray) -> FloatArray | None:
    """Return outputs (k, n_out) at times (k,), variables x (k, 2 n_q + n_z) and parameters (n_p,) or (k, n_p).

    The variables are coordinates, rates and first-order states. None stands for zeros.
    """
    if self.modes is not None:
        return self.modes.decisions.evaluate(kernel, t, x, p)
    program = self.stages.program
    if kernel not in program:
        return None
    if p.ndim == 1:
        return self.engine.evaluate(kernel, t, x, run_input.constants(program, p))
    if program.conditions is not None:
        program.conditions.decide_at(p, t)
    return self.engine.rows(program.kernel(kernel), t, x, run_input.prepare_rows(program, p))


def _states(self: CompiledModel, given: Any) -> FloatArray:
    """Return first-order states (n_z,) or (k, n_z), zeros where nothing is given."""
    names = self.layout.states
    if isinstance(given, Mapping):
        values = run_input.resolve("state", given, names, self.layout.aliases)
        missing = [name for name in names if name not in values]
        if missing:
            raise UnknownNameError(f"missing states: {list_names(missing)}. The scene has: {list_names(names)}")
        return np.array([values[name] for name in names])
    return np.zeros(len(names)) if given is None else rows_of("states", given, len(names))


def _refuse_contradictions(self: CompiledModel, q: FloatArray, p: FloatArray) -> None:
    """Refuse arrays of coordinates (k, n_q) and parameters (n_p,) with numbers that their symbols exclude."""
    layout = self.layout
    for names, table, rounding in ((layout.coordinates, q, ROUNDING), (layout.parameters, p[np.newaxis], 0.0)):
        for row in table[rows_that_contradict(layout.assumptions, names, table, rounding)]:
            refuse_contradictions(layout.assumptions, dict(zip(names, row.tolist(), strict=True)), rounding)


def rows_of(name: str, values: Any, size: int) -> FloatArray:
    """Return an array (size,) or (k, size) that a user gave.

    Raises
    ------
    ValueInputError
        For another shape, and for what are no numbers.
    """
    try:
        array = array_of(values)
    except ValueError as reason:
        raise ValueInputError(f"{name} = {values!r} {reason}") from None
    if array.ndim not in (1, 2) or array.shape[-1] != size:
        raise ValueInputError(f"{name} must have shape ({size},) or (k, {size}), not {array.shape}")
    return array


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
