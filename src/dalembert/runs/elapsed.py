"""Runs that begin at another time than zero, in the time since their start.

Steps and states of such a run would be rounded as its times are. So it begins at zero, and its results are counted from
the start afterwards. Where time itself occurs in the scene, or in what is watched, and times are far from zero, the run
is that of another model of the scene, in which time is the elapsed one (`dalembert.scene.expressions.elapsed`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..frozen import frozen
from ..scene.expressions.elapsed import Offset, time_symbol, timed
from ..scene.symbol_table import SymbolTable
from ..starts.inputs import named_parameters
from ..steps.problem import times_wanted
from .events import moving_events

if TYPE_CHECKING:
    from ..events.event_code import Event
    from ..model.model import CompiledModel
    from .reductions import Reduction

FAR = 16.0
"""Times that are larger than this many spans count as far from zero: below, the rounding of both is much the same."""

_AT = re.compile(r"\bat t = ([-+.\deinfa]+)")


def begins_elsewhere(t0: Any, t1: Any) -> bool:
    """Whether a run over a span, or one of many, begins at another time than zero and takes time."""
    if (type(t0) is float and t0 == 0.0) or (type(t0) is np.ndarray and t0.shape == (1,) and t0.item() == 0.0):
        return False
    first, last = np.asarray(t0, dtype=float), np.asarray(t1, dtype=float)
    if not first.any():  # NaN is not false
        return False
    with np.errstate(invalid="ignore"):
        return bool(np.any((first != 0.0) & (first != last) & np.isfinite(first) & np.isfinite(last)))


def far(t0: Any, t1: Any) -> NDArray[np.bool_]:
    """Return which spans have times that are far from zero; those that take no time have not."""
    first, last = np.asarray(t0, dtype=float), np.asarray(t1, dtype=float)
    with np.errstate(invalid="ignore"):
        later = np.maximum(np.abs(first), np.abs(last)) > FAR * np.abs(last - first)
        return np.asarray(later & (first != 0.0) & (first != last))


def elapsed_times(t0: float, t1: float, t_eval: FloatArray | None) -> FloatArray | None:
    """Return times to record, checked, since the start of a span."""
    if t_eval is None:
        return None
    times_wanted(t0, t1, t_eval)
    return t_eval - t0


@final
@frozen(eq=False)
class ElapsedRequest:
    """Events and reductions of a model that runs in the time since a start.

    Attributes
    ----------
    other : bool
        Whether that is another model of the scene, because time itself occurs in it, or in what is watched.
    watched : tuple of SymPy expressions
        Those of events and reductions in which time itself occurs.
    events, reductions
        As that model takes them.
    """

    other: bool
    watched: tuple[Any, ...]
    events: tuple[Event, ...]
    reductions: dict[str, Reduction]


def elapsed_request(
    symbols: SymbolTable, span: tuple[Any, Any], events: Any, reduce: Any = None
) -> ElapsedRequest | None:
    """Return the events and reductions of a run, or many, in elapsed time; None where time is left as it is."""

    def meant(expression: Any) -> Any:
        called = isinstance(expression, str) and symbols.aliases.get(expression, expression) == symbols.time
        return time_symbol() if called else expression

    from ..events.event_code import event_list
    from .reductions import reduction_table

    listed = event_list(events, symbols.aliases)
    table = reduction_table(reduce, symbols.aliases)
    own = tuple(replace(event, expression=meant(event.expression), name=event.label) for event in listed)
    reductions = {name: replace(each, expression=meant(each.expression)) for name, each in table.items()}
    every = [event.expression for event in own] + [each.expression for each in reductions.values()]
    every += [value for event in own for value in (event.apply or {}).values()]
    watched = tuple(e for e in dict.fromkeys(every) if not isinstance(e, str) and timed(e))
    other = symbols.timed or bool(watched)
    return None if other and not np.any(far(*span)) else ElapsedRequest(other, watched, own, reductions)


def in_elapsed_time(
    model: CompiledModel, t0: Any, t1: Any, events: Any = (), reduce: Any = None
) -> tuple[CompiledModel | None, Any, Any]:
    """Return the model that runs a span, or many, in the time since its start; None where time is left as it is.

    Events and reductions are returned as that model takes them.
    """
    found = elapsed_request(model.equations.symbols, (t0, t1), events, reduce)
    if found is None:
        return None, events, reduce
    if not found.other:
        return model, events, reduce
    if found.watched:
        check_watched(model, events, reduce)  # errors are about the values as they were given
    return model.variants.in_elapsed_time(found.watched), found.events, found.reductions


def check_watched(model: CompiledModel, events: Any, reduce: Any) -> None:
    """Reject events and reductions that cannot be watched, as a run does."""
    if model.modes is not None:
        moving_events(model.layout, events)
        model = model.modes.model(model.modes.open_mode)
    model.derived.events(events, reduce)


def with_offsets(
    model: CompiledModel, other: CompiledModel, start: float, parameters: Mapping[Any, Any]
) -> Mapping[Any, Any]:
    """Return parameters with those that another model of the scene has for a start."""
    offsets = other.equations.symbols.offsets
    if not offsets:
        return parameters
    return {**parameters, **offset_values(offsets, start, named_parameters(model, parameters))}


def offset_values(offsets: Sequence[Offset], start: float, parameters: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters of expressions of time, with their values at the start of a run."""
    return {offset.name: offset.value(start, parameters) for offset in offsets}


def offset_columns(
    offsets: Sequence[Offset], starts: FloatArray, parameters: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Return the same for many cases, of starts (k,) or (1,) and parameters (k,) or (1,): columns (k,) or (1,)."""
    columns = {}
    for offset in offsets:
        names = [symbol.name for symbol in offset.symbols]
        given = np.stack(np.broadcast_arrays(starts, *(parameters[name] for name in names)), axis=1)
        rows, back = np.unique(given, axis=0, return_inverse=True)
        values = [offset.value(float(row[0]), dict(zip(names, row[1:].tolist(), strict=True))) for row in rows]
        columns[offset.name] = np.array(values)[back.ravel()]
    return columns


def noted_from(note: str, start: float) -> str:
    """Return a note of a run with its times counted from the start."""

    def moved(found: re.Match[str]) -> str:
        return f"at t = {start + float(found[1]):.12g}"

    return _AT.sub(moved, note)


def extension(
    names: Sequence[str], own: Sequence[str], offsets: Sequence[Offset], start: float
) -> Callable[[FloatArray], FloatArray]:
    """Return the function from parameters p (n_p,), named `own`, to those of a model with offsets, named `names`."""

    def extended(p: FloatArray) -> FloatArray:
        values = dict(zip(own, p.tolist(), strict=True))
        values |= offset_values(offsets, start, values)
        return np.array([values[name] for name in names])

    return extended
