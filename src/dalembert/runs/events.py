"""Events of runs: their expressions, the parameters that stand only in them, and their compilation."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..errors import ExpressionError
from ..events.event_code import Event, EventCode
from ..ir.program import DIRECTION
from ..once import deriving
from ..reduction.event_functions import event_functions, jump_kernel
from ..reduction.starting import Start
from ..scene.expressions.identity import symbols_called
from ..transforms.taylor.nonsmooth import nonanalytic_operations

if TYPE_CHECKING:
    from ..ir.kernel import Kernel
    from ..ir.node import Node
    from ..ir.program import Layout
    from ..model.model import CompiledModel
    from ..pipeline import Stages
    from ..results.cases import CaseSet
    from .reductions import Reduction


def with_event_parameters(
    model: CompiledModel, parameters: Mapping[Any, Any], events: Any, reduce: Any = None, grid: CaseSet | None = None
) -> CompiledModel:
    """Return the model whose parameters include those that events and reductions of a run bring; itself without any.

    They are the symbols of events and reductions that are given, and that the scene does not have. What is given and
    stands nowhere is left for the model to reject.
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


@deriving
def compiled_events(
    stages: Stages,
    events: Sequence[Event],
    start: Callable[[Iterable[str]], Start],
    reductions: Mapping[str, Reduction] | None = None,
    margins: Mapping[str, Node] | None = None,
) -> EventCode:
    """Return events and reductions as kernels on the state of the formulation.

    `margins` are functions by name whose fall through zero is to be watched too, as that of the rank of constraints.

    Raises
    ------
    UnknownNameError, ExpressionError
        For expressions that cannot be watched, and for what cannot jump.
    """
    scene, reduced, layout = stages.scene, stages.reduced, stages.program.layout
    plan, crossings, running, finals = _planned(reductions or {}, len(events))
    watched = [*events, *crossings]
    ends = {p.output for p in reduced.equations.guards if p.kind not in ("meet", "kink")}
    smooth = bool(watched) and all(e.expression in ends and e.terminal and e.apply is None for e in watched)
    rank = len(watched) if margins else -1
    watched += [Event(name, direction=-1) for name in margins or {}]
    jumps = [
        None
        if event.apply is None
        else jump_kernel(scene, reduced, event.expression, event.apply, f"event {event.label!r}")
        for event in watched
    ]
    moving = stages.mode is None  # what one mode keeps constant, as the reaction of an open contact, another moves
    watch = event_functions(
        scene, reduced, [event.expression for event in watched], "event", moving=moving, names=margins
    )

    def values(items: Iterable[Reduction]) -> Kernel:
        return event_functions(scene, reduced, [item.expression for item in items], "reduction", moving=False).values

    return EventCode(
        program=stages.program,
        events=tuple(watched),
        reported=len(events),
        watch=watch,
        jumps=tuple(jumps),
        start=start((*layout.variables, DIRECTION)),
        running=values(running),
        kinds=tuple(item.kind for item in running),
        finals=values(finals),
        plan=plan,
        rank=rank,
        smooth=smooth and not margins and not nonanalytic_operations(watch.values),
    )


def _planned(
    reductions: Mapping[str, Reduction], events: int
) -> tuple[dict[str, tuple[str, int]], list[Event], list[Reduction], list[Reduction]]:
    """Return where results of reductions come from, events of first crossings, reductions along motions, and at ends.

    The results are, by name, the kind of a reduction and its number among the events (behind so many `events` of the
    user) or the reductions of its kind.
    """
    plan: dict[str, tuple[str, int]] = {}
    crossings: list[Event] = []
    running: list[Reduction] = []
    finals: list[Reduction] = []
    for name, reduction in reductions.items():
        if reduction.kind == "first crossing":
            plan[name] = reduction.kind, events + len(crossings)
            crossings.append(reduction.event(name))
        else:
            own = finals if reduction.kind == "final" else running
            plan[name] = reduction.kind, len(own)
            own.append(reduction)
    return plan, crossings, running, finals
