"""Ends of Taylor steps at kinks and jumps: [series of what switches decide by] -> [size of the step].

Up to the zero of a - b the comparison a < b has one value, and so have the sign of a up to the zero of a, and its
floor up to the next integer. Along a step that ends there the motion is smooth, and its series knows all of it. The
zero is found as the knot of a table is (`step_ends`): by steps of Newton's kind that never pass it, with a bound of
the second derivative over the whole step. So no passage is too slow or too short to be seen.

A step goes past the zero by a time in which nothing happens that counts. No step is shorter than the time in which the
rates change the state by about the tolerance, so that a motion that is pushed back and forth across a jump continues.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ...ir.kernel import Lines, Operand
from .expansion import Series
from .nonsmooth import Switch
from .step_ends import Side, in_shares_of_step, shortest, time_to_change, value_and_slope

_ROUNDS = 4
_BEYOND, _NEAREST = 1e-4, 1e-13
"""Change of the state while a step continues past a zero, in tolerances, and the least of it: behind the zero of a root
of Max(0, x) coefficients grow by its inverse from order to order, and must not overflow."""
_SHORTEST = 3.0
"""Change of the state in the shortest step, in tolerances."""


def before_switches(
    lines: Lines,
    switches: Sequence[Switch],
    arguments: Mapping[str, Series],
    rates: Sequence[Series],
    order: int,
    size: Operand,
    direction: Operand,
    scale: Operand,
    tolerance: float,
) -> Operand:
    """Return the largest step before a kink or a jump, or past it where one is about to be met.

    Parameters
    ----------
    arguments : mapping of str to Series
        What the switches decide by, in powers of time.
    rates : sequence of Series
        Of all components of the state.
    size, direction : Operand
        Of the step that is proposed, and that of time.
    scale, tolerance
        What errors are measured by, and the share of it that the order of the step stands for.
    """
    if not switches:
        return size
    h = lines.mul(size, direction)
    share: Operand = 1.0
    for argument, floor in dict.fromkeys((switch.argument, switch.line.op == "floor") for switch in switches):
        terms = in_shares_of_step(lines, arguments[argument], order, h)
        for gap, leaving in (_to_integers if floor else _to_zero)(lines, terms):
            share = lines.op("min", share, _certain_share(lines, gap, leaving))
    certain = lines.mul(size, share)
    beyond = time_to_change(lines, rates, scale, max(_BEYOND * tolerance, _NEAREST), certain, size)
    least = time_to_change(lines, rates, scale, max(_SHORTEST * tolerance, _NEAREST), 0.0, size)
    reach = lines.add(certain, lines.op("max", beyond, shortest(lines, size)))
    return lines.op("min", lines.op("max", reach, least), size)


def as_at_start(lines: Lines, switch: Switch, begun: Operand, args: Sequence[Operand]) -> Operand:
    """Return a switch of other operands, continued on the side on which its argument has `begun`."""
    compared = [begun if arg == switch.argument else arg for arg in switch.compared]
    match switch.line.op:
        case "abs":
            return lines.mul(lines.op("sign", begun), args[0])
        case "min":
            return lines.op("select", lines.op("less_equal", *compared), *args)
        case "max":
            return lines.op("select", lines.op("less_equal", *compared[::-1]), *args)
        case "less" | "less_equal":
            return lines.op(switch.line.op, *compared)
        case op:
            return lines.op(op, begun)


def _to_zero(lines: Lines, terms: Series) -> list[tuple[Operand, Series]]:
    """Return the distance from zero, and the terms of its growth; at zero itself, the motion counts as towards it."""
    leaving = terms[-1]
    for term in terms[-2:0:-1]:
        leaving = lines.op("select", term, term, leaving)
    side = lines.op("sign", lines.op("select", terms[0], terms[0], lines.neg(leaving)))
    return [(lines.op("abs", terms[0]), [lines.mul(term, side) for term in terms])]


def _to_integers(lines: Lines, terms: Series) -> list[tuple[Operand, Series]]:
    """Return the distances from the integers below and above, and the terms of their growth."""
    below = lines.sub(terms[0], lines.op("floor", terms[0]))
    return [(below, terms), (lines.sub(1.0, below), [lines.neg(term) for term in terms])]


def _certain_share(lines: Lines, gap: Operand, terms: Series) -> Operand:
    """Return the share of the step in which a distance `gap` that grows by `terms` is certainly not used up."""
    side = Side.of(lines, terms, turned=True)
    share: Operand = 0.0
    for number in range(_ROUNDS):
        moved, slope = (0.0, terms[1]) if number == 0 else value_and_slope(lines, terms, share)
        share = lines.op("min", lines.add(share, side.certain(lines, lines.add(gap, moved), lines.neg(slope))), 1.0)
    return lines.op("select", lines.op("less_equal", side.rise, gap), 1.0, share)
