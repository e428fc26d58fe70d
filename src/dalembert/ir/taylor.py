"""[Recurrences] -> [Kernel]: one step of a Taylor method as straight-line code.

A step computes the series of the state, takes its size from the last two coefficients, and sums
the series by Horner's scheme. Order and step size follow Jorba and Zou (Experimental Mathematics
14, 2005): order ceil(-log(tolerance)/2 + 1), and the smaller of the two estimates of the radius of
convergence, divided by e**2, with their safety factor exp(-0.7 / (order - 1)).

The recurrences divide by the order k. A product with the rounded 1 / k is off by the same share at every step, which
makes the errors of a long run grow with time and not with its square root (energy of the harmonic oscillator over 1e5
time units: 1.5e-12 and 2.6e-14). From `FAITHFUL_ORDER` on, where tolerances are near that share, the rest of 1 / k is
therefore multiplied too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import final

from .lines import Lines
from .passes import eliminate_dead_code, run
from .program import Assignment, Kernel, Load, Operand
from .recurrences import Integrated, Recurrences

__all__ = [
    "FAITHFUL_ORDER",
    "SETTINGS",
    "STEP_ARGUMENTS",
    "clipped_tolerance",
    "controlled",
    "order_for",
    "series_kernel",
    "step_kernel",
]

STEP_ARGUMENTS = ("t", "y", "c", "s")
SETTINGS = ("largest step", "direction of time", "scale floor")
"""What the argument s holds. The scale floor is atol / rtol, below which a state counts as that large."""

FAITHFUL_ORDER = 16
"""Order from which quotients by the order are rounded but once: that of tolerances up to 1e-13."""

Series = list[Operand]


def clipped_tolerance(rtol: float, atol: float) -> float:
    """Return the tolerance that the order of a Taylor step follows: rtol, or atol where there is no rtol."""
    return min(max(rtol or atol, 1e-18), 0.5)


def order_for(tolerance: float) -> int:
    """Return the order that is cheapest for a tolerance."""
    return max(4, math.ceil(-math.log(tolerance) / 2.0 + 1.0))


def _at(series: Series, k: int) -> Operand:
    return series[k] if k < len(series) else 0.0


def _over(lines: Lines, value: Operand, k: int, faithful: bool) -> Operand:
    """Return value / k."""
    share = 1.0 / k
    rest = float(Fraction(1, k) - Fraction(share))
    if not faithful or rest == 0.0:
        return lines.mul(value, share)
    return lines.fma(value, share, lines.mul(value, rest))


Dot = list[tuple[Series, int, Series, int]]
"""A sum of products of coefficients, each a series and an index into it that may not be known yet."""


@final
class _Expansion:
    """The series of every value, extended order by order."""

    def __init__(self, recurrences: Recurrences, order: int) -> None:
        self.lines = Lines()
        self.recurrences, self.faithful = recurrences, order >= FAITHFUL_ORDER
        self.rate = dict(zip(recurrences.states, recurrences.rates, strict=True))
        self.series: dict[str, Series] = {state: [state] for state in recurrences.states}
        self.slopes: dict[Operand, Series] = {}
        self.clock = [load.target for load in recurrences.kernel.loads if load.array == "t"]
        for load in recurrences.kernel.loads:
            self.series.setdefault(load.target, [load.target])

    def of(self, operand: Operand) -> Series:
        return self.series[operand] if isinstance(operand, str) else [operand]

    def extend(self, k: int) -> None:
        """Append coefficient k of every value, and coefficient k + 1 of the state."""
        for clock in self.clock:
            if k > 0:
                self._append(clock, 1.0 if k == 1 else 0.0)
        items = [(item, item.value if isinstance(item, Integrated) else item) for item in self.recurrences.items]
        moving = [(item, line) for item, line in items if line.target in self.recurrences.varying]
        if k == 0:
            for _, line in items:
                self.series[line.target] = [self.lines.op(line.op, *(self.of(arg)[0] for arg in line.args))]
        else:
            dots = [self._dots(item, line, k) for item, line in moving]
            begun = self._begin([dot for group in dots for dot in group])
            for (item, line), group in zip(moving, dots, strict=True):
                sums = [self._finish(dot, begun) for dot in group]
                self._append(line.target, self._coefficient(item, line, sums, k))
        for state, rate in self.rate.items():
            self._append(state, _over(self.lines, _at(self.of(rate), k), k + 1, self.faithful))

    def _append(self, target: str, value: Operand) -> None:
        self.series[target].append(value)
        if target in self.slopes:
            self.slopes[target].append(self.lines.mul(value, float(len(self.series[target]) - 1)))

    def _begin(self, dots: list[Dot]) -> dict[int, Operand]:
        """Sum the products whose factors are known, oldest first, so that little is left to wait for the newest."""
        sums: dict[int, Operand] = {}
        for dot in dots:
            dot.sort(key=lambda product: max(product[1], product[3]))
            for place, (a, i, b, j) in enumerate(dot):
                if i < len(a) and j < len(b):
                    sums[id(dot)] = self.lines.fma(a[i], b[j], sums.get(id(dot), 0.0))
                    dot[place] = ([], 0, [], 0)
        return sums

    def _finish(self, dot: Dot, begun: dict[int, Operand]) -> Operand:
        total = begun.get(id(dot), 0.0)
        for a, i, b, j in dot:
            if a:
                total = self.lines.fma(a[i], b[j], total)
        return total

    def _dots(self, item: Assignment | Integrated, line: Assignment, k: int) -> list[Dot]:
        """Return the sums of products that coefficient k of a value needs."""
        if isinstance(item, Integrated):
            return [self._slope_dot(inner, self.series[factor], k) for _, inner, factor in item.terms]
        varying, own = self.recurrences.varying, self.series[line.target]
        if line.op == "mul" and all(arg in varying for arg in line.args):
            a, b = (self.of(arg) for arg in line.args)
            return [[(a, j, b, k - j) for j in range((k + 1) // 2 if a is b else k + 1)]]
        if line.op == "div" and line.args[1] in varying:
            b = self.of(line.args[1])
            return [[(b, j, own, k - j) for j in range(1, k + 1)]]
        if line.op == "sqrt":
            return [[(own, j, own, k - j) for j in range(1, (k + 1) // 2)]]
        return []

    def _slope_dot(self, inner: Operand, factor: Series, k: int) -> Dot:
        """Return the sum of j inner_j factor_(k-j); of a state, j inner_j is coefficient j - 1 of its rate."""
        if isinstance(inner, str) and inner in self.rate:
            rate = self.of(self.rate[inner])
            return [(rate, j - 1, factor, k - j) for j in range(1, k + 1) if j - 1 < len(rate) or len(rate) > 1]
        if inner not in self.slopes:
            known = self.of(inner)
            self.slopes[inner] = [self.lines.mul(value, float(j)) for j, value in enumerate(known)]
        return [(self.slopes[inner], j, factor, k - j) for j in range(1, k + 1)]

    def _coefficient(self, item: Assignment | Integrated, line: Assignment, sums: list[Operand], k: int) -> Operand:
        lines, own = self.lines, self.series[line.target]
        if isinstance(item, Integrated):
            total: Operand = 0.0
            for (sign, _, _), term in zip(item.terms, sums, strict=True):
                total = lines.add(total, term) if sign > 0 else lines.sub(total, term)
            return _over(lines, total, k, self.faithful)
        a, *rest = (self.of(arg) for arg in line.args)
        match line.op:
            case "add":
                return lines.add(_at(a, k), _at(rest[0], k))
            case "sub":
                return lines.sub(_at(a, k), _at(rest[0], k))
            case "neg":
                return lines.neg(_at(a, k))
            case "mul":
                return self._product(a, rest[0], sums, k)
            case "div":
                return lines.mul(lines.sub(_at(a, k), sums[0] if sums else 0.0), self._inverse(rest[0][0]))
            case "sqrt":
                known = self._doubled(sums[0], own, k, k // 2 > 0)
                return lines.mul(lines.sub(_at(a, k), known), self._inverse(lines.mul(own[0], 2.0)))
            case "abs":
                return lines.mul(lines.op("sign", a[0]), _at(a, k))
            case "min" | "max":
                b = rest[0]
                first = (a[0], b[0]) if line.op == "min" else (b[0], a[0])
                return lines.op("select", lines.op("less_equal", *first), _at(a, k), _at(b, k))
            case "select":
                return lines.op("select", a[0], _at(rest[0], k), _at(rest[1], k))
            case _:  # sign, floor and comparisons are constant between their jumps
                return 0.0

    def _product(self, a: Series, b: Series, sums: list[Operand], k: int) -> Operand:
        if not sums:
            return self.lines.mul(_at(a, k), b[0]) if len(b) == 1 else self.lines.mul(a[0], _at(b, k))
        return self._doubled(sums[0], a, k, True) if a is b else sums[0]

    def _doubled(self, half_sum: Operand, a: Series, k: int, middle: bool) -> Operand:
        """Return twice a sum over pairs, and the square of the middle coefficient where there is one."""
        half = _at(a, k // 2) if middle and k % 2 == 0 else 0.0
        return self.lines.fma(half, half, self.lines.mul(half_sum, 2.0))

    def _inverse(self, a: Operand) -> Operand:
        return self.lines.op("div", 1.0, a) if isinstance(a, str) else 1.0 / a


def _loads(recurrences: Recurrences) -> tuple[Load, ...]:
    """Return loads of everything the kernel reads, and of every component of the state."""
    others = tuple(load for load in recurrences.kernel.loads if load.array != "y")
    return tuple(Load(state, "y", i) for i, state in enumerate(recurrences.states)) + others


def step_kernel(recurrences: Recurrences, order: int, *, dense: bool) -> Kernel:
    """Return one Taylor step as a kernel of the arguments `STEP_ARGUMENTS`.

    Its outputs are the new state (n_y), the size of the step, a zero that is NaN where the new state is not finite,
    and, where `dense`, the coefficients of orders 0 to `order` of each component in turn, in powers of the signed time.
    """
    expansion = _Expansion(recurrences, order)
    for k in range(order):
        expansion.extend(k)
    lines = expansion.lines
    rates = [expansion.of(rate) for rate in recurrences.rates]
    outputs = _finish(lines, recurrences, rates, order)
    if dense:
        outputs += [a for state in recurrences.states for a in expansion.series[state]]
    settings = tuple(Load(name, "s", i) for i, name in enumerate(_SETTINGS))
    kernel = Kernel("step", STEP_ARGUMENTS, (*_loads(recurrences), *settings), tuple(lines.body), tuple(outputs))
    return run(kernel, [eliminate_dead_code])


_TURNS = 4.0 * math.pi

_SETTINGS = ("largest_", "direction_", "floor_")


def _finish(lines: Lines, recurrences: Recurrences, rates: list[Series], order: int) -> list[Operand]:
    """Return the new state, the size of the step and the check, from the series of the rates."""
    largest, direction, floor = _SETTINGS
    size = lines.op("min", _radius(lines, recurrences, rates, order, floor), largest)
    weights = _weights(lines, lines.op("mul", size, direction), order)
    new: list[Operand] = []
    check: Operand = 0.0
    for state, rate in zip(recurrences.states, rates, strict=True):
        total: Operand = 0.0
        for k in range(order - 1, -1, -1):
            total = lines.fma(weights[k], _at(rate, k), total)
        new.append(lines.add(state, total))
        check = lines.op("fma", new[-1], 0.0, check)
    return [*new, size, check]


def controlled(recurrences: Recurrences, rates: list[list[str]], order: int) -> tuple[list[Assignment], list[Operand]]:
    """Return the end of a step whose series are already known: lines, and the outputs of `step_kernel` without dense.

    `rates` names the coefficients 0 to order - 1 of each rate.
    """
    lines = Lines()
    outputs = _finish(lines, recurrences, [list(rate) for rate in rates], order)
    return lines.body, outputs


def series_kernel(recurrences: Recurrences, order: int) -> Kernel:
    """Return the series alone: coefficients of orders 0 to `order` of each component of the state in turn."""
    expansion = _Expansion(recurrences, order)
    for k in range(order):
        expansion.extend(k)
    outputs = [a for state in recurrences.states for a in expansion.series[state]]
    kernel = Kernel("series", ("t", "y", "c"), _loads(recurrences), tuple(expansion.lines.body), tuple(outputs))
    return run(kernel, [eliminate_dead_code])


def _weights(lines: Lines, h: Operand, order: int) -> list[Operand]:
    """Return h**(k+1) / (k+1), by which coefficient k of a rate moves the state."""
    powers: list[Operand] = [h]
    for k in range(2, order + 1):
        powers.append(lines.op("mul", powers[(k - 1) // 2], powers[k // 2 - 1]))
    return [_over(lines, power, k + 1, order >= FAITHFUL_ORDER) for k, power in enumerate(powers)]


def _radius(lines: Lines, recurrences: Recurrences, rates: list[Series], order: int, floor: Operand) -> Operand:
    """Return the step that the last two coefficients of the state allow, read off those of its rate.

    The scale is the largest component that anything depends on, but at least the floor; quadratures count in
    the error and not in the scale, and an angle counts as two turns at most, however often it has gone round.
    """
    used = {arg for item in recurrences.items for arg in (item.value if isinstance(item, Integrated) else item).args}
    used |= set(recurrences.rates)
    scale: list[Operand] = [state for state in recurrences.states if state in used] or list(recurrences.states)
    angles = [state for state in scale if state in recurrences.angles]
    largest = _norm(lines, [state for state in scale if state not in recurrences.angles], floor)
    if angles:
        largest = lines.op(
            "max", largest, lines.op("min", _norm(lines, angles[1:], lines.op("abs", angles[0])), _TURNS)
        )
    size = lines.op("rough_log2", largest)
    steps = []
    for k in (order - 1, order):
        norm = lines.op("rough_log2", _norm(lines, [_at(rate, k - 1) for rate in rates], 1e-300))
        gap = lines.op("add", lines.op("sub", size, norm), math.log2(k))
        steps.append(lines.mul(gap, 1.0 / k))
    safety = (-2.0 - 0.7 / (order - 1)) / math.log(2.0)
    return lines.op("rough_exp2", lines.op("add", lines.op("min", *steps), safety))


def _norm(lines: Lines, values: Sequence[Operand], least: Operand) -> Operand:
    total = least
    for value in values:
        if value != 0.0:
            total = lines.op("max", total, lines.op("abs", value) if isinstance(value, str) else abs(value))
    return total
