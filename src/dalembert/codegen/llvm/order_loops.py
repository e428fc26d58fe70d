"""A Taylor step as a loop over the orders: short code for what unrolled code repeats order by order.

The first orders are written out. From then on, one pass of a loop computes a coefficient of every value
(`dalembert.transforms.expansion.Ahead`). The products of coefficients that were known before the pass are summed
first, many sums at a time. Their factors lie in memory in rows, one an order; on one lane, a row holds the factors
of as many sums as a vector register has room for, and those are summed together.

Every sum is taken in the same order as in unrolled code, and gives the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import final

from ...ir.kernel import Operand
from ...transforms.expansion import Ahead, Expansion, Series, Sum
from ...transforms.recurrences import Integrated, Recurrences
from ...transforms.taylor import LOW_TERMS, STEP_ARGUMENTS, closing, closing_loads
from . import vector_functions as functions
from .assembly import LanePrinter, fma_name, prelude

__all__ = ["LEAST_ORDER", "order_loop_assembly"]

_FIRST = 4
"""Order of the first pass: from there on, the sums of all kinds have the terms that the code counts on."""

LEAST_ORDER = _FIRST + 1

_TOGETHER = 8
"""Packs that are summed in one loop: with two factors each they fill the registers."""

_LARGEST_FRAME = 1 << 16
"""Bytes up to which rows lie on the stack."""


def order_loop_assembly(name: str, recurrences: Recurrences, order: int, lanes: int, width: int, *, dense: bool) -> str:
    """Return a module with one Taylor step, called like `dalembert.transforms.taylor.step_kernel`.

    Parameters
    ----------
    name : str
        Of the function.
    order : int
        `LEAST_ORDER` or more.
    lanes : int
        Cases side by side.
    width : int
        On one lane, how many sums share a register; 1, 2, 4 or 8.
    dense : bool
        Whether the series of the state are written too.
    """
    step = _Step(recurrences, order, lanes, width if lanes == 1 else 1, dense)
    memory = ["declare ptr @malloc(i64)", "declare void @free(ptr)"]
    return "\n\n".join([prelude(lanes), *memory, _tables(order), step.text(name)])


def _tables(order: int) -> str:
    """Return tables of 1 / k as rounded and of what rounding took from it."""
    shares = [Fraction(1, max(k, 1)) for k in range(order + 2)]
    tables = {"share": [float(x) for x in shares], "rest": [float(x - Fraction(float(x))) for x in shares]}
    parts = []
    for name, values in tables.items():
        items = ", ".join(f"double {functions.constant(x, 1)}" for x in values)
        parts.append(f"@table.{name} = internal constant [{len(values)} x double] [{items}]")
    return "\n".join(parts)


@final
@dataclass(frozen=True)
class _Row:
    """The factors of a pack, order by order: `series` in its slots. A row of slopes is complete one order later."""

    series: tuple[Series, ...]
    late: int
    place: int


@final
@dataclass(frozen=True)
class _Pack:
    """Sums that are taken together, of orders that lie `offset` behind the present one."""

    number: int
    sums: tuple[Sum, ...]
    offset: int
    a: _Row
    b: _Row

    @property
    def half(self) -> bool:
        return self.sums[0].half


@final
class _Step:
    """One step function under construction."""

    def __init__(self, recurrences: Recurrences, order: int, lanes: int, width: int, dense: bool) -> None:
        self.recurrences, self.order, self.lanes, self.width, self.dense = recurrences, order, lanes, width, dense
        self.printer = LanePrinter(lanes)
        self.lines = self.printer.lines
        self.v, self.one = functions.vector(lanes), 8 * lanes
        self.kind, self.stride = functions.vector(lanes * width), 8 * lanes * width
        self.zero = functions.constant(0.0, lanes * width)
        self.rows: dict[tuple[int, ...], _Row] = {}
        self.fresh = 0
        self.entry = Expansion(recurrences, order)
        self.entry.extend(_FIRST)
        opened = len(self.entry.lines.body)
        self.ahead = Ahead(self.entry)
        self.packs = self._planned()
        self.ahead.extend()
        body = self.entry.lines.body
        self.first_orders, self.later_orders = body[:opened], body[opened:]
        self.rates = [
            r for r in dict.fromkeys(recurrences.rates) if isinstance(r, str) and len(self.entry.series[r]) > 1
        ]

    # -- plan -----------------------------------------------------------------------------

    def _planned(self) -> list[_Pack]:
        """Return what is summed in packs, and tell `ahead` the names of the sums."""
        ahead = self.ahead
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
        packs: list[_Pack] = []
        for (offset, half, late), sums in sorted(kinds.items()):
            sums.sort(key=lambda s: (rank[id(s.a)], rank[id(s.b)]))
            for first in range(0, len(sums), self.width):
                some = tuple(sums[first : first + self.width])
                a = self._row(tuple(s.a for s in some), late)
                b = a if half else self._row(tuple(s.b for s in some), late)
                packs.append(_Pack(len(packs), some, offset, a, b))
        for pack in packs:
            for slot, s in enumerate(pack.sums):
                ahead.known[s] = f"inner.{pack.number}.{slot}"
                if s.half:
                    ahead.middles[id(s.a)] = f"middle.{pack.number}.{slot}"
        return packs

    def _row(self, series: tuple[Series, ...], late: bool) -> _Row:
        key = (int(late), *(id(s) for s in series))
        return self.rows.setdefault(key, _Row(series, int(late), len(self.rows)))

    # -- text -----------------------------------------------------------------------------

    def _set(self, expression: str, name: str = "") -> str:
        if not name:
            self.fresh += 1
            name = f"x.{self.fresh}"
        self.lines.append(f"%{name} = {expression}")
        return f"%{name}"

    def _at(self, base: str, offset: int | str) -> str:
        return self._set(f"getelementptr i8, ptr {base}, i64 {offset}")

    def _load(self, base: str, row: _Row) -> str:
        """Load a row of an order, whose address in the first row is `base`."""
        return self._set(f"load {self.kind}, ptr {self._at(base, self._place(row))}, align {self.stride}")

    def _place(self, row: _Row) -> int:
        return row.place * (self.order + 1) * self.stride

    def _fma(self, a: str, b: str, c: str, name: str = "") -> str:
        k = self.kind
        return self._set(f"call {k} @{fma_name(self.lanes * self.width)}({k} {a}, {k} {b}, {k} {c})", name)

    def _filled(self, values: Sequence[Operand]) -> str:
        """Return a row with values in its slots."""
        if self.width == 1:
            return self.printer.operand(values[0])
        row = "undef"
        for slot in range(self.width):
            value = self.printer.operand(values[slot] if slot < len(values) else 0.0)
            row = self._set(f"insertelement {self.kind} {row}, double {value}, i32 {slot}")
        return row

    def _taken(self, row: str, slot: int, name: str) -> None:
        """Name what a slot of a row holds."""
        taken = (
            f"bitcast {self.v} {row} to {self.v}"
            if self.width == 1
            else f"extractelement {self.kind} {row}, i32 {slot}"
        )
        self._set(taken, name)

    def _keep(self, base: str, row: _Row, values: Sequence[Operand]) -> None:
        at = self._at(base, self._place(row))
        self.lines.append(f"store {self.kind} {self._filled(values)}, ptr {at}, align {self.stride}")

    def _write(self, base: str, offset: int, value: Operand) -> None:
        """Store one value, in the rates or in the outputs."""
        self.lines.append(f"store {self.v} {self.printer.operand(value)}, ptr {self._at(base, offset)}, align 8")

    def _splat(self, value: str, name: str) -> None:
        """Name a number, in all lanes."""
        if self.lanes == 1:
            self._set(f"bitcast double {value} to double", name)
            return
        one = self._set(f"insertelement {self.v} undef, double {value}, i32 0")
        self._set(f"shufflevector {self.v} {one}, {self.v} undef, <{self.lanes} x i32> zeroinitializer", name)

    # -- code -----------------------------------------------------------------------------

    def text(self, name: str) -> str:
        """Return the function."""
        self.lines.append("entry:")
        self._open()
        self.lines += ["br label %orders", "orders:"]
        self._carry()
        self._sum()
        self._one_order()
        closed = "%n.closed"
        self._set(f"icmp eq i64 %n.next, {self.order}", closed[1:])
        self.lines += ["br label %turn", "turn:", f"br i1 {closed}, label %close, label %orders", "close:"]
        self._close()
        body = "\n".join(line if line.endswith(":") else f"  {line}" for line in self.lines)
        arguments = ", ".join(f"ptr noalias nocapture %{a}" for a in (*STEP_ARGUMENTS, "out"))
        return f"define void @{name}({arguments}) nounwind {{\n{body}\n}}"

    @property
    def _rates_at(self) -> dict[str, int]:
        """Where the coefficients of the rates begin, behind the rows."""
        begin = len(self.rows) * (self.order + 1) * self.stride
        return {rate: begin + i * (self.order + 1) * self.one for i, rate in enumerate(self.rates)}

    @property
    def _size(self) -> int:
        return (self.order + 1) * (len(self.rows) * self.stride + len(self.rates) * self.one)

    def _open(self) -> None:
        """Write the first orders: their coefficients, and what later orders need of them."""
        if self._size <= _LARGEST_FRAME:
            self._set(f"alloca [{self._size} x i8], align 64", "n.work")
        else:
            self._set(f"call ptr @malloc(i64 {self._size + 64})", "n.memory")
            up = self._set(f"ptrtoint ptr {self._at('%n.memory', 63)} to i64")
            self._set(f"inttoptr i64 {self._set(f'and i64 {up}, -64')} to ptr", "n.work")
        for i, state in enumerate(self.recurrences.states):
            self.printer.load(state, "y", i)
        for load in self.recurrences.kernel.loads:
            if load.array != "y":
                self.printer.load(load.target, load.array, load.index or 0)
        for load in closing_loads(self.recurrences):
            self.printer.load(load.target, load.array, load.index or 0)
        self.printer.body(self.first_orders)
        before = self.ahead.before
        for row in self.rows.values():
            for k in range(1, _FIRST - row.late):
                self._keep(self._at("%n.work", k * self.stride), row, [before[id(s)][k] for s in row.series])
        for rate, begin in self._rates_at.items():
            for k in range(_FIRST):
                self._write("%n.work", begin + k * self.one, self.entry.series[rate][k])
        if self.dense:
            for i, state in enumerate(self.recurrences.states):
                for k, value in enumerate(self.entry.series[state]):
                    self._write("%out", self._series_at(i) + k * self.one, value)

    def _series_at(self, i: int) -> int:
        """Return where the series of a component of the state begins in the outputs."""
        return (len(self.recurrences.states) + 2 + i * (self.order + 1)) * self.one

    def _carry(self) -> None:
        """Write what goes from one pass to the next, and where the rows of the present order are."""
        self._set(f"phi i64 [{_FIRST}, %entry], [%n.next, %turn]", "n.k")
        for carried in self.ahead.carried:
            first, later = (self.printer.operand(x) for x in (carried.known, carried.series[carried.place]))
            self._set(f"phi {self.v} [{first}, %entry], [{later}, %turn]", carried.name)
        self._set("add i64 %n.k, 1", "n.next")
        self._set(f"mul i64 %n.k, {self.stride}", "n.bytes")
        self._set("getelementptr i8, ptr %n.work, i64 %n.bytes", "n.here")

    def _sum(self) -> None:
        """Write the sums without index 0, those with equally many terms in one loop."""
        kinds: dict[tuple[int, bool], list[_Pack]] = {}
        for pack in self.packs:
            kinds.setdefault((pack.offset, pack.half), []).append(pack)
        for (offset, half), packs in kinds.items():
            for first in range(0, len(packs), _TOGETHER):
                some = packs[first : first + _TOGETHER]
                name = f"sum.{some[0].number}"
                (self._half_sums if half else self._full_sums)(name, some, offset)

    def _full_sums(self, name: str, packs: list[_Pack], offset: int) -> None:
        """Write sums of a_i b_(m-i), m = k - offset: i from 2 to m - 2, which may be none, then 1 and m - 1."""
        m_bytes = self._set(f"sub i64 %n.bytes, {offset * self.stride}")
        one = self._at("%n.work", self.stride)
        low, high = self._at(one, self.stride), self._at(self._at("%n.work", m_bytes), -2 * self.stride)
        self._loop(name, packs, (low, self.stride), (high, -self.stride), one)
        newest = self._at(self._at("%n.work", m_bytes), -self.stride)
        for pack in packs:
            total = self._fma(self._load(one, pack.a), self._load(newest, pack.b), f"%{name}.total.{pack.number}")
            total = self._fma(self._load(newest, pack.a), self._load(one, pack.b), total)
            for slot in range(len(pack.sums)):
                self._taken(total, slot, f"inner.{pack.number}.{slot}")

    def _half_sums(self, name: str, packs: list[_Pack], offset: int) -> None:
        """Write sums of a_i a_(k-i) for i from (k - 1) / 2 down to 1, and what is in the middle of an even k."""
        assert offset == 0, "only products and roots have half sums"
        below = self._set("sub i64 %n.k, 1")
        last, middle = (self._set(f"mul i64 {self._set(f'lshr i64 {i}, 1')}, {self.stride}") for i in (below, "%n.k"))
        high = self._at("%n.here", self._set(f"sub i64 0, {last}"))
        low, end = self._at("%n.work", last), self._at("%n.here", 0)
        self._loop(name, packs, (low, -self.stride), (high, self.stride), end)
        odd, here = self._set("trunc i64 %n.k to i1"), self._at("%n.work", middle)
        for pack in packs:
            chosen = self._set(f"select i1 {odd}, {self.kind} {self.zero}, {self.kind} {self._load(here, pack.a)}")
            for slot in range(len(pack.sums)):
                self._taken(chosen, slot, f"middle.{pack.number}.{slot}")
                self._taken(f"%{name}.total.{pack.number}", slot, f"inner.{pack.number}.{slot}")

    def _loop(self, name: str, packs: list[_Pack], low: tuple[str, int], high: tuple[str, int], end: str) -> None:
        """Write a loop that adds products of rows, from two addresses in steps, until the second has come to `end`."""
        lines = self.lines
        lines += [f"br label %{name}.begin", f"{name}.begin:"]
        none = self._set(f"icmp eq ptr {high[0]}, {end}")
        lines += [f"br i1 {none}, label %{name}.end, label %{name}", f"{name}:"]
        for side, (start, _) in (("low", low), ("high", high)):
            self._set(f"phi ptr [{start}, %{name}.begin], [%{name}.{side}.next, %{name}]", f"{name}.{side}")
        for pack in packs:
            start = f"[{self.zero}, %{name}.begin], [%{name}.more.{pack.number}, %{name}]"
            self._set(f"phi {self.kind} {start}", f"{name}.sum.{pack.number}")
        loaded: dict[tuple[str, int], str] = {}
        for pack in packs:
            for side, row in (("low", pack.a), ("high", pack.b)):
                if (side, row.place) not in loaded:
                    loaded[side, row.place] = self._load(f"%{name}.{side}", row)
            a, b = loaded["low", pack.a.place], loaded["high", pack.b.place]
            self._fma(a, b, f"%{name}.sum.{pack.number}", f"{name}.more.{pack.number}")
        for side, (_, step) in (("low", low), ("high", high)):
            self._set(f"getelementptr i8, ptr %{name}.{side}, i64 {step}", f"{name}.{side}.next")
        done = self._set(f"icmp eq ptr %{name}.high.next, {end}")
        lines += [f"br i1 {done}, label %{name}.end, label %{name}", f"{name}.end:"]
        for pack in packs:
            sums = f"[{self.zero}, %{name}.begin], [%{name}.more.{pack.number}, %{name}]"
            self._set(f"phi {self.kind} {sums}", f"{name}.total.{pack.number}")

    def _one_order(self) -> None:
        """Write coefficient k of every value, and keep what later orders need."""
        for when, index in (("now", "%n.k"), ("next", "%n.next")):
            for table in ("share", "rest"):
                at = self._set(f"getelementptr double, ptr @table.{table}, i64 {index}")
                self._splat(self._set(f"load double, ptr {at}, align 8"), f"{when}.{table}")
        self._splat(self._set("uitofp i64 %n.k to double"), Ahead.ORDER)
        self.printer.body(self.later_orders)
        for row in self.rows.values():
            base = self._at("%n.here", -row.late * self.stride)
            self._keep(base, row, [s[2 - row.late] if len(s) > 2 - row.late else 0.0 for s in row.series])
        offset = self._set(f"mul i64 %n.k, {self.one}")
        for rate, begin in self._rates_at.items():
            self._write(self._at("%n.work", offset), begin, self.ahead.series[rate][2])
        if self.dense:
            for i, state in enumerate(self.recurrences.states):
                self._write(self._at("%out", offset), self._series_at(i) + self.one, self.ahead.series[state][3])

    def _close(self) -> None:
        """Write the end of the step, from the coefficients of the rates."""
        lines, done = self.entry.lines, len(self.entry.lines.body)
        known: dict[Operand, Series] = {}
        for i, (rate, begin) in enumerate(self._rates_at.items()):
            known[rate] = self.entry.series[rate][:_FIRST]
            for k in range(_FIRST, self.order - 1):
                at = self._at("%n.work", begin + k * self.one)
                self._set(f"load {self.v}, ptr {at}, align 8", f"rate.{i}.{k}")
                known[rate].append(f"rate.{i}.{k}")
            known[rate].append(self.ahead.series[rate][2])
        rates = [known[rate] if rate in known else self.entry.of(rate) for rate in self.recurrences.rates]
        first = min(LOW_TERMS, self.order - 2)
        between: Series = [0.0] * (self.order - 2 - first)
        poles = [
            [*self.entry.series[pole][:first], *between, *self.ahead.series[pole][1:3]]
            for pole in self.recurrences.poles
        ]
        outputs = closing(lines, self.recurrences, rates, poles, self.order)
        self.printer.body(lines.body[done:])
        for index, operand in enumerate(outputs):
            self.printer.store(operand, index)
        if self._size > _LARGEST_FRAME:
            self.lines.append("call void @free(ptr %n.memory)")
        self.lines.append("ret void")
