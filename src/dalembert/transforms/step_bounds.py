"""Bounds and signs of expressions over a whole step, as kernels for many lanes: [Kernel] -> [Kernel].

These are the first tests of `dalembert.events.event_search` and `dalembert.events.step_reductions`, as
straight-line code. Most steps pass these cheap tests; the others are examined one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from ..arrays import FloatArray
from ..ir.kernel import Kernel, Lines, Load, Operand
from ..methods.chebyshev import (
    BOUNDS,
    COEFFICIENTS,
    CONVERGED,
    INTEGRAL,
    NEGLIGIBLE,
    POINTS,
    SLOPE_TAIL,
    SLOPES,
    SMOOTH,
    TAIL,
    UNSEEN,
)
from .pipelines import STEP_PASSES
from .step_polynomials import ARGUMENTS, StepShape, over_step, powers, summed

_SURE = 1.0 - 1e-6
"""Share of an expression that may be taken away before its sign is unknown: one that is zero at the end of a motion may
seem to keep its sign by rounding errors, and an event at that time would be missed."""


def polynomial_signs_kernel(values: Kernel, shape: StepShape) -> Kernel:
    """Return the kernel of a step's outputs that gives 1 or -1 for expressions of one sign over the step, else 0.

    `values` are the expressions, from time, state and constants; they have to be polynomials over the step.
    """
    return _of_polynomials("step_signs", values, shape, [_signs_of_polynomial] * len(values.outputs))


def polynomial_bounds_kernel(values: Kernel, shape: StepShape, kinds: Sequence[str]) -> Kernel:
    """Return the kernel of a step's outputs with what `point_bounds_kernel` gives, of polynomials over the step."""
    return _of_polynomials("step_bounds", values, shape, [partial(_running_of_polynomial, kind) for kind in kinds])


def point_signs_kernel(count: int, oscillating: bool) -> Kernel:
    """Return the kernel that gives the results of `polynomial_signs_kernel` from expressions (count,) at each point.

    If they may be `oscillating` between the points, their series must converge.
    """

    def sign(lines: Lines, row: list[Operand]) -> list[Operand]:
        return [_sign(lines, _series(lines, COEFFICIENTS, row), oscillating)]

    return _at_points("point_signs", [sign] * count)


def point_bounds_kernel(kinds: Sequence[str], oscillating: bool) -> Kernel:
    """Return the kernel that tests expressions for `dalembert.events.reductions`, from their values at each point.

    For each of kind mean: its mean over the step, and 1 if that is as good as it can be, else 0. For a maximum: the
    larger of its values at the ends, and an upper bound, which is that value if the expression is monotone. For a
    minimum, those of the negative expression. `oscillating` is that of `point_signs_kernel`.
    """
    return _at_points("point_bounds", [partial(_running, kind, oscillating) for kind in kinds])


def series_signs_kernel(count: int, size: int, degree: int) -> Kernel:
    """Return the kernel of a step's outputs that gives the results of `polynomial_signs_kernel`, from series.

    Parameters
    ----------
    count : int
        Number of expressions with series.
    size : int
        Place of the size of the step among its outputs; behind its check are polynomials, the last of the integrals.
    degree : int
        Of the polynomials in time.
    """
    lines = Lines()
    loads = [Load("size_", "y", size), Load("direction_", "s", 1)]
    first = size + 2 + (size - count) * (degree + 1)
    h = lines.mul("size_", "direction_")
    scales = [lines.mul(power, float(k + 1)) for k, power in enumerate(powers(lines, h, degree))]
    outputs: list[Operand] = []
    for e in range(count):
        names = [f"a_{e}_{k}_" for k in range(1, degree + 1)]
        loads += [Load(name, "y", first + e * (degree + 1) + k) for k, name in enumerate(names, 1)]
        terms = [lines.mul(name, scale) for name, scale in zip(names, scales, strict=True)]
        tail = lines.add(lines.op("abs", terms[-1]), lines.op("abs", terms[-2]))
        outputs.append(_sign_of_polynomial(lines, terms, lines.mul(tail, TAIL)))
    kernel = Kernel("series_signs", ARGUMENTS, tuple(loads), tuple(lines.body), tuple(outputs))
    return STEP_PASSES(kernel)


