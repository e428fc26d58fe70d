"""Parameters that stand only in events and reductions: given with a run, and not in the scene."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

from ..scene.expressions import symbols_called

if TYPE_CHECKING:
    from ..results.sampler import CaseSet
    from .base import Model

__all__ = ["watched_expressions", "with_event_parameters"]

M = TypeVar("M", bound="Model[Any, Any]")


def with_event_parameters(
    model: M, parameters: Mapping[Any, Any], events: Any, reduce: Any = None, grid: CaseSet | None = None
) -> M:
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
    return model._with_parameters(found) if found else model


def watched_expressions(events: Any, reduce: Any, aliases: Mapping[str, str]) -> Iterable[Any]:
    """Yield the expressions of events, of the jumps that they apply, and of reductions."""
    from ..integrators.event_code import event_list
    from .reductions import reduction_table

    for event in event_list(events, aliases):
        yield event.expression
        yield from (event.apply or {}).values()
    for reduction in reduction_table(reduce, aliases).values():
        yield reduction.expression
