"""The arguments of a loop as one C structure, whose arrays lie in it.

A loop is exported with arguments that have been made for it: numbers among them become literals, arrays become members
of so many elements, and addresses names of functions. What a run sets is given by the dotted names of fields.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any, final

import numpy as np

from ...subset.arguments import AddressTable, kind_of
from ...subset.compiled_subset import FLAG, INTEGER, NUMBER, Array, Fields, Group, Kind
from .expressions import TYPES
from .printing import Code, Constant, Kernel, Known, Loop, Pointer, double, member_name

KERNELS, LOOPS, NOTHING = "kernels", "loops", "nothing"
"""Kinds of entries of a table of addresses."""


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
    bases : dict of str to str
        What addresses in a table are: those of kernels (`KERNELS`) or loops (`LOOPS`), none (`NOTHING`), or places
        behind a member.
    """

    members: list[tuple[str, tuple[str, ...]]] = field(default_factory=list)
    beginning: list[tuple[str, str]] = field(default_factory=list)
    constants: list[tuple[str, str, list[str]]] = field(default_factory=list)
    leaves: dict[int, tuple[str, ...]] = field(default_factory=dict)
    bases: dict[str, str] = field(default_factory=dict)

    def address(self, table: str, word: str) -> str:
        """Return an address in a table of addresses, from the element there."""
        base = self.bases[table]
        if base in (KERNELS, LOOPS):
            return Code(word) if base == KERNELS else Loop(word)
        return Pointer(f"({base} + {word})") if base != NOTHING else "0"

    def leaf(self, place: int) -> tuple[str, ...]:
        """Return the words of the argument whose first word has this place among all."""
        return self.leaves[place]

    def members_used(self, text: str, needed: Collection[str]) -> list[str]:
        """Return the declarations, line by line, of the members that a text uses or that are needed."""
        names = _names_used(text, needed)
        wanted = [(name, lines) for name, lines in self.members if name in names]
        return _nested([(name.split("."), lines) for name, lines in wanted])

    def beginning_used(self, text: str, needed: Collection[str]) -> list[tuple[str, str]]:
        """Return the elements of these members with their literals."""
        names = _names_used(text, needed)
        members = {name for name, _ in self.members if name in names}
        return [pair for pair in self.beginning if {pair[0].partition("[")[0], pair[0].rpartition(".")[0]} & members]


_MEMBER = re.compile(r"run->[\w.]+")