def held_kernel(events: int, kinds: Sequence[str]) -> Kernel:
    """Return the kernel that says whether tests decide all expressions over a step, and what reductions are then.

    Of `events`, the rows of its state are the signs that they have to keep, and those of `point_signs_kernel`; of
    reductions of these `kinds`, the results of `point_bounds_kernel`, and what they are at the beginning. Constants
    are the size of the step. Outputs are 1 or 0, and the reductions.
    """
    lines = Lines()
    loads = [Load("t_", "t", None), Load("size_", "c", 0), Load("direction_", "s", 1)]
    names = [f"y_{row}_" for row in range(2 * events + (BOUNDS + 1) * len(kinds))]
    loads += [Load(name, "y", row) for row, name in enumerate(names)]
    keeps: list[Operand] = [
        lines.op("less", 0.0, lines.mul(expected, sign))
        for expected, sign in zip(names[:events], names[events : 2 * events], strict=True)
    ]
    outputs: list[Operand] = []
    end = lines.add("t_", lines.mul("direction_", "size_"))
    for place, kind in enumerate(kinds):
        value, reach = names[2 * events + BOUNDS * place :][:BOUNDS]
        before = names[2 * events + BOUNDS * len(kinds) + place]
        if kind == "mean":
            keeps.append(reach)
            outputs.append(lines.add(before, lines.mul(lines.sub(end, "t_"), value)))
        else:
            best = lines.op("max", before if kind == "maximum" else lines.neg(before), value)
            keeps.append(lines.op("less_equal", reach, best))
            outputs.append(best if kind == "maximum" else lines.neg(best))
    all_keep = keeps[0]
    for each in keeps[1:]:
        all_keep = lines.op("min", all_keep, each)
    return STEP_PASSES(Kernel("held", ARGUMENTS, tuple(loads), tuple(lines.body), (all_keep, *outputs)))


Finish = Callable[[Lines, list[Operand]], list[Operand]]


def _series(lines: Lines, matrix: FloatArray, values: list[Operand]) -> list[Operand]:
    series: list[Operand] = []
    for row in matrix:
        total: Operand = 0.0
        for weight, value in zip(map(float, row), values, strict=True):
            total = lines.fma(value, weight, total)
        series.append(total)
    return series


def _at_points(name: str, finishes: Sequence[Finish]) -> Kernel:
    """Return a kernel of expressions at each point of a step, of which each is finished by its own function."""
    lines = Lines()
    names = [[f"value_{point}_{e}_" for e in range(len(finishes))] for point in range(len(POINTS))]
    loads = [Load(name, "y", place) for place, name in enumerate(name for row in names for name in row)]
    rows = zip(*names, strict=True)
    outputs = [output for finish, row in zip(finishes, rows, strict=True) for output in finish(lines, list(row))]
    return STEP_PASSES(Kernel(name, ARGUMENTS, tuple(loads), tuple(lines.body), tuple(outputs)))


def _of_polynomials(name: str, values: Kernel, shape: StepShape, finishes: Sequence[Finish]) -> Kernel:
    """Return a kernel of a step's outputs, from the coefficients of expressions."""
    lines, loads, polynomials = over_step(values, shape)
    each = zip(finishes, polynomials, strict=True)
    outputs = [output for finish, terms in each if terms is not None for output in finish(lines, terms)]
    return STEP_PASSES(Kernel(name, ARGUMENTS, tuple(loads), tuple(lines.body), tuple(outputs)))


def _converges(lines: Lines, sizes: list[Operand]) -> Operand:
    """Return 1 if a series with coefficients of these sizes shows no oscillation between the points."""
    tail = lines.add(sizes[-1], sizes[-2])
    return lines.op("less_equal", tail, lines.mul(summed(lines, sizes[1:]), CONVERGED))


