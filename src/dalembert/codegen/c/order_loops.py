"""Taylor steps as loops over the orders in C, which are shorter than unrolled code and give the same bits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

from ...ir.kernel import Assignment, Operand
from ...transforms.taylor.order_pass import FIRST_ORDER, Ahead, OrderPlan, Pack, shares
from ...transforms.taylor.recurrences import Recurrences
from ...transforms.taylor.step import closing_loads
from .kernels import Names, body_lines
from .printing import double, rows_of

_WIDTH, _TOGETHER = 4, 8
"""Sums side by side, which compilers take in one register; packs of these in one loop."""


def order_loop_variables(name: str, recurrences: Recurrences, order: int) -> dict[str, Any]:
    """Return the variables of ``c/order_loop.c.j2``: a step that also writes its series.

    It is called like `dalembert.transforms.taylor.step.step_kernel`.
    """
    return _Step(recurrences, order).variables(name)


@final
class _Step(OrderPlan):
    def __init__(self, recurrences: Recurrences, order: int) -> None:
        super().__init__(recurrences, order, _WIDTH)
        self.names = Names(("t", "y", "c", "s", "out"))
        own = ("shares", "rests", "row", "rate", "k", "i", "m")
        self.own = {wish: self.names(f"own {wish}") for wish in own}
        self.at_end, self.end_lines, self.end_outputs = self.end()
        self.live = self._live()
        read = {arg for line in self.end_lines if line.target in self.live for arg in line.args}
        read |= set(self.end_outputs)
        self.carried = [item for item in self.ahead.carried if item.name in self.live]
        self.outside = [line.target for line in self.later_orders if line.target in read and line.target in self.live]

    def _live(self) -> set[Operand]:
        """Return the values that what is kept or written depends on."""
        states, entry, now = self.recurrences.states, self.entry.series, self.ahead.series
        live: set[Operand] = {*self.end_outputs}
        for row in self.rows:
            live |= {*self.kept_now(row), *(value for values in self.kept_before(row) for value in values)}
        for rate in self.rates:
            live |= {now[rate][2], *entry[rate][:FIRST_ORDER]}
        for state in states:
            live |= {now[state][3], *entry[state][: FIRST_ORDER + 1]}
        lines = [*self.first_orders, *self.later_orders, *self.end_lines]
        size = -1
        while size < len(live):
            size = len(live)
            for line in reversed(lines):
                if line.target in live:
                    live.update(line.args)
            for item in self.ahead.carried:
                if item.name in live:
                    live |= {item.known, item.series[item.place]}
        return live

    def variables(self, name: str) -> dict[str, Any]:
        """Return names, numbers and lines."""
        own, names = self.own, self.names
        rounded, rests = shares(self.order)
        return {
            "name": name,
            "doc": f"A Taylor step of order {self.order}.",
            "width": _WIDTH,
            "last": self.order - 1,
            "orders": self.order + 1,
            "terms": len(rounded),
            "first_order": FIRST_ORDER,
            "rows": max(len(self.rows), 1),
            "rates": max(len(self.rates), 1),
            "shares": rows_of([double(share) for share in rounded]),
            "rests": rows_of([double(rest) for rest in rests]),
            "shares_name": own["shares"],
            "rests_name": own["rests"],
            "row": own["row"],
            "rate": own["rate"],
            "k": own["k"],
            "i": own["i"],
            "m": own["m"],
            "share": names(Ahead.SHARE),
            "rest": names(Ahead.REST),
            "next_share": names(Ahead.NEXT_SHARE),
            "next_rest": names(Ahead.NEXT_REST),
            "order_name": names(Ahead.ORDER),
            "first_orders": self._open(),
            "outside": self._outside(),
            "groups": self._groups(),
            "one_order": self._one_order(),
            "turn": self._turn(),
            "closing": self._close(),
        }

    def _operand(self, operand: Operand) -> str:
        return self.names.operand(operand)

    def _row(self, place: int, order: str, slot: int) -> str:
        return f"{self.own['row']}[{place}][{order}][{slot}]"

    def _kept(self, place: int, order: str, values: Sequence[Operand]) -> list[str]:
        """Return the lines that keep values in the slots of a row."""
        filled = [*values, *[0.0] * (_WIDTH - len(values))]
        return [f"{self._row(place, order, slot)} = {self._operand(value)};" for slot, value in enumerate(filled)]

    def _series_at(self, i: int) -> int:
        """Return the place at which the series of a component of the state begins in the outputs."""
        return len(self.recurrences.states) + 2 + i * (self.order + 1)

    def _open(self) -> list[str]:
        """Return the lines of the first orders, and of what later orders need of them."""
        states, loads = self.recurrences.states, self.recurrences.kernel.loads
        loaded = [(state, "y", i) for i, state in enumerate(states)]
        others = [*(load for load in loads if load.array != "y"), *closing_loads(self.recurrences)]
        loaded += [(load.target, load.array, load.index or 0) for load in others]
        lines = [f"const double {self.names(name)} = {array}[{i}];" for name, array, i in loaded if name in self.live]
        lines += self._body(self.first_orders)
        for row in self.rows:
            for k, values in enumerate(self.kept_before(row), 1):
                lines += self._kept(row.place, str(k), values)
        for i, rate in enumerate(self.rates):
            for k, value in enumerate(self.entry.series[rate][:FIRST_ORDER]):
                lines.append(f"{self.own['rate']}[{i}][{k}] = {self._operand(value)};")
        for i, state in enumerate(states):
            for k, value in enumerate(self.entry.series[state][: FIRST_ORDER + 1]):
                lines.append(f"out[{self._series_at(i) + k}] = {self._operand(value)};")
        return lines

    def _body(self, lines: Sequence[Assignment]) -> list[str]:
        """Return the lines of operations; variables that outlive a pass are declared already."""
        kept, outside = [line for line in lines if line.target in self.live], set(self.outside)
        found = []
        for line, text in zip(kept, body_lines(kept, self.names), strict=True):
            name = self.names(line.target)
            found.append(text.replace(f"const double {name} =", f"{name} =") if line.target in outside else text)
        return found

    def _outside(self) -> list[dict[str, str]]:
        """Return the variables that outlive a pass, with their first values."""
        carried = [{"name": self.names(item.name), "begin": self._operand(item.known)} for item in self.carried]
        return carried + [{"name": self.names(name), "begin": "0.0"} for name in self.outside]

    def _groups(self) -> list[dict[str, Any]]:
        """Return the sums without index 0, those with equally many terms in one loop."""
        kinds: dict[tuple[int, bool], list[Pack]] = {}
        for pack in self.packs:
            kinds.setdefault((pack.offset, pack.half), []).append(pack)
        found = []
        for (offset, half), packs in kinds.items():
            for first in range(0, len(packs), _TOGETHER):
                found.append(self._group(packs[first : first + _TOGETHER], half, offset))
        return found

    def _group(self, packs: list[Pack], half: bool, behind: int) -> dict[str, Any]:
        totals = []
        for pack in packs:
            for slot in range(len(pack.sums)):
                inner, middle = (self.names(f"{kind}.{pack.number}.{slot}") for kind in ("inner", "middle"))
                if f"inner.{pack.number}.{slot}" in self.live:
                    totals.append(f"const double {inner} = {self._sum(pack)}[{slot}];")
                if half and f"middle.{pack.number}.{slot}" in self.live:
                    k = self.own["k"]
                    at = self._row(pack.a.place, f"{k} / 2", slot)
                    totals.append(f"const double {middle} = {k} % 2 == 1 ? 0.0 : {at};")
        return {
            "half": half,
            "behind": behind,
            "packs": [{"sum": self._sum(pack), "a": pack.a.place, "b": pack.b.place} for pack in packs],
            "totals": totals,
        }

    def _sum(self, pack: Pack) -> str:
        return self.names(f"sum.{pack.number}")

    def _one_order(self) -> list[str]:
        """Return the lines of coefficient k of every value, and of what later orders need of it."""
        k, lines = self.own["k"], list[str]()
        lines += self._body(self.later_orders)
        for row in self.rows:
            lines += self._kept(row.place, f"{k} - {row.late}" if row.late else k, self.kept_now(row))
        for i, rate in enumerate(self.rates):
            lines.append(f"{self.own['rate']}[{i}][{k}] = {self._operand(self.ahead.series[rate][2])};")
        for i, state in enumerate(self.recurrences.states):
            value = self._operand(self.ahead.series[state][3])
            lines.append(f"out[{self._series_at(i) + 1} + {k}] = {value};")
        return lines

    def _turn(self) -> list[str]:
        """Return the lines that carry values to the next pass."""
        carried = self.carried
        later = [self._operand(item.series[item.place]) for item in carried]
        names = [self.names(item.name) for item in carried]
        if not set(names) & set(later):
            return [f"{name} = {value};" for name, value in zip(names, later, strict=True)]
        held = [self.names(f"next {item.name}") for item in carried]
        lines = [f"const double {one} = {value};" for one, value in zip(held, later, strict=True)]
        return lines + [f"{name} = {one};" for name, one in zip(names, held, strict=True)]

    def _close(self) -> list[str]:
        """Return the lines of the end of the step, from the coefficients of the rates."""
        lines = [f"const double {self.names(name)} = {self.own['rate']}[{i}][{k}];" for name, i, k in self.at_end
                 if name in self.live]  # fmt: skip
        lines += self._body(self.end_lines)
        return lines + [f"out[{i}] = {self._operand(value)};" for i, value in enumerate(self.end_outputs)]
