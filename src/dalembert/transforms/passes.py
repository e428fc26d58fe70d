"""Passes from kernel to kernel: frozen dataclasses with a name and options, run by `dalembert.transforms.pipelines`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, final

from ..frozen import frozen
from ..ir.kernel import Assignment, Kernel, Load, Operand
from ..ir.program import Program, hidden_parameters
from ..naming import Namer


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
        for arg in line.args:
            if isinstance(arg, str) and arg not in fixed:
                break
        else:
            fixed.add(line.target)
    return fixed


@final
@frozen
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
        if len(body) == len(kernel.body) and len(loads) == len(kernel.loads):
            return kernel
        return replace(kernel, body=tuple(reversed(body)), loads=loads)


@final
@frozen
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
@frozen
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
        if max(divisors.values(), default=0) < self.uses:
            return kernel
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
@frozen
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
        known: dict[tuple[str, ...], str] = {}
        body: list[Assignment] = []
        for line in kernel.body:
            args = tuple([same.get(arg, arg) for arg in line.args]) if same else line.args
            texts = [arg if isinstance(arg, str) else repr(arg) for arg in args]  # in which 0.0 and -0.0 differ
            if line.op in self.commutative:
                texts.sort()
            key = line.op, *texts
            first = known.setdefault(key, line.target)
            if first is not line.target:
                same[line.target] = first
            else:
                body.append(line if args is line.args else Assignment(line.target, line.op, args))
        if not same:
            return kernel
        return replace(kernel, body=tuple(body), outputs=tuple(same.get(o, o) for o in kernel.outputs))


@final
@frozen
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


# Hoisting of parameters: a pass that computes values of parameters alone once a run.


@final
@frozen
class HoistParameters:
    """Replace values that depend on parameters p alone by constants c, which a kernel ``prepare`` computes from p.

    The first entries of c are the parameters themselves; equal expressions of different kernels share an entry.
    Kernels take c in place of p; ``prepare`` becomes the first kernel of the program. Parameters of inputs, which
    change along a run, are entries of c, and what depends on them stays where it is.
    """

    name: ClassVar[str] = "hoist parameters"

    def __call__(self, program: Program) -> Program:
        """Return the program after the pass."""
        constants = _Constants(program.layout.parameters)
        changing = {name for u in program.layout.inputs for name in hidden_parameters(u)}
        places = frozenset(i for i, name in enumerate(program.layout.parameters) if name in changing)
        kernels = tuple(_without_parameters(kernel, constants, places) for kernel in program.kernels)
        prepare = EliminateDeadCode()(constants.kernel())
        layout = replace(program.layout, constants=len(prepare.outputs))
        return replace(program, kernels=(prepare, *kernels), layout=layout)


@final
class _Constants:
    """The constants of a program under construction."""

    def __init__(self, parameters: tuple[str, ...]) -> None:
        self._namer = Namer()
        self.parameters = [self._namer(name) for name in parameters]
        self._outputs: list[Operand] = list(self.parameters)
        self._slots = {name: i for i, name in enumerate(self.parameters)}
        self._body: list[Assignment] = []
        self._known: dict[tuple[str, tuple[Operand, ...]], str] = {}

    def value(self, line: Assignment, meaning: Mapping[str, str]) -> str:
        """Return the name of the value of a line; `meaning` has those of its operands."""
        args = tuple(meaning[a] if isinstance(a, str) else a for a in line.args)
        key = (line.op, args)
        if key not in self._known:
            self._known[key] = self._namer(line.target)
            self._body.append(Assignment(self._known[key], line.op, args))
        return self._known[key]

    def place(self, name: str) -> int:
        """Return the place of a value among the constants."""
        if name not in self._slots:
            self._slots[name] = len(self._outputs)
            self._outputs.append(name)
        return self._slots[name]

    def kernel(self) -> Kernel:
        """Return the kernel that computes the constants from the parameters."""
        loads = tuple(Load(name, "p", i) for i, name in enumerate(self.parameters))
        return Kernel("prepare", ("p",), loads, tuple(self._body), tuple(self._outputs))


def _without_parameters(kernel: Kernel, constants: _Constants, changing: frozenset[int]) -> Kernel:
    """Return a kernel that takes constants in place of parameters; some of these change along a run."""
    fixed = values_of(kernel, "p", changing)
    meaning = {load.target: constants.parameters[load.index or 0] for load in kernel.loads if load.array == "p"}
    for line in kernel.body:
        if line.target in fixed:
            meaning[line.target] = constants.value(line, meaning)
    body = tuple(line for line in kernel.body if line.target not in fixed)
    needed = {arg for line in body for arg in line.args} | set(kernel.outputs)
    loads = [load for load in kernel.loads if load.array != "p"]
    loads += [Load(local, "c", constants.place(name)) for local, name in meaning.items() if local in needed]
    arguments = tuple("c" if argument == "p" else argument for argument in kernel.arguments)
    return replace(kernel, arguments=arguments, loads=tuple(loads), body=body)
