"""The files of the corpus: one line of JSON an entry."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

__all__ = ["NAMED", "RANDOM", "entries", "written"]

FOLDER = Path(__file__).parent
RANDOM = FOLDER / "random.json"
NAMED = FOLDER / "named.json"


def entries(file: Path) -> list[dict[str, Any]]:
    """Return the entries of a file."""
    kept: list[dict[str, Any]] = json.loads(file.read_text()) if file.exists() else []
    return kept


def written(file: Path, rows: list[dict[str, Any]]) -> None:
    """Write entries, one a line."""
    lines = ",\n".join(json.dumps(row, separators=(",", ":"), ensure_ascii=False) for row in rows)
    file.write_text(f"[\n{lines}\n]\n")
