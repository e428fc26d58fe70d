"""Arguments of evaluations as rows: times, coordinates, rates, first-order states and parameters that users give."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import FloatArray
from ..errors import UnknownNameError, ValueInputError, list_names
from ..ir.program import coefficient_places
from ..starts import inputs as run_input
from ..starts.input_values import read_inputs
from ..starts.symbol_assumptions import ROUNDING, ValueReader, refuse_contradictions, rows_that_contradict
from ..stops.samples import Samples
from ..values import array_of, common_rows, times_of

if TYPE_CHECKING:
    from .model import CompiledModel


def rows_at(
    self: CompiledModel, vectors: Mapping[str, Any], t: Any, p: Any, states: Any
) -> tuple[FloatArray, FloatArray, FloatArray, bool]:
    """Return times (k,), rows (k, n) of q, q_dot and states, and of further vectors, parameters (n_p,), and k is one.

    `vectors` are q, qdot and others of the size of q, as users give them; one that is None is zero.
    """
    size, at = len(self.layout.coordinates), times_of("t", t)
    read = {name: np.zeros(size) if v is None else rows_of(name, v, size) for name, v in vectors.items()}
    read["states"] = _states(self, states)
    single = all(v.ndim == 1 for v in read.values()) and np.ndim(t) == 0
    read = {name: np.atleast_2d(v) for name, v in read.items()}
    count = common_rows({**{name: len(v) for name, v in read.items()}, "t": len(at)})
    order = ["q", "qdot", "states", *(name for name in vectors if name not in ("q", "qdot"))]
    y = np.hstack([np.broadcast_to(read[name], (count, read[name].shape[1])) for name in order])
    times = np.ascontiguousarray(np.broadcast_to(at, (count,)))
    if isinstance(p, Mapping):
        p = self.parameter_vector(p)
    p = rows_of("p", p, len(self.layout.parameters))
    if p.ndim > 1:
        raise ValueInputError(f"p must have shape ({len(self.layout.parameters)},), not {p.shape}: one for all states")
    _refuse_contradictions(self, read["q"], p)
    return times, np.ascontiguousarray(y), p, single


def traced(*given: Any) -> bool:
    """Return whether JAX traces a value in the arguments, mappings and records included; for models in JAX."""
    from ..jax.runs.precision import is_traced

    values = [each for value in given for each in (value.values() if isinstance(value, Mapping) else (value,))]
    records = [array for value in values if isinstance(value, Samples) for array in (value.t, value.values)]
    return is_traced(*values, *records)


def parameters_with_inputs(
    self: CompiledModel, p: FloatArray, t: FloatArray, inputs: Mapping[Any, Any] | None
) -> FloatArray:
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


def require_states(self: CompiledModel, kernel: str, given: Any) -> None:
    """Raise an error if a kernel depends on first-order states and none are given.

    Raises
    ------
    ValueInputError
    """
    if given is None and self.layout.states and _depends_on_states(self, kernel):
        require_states_given(self, kernel)


def require_states_given(self: CompiledModel, kernel: str) -> None:
    """Raise because first-order states are not given.

    Raises
    ------
    ValueInputError
    """
    raise ValueInputError(
        f"{kernel} depends on the first-order states of the scene; give states={{...}} for"
        f" {list_names(self.layout.states)}"
    )


def _depends_on_states(self: CompiledModel, kernel: str) -> bool:
    """Whether the outputs of a kernel depend on first-order states."""
    if self.modes is not None:
        return kernel != "mass_matrix"
    program, first = self.stages.program, 2 * len(self.layout.coordinates)
    loads = program.kernel(kernel).loads if kernel in program else ()
    return any(load.array == "y" and load.index is not None and load.index >= first for load in loads)


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
    """Reject arrays of coordinates (k, n_q) and parameters (n_p,) with numbers that their symbols exclude."""
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


def read_parameters(self: CompiledModel) -> ValueReader:
    """Return the reader of parameters by name."""
    layout = self.layout
    return ValueReader(lambda given: run_input.parameter_values(layout, given), layout.aliases, layout.assumptions)


def read_initial(self: CompiledModel) -> ValueReader:
    """Return the reader of initial values by name."""
    layout = self.layout
    return ValueReader(
        lambda given: run_input.given_values(layout, given), layout.aliases, layout.assumptions, ROUNDING
    )
