"""Variables of ``numba/taylor.py.j2``: a Taylor step with its recurrences as loops over the orders.

The series of every value lies in an array ``w``, coefficient after coefficient, those of the state first. A pass of the
loop computes the next coefficient of every value, in one line each; products are calls of a convolution.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

from ...ir.kernel import Assignment, Operand
from ...transforms.taylor.recurrences import Integrated, Recurrences
from ...transforms.taylor.step import closing_loads, ending
from ..printers import NUMBA

_PIECE = 100
"""Values in one function."""


def taylor_loop(name: str, recurrences: Recurrences, order: int, *, dense: bool) -> dict[str, Any]:
    """Return the variables of the template of a step, called like `dalembert.transforms.taylor.step.step_kernel`."""
    return _Step(recurrences, order).variables(name, dense)


def _line(item: Assignment | Integrated) -> Assignment:
    return item.value if isinstance(item, Integrated) else item


@final
class _Step:
    """Places of the coefficients of every value, and the lines that compute them."""

    def __init__(self, recurrences: Recurrences, order: int) -> None:
        self.recurrences, self.order = recurrences, order
        self.rate = dict(zip(recurrences.states, recurrences.rates, strict=True))
        self.clocks = [load.target for load in recurrences.kernel.loads if load.array == "t"]
        series = [*recurrences.states, *self.clocks]
        fixed = [load.target for load in recurrences.kernel.loads if load.array not in ("t", "y")]
        for item in recurrences.items:
            target = _line(item).target
            (series if target in recurrences.varying else fixed).append(target)
        inner = [a for item in recurrences.items if isinstance(item, Integrated) for _, a, _ in item.terms]
        slopes = dict.fromkeys(a for a in inner if isinstance(a, str) and a not in self.rate and a in set(series))
        terms = order + 1
        self.place = {name: number * terms for number, name in enumerate(series)}
        self.slope = {name: (len(series) + number) * terms for number, name in enumerate(slopes)}
        self.fixed = {name: (len(series) + len(slopes)) * terms + number for number, name in enumerate(fixed)}
        self.size = (len(series) + len(slopes)) * terms + len(fixed)

    def variables(self, name: str, dense: bool) -> dict[str, Any]:
        """Return the variables of the template."""
        states, items = self.recurrences.states, self.recurrences.items
        lines, outputs = self._end()
        return {
            "name": name,
            "doc": f"A Taylor step of order {self.order}: {len(items)} recurrences.",
            "size": 8 * self.size,
            "order": self.order,
            "terms": self.order + 1,
            "states": len(states),
            "dense": dense,
            "outputs": len(outputs),
            "loads": self._loads(),
            "clocks": [self._clock(place) for place in self._times()],
            "pieces": [
                self._piece(name, number, items[first : first + _PIECE])
                for number, first in enumerate(range(0, len(items), _PIECE))
            ],
            "rates": [self._rate(state, rate) for state, rate in self.rate.items()],
            "lines": lines,
            "stores": [{"place": f"out[{i}]", "value": value} for i, value in enumerate(outputs)],
        }

    def _loads(self) -> list[dict[str, Any]]:
        """Return coefficients 0 of what is given; slopes begin with zero."""
        loads = [{"place": self.place[state], "value": f"y[{i}]"} for i, state in enumerate(self.recurrences.states)]
        for load in self.recurrences.kernel.loads:
            if load.array != "y":
                place = self.place.get(load.target, self.fixed.get(load.target))
                loads.append({"place": place, "value": f"{load.array}[{load.index or 0}]"})
        return loads + [{"place": place, "value": "0.0"} for place in self.slope.values()]

    def _times(self) -> list[int]:
        """Return where the series of time lie, and of its slope where a function of time is integrated."""
        return [place[clock] for clock in self.clocks for place in (self.place, self.slope) if clock in place]

    def _clock(self, place: int) -> dict[str, int]:
        return {"slope": place + 1, "rest": place + 2, "end": place + self.order + 1}

    def _piece(self, name: str, number: int, items: Sequence[Assignment | Integrated]) -> dict[str, Any]:
        return {
            "first": f"{name}_first_{number}",
            "later": f"{name}_later_{number}",
            "starts": [self._start(_line(item)) for item in items],
            "recurrences": [line for item in items for line in self._later(item)],
        }

    def _rate(self, state: str, rate: Operand) -> dict[str, Any]:
        return {"next": self.place[state] + 1, "start": self._first(rate), "value": self._now(rate)}

    # -- operands ---------------------------------------------------------------------------

    def _first(self, operand: Operand) -> str:
        """Return coefficient 0."""
        if not isinstance(operand, str):
            return NUMBA.operand(operand)
        return f"w[{self.place[operand] if operand in self.place else self.fixed[operand]}]"

    def _now(self, operand: Operand, back: int = 0) -> str:
        """Return coefficient k - `back` >= 1: zero for what does not vary."""
        return f"w[{self.place[str(operand)] - back} + k]" if self._varies(operand) else "0.0"

    def _varies(self, operand: Operand) -> bool:
        return isinstance(operand, str) and operand in self.place

    def _convolved(self, a: int, b: int, count: str) -> str:
        """Return the sum of w[a + j] w[b + k - j] for j below `count`."""
        return f"_convolve(w, {a}, {b} + k, {count})"

    # -- lines ------------------------------------------------------------------------------

    def _start(self, line: Assignment) -> str:
        value = NUMBA.expression(line.op, *map(self._first, line.args))
        return f"{self._first(line.target)} = {value}"

    def _later(self, item: Assignment | Integrated) -> list[str]:
        """Return the lines of coefficient k of a value."""
        line = _line(item)
        if not self._varies(line.target):
            return []
        value = self._integral(item) if isinstance(item, Integrated) else self._coefficient(line)
        lines = [f"{self._now(line.target)} = {value}"]
        if line.target in self.slope:
            lines.append(f"w[{self.slope[line.target]} + k] = {self._now(line.target)} * order")
        return lines

    def _integral(self, item: Integrated) -> str:
        terms: list[str] = []
        for sign, inner, factor in item.terms:
            if not self._varies(inner) or not self._varies(factor):
                continue
            assert isinstance(inner, str)
            rate, other = self.rate.get(inner), self.place[factor]
            if rate is None:
                term = self._convolved(self.slope[inner] + 1, other - 1, "k")
            elif self._varies(rate):
                term = self._convolved(self.place[str(rate)], other - 1, "k")
            else:  # of a constant rate, only the first coefficient counts
                term = f"{self._first(rate)} * {self._now(factor, 1)}"
            before = " + " if terms else ""
            terms.append(before + term if sign > 0 else f"{before.replace('+', '-') or '-'}{term}")
        total = "".join(terms)
        return "0.0" if not terms else f"{total} / order" if len(terms) == 1 else f"({total}) / order"

    def _coefficient(self, line: Assignment) -> str:
        """Return coefficient k of an operation with a recurrence of its own."""
        own, first, now = self.place[line.target], self._first, self._now
        a = line.args[0]
        b: Operand = line.args[1] if len(line.args) > 1 else 0.0
        match line.op:
            case "add" | "sub" | "neg":
                return NUMBA.formats[line.op].format(*map(now, line.args))
            case "mul" if self._varies(a) and self._varies(b):
                return self._convolved(self.place[str(a)], self.place[str(b)], "k + 1")
            case "mul":
                return f"{first(a)} * {now(b)}" if self._varies(b) else f"{now(a)} * {first(b)}"
            case "div" if self._varies(b):
                return f"({now(a)} - {self._convolved(self.place[str(b)] + 1, own - 1, 'k')}) / {first(b)}"
            case "div":
                return f"{now(a)} / {first(b)}"
            case "sqrt":
                known = self._convolved(own + 1, own - 1, "k - 1")
                return f"({now(a)} - {known}) / ({first(line.target)} + {first(line.target)})"
            case "abs":
                return f"_select(_less({first(a)}, 0.0), -{now(a)}, {now(a)})"
            case "min" | "max":
                order = (a, b) if line.op == "min" else (b, a)
                return f"_select(_less_equal({first(order[0])}, {first(order[1])}), {now(a)}, {now(b)})"
            case "select":
                return f"_select({first(a)}, {now(b)}, {now(line.args[2])})"
            case _:  # sign, floor and comparisons are constant between their jumps
                return "0.0"

    def _end(self) -> tuple[list[str], list[str]]:
        """Return the lines of the end of the step, and what is stored."""
        recurrences = self.recurrences
        states, orders = recurrences.states, range(self.order)
        old = {state: f"old_{i}_" for i, state in enumerate(states)}
        names: dict[Operand, str] = dict(old.items())
        rates = [[f"rate_{i}_{k}_" for k in orders] for i in range(len(states))]
        poles = [[f"pole_{i}_{k}_" for k in orders] for i in range(len(recurrences.poles))]
        watched = [[f"watched_{i}_{k}_" for k in orders] for i in range(len(recurrences.watched))]
        body, outputs = ending(recurrences, rates, poles, self.order, watched)
        lines = [f"{name} = y[{i}]" for i, name in enumerate(old.values())]
        lines += [f"{load.target} = {load.array}[{load.index or 0}]" for load in closing_loads(recurrences)]
        sources = [*recurrences.rates, *recurrences.poles, *recurrences.watched]
        for values, series in zip([*rates, *poles, *watched], sources, strict=True):
            for k, value in enumerate(values):
                lines.append(f"{value} = {self._first(series) if k == 0 else self._at(series, k)}")
        read = {arg for line in body for arg in line.args} | set(outputs)
        for name, place in [*self.fixed.items(), *((clock, self.place[clock]) for clock in self.clocks)]:
            if name in read:
                lines.append(f"{name} = w[{place}]")
        for line in body:
            lines.append(NUMBA.assignment(Assignment(line.target, line.op, tuple(names.get(a, a) for a in line.args))))
        return lines, [NUMBA.operand(names.get(output, output)) for output in outputs]

    def _at(self, operand: Operand, k: int) -> str:
        """Return a coefficient above 0."""
        return f"w[{self.place[str(operand)] + k}]" if self._varies(operand) else "0.0"
