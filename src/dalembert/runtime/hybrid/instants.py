"""Cases at an instant: what is known of them when something happens to their contacts, and how they go on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...reduction.modes import Mode
from .deciding import Choice

__all__ = ["Instants", "Settled", "placed"]


@final
@dataclass(frozen=True, eq=False)
class Instants:
    """Cases at an instant: times (k,), states (q, q_dot) (k, 2 n_q), parameters (k, n_p), and what they slip with.

    `passed` (k,) is how long the last phase was, `directions` (k, n_contacts, 2) and `sides` (k, n_contacts) what it
    slipped with, and `speeds` (k, n_contacts) the sizes of the slip speeds so far.
    """

    t: FloatArray
    x: FloatArray
    c: FloatArray
    directions: FloatArray
    sides: FloatArray
    speeds: FloatArray
    passed: FloatArray

    @classmethod
    def starting(cls, t: FloatArray, x: FloatArray, c: FloatArray, contacts: int) -> Instants:
        """Return cases of which nothing else is known."""
        count = len(t)
        forward = np.tile(np.array([1.0, 0.0]), (count, contacts, 1))
        return cls(t, x, c, forward, np.ones((count, contacts)), np.zeros((count, contacts)), np.zeros(count))

    def part(self, some: NDArray[np.intp] | slice) -> Instants:
        """Return some of the cases; a slice gives views."""
        fields = (self.t, self.x, self.c, self.directions, self.sides, self.speeds, self.passed)
        return Instants(*(values[some] for values in fields))


def placed(some: NDArray[np.intp]) -> NDArray[np.intp] | slice:
    """Return numbers that rise, as a slice where none is left out."""
    if len(some) and int(some[-1]) - int(some[0]) + 1 == len(some):
        return slice(int(some[0]), int(some[-1]) + 1)
    return some


@final
@dataclass(frozen=True, eq=False)
class Settled:
    """How cases go on.

    Attributes
    ----------
    table : list of Mode
        The modes that occur.
    mode : ndarray (k,) of int
        Number of the mode of each case, -1 where the status is not SUCCESS.
    x, directions, sides, speeds
        As in `Instants`.
    status : ndarray (k,) of int
    """

    table: list[Mode]
    mode: NDArray[np.intp]
    x: FloatArray
    directions: FloatArray
    sides: FloatArray
    speeds: FloatArray
    status: NDArray[np.int64]

    @classmethod
    def copied(cls, now: Instants, speeds: FloatArray) -> Settled:
        """Return cases of which nothing is decided yet."""
        count = len(now.t)
        x, directions, sides = now.x.copy(), now.directions.copy(), now.sides.copy()
        return cls([], np.full(count, -1), x, directions, sides, speeds, np.zeros(count, np.int64))

    def put(self, cases: NDArray[np.intp], other: Settled) -> None:
        """Replace what is said of some cases."""
        for name in ("x", "directions", "sides", "speeds", "status"):
            getattr(self, name)[cases] = getattr(other, name)
        self.mode[cases] = -1
        for number, mode in enumerate(other.table):
            self.take(mode, cases[other.mode == number])

    def part(self, some: NDArray[np.bool_]) -> Settled:
        """Return some of the cases."""
        motion = (self.x[some], self.directions[some], self.sides[some], self.speeds[some])
        return Settled(self.table, self.mode[some], *motion, self.status[some])

    def record(self, cases: NDArray[np.intp], choice: Choice) -> None:
        """Take down what was chosen for some cases."""
        place = slice(None) if len(cases) == len(self.status) else cases
        self.status[place] = choice.status
        self.directions[place], self.sides[place] = choice.directions, choice.sides
        for number, mode in enumerate(choice.modes):
            here = choice.mode == number
            if np.any(here):
                self.take(mode, cases[here])

    def take(self, mode: Mode, cases: NDArray[np.intp]) -> None:
        """Put cases into a mode."""
        if mode not in self.table:
            self.table.append(mode)
        self.mode[cases] = self.table.index(mode)
