"""Expressions of events and reductions of runs, and the parameters that stand only in them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from ..errors import ExpressionError
from ..scene.expressions import symbols_called

if TYPE_CHECKING:
    from ..events.event_code import Event
    from ..ir.program import Layout
    from ..model.model import CompiledModel
    from ..results.cases import CaseSet


def with_event_parameters(
    model: CompiledModel, parameters: Mapping[Any, Any], events: Any, reduce: Any = None, grid: CaseSet | None = None
) -> CompiledModel:
    """Return the model whose parameters include those that events and reductions of a run bring; itself without any.

    They are the symbols of events and reductions that are given, and that the scene does not have. What is given and
    stands nowhere is left for the model to refuse.
    """
    if (reduce is None and isinstance(events, tuple) and not events) or not isinstance(parameters, Mapping):
        return model
    keys, layout = (*parameters, *(grid.names if grid is not None else ())), model.layout
    if len(keys) <= len(layout.given) - len(layout.defaults):
        return model  # none is further where all are given, and names take time
    known = {*layout.parameters, *layout.variables, *layout.state, *layout.inputs}
    names = {str(key) for key in keys}
    further = {name for name in names if layout.aliases.get(name, name) not in known}
    if not further:
        return model
    found = symbols_called(further, watched_expressions(events, reduce, layout.aliases))
    return model.variants.with_parameters(found) if found else model


def watched_expressions(events: Any, reduce: Any, aliases: Mapping[str, str]) -> Iterable[Any]:
    """Yield the expressions of events, of the jumps that they apply, and of reductions."""
    from ..events.event_code import event_list
    from .reductions import reduction_table

    for event in event_list(events, aliases):
        yield event.expression
        yield from (event.apply or {}).values()
    for reduction in reduction_table(reduce, aliases).values():
        yield reduction.expression


def moving_events(layout: Layout, events: Any) -> tuple[Event, ...]:
    """Return events, each of which moves in some mode.

    Raises
    ------
    ExpressionError
        For those that are constant along every motion.
    """
    from ..events.event_code import event_list

    listed = event_list(events, layout.aliases)
    for event in listed:
        watched = event.expression
        inside = getattr(watched, "free_symbols", ())
        names = {watched} if isinstance(watched, str) else {str(symbol) for symbol in inside}
        if names <= {*layout.parameters}:
            raise ExpressionError(
                f"event {event.label!r} is constant along every motion, so that nothing can be watched: write it"
                " in coordinates, rates, outputs or time"
            )
    return listed
