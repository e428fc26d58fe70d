"""Which mode holds: every combination of what contacts may do is tried, and the one that contradicts nothing is taken.

Closed contacts push and do not pull, open ones do not approach, what sticks needs no more friction than there is, and
friction opposes the slip that it lets begin. After an impact the same holds of impulses and of rates. Where no
combination is left, or one with a contact open and one with it closed, the laws have no solution or several.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...integrators.mode_selection import ROUNDING
from ...mechanics.equations import ContactRow
from ...methods.status import Status
from ...reduction.modes import CLOSED, OPEN, SLIP, SMOOTH, STICK, Mode, side_name
from .facts import Facts, Level, Outcome

__all__ = ["Choice", "Option", "Standing", "Trial", "choose", "contested", "expected", "judge", "options_of"]

GRAZING = 1e-6
"""Share of the motion within which slip that friction has just failed to hold may seem to go backwards."""

_TURNS = 60

FREE, TOUCHING, GRIPPED, SLIDING, LIFTING = "free", "touching", "gripped", "sliding", "lifting"


@final
@dataclass(frozen=True)
class Standing:
    """What is known of a contact before it is decided what it does.

    Attributes
    ----------
    kind : str
        "free" (open, or opening), "lifting" (its normal reaction has just vanished), "touching" (closed, without
        friction, or smooth), "gripped" (closed, its slip velocity is zero) or "sliding" (closed, with a slip velocity).
    broken : int or None
        Where friction has just failed to hold it: the direction of the slip along one direction, 0 along two.
    struck : bool
        Whether it is being struck, so that it is closed during the impact.
    turned : bool
        Whether its normal reaction has just changed its side: it goes on from zero, where rounding has the sign.
    """

    kind: str
    broken: int | None = None
    struck: bool = False
    turned: bool = False

    @property
    def side(self) -> int:
        """The side on which it is pushed, relative to that just before."""
        return -1 if self.turned else 1


@final
@dataclass(frozen=True, eq=False)
class Choice:
    """The chosen modes of k cases.

    Attributes
    ----------
    mode : ndarray (k,) of int
        Number in `modes`, -1 where the status is not SUCCESS.
    modes : list of Mode
    directions, sides : ndarray (k, n_contacts, 2), (k, n_contacts)
    status : ndarray (k,) of int
    motion : ndarray (k, n_q)
        Second rates, or rates after the impact.
    """

    mode: NDArray[np.intp]
    modes: list[Mode]
    directions: FloatArray
    sides: FloatArray
    status: NDArray[np.int64]
    motion: FloatArray


Option = tuple[str, int, int]
"""State, side and direction (0: that of the slip velocity, or of the slip that begins)."""


@final
@dataclass(frozen=True, eq=False)
class Trial:
    """A combination that was tried: its mode, margins (k,), directions, sides and motion."""

    mode: Mode
    margin: FloatArray
    along: FloatArray
    sides: FloatArray
    motion: FloatArray


def choose(
    facts: Facts, standings: Sequence[Standing], level: Level, directions: FloatArray, sides: FloatArray | None = None
) -> Choice:
    """Return the modes of cases whose contacts stand alike.

    Parameters
    ----------
    facts : Facts
    standings : sequence of Standing
        One a contact.
    level : Level
        Of accelerations, or of an impact.
    directions : ndarray (k, n_contacts, 2)
        Of the slip velocities, unit vectors; anything for contacts that do not slide.
    sides : ndarray (k, n_contacts), optional
        On which side constraints that never open were pushed just before. The others are only tried where these
        contradict something.
    """
    every = options_of(facts.contacts, standings)
    tried: list[Trial] = []
    if sides is not None and any(side_name(contact) is not None for contact in facts.contacts):
        tried = [_try(facts, standings, level, c, directions, sides) for c in expected(every, standings)]
        if np.all(np.any([trial.margin >= 0.0 for trial in tried], axis=0)):
            return judge(facts.contacts, tried)
    others = np.ones((len(facts), len(facts.contacts)))
    if sides is not None:
        turned = [i for i, standing in enumerate(standings) if standing.turned]
        others[:, turned] = sides[:, turned]
    return judge(facts.contacts, [_try(facts, standings, level, c, directions, others) for c in every])


def expected(every: Sequence[tuple[Option, ...]], standings: Sequence[Standing]) -> list[tuple[Option, ...]]:
    """Return those combinations whose sides are relative to the ones just before, and as these would have them."""
    return [c for c in every if all(side == s.side for (_, side, _), s in zip(c, standings, strict=True))]


def _try(
    facts: Facts,
    standings: Sequence[Standing],
    level: Level,
    combination: Sequence[Option],
    directions: FloatArray,
    sides: FloatArray,
) -> Trial:
    """Return what comes of a combination, whose sides are relative to the given ones."""
    mode = tuple(state for state, _, _ in combination)
    sides = sides * np.array([float(side) for _, side, _ in combination])
    along = _along(facts, combination, directions)
    begins = [i for i, (s, _, d) in enumerate(combination) if s == SLIP and d == 0 and standings[i].kind == GRIPPED]
    if begins:
        along = _turned(facts, level, combination, sides, along, begins)
    outcome = facts.solve(level, mode, along, sides)
    margin = _margin(facts, standings, level, combination, outcome, along, sides)
    return Trial(mode, margin, along, sides, outcome.motion)


def judge(contacts: Sequence[ContactRow], tried: Sequence[Trial]) -> Choice:
    """Return the first combination that contradicts nothing, or why there is none."""
    margins = np.array([trial.margin for trial in tried])
    count = margins.shape[1]
    strict = margins >= 0.0
    allowed = np.where(np.any(strict, axis=0), strict, margins >= -ROUNDING)
    some = np.any(allowed, axis=0)
    status = np.where(some, int(Status.SUCCESS), int(Status.CONTACT_IMPOSSIBLE))
    status[np.any(np.isnan(margins), axis=0) & ~some] = int(Status.NON_FINITE)
    clear = margins > ROUNDING
    several = np.sum(clear, axis=0) > 1
    if np.any(several):
        for b, a in combinations(range(len(tried)), 2):
            for i, contact in enumerate(contacts):
                apart = np.full(count, (tried[a].mode[i] == OPEN) != (tried[b].mode[i] == OPEN))
                if side_name(contact) is not None:
                    apart |= tried[a].sides[:, i] != tried[b].sides[:, i]
                status[clear[a] & clear[b] & apart] = int(Status.CONTACT_AMBIGUOUS)
    number = np.argmax(allowed, axis=0)

    def picked(values: Sequence[FloatArray]) -> FloatArray:
        """Return what each case has of the combination that it takes, in few passes where most take the same."""
        first = int(number[0]) if count else 0
        found = values[first].copy()
        for i, value in enumerate(values):
            here = number == i
            if i != first and np.any(here):
                found[here] = value[here]
        return found

    return Choice(
        mode=np.where(status == Status.SUCCESS, number, -1),
        modes=[trial.mode for trial in tried],
        directions=picked([trial.along for trial in tried]),
        sides=picked([trial.sides for trial in tried]),
        status=status,
        motion=picked([trial.motion for trial in tried]),
    )


def options_of(contacts: Sequence[ContactRow], standings: Sequence[Standing]) -> list[tuple[Option, ...]]:
    """Return every combination of what contacts may do, in the order of preference."""
    return list(product(*(_options(c, s) for c, s in zip(contacts, standings, strict=True))))


def _options(contact: ContactRow, standing: Standing) -> list[Option]:
    """Return what a contact may do, in the order of preference."""
    if standing.kind in (FREE, LIFTING):
        return [(OPEN, 1, 0)]
    sides = (standing.side,) if standing.turned or side_name(contact) is None else (1, -1)
    found: list[Option] = []
    for side in sides:
        if not contact.tangential:
            found.append((CLOSED, side, 0))
        elif contact.regularization is not None:
            found.append((SMOOTH, side, 0))
        elif standing.kind == SLIDING:
            found.append((SLIP, side, 0))
        elif len(contact.tangential) > 1:
            found += [(SLIP, side, 0)] if standing.broken is not None else [(STICK, side, 0), (SLIP, side, 0)]
        elif standing.broken is not None:
            found.append((SLIP, side, standing.broken))
        else:
            found += [(STICK, side, 0), (SLIP, side, 1), (SLIP, side, -1)]
    if contact.constraint is not None and not standing.struck:
        found.append((OPEN, 1, 0))
    return sorted(found, key=lambda option: (STICK, CLOSED, SMOOTH, SLIP, OPEN).index(option[0]))


def _along(facts: Facts, combination: Sequence[Option], directions: FloatArray) -> FloatArray:
    """Return the directions of slip that a combination stands for."""
    along = directions.copy()
    for i, (state, _, sign) in enumerate(combination):
        if state == SMOOTH:
            slips, eps = facts.slips(i), facts.regularization[:, i]
            along[:, i] = slips / np.sqrt(np.sum(slips**2, axis=1) + eps**2)[:, None]
        elif sign:
            along[:, i] = (float(sign), 0.0)
    return along


def _turned(
    facts: Facts, level: Level, combination: Sequence[Option], sides: FloatArray, along: FloatArray, begins: list[int]
) -> FloatArray:
    """Return directions along which slip begins in the very direction that friction opposes, found by iteration.

    It starts against the force that would hold, and halves the way at every turn.
    """
    mode = tuple(state for state, _, _ in combination)
    sticking = tuple(STICK if i in begins else state for i, state in enumerate(mode))
    held = facts.solve(level, sticking, along, sides)
    for i in begins:
        along[:, i] = _unit(-held.friction[:, i], along[:, i])
    for _ in range(_TURNS):
        outcome = facts.solve(level, mode, along, sides)
        for i in begins:
            size = np.sqrt(np.sum(outcome.slip[:, i] ** 2, axis=1))
            small = size <= ROUNDING * np.sum(np.abs(held.friction[:, i]), axis=1) / _smallest(facts)
            wanted = _unit(outcome.slip[:, i], along[:, i])
            along[:, i] = np.where(small[:, None], along[:, i], _unit(along[:, i] + wanted, along[:, i]))
    return along


def _smallest(facts: Facts) -> FloatArray:
    return np.maximum(np.max(np.abs(facts.mass), axis=(1, 2)), 1e-300)


def _unit(vectors: FloatArray, otherwise: FloatArray) -> FloatArray:
    size = np.sqrt(np.sum(vectors**2, axis=1))[:, None]
    return np.where(size > 0.0, vectors / np.where(size > 0.0, size, 1.0), otherwise)


def _margin(
    facts: Facts,
    standings: Sequence[Standing],
    level: Level,
    combination: Sequence[Option],
    outcome: Outcome,
    along: FloatArray,
    sides: FloatArray,
) -> FloatArray:
    """Return by which share of the forces, at least, a combination contradicts nothing (k,); below zero it does."""
    mode = tuple(state for state, _, _ in combination)
    never = np.zeros(len(facts), np.bool_)
    shared = {i: never.copy() for i, state in enumerate(mode) if state == STICK}  # where others hold it too
    conditions: list[FloatArray] = [np.ones(len(facts))]
    for i, j in contested(facts.contacts, standings, mode):
        together, ratio = facts.coupling(level, mode, i, j)
        if mode[i] == mode[j] == STICK:
            shared[i], shared[j] = shared[i] | together, shared[j] | together
            if np.any(together):
                holds = _impending(facts, level, mode, (i, j), ratio, along, sides)
                conditions.append(np.where(together, holds, 1.0))
        else:
            conditions.append(np.where(together, -1.0, 1.0))
    force = np.sum(np.abs(outcome.normal), axis=1) + np.sum(np.abs(outcome.friction), axis=(1, 2))
    speed = np.max(np.abs(outcome.motion), axis=1, initial=0.0)
    for i, contact in enumerate(facts.contacts):
        standing, state = standings[i], mode[i]
        press = sides[:, i] * outcome.normal[:, i]
        alone = ~shared.get(i, never)
        if state == OPEN:
            if standing.kind not in (FREE, LIFTING):
                conditions.append(_share(outcome.gap[:, i], speed * _size(facts.jacobian[:, contact.constraint])))
        elif (contact.constraint is not None or side_name(contact) is not None) and not standing.turned:
            conditions.append(np.where(alone, _share(press, force), 1.0))
        if state == STICK:
            used = np.sqrt(np.sum(outcome.friction[:, i] ** 2, axis=1))
            conditions.append(np.where(alone, _share(facts.mu_static[:, i] * press - used, force), 1.0))
        if state == SLIP and standing.kind == GRIPPED:
            share = _forward(facts, level, mode, outcome, along, i)
            grazing = (standing.broken is not None) & (share >= -GRAZING)
            conditions.append(np.where(grazing, np.maximum(share, 0.0), share))
    least = np.min(conditions, axis=0)
    least[~np.isfinite(outcome.motion).all(axis=1)] = np.nan
    return np.asarray(least)


def _forward(facts: Facts, level: Level, mode: Mode, outcome: Outcome, along: FloatArray, i: int) -> FloatArray:
    """Return by which share of the motion, and of what friction does to it, slip begins along its direction (k,)."""
    speed = np.max(np.abs(outcome.motion), axis=1, initial=0.0)
    forward = np.sum(outcome.slip[:, i] * along[:, i], axis=1)
    force = np.sum(np.abs(outcome.friction[:, i]), axis=1)
    held = facts.yielding(level, mode, i) * force
    return _share(forward, speed * np.max(_size(facts.slip_jacobian[:, facts.places[i]]), axis=1) + held)


def contested(contacts: Sequence[ContactRow], standings: Sequence[Standing], mode: Mode) -> list[tuple[int, int]]:
    """Return contacts along one direction that stick now, of which one at least is to go on sticking."""
    able = [
        i
        for i, (contact, standing) in enumerate(zip(contacts, standings, strict=True))
        if standing.kind == GRIPPED and len(contact.tangential) == 1 and mode[i] in (STICK, SLIP)
    ]
    return [(i, j) for i in able for j in able if i < j and STICK in (mode[i], mode[j])]


def _impending(
    facts: Facts,
    level: Level,
    mode: Mode,
    pair: tuple[int, int],
    ratio: FloatArray,
    along: FloatArray,
    sides: FloatArray,
) -> FloatArray:
    """Return by which share of the motion two contacts that can only slip together do not begin to (k,).

    Which of them bears how much is not determined; with both at their limits it is.
    """
    i, j = pair
    both = tuple(SLIP if n in pair else state for n, state in enumerate(mode))
    least = np.full(len(facts), np.inf)
    for sign in (1.0, -1.0):
        way = along.copy()
        way[:, i], way[:, j] = (sign, 0.0), np.column_stack([sign * ratio, np.zeros(len(facts))])
        outcome = facts.solve(level, both, way, sides, facts.mu_static)
        least = np.minimum(least, -_forward(facts, level, both, outcome, way, i))
    return least


def _size(rows: FloatArray) -> FloatArray:
    return np.sqrt(np.sum(rows**2, axis=-1))


def _share(value: FloatArray, scale: FloatArray) -> FloatArray:
    """Return a value in terms of a scale; zero stays zero where there is none."""
    return np.where(value == 0.0, 0.0, value / np.where(scale > 0.0, scale, 1.0))
