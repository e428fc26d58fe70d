"""How one motion with contacts goes on, as compiled code sees it: when its phases end, and what follows them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from ...integrators.phase_tables import NOTHING_FIRED, Fleet, case_numbers
from ...integrators.workspace import RUNNING
from ...ir.program import Layout
from ...mechanics.equations import Watchpoint
from ...methods.status import Status
from ...reduction.modes import Mode
from .carrying import Carrier, Cause
from .instants import Instants
from .modes import Modes

__all__ = ["Lookout", "Seen", "Stop"]

_MOST_PHASES = 256
"""Phases that are seen at a time."""


@final
@dataclass(frozen=True, eq=False)
class Stop:
    """How a phase begins: the case, as it is decided, its mode, why, and how many phases before were too short."""

    now: Instants
    mode: Mode
    cause: Cause
    soon: int


@final
@dataclass(frozen=True, eq=False)
class Seen:
    """What is seen of a motion.

    Attributes
    ----------
    stops : list of Stop
    done : bool
        Whether the motion runs to its end after the last of them.
    now : Instants
        The case at the end of what is seen, for which a decision is to be made.
    fired : list of Watchpoint or None
        Because of what; None where there is no decision to make.
    """

    stops: list[Stop]
    done: bool
    now: Instants
    fired: list[Watchpoint] | None


@final
class Lookout:
    """Sees how a motion goes on.

    Parameters
    ----------
    modes : Modes
    layout : Layout
        Of the scene.
    options : mapping
        Method, tolerances, largest step and number of steps.
    span : (float, float)
        Of the whole motion.
    start : Instants
        The case where it starts.
    """

    def __init__(
        self, modes: Modes, layout: Layout, options: Mapping[str, Any], span: tuple[float, float], start: Instants
    ) -> None:
        self.modes = modes
        self.table: list[Mode] = []
        self.causes: list[Cause] = [(None, ())]
        k, nothing = len(modes.equations.contacts), np.zeros(0, np.int64)
        self.now = start.part(np.arange(1))
        self.numbers = case_numbers(1)
        self.log = np.empty((_MOST_PHASES, 4 + 3 * k + start.x.shape[1]))
        now, none = self.now, np.empty((0, 0))
        cases = Fleet(
            now.t,
            np.array([span[1]]),
            np.array([span[1] - span[0]]),
            now.passed,
            now.x,
            now.c,
            now.directions.reshape(1, 2 * k),
            now.sides,
            now.speeds,
            self.numbers,
            np.empty((1, 0)),
            nothing,
            nothing,
            np.empty(0),
            np.empty(0),
            none,
            nothing,
            none,
            none,
            self.log,
        )
        self.carrier = Carrier(modes, layout, {**options, "threads": 1}, (), cases, self.table, self.causes)

    def look(self, now: Instants, mode: Mode, cause: Cause, soon: int) -> Seen | None:
        """Return what is seen of a motion from an instant on; None where there is no compiled code for its mode."""
        for name in ("t", "x", "directions", "sides", "speeds", "passed"):
            getattr(self.now, name)[...] = getattr(now, name)
        numbers, begin = self.numbers, now.t
        for known, value in ((self.table, mode), (self.causes, cause)):
            if value not in known:
                known.append(value)  # type: ignore[arg-type]
        for values in numbers:
            values[:] = 0
        numbers.state[:], numbers.station[:], numbers.fired[:] = RUNNING, -1, NOTHING_FIRED
        numbers.mode[:], numbers.cause[:] = self.table.index(mode), self.causes.index(cause)
        numbers.soon[:], self.log[:, 0] = soon, np.nan
        if not self.carrier.carry(np.zeros(1, np.intp)):
            return None
        stops = []
        for line in self.log[~np.isnan(self.log[:, 0])]:
            stops.append(self._stop(line, begin))
            begin = stops[-1].now.t
        last, bits = self.now.part(np.arange(1)), int(numbers.fired[0])
        if bits == NOTHING_FIRED:
            done = numbers.state[0] == Status.SUCCESS and last.t[0] != begin[0]
            return Seen(stops, bool(done), last, None)
        here = self.table[numbers.mode[0]]
        fired = [point for i, point in enumerate(self.modes.points(here)) if bits >> i & 1]
        self.carrier.learn(np.zeros(1, np.intp), here, fired)
        return Seen(stops, False, last, fired)

    def _stop(self, line: Sequence[float], begin: Any) -> Stop:
        k, row = len(self.modes.equations.contacts), np.array(line)
        directions = np.zeros((1, k, 2))
        t, directions[0, :, 0] = row[:1], row[4 : 4 + k]
        sides, speeds = row[np.newaxis, 4 + k : 4 + 2 * k], row[np.newaxis, 4 + 2 * k : 4 + 3 * k]
        now = Instants(t, row[np.newaxis, 4 + 3 * k :], self.now.c, directions, sides, speeds, t - begin)
        return Stop(now, self.table[int(row[1])], self.causes[int(row[2])], int(row[3]))
