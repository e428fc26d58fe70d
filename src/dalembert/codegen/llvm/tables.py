"""Tables in assembly: the search for a piece, numbers of pieces in every lane, and the arrays of both."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from ...ir.tables import table_of
from ..rendering import render
from .lane_types import constant, integer, suffix, vector

__all__ = ["entry_lines", "piece_lines", "with_tables"]

_SEARCH, _ARRAY = re.compile(r"@table_piece(\d+)\("), re.compile(r"@table\.(\d+)\.(\d+|edges)\b")


def piece_lines(lanes: int, target: str, args: Sequence[str], key: float) -> list[str]:
    """Return lines that set ``%target`` to the number of the piece that an operand lies in."""
    edges = f"ptr @table.{int(key)}.edges, i64 {len(table_of(key).edges)}"
    return [f"%{target} = call {vector(lanes)} @table_piece{lanes}({vector(lanes)} {args[0]}, {edges})"]


def entry_lines(lanes: int, target: str, args: Sequence[str], key: float, row: float) -> list[str]:
    """Return lines that set ``%target`` to a number of a piece."""
    v, integers = vector(lanes), vector(lanes, "i64")
    lines = [
        f"%{target}.place = fptosi {v} {args[0]} to {integers}",
        f"%{target}.at = getelementptr double, ptr @table.{int(key)}.{int(row)}, {integers} %{target}.place",
    ]
    return [*lines, *_gathered(lanes, target, f"%{target}.at")]


def _gathered(lanes: int, target: str, at: str) -> list[str]:
    """Return lines that load a number in every lane, from addresses."""
    if lanes == 1:
        return [f"%{target} = load double, ptr {at}, align 8"]
    every = f"<{', '.join(['i1 true'] * lanes)}>"
    given = f"{vector(lanes, 'ptr')} {at}, i32 8, {vector(lanes, 'i1')} {every}, {vector(lanes)} undef"
    return [f"%{target} = call {vector(lanes)} @llvm.masked.gather.{suffix(lanes)}.v{lanes}p0({given})"]


def with_tables(text: str) -> str:
    """Return a module of assembly with what it uses of tables."""
    names = list(dict.fromkeys(_ARRAY.findall(text)))
    if not names:
        return text
    searches = sorted({int(lanes) for lanes in _SEARCH.findall(text)})
    gathers = sorted({*searches, *map(int, re.findall(r"@llvm\.masked\.gather\.v\d+f64\.v(\d+)p0\(", text))} - {1})
    variables: dict[str, Any] = {
        "arrays": [_array(key, row) for key, row in names],
        "searches": [_search(lanes) for lanes in searches],
        "gathers": [{**_types(lanes), "lanes": lanes} for lanes in gathers],
    }
    return text + render("llvm/tables.ll.j2", variables)


def _array(key: str, row: str) -> dict[str, Any]:
    table = table_of(int(key))
    values = table.edges if row == "edges" else table.row(int(row))
    numbers = [constant(float(value), 1) for value in values]
    return {"name": f"table.{key}.{row}", "size": len(numbers), "numbers": numbers}


def _types(lanes: int) -> dict[str, str]:
    return {
        "vector": vector(lanes),
        "integers": vector(lanes, "i64"),
        "pointers": vector(lanes, "ptr"),
        "flags": vector(lanes, "i1"),
        "suffix": suffix(lanes),
    }


def _search(lanes: int) -> dict[str, Any]:
    return {
        **_types(lanes),
        "lanes": lanes,
        "zero": integer(0, lanes),
        "one": integer(1, lanes),
        "load": _gathered(lanes, "edge", "%at"),
    }
