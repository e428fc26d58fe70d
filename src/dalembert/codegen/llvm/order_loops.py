"""Taylor step as a loop over the orders, shorter than unrolled code.

The first orders are written out. From then on, one pass of a loop computes a coefficient of every value
(`dalembert.transforms.taylor.order_pass.Ahead`). The products of coefficients that were known before the pass are
summed first, many sums at a time. Their factors lie in memory in rows, one an order; on one lane, a row holds the
factors of as many sums as a vector register has room for, and those are summed together.

Every sum is taken in the same order as in unrolled code, and gives the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, final

from ...ir.kernel import Operand
from ...transforms.taylor.order_pass import FIRST_ORDER, OrderPlan, Pack, Row, shares
from ...transforms.taylor.recurrences import Recurrences
from ...transforms.taylor.step import closing_loads
from ..rendering import render
from .lane_printer import LanePrinter
from .target import constant, fma_name, memory_of_call, vector
from .vector_functions import prelude_variables

_TOGETHER = 8
"""Packs that are summed in one loop: with two factors each they fill the registers."""


def order_loop_assembly(name: str, recurrences: Recurrences, order: int, lanes: int, width: int, *, dense: bool) -> str:
    """Return a module with one Taylor step, called like `dalembert.transforms.taylor.step.step_kernel`.

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
    return render("llvm/order_loop.ll.j2", {"name": name, **_tables(order), **step.variables()})


def _tables(order: int) -> dict[str, Any]:
    """Return tables of 1 / k as rounded and of its rounding error."""
    rounded, rests = shares(order)
    return {
        "table_size": len(rounded),
        "shares": [constant(share, 1) for share in rounded],
        "rests": [constant(rest, 1) for rest in rests],
    }