def _sign(lines: Lines, series: list[Operand], oscillating: bool) -> Operand:
    """Return the sign of a function with this series, 0 where it may change."""
    sizes = [lines.op("abs", term) for term in series]
    rest = summed(lines, [lines.mul(lines.add(sizes[-1], sizes[-2]), TAIL), *sizes[1:]])
    if oscillating:
        rest = lines.op("select", _converges(lines, sizes), rest, lines.mul(rest, UNSEEN))
    sign = lines.op("select", lines.op("less", 0.0, series[0]), 1.0, -1.0)
    return lines.op("select", lines.op("less", rest, lines.mul(sizes[0], _SURE)), sign, 0.0)


def _signs_of_polynomial(lines: Lines, terms: list[Operand]) -> list[Operand]:
    return [_sign_of_polynomial(lines, terms)]


def _sign_of_polynomial(lines: Lines, terms: list[Operand], missing: Operand = 0.0) -> Operand:
    """Return the sign of a polynomial over the step, 0 where it may change; `missing` is what it may leave out.

    The least that it can be is its first coefficient and what the others can take away, for powers of fractions lie
    between 0 and 1.
    """
    sign = lines.op("select", lines.op("less", 0.0, terms[0]), 1.0, -1.0)
    taken = summed(lines, [lines.op("min", lines.mul(term, sign), 0.0) for term in terms[1:]])
    least = lines.add(lines.sub(lines.mul(lines.op("abs", terms[0]), _SURE), missing), taken)
    return lines.op("select", lines.op("less", 0.0, least), sign, 0.0)


def _running_of_polynomial(kind: str, lines: Lines, terms: list[Operand]) -> list[Operand]:
    """Return the outputs of `polynomial_bounds_kernel` of an expression that is a polynomial; its mean is exact."""
    if kind == "mean":
        rest = [lines.mul(term, 1.0 / (k + 2)) for k, term in enumerate(terms[1:])]
        return [lines.add(terms[0], summed(lines, rest)), 1.0]
    first, *rest = terms if kind == "maximum" else [lines.neg(term) for term in terms]
    best = lines.op("max", first, lines.add(first, summed(lines, rest)))
    if not rest:
        return [best, best]
    bound = lines.add(first, summed(lines, [lines.op("max", term, 0.0) for term in rest]))
    falls = summed(lines, [lines.mul(lines.op("abs", term), k + 2.0) for k, term in enumerate(rest[1:])])
    monotone = lines.op("less", falls, lines.op("abs", rest[0]))
    return [best, lines.op("select", monotone, best, bound)]


def _running(kind: str, oscillating: bool, lines: Lines, values: list[Operand]) -> list[Operand]:
    series = _series(lines, COEFFICIENTS, values if kind != "minimum" else [lines.neg(value) for value in values])
    sizes = [lines.op("abs", term) for term in series]
    tail = lines.add(sizes[-1], sizes[-2])
    if kind == "mean":
        mean: Operand = 0.0
        for weight, term in zip(map(float, INTEGRAL), series, strict=True):
            mean = lines.fma(term, weight, mean)
        size, before = summed(lines, sizes), lines.add(sizes[4], sizes[5])
        smooth = lines.op("less_equal", lines.mul(tail, tail), lines.mul(lines.mul(size, before), SMOOTH))
        return [mean, lines.op("max", smooth, lines.op("less_equal", tail, lines.mul(size, NEGLIGIBLE)))]
    falls = [lines.op("abs", term) for term in _series(lines, SLOPES, values)]
    reach = lines.fma(tail, TAIL, summed(lines, sizes[1:]))
    monotone = lines.op("less", lines.fma(tail, SLOPE_TAIL, summed(lines, falls[1:])), falls[0])
    if oscillating:
        converges = _converges(lines, sizes)
        reach = lines.op("select", converges, reach, lines.mul(reach, UNSEEN))
        monotone = lines.op("min", monotone, converges)
    ends = [value if kind == "maximum" else lines.neg(value) for value in (values[0], values[-1])]
    best = lines.op("max", *ends)
    return [best, lines.op("select", monotone, best, lines.add(series[0], reach))]
