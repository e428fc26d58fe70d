"""The memory of a run as text of Python for numba: named tuples of arrays, and records of numbers."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from ...naming import Namer
from ...subset.arguments import Record


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
