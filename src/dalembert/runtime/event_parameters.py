"""Parameters that stand only in events and reductions: given with a run, and not in the scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

from ..scene.expressions import symbols_called

if TYPE_CHECKING:
    from ..ir.program import Layout
    from ..results.sampler import CaseSet
    from .model import CompiledModel

__all__ = ["event_parameters", "watched_expressions", "with_event_parameters"]

T = TypeVar("T")


def with_event_parameters(
    model: CompiledModel, parameters: Mapping[Any, Any], events: Any, reduce: Any = None, grid: CaseSet | None = None
) -> CompiledModel:
    """Return the model whose parameters include those that events and reductions of a run bring; itself without any."""
    return event_parameters(model, model.layout, parameters, events, reduce, grid, make=model.variants.with_parameters)


def event_parameters(
    model: T,
    layout: Layout,
    parameters: Mapping[Any, Any],
    events: Any,
    reduce: Any,
    grid: CaseSet | None,
    *,
    make: Callable[[tuple[Any, ...]], T],
) -> T:
    """Return what `make` makes of further parameters; `model` where there are none.

    They are the symbols of events and reductions that are given, and that the scene does not have. What is given and
    stands nowhere is left for the model to refuse.
    """
    if (reduce is None and isinstance(events, tuple) and not events) or not isinstance(parameters, Mapping):
        return model
    keys = (*parameters, *(grid.names if grid is not None else ()))
    if len(keys) <= len(layout.given) - len(layout.defaults):
        return model  # none is further where all are given, and names take time
    known = {*layout.parameters, *layout.variables, *layout.state, *layout.inputs}
    names = {str(key) for key in keys}
    further = {name for name in names if layout.aliases.get(name, name) not in known}
    if not further:
        return model
    found = symbols_called(further, watched_expressions(events, reduce, layout.aliases))
    return make(found) if found else model


def watched_expressions(events: Any, reduce: Any, aliases: Mapping[str, str]) -> Iterable[Any]:
    """Yield the expressions of events, of the jumps that they apply, and of reductions."""
    from ..integrators.event_code import event_list
    from .reductions import reduction_table

    for event in event_list(events, aliases):
        yield event.expression
        yield from (event.apply or {}).values()
    for reduction in reduction_table(reduce, aliases).values():
        yield reduction.expression
