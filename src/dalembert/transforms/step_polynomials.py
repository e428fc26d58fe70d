"""Polynomials of expressions over a step, as straight-line code for many lanes: [Kernel] -> lines, or points."""

from __future__ import annotations

from typing import final

from ..frozen import frozen
from ..ir.kernel import Kernel, Lines, Load, Operand
from ..methods.chebyshev import POINTS
from .pipelines import STEP_PASSES

ARGUMENTS = ("t", "y", "c", "s")
"""Of a kernel of a step: time where it begins, outputs of the step, constants, settings."""


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
    return not values.outputs or (shape.in_time and None not in over_step(values, shape)[2])


def step_points_kernel(components: set[int], shape: StepShape, size: int) -> Kernel:
    """Return the kernel of a step's outputs that gives its points: for each the time, then the state (size,).

    Only these components of the state are computed.
    """
    lines, loads, series, h = _polynomials(components, shape)
    outputs: list[Operand] = []
    for theta in map(float, POINTS):
        outputs += [lines.fma(h, theta, "t_"), *_state_at(lines, series, theta, size)]
    return STEP_PASSES(Kernel("step_points", ARGUMENTS, tuple(loads), tuple(lines.body), tuple(outputs)))


def over_step(values: Kernel, shape: StepShape) -> tuple[Lines, list[Load], list[list[Operand] | None]]:
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
    scaled = [lines.mul(term, power) for term, power in zip(terms, powers(lines, scale, len(terms)), strict=True)]
    gap = lines.sub(end, summed(lines, scaled))
    scaled[2] = lines.fma(gap, 3.0, scaled[2])
    scaled[3] = lines.fma(gap, -2.0, scaled[3])
    return scaled


def powers(lines: Lines, base: Operand, count: int) -> list[Operand]:
    """Return the powers of a value from 0 on, each as the product of two smaller ones by halves."""
    powers: list[Operand] = [1.0, base]
    for k in range(2, count):
        powers.append(lines.mul(powers[k // 2], powers[k - k // 2]))
    return powers[:count]


def summed(lines: Lines, values: list[Operand]) -> Operand:
    """Return a sum by halves: sums one after the other would wait for each other."""
    if len(values) < 2:
        return values[0] if values else 0.0
    return lines.add(summed(lines, values[: len(values) // 2]), summed(lines, values[len(values) // 2 :]))
