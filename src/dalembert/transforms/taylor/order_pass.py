"""One order of an expansion as the body of a loop over the orders, and its sums of products in packs."""

from __future__ import annotations

from fractions import Fraction
from typing import final

from ...frozen import frozen
from ...ir.kernel import Assignment, Operand
from .expansion import Expansion, Extension, Series, Sum
from .recurrences import Integrated, Recurrences
from .step import LOW_TERMS, closing

FIRST_ORDER = 4
"""Order of the first pass: from there on, the sums of all kinds have the terms that the code counts on."""

LEAST_ORDER = FIRST_ORDER + 1


@final
@frozen
class Carried:
    """A value carried from one pass to the next: `known` at first, then the present `series[place]`."""

    name: str
    known: Operand
    series: Series
    place: int


@final
class Ahead(Extension):
    """Coefficient k of every value, for a k that is known only when the code runs, larger than the orders of `entry`.

    Series have three places: coefficient 0, the one before (``k - 1``), and the present one, k; the state has a fourth,
    ``k + 1``. Values that change with k have the names below and those of `Carried` values.

    Parameters
    ----------
    entry : Expansion
        The orders before. Constants that it has computed are used, and its lines are continued.

    Attributes
    ----------
    carried : list of Carried
    known, middles : dict
        To be filled in before `extend`: the names of what `_inner` and, for the series of half sums, `_middle` return.
    still : set of int
        The series, by `id`, of which all but coefficient 0 is zero.
    before : dict of int to Series
        The series of `entry` that stands behind each series, by `id`.
    """

    SHARE, REST, ORDER = "now.share", "now.rest", "now.order"
    NEXT_SHARE, NEXT_REST = "next.share", "next.rest"
    """1 / k as rounded, what rounding took from it, and k; the first two for k + 1 too."""

    def __init__(self, entry: Expansion) -> None:
        super().__init__(entry.recurrences, entry.lines, entry.faithful)
        self.carried: list[Carried] = []
        self.known: dict[Sum, Operand] = {}
        self.middles: dict[int, Operand] = {}
        self.before: dict[int, Series] = {}
        twin: dict[int, Series] = {}
        for name, series in entry.series.items():
            self.series[name] = twin[id(series)] = self._begun(series, entry.orders)
        for inner, series in entry.slopes.items():
            self.slopes[inner] = twin[id(series)] = series[:1]
        self.before = {id(twin[id(series)]): series for series in (*entry.series.values(), *entry.slopes.values())}
        self.still = {key for key, series in self.before.items() if all(a == 0.0 for a in series[1:])}
        for name, sums in entry.sums.items():
            for s in sums:  # the rate of a state may be a number, which has no series
                for series in (s.a, s.b):
                    if id(series) not in twin:
                        twin[id(series)] = series
                        self.still.add(id(series))
            self.sums[name] = [Sum(twin[id(s.a)], twin[id(s.b)], s.half) for s in sums]

    def _begun(self, series: Series, orders: int) -> Series:
        """Return coefficients 0 and k - 1, and of the state k too; zero once they have come to be."""
        begun = series[:1]
        for place, known in enumerate(series[orders - 1 :] if len(series) > 1 else [], 1):
            if all(a == 0.0 for a in series[2:]):
                begun.append(0.0)
                continue
            name = f"carried.{len(self.carried)}"
            self.carried.append(Carried(name, known, begun, place + 1))
            begun.append(name)
        return begun

    def extend(self) -> None:
        """Append coefficient k of every value, and coefficient k + 1 of the state."""
        self._extend(2)

    def _inner(self, k: int) -> dict[Sum, Operand]:
        return self.known

    def _middle(self, series: Series, k: int) -> Operand:
        return self.middles[id(series)]

    def _over(self, value: Operand, k: int) -> Operand:
        share, rest = (self.SHARE, self.REST) if k == 2 else (self.NEXT_SHARE, self.NEXT_REST)
        if not self.faithful:
            return self.lines.mul(value, share)
        return self.lines.fma(value, share, self.lines.mul(value, rest))

    def _times_order(self, value: Operand, k: int) -> Operand:
        return self.lines.mul(value, self.ORDER)


