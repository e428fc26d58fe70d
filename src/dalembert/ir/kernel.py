"""`Kernel`: straight-line code in SSA form from named arrays to an output array."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import NoReturn, final

from .calls import CALLS
from .notation import Reader, one_line, operand_text, operation_text, word
from .ops import ALL_OPERATIONS

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
@dataclass(frozen=True, slots=True, weakref_slot=True)
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

    @property
    def digest(self) -> str:
        """A digest of all that the kernel is made of, the same in every process."""
        loads = [(load.target, load.array, load.index) for load in self.loads]
        body = [(line.target, line.op, line.args) for line in self.body]
        parts = self.name, self.arguments, loads, body, self.outputs
        return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]

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
        """Return the kernel of which `text` is the text form; `verify` checks it.

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


def calls_in(kernel: Kernel) -> list[int]:
    """Return the keys of the functions that a kernel calls (`dalembert.ir.calls`), each once."""
    return list(dict.fromkeys(int(float(line.args[-1])) for line in kernel.body if line.op in CALLS))


def describe_counts(kernel: Kernel) -> str:
    """Return the operation count of a kernel as text: ``8 flops, 1 sin, 1 cos``."""
    counts = count_operations(kernel)
    named = [
        f"{counts[name]} {name}"
        for name, op in ALL_OPERATIONS.items()
        if not op.flops and name != "neg" and counts[name]
    ]
    return ", ".join([f"{counts['flops']} flops", *named])


# Straight-line code under construction.


@final
class Lines:
    """Assignments in the order of the calls; each operation is written once, trivial ones never.

    Attributes
    ----------
    body : list of Assignment
    parts : dict
        Assignments that were noted as a part, under its key.
    """

    def __init__(self) -> None:
        self.body: list[Assignment] = []
        self.parts: dict[Hashable, list[Assignment]] = {}
        self._known: dict[tuple[str, tuple[Operand, ...]], str] = {}
        self._negated: dict[Operand, Operand] = {}

    def note(self, key: Hashable, begin: int) -> None:
        """Note what was written from line `begin` on as the part `key`."""
        self.parts[key] = self.body[begin:]

    def op(self, name: str, *args: Operand) -> Operand:
        """Return the value of an operation."""
        key = (name, args)
        if key not in self._known:
            self._known[key] = f"v_{len(self.body)}_"
            self.body.append(Assignment(self._known[key], name, args))
        return self._known[key]

    def add(self, a: Operand, b: Operand) -> Operand:
        """Return a + b."""
        if a == 0.0 or b == 0.0:
            return b if a == 0.0 else a
        return self.op("add", a, b)

    def sub(self, a: Operand, b: Operand) -> Operand:
        """Return a - b."""
        if a == 0.0 or b == 0.0:
            return self.neg(b) if a == 0.0 else a
        return self.op("sub", a, b)

    def mul(self, a: Operand, b: Operand) -> Operand:
        """Return a * b."""
        if not isinstance(a, str) and not isinstance(b, str):
            return a * b
        if a in (0.0, 1.0):
            return 0.0 if a == 0.0 else b
        if b in (0.0, 1.0):
            return 0.0 if b == 0.0 else a
        if isinstance(a, str) != isinstance(b, str):
            a, b = self._with_sign(a, b)
        return self.op("mul", a, b)

    def neg(self, a: Operand) -> Operand:
        """Return -a."""
        if not isinstance(a, str):
            return -a
        negative = self.op("neg", a)
        self._negated[negative] = a
        return negative

    def _with_sign(self, a: Operand, b: Operand) -> tuple[Operand, Operand]:
        """Return the factors of a product, where one is a number with the sign of the other: (-x) 2 is x (-2)."""
        if isinstance(a, str):
            return (self._negated[a], -float(b)) if a in self._negated else (a, b)
        return (-a, self._negated[b]) if b in self._negated else (a, b)

    def fma(self, a: Operand, b: Operand, c: Operand) -> Operand:
        """Return a * b + c, rounded once where the target can."""
        if a == 0.0 or b == 0.0:
            return c
        if c == 0.0:
            return self.mul(a, b)
        if isinstance(a, str) != isinstance(b, str):
            a, b = self._with_sign(a, b)
        return self.op("fma", a, b, c)


# The verifier of kernels, run after every pass.


class MalformedKernel(AssertionError):
    """A pass produced a kernel that is not in SSA form; a fault of the compiler, never of a scene."""


def verify(kernel: Kernel) -> Kernel:
    """Return `kernel` if it is well formed.

    Raises
    ------
    MalformedKernel
        When a value is assigned twice or used before its assignment, an operation is unknown or has the wrong
        number of operands, a load names no argument, or a literal is not finite.
    """
    known: set[str | float] = set()
    arguments = kernel.arguments
    for load in kernel.loads:
        if load.array not in arguments:
            _fail(kernel, f"{load.target} is loaded from {load.array}, which is no argument")
        if load.target in known or not load.target.isidentifier() or load.target in arguments:
            _fail_to_define(kernel, load.target, known)
        known.add(load.target)
    for line in kernel.body:
        operation, target = ALL_OPERATIONS.get(line.op), line.target
        if operation is None:
            _fail(kernel, f"{target} uses the unknown operation {line.op}")
        if operation.arity != len(line.args):
            _fail(kernel, f"{target}: {line.op} takes {operation.arity} operands, not {len(line.args)}")
        for operand in line.args:
            if operand not in known:
                _check_literal(kernel, operand, target)
        if target in known or not target.isidentifier() or target in arguments:
            _fail_to_define(kernel, target, known)
        known.add(target)
    for operand in kernel.outputs:
        if operand not in known:
            _check_literal(kernel, operand, "an output")
    return kernel


def _fail(kernel: Kernel, text: str) -> NoReturn:
    raise MalformedKernel(f"kernel {kernel.name!r}: {text}")


def _fail_to_define(kernel: Kernel, target: str, known: set[str | float]) -> NoReturn:
    _fail(kernel, f"{target} is assigned twice" if target in known else f"{target!r} cannot name a value")


def _check_literal(kernel: Kernel, operand: str | float, where: str) -> None:
    """Require that an operand is a known value or a finite number."""
    if isinstance(operand, str):
        _fail(kernel, f"{where} uses {operand} before its assignment")
    if not math.isfinite(operand):
        _fail(kernel, f"{where} uses the literal {operand}")
