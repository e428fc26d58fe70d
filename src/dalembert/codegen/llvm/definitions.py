"""What modules of LLVM assembly use besides their own functions: elementary functions, tables, compiled functions."""

from __future__ import annotations

import re
from typing import Any

from ...ir.calls import SYMBOL, function_of
from ...ir.tables import numbers_of, table_of
from ..rendering import render
from .elementary_text import elementary_functions
from .lane_printer import gathered
from .target import constant, integer, suffix, vector

_SEARCH, _ARRAY = re.compile(r"@table_piece(\d+)\("), re.compile(r"@table\.(\d+)\.(\d+|edges)\b")
_CALLED = re.compile(rf"@{SYMBOL}(\d+)\(")


def with_definitions(text: str) -> str:
    """Return a module of assembly with the elementary functions and tables that it uses, and compiled ones declared."""
    names = list(dict.fromkeys(_ARRAY.findall(text)))
    text += elementary_functions(text) + "".join(f"\n{declaration}\n" for declaration in _declarations(text))
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


def _declarations(text: str) -> list[str]:
    counts = {key: function_of(key).count for key in dict.fromkeys(_CALLED.findall(text))}
    return [f"declare double @{SYMBOL}{key}({', '.join(['double'] * count)})" for key, count in counts.items()]


def _array(key: str, row: str) -> dict[str, Any]:
    values = table_of(int(key)).edges if row == "edges" else numbers_of(int(key)).row(int(row))
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
        "load": gathered(lanes, "edge", "%at"),
    }
