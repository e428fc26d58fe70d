"""Inputs of traced runs: what users give them, read and checked, and their values at times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..codegen.printers import JAX
from ..errors import OptionError, UnknownNameError, ValueInputError, list_names
from ..ir.program import Layout, Program, coefficient_places
from ..methods.status import Status
from ..options import SolveOptions
from ..scene.symbol_table import InputSymbol
from ..stops.feedback import Feedback
from ..stops.samples import Samples, checked_samples, refuse_kind, refuse_samples, unknown_input
from .arguments import COLUMNS, knots_of, polynomials
from .elapsed import expansion_in_elapsed_time
from .feedback import FeedbackKernels, checked_feedback, function_of_weights, weights_of
from .modules import compile_kernel
from .pieces import EXPLICIT
from .runs.precision import is_traced, precision_of
from .runs.run_constants import stacked

Given = dict[str, Samples | Feedback]
"""Inputs that are functions of time, by name."""

_NEAR = 16.0
"""Least shares of the time within which an event counts as one at a knot."""


def inputs_of(
    layout: Layout, symbols: Sequence[InputSymbol], inputs: Mapping[Any, Any] | None, t: Any
) -> tuple[dict[str, Any], Given]:
    """Return inputs that are constant in time, by name, and the others.

    Raises
    ------
    UnknownNameError
        For what is no input, and inputs that are given twice.
    ValueInputError
        For samples for many cases, too short ones, and those of a kind that is not smooth enough.
    OptionError
        For functions that are not supported.
    """
    if inputs is None:
        return {}, {}
    if not isinstance(inputs, Mapping):
        raise ValueInputError(
            f"inputs must be a mapping of names or symbols to numbers, samples or functions, not {inputs!r}"
        )
    known = {symbol.name: symbol for symbol in symbols}
    numbers: dict[str, Any] = {}
    given: Given = {}
    wrong = []
    for key, value in inputs.items():
        name = layout.aliases.get(str(key), str(key))
        if name not in known:
            wrong.append(unknown_input(layout, name, str(key), list(known)))
        elif name in numbers or name in given:
            wrong.append(f"input {name!r} is given twice")
        elif isinstance(value, Samples):
            given[name] = _checked(known[name], value, t)
        elif isinstance(value, Feedback) or callable(value):
            given[name] = checked_feedback(known[name], value, len(layout.coordinates))
        else:
            numbers[name] = value
    if wrong:
        raise UnknownNameError("\n".join(wrong))
    return numbers, given


def refuse_given(given: Given, options: SolveOptions) -> None:
    """Reject inputs that are functions of time where the method, or dense output, does not support them.

    Raises
    ------
    OptionError
    """
    if not given:
        return
    method, functions = options.method, [name for name in given if isinstance(given[name], Feedback)]
    if functions and method not in EXPLICIT:
        raise OptionError(
            f"solve_fn by {method!r} needs more of input {functions[0]!r} than the values of a function: take one of"
            f" {list_names(map(repr, EXPLICIT))}, or give samples"
        )
    if functions and options.dense:
        raise OptionError(
            f"dense output does not know the function of input {functions[0]!r}: leave out dense=True, and give solve"
            " the times that are wanted"
        )


def _checked(symbol: InputSymbol, record: Samples, t: Any) -> Samples:
    """Return a record, rejected where it is known not to cover a run along times t."""
    shape, knots = np.shape(record.values), len(record.t)
    if shape != (knots,):
        raise ValueInputError(
            f"input {symbol.name!r} has values of shape {shape} and this is one run: give values of shape ({knots},),"
            " those of a case, and vectorise over the cases: jax.vmap(lambda values: solve(t, initial, p,"
            f" inputs={{{symbol.name!r}: da.samples(times, values)}}))(values)"
        )
    refuse_kind(symbol, record)
    if not is_traced(record.t, record.values):
        record = checked_samples(symbol.name, record)
    if not is_traced(record.t, t):
        times = np.asarray(t)
        refuse_samples(symbol, record, float(times.min()), float(times.max()))
    return record


def parameters_at(
    layout: Layout, symbols: Sequence[InputSymbol], given: Given, p: Any, t: Any, forward: Any
) -> tuple[Any, Any]:
    """Return parameters (n_t, n_p) with records as they are at times t (n_t,), and whether these are knots (n_t,).

    `forward` is 1 in runs that go forward in time, else -1; at a knot, the record is that ahead.
    """
    known = {symbol.name: symbol for symbol in symbols}
    rows, at_knots = jnp.broadcast_to(p, (len(t), len(p))), jnp.zeros(len(t), bool)
    still = jax.lax.stop_gradient(t)
    for name, record in given.items():
        assert isinstance(record, Samples)
        begin, stop = COLUMNS[record.kind]
        (place,) = coefficient_places(layout.parameters, (name,))
        knots = knots_of(known[name], record)
        fixed = jax.lax.stop_gradient(knots)
        number = (jnp.searchsorted(fixed, still, side=side) for side in ("right", "left"))
        piece = jnp.where(forward > 0.0, *number)
        rows = rows.at[:, place + begin : place + stop].set(polynomials(knots, record)[piece])
        near = _NEAR * precision_of(knots).smallest_of_time * jnp.maximum(jnp.abs(still), 1.0)
        at_knots |= jnp.any(jnp.abs(still[:, None] - fixed) <= near[:, None], axis=1)
    return rows, at_knots


def feedback_kernels(program: Program, given: Given, start: int) -> FeedbackKernels | None:
    """Return the inputs of a run that are functions, for kernels whose constant `start` is its start; None without."""
    functions = {name: value for name, value in given.items() if isinstance(value, Feedback)}
    if not functions:
        return None
    layout = program.layout
    n, first, each = len(layout.coordinates), 0, []
    for name, value in functions.items():
        each.append(function_of_weights(name, value, n, first))
        first += len(weights_of(value))
    places = tuple(place + 1 for place in coefficient_places(layout.parameters, tuple(functions)))
    expand = compile_kernel(expansion_in_elapsed_time(program), JAX)
    return FeedbackKernels(tuple(each), places, start, n, expand, stacked(expand))


def failed(status: Any, wrong: Any) -> Any:
    """Return the status of a run, or of what is wrong with its inputs."""
    return jnp.where(wrong == int(Status.SUCCESS), status, wrong)
