"""Bounds and signs of expressions over a whole step, as kernels for many lanes: [Kernel] -> [Kernel].

These are the first tests of `dalembert.events.event_search` and `dalembert.events.step_reductions`, as
straight-line code. Most steps pass these cheap tests; the others are examined one by one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import final

from ..arrays import FloatArray
from ..frozen import frozen
from ..ir.kernel import Kernel, Lines, Load, Operand
from ..methods.chebyshev import (
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

_ARGUMENTS = ("t", "y", "c", "s")

_SURE = 1.0 - 1e-6
"""Share of an expression that may be taken away before its sign is unknown: one that is zero at the end of a motion may
seem to keep its sign by rounding errors, and an event at that time would be missed."""


@final
@frozen
class StepShape:
    """Places of the size and the polynomials among the outputs of a step; the state at its end comes first.

    ``in_time`` says whether the polynomials, of a ``degree``, are in time, and not in the fraction of the step.
    """

    degree: int
    size: int
    first: int
    in_time: bool


def are_polynomials(values: Kernel, shape: StepShape) -> bool:
    """Return whether all are polynomials over a step, whose terms fall off fast: affine, by Taylor steps."""
    return not values.outputs or (shape.in_time and None not in _over_step(values, shape)[2])


def polynomial_signs_kernel(values: Kernel, shape: StepShape) -> Kernel:
    """Return the kernel of a step's outputs that gives 1 or -1 for expressions of one sign over the step, else 0.

    `values` are the expressions, from time, state and constants; they have to be polynomials over the step.
    """
    return _of_polynomials("step_signs", values, shape, lambda lines, terms: [_sign_of_polynomial(lines, terms)])


def polynomial_bounds_kernel(values: Kernel, shape: StepShape) -> Kernel:
    """Return the kernel of a step's outputs with what `point_bounds_kernel` gives, of polynomials over the step."""
    return _of_polynomials("step_bounds", values, shape, _running_of_polynomial)


def step_points_kernel(components: set[int], shape: StepShape, size: int) -> Kernel:
    """Return the kernel of a step's outputs that gives its points: for each the time, then the state (size,).

    Only these components of the state are computed.
    """
    lines, loads, series, h = _polynomials(components, shape)
    outputs: list[Operand] = []
    for theta in map(float, POINTS):
        outputs += [lines.fma(h, theta, "t_"), *_state_at(lines, series, theta, size)]
    return STEP_PASSES(Kernel("step_points", _ARGUMENTS, tuple(loads), tuple(lines.body), tuple(outputs)))


def point_signs_kernel(count: int, oscillating: bool) -> Kernel:
    """Return the kernel that gives the results of `polynomial_signs_kernel` from expressions (count,) at each point.

    If they may be `oscillating` between the points, their series must converge.
    """

    def sign(lines: Lines, row: list[Operand]) -> list[Operand]:
        return [_sign(lines, _series(lines, COEFFICIENTS, row), oscillating)]

    return _at_points("point_signs", count, sign)


def point_bounds_kernel(count: int, oscillating: bool) -> Kernel:
    """Return the kernel that tests expressions for `dalembert.events.reductions`, from their values at each point.

    For each: its mean over the step, 1 if that is as good as it can be, a lower and an upper bound, its values at the
    ends, and 1 if it is monotone. `oscillating` is that of `point_signs_kernel`.
    """
    return _at_points("point_bounds", count, lambda lines, row: _running(lines, row, oscillating))


def series_signs_kernel(count: int, size: int, degree: int) -> Kernel:
    """Return the kernel of a step's outputs with the results of `step_signs_kernel`, from series of the expressions.

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
    scales = [lines.mul(power, float(k + 1)) for k, power in enumerate(_powers(lines, h, degree))]
    outputs: list[Operand] = []
    for e in range(count):
        names = [f"a_{e}_{k}_" for k in range(1, degree + 1)]
        loads += [Load(name, "y", first + e * (degree + 1) + k) for k, name in enumerate(names, 1)]
        terms = [lines.mul(name, scale) for name, scale in zip(names, scales, strict=True)]
        tail = lines.add(lines.op("abs", terms[-1]), lines.op("abs", terms[-2]))
        outputs.append(_sign_of_polynomial(lines, terms, lines.mul(tail, TAIL)))
    kernel = Kernel("series_signs", _ARGUMENTS, tuple(loads), tuple(lines.body), tuple(outputs))
    return STEP_PASSES(kernel)


Finish = Callable[[Lines, list[Operand]], list[Operand]]


def _at_points(name: str, count: int, finish: Finish) -> Kernel:
    """Return a kernel of expressions (count,) at each point of a step."""
    lines = Lines()
    names = [[f"value_{point}_{e}_" for e in range(count)] for point in range(len(POINTS))]
    loads = [Load(name, "y", place) for place, name in enumerate(name for row in names for name in row)]
    outputs = [output for row in zip(*names, strict=True) for output in finish(lines, list(row))]
    return STEP_PASSES(Kernel(name, _ARGUMENTS, tuple(loads), tuple(lines.body), tuple(outputs)))


def _of_polynomials(name: str, values: Kernel, shape: StepShape, finish: Finish) -> Kernel:
    """Return a kernel of a step's outputs, from the coefficients of expressions."""
    lines, loads, polynomials = _over_step(values, shape)
    outputs = [output for terms in polynomials if terms is not None for output in finish(lines, terms)]
    return STEP_PASSES(Kernel(name, _ARGUMENTS, tuple(loads), tuple(lines.body), tuple(outputs)))


