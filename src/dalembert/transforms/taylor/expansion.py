"""Expansion of recurrences: Taylor coefficients of every value, order by order.

`Expansion` writes orders 0, 1, 2, ... out as straight-line code. `dalembert.transforms.taylor.order_pass` writes one
order as the body of a loop. Both use `Extension`: the same operations in the same order, and so the same bits.

The recurrences divide by the order k. A product with the rounded 1 / k is off by the same share at every step, which
makes the errors of a long run grow with time and not with its square root (energy of the harmonic oscillator over 1e5
time units: 1.5e-12 and 2.6e-14). From `FAITHFUL_ORDER` on, where tolerances are near that share, the rest of 1 / k is
therefore multiplied too.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from fractions import Fraction
from typing import final

from ...frozen import frozen
from ...ir.kernel import Assignment, Lines, Operand
from .recurrences import Integrated, Recurrences

FAITHFUL_ORDER = 19
"""Order from which quotients by the order are rounded but once: that of tolerances up to 7e-13."""

Series = list[Operand]


def coefficient(series: Series, k: int) -> Operand:
    """Return coefficient k, which is zero where a series has ended."""
    return series[k] if k < len(series) else 0.0


def over(lines: Lines, value: Operand, k: int, faithful: bool) -> Operand:
    """Return value / k."""
    share = 1.0 / k
    rest = float(Fraction(1, k) - Fraction(share))
    if not faithful or rest == 0.0:
        return lines.mul(value, share)
    return lines.fma(value, share, lines.mul(value, rest))


@final
@frozen(eq=False)
class Sum:
    """The sum of a_i b_(m-i) for i = 0 .. m, written order by order; if `half`, that for i < m - i of one series.

    `a` is the factor that is known later. The pairs without index 0, whose factors are known before the present order,
    come first, and those with the newest coefficients last among them: little is left to wait for.
    """

    a: Series
    b: Series
    half: bool = False

    def inner(self, m: int) -> list[tuple[int, int]]:
        """Return the pairs of indices other than 0."""
        if self.half:
            return [(i, m - i) for i in range((m - 1) // 2, 0, -1)]
        return [(i, m - i) for i in (*range(2, m - 1), *dict.fromkeys((1, m - 1))) if 0 < i < m]


class Extension(ABC):
    """The next coefficient of every value, from those that are known.

    Attributes
    ----------
    lines : Lines
        The operations so far.
    series, slopes : dict of str to Series
        Coefficients of every value, and those of the derivatives (j + 1) a_(j+1) where a recurrence needs them.
    sums : dict of str to list of Sum
        Sums that the coefficients of a value need.
    """

    def __init__(self, recurrences: Recurrences, lines: Lines, faithful: bool) -> None:
        self.recurrences, self.lines, self.faithful = recurrences, lines, faithful
        self.rate = dict(zip(recurrences.states, recurrences.rates, strict=True))
        self.clock = [load.target for load in recurrences.kernel.loads if load.array == "t"]
        self.items = [(item, item.value if isinstance(item, Integrated) else item) for item in recurrences.items]
        self.moving = [(item, line) for item, line in self.items if line.target in recurrences.varying]
        self.series: dict[str, Series] = {}
        self.slopes: dict[Operand, Series] = {}
        self.sums: dict[str, list[Sum]] = {}
        self._scaled = dict(scaled for item, line in self.moving if (scaled := self._constant_times(item, line)))

    @abstractmethod
    def _inner(self, k: int) -> dict[Sum, Operand]:
        """Return the part without index 0 of every sum that coefficients k need."""

    @abstractmethod
    def _middle(self, series: Series, k: int) -> Operand:
        """Return coefficient k / 2, or zero where k is odd."""

    @abstractmethod
    def _over(self, value: Operand, k: int) -> Operand:
        """Return value / k."""

    @abstractmethod
    def _times_order(self, value: Operand, k: int) -> Operand:
        """Return value * k."""

    def of(self, operand: Operand) -> Series:
        """Return the series of an operand."""
        return self.series[operand] if isinstance(operand, str) else [operand]

    def _extend(self, k: int) -> None:
        """Append coefficient k >= 1 of every value, and coefficient k + 1 of the state."""
        for clock in self.clock:
            self._append(clock, 1.0 if len(self.series[clock]) == 1 else 0.0, k)
        inner = self._inner(k)
        for item, line in self.moving:
            begin = len(self.lines.body)
            self._append(line.target, self._next(item, line, inner, k), k)
            self.lines.note((line.target, k), begin)
        self._move(k)

    def _move(self, k: int) -> None:
        for state, rate in self.rate.items():
            begin = len(self.lines.body)
            self._append(state, self._over(coefficient(self.of(rate), k), k + 1), k + 1)
            self.lines.note((state, k + 1), begin)

    def _append(self, target: str, value: Operand, k: int) -> None:
        self.series[target].append(value)
        if target in self.slopes:
            self.slopes[target].append(self._times_order(value, k))

    def _constant_times(
        self, item: Assignment | Integrated, line: Assignment
    ) -> tuple[str, tuple[str, Operand]] | None:
        """Return a product with a constant: its name, and that of the other factor with the constant."""
        if item is not line or line.op != "mul":
            return None
        moving, fixed = sorted(line.args, key=self._is_fixed)
        return (line.target, (str(moving), fixed)) if self._is_fixed(fixed) else None

    def _is_fixed(self, value: Operand) -> bool:
        """Return whether a value is constant: one of no state, or a component of the state whose rate is zero."""
        return value not in self.recurrences.varying or self.rate.get(str(value)) == 0.0

    def _whole(self, s: Sum, inner: Operand, m: int) -> Operand:
        """Return a sum with all of its pairs."""
        total = self.lines.fma(coefficient(s.a, 0), coefficient(s.b, m), inner)
        return total if m == 0 or s.half else self.lines.fma(coefficient(s.a, m), coefficient(s.b, 0), total)

    def _next(self, item: Assignment | Integrated, line: Assignment, inner: dict[Sum, Operand], k: int) -> Operand:
        lines, own, sums = self.lines, self.series[line.target], self.sums[line.target]
        if isinstance(item, Integrated):
            total: Operand = 0.0
            for (sign, _, _), s in zip(item.terms, sums, strict=True):
                term = self._whole(s, inner[s], k - 1)
                total = lines.add(total, term) if sign > 0 else lines.sub(total, term)
            return self._over(total, k)
        a, *rest = (self.of(arg) for arg in line.args)
        match line.op:
            case "add" | "sub":
                return self._added(line, k)
            case "neg":
                return lines.neg(coefficient(a, k))
            case "mul":
                return self._product(a, rest[0], sums, inner, k)
            case "div":
                inverse = self._inverse(rest[0][0])
                known = lines.fma(coefficient(sums[0].a, k), own[0], inner[sums[0]]) if sums else 0.0
                return lines.fma(coefficient(a, k), inverse, lines.neg(lines.mul(known, inverse)))
            case "sqrt":
                known = self._doubled(inner[sums[0]], self._middle(own, k))
                return lines.mul(lines.sub(coefficient(a, k), known), self._inverse(lines.mul(own[0], 2.0)))
            case "abs":
                return lines.mul(lines.op("sign", a[0]), coefficient(a, k))
            case "min" | "max":
                b = rest[0]
                first = (a[0], b[0]) if line.op == "min" else (b[0], a[0])
                return lines.op("select", lines.op("less_equal", *first), coefficient(a, k), coefficient(b, k))
            case "select":
                return lines.op("select", a[0], coefficient(rest[0], k), coefficient(rest[1], k))
            case _:  # sign, floor and comparisons are constant between their jumps
                return 0.0

    def _added(self, line: Assignment, k: int) -> Operand:
        """Return coefficient k of a sum or a difference; a term that is a constant times something is fused into it."""
        left, right = line.args
        minus = line.op == "sub"
        for term, other, turned in ((right, left, minus), (left, right, False)):
            if term in self._scaled:
                x, constant = self._scaled[str(term)]
                rest, factor = coefficient(self.of(other), k), self.of(constant)[0]
                if minus:
                    rest, factor = (rest, self.lines.neg(factor)) if turned else (self.lines.neg(rest), factor)
                return self.lines.fma(coefficient(self.of(x), k), factor, rest)
        add = self.lines.sub if minus else self.lines.add
        return add(coefficient(self.of(left), k), coefficient(self.of(right), k))

    def _product(self, a: Series, b: Series, sums: list[Sum], inner: dict[Sum, Operand], k: int) -> Operand:
        if not sums:
            constant, moving = (b, a) if len(b) == 1 else (a, b)
            return self.lines.mul(coefficient(moving, k), constant[0])
        total = self._whole(sums[0], inner[sums[0]], k)
        return self._doubled(total, self._middle(a, k)) if a is b else total

    def _doubled(self, half_sum: Operand, middle: Operand) -> Operand:
        """Return twice a sum over pairs, and the square of the middle coefficient where there is one."""
        return self.lines.fma(middle, middle, self.lines.mul(half_sum, 2.0))

    def _inverse(self, a: Operand) -> Operand:
        return self.lines.op("div", 1.0, a) if isinstance(a, str) else 1.0 / a


@final
class Expansion(Extension):
    """The first orders, written out one after the other."""

    def __init__(self, recurrences: Recurrences, order: int) -> None:
        super().__init__(recurrences, Lines(), order >= FAITHFUL_ORDER)
        self.series = {state: [state] for state in recurrences.states}
        for load in recurrences.kernel.loads:
            self.series.setdefault(load.target, [load.target])
        self.orders = 0

    def extend(self, orders: int) -> None:
        """Append coefficients of every value until there are so many, and one more of the state."""
        while self.orders < orders:
            k, self.orders = self.orders, self.orders + 1
            if k > 0:
                self._extend(k)
                continue
            for _, line in self.items:
                self.series[line.target] = [self.lines.op(line.op, *(self.of(arg)[0] for arg in line.args))]
            depth = self._depths()
            self.sums = {line.target: self._needed(item, line, depth) for item, line in self.moving}
            self._move(0)

    def _depths(self) -> dict[int, int]:
        """Return the depth of each series within an order: the length of the chain of series that it needs."""
        depth: dict[str, int] = {}
        for item, line in self.moving:
            before = [] if isinstance(item, Integrated) else [depth.get(a, 0) for a in line.args if isinstance(a, str)]
            depth[line.target] = 1 + max(before, default=0)
        return {id(self.series[name]): level for name, level in depth.items()}

    def _needed(self, item: Assignment | Integrated, line: Assignment, depth: dict[int, int]) -> list[Sum]:
        """Return the sums of products that the coefficients of a value need."""

        def oriented(a: Series, b: Series) -> Sum:
            return Sum(b, a) if depth.get(id(a), 0) < depth.get(id(b), 0) else Sum(a, b)

        varying, own = self.recurrences.varying, self.series[line.target]
        if isinstance(item, Integrated):
            return [oriented(self._slope(inner), self.series[factor]) for _, inner, factor in item.terms]
        if line.op == "mul" and all(arg in varying for arg in line.args):
            a, b = (self.of(arg) for arg in line.args)
            return [Sum(a, a, half=True) if a is b else oriented(a, b)]
        if line.op == "div" and line.args[1] in varying:
            return [Sum(self.of(line.args[1]), own)]
        return [Sum(own, own, half=True)] if line.op == "sqrt" else []

    def _slope(self, inner: Operand) -> Series:
        """Return the series of the derivative of a value: of a state, that of its rate."""
        if isinstance(inner, str) and inner in self.rate:
            return self.of(self.rate[inner])
        return self.slopes.setdefault(inner, [])

    def _inner(self, k: int) -> dict[Sum, Operand]:
        total: dict[Sum, Operand] = {}
        for item, line in self.moving:
            for s in self.sums[line.target]:
                begin = len(self.lines.body)
                part: Operand = 0.0
                for i, j in s.inner(k - 1 if isinstance(item, Integrated) else k):
                    part = self.lines.fma(coefficient(s.a, i), coefficient(s.b, j), part)
                total[s] = part
                self.lines.note((s, k), begin)
        return total

    def _middle(self, series: Series, k: int) -> Operand:
        return coefficient(series, k // 2) if k % 2 == 0 else 0.0

    def _over(self, value: Operand, k: int) -> Operand:
        return over(self.lines, value, k, self.faithful)

    def _times_order(self, value: Operand, k: int) -> Operand:
        return self.lines.mul(value, float(k))
