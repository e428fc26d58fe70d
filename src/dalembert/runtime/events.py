"""Compilation of events: [Event] -> [EventCode]."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..integrators.event_code import Event, EventCode
from ..once import deriving
from ..reduction.event_functions import event_functions, jump_kernel
from ..reduction.starting import Start
from ..transforms.nonsmooth import nonanalytic_operations

if TYPE_CHECKING:
    from ..ir.graph import Node
    from ..pipeline import Stages
    from .reductions import Reduction

__all__ = [
    "compiled_events",
]


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
    table = dict(reductions or {})
    plan: dict[str, tuple[str, int]] = {}
    watched = list(events)
    running: list[Any] = []
    finals: list[Any] = []
    kinds: list[str] = []
    for name, reduction in table.items():
        if reduction.kind == "first crossing":
            plan[name] = reduction.kind, len(watched)
            watched.append(reduction.event(name))
        elif reduction.kind == "final":
            plan[name] = reduction.kind, len(finals)
            finals.append(reduction.expression)
        else:
            plan[name] = reduction.kind, len(running)
            running.append(reduction.expression)
            kinds.append(reduction.kind)
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
    return EventCode(
        program=stages.program,
        events=tuple(watched),
        reported=len(events),
        watch=watch,
        jumps=tuple(jumps),
        start=start(layout.variables),
        running=event_functions(scene, reduced, running, "reduction", moving=False).values,
        kinds=tuple(kinds),
        finals=event_functions(scene, reduced, finals, "reduction", moving=False).values,
        plan=plan,
        rank=rank,
        smooth=smooth and not margins and not nonanalytic_operations(watch.values),
    )
