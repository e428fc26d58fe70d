"""Several impacts at one instant: whether a jump of velocities is a sequence of impacts, each by Newton's law."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from itertools import chain, combinations
from typing import TYPE_CHECKING

import numpy as np

from fuzz.contacts.moreau_jean import Array

if TYPE_CHECKING:
    from fuzz.contacts.invariants import Rows

__all__ = ["impacts_in_turn"]

TOUCHING = 1e-13
"""Gap, over the size of the motion, from which on contacts do not touch."""
STILL, EQUAL, SAME = 1e-9, 2e-5, 1e-7
"""Of velocities, over their sizes: those that do not approach, those that are equal, and those tried once."""
MOST = 10_000
"""Impacts that are tried: a dozen of them may bring three masses to rest at a wall."""


def impacts_in_turn(rows: Rows, before: Array, after: Array) -> bool:
    """Return whether impacts of contacts without friction, one after the other, lead from velocities to others (n,).

    In each some of the contacts that touch and approach are struck; those that touch and would be pushed together by
    it are pushed along.
    """
    size = max(0.1, float(np.max(np.abs(before))))
    if rows.system.directions or rows.system.bilateral or np.max(np.abs(after - before)) <= EQUAL * size:
        return False
    near = sorted(gap for gap in rows.gap if gap <= TOUCHING * (1.0 + size))  # smaller ones are gaps near the origin
    sets = [[k for k, gap in enumerate(rows.gap) if gap <= least] for least in near]
    return any(_lead_to(rows, touching, before, after, size) for touching in reversed(sets))


def _lead_to(rows: Rows, touching: list[int], before: Array, after: Array, size: float) -> bool:
    """Return whether impacts of some contacts that touch lead from velocities to others."""
    waiting, seen = deque([before]), 0  # short sequences first: every impact leaves a smaller one to be tried
    known = set[tuple[float, ...]]()
    while waiting and seen < MOST:
        v, seen = waiting.popleft(), seen + 1
        for reached in _struck(rows, touching, v, STILL * size):
            if np.max(np.abs(reached - after)) <= EQUAL * size:
                return True
            key = tuple(np.round(reached / (SAME * size)).tolist())
            if key not in known:
                known.add(key)
                waiting.append(reached)
    return False


def _struck(rows: Rows, touching: list[int], v: Array, still: float) -> Iterator[Array]:
    """Yield velocities after an impact of some contacts that approach, those of most contacts last."""
    u = rows.speeds(v)[:, 0]
    coming = [k for k in touching if u[k] < -still]
    for some in chain.from_iterable(combinations(coming, count) for count in range(1, len(coming) + 1)):
        target = {k: -rows.law[k, 2] * u[k] if k in some else 0.0 for k in touching if k in some or u[k] <= still}
        near = [k for k in target if k in some or k not in coming]
        for pushed in chain.from_iterable(combinations(near, count) for count in range(1, len(near) + 1)):
            J = rows.J[list(pushed), 0]
            pull = np.linalg.solve(rows.M, J.T)
            P, *_ = np.linalg.lstsq(J @ pull, np.array([target[k] - u[k] for k in pushed]), rcond=None)
            x = v + pull @ P
            ends = rows.speeds(x)[:, 0]
            if np.min(P) >= 0.0 and all(ends[k] >= target[k] - still for k in near):
                yield x
                break
