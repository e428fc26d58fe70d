"""Events: what users say of them, and what an integration needs to know of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..codegen.base import FloatArray
from ..errors import OptionError
from ..integrators.watched import Jump, Rule, Watched
from ..ir.interpret import interpret_rows
from ..ir.program import Kernel, Program
from ..reduction.starting import Start
from ..reduction.watching import Watch, jumping, watching
from ..results.trajectory import projected

if TYPE_CHECKING:
    from ..compiler import Stages

__all__ = ["Event", "EventCode", "compiled_events", "event_list"]


@final
@dataclass(frozen=True)
class Event:
    """Something that happens where an expression changes its sign.

    Parameters
    ----------
    expression : str or SymPy expression
        Of coordinates, rates, parameters and time, or the name of an output, of a component of the state, or of an
        energy.
    terminal : bool or int
        Whether the run ends there; a number ends it at that occurrence.
    direction : {0, 1, -1}
        1 for changes from minus to plus only, -1 for the others only, in the order in which the motion is
        integrated.
    apply : mapping of symbols or names to expressions, optional
        Coordinates and rates that jump, and what they are after it in terms of the state before, as in
        ``{y.diff(): -e * y.diff()}``. What is not in it stays.
    name : str, optional
        What results call it; by default, the text of the expression.

    Raises
    ------
    OptionError
        For a direction or a number of occurrences that does not exist.
    """

    expression: Any
    terminal: bool | int = False
    direction: int = 0
    apply: Mapping[Any, Any] | None = None
    name: str | None = None

    def __post_init__(self) -> None:
        faults = []
        if self.direction not in (-1, 0, 1):
            faults.append(f"direction must be 1 (from minus to plus), -1 or 0 (both), not {self.direction!r}")
        terminal: Any = self.terminal
        if not isinstance(terminal, int | np.integer) or terminal < 0:
            faults.append(f"terminal must be True, False or a number of occurrences, not {terminal!r}")
        changes: Any = self.apply
        if changes is not None and not (isinstance(changes, Mapping) and changes):
            faults.append(f"apply must map coordinates or rates to expressions, not {changes!r}")
        if faults:
            raise OptionError(f"event {self.label!r}: {'; '.join(faults)}")

    @property
    def label(self) -> str:
        """What results call it."""
        return str(self.expression) if self.name is None else self.name


def event_list(events: Any, aliases: Mapping[str, str]) -> tuple[Event, ...]:
    """Return events, each with its name, from a sequence of events, expressions and names, or from one of them.

    Raises
    ------
    OptionError
        When two have one name.
    """
    if isinstance(events, Event | str) or not isinstance(events, Iterable):
        events = (events,)
    made = [event if isinstance(event, Event) else Event(event) for event in events]
    listed = tuple(replace(event, name=aliases.get(event.label, event.label)) for event in made)
    labels = [event.label for event in listed]
    twice = sorted({label for label in labels if labels.count(label) > 1})
    if twice:
        raise OptionError(f"two events are called {', '.join(map(repr, twice))}; give each its own name=")
    return listed


@final
@dataclass(frozen=True, eq=False)
class EventCode:
    """Events as kernels: what is watched, and for each event the map of a jump, which `start` makes consistent."""

    program: Program
    events: tuple[Event, ...]
    watch: Watch
    jumps: tuple[Kernel | None, ...]
    start: Start

    def watched(self, c: FloatArray) -> Watched:
        """Return what an integration with the constants c (n_c,) needs to know."""
        program, watch = self.program, self.watch

        def begins(t: float, y: FloatArray) -> FloatArray:
            return interpret_rows(watch.begins, np.array([t]), y.reshape(1, -1), c).reshape(-1, 3)

        size = len(program.layout.state)
        jumps = [None if jump is None else self._jump(jump, c, size) for jump in self.jumps]
        rules = [Rule(e.direction, int(e.terminal), jump) for e, jump in zip(self.events, jumps, strict=True)]
        return Watched(
            values=lambda t, y: interpret_rows(watch.values, t, y, c),
            begins=begins,
            settle=lambda t, y: projected(program, c, t, y),
            rules=rules,
        )

    def _jump(self, jump: Kernel, c: FloatArray, size: int) -> Jump:
        def apply(t: float, y: FloatArray) -> FloatArray | None:
            time = np.array([t])
            given = interpret_rows(jump, time, y.reshape(1, -1), c)
            out = interpret_rows(self.start.kernel, time, given, c)[0]
            checks = out[size:]
            consistent = np.all(np.abs(checks[::2]) <= checks[1::2]) and np.all(np.isfinite(out))
            return out[:size] if consistent else None

        return apply


def compiled_events(stages: Stages, events: Sequence[Event], start: Callable[[Iterable[str]], Start]) -> EventCode:
    """Return events as kernels on the state of the formulation.

    Raises
    ------
    UnknownNameError, ExpressionError
        For expressions that cannot be watched, and for what cannot jump.
    """
    scene, reduced, layout = stages.scene, stages.reduced, stages.program.layout
    watch = watching(scene, reduced, [event.expression for event in events], "event", moving=True)
    jumps = [
        None if event.apply is None else jumping(scene, reduced, event.apply, f"event {event.label!r}")
        for event in events
    ]
    return EventCode(stages.program, tuple(events), watch, tuple(jumps), start((*layout.coordinates, *layout.rates)))