@final
class _Step(OrderPlan):
    """One step function under construction."""

    def __init__(self, recurrences: Recurrences, order: int, lanes: int, width: int, dense: bool) -> None:
        self.lanes, self.width, self.dense = lanes, width, dense
        self.printer = LanePrinter(lanes)
        self.v, self.one = vector(lanes), 8 * lanes
        self.kind, self.stride = vector(lanes * width), 8 * lanes * width
        self.zero = constant(0.0, lanes * width)
        self.fresh = 0
        super().__init__(recurrences, order, width)

    # -- lines ----------------------------------------------------------------------------

    def _lines(self, write: Callable[[], None]) -> list[str]:
        """Return the lines that a function writes."""
        self.printer.lines = []
        write()
        return self.printer.lines

    def _set(self, expression: str, name: str = "") -> str:
        if not name:
            self.fresh += 1
            name = f"x.{self.fresh}"
        self.printer.lines.append(f"%{name} = {expression}")
        return f"%{name}"

    def _at(self, base: str, offset: int | str) -> str:
        return self._set(f"getelementptr i8, ptr {base}, i64 {offset}")

    def _load(self, base: str, row: Row) -> str:
        """Load a row of an order, whose address in the first row is `base`."""
        return self._set(f"load {self.kind}, ptr {self._at(base, self._place(row))}, align {self.stride}")

    def _place(self, row: Row) -> int:
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

    def _keep(self, base: str, row: Row, values: Sequence[Operand]) -> None:
        at = self._at(base, self._place(row))
        self.printer.lines.append(f"store {self.kind} {self._filled(values)}, ptr {at}, align {self.stride}")

    def _write(self, base: str, offset: int, value: Operand) -> None:
        """Store one value, in the rates or in the outputs."""
        self.printer.lines.append(
            f"store {self.v} {self.printer.operand(value)}, ptr {self._at(base, offset)}, align 8"
        )

    # -- variables of the template --------------------------------------------------------

    def variables(self) -> dict[str, Any]:
        """Return names, numbers and lines of the step."""
        return {
            "prelude": prelude_variables(self.lanes),
            "lanes": self.lanes,
            "vector": self.v,
            "row_type": self.kind,
            "row_of_zeros": self.zero,
            "order": self.order,
            "first_order": FIRST_ORDER,
            "memory": memory_of_call(self._size),
            "stride": self.stride,
            "stride_back": -self.stride,
            "two_strides_back": -2 * self.stride,
            "first_orders": self._lines(self._open),
            "carried": self._carried(),
            "sums": self._sums(),
            "one_order": self._lines(self._one_order),
            "closing": self._lines(self._close),
        }

    @property
    def _rates_at(self) -> dict[str, int]:
        """Offset of the coefficients of the rates, behind the rows."""
        begin = len(self.rows) * (self.order + 1) * self.stride
        return {rate: begin + i * (self.order + 1) * self.one for i, rate in enumerate(self.rates)}

    @property
    def _size(self) -> int:
        return (self.order + 1) * (len(self.rows) * self.stride + len(self.rates) * self.one)

    def _open(self) -> None:
        """Write the first orders: their coefficients, and the values that later orders need."""
        for i, state in enumerate(self.recurrences.states):
            self.printer.load(state, "y", i)
        for load in self.recurrences.kernel.loads:
            if load.array != "y":
                self.printer.load(load.target, load.array, load.index or 0)
        for load in closing_loads(self.recurrences):
            self.printer.load(load.target, load.array, load.index or 0)
        self.printer.body(self.first_orders)
        for row in self.rows:
            for k, values in enumerate(self.kept_before(row), 1):
                self._keep(self._at("%n.work", k * self.stride), row, values)
        for rate, begin in self._rates_at.items():
            for k in range(FIRST_ORDER):
                self._write("%n.work", begin + k * self.one, self.entry.series[rate][k])
        if self.dense:
            for i, state in enumerate(self.recurrences.states):
                for k, value in enumerate(self.entry.series[state]):
                    self._write("%out", self._series_at(i) + k * self.one, value)

    def _series_at(self, i: int) -> int:
        """Return the place at which the series of a component of the state begins in the outputs."""
        return (len(self.recurrences.states) + 2 + i * (self.order + 1)) * self.one

    def _carried(self) -> list[dict[str, str]]:
        """Return the values carried from one pass to the next."""
        return [
            {
                "name": carried.name,
                "known": self.printer.operand(carried.known),
                "later": self.printer.operand(carried.series[carried.place]),
            }
            for carried in self.ahead.carried
        ]

    def _sums(self) -> list[dict[str, Any]]:
        """Return the sums without index 0, those with equally many terms in one loop."""
        kinds: dict[tuple[int, bool], list[Pack]] = {}
        for pack in self.packs:
            kinds.setdefault((pack.offset, pack.half), []).append(pack)
        groups = []
        for (offset, half), packs in kinds.items():
            assert not (half and offset), "only products and roots have half sums"
            for first in range(0, len(packs), _TOGETHER):
                groups.append(self._group(packs[first : first + _TOGETHER], half, offset * self.stride))
        return groups

    def _group(self, packs: list[Pack], half: bool, behind: int) -> dict[str, Any]:
        """Return a loop that adds products of rows of packs."""
        name = f"sum.{packs[0].number}"
        write_totals = self._half_totals if half else self._full_totals
        return {
            "name": name,
            "half": half,
            "behind": behind,
            "numbers": [pack.number for pack in packs],
            "products": self._lines(lambda: self._products(name, packs)),
            "totals": self._lines(lambda: write_totals(name, packs)),
        }

    def _products(self, name: str, packs: list[Pack]) -> None:
        """Write one pass of the loop: rows loaded from two addresses, and their products added."""
        loaded: dict[tuple[str, int], str] = {}
        for pack in packs:
            for side, row in (("low", pack.a), ("high", pack.b)):
                if (side, row.place) not in loaded:
                    loaded[side, row.place] = self._load(f"%{name}.{side}", row)
            a, b = loaded["low", pack.a.place], loaded["high", pack.b.place]
            self._fma(a, b, f"%{name}.sum.{pack.number}", f"{name}.more.{pack.number}")

    def _full_totals(self, name: str, packs: list[Pack]) -> None:
        """Write the terms of orders 1 and m - 1, and what the slots hold."""
        one, newest = f"%{name}.last", f"%{name}.newest"
        for pack in packs:
            total = self._fma(self._load(one, pack.a), self._load(newest, pack.b), f"%{name}.total.{pack.number}")
            total = self._fma(self._load(newest, pack.a), self._load(one, pack.b), total)
            for slot in range(len(pack.sums)):
                self._taken(total, slot, f"inner.{pack.number}.{slot}")

    def _half_totals(self, name: str, packs: list[Pack]) -> None:
        """Write what is in the middle of an even k, and what the slots hold."""
        for pack in packs:
            middle = self._load(f"%{name}.middle", pack.a)
            chosen = self._set(f"select i1 %{name}.odd, {self.kind} {self.zero}, {self.kind} {middle}")
            for slot in range(len(pack.sums)):
                self._taken(chosen, slot, f"middle.{pack.number}.{slot}")
                self._taken(f"%{name}.total.{pack.number}", slot, f"inner.{pack.number}.{slot}")

    def _one_order(self) -> None:
        """Write coefficient k of every value, and keep what later orders need."""
        self.printer.body(self.later_orders)
        for row in self.rows:
            base = self._at("%n.here", -row.late * self.stride)
            self._keep(base, row, self.kept_now(row))
        offset = self._set(f"mul i64 %n.k, {self.one}")
        for rate, begin in self._rates_at.items():
            self._write(self._at("%n.work", offset), begin, self.ahead.series[rate][2])
        if self.dense:
            for i, state in enumerate(self.recurrences.states):
                self._write(self._at("%out", offset), self._series_at(i) + self.one, self.ahead.series[state][3])

    def _close(self) -> None:
        """Write the end of the step, from the coefficients of the rates."""
        begins = list(self._rates_at.values())
        read, lines, outputs = self.end()
        for name, i, k in read:
            at = self._at("%n.work", begins[i] + k * self.one)
            self._set(f"load {self.v}, ptr {at}, align 8", name)
        self.printer.body(lines)
        for index, operand in enumerate(outputs):
            self.printer.store(operand, index)
