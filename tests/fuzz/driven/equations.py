"""Equations of the contact scenes with numbers that change in time, for the Moreau-Jean reference: `driven`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from fuzz.contacts.moreau_jean import Array
from fuzz.contacts.systems import SYSTEMS, System, equations
from fuzz.driven.records import Record

__all__ = ["MOVED", "driven", "packed"]

PREFIX = "driven "
MOVED = {("wheel", "x_wall"): (1,), ("pendulum", "d"): (0, 1)}
"""Contacts whose gap grows with a number that is a place, by system and name."""


@cache
def driven(name: str) -> str:
    """Return the name of a system whose numbers are those of `packed`; it is made, and stands in `SYSTEMS`."""
    base, system = equations(name), SYSTEMS[name]

    def fill(t: float, q: Any, v: Any, p: Any, M: Any, f: Any, gap: Any, law: Any, J: Any, w: Any) -> None:
        now, count = t + p[0], int(p[1])
        numbers = p[2 : 2 + count].copy()
        at, end = 2 + count, p.size
        w[:, 0] = 0.0
        while at < end:
            place, moved, pieces = int(p[at]), int(p[at + 1]), int(p[at + 2])
            k, at = 0, at + 3
            while k + 1 < pieces and p[at + k + 1] <= now:
                k += 1
            s, c = now - p[at + k], at + pieces + 4 * k
            numbers[place] = p[c] + s * (p[c + 1] + s * (p[c + 2] + s * p[c + 3]))
            rate = p[c + 1] + s * (2.0 * p[c + 2] + s * 3.0 * p[c + 3])
            for i in range(gap.size):
                if (moved >> i) & 1:
                    w[i, 0] += rate
            at += 5 * pieces
        base(now, q, v, numbers, M, f, gap, law, J, w)

    SYSTEMS[PREFIX + name] = System(fill, system.contacts, system.directions, system.bilateral)
    return PREFIX + name


def packed(
    name: str, names: Sequence[str], numbers: Mapping[str, float], records: Mapping[str, Record], begin: float = 0.0
) -> Array:
    """Return the parameters of a driven system: its base's numbers, and records of some; time begins at `begin` [s]."""
    p = [begin, float(len(names)), *(numbers.get(each, 0.0) for each in names)]
    for each, record in records.items():
        moved = sum(1 << i for i in MOVED.get((name, each), ()))
        p += record.words(names.index(each), moved)
    return np.array(p)
