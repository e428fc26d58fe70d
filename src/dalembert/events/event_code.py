"""Events and reductions: `Event`, and `EventCode` with their kernels."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError, nesting_named
from ..frozen import frozen
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.ops import OSCILLATING_OPERATIONS
from ..ir.program import DIRECTION, WIDTH, Program, coefficient_places
from ..methods.status import SUSPECT, Status
from ..reduction.event_functions import EventFunctions
from ..reduction.starting import Start
from ..steps.dense_output import DenseOutput, JoinedOutput
from ..steps.projection import projected
from ..stops.segments import Constants, Segments
from ..values import listed as members
from .reductions import running_values


def suspected(ends: FloatArray, happened: FloatArray) -> None:
    """Mark cases (ends (k, 3)) that came near a lost rank, as `happened` (k,) counts, for `check_cases`."""
    near = happened > 0.0
    ends[near, 1] = SUSPECT - ends[near, 1]


@final
@frozen
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
        ``{y.diff(): -e * y.diff()}``, or ``{"omega_T_x": 0}`` of a free orientation. Others stay.
    name : str, optional
        What results call it; by default, the text of the expression.

    Raises
    ------
    OptionError
        For a direction or a number of occurrences that does not exist.

    Examples
    --------
    A pendulum that passes its lowest point, and strikes an elastic stop::

        lowest = da.Event(theta, direction=1, name="lowest")
        stop = da.Event(theta - 0.5, direction=1, apply={theta.diff(): -theta.diff()}, name="stop")
        run = model.simulate((0, 10), {theta: 0.2, theta.diff(): 2}, {m: 1, l: 1, g: 9.81}, events=[lowest, stop])
        run.events["stop"].t, run.events["stop"].before["theta_dot"]
    """

    expression: Any
    terminal: bool | int = False
    direction: int = 0
    apply: Mapping[Any, Any] | None = None
    name: str | None = None

    @nesting_named
    def __post_init__(self) -> None:
        faults = []
        if not isinstance(self.expression, Hashable):
            faults.append(f"the expression must be a name or a SymPy expression, not {self.expression!r}")
        if self.name is not None and not isinstance(self.name, str):
            faults.append(f"the name must be a text, not {self.name!r}")
        direction: Any = self.direction
        if not isinstance(direction, int | float | np.number) or direction not in (-1, 0, 1):
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
        """Name of the event in results."""
        return str(self.expression) if self.name is None else self.name


def armed(event: Event) -> Event:
    """Return a directed event that has not occurred where the motion begins, even if its expression is zero there.

    So no rounding decides on which side it begins: if the expression does not leave zero against the direction, the
    event occurs at once. Its direction counts twice.
    """
    marked = replace(event)
    object.__setattr__(marked, "direction", 2 * event.direction)
    return marked


def event_list(events: Any, aliases: Mapping[str, str]) -> tuple[Event, ...]:
    """Return events, each with its name, from a sequence of events, expressions and names, or from one of them.

    Raises
    ------
    OptionError
        When two have one name.
    """
    if events is None:
        return ()
    if isinstance(events, Event | str) or not isinstance(events, Iterable):
        events = (events,)
    events = members("events", events, "expressions or Events")
    made = [event if isinstance(event, Event) else Event(event) for event in events]
    names = [aliases.get(event.label, event.label) for event in made]
    listed = tuple(e if e.name == name else replace(e, name=name) for e, name in zip(made, names, strict=True))
    labels = [event.label for event in listed]
    twice = sorted({label for label in labels if labels.count(label) > 1})
    if twice:
        raise OptionError(f"two events are called {', '.join(map(repr, twice))}; give each its own name=")
    return listed


