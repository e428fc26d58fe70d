"""Passes from kernel to kernel: frozen dataclasses with a name and options, run by `dalembert.transforms.pipelines`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, final

from ..ir.kernel import Assignment, Kernel, Operand
from ..naming import Namer

__all__ = [
    "EliminateDeadCode",
    "FuseProducts",
    "GroupProducts",
    "ShareEqual",
    "ShareReciprocals",
    "values_of",
]


def _namer(kernel: Kernel) -> Namer:
    taken = {line.target for line in kernel.body} | {load.target for load in kernel.loads}
    return Namer(taken | set(kernel.arguments))


def _uses(kernel: Kernel) -> Counter[Operand]:
    counts: Counter[Operand] = Counter(arg for line in kernel.body for arg in line.args)
    counts.update(kernel.outputs)
    return counts


def values_of(kernel: Kernel, array: str, without: frozenset[int] = frozenset()) -> set[str]:
    """Return the values that depend on the entries of an argument alone, or on nothing; some entries do not count."""
    fixed = {load.target for load in kernel.loads if load.array == array and load.index not in without}
    for line in kernel.body:
        if all(not isinstance(arg, str) or arg in fixed for arg in line.args):
            fixed.add(line.target)
    return fixed


@final
@dataclass(frozen=True)
class EliminateDeadCode:
    """Remove assignments and loads that no output depends on."""

    name: ClassVar[str] = "eliminate dead code"

    def __call__(self, kernel: Kernel) -> Kernel:
        """Return the kernel after the pass."""
        live = {output for output in kernel.outputs if isinstance(output, str)}
        body: list[Assignment] = []
        for line in reversed(kernel.body):
            if line.target in live:
                body.append(line)
                live.update(arg for arg in line.args if isinstance(arg, str))
        loads = tuple(load for load in kernel.loads if load.target in live)
        return replace(kernel, body=tuple(reversed(body)), loads=loads)


@final
@dataclass(frozen=True)
class GroupProducts:
    """Gather the factors made of parameters in each product, so that they can be hoisted as one.

    ``(m*b*(u*w))/I`` becomes ``(m*b/I)*(u*w)``. Only products that are used once are taken apart.

    Attributes
    ----------
    parameters : str
        The argument that holds the parameters.
    """

    name: ClassVar[str] = "group products"
    parameters: str = "p"

    def __call__(self, kernel: Kernel) -> Kernel:
        """Return the kernel after the pass."""
        grouping = _Grouping(kernel, values_of(kernel, self.parameters))
        for line in kernel.body:
            grouping.add(line)
        return replace(kernel, body=tuple(grouping.body))


@final
class _Grouping:
    """The lines of a kernel whose products are grouped, under construction; `fixed` are the values of parameters."""

    def __init__(self, kernel: Kernel, fixed: set[str]) -> None:
        self.fixed, self.uses, self.namer = fixed, _uses(kernel), _namer(kernel)
        self.lines = {line.target: line for line in kernel.body}
        self.body: list[Assignment] = []
        self.inner = {name for line in kernel.body if self._is_open(line) for name in self._rebuilt(line)}

    def _is_open(self, line: Assignment) -> bool:
        return line.op in ("mul", "div") and line.target not in self.fixed

    def _rebuilt(self, line: Assignment) -> list[str]:
        """Return the operands that are products used only here, and so are rebuilt with the line."""
        children = [self.lines[arg] for arg in line.args if isinstance(arg, str) and arg in self.lines]
        return [c.target for c in children if self._is_open(c) and self.uses[c.target] == 1]

    def _factors(self, operand: Operand, top: list[Operand], bottom: list[Operand], root: bool = False) -> None:
        """Append the factors of an operand to those of a numerator and a denominator."""
        line = self.lines.get(operand) if isinstance(operand, str) else None
        if line is None or not self._is_open(line) or not (root or self.uses[operand] == 1):
            top.append(operand)
            return
        self._factors(line.args[0], top, bottom)
        if line.op == "mul":
            self._factors(line.args[1], top, bottom)
        else:
            self._factors(line.args[1], bottom, top)

    def _product(self, operands: Sequence[Operand], target: str | None = None) -> Operand:
        """Write the product of operands, and return its name."""
        result = operands[0]
        for place, operand in enumerate(operands[1:], 2):
            name = target if target is not None and place == len(operands) else self.namer("k")
            self.body.append(Assignment(name, "mul", (result, operand)))
            result = name
        return result

    def _is_fixed(self, operand: Operand) -> bool:
        return not isinstance(operand, str) or operand in self.fixed

    def add(self, line: Assignment) -> None:
        """Write a line, with its factors of parameters in one."""
        if not self._is_open(line):
            self.body.append(line)
            return
        if line.target in self.inner:
            return
        top: list[Operand] = []
        bottom: list[Operand] = []
        self._factors(line.target, top, bottom, root=True)
        held, below = ([f for f in side if self._is_fixed(f)] for side in (top, bottom))
        free, under = ([f for f in side if not self._is_fixed(f)] for side in (top, bottom))
        if held or below:
            factor = self._product(held) if held else 1.0
            if below:
                name = self.namer("k")
                self.body.append(Assignment(name, "div", (factor, self._product(below))))
                factor = name
            free.append(factor)  # last, so that equal factors meet in squares first
        if not under:
            self._product(free, line.target)
            return
        above = self._product(free or [1.0])
        self.body.append(Assignment(line.target, "div", (above, self._product(under))))


@final
@dataclass(frozen=True)
class ShareReciprocals:
    """Divide once by each divisor that many quotients share, and multiply by the reciprocal.

    Attributes
    ----------
    uses : int
        Quotients from which on it is done. The series of two need fewer products than those of a reciprocal and two
        products.
    """

    name: ClassVar[str] = "share reciprocals"
    uses: int = 3

    def __call__(self, kernel: Kernel) -> Kernel:
        """Return the kernel after the pass."""
        divisors: Counter[Operand] = Counter(
            line.args[1] for line in kernel.body if line.op == "div" and isinstance(line.args[1], str)
        )
        namer = _namer(kernel)
        reciprocal: dict[Operand, str] = {}
        body: list[Assignment] = []
        for line in kernel.body:
            if line.op != "div" or divisors[line.args[1]] < self.uses:
                body.append(line)
                continue
            divisor = line.args[1]
            if divisor not in reciprocal:
                reciprocal[divisor] = namer("inverse")
                body.append(Assignment(reciprocal[divisor], "div", (1.0, divisor)))
            body.append(Assignment(line.target, "mul", (line.args[0], reciprocal[divisor])))
        return replace(kernel, body=tuple(body))


@final
@dataclass(frozen=True)
class ShareEqual:
    """Compute equal operations once, which other passes may have written twice.

    Attributes
    ----------
    commutative : tuple of str
        Operations whose operands may change places.
    """

    name: ClassVar[str] = "share equal"
    commutative: tuple[str, ...] = ("add", "mul", "min", "max")

    def __call__(self, kernel: Kernel) -> Kernel:
        """Return the kernel after the pass."""
        same: dict[Operand, Operand] = {}
        known: dict[tuple[str, tuple[str, ...]], str] = {}
        body: list[Assignment] = []
        for line in kernel.body:
            args = tuple(same.get(arg, arg) for arg in line.args)
            texts = [arg if isinstance(arg, str) else repr(arg) for arg in args]  # in which 0.0 and -0.0 differ
            if line.op in self.commutative:
                texts.sort()
            key = line.op, tuple(texts)
            if key in known:
                same[line.target] = known[key]
            else:
                known[key] = line.target
                body.append(Assignment(line.target, line.op, args))
        return replace(kernel, body=tuple(body), outputs=tuple(same.get(o, o) for o in kernel.outputs))


@final
@dataclass(frozen=True)
class FuseProducts:
    """Fuse products that only one sum or difference uses with it, as ``fma``."""

    name: ClassVar[str] = "fuse products"

    def __call__(self, kernel: Kernel) -> Kernel:
        """Return the kernel after the pass."""
        uses, namer = _uses(kernel), _namer(kernel)
        products = {line.target: line for line in kernel.body if line.op == "mul" and uses[line.target] == 1}
        taken: set[str] = set()
        body: list[Assignment] = []
        for line in kernel.body:
            place = next((i for i in (1, 0) if line.op in ("add", "sub") and line.args[i] in products), None)
            if place is None:
                body.append(line)
                continue
            product, other = products[str(line.args[place])], line.args[1 - place]
            a, b = product.args
            if line.op == "sub":
                sign = namer(f"{line.target}_minus")
                body.append(Assignment(sign, "neg", (a if place else other,)))
                a, other = (sign, other) if place else (a, sign)
            taken.add(product.target)
            body.append(Assignment(line.target, "fma", (a, b, other)))
        lines = tuple(line for line in body if line.target not in taken)
        return replace(kernel, body=lines)
