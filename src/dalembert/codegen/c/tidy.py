"""Translated functions without what has no influence: values that nobody reads, detours, empty blocks."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection

NAME = re.compile(r"(?<![\w.>])[A-Za-z_]\w*")
"""A name in C, and not a member of something."""

_ASSIGNED = re.compile(r"\s*(\w+) = (.*);")
_PART = re.compile(r"(part_\d+) = (.*);")
_CALL = re.compile(r"\w+\(.*\)")
_BLOCKS = ("if (", "for (")


def tidied(lines: list[str], variables: Collection[str], functions: Collection[str]) -> list[str]:
    """Return the lines of a function without what has no influence.

    Parameters
    ----------
    lines : list of str
        Statements; blocks begin with ``{`` at the end of a line, and end with a line of their own.
    variables : collection of str
        Variables of the function.
    functions : collection of str
        Functions that may change memory; others are of their arguments alone.
    """
    while True:
        kept = _without_empty_blocks(_without_unread(lines, variables, functions))
        if kept == lines:
            return _without_detours(lines)
        lines = kept


def _without_unread(lines: list[str], variables: Collection[str], functions: Collection[str]) -> list[str]:
    """Return lines without assignments to variables that are never read; calls among them stay."""
    read: set[str] = set()
    for line in lines:
        found = _ASSIGNED.fullmatch(line)
        read |= set(NAME.findall(found[2] if found and found[1] in variables else line))
    kept = []
    for line in lines:
        found = _ASSIGNED.fullmatch(line)
        if found is None or found[1] not in variables or found[1] in read:
            kept.append(line)
        elif _CALL.fullmatch(found[2]) and found[2].split("(")[0] in functions:
            kept.append(f"{found[2]};")
    return kept


def _without_empty_blocks(lines: list[str]) -> list[str]:
    """Return lines without blocks in which nothing is left; loops that count have an end."""
    found: list[str] = []
    for line in lines:
        if line == "}" and found and found[-1].endswith("{") and found[-1].startswith(_BLOCKS):
            found.pop()
        elif line == "}" and found and found[-1] == "} else {":
            found[-1] = line
        else:
            found.append(line)
    return found


def _without_detours(lines: list[str]) -> list[str]:
    """Return lines in which nothing is computed only to be assigned or returned in the next line."""
    counts = Counter(NAME.findall("\n".join(lines)))
    found: list[str] = []
    for line in lines:
        before = _PART.fullmatch(found[-1]) if found else None
        ends = before is not None and line.endswith((f" = {before[1]};", f"return {before[1]};"))
        if before is not None and ends and counts[before[1]] == 2:
            found[-1] = f"{line[: -len(before[1]) - 1]}{before[2]};"
        else:
            found.append(line)
    return found
