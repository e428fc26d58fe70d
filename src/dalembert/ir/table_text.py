"""Text form of tables in programs: printer and reader."""

from __future__ import annotations

import numpy as np

from .notation import Reader, literal_text, word
from .tables import Table, registered

__all__ = ["read_table", "table_text"]


def table_text(table: Table) -> str:
    """Return a table in the notation of `dalembert.ir.notation`; `read_table` reads it back."""

    def numbers(values: np.ndarray) -> str:
        return ", ".join(literal_text(value) for value in values)

    lines = [f"table {table.key}", f"  name {word(table.name)}", f"  smoothness {table.smoothness}"]
    lines.append(f"  range {literal_text(table.first)}, {literal_text(table.last)}")
    lines += [f"  edges {numbers(table.edges)}", f"  origins {numbers(table.origins)}"]
    lines += [f"  power {k} {numbers(column)}" for k, column in enumerate(table.coefficients.T)]
    return "\n".join(lines)


def read_table(reader: Reader) -> Table:
    """Return the table that comes next in a text, and register it; the digest that it begins with must be its own."""
    reader.require("table")
    key = reader.whole("the key of the table")
    reader.end_line()
    reader.require("name")
    name = reader.word("the name of the table")
    reader.end_line()
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
    table = Table(name, np.array(edges), np.array(origins), np.array(columns).T, smoothness, first, last)
    if table.key != key:
        reader.fail(f"a table with the digest {key}, which is {table.key},")
    return registered(table)
