"""Named fields of the text form of a program: printers and readers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from copy import copy
from typing import Any, final

import numpy as np

from ..errors import list_names
from ..frozen import frozen
from .notation import Reader, literal_text, word
from .surfaces import Surface
from .tables import PieceNumbers, Table, registered, table_of

_WIDTH, _INDENT = 100, 16
"""Columns up to which a list continues on one line, and the column that values begin at."""


@final
@frozen
class _Field:
    """Printer of a value, as items, and its reader; one left out of a text is `default`, if that is not None."""

    items: Callable[[Any], list[str]]
    read: Callable[[Reader], Any]
    default: Any


def _read_flag(reader: Reader) -> bool:
    if reader.take("yes"):
        return True
    reader.require("no")
    return False


def _aliases(values: Mapping[str, str]) -> list[str]:
    return [word(key) if key == value else f"{word(key)}: {word(value)}" for key, value in values.items()]


def _mapped(item: Callable[[Any], str]) -> Callable[[Mapping[str, Any]], list[str]]:
    return lambda values: [f"{word(key)}: {item(value)}" for key, value in values.items()]


def _read_mapping(value: Callable[[Reader], Any], *, short: bool = False) -> Callable[[Reader], dict[str, Any]]:
    """Return the reader of a mapping; in a short one, a key alone stands for itself."""

    def read(reader: Reader) -> dict[str, Any]:
        entries: dict[str, Any] = {}

        def entry() -> None:
            key = reader.word()
            if key in entries:
                reader.fail(f"no second value of {key!r}")
            if not reader.take(":"):
                if not short:
                    reader.fail("':'")
                entries[key] = key
            else:
                entries[key] = value(reader)

        reader.listed(entry)
        return entries

    return read


def _read_kinds(reader: Reader) -> tuple[str, ...]:
    def kinds() -> Iterator[str]:
        while reader.sees_word():
            yield reader.word()

    return tuple(kinds())


_NAME = _Field(lambda value: [word(value)], Reader.word, None)
_TEXT = _Field(lambda value: [word(value)], Reader.word, "")
_FLAG = _Field(lambda value: ["yes" if value else "no"], _read_flag, False)
_COUNT = _Field(lambda value: [str(value)], Reader.whole, None)
_NAMES = _Field(lambda values: list(map(word, values)), lambda reader: tuple(reader.listed(reader.word)), ())
_ALIASES = _Field(_aliases, _read_mapping(Reader.word, short=True), {})
_NUMBERS = _Field(_mapped(literal_text), _read_mapping(Reader.number), {})
_ASSUMPTIONS = _Field(_mapped(lambda kinds: " ".join(map(word, kinds))), _read_mapping(_read_kinds), {})

PROGRAM_FIELDS: dict[str, _Field] = {
    "formulation": _NAME,
    "notes": _NAMES,
    "nonanalytic": _FLAG,
    "energy_note": _TEXT,
}
LAYOUT_FIELDS: dict[str, _Field] = {
    "coordinates": _NAMES,
    "rates": _NAMES,
    "parameters": _NAMES,
    "unknowns": _NAMES,
    "undetermined": _NAMES,
    "state": _NAMES,
    "outputs": _NAMES,
    "constraints": _NAMES,
    "holonomic": _COUNT,
    "constants": _COUNT,
    "defaults": _NUMBERS,
    "entries": _NAMES,
    "assumptions": _ASSUMPTIONS,
    "inputs": _NAMES,
    "states": _NAMES,
    "held": _NAMES,
    "angles": _NAMES,
    "aliases": _ALIASES,
}


def field_lines(fields: Mapping[str, _Field], values: object) -> list[str]:
    """Return the lines of the fields of an object; those that are as by default are left out."""
    lines: list[str] = []
    for key, field in fields.items():
        value = getattr(values, key)
        if value == field.default:
            continue
        line = f"  {key:<{_INDENT - 2}}"
        items = field.items(value)
        for i, item in enumerate(items):
            text = item if i == len(items) - 1 else f"{item}, "
            if len(line) + len(text) > _WIDTH and len(line) > _INDENT:
                lines.append(line.rstrip())
                line = " " * _INDENT
            line += text
        lines.append(line)
    return lines


def read_fields(reader: Reader, fields: Mapping[str, _Field]) -> dict[str, Any]:
    """Return the values of the fields that come next in a text, one a line, and the defaults of those left out."""
    values: dict[str, Any] = {}
    while not (reader.done or any(map(reader.sees, ("table", "surface", "kernel", "conditions")))):
        left = [key for key in fields if key not in values]
        key = next((key for key in left if reader.take(key)), None)
        if key is None:
            reader.fail(f"one of {list_names(left)}, or 'kernel'")
        values[key] = fields[key].read(reader)
        reader.end_line()
    for key, field in fields.items():
        if key not in values:
            if field.default is None:
                reader.fail(f"{key!r} of the program")
            values[key] = copy(field.default)
    return values


# Text form of tables in programs: printer and reader.


def table_text(table: PieceNumbers) -> str:
    """Return a table or a surface in the notation of `dalembert.ir.notation`; `read_table` reads it back."""

    def numbers(values: np.ndarray) -> str:
        return ", ".join(literal_text(value) for value in values)

    if isinstance(table, Surface):
        lines = [f"surface {table.key}", f"  name {word(table.name)}"]
        lines.append(f"  axes {', '.join(str(axis.key) for axis in table.axes)}")
        lines.append(f"  cells {', '.join(map(str, table.coefficients.shape))}")
        lines += [f"  column {numbers(column.ravel())}" for column in table.coefficients]
        return "\n".join(lines)
    assert isinstance(table, Table)
    lines = [f"table {table.key}", f"  name {word(table.name)}", f"  smoothness {table.smoothness}"]
    lines.append(f"  range {literal_text(table.first)}, {literal_text(table.last)}")
    lines += [f"  edges {numbers(table.edges)}", f"  origins {numbers(table.origins)}"]
    lines += [f"  power {k} {numbers(column)}" for k, column in enumerate(table.coefficients.T)]
    return "\n".join(lines)


def read_table(reader: Reader) -> PieceNumbers:
    """Return the table or surface that comes next in a text, and register it.

    The digest that it begins with must be its own.
    """
    kind = "surface" if reader.sees("surface") else "table"
    reader.require(kind)
    key = reader.whole(f"the key of the {kind}")
    reader.end_line()
    reader.require("name")
    name = reader.word(f"the name of the {kind}")
    reader.end_line()
    read = _read_surface if kind == "surface" else _read_curve
    found = read(reader, name)
    if found.key != key:
        reader.fail(f"a {kind} with the digest {key}, which is {found.key},")
    return registered(found)


def _read_surface(reader: Reader, name: str) -> PieceNumbers:
    reader.require("axes")
    first, second = reader.listed(lambda: reader.whole("the key of an axis"))
    reader.end_line()
    reader.require("cells")
    shape = reader.listed(reader.whole)
    reader.end_line()
    columns: list[list[float]] = []
    while reader.sees("column"):
        reader.require("column")
        columns.append(reader.listed(reader.number))
        reader.end_line()
    return Surface(name, (table_of(first), table_of(second)), np.array(columns).reshape(shape))


def _read_curve(reader: Reader, name: str) -> PieceNumbers:
    reader.require("smoothness")
    smoothness = reader.whole()
    reader.end_line()

    def numbers(title: str) -> list[float]:
        reader.require(title)
        found = reader.listed(reader.number)
        reader.end_line()
        return found

    first, last = numbers("range")
    edges, origins = numbers("edges"), numbers("origins")
    columns: list[list[float]] = []
    while reader.sees("power"):
        reader.require("power", str(len(columns)))
        columns.append(reader.listed(reader.number))
        reader.end_line()
    return Table(name, np.array(edges), np.array(origins), np.array(columns).T, smoothness, first, last)