@final
@frozen(eq=False)
class EventCode:
    """Events and reductions as kernels.

    Attributes
    ----------
    program : Program
        Of the model.
    events : tuple of Event
        The requested events, then those whose first times are reductions.
    reported : int
        Number of requested events.
    watch, jumps, start
        The watched expressions, and for each event the map of a jump or None, which `start` makes consistent. It takes
        the results of the map, and the direction of time where it depends on that.
    running, kinds
        Kernel of the expressions whose minima, maxima and integrals are taken, and which of these.
    finals
        Kernel of the expressions whose final values are taken.
    plan : mapping of str to (str, int)
        Kind of each reduction, and its number among those of its kind.
    rank : int
        Number of the first event for a lost rank of constraints, which all others follow; -1 without any.
    smooth : bool
        Whether every event is what ends a mode of contacts, of which none is open, and has a series wherever the motion
        has one.
    """

    program: Program
    events: tuple[Event, ...]
    reported: int
    watch: EventFunctions
    jumps: tuple[Kernel | None, ...]
    start: Start
    running: Kernel
    kinds: tuple[str, ...]
    finals: Kernel
    plan: Mapping[str, tuple[str, int]]
    rank: int = -1
    smooth: bool = False

    @cached_property
    def reads_inputs(self) -> bool:
        """Whether watched expressions depend on inputs, and may jump or have kinks at their knots."""
        layout, kernels = self.program.layout, (self.watch.values, self.watch.begins, self.running)
        places = coefficient_places(layout.parameters, layout.inputs)
        hidden = {place + i for place in places for i in range(WIDTH)}
        return any(load.array == "c" and load.index in hidden for kernel in kernels for load in kernel.loads)

    @cached_property
    def oscillating(self) -> bool:
        """Whether watched expressions may oscillate within a step, however smooth the motion is.

        In free flight a step is as long as the span, and sin(theta) goes through many periods in it.
        """
        return _oscillating(self.watch.values)

    @cached_property
    def running_oscillates(self) -> bool:
        """Whether so may expressions whose minima, maxima and integrals are taken."""
        return _oscillating(self.running)

    @property
    def along(self) -> bool:
        """Whether anything has to be watched along the motions, and not only at their ends."""
        return bool(self.events or self.kinds)

    @property
    def labels(self) -> list[str]:
        """Names of the requested events."""
        return [event.label for event in self.events[: self.reported]]

    def conclude(self, ends: FloatArray, happened: FloatArray) -> None:
        """Mark cases (ends (k, 3), happened (k, 3 n_events)) that came near a lost rank."""
        if self.rank >= 0:
            suspected(ends, np.sum(happened[:, 3 * self.rank :: 3], axis=1))

    def totals(self, c: Constants, dense: DenseOutput | None) -> FloatArray:
        """Return minima, maxima and integrals (n,) along a motion with the constants c (n_c,)."""

        def sampled(part: DenseOutput) -> Callable[[int, FloatArray], FloatArray]:
            def values(step: int, theta: FloatArray) -> FloatArray:
                t = part.knots[step] + theta * (part.knots[step + 1] - part.knots[step])
                own = _during(c, part.knots[step], part.knots[step + 1])
                y = projected(self.program, own, t, part.within(np.full(len(theta), step), theta))
                return interpret_rows(self.running, t, y, own)

            return values

        motion = JoinedOutput(np.zeros(1), ()) if dense is None else dense
        return running_values(motion, sampled, self.kinds, self.running_oscillates)

    def reduced(
        self, start: FloatArray, ends: FloatArray, y: FloatArray, c: FloatArray, totals: FloatArray, first: FloatArray
    ) -> FloatArray:
        """Return the reductions (k, n) of a block of cases.

        Parameters
        ----------
        start, ends, y, c
            Starts (k,) or (1,), final times, statuses and steps (k, 3), final states (k, n_y) and constants (k, n_c).
        totals
            Minima, maxima and integrals (k, n_running).
        first
            Times of the first of each event (k, n_events).
        """
        t, status = ends[:, 0], ends[:, 1]
        finals = interpret_rows(self.finals, t, y, c) if self.finals.outputs else totals
        last = interpret_rows(self.running, t, y, c) if self.kinds else totals
        out = np.empty((len(t), len(self.plan)))
        for column, (kind, number) in zip(out.T, self.plan.values(), strict=True):
            if kind == "final":
                column[:] = finals[:, number]
            elif kind == "first crossing":
                column[:] = first[:, number]
            elif kind == "mean":
                times = t - start
                column[:] = last[:, number]
                np.divide(totals[:, number], times, out=column, where=times != 0.0)
            else:
                extreme = np.minimum if kind == "minimum" else np.maximum
                extreme(totals[:, number], last[:, number], out=column)
        ran = (status == _SUCCESS) | (status == _EVENT)
        if not ran.all():
            out[~ran] = np.nan
        return out

    def after_jump(
        self, jump: Kernel, t: FloatArray, y: FloatArray, c: FloatArray, directions: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return states (k, n_y) after a jump, and whether the constraints allow them (k,).

        Parameters
        ----------
        jump : Kernel
            One of `jumps`.
        t, y, c : ndarray (k,), (k, n_y), (n_c,) or (k, n_c)
            Times, states before the jump and constants.
        directions : ndarray (k,)
            1, or -1 for motions backwards in time.
        """
        given, size = interpret_rows(jump, t, y, c), len(self.program.layout.state)
        if DIRECTION in self.start.given:
            given = np.column_stack([given, directions])
        out = interpret_rows(self.start.kernel, t, given, c)
        checks = out[:, size:]
        allowed = np.all(np.abs(checks[:, ::2]) <= checks[:, 1::2], axis=1) & np.all(np.isfinite(out), axis=1)
        return out[:, :size], allowed


_SUCCESS, _EVENT = float(Status.SUCCESS), float(Status.EVENT)


def _oscillating(kernel: Kernel) -> bool:
    return any(line.op in OSCILLATING_OPERATIONS for line in kernel.body)


def _during(c: Constants, t0: float, t1: float) -> FloatArray:
    """Return the constants (n_c,) of the segment in which a step from t0 to t1 lies."""
    return c.at(np.array([t0 + 0.5 * (t1 - t0)]))[0] if isinstance(c, Segments) else c
