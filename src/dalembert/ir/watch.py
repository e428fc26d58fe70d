"""[Kernel] -> [Kernel]: whether watched expressions keep their sign all over a step, for many cases side by side.

This is the first test of `dalembert.integrators.crossings` as straight-line code. Most steps pass it, and cost next to
nothing; the others are looked at one by one.
"""

from __future__ import annotations

from ..integrators.crossings import COEFFICIENTS, POINTS, TAIL
from .lines import Lines
from .passes import eliminate_dead_code, run
from .program import Kernel, Load, Operand
from .runge_kutta import inlined

__all__ = ["quiet_kernel"]

_ARGUMENTS = ("t", "y", "c", "s")


def quiet_kernel(values: Kernel, degree: int, size: int, first: int, *, in_time: bool) -> Kernel:
    """Return the kernel of a step's outputs that gives 1 or -1 for expressions of that sign all over it, 0 for others.

    Parameters
    ----------
    values
        The expressions, from time, state and constants.
    degree
        Of the polynomials of a step.
    size, first
        Where the outputs of a step hold its size, and its polynomials; the state at its end comes first.
    in_time
        Whether the polynomials are in time, and not in the fraction of the step.
    """
    lines = Lines()
    used = sorted({load.index or 0 for load in values.loads if load.array == "y"})
    loads = [Load("t_", "t", None), Load("size_", "y", size), Load("direction_", "s", 1)]
    series: dict[int, list[Operand]] = {}
    h = lines.mul("size_", "direction_")
    for m in used:
        names = [f"a_{m}_{k}_" for k in range(degree + 1)]
        loads += [Load(name, "y", first + m * (degree + 1) + k) for k, name in enumerate(names)]
        loads.append(Load(f"end_{m}_", "y", m))
        series[m] = _joined(lines, list(names), h if in_time else 1.0, f"end_{m}_")
    evaluate = inlined(lines, values)
    width = max(used, default=-1) + 1
    rows: list[list[Operand]] = []
    for theta in map(float, POINTS):
        state: list[Operand] = [0.0] * width
        for m, terms in series.items():
            total = terms[-1]
            for term in terms[-2::-1]:
                total = lines.fma(total, theta, term)
            state[m] = total
        rows.append(evaluate(lines.fma(h, theta, "t_"), state))
    outputs = tuple(_sign(lines, list(column)) for column in zip(*rows, strict=True))
    constants = sorted({load.index or 0 for load in values.loads if load.array == "c"})
    loads += [Load(f"c_{index}_", "c", index) for index in constants]
    kernel = Kernel("quiet", _ARGUMENTS, tuple(loads), tuple(lines.body), outputs)
    return run(kernel, [eliminate_dead_code])


def _joined(lines: Lines, terms: list[Operand], scale: Operand, end: Operand) -> list[Operand]:
    """Return coefficients in the fraction of the step, made to end in the state that it ended in."""
    power: Operand = 1.0
    scaled: list[Operand] = []
    total: Operand = 0.0
    for term in terms:
        scaled.append(lines.mul(term, power))
        total = lines.add(total, scaled[-1])
        power = lines.mul(power, scale)
    gap = lines.sub(end, total)
    scaled[2] = lines.fma(gap, 3.0, scaled[2])
    scaled[3] = lines.fma(gap, -2.0, scaled[3])
    return scaled


def _sign(lines: Lines, values: list[Operand]) -> Operand:
    """Return the sign of a function with these values at the points, 0 where it may change."""
    series: list[Operand] = []
    for row in COEFFICIENTS:
        total: Operand = 0.0
        for weight, value in zip(map(float, row), values, strict=True):
            total = lines.fma(value, weight, total)
        series.append(total)
    sizes = [lines.op("abs", term) for term in series]
    rest = lines.mul(lines.add(sizes[-1], sizes[-2]), TAIL)
    for size in sizes[1:]:
        rest = lines.add(rest, size)
    sign = lines.op("select", lines.op("less", 0.0, series[0]), 1.0, -1.0)
    return lines.op("select", lines.op("less", rest, sizes[0]), sign, 0.0)
