"""Compilation of events: [Event] -> [EventCode]."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from ..events.event_code import Event, EventCode
from ..ir.program import DIRECTION
from ..once import deriving
from ..reduction.event_functions import event_functions, jump_kernel
from ..reduction.starting import Start
from ..transforms.nonsmooth import nonanalytic_operations

if TYPE_CHECKING:
    from ..ir.kernel import Kernel
    from ..ir.node import Node
    from ..pipeline import Stages
    from .reductions import Reduction


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
    ends = {p.output for p in reduced.equations.guards if p.kind != "meet"}
    smooth = bool(watched) and all(e.expression in ends and e.terminal and e.apply is None for e in watched)
    rank = len(watched) if margins else -1
    watched += [Event(name, direction=-1) for name in margins or {}]
    jumps = [
        None if event.apply is None else jump_kernel(scene, reduced, event.apply, f"event {event.label!r}")
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