def _names_used(text: str, needed: Collection[str]) -> set[str]:
    """Return the members that a text uses, or that are needed, and those that they are in."""
    names = {match.removeprefix("run->") for match in _MEMBER.findall(text)} | set(needed)
    names |= {name.partition("[")[0] for name in needed}
    return names | {used[:place] for used in names for place, letter in enumerate(used) if letter == "."}


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
        self.memory: list[_Memory] = []

    def of(self, arguments: tuple[Any, ...]) -> Workspace:
        """See `workspace_of`."""
        self.memory = _memory_of(_arrays(arguments, kind_of(type(arguments)), ""))
        self._group(arguments, kind_of(type(arguments)), "")
        return self.found

    def _group(self, group: tuple[Any, ...], kind: Kind, path: str) -> None:
        assert isinstance(kind, Group)
        for name, part, value in zip(map(member_name, kind.names), kind.parts, group, strict=True):
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
            for field, item in zip(kind.names, kind.items, strict=True):
                if number := getattr(value, field):
                    self.found.beginning.append((f"{path}.{field}", self._literal(item, number)))
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
        if not value:
            return "0"
        word = self.codes[int(value)]
        return word if isinstance(word, Known) else Kernel(word)

    def _array(self, name: str, kind: Array, value: Any, path: str) -> tuple[str, ...]:
        """Return the words of an array, which is declared where it has memory of its own."""
        if kind.item.owned:
            return self._table(value, path), str(value.size)
        shape = tuple(map(str, value.shape))
        if not value.size:  # of what has no elements code may be there that never runs
            self.found.members.append((path, (f"{TYPES[kind.item]} {name}[1];",)))
            return Known(f"run->{path}"), *shape
        span = _span(value)
        own = next(memory for memory in self.memory if memory.holds(span))
        if own.path != path:
            return own.word(value), *shape
        if path in self.constant:
            word = Constant(f"constant_{path.replace('.', '_')}")
            self.found.constants.append(
                (TYPES[kind.item], word, [self._literal(kind.item, x) for x in np.ravel(value)])
            )
            own.data = word
            return word, *shape
        self.found.members.append((path, (f"{TYPES[kind.item]} {name}[{value.size}];",)))
        places = np.flatnonzero(np.ravel(value))
        self.found.beginning += [(f"{path}[{i}]", self._literal(kind.item, np.ravel(value)[i])) for i in places]
        return own.word(value), *shape

    def _table(self, value: AddressTable, path: str) -> str:
        """Return the name of a table of addresses: of functions, or of places in one array."""
        name, numbers = Known(f"constant_{path.replace('.', '_')}"), [value[i] for i in range(value.size)]
        if not any(numbers):
            self.found.bases[name] = NOTHING
        elif all(number in self.codes for number in numbers if number):
            words = [self.codes[number] if number else "0" for number in numbers]
            self.found.bases[name] = LOOPS if any(isinstance(word, Loop) for word in words) else KERNELS
            self.found.constants.append((self.found.bases[name], name, words))
        else:
            own = next(memory for memory in self.memory if memory.begin <= min(numbers) and max(numbers) < memory.end)
            self.found.bases[name] = own.data
            offsets = [str((number - own.begin) // own.array.itemsize) for number in numbers]
            self.found.constants.append((TYPES[INTEGER], name, offsets))
        return name


# Memory that arguments share.


@final
@dataclass
class _Memory:
    """Memory from `begin` to `end`, of an array that others are views of, and its name in C."""

    path: str
    array: Any
    begin: int
    end: int
    data: str

    def holds(self, span: tuple[int, int]) -> bool:
        """Return whether an array with this begin and end lies in it."""
        return self.begin <= span[0] and span[1] <= self.end

    def word(self, array: Any) -> Known:
        """Return the address of the first element of an array in it."""
        place = (_span(array)[0] - self.begin) // self.array.itemsize
        return Known(f"&{self.data}[{place}]" if place else self.data)


def _span(array: Any) -> tuple[int, int]:
    begin = int(array.__array_interface__["data"][0])
    return begin, begin + array.nbytes


def _arrays(group: tuple[Any, ...], kind: Kind, path: str) -> Iterator[tuple[str, Any]]:
    """Yield the names and arrays among arguments, those with elements."""
    assert isinstance(kind, Group)
    for name, part, value in zip(map(member_name, kind.names), kind.parts, group, strict=True):
        inner = f"{path}.{name}".strip(".")
        if isinstance(part, Group):
            yield from _arrays(value, part, inner)
        elif isinstance(part, Array) and not part.item.owned and value.size:
            yield inner, value


def _memory_of(arrays: Iterable[tuple[str, Any]]) -> list[_Memory]:
    """Return the arrays that have memory of their own: no other holds them; of equal ones, the first.

    Raises
    ------
    TypeError
        Where two overlap in part.
    """
    found: list[_Memory] = []
    ordered = sorted(enumerate(arrays), key=lambda item: (_span(item[1][1])[0], -item[1][1].nbytes, item[0]))
    for _, (path, array) in ordered:
        begin, end = _span(array)
        if found and begin < found[-1].end:
            if end > found[-1].end or found[-1].array.dtype != array.dtype:
                raise TypeError(f"{path} and {found[-1].path} overlap: such arguments are not exported")
            continue
        found.append(_Memory(path, array, begin, end, f"run->{path}"))
    return found
