"""Decisions by kernels: what `deciding` tries, computed for many cases at once without a linear system to solve.

It serves contacts that slip along one direction, one of which at most may begin to, and goes without impacts. What it
cannot be sure of is left to the numerical way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...integrators.mode_selection import REGULAR
from ...ir.kernel import Kernel
from ...mechanics.equations import EquationsOfMotion
from ...once import derived_once, derived_property
from ...reduction.modes import SLIP, STICK, Mode, side_name
from ...reduction.verdicts import Attempt, Verdict, slip_kernel, start_kernel, verdict
from .deciding import (
    FREE,
    GRAZING,
    GRIPPED,
    LIFTING,
    TOUCHING,
    Choice,
    Option,
    Standing,
    Trial,
    contested,
    expected,
    judge,
    options_of,
)

__all__ = ["Quick", "Rows"]

Rows = Callable[[Kernel, FloatArray, FloatArray, FloatArray], FloatArray]
"""Outputs (k, n) of a kernel at times (k,), states (k, n_y) and constants (k, n_c)."""


@final
class Quick:
    """The kernels of a scene, made as they are needed.

    Parameters
    ----------
    equations : EquationsOfMotion
    rows : callable
        Evaluates kernels.
    """

    def __init__(self, equations: EquationsOfMotion, rows: Rows) -> None:
        self._equations, self._rows = equations, rows
        self._verdicts: dict[tuple[tuple[Standing, ...], bool], Verdict | None] = {}

    @derived_property
    def slip_kernel(self) -> Kernel:
        """The kernel of the slip velocities."""
        return slip_kernel(self._equations)

    @derived_property
    def _start_kernel(self) -> Kernel:
        return start_kernel(self._equations)

    def slips(self, t: FloatArray, x: FloatArray, p: FloatArray) -> FloatArray:
        """Return the slip velocities (k, n_contacts) along the first directions of contacts."""
        return self._rows(self.slip_kernel, t, x, p)

    def starts(self, t: FloatArray, x: FloatArray, p: FloatArray) -> tuple[FloatArray, ...]:
        """Return what tells how contacts stand at the start, (k, n_contacts) each; see `start_kernel`."""
        found = self._rows(self._start_kernel, t, x, p).reshape(len(t), -1, 5)
        return tuple(np.moveaxis(found, 2, 0))

    def choose(
        self,
        standings: Sequence[Standing],
        cases: tuple[FloatArray, FloatArray, FloatArray],
        directions: FloatArray,
        sides: FloatArray,
        *,
        known: bool,
    ) -> Decided | None:
        """Return the modes of cases whose contacts stand alike, as `deciding.choose` does; None where it cannot.

        Parameters
        ----------
        standings
            One a contact.
        cases
            Times (k,), states (k, 2 n_q) and parameters (k, n_p).
        directions, sides
            As for `deciding.choose`; `known` says whether these sides are those just before.
        """
        known = self.sided(known)
        found = self.verdict(standings, known)
        if found is None:
            return None
        t, x, p = cases
        count, k, n_q = len(t), len(standings), x.shape[1] // 2
        before = sides if known else np.ones_like(sides)
        out = self._rows(found.kernel, t, np.hstack([x, directions[:, :, 0], before]), p)
        margins = out[:, 2 : 2 + len(found.attempts)].T
        sure = np.isfinite(out[:, 1]) & (out[:, 0] >= REGULAR)
        if known:
            sure &= np.any(margins >= 0.0, axis=0)
        tried = []
        for attempt, margin in zip(found.attempts, margins, strict=True):
            along = directions.copy()
            for i in range(k):
                if attempt.ways[i]:
                    along[:, i] = (float(attempt.ways[i]), 0.0)
            tried.append(Trial(attempt.mode, margin, along, before * np.array(attempt.sides), np.empty((count, 0))))
        choice = judge(self._equations.contacts, tried)
        after = x[:, n_q:].copy()
        for place, number in enumerate(found.held):
            first, here = 2 + len(tried) + place * n_q, choice.mode == number
            after[here] = out[here, first : first + n_q]
        return Decided(choice, after, sure)

    def sided(self, known: bool) -> bool:
        """Return whether sides are known, and there are any."""
        return known and any(side_name(contact) is not None for contact in self._equations.contacts)

    def verdict(self, standings: Sequence[Standing], known: bool) -> Verdict | None:
        """Return the verdict on contacts that stand so, None where there is none; `known` as `sided` returns it."""
        key = tuple(standings), known
        return derived_once(self._verdicts, key, lambda: self._made(*key))

    def _made(self, standings: tuple[Standing, ...], known: bool) -> Verdict | None:
        contacts = self._equations.contacts
        combinations = options_of(contacts, standings)
        if known:
            combinations = expected(combinations, standings)
        attempts = [_attempt(standings, c) for c in combinations]
        if any(s.struck for s in standings) or any(contested(contacts, standings, a.mode) for a in attempts):
            return None
        touching = any(standing.kind == TOUCHING for standing in standings)
        return verdict(self._equations, attempts, [touching or STICK in a.mode for a in attempts], GRAZING)


@final
@dataclass(frozen=True, eq=False)
class Decided:
    """A choice, the rates (k, n_q) with which cases go on, and which of them are sure (k,)."""

    choice: Choice
    rates: FloatArray
    sure: NDArray[np.bool_]


def _attempt(standings: Sequence[Standing], combination: Sequence[Option]) -> Attempt:
    mode: Mode = tuple(state for state, _, _ in combination)
    return Attempt(
        mode=mode,
        sides=tuple(side for _, side, _ in combination),
        ways=tuple(way for _, _, way in combination),
        begins=tuple(st == SLIP and s.kind == GRIPPED for s, st in zip(standings, mode, strict=True)),
        broken=tuple(standing.broken is not None for standing in standings),
        leaves=tuple(standing.kind in (FREE, LIFTING) for standing in standings),
        turned=tuple(standing.turned for standing in standings),
    )
