"""Functions of the subset specialised for one program: [RunLoop, names of kernels] -> source text of Python for numba.

The text is that of the functions themselves. What is constant for the program is evaluated, branches that are never
taken are left out, and calls of code at addresses become calls of functions. This is partial evaluation as in N. D.
Jones, C. K. Gomard, P. Sestoft, Partial Evaluation and Automatic Program Generation, chapter 3. The memory of a run is
text too: named tuples of arrays, and records of numbers.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from ...naming import Namer
from ...subset.arguments import Record
from ..c.run_loops import RunLoop
from .specialised_functions import Known, Part, SpecialisedFunction, is_docstring


@final
class RunMemory:
    """The text that makes the arguments of a loop.

    Parameters
    ----------
    arguments : NamedTuple
        Of the loop.
    read : set of str
        Dotted names that its functions read; nothing else is made.

    Attributes
    ----------
    types : list of str
        Lines that define the named tuples, each after those that it holds.
    value : list of str
        Lines of the expression that makes the arguments.
    resets : list of str
        Lines that set to 0 what is 0 before a run, of the arguments ``run``.
    """

    def __init__(self, arguments: Any, read: set[str]) -> None:
        self._read, self._namer = read, Namer(("namedtuple", "np", "numba", "math", "record"))
        self._names: dict[tuple[str, tuple[str, ...]], str] = {}
        self.types: list[str] = []
        self.resets: list[str] = []
        self.value = self._group(arguments, "")

    def _parts(self, group: Any, path: str) -> list[tuple[str, Any, str]]:
        """Return the fields of a group that are read, their values and dotted names."""
        found = []
        for name in group._fields:
            place, value = f"{path}.{name}".lstrip("."), getattr(group, name)
            group_of_parts = isinstance(value, tuple) and hasattr(value, "_fields")
            if (group_of_parts and self._parts(value, place)) or (not group_of_parts and place in self._read):
                found.append((name, value, place))
        return found

    def _group(self, group: Any, path: str) -> list[str]:
        parts = self._parts(group, path)
        numbers = {name: value for name, value, _ in parts if isinstance(value, int | float)}
        if len(numbers) == len(parts):
            return [self._record(path, {name: isinstance(value, float) for name, value in numbers.items()})]
        lines = []
        for name, value, place in parts:
            first, *rest = self._value(value, place)
            lines += [f"    {name}={first}", *(f"    {line}" for line in rest)]
            lines[-1] += ","
        return [f"{self._type(type(group).__name__, tuple(name for name, _, _ in parts))}(", *lines, ")"]

    def _value(self, value: Any, path: str) -> list[str]:
        if isinstance(value, Record):
            kinds = zip(value.kind.names, value.kind.items, strict=True)
            return [self._record(path, {name: item.type == "double" for name, item in kinds})]
        return self._group(value, path) if isinstance(value, tuple) else [self._array(path, value)]

    def _type(self, name: str, fields: tuple[str, ...]) -> str:
        if (name, fields) not in self._names:
            self._names[name, fields] = made = self._namer(name)
            self.types.append(f'{made} = namedtuple("{made}", "{" ".join(fields)}")')
        return self._names[name, fields]

    def _record(self, path: str, numbers: dict[str, bool]) -> str:
        """Return a record of numbers, which are floats or integers."""
        floats = " ".join(name for name, is_float in numbers.items() if is_float)
        integers = " ".join(name for name, is_float in numbers.items() if not is_float)
        self.resets += [f"run.{path}.{name} = {'0.0' if is_float else '0'}" for name, is_float in numbers.items()]
        return f'record("{floats}", "{integers}")'

    def _array(self, path: str, array: Any) -> str:
        kind = "" if array.dtype == np.float64 else f", np.{array.dtype}"
        if array.any() or not array.size:
            return f"np.array({array.tolist()}{kind})" if array.size else f"np.zeros({array.shape}{kind})"
        self.resets.append(f"run.{path}[...] = 0")
        return f"np.zeros({array.shape}{kind})"


@final
@dataclass
class _Made:
    """A specialised function: its name, the parameters that are left, and its result where that is known."""

    name: str
    kept: list[int]
    result: Known | None
    empty: bool


@final
class SpecialisedLoops:
    """The functions of a loop for one program.

    Attributes
    ----------
    texts : list of str
        Functions, each after those that it calls.
    constants : dict of str to number
        Names of numbers that the functions read.
    touched : set of str
        Dotted names of the arguments that the functions have had before unread variables were left out.
    """

    def __init__(self, loop: RunLoop, kernels: Mapping[str, str], taken: frozenset[str]) -> None:
        self._loop, self._names = loop, {number: kernels[key] for number, key in enumerate(loop.kernels, 1)}
        self._whole = Part("", loop.arguments)
        self.texts: list[str] = []
        self.constants: dict[str, int | float] = {}
        self.touched: set[str] = set()
        self._made: dict[Any, _Made] = {}
        self._name = Namer(taken)

    @property
    def read(self) -> set[str]:
        """Dotted names of the arguments that the functions read."""
        named = {
            node.attr for text in self.texts for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Attribute)
        }
        return {path for path in self.touched if path.split(".")[-1] in named}

    def entry(self, function: Any) -> str:
        """Specialise a function of the arguments of the loop, and perhaps of a number; return its name."""
        count = len(inspect.signature(function).parameters)
        return self.specialised(function, [self._whole, *[None] * (count - 1)]).name

    def specialised(self, function: Any, given: list[Known | Part | None]) -> _Made:
        """Return a function for values that are known, parts, and others (None)."""
        key = function, tuple(_key(value) for value in given)
        if key not in self._made:
            tree: Any = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
            names = [argument.arg for argument in tree.args.args]
            one = SpecialisedFunction(self, function, tree, dict(zip(names, given, strict=True)))
            body = _without_unread(one.block(tree.body))
            while body and isinstance(body[-1], ast.Return) and body[-1].value is None:
                body.pop()
            code = [line for line in body if not is_docstring(line)]
            result = one.returned if len(code) == 1 and isinstance(code[0], ast.Return) else None
            used = {node.id for line in code for node in ast.walk(line) if isinstance(node, ast.Name)}
            kept = [i for i, name in enumerate(names) if name in used or (i == 0 and given[0] == self._whole)]
            made = _Made(self._name(function.__name__.lower()), kept, result, not code)
            if code and result is None:
                arguments = [names[i] for i in kept]
                self.texts.append(_printed(made.name, arguments, body))
            self._made[key] = made
        return self._made[key]

    def is_given(self, path: str) -> bool:
        """Return whether runs set this number."""
        return path in self._loop.given

    def kernel(self, number: int) -> str:
        """Return the function that stands at an address."""
        return self._names[number]


def _key(value: Known | Part | None) -> Any:
    return value.path if isinstance(value, Part) else (type(value.value), value.value) if value is not None else None


def _printed(name: str, arguments: list[str], body: list[ast.stmt]) -> str:
    made = ast.parse(f"def {name}({', '.join(arguments)}):\n    pass").body[0]
    assert isinstance(made, ast.FunctionDef)
    made.body = body
    return "@numba.njit(**ENTRY)\n" + ast.unparse(ast.fix_missing_locations(made)) + "\n"


def _without_unread(body: list[ast.stmt]) -> list[ast.stmt]:
    """Return statements without assignments to names that are never read."""
    while True:
        read = {
            node.id
            for line in body
            for node in ast.walk(line)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)
        }
        dropped = _Unread(read)
        body = [line for statement in body if (line := dropped.visit(statement)) is not None]
        if not dropped.changed:
            return body


class _Unread(ast.NodeTransformer):
    """Leaves out assignments to names that are not read; values with calls stay."""

    def __init__(self, read: set[str]) -> None:
        self.read, self.changed = read, False

    def visit_Assign(self, node: ast.Assign) -> ast.stmt | None:
        (target,) = node.targets[-1:]
        calls = any(isinstance(part, ast.Call) for part in ast.walk(node.value))
        if len(node.targets) > 1 or not isinstance(target, ast.Name) or target.id in self.read or calls:
            return node
        self.changed = True
        return None