@final
@frozen
class Row:
    """The factors of a pack, order by order: `series` in its slots. A row of slopes is complete one order later."""

    series: tuple[Series, ...]
    late: int
    place: int


@final
@frozen
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


def shares(order: int) -> tuple[list[float], list[float]]:
    """Return 1 / k as rounded, and its rounding error, for k up to `order` + 1; those of 0 stand for nothing."""
    exact = [Fraction(1, max(k, 1)) for k in range(order + 2)]
    return [float(share) for share in exact], [float(share - Fraction(float(share))) for share in exact]


class OrderPlan:
    """A Taylor step as a loop over the orders: what each pass computes, and what it keeps for later ones.

    Targets print its parts. Every sum is taken in the same order as in unrolled code, and gives the same bits.

    Parameters
    ----------
    recurrences : Recurrences
    order : int
        `LEAST_ORDER` or more.
    width : int
        How many sums share a register.

    Attributes
    ----------
    entry, ahead : Expansion, Ahead
        The first orders, and one pass.
    packs, rows : list of Pack, list of Row
        Sums of products, and their factors.
    first_orders, later_orders : list of Assignment
        Lines of the orders below `FIRST_ORDER`, and of a pass.
    rates : list of str
        Values of which all coefficients are kept to the end.
    """

    def __init__(self, recurrences: Recurrences, order: int, width: int) -> None:
        self.recurrences, self.order = recurrences, order
        self.entry = Expansion(recurrences, order)
        self.entry.extend(FIRST_ORDER)
        opened = len(self.entry.lines.body)
        self.ahead = Ahead(self.entry)
        self.packs, self.rows = planned_sums(self.ahead, width)
        self.ahead.extend()
        body = self.entry.lines.body
        self.first_orders, self.later_orders = body[:opened], body[opened:]
        kept = dict.fromkeys([*recurrences.rates, *recurrences.watched])
        self.rates = [r for r in kept if isinstance(r, str) and len(self.entry.series[r]) > 1]

    def kept_before(self, row: Row) -> list[list[Operand]]:
        """Return what a row holds of the orders 1, 2, ... that the first pass finds there, slot by slot."""
        before = self.ahead.before
        return [[before[id(s)][k] for s in row.series] for k in range(1, FIRST_ORDER - row.late)]

    def kept_now(self, row: Row) -> list[Operand]:
        """Return what a pass keeps in a row, slot by slot: of order k, or of k - 1 where the row is late."""
        return [s[2 - row.late] if len(s) > 2 - row.late else 0.0 for s in row.series]

    def end(self) -> tuple[list[tuple[str, int, int]], list[Assignment], list[Operand]]:
        """Return the end of the step.

        Returns
        -------
        list of (str, int, int)
            Names of the coefficients of rates that it reads again, with the number of the rate and the order.
        list of Assignment
            Its lines.
        list of Operand
            The outputs of `dalembert.transforms.taylor.step.step_kernel` without dense.
        """
        entry, order, recurrences = self.entry, self.order, self.recurrences
        done = len(entry.lines.body)
        known: dict[Operand, Series] = {}
        read = []
        for i, rate in enumerate(self.rates):
            known[rate] = entry.series[rate][:FIRST_ORDER]
            for k in range(FIRST_ORDER, order - 1):
                read.append((f"rate.{i}.{k}", i, k))
                known[rate].append(f"rate.{i}.{k}")
            known[rate].append(self.ahead.series[rate][2])
        rates = [known[rate] if rate in known else entry.of(rate) for rate in recurrences.rates]
        first = min(LOW_TERMS, order - 2)
        between: Series = [0.0] * (order - 2 - first)
        poles = [[*entry.series[pole][:first], *between, *self.ahead.series[pole][1:3]] for pole in recurrences.poles]
        watched = [known[name] for name in recurrences.watched]
        outputs = closing(entry.lines, recurrences, rates, poles, order, watched)
        return read, entry.lines.body[done:], outputs
