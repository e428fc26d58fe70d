"""Tables of what became of random scenes, for the terminal and for docs/reliability.md."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

__all__ = ["ORDER", "summary", "table"]

OUTCOMES = (
    "agree",
    "refused rightly",
    "set aside",
    "HANG",
    "CRASH",
    "FALSE REFUSAL",
    "BARE EXCEPTION",
    "WRONG",
    "BROKEN",
)
ORDER = {name: place for place, name in enumerate(OUTCOMES)}
"""Outcome -> how bad it is."""


def table(rows: Sequence[dict[str, Any]]) -> list[tuple[str, int, Counter[str]]]:
    """Return (what was compared, how often, outcomes) of all scenes and of each path."""
    lines = [("scenes, their worst path", len(rows), Counter(row["outcome"] for row in rows))]
    paths: dict[str, Counter[str]] = {}
    for row in rows:
        for path, (outcome, _) in row["paths"].items():
            paths.setdefault(path, Counter())[outcome] += 1
    lines += [(path, counts.total(), counts) for path, counts in sorted(paths.items())]
    return lines


def summary(rows: Sequence[dict[str, Any]]) -> str:
    """Return the tables as Markdown, with the reasons of what was set aside or refused."""
    if not rows:
        return "no results"
    heads = [name for name in OUTCOMES if any(counts[name] for _, _, counts in table(rows))]
    text = ["| compared | count | " + " | ".join(heads) + " |", "|---" * (len(heads) + 2) + "|"]
    for what, count, counts in table(rows):
        text.append(f"| {what} | {count} | " + " | ".join(str(counts[name]) for name in heads) + " |")
    for outcome in ("set aside", "refused rightly"):
        reasons = Counter(_reason(detail) for row in rows for kind, detail in row["paths"].values() if kind == outcome)
        if reasons:
            text += ["", f"{outcome}:", *(f"- {count} {reason}" for reason, count in reasons.most_common(12))]
    for key in ("family", "style"):
        counts = Counter(str(row.get(key)) for row in rows)
        text += ["", f"{key}: " + ", ".join(f"{name} {count}" for name, count in counts.most_common())]
    cpu = sum(row.get("cpu", 0.0) for row in rows)
    text += ["", f"{len(rows)} scenes, {cpu:.0f} s of processor time, {cpu / len(rows):.2f} s a scene"]
    return "\n".join(text)


def _reason(detail: str) -> str:
    """Return the part of a detail that scenes have in common."""
    words = detail.split(":")[0]
    return words.split(" by ")[0].split(" = ")[0][:70]