def _over_step(values: Kernel, shape: StepShape) -> tuple[Lines, list[Load], list[list[Operand] | None]]:
    """Return lines and loads of expressions over a step, and their coefficients; None for those not affine."""
    lines, loads, series, h = _polynomials(components_of(values), shape)
    constants = sorted({load.index or 0 for load in values.loads if load.array == "c"})
    loads += [Load(f"c_{index}_", "c", index) for index in constants]
    return lines, loads, _affine(lines, values, series, h)


def components_of(kernel: Kernel) -> set[int]:
    """Return which components of the state a kernel reads."""
    return {load.index or 0 for load in kernel.loads if load.array == "y"}


def _polynomials(components: set[int], shape: StepShape) -> tuple[Lines, list[Load], dict[int, list[Operand]], Operand]:
    """Return lines and loads of the polynomials of components of the state, these, and the signed step."""
    lines = Lines()
    loads = [Load("t_", "t", None), Load("size_", "y", shape.size), Load("direction_", "s", 1)]
    series: dict[int, list[Operand]] = {}
    h = lines.mul("size_", "direction_")
    for m in sorted(components):
        names = [f"a_{m}_{k}_" for k in range(shape.degree + 1)]
        loads += [Load(name, "y", shape.first + m * (shape.degree + 1) + k) for k, name in enumerate(names)]
        loads.append(Load(f"end_{m}_", "y", m))
        series[m] = _ended_in_state(lines, list(names), h if shape.in_time else 1.0, f"end_{m}_")
    return lines, loads, series, h


def _affine(lines: Lines, values: Kernel, series: dict[int, list[Operand]], h: Operand) -> list[list[Operand] | None]:
    """Return the coefficients of expressions in the fraction of the step; None for one not affine in time and state.

    Constants have one coefficient.
    """
    known: dict[Operand, list[Operand] | None] = {}
    for load in values.loads:
        index = load.index or 0
        constant: list[Operand] = [f"c_{index}_"]
        known[load.target] = ["t_", h] if load.array == "t" else series[index] if load.array == "y" else constant
    for line in values.body:
        given = [known[arg] if isinstance(arg, str) else list[Operand]((arg,)) for arg in line.args]
        args = [arg for arg in given if arg is not None]
        known[line.target] = _combined(lines, line.op, args) if len(args) == len(given) else None
    return [known[output] if isinstance(output, str) else [output] for output in values.outputs]


def _combined(lines: Lines, op: str, args: list[list[Operand]]) -> list[Operand] | None:
    """Return the coefficients of an operation on polynomials, None if it is not affine."""
    if all(len(arg) == 1 for arg in args):
        return [lines.op(op, *(arg[0] for arg in args))]
    if op == "neg":
        return [lines.neg(term) for term in args[0]]
    if op in ("mul", "fma"):
        one, other = sorted(args[:2], key=len)
        if len(one) > 1:
            return None
        product = [lines.mul(term, one[0]) for term in other]
        return product if op == "mul" else _combined(lines, "add", [product, args[2]])
    if op == "div" and len(args[1]) == 1:
        inverse = lines.op("div", 1.0, args[1][0])
        return [lines.mul(term, inverse) for term in args[0]]
    if op not in ("add", "sub"):
        return None
    size = max(map(len, args))
    a, b = ([*arg, *[0.0] * (size - len(arg))] for arg in args)
    return [(lines.add if op == "add" else lines.sub)(x, y) for x, y in zip(a, b, strict=True)]


def _state_at(lines: Lines, series: dict[int, list[Operand]], theta: float, size: int) -> list[Operand]:
    """Return the state (size,) at a fraction of the step, 0 for components without polynomials."""
    state: list[Operand] = [0.0] * size
    for m, terms in series.items():
        total = terms[-1]
        for term in terms[-2::-1]:
            total = lines.fma(total, theta, term)
        state[m] = total
    return state


def _ended_in_state(lines: Lines, terms: list[Operand], scale: Operand, end: Operand) -> list[Operand]:
    """Return coefficients in the fraction of the step, made to end in the state that it ended in."""
    scaled = [lines.mul(term, power) for term, power in zip(terms, _powers(lines, scale, len(terms)), strict=True)]
    gap = lines.sub(end, _sum(lines, scaled))
    scaled[2] = lines.fma(gap, 3.0, scaled[2])
    scaled[3] = lines.fma(gap, -2.0, scaled[3])
    return scaled


