"""`Kernel`: straight-line code in SSA form from named arrays to an output array."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

from .notation import Reader, one_line, operand_text, operation_text, word
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

    def __str__(self) -> str:
        place = "" if self.index is None else f"[{self.index}]"
        return f"{word(self.target)} = {word(self.array)}{place}"


@final
@dataclass(frozen=True, slots=True)
class Assignment:
    """``target = op(args)``; every target is assigned once."""

    target: str
    op: str
    args: tuple[Operand, ...]

    def __str__(self) -> str:
        return f"{word(self.target)} = {operation_text(self.op, self.args)}"


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
        Values of the output array, in order.

    Notes
    -----
    ``str(kernel)`` is its text, which `parse` reads back::

        kernel rhs(t, y, c)
          theta = y[2]
          b = c[1]
          sin_theta = sin(theta)
          z = b * sin_theta
          out[0] = z
    """

    name: str
    arguments: tuple[str, ...]
    loads: tuple[Load, ...]
    body: tuple[Assignment, ...]
    outputs: tuple[Operand, ...]

    def __str__(self) -> str:
        return self.text()

    def text(self, labels: Sequence[str] = ()) -> str:
        """Return the kernel in the notation of `dalembert.ir.notation`, its outputs commented by `labels`."""
        lines = [f"kernel {word(self.name)}({', '.join(map(word, self.arguments))})"]
        lines += [f"  {load}" for load in self.loads]
        lines += ["  " + str(line) for line in self.body]
        for i, output in enumerate(self.outputs):
            comment = f"  # {one_line(labels[i])}" if labels and labels[i] != output else ""
            lines.append(f"  out[{i}] = {operand_text(output)}{comment}")
        return "\n".join(lines)

    @classmethod
    def parse(cls, text: str) -> Kernel:
        """Return the kernel of which `text` is the text form; `dalembert.ir.verify` checks it.

        Raises
        ------
        ProgramTextError
            With the line that cannot be read, and what was expected there.
        """
        reader = Reader(text)
        kernel = cls.read(reader)
        if not reader.done:
            reader.fail("an assignment, or the end")
        return kernel

    @classmethod
    def read(cls, reader: Reader) -> Kernel:
        """Read the kernel at the present place of a text."""
        reader.require("kernel")
        name = reader.word("the name of the kernel")
        reader.require("(")
        arguments = tuple(reader.listed(reader.word, ")"))
        reader.require(")")
        reader.end_line()
        loads: list[Load] = []
        body: list[Assignment] = []
        outputs: list[Operand] = []
        while reader.sees_word() and (reader.sees("=", 1) or reader.sees("[", 1)):
            if reader.sees("[", 1):
                reader.require("out", "[", str(len(outputs)), "]", "=")
                outputs.append(reader.operand())
            elif outputs:
                reader.fail("an output, or the end of the kernel")
            else:
                target = reader.word()
                reader.require("=")
                if reader.sees_word() and (reader.sees("[", 1) or reader.ends(1)):
                    loads.append(Load(target, reader.word(), _index(reader)))
                else:
                    body.append(Assignment(target, *reader.operation()))
            reader.end_line()
        return cls(name, arguments, tuple(loads), tuple(body), tuple(outputs))


def _index(reader: Reader) -> int | None:
    """Return the index of a load, in brackets, or None."""
    if not reader.take("["):
        return None
    index = reader.whole("the number of an entry")
    reader.require("]")
    return index


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
