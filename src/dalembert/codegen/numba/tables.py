"""Tables in numba modules: numbers of their pieces, and the search for a piece."""

from __future__ import annotations

import re
from typing import Any

from ...ir.tables import table_of
from ..rendering import render

__all__ = ["table_definitions"]

_SEARCH, _ARRAY = re.compile(r"\b_piece_(\d+)\("), re.compile(r"\b_table_(\d+)_(\d+)\(")


def table_definitions(text: str) -> str:
    """Return the definitions of what printed functions use of tables; nothing where they use none."""
    searched, read = dict.fromkeys(_SEARCH.findall(text)), dict.fromkeys(_ARRAY.findall(text))
    if not searched and not read:
        return ""
    rows = [(key, "edges", table_of(int(key)).edges) for key in searched]
    rows += [(key, row, table_of(int(key)).row(int(row))) for key, row in read]
    variables: dict[str, Any] = {
        "arrays": [{"name": f"_table_{key}_{row}", "numbers": _listed(values)} for key, row, values in rows],
        "searches": [{"key": key, "count": len(table_of(int(key)).edges)} for key in searched],
    }
    return render("numba/tables.py.j2", variables)


def _listed(values: Any) -> str:
    """Return numbers as an expression of Python."""
    printed = (repr(float(value)) for value in values)
    return "[" + ", ".join("math.nan" if number == "nan" else number for number in printed) + "]"
