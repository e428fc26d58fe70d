"""`Kernel`: straight-line code in SSA form from named arrays to an output array."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import final

from .ops import ALL_OPERATIONS

__all__ = ["Assignment", "Kernel", "Load", "Operand", "count_operations", "describe_counts"]


Operand = str | float
"""The name of a value, or a literal."""


@final
@dataclass(frozen=True, slots=True)
class Load:
    """``target = array[index]``, or ``target = array`` for the scalar time (index None)."""

    target: str
    array: str
    index: int | None


@final
@dataclass(frozen=True, slots=True)
class Assignment:
    """``target = op(args)``; every target is assigned once."""

    target: str
    op: str
    args: tuple[Operand, ...]


@final
@dataclass(frozen=True, slots=True)
class Kernel:
    """Named inputs, straight-line assignments, outputs.

    Attributes
    ----------
    name : str
        Name of the generated function.
    arguments : tuple of str
        Its arguments, in order: ``t``, ``y``, ``c``, or ``p``.
    loads : tuple of Load
        Inputs in use.
    body : tuple of Assignment
        Operations, each after its operands.
    outputs : tuple of Operand
        What is written to the output array, in order.
    """

    name: str
    arguments: tuple[str, ...]
    loads: tuple[Load, ...]
    body: tuple[Assignment, ...]
    outputs: tuple[Operand, ...]


def count_operations(kernel: Kernel) -> Counter[str]:
    """Return how often each operation occurs, with all floating-point ones under "flops"."""
    counts: Counter[str] = Counter()
    for line in kernel.body:
        operation = ALL_OPERATIONS[line.op]
        counts[line.op] += 1
        counts["flops"] += operation.flops
    return counts


def describe_counts(kernel: Kernel) -> str:
    """Return the operation count of a kernel as text: ``8 flops, 1 sin, 1 cos``."""
    counts = count_operations(kernel)
    named = [
        f"{counts[name]} {name}"
        for name, op in ALL_OPERATIONS.items()
        if not op.flops and name != "neg" and counts[name]
    ]
    return ", ".join([f"{counts['flops']} flops", *named])
