"""Moreau-Jean reference of driven cases: stretch by stretch, between a controller's instants and kicks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

import numpy as np

from fuzz.contacts.moreau_jean import Array, integrated
from fuzz.driven.equations import driven as system_of
from fuzz.driven.equations import packed
from fuzz.driven.families import Driven, Kick
from fuzz.driven.records import Record

__all__ = ["Motion", "instants", "reference"]

KICKS = 50
"""Most kicks of a motion."""


@final
@dataclass(frozen=True, eq=False)
class Motion:
    """A motion in steps: times (k,), positions and velocities (k, n), times of kicks."""

    t: Array
    q: Array
    v: Array
    kicks: tuple[float, ...]

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return positions and velocities at times, by lines between steps."""
        q, v = (np.column_stack([np.interp(times, self.t, x) for x in table.T]) for table in (self.q, self.v))
        return q, v


def instants(driven: Driven) -> list[float]:
    """Return the instants of the controller before the end of the span, 0 where there is none."""
    if driven.law is None:
        return [0.0]
    count = math.ceil(driven.case.span / driven.law.period - 1e-9)
    return [driven.law.period * k for k in range(count)]


def reference(driven: Driven, system: str, names: tuple[str, ...], steps: int) -> Motion:
    """Integrate a case with some `steps` in its span; `names` are those of the numbers of its system."""
    case, law = driven.case, driven.law
    start = np.array(list(case.initial.values()), float)
    q, v = start[: len(start) // 2], start[len(start) // 2 :]
    begins, parts, kicks, own = instants(driven), [(np.zeros(1), q[np.newaxis], v[np.newaxis])], list[float](), 0.0
    for number, (begin, end) in enumerate(zip(begins, [*begins[1:], case.span], strict=True)):
        records = dict(driven.records)
        if law is not None:
            value = law.value(q, v, number if law.kind == "count" else own)
            own += law.error(q)
            records[law.sets] = Record("hold", (0.0,), (value,))
        p, now = packed(system, names, case.parameters, records), begin
        while now < end:
            p[0] = now
            each = max(4, math.ceil((end - now) / case.span * steps))
            Q, V, _ = integrated(system_of(system), p, q, v, end - now, each, 1)
            part = np.linspace(now, end, each + 1), Q, V
            kick = driven.kick if len(kicks) < KICKS else None
            cut = None if kick is None else _crossing(kick, part[0], Q)
            if kick is not None and cut is not None:
                part = tuple(_cut(values, *cut) for values in part)  # type: ignore[assignment]
                kicks.append(float(part[0][-1]))
                part[2][-1] *= kick.scale
            parts.append(part)
            now, q, v = float(part[0][-1]), part[1][-1], part[2][-1]
    return Motion(*(np.concatenate(values) for values in zip(*parts, strict=True)), tuple(kicks))


def _cut(values: Array, i: int, share: float) -> Array:
    """Return values (k, ...) up to a share of the step from number i to the next."""
    return np.concatenate([values[: i + 1], values[i : i + 1] + share * np.diff(values[i : i + 2], axis=0)])


def _crossing(kick: Kick, times: Array, q: Array) -> tuple[int, float] | None:
    """Return the step in which a kick comes, and the share of it before."""
    value = (times if kick.place < 0 else q[:, kick.place]) - kick.level
    begins = 1 if abs(value[0]) <= 1e-12 * (1.0 + abs(kick.level)) else 0  # a zero at the start is no change of sign
    for i in range(begins, len(value) - 1):
        low, high = value[i], value[i + 1]
        if (low < 0.0 <= high and kick.direction >= 0) or (low > 0.0 >= high and kick.direction <= 0):
            return i, float(low / (low - high))
    return None
