"""Residual control of Taylor steps: the residual of the polynomial at points within the step.

A step takes its size from the last two coefficients of its series. A term that vanishes at the start of the step and is
large within it is not in them: tanh(100) is 1 with all its derivatives 0, and t**25 has no coefficient up to order 24.
Where a right-hand side has such operations (`dalembert.transforms.taylor.nonsmooth.nonanalytic_operations`), the
polynomial p of a step is put into the differential equation at a few points of the step. The step ends before the
first point where p' and f(t, p) differ by more than the tolerance; the series, which is the cost of a step, stays
valid on the shorter step. So a step is never rejected, and the loops do not depend on this.

Points lie closer and closer towards the beginning, so that one series serves to come near a jump however far it lies
from the middle of the step; between large ones the distances are unequal, so that no period hides there. What begins
and ends between two points is not seen. Steps therefore grow by a factor at most, and the first is a share of the span.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from ...ir.kernel import Assignment, Lines, Operand
from .expansion import FAITHFUL_ORDER, Series, coefficient, over
from .nonsmooth import leading_to
from .recurrences import Recurrences
from .switch_steps import as_at_start

PREVIOUS = "previous_"
"""The size of the step before, which lies behind the state; 0 before the first."""

_POINTS = (1e-5, 0.02, 0.22, 0.45, 0.7, 1.0)
_GROWTH, _FIRST = 2.0, 0.01
_ALLOWED = 1.0
"""Largest ratio of a residual to that of the first term left out, as it is in steps that the coefficients limit."""

_LEAST = 1e-9
"""Share of a step that is taken where not even the first point is fine: what a jump at the beginning does in it is
nothing. Where nothing is fine ever after, steps come to an end within a few of these."""

_NOISE = 1e-13
"""Share of a rate that is rounding."""


def cost(recurrences: Recurrences, order: int) -> tuple[int, int]:
    """Return the number of evaluations of the residual control of a step, and about how many other lines it needs."""
    if not recurrences.controlled:
        return 0, 0
    return len(_POINTS), len(_POINTS) * order * (len(recurrences.states) + len(recurrences.controlled))


def grown(lines: Lines, size: Operand, largest: Operand) -> Operand:
    """Return the largest size of a step after its predecessor."""
    first = lines.mul(largest, _FIRST)
    most = lines.op("select", lines.op("less", 0.0, PREVIOUS), lines.mul(PREVIOUS, _GROWTH), first)
    return lines.op("min", size, most)


def reached(
    lines: Lines,
    recurrences: Recurrences,
    rates: list[Series],
    order: int,
    size: Operand,
    direction: Operand,
    scale: Operand,
    tolerance: float,
    arguments: Mapping[Operand, Operand],
    weights: Sequence[Operand] = (),
) -> Operand:
    """Return the size of a step that ends at the last point before its polynomial fails to solve the equations.

    Parameters
    ----------
    rates : list of Series
        Of all components of the state; those of the controlled ones are compared.
    size : Operand
        Of the step that is proposed, which is returned as it is where all is fine.
    scale, tolerance
        Scale of errors, and the tolerance of the step as a share of it.
    arguments : mapping of str to Operand
        Arguments of tables and of switches at the beginning of the step, which stays in the pieces that they are in.
    weights : sequence of Operand
        Of the components of the state in the scale of errors; none where all count alike.
    """
    body = _controlled_body(recurrences)
    allowed = lines.mul(scale, max(_ALLOWED * (order + 1) * tolerance, _NOISE))
    reach: Operand = _LEAST
    fine: Operand = 1.0
    for theta in _POINTS:
        reaches = lines.mul(size, theta)
        x = lines.mul(reaches, direction)
        terms = order if theta > 0.1 else min(order, math.ceil(-42.0 / math.log(theta)))
        states = _states_at(lines, recurrences, body, rates, x, terms, faithful=order >= FAITHFUL_ORDER)
        values = _values_at(lines, recurrences, body, states, x, arguments)
        for i in recurrences.controlled:
            found = values[recurrences.rates[i]]
            gap = lines.op("abs", lines.sub(found, _polynomial(lines, rates[i], x, terms)))
            gap = lines.op("fma", lines.op("abs", found), -_NOISE, gap)
            error = lines.mul(gap, reaches)
            error = lines.mul(error, weights[i]) if weights else error
            fine = lines.mul(fine, lines.op("less_equal", error, allowed))
        reach = lines.op("select", fine, theta, reach)
    return lines.mul(size, reach)


def _controlled_body(recurrences: Recurrences) -> list[Assignment]:
    """Return the lines that the controlled rates depend on."""
    needed = leading_to(recurrences.kernel, [recurrences.rates[i] for i in recurrences.controlled])
    return [line for line in recurrences.kernel.body if line.target in needed]


def _polynomial(lines: Lines, series: Series, x: Operand, terms: int) -> Operand:
    """Return the sum of so many terms of a series, by Horner's scheme."""
    total: Operand = coefficient(series, terms - 1)
    for k in range(terms - 2, -1, -1):
        total = lines.fma(total, x, coefficient(series, k))
    return total


def _states_at(
    lines: Lines,
    recurrences: Recurrences,
    body: Sequence[Assignment],
    rates: Sequence[Series],
    x: Operand,
    terms: int,
    *,
    faithful: bool,
) -> dict[Operand, Operand]:
    """Return the components of the state that the controlled rates read, a time `x` after the start of the step."""
    read = {arg for line in body for arg in line.args} | {recurrences.rates[i] for i in recurrences.controlled}
    values: dict[Operand, Operand] = {}
    for state, rate in zip(recurrences.states, rates, strict=True):
        if state in read:
            moved = [over(lines, coefficient(rate, k), k + 1, faithful) for k in range(terms)]
            values[state] = lines.fma(_polynomial(lines, moved, x, terms), x, state)
    return values


def _values_at(
    lines: Lines,
    recurrences: Recurrences,
    body: Sequence[Assignment],
    states: Mapping[Operand, Operand],
    x: Operand,
    arguments: Mapping[Operand, Operand],
) -> dict[Operand, Operand]:
    """Return the values of the lines of the right-hand side, a time `x` after the start of the step."""
    switches = {switch.line.target: switch for switch in recurrences.switches}
    values = dict(states)
    for load in recurrences.kernel.loads:
        if load.array == "t":
            values[load.target] = lines.op("add", load.target, x)
    for line in body:
        known = arguments if line.op == "piece" else values
        args = [known.get(arg, arg) for arg in line.args]
        switch = switches.get(line.target)
        values[line.target] = (
            lines.op(line.op, *args) if switch is None else as_at_start(lines, switch, arguments[switch.argument], args)
        )
    return values
