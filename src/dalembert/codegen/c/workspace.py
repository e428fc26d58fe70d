"""The arguments of a loop as one C structure, whose arrays lie in it.

A loop is exported with arguments that have been made for it: numbers among them become literals, arrays become members
of so many elements, and addresses names of functions. What a run sets is given by the dotted names of fields.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any, final

import numpy as np

from ...subset.arguments import kind_of
from ...subset.compiled_subset import FLAG, NUMBER, Array, Fields, Group, Kind
from .expressions import TYPES, Known
from .printing import double


@final
@dataclass
class Workspace:
    """The members of a structure, and where the arguments of a loop are.

    Attributes
    ----------
    members : list of (str, tuple of str)
        Name, and lines of the declaration, of each member: of arrays and numbers, whose names are dotted.
    beginning : list of (str, str)
        Elements and the literals that they begin with, where that is not zero.
    constants : list of (str, str, list of str)
        C type, name and elements of arrays that never change.
    leaves : dict of int to tuple of str
        Words of each argument, by the place of its first word.
    """

    members: list[tuple[str, tuple[str, ...]]] = field(default_factory=list)
    beginning: list[tuple[str, str]] = field(default_factory=list)
    constants: list[tuple[str, str, list[str]]] = field(default_factory=list)
    leaves: dict[int, tuple[str, ...]] = field(default_factory=dict)

    def leaf(self, place: int) -> tuple[str, ...]:
        """Return the words of the argument whose first word has this place among all."""
        return self.leaves[place]

    def members_used(self, text: str, needed: Collection[str]) -> list[str]:
        """Return the declarations, line by line, of the members that a text uses or that are needed."""
        names = {match.removeprefix("run->") for match in _MEMBER.findall(text)} | set(needed)
        names |= {name.partition("[")[0] for name in needed}
        wanted = [(name, lines) for name, lines in self.members if any(_within(name, used) for used in names)]
        return _nested([(name.split("."), lines) for name, lines in wanted])


_MEMBER = re.compile(r"run->[\w.]+")


def _within(name: str, used: str) -> bool:
    return used == name or used.startswith(f"{name}.")


def _nested(members: list[tuple[list[str], tuple[str, ...]]]) -> list[str]:
    """Return declarations, those with common first names in structures."""
    lines: list[str] = []
    for first, group in groupby(members, lambda member: (member[0][0], len(member[0]) == 1)):
        if first[1]:
            lines += [line for _, own in group for line in own]
            continue
        inner = _nested([(path[1:], own) for path, own in group])
        lines += ["struct {", *(f"    {line}" for line in inner), f"}} {first[0]};"]
    return lines


def workspace_of(
    arguments: tuple[Any, ...], given: frozenset[str], constant: frozenset[str], codes: Mapping[int, str]
) -> Workspace:
    """Return arguments of a loop as a C structure.

    Parameters
    ----------
    arguments : NamedTuple
    given : frozenset of str
        Dotted names of numbers that a run sets; others are as in `arguments`.
    constant : frozenset of str
        Dotted names of arrays that never change.
    codes : mapping of int to str
        Names of the functions at addresses among the arguments.
    """
    return _Layout(given, constant, codes).of(arguments)


@final
class _Layout:
    def __init__(self, given: frozenset[str], constant: frozenset[str], codes: Mapping[int, str]) -> None:
        self.given, self.constant, self.codes = given, constant, codes
        self.found, self.place = Workspace(), 0

    def of(self, arguments: tuple[Any, ...]) -> Workspace:
        """See `workspace_of`."""
        self._group(arguments, kind_of(type(arguments)), "")
        return self.found

    def _group(self, group: tuple[Any, ...], kind: Kind, path: str) -> None:
        assert isinstance(kind, Group)
        for name, part, value in zip(kind.names, kind.parts, group, strict=True):
            inner = f"{path}.{name}".strip(".")
            if isinstance(part, Group):
                self._group(value, part, inner)
                continue
            self.found.leaves[self.place] = self._member(name, part, value, inner)
            self.place += len(part.words)

    def _member(self, name: str, kind: Kind, value: Any, path: str) -> tuple[str, ...]:
        """Declare a member, and return the words of the argument."""
        if isinstance(kind, Array):
            return self._array(name, kind, value, path)
        if isinstance(kind, Fields):
            inner = [f"    {TYPES[item]} {field};" for field, item in zip(kind.names, kind.items, strict=True)]
            self.found.members.append((path, ("struct {", *inner, f"}} {name};")))
            return (Known(f"run->{path}"),)
        if path in self.given:
            self.found.members.append((path, (f"{TYPES[kind]} {name};",)))  # type: ignore[index]
            return (f"run->{path}",)
        return (self._literal(kind, value),)

    def _literal(self, kind: Kind, value: Any) -> str:
        if kind == NUMBER:
            return double(float(value))
        if kind == FLAG:
            return "true" if value else "false"
        if not getattr(kind, "owned", False):
            return str(int(value))
        return Known(self.codes[int(value)]) if value else "0"

    def _array(self, name: str, kind: Array, value: Any, path: str) -> tuple[str, ...]:
        shape = tuple(map(str, value.shape)) if not kind.item.owned else (str(value.size),)
        if kind.item.owned and value.size:
            raise TypeError(f"{path}: tables of addresses are not exported")
        if path in self.constant and value.size:
            own = f"constant_{path.replace('.', '_')}"
            self.found.constants.append((TYPES[kind.item], own, [self._literal(kind.item, x) for x in np.ravel(value)]))
            return Known(own), *shape
        # of what has no elements code may be there that never runs
        self.found.members.append((path, (f"{TYPES[kind.item]} {name}[{max(value.size, 1)}];",)))
        if value.size:
            places = np.flatnonzero(np.ravel(value))
            self.found.beginning += [(f"{path}[{i}]", self._literal(kind.item, np.ravel(value)[i])) for i in places]
        return Known(f"run->{path}"), *shape
