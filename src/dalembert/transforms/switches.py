"""Switches: operations of a right-hand side with a kink or a jump at zeros of a value whose series is known."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass
from typing import final

from ..ir.kernel import Assignment, Kernel, Operand
from .linear import SET_ASIDE
from .nonsmooth import JUMPING, leading_to, reached_from

__all__ = ["Switch", "left_to_control", "switches_of"]

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


def _guards(kernel: Kernel) -> set[Operand]:
    """Return the comparisons that only guard pivots of dependent constraints."""
    guards = {line.args[0] for line in kernel.body if line.op == "select" and SET_ASIDE in line.args[1:]}
    others = {
        arg
        for line in kernel.body
        for place, arg in enumerate(line.args)
        if arg in guards and not (line.op == "select" and place == 0 and SET_ASIDE in line.args[1:])
    }
    return guards - others - set(kernel.outputs)


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
