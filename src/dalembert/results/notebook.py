"""Texts that notebooks show of results."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from ..arrays import FloatArray

__all__ = ["ranges", "summary"]


def summary(title: str, facts: Iterable[tuple[str, object]], head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return HTML: a title, pairs of a name and a value, and a table."""
    items = "".join(f"<li>{escape(name)}: {escape(str(value))}</li>" for name, value in facts)
    heads = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    table = f"<table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>"
    return f"<div><b>{escape(title)}</b><ul>{items}</ul>{table}</div>"


def ranges(names: Iterable[str], columns: Iterable[FloatArray]) -> list[tuple[str, ...]]:
    """Return name, least, largest and last number of columns of numbers."""
    rows = []
    for name, column in zip(names, columns, strict=True):
        finite = column[np.isfinite(column)]
        cells = (finite.min(), finite.max(), column.ravel()[-1]) if finite.size else (np.nan,) * 3
        rows.append((name, *(f"{x:.6g}" for x in cells)))
    return rows