def _powers(lines: Lines, base: Operand, count: int) -> list[Operand]:
    """Return the powers of a value from 0 on, each as the product of two smaller ones by halves."""
    powers: list[Operand] = [1.0, base]
    for k in range(2, count):
        powers.append(lines.mul(powers[k // 2], powers[k - k // 2]))
    return powers[:count]


def _series(lines: Lines, matrix: FloatArray, values: list[Operand]) -> list[Operand]:
    series: list[Operand] = []
    for row in matrix:
        total: Operand = 0.0
        for weight, value in zip(map(float, row), values, strict=True):
            total = lines.fma(value, weight, total)
        series.append(total)
    return series


def _sizes(lines: Lines, series: list[Operand]) -> list[Operand]:
    return [lines.op("abs", term) for term in series]


def _sum(lines: Lines, values: list[Operand]) -> Operand:
    """Return a sum by halves: sums one after the other would wait for each other."""
    if len(values) < 2:
        return values[0] if values else 0.0
    return lines.add(_sum(lines, values[: len(values) // 2]), _sum(lines, values[len(values) // 2 :]))


def _converges(lines: Lines, sizes: list[Operand]) -> Operand:
    """Return 1 if a series with coefficients of these sizes shows no oscillation between the points."""
    tail = lines.add(sizes[-1], sizes[-2])
    return lines.op("less_equal", tail, lines.mul(_sum(lines, sizes[1:]), CONVERGED))


def _sign(lines: Lines, series: list[Operand], oscillating: bool) -> Operand:
    """Return the sign of a function with this series, 0 where it may change."""
    sizes = _sizes(lines, series)
    rest = _sum(lines, [lines.mul(lines.add(sizes[-1], sizes[-2]), TAIL), *sizes[1:]])
    if oscillating:
        rest = lines.op("select", _converges(lines, sizes), rest, lines.mul(rest, UNSEEN))
    sign = lines.op("select", lines.op("less", 0.0, series[0]), 1.0, -1.0)
    return lines.op("select", lines.op("less", rest, lines.mul(sizes[0], _SURE)), sign, 0.0)


def _sign_of_polynomial(lines: Lines, terms: list[Operand], missing: Operand = 0.0) -> Operand:
    """Return the sign of a polynomial over the step, 0 where it may change; `missing` is what it may leave out.

    The least that it can be is its first coefficient and what the others can take away, for powers of fractions lie
    between 0 and 1.
    """
    sign = lines.op("select", lines.op("less", 0.0, terms[0]), 1.0, -1.0)
    taken = _sum(lines, [lines.op("min", lines.mul(term, sign), 0.0) for term in terms[1:]])
    least = lines.add(lines.sub(lines.mul(lines.op("abs", terms[0]), _SURE), missing), taken)
    return lines.op("select", lines.op("less", 0.0, least), sign, 0.0)


def _running_of_polynomial(lines: Lines, terms: list[Operand]) -> list[Operand]:
    """Return the outputs of `step_bounds_kernel` of an expression that is a polynomial; its mean is exact."""
    rest = terms[1:]
    mean = lines.add(terms[0], _sum(lines, [lines.mul(term, 1.0 / (k + 2)) for k, term in enumerate(rest)]))
    bounds = [
        lines.add(terms[0], _sum(lines, [lines.op(which, term, 0.0) for term in rest])) for which in ("min", "max")
    ]
    falls = _sum(lines, [lines.mul(lines.op("abs", term), k + 2.0) for k, term in enumerate(rest[1:])])
    monotone = lines.op("less", falls, lines.op("abs", rest[0])) if rest else 1.0
    return [mean, 1.0, *bounds, terms[0], lines.add(terms[0], _sum(lines, rest)), monotone]


def _running(lines: Lines, values: list[Operand], oscillating: bool) -> list[Operand]:
    series, slopes = _series(lines, COEFFICIENTS, values), _series(lines, SLOPES, values)
    sizes, falls = _sizes(lines, series), _sizes(lines, slopes)
    tail = lines.add(sizes[-1], sizes[-2])
    mean: Operand = 0.0
    for weight, term in zip(map(float, INTEGRAL), series, strict=True):
        mean = lines.fma(term, weight, mean)
    size, before = _sum(lines, sizes), lines.add(sizes[4], sizes[5])
    smooth = lines.op("less_equal", lines.mul(tail, tail), lines.mul(lines.mul(size, before), SMOOTH))
    smooth = lines.op("max", smooth, lines.op("less_equal", tail, lines.mul(size, NEGLIGIBLE)))
    reach = lines.fma(tail, TAIL, _sum(lines, sizes[1:]))
    monotone = lines.op("less", lines.fma(tail, SLOPE_TAIL, _sum(lines, falls[1:])), falls[0])
    if oscillating:
        converges = _converges(lines, sizes)
        reach = lines.op("select", converges, reach, lines.mul(reach, UNSEEN))
        monotone = lines.op("min", monotone, converges)
    bounds = [lines.sub(series[0], reach), lines.add(series[0], reach)]
    return [mean, smooth, *bounds, values[0], values[-1], monotone]
