"""Parts of an adaptive Runge-Kutta step as straight-line code: all but the evaluations of the right-hand side.

An attempt tests the error of its stages, keeps the old state where it is too large, and proposes the size of the next
attempt by the proportional-integral control of `dalembert.methods.step_constants`. Its memory is part of the state: the
outputs of an attempt are the argument ``y`` of the next one. Nothing branches, so the same code serves lanes that
accept and lanes that reject.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import final

import numpy as np

from ..ir.kernel import Kernel, Lines, Load, Operand
from ..methods import step_constants as gains
from ..methods.tableau import Tableau

SETTINGS = ("largest step", "direction of time", "rtol", "atol")
"""Entries of the argument s; atol once for each component of the state, where each has its own."""

CONTROL = ("size of the next attempt", "log2 of the previous error", "largest growth")
"""Outputs behind state, size and check; behind them come the slopes of the state, where they are carried."""

CONTROLS = len(CONTROL)
PROPOSAL_AT, GROWTH_AT = 2, 4
"""Places of the first and the last of `CONTROL`, counted from that of the size of the step."""

_LARGEST, _DIRECTION, _RTOL, _ATOL = _SETTINGS = ("largest_", "direction_", "rtol_", "atol_")
_PROPOSAL, _PREVIOUS, _GROWTH = _CONTROL = ("proposal_", "previous_", "growth_")
_HUGE = 1.7976931348623157e308
_LOG2_PREVIOUS = math.log2(gains.SMALLEST_PREVIOUS)

Vector = list[Operand]
Slopes = Callable[[Operand, Vector], Vector]


def memory_size(n: int, carried: bool) -> int:
    """Return the number of outputs of an attempt between its check and its polynomials."""
    return len(CONTROL) + (n if carried else 0)


class Parts(ABC):
    """The parts of a step that are not evaluations of the right-hand side."""

    def __init__(self, rhs: Kernel, *, weighted: bool) -> None:
        self.lines, self.n = Lines(), len(rhs.outputs)
        self.y: Vector = names_of("y", self.n)
        self.slopes: dict[int, Vector] = {}
        self.atol: Vector = names_of("atol", self.n) if weighted else [_ATOL] * self.n
        self.loads: tuple[Load, ...] = (
            Load("t_", "t", None),
            *loads_of(self.y, "y", 0),
            *loads_of((*_SETTINGS[:3], *(self.atol if weighted else [_ATOL])), "s", 0),
        )

    @abstractmethod
    def stages(self) -> tuple[int, ...]:
        """Return the stages that must be evaluated."""

    @abstractmethod
    def time(self, stage: int) -> Operand:
        """Return the time of a stage."""

    @abstractmethod
    def point(self, stage: int) -> Vector:
        """Return the state at which a stage is evaluated."""

    @abstractmethod
    def outputs(self) -> Vector:
        """Return the outputs, once all slopes are known."""


@final
class Start(Parts):
    """The choice of the first step, from the slopes at the initial state and after a small explicit Euler step."""

    def __init__(self, rhs: Kernel, tableau: Tableau, *, carried: bool, weighted: bool = False) -> None:
        super().__init__(rhs, weighted=weighted)
        self.exponent, self.carried = 1.0 / (tableau.error_order + 1), carried
        sizes = [self.lines.op("abs", component) for component in self.y]
        scale = [self.lines.fma(_RTOL, size, atol) for size, atol in zip(sizes, self.atol, strict=True)]
        self.weights = [self.lines.op("div", 1.0, value) for value in scale]

    def stages(self) -> tuple[int, ...]:
        """See `Parts.stages`."""
        return (0, 1)

    def time(self, stage: int) -> Operand:
        """See `Parts.time`."""
        return self.lines.add("t_", self.lines.mul(self._trial(), _DIRECTION)) if stage else "t_"

    def point(self, stage: int) -> Vector:
        """See `Parts.point`."""
        if stage == 0:
            return self.y
        h = self.lines.mul(self._trial(), _DIRECTION)
        return [self.lines.fma(h, rate, y) for rate, y in zip(self.slopes[0], self.y, strict=True)]

    def _norm(self, values: Vector) -> Operand:
        total: Operand = 0.0
        for value, weight in zip(values, self.weights, strict=True):
            scaled = self.lines.mul(value, weight)
            total = self.lines.fma(scaled, scaled, total)
        return self.lines.op("sqrt", self.lines.mul(total, 1.0 / self.n))

    def _trial(self) -> Operand:
        """Return the size of the Euler step."""
        lines, size, slope = self.lines, self._norm(self.y), self._norm(self.slopes[0])
        flat = lines.op("less", lines.op("min", size, slope), gains.FIRST_NEGLIGIBLE)
        share = lines.op("div", lines.mul(size, gains.FIRST_SHARE), lines.op("max", slope, gains.FIRST_NEGLIGIBLE))
        return lines.op("min", lines.op("select", flat, gains.FIRST_BLIND, share), _LARGEST)

    def outputs(self) -> Vector:
        """See `Parts.outputs`."""
        lines, h, slope = self.lines, self._trial(), self._norm(self.slopes[0])
        change = self._norm([lines.sub(b, a) for a, b in zip(self.slopes[0], self.slopes[1], strict=True)])
        curvature = lines.op("div", change, h)
        largest = lines.op("max", lines.op("max", slope, curvature), gains.FIRST_SLOPE)
        power = lines.mul(lines.op("sub", math.log2(gains.FIRST_SHARE), lines.op("rough_log2", largest)), self.exponent)
        improved = lines.op("min", lines.mul(h, gains.FIRST_GROWTH), lines.op("rough_exp2", power))
        h = lines.op("select", _finite(lines, curvature), lines.op("min", improved, _LARGEST), h)
        h = lines.op("select", _finite(lines, slope), h, 0.0)
        return [*self.y, 0.0, 0.0, h, _LOG2_PREVIOUS, gains.LARGEST_GROWTH, *(self.slopes[0] if self.carried else [])]


@final
class Attempt(Parts):
    """The error, the control and the dense output of an attempt, around its stages."""

    def __init__(
        self,
        rhs: Kernel,
        tableau: Tableau,
        *,
        carried: bool,
        dense: bool,
        knots: Kernel | tuple[str, str] | None = None,
        weighted: bool = False,
    ) -> None:
        super().__init__(rhs, weighted=weighted)
        self.tableau, self.carried, self.dense = tableau, carried, dense
        self.unlimited: Operand = 0.0
        self.loads += loads_of(_CONTROL, "y", self.n + 2)
        if carried:
            self.slopes[0] = names_of("k_first", self.n)
            self.loads += loads_of(self.slopes[0], "y", self.n + 2 + len(CONTROL))
        lines = self.lines
        least = lines.mul(lines.op("abs", "t_"), gains.SMALLEST_OF_TIME)
        proposed = lines.op("max", _PROPOSAL, least)
        ends = lines.op("less_equal", _LARGEST, lines.mul(proposed, gains.STRETCH))
        self.size = lines.op("select", ends, _LARGEST, proposed)
        if knots is not None:
            self._end_at_knot(knots, least)
        self.h = lines.mul(self.size, _DIRECTION)
        self._points: dict[int, Vector] = {}

    def _end_at_knot(self, knots: Kernel | tuple[str, str], least: Operand) -> None:
        """End the step at a knot of a table; `unlimited` is the proposed size, 0 where no knot shortens the step."""
        lines = self.lines
        forward, backward = inlined(lines, knots)("t_", self.y) if isinstance(knots, Kernel) else knots
        limit = lines.op("select", lines.op("less", _DIRECTION, 0.0), backward, forward)
        limit = lines.op("max", limit, lines.mul(least, 4.0))
        cut = lines.op("less", limit, self.size)
        self.unlimited = lines.op("select", cut, _PROPOSAL, 0.0)
        self.size = lines.op("select", cut, limit, self.size)

    def stages(self) -> tuple[int, ...]:
        """See `Parts.stages`."""
        tableau = self.tableau
        first = () if self.carried else (0,)
        all_stages = self.dense or tableau.bounded
        end = (tableau.end,) if self.carried or all_stages or tableau.fsal else ()
        extra = range(tableau.end + 1, tableau.n_total) if all_stages else ()
        return (*first, *range(1, tableau.end), *end, *extra)

    def time(self, stage: int) -> Operand:
        """See `Parts.time`."""
        node = float(self.tableau.c[stage])
        if node in (0.0, 1.0):
            return self.lines.add("t_", self.h) if node else "t_"
        return self.lines.fma(node, self.h, "t_")

    def point(self, stage: int) -> Vector:
        """See `Parts.point`."""
        if stage not in self._points:
            sums = self._sums(self.tableau.A[stage])
            self._points[stage] = [self.lines.fma(self.h, total, y) for total, y in zip(sums, self.y, strict=True)]
        return self._points[stage]

    def _sums(self, weights: Sequence[float]) -> Vector:
        sums: Vector = [0.0] * self.n
        for stage, weight in enumerate(map(float, weights)):
            if weight != 0.0:
                pairs = zip(self.slopes[stage], sums, strict=True)
                sums = [self.lines.fma(slope, weight, total) for slope, total in pairs]
        return sums

    def outputs(self) -> Vector:
        """See `Parts.outputs`."""
        lines, new = self.lines, self.point(self.tableau.end)
        last = self.slopes[self.tableau.end] if self.carried else []
        square = self._error_square(new)
        for value in (*new, *last):
            square = lines.op("fma", value, 0.0, square)
        # Both tests are false for an infinite square, and for one that is not a number.
        accepted = lines.op("less_equal", square, 1.0)
        finite = lines.op("less_equal", square, _HUGE)

        def kept(value: Operand, old: Operand) -> Operand:
            return lines.op("select", accepted, value, old)

        proposal, error = self._proposal(square, accepted, finite)
        if self.unlimited != 0.0:
            proposal = kept(lines.op("max", proposal, self.unlimited), proposal)
        previous = kept(lines.op("max", error, _LOG2_PREVIOUS), _PREVIOUS)
        control = [proposal, previous, kept(gains.LARGEST_GROWTH, 1.0)]
        results = [kept(value, old) for value, old in zip(new, self.y, strict=True)]
        results += [kept(self.size, 0.0), lines.op("select", finite, 0.0, 1.0), *control]
        results += [kept(slope, old) for slope, old in zip(last, self.slopes[0], strict=False)]
        return results + (self._polynomials() if self.dense else [])

    def _error_square(self, new: Vector) -> Operand:
        """Return the square of the RMS norm of the error over the tolerances (see `Tableau.error`).

        Where that is `bounded`, the square is at least that of the dense output over `POLYNOMIAL_ERROR`.
        """
        lines, tableau = self.lines, self.tableau
        rows = [*tableau.error, *([tableau.between / gains.POLYNOMIAL_ERROR] if tableau.bounded else [])]
        estimates = [self._sums(row) for row in rows]
        totals: Vector = [0.0] * len(estimates)
        for i in range(self.n):
            larger = lines.op("max", lines.op("abs", self.y[i]), lines.op("abs", new[i]))
            scale = lines.op("div", 1.0, lines.fma(_RTOL, larger, self.atol[i]))
            for row, estimate in enumerate(estimates):
                scaled = lines.mul(estimate[i], scale)
                totals[row] = lines.fma(scaled, scaled, totals[row])
        square = lines.mul(lines.mul(self.size, self.size), 1.0 / self.n)
        total = totals[0]
        if len(tableau.error) == 2:
            below = lines.add(lines.fma(totals[1], gains.SECOND_ERROR_WEIGHT, total), gains.SMALLEST_NORMAL)
            total = lines.mul(lines.op("div", total, below), total)
        if tableau.bounded:  # NaN where either is
            total = lines.op("fma", totals[-1], 0.0, lines.op("max", totals[-1], total))
        return lines.mul(total, square)

    def _proposal(self, square: Operand, accepted: Operand, finite: Operand) -> tuple[Operand, Operand]:
        """Return the size of the next attempt and the logarithm of the error."""
        lines = self.lines
        exponent = 1.0 / (self.tableau.error_order + 1)
        beta = gains.INTEGRAL * exponent
        alpha = exponent - gains.PROPORTIONAL * beta
        error = lines.mul(lines.op("rough_log2", square), 0.5)
        power = lines.fma(error, -alpha, lines.mul(_PREVIOUS, beta))
        power = lines.op("select", accepted, power, lines.mul(error, -exponent))
        factor = lines.mul(lines.op("rough_exp2", power), gains.SAFETY)
        factor = lines.op("max", lines.op("min", factor, _GROWTH), gains.LARGEST_REDUCTION)
        return lines.mul(self.size, lines.op("select", finite, factor, gains.REDUCTION_BLIND)), error

    def _polynomials(self) -> Vector:
        """Return the dense output, whose end is the new state up to rounding."""
        columns = [self._sums(column) for column in np.asarray(self.tableau.P).T]
        scaled = [[self.lines.mul(value, self.h) for value in column] for column in columns]
        return [value for i in range(self.n) for value in (self.y[i], *(column[i] for column in scaled))]


def names_of(stem: str, n: int) -> Vector:
    """Return the names of so many values."""
    return [f"{stem}_{i}_" for i in range(n)]


def loads_of(names: Sequence[Operand], array: str, first: int) -> tuple[Load, ...]:
    """Return loads of consecutive entries of an array, from the `first` on."""
    return tuple(Load(str(name), array, first + i) for i, name in enumerate(names))


def _finite(lines: Lines, value: Operand) -> Operand:
    """Return 1 where a nonnegative value is finite."""
    return lines.op("less_equal", value, _HUGE)


def inlined(lines: Lines, rhs: Kernel) -> Slopes:
    """Return a function that writes the right-hand side into `lines` and gives its outputs."""

    def evaluate(t: Operand, y: Vector) -> Vector:
        values: dict[str, Operand] = {}
        for load in rhs.loads:
            index = load.index or 0
            values[load.target] = t if load.array == "t" else y[index] if load.array == "y" else f"c_{index}_"
        for line in rhs.body:
            args = (values[arg] if isinstance(arg, str) else arg for arg in line.args)
            values[line.target] = lines.op(line.op, *args)
        return [values[output] if isinstance(output, str) else output for output in rhs.outputs]

    return evaluate
