"""Nonsmooth and nonanalytic operations: kinks, jumps, and functions that their power series need not represent."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import final

from ...ir.graph import Graph
from ...ir.kernel import Assignment, Kernel, Operand
from ...ir.node import Node, deps_of
from ...ir.program import Program
from ...ir.tables import numbers_of
from ..linear import SET_ASIDE

_CHOOSING = ("select", "min", "max")
JUMPING = ("less", "less_equal", "sign", "floor")
"""Operations with jumps."""
_KINKED = {*_CHOOSING, *JUMPING, "abs"}
_STEEP = {"exp", "sinh", "cosh", "tanh", "atan"}
_BRANCHED = {"acos", "asin", "atan2"}
"""Operations with several branches, of which a power series keeps one: a kink where |x| is 1, a jump at the cut."""

LEAST_POWER, LEAST_INVERSE = 6, 5
"""Exponents from which powers and inverse powers are steep; of the latter, sums with a square in them count twice.

A factor that passes through zero has with exponent k no coefficient below k, so that a series of that order shows
nothing of it; orders are 6 or more, and 13 by default. A force that goes with an inverse power of a distance is nothing
far away: at the default order, steps passed over bodies at 1e5 times the shortest distance for exponents up to 4, which
is let alone, at 1e3 times for 6, and at 100 times for 8 (measured on particles that repel each other)."""

INVERSE = "inverse powers"


def nonanalytic_operations(kernel: Kernel) -> dict[str, str]:
    """Return the values of a kernel that a power series need not represent, with the kind of each.

    These are the operations with a kink or a jump on what depends on state or time, and steep ones, which are smooth
    and may be nothing where a series begins and everything close by: tanh(100) is 1 with all its derivatives 0, and
    t**25 has no coefficient up to order 24. Steep are the exponential functions, powers with exponents that are not
    known or move, and products of `LEAST_POWER` equal factors or more, above or below the line, however nested.

    The rule does not find everything: a quotient of low powers is small very far from its pole, differences of
    products may cancel to any order, and a component of the state that is nothing may grow by a rate of its own (which
    absolute tolerances leave unseen by every method).
    """
    factors = factors_of(kernel)
    guards = _guards(kernel)
    found: dict[str, str] = {}
    squares: set[str] = set()
    for line in kernel.body:
        if line.target not in factors or line.target in guards or (line.op == "select" and line.args[0] in guards):
            continue
        own = factors[line.target]
        parts = (part for arg in line.args for part in factors.get(arg, {}).items())
        if line.op in ("add", "sub") and any(exponent >= 2.0 or name in squares for name, exponent in parts):
            squares.add(line.target)
        if (
            line.op in _KINKED
            or line.op in _STEEP
            or line.op in _BRANCHED
            or (line.op == "pow" and isinstance(line.args[1], str))
        ):
            found[line.target] = line.op
        elif any(exponent >= LEAST_POWER for exponent in own.values()):
            found[line.target] = "high powers"
        elif any(exponent * (1 + (name in squares)) <= -LEAST_INVERSE for name, exponent in own.items()):
            found[line.target] = INVERSE
    return found


def last_of(kernel: Kernel, values: Collection[str]) -> tuple[str, ...]:
    """Return those values from which none of the others is computed."""
    behind = {value for value in values if reached_from(kernel, [value]) & set(values) == {value}}
    return tuple(line.target for line in kernel.body if line.target in behind)


def nonsmooth_values(found: Mapping[str, str]) -> list[str]:
    """Return those of the values that `nonanalytic_operations` gives which have a kink or a jump."""
    return [name for name, what in found.items() if what in _KINKED]


def moving_roots(kernel: Kernel, moving: Collection[Operand]) -> tuple[str, ...]:
    """Return the square roots of moving values.

    One of squares and a small positive number never vanishes, but its series does: sqrt(v**2 + 1e-8) is v until v is
    1e-4. A step that went by the last coefficients alone would pass through, as if v went on below zero.
    """
    return tuple(line.target for line in kernel.body if line.op == "sqrt" and line.args[0] in moving)


def nonanalytic(graph: Graph, nodes: Sequence[Node], moving: Sequence[Node], *, kinks: bool) -> bool:
    """Return whether nodes have exponential functions in what is `moving` or, where `kinks` count, kinks or jumps."""
    mask = deps_of(moving)
    counted = {*_STEEP, *_BRANCHED, *(_KINKED if kinks else ())}
    return any(node.op in counted and node.deps & mask for node in graph.topological(nodes))


def factors_of(kernel: Kernel) -> dict[Operand, dict[str, float]]:
    """Return the values that vary with state or time, each with its factors and their exponents."""
    factors: dict[Operand, dict[str, float]] = {
        load.target: {load.target: 1.0} for load in kernel.loads if load.array in ("t", "y")
    }
    for line in kernel.body:
        if any(arg in factors for arg in line.args):
            factors[line.target] = _factors(line, factors)
    return factors


def largest_degree(kernel: Kernel) -> int:
    """Return the largest degree of products in the outputs of a kernel, less than `LEAST_POWER`.

    It is that in the state and the time, or in one factor if that is more: of what is no sum or product, degrees count
    only where it is multiplied by itself, and those of divisors do not count.
    """
    degrees: dict[Operand, float] = {load.target: 1.0 for load in kernel.loads if load.array in ("t", "y")}
    for line in kernel.body:
        first, *_ = args = [degrees.get(arg, 0.0) for arg in line.args]
        match line.op:
            case "mul":
                degrees[line.target] = sum(args)
            case "add" | "sub" | "neg" | "abs":
                degrees[line.target] = max(args)
            case "div":
                degrees[line.target] = first
            case "pow" if not isinstance(line.args[1], str):
                degrees[line.target] = first * line.args[1]
    needed, factors, most = set(kernel.outputs), factors_of(kernel), 0.0
    for line in reversed(kernel.body):
        if line.target in needed:
            needed.update(line.args[:1] if line.op == "div" else line.args)
            most = max([most, degrees.get(line.target, 0.0), *factors.get(line.target, {}).values()])
    return int(min(most, LEAST_POWER - 1))


def _factors(line: Assignment, known: dict[Operand, dict[str, float]]) -> dict[str, float]:
    """Return the factors of a value and their exponents, from those of the values before it."""
    first = known.get(line.args[0], {})
    match line.op:
        case "mul" | "div":
            factors, sign = dict(first), 1.0 if line.op == "mul" else -1.0
            for name, exponent in known.get(line.args[1], {}).items():
                factors[name] = factors.get(name, 0.0) + sign * exponent
            return factors
        case "neg" | "abs":
            return first
        case "sqrt":
            return {name: 0.5 * exponent for name, exponent in first.items()}
        case "pow" if not isinstance(line.args[1], str):
            return {name: line.args[1] * exponent for name, exponent in first.items()}
        case _:
            return {line.target: 1.0}


def leading_to(kernel: Kernel, targets: Collection[Operand]) -> set[Operand]:
    """Return some values and all from which they are computed."""
    needed = set(targets)
    for line in reversed(kernel.body):
        if line.target in needed:
            needed.update(line.args)
    return needed


def reached_from(kernel: Kernel, values: Collection[str]) -> set[Operand]:
    """Return some values and all that are computed from them."""
    reached: set[Operand] = set(values)
    for line in kernel.body:
        if any(arg in reached for arg in line.args):
            reached.add(line.target)
    return reached


def only_in_branches(kernel: Kernel) -> frozenset[str]:
    """Return the targets that reach an output only through a selection, which may choose otherwise.

    Where it does, what they compute may be singular, and their derivatives count for nothing. What is merely compared
    has no derivative either.
    """
    always = {output for output in kernel.outputs if isinstance(output, str)}
    for line in reversed(kernel.body):
        if line.target in always and line.op not in (*_CHOOSING, *JUMPING):
            always.update(arg for arg in line.args if isinstance(arg, str))
    return frozenset(line.target for line in kernel.body if line.target not in always)


def _jumping_pieces(kernel: Kernel) -> set[Operand]:
    """Return the pieces of tables, or of derivatives of tables, that jump at their knots."""
    entries = (line for line in kernel.body if line.op == "entry")
    return {place for place, key, row in (line.args for line in entries) if numbers_of(float(key)).jumps(int(row))}


def decisions(program: Program) -> Kernel | None:
    """Return the kernel of the quantities in the rates that jump with state or time; None where there are none.

    Without what sets pivots aside where constraints depend on each other: on its branch a motion passes there smoothly.
    """
    rhs = program.kernel("rhs")
    guards = pivot_comparisons(rhs)
    moving = {load.target for load in rhs.loads if load.array in ("t", "y")}
    found, jumping = [], _jumping_pieces(rhs)
    for line in rhs.body:
        if any(arg in moving for arg in line.args):
            moving.add(line.target)
            if (line.op in JUMPING and line.target not in guards) or line.target in jumping:
                found.append(line.target)
    return replace(rhs, name="decisions", outputs=tuple(found)) if found else None


# Switches: operations of a right-hand side with a kink or a jump at zeros of a value whose series is known.

_COMPARING = ("less", "less_equal", "min", "max")
_SWITCHING = ("abs", "sign", "floor", *_COMPARING)


@final
@dataclass(frozen=True, slots=True)
class Switch:
    """An operation with a kink or a jump.

    Attributes
    ----------
    line : Assignment
    argument : str
        The value at whose zeros (for a floor: integers) it has that.
    compared : tuple of Operand
        What a comparison, minimum or maximum compares, up to a difference of both: the argument and zero in some order.
    """

    line: Assignment
    argument: str
    compared: tuple[Operand, ...]

    @classmethod
    def of(cls, line: Assignment, differences: dict[tuple[Operand, ...], Assignment]) -> Switch:
        """Return the switch of an operation; a difference that it needs joins those of `differences`."""
        if line.op not in _COMPARING:
            return cls(line, str(line.args[0]), ())
        if 0.0 in line.args:
            (argument,) = (arg for arg in line.args if arg != 0.0)
            return cls(line, str(argument), line.args)
        name = f"{line.target}_difference"
        argument = differences.setdefault(line.args, Assignment(name, "sub", line.args)).target
        return cls(line, argument, (argument, 0.0))


def switches_of(
    kernel: Kernel, rates: int, varying: Set[str], hidden: Mapping[str, str]
) -> tuple[tuple[Switch, ...], tuple[Assignment, ...]]:
    """Return the switches that the first `rates` outputs of a kernel depend on, and the differences that they need.

    Those that depend on what power series need not represent are left out: their zeros are not known.

    Parameters
    ----------
    varying : set of str
        Values that change along the motion.
    hidden : mapping of str to str
        What `nonanalytic_operations` finds in the kernel.
    """
    guards = _guards(kernel)
    found = [
        line for line in kernel.body if line.op in _SWITCHING and line.target not in guards and varying & set(line.args)
    ]
    decided = _decided(kernel, varying)
    known = {line.target for line in found} | _selections(kernel, varying, decided)
    unknown = reached_from(kernel, [name for name in hidden if name not in known])
    needed = leading_to(kernel, kernel.outputs[:rates])
    differences: dict[tuple[Operand, ...], Assignment] = {}
    switches = tuple(
        Switch.of(line, differences) for line in found if line.target in needed and not unknown & set(line.args)
    )
    return switches, tuple(differences.values())


def left_to_control(
    kernel: Kernel, varying: Set[str], hidden: Mapping[str, str], switches: tuple[Switch, ...]
) -> dict[str, str]:
    """Return those of the `hidden` operations for which no step ends at a zero."""
    known = {switch.line.target for switch in switches} | _selections(kernel, varying, _decided(kernel, varying))
    return {name: what for name, what in hidden.items() if name not in known}


def pivot_comparisons(kernel: Kernel) -> set[Operand]:
    """Return the comparisons that set a pivot aside where constraints depend on each other."""
    return {line.args[0] for line in kernel.body if line.op == "select" and SET_ASIDE in line.args[1:]}


def _guards(kernel: Kernel) -> set[Operand]:
    """Return the comparisons that only guard pivots of dependent constraints."""
    guards = pivot_comparisons(kernel)
    others = {
        arg
        for line in kernel.body
        for place, arg in enumerate(line.args)
        if arg in guards and not (line.op == "select" and place == 0 and SET_ASIDE in line.args[1:])
    }
    return guards - others - set(kernel.outputs)


def guarded_pivots(kernel: Kernel, varying: Set[str]) -> tuple[str, ...]:
    """Return the pivots of constraints that may lose rank, as their guards give them."""
    guards = _guards(kernel)
    return tuple(
        line.target
        for line in kernel.body
        if line.op == "select" and line.args[0] in guards and SET_ASIDE in line.args[1:] and line.target in varying
    )


def _decided(kernel: Kernel, varying: Set[str]) -> set[Operand]:
    """Return the values that change by jumps alone."""
    jumping: set[Operand] = set()
    for line in kernel.body:
        moving = varying & set(line.args)
        if moving and (line.op in JUMPING or moving <= jumping):
            jumping.add(line.target)
    return jumping


def _selections(kernel: Kernel, varying: Set[str], decided: set[Operand]) -> set[str]:
    """Return the selections by conditions that change by jumps alone, or not at all."""
    return {
        line.target
        for line in kernel.body
        if line.op == "select" and (line.args[0] in decided or line.args[0] not in varying)
    }
