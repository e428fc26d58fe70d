"""Smaller scenes with the same outcome: ``python -m fuzz.shrinking SEED`` from the folder ``tests``."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

from fuzz.compare import compared
from fuzz.description import ZERO, Description, number
from fuzz.generator import generated
from fuzz.summary import ORDER

__all__ = ["shrunk"]

SIMPLE = (number(0), number(1), number("0.3"))


def shrunk(description: Description, path: str, outcome: str, *, tries: int = 150) -> Description:
    """Return the smallest description found in which a path has the same outcome."""
    left = tries
    progress = True
    while progress and left > 0:
        progress = False
        for smaller in _smaller(description):
            left -= 1
            if left < 0:
                break
            try:
                found = compared(smaller).paths.get(path, ("", ""))[0]
            except Exception:
                continue
            if found == outcome:
                description, progress = smaller, True
                break
    return description


def _smaller(d: Description) -> Iterator[Description]:
    """Yield descriptions with something less."""
    for name in ("loads", "constraints"):
        items = getattr(d, name)
        for i, item in enumerate(items):
            if not getattr(item, "unit", False):
                yield replace(d, **{name: items[:i] + items[i + 1 :]})
    if d.gravity is not None:
        yield replace(d, gravity=None)
    if d.left_out:
        yield replace(d, left_out=())
    for i, body in enumerate(d.bodies):
        for change in ({"hinge": ZERO}, {"centre": ZERO}, {"mass": number(1)}):
            if getattr(body, next(iter(change))) != next(iter(change.values())):
                yield _with(d, "bodies", i, replace(body, **change))
        if body.inertia is not None and body.inertia != (number(1),) * 3 + ZERO:
            yield _with(d, "bodies", i, replace(body, inertia=(number(1),) * 3 + ZERO))
        for j, move in enumerate(body.moves):
            if move[0] == "matrix":
                yield _with(d, "bodies", i, replace(body, moves=body.moves[:j] + body.moves[j + 1 :]))
    for name in ("bodies", "loads", "constraints"):
        for i, item in enumerate(getattr(d, name)):
            for simpler in _simpler(item):
                yield _with(d, name, i, simpler)


def _with(d: Description, name: str, i: int, item: Any) -> Description:
    items = getattr(d, name)
    return replace(d, **{name: (*items[:i], item, *items[i + 1 :])})


def _simpler(item: Any) -> Iterator[Any]:
    """Yield an item with one expression in it replaced by a part of it or a simple number."""
    if is_dataclass(item) and not isinstance(item, type):
        for f in fields(item):
            value = getattr(item, f.name)
            if isinstance(value, tuple) and f.name not in ("frame", "arm_frame"):
                for simpler in _simpler(value):
                    yield replace(item, **{f.name: simpler})
    elif isinstance(item, tuple) and item:
        if isinstance(item[0], str):
            if item[0] in ("num", "par", "t", "q", "u", "rotate", "shift", "quaternion", "angles", "matrix"):
                if item[0] in ("rotate", "shift"):
                    for i in range(1, len(item)):
                        for simpler in _simpler(item[i]):
                            yield (*item[:i], simpler, *item[i + 1 :])
                elif item[0] == "num" and item not in SIMPLE:
                    yield from SIMPLE[1:]
                return
            yield from (part for part in item[1:] if isinstance(part, tuple))
        for i, part in enumerate(item):
            if isinstance(part, tuple):
                for simpler in _simpler(part):
                    yield (*item[:i], simpler, *item[i + 1 :])


def main() -> None:
    """Print a smaller description with the worst outcome of a seed."""
    description = generated(int(sys.argv[1]))
    report = compared(description)
    path = max(report.paths, key=lambda path: ORDER[report.paths[path][0]])
    outcome = report.paths[path][0]
    print(path, *report.paths[path])
    small = shrunk(description, path, outcome)
    for item in (*small.bodies, *small.loads, *small.constraints):
        print(item)
    print(small.gravity, small.start, small.parameters, small.span, compared(small).paths[path])


if __name__ == "__main__":
    main()
