"""Loops as C: the functions that they consist of, and the constants that they read."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from ...subset.arguments import kind_of
from ...subset.compiled_subset import FLAG, INTEGER, NUMBER, Array, Group, Kind
from ..subset.target import Value
from .expressions import TYPES, Arguments
from .printing import Constant, double, rows_of
from .statements import Function, is_static, translated
from .workspace import KERNELS, LOOPS, Workspace

_DTYPES = {"f": NUMBER, "i": INTEGER, "b": FLAG}


@final
class LoopSource:
    """The text of loops whose arguments are a structure.

    Parameters
    ----------
    arguments : Workspace
    prefix : str
        Of the names of functions; the C type of the structure is ``PREFIX_run``.
    fused : str
        Name of what rounds a product and a sum once where the target can.
    reserved : set of str
        Names that other functions of the source have.

    Attributes
    ----------
    used : set of str
        Names of the functions of the prelude that the source calls.
    functions : set of str
        Names of the functions so far.
    """

    def __init__(self, arguments: Workspace, prefix: str, fused: str, reserved: frozenset[str]) -> None:
        self.arguments: Arguments = arguments
        self.fused, self._prefix = fused, prefix
        self.used: set[str] = set()
        self.functions: set[str] = set()
        self._texts: list[list[str]] = []
        self._results: list[tuple[str, list[str]]] = []
        self._constants = [constant for constant in arguments.constants if constant[0] != LOOPS]
        self._of_loops = [constant for constant in arguments.constants if constant[0] == LOOPS]
        self._made: dict[Any, tuple[str, Function]] = {}
        self._kinds: dict[int, tuple[Kind, int]] = {}
        self._numbers: dict[Kind, int] = {}
        self._arrays: dict[int, tuple[Value, Any]] = {}
        self._taken = set(reserved)

    @property
    def text(self) -> str:
        """The constants, the types of results, and the functions, each after those that it calls."""
        parts = []
        for kind, name, numbers in self._constants:
            parts.append(_constant(_DECLARED.get(kind, f"const {kind}"), name, numbers))
        for name, members in self._results:
            parts.append([f"struct {name} {{", *(f"    {member}" for member in members), "};"])
        parts += self._texts
        return "".join("\n".join(["", *lines, ""]) for lines in parts)

    def add_tables_of_loops(self) -> None:
        """Write the tables of loops, behind the functions so far, which they name."""
        for kind, name, elements in self._of_loops:
            self._texts.append(_indented(_constant(_DECLARED[kind], name, elements), ""))

    def entry(self, function: Any, arguments: type[tuple[Any, ...]], *numbers: str, number: int | None = None) -> str:
        """Translate a function of the arguments of the loop, and of further doubles or an integer.

        Returns how it is called.
        """
        given = [Value(kind_of(arguments), (), "run"), *(Value(NUMBER, (word,)) for word in numbers)]
        given += [] if number is None else [Value(INTEGER, (str(number),))]
        text, _, constant = self.call(function, given)
        return text if constant is None else constant.words[0]

    def call(self, function: Any, given: list[Value]) -> tuple[str, Kind, Value | None]:
        """Return the text of a call, the kind of its result, and the result where it is constant."""
        words = [word for value in given for word in value.words]
        key = function, tuple(self._key(value) for value in given)
        if key not in self._made:
            # with the prefix no variable has the name of a function
            name = self._named(f"{self._prefix}_{function.__name__.strip('_').lower()}")
            made = translated(self, function, name, given)
            self._made[key] = name, made
            self.functions.add(name)
            if made.constant is None and not made.empty:
                self._texts.append(_indented(made.lines, f"{self._prefix}_run"))
                if isinstance(made.kind, Group) and made.kind.parts:
                    kinds = [TYPES[kind] for kind in made.kind.parts]  # type: ignore[index]
                    self._results.append((f"{name}_result", [f"{kind} part_{i};" for i, kind in enumerate(kinds)]))
        name, made = self._made[key]
        if made.empty:
            return "", made.kind, None
        passed = [*(["run"] if made.takes_run else []), *(words[place] for place in made.kept)]
        return f"{name}({', '.join(passed)})", made.kind, made.constant

    def _key(self, value: Value) -> Any:
        words = tuple(
            str(word) if is_static(word) else type(word).__name__ for word in value.words
        )  # of others, whether they are addresses counts
        return self._number_of(value.kind), words, value.base, value.first

    def _number_of(self, kind: Kind) -> int:
        """Return one number of all equal kinds: those of arguments are nested deeply, and compared once."""
        if id(kind) not in self._kinds:
            self._kinds[id(kind)] = kind, self._numbers.setdefault(kind, len(self._numbers))
        return self._kinds[id(kind)][1]

    def _named(self, wish: str) -> str:
        name, count = wish, 1
        while name in self._taken:
            count += 1
            name = f"{wish}_{count}"
        self._taken.add(name)
        return name

    def array(self, array: Any) -> Value:
        """See `Functions.array`."""
        if id(array) not in self._arrays:
            item = _DTYPES[array.dtype.kind]
            numbers = [double(float(x)) if item == NUMBER else str(int(x)) for x in np.ravel(array)]
            name = self._named(f"constant_{len(self._arrays)}")
            self._constants.append((TYPES[item], name, numbers))
            value = Value(Array(item, array.ndim), (Constant(name), *map(str, array.shape)))
            self._arrays[id(array)] = value, array
        return self._arrays[id(array)][0]


_DECLARED = {KERNELS: "kernel_function *const", LOOPS: "loop_function *const"}
"""C types of the elements of constant tables of addresses."""


def _constant(kind: str, name: str, elements: list[str]) -> list[str]:
    rows = [f"    {row}" for row in rows_of(elements)]
    return [f"static {kind} {name}[{len(elements)}] = {{", *rows, "};"]


def _indented(lines: list[str], run: str) -> list[str]:
    """Return lines with four spaces for each block around them, and the type of the arguments of the loop."""
    found, depth = [], 0
    for line in lines:
        depth -= line.startswith("}")
        found.append(f"{'    ' * depth}{line.replace('NAME_RUN', run)}")
        depth += line.endswith("{")
    return found
