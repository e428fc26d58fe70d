"""Sums of products of coefficients in a loop over the orders: grouping, and places of their factors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from ...transforms.expansion import Series, Sum
from ...transforms.order_pass import Ahead
from ...transforms.recurrences import Integrated


@final
@dataclass(frozen=True)
class Row:
    """The factors of a pack, order by order: `series` in its slots. A row of slopes is complete one order later."""

    series: tuple[Series, ...]
    late: int
    place: int


@final
@dataclass(frozen=True)
class Pack:
    """Sums that are taken together, of orders that lie `offset` behind the present one."""

    number: int
    sums: tuple[Sum, ...]
    offset: int
    a: Row
    b: Row

    @property
    def half(self) -> bool:
        """Whether each product occurs twice in the sums, and is taken once."""
        return self.sums[0].half


def planned_sums(ahead: Ahead, width: int) -> tuple[list[Pack], list[Row]]:
    """Return what is summed in packs and the rows of its factors, and write the names of the sums to `ahead`.

    `width` is how many sums share a register.
    """
    rows: dict[tuple[int, ...], Row] = {}

    def row(series: tuple[Series, ...], late: bool) -> Row:
        key = (int(late), *(id(s) for s in series))
        return rows.setdefault(key, Row(series, int(late), len(rows)))

    slopes = {id(series) for series in ahead.slopes.values()}
    rank = {id(s): place for place, s in enumerate([*ahead.series.values(), *ahead.slopes.values()])}
    kinds: dict[tuple[int, bool, bool], list[Sum]] = {}
    for item, line in ahead.moving:
        for s in ahead.sums[line.target]:
            if id(s.a) in ahead.still or id(s.b) in ahead.still:
                ahead.known[s] = 0.0
                if s.half:
                    ahead.middles[id(s.a)] = 0.0
                continue
            late = id(s.a) in slopes or id(s.b) in slopes
            kinds.setdefault((int(isinstance(item, Integrated)), s.half, late), []).append(s)
    packs: list[Pack] = []
    for (offset, half, late), sums in sorted(kinds.items()):
        sums.sort(key=lambda s: (rank[id(s.a)], rank[id(s.b)]))
        for first in range(0, len(sums), width):
            some = tuple(sums[first : first + width])
            a = row(tuple(s.a for s in some), late)
            b = a if half else row(tuple(s.b for s in some), late)
            packs.append(Pack(len(packs), some, offset, a, b))
    for pack in packs:
        for slot, s in enumerate(pack.sums):
            ahead.known[s] = f"inner.{pack.number}.{slot}"
            if s.half:
                ahead.middles[id(s.a)] = f"middle.{pack.number}.{slot}"
    return packs, list(rows.values())
