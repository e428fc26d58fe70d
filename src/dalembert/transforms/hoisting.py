"""Hoisting of parameters: a pass that computes values of parameters alone once a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, final

from ..ir.input_parameters import hidden_parameters
from ..ir.kernel import Assignment, Kernel, Load, Operand
from ..ir.program import Program
from ..naming import Namer
from .passes import EliminateDeadCode, values_of

__all__ = ["HoistParameters"]


@final
@dataclass(frozen=True)
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
