"""Names of users, and the identifiers of generated code."""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterable
from functools import lru_cache
from typing import final

RATE_SUFFIX = "_dot"
_ACCELERATION_SUFFIX = "_ddot"
_LONGEST = 500
"""Characters of an identifier; LLVM takes those that differ only beyond 1,024 for one."""

GENERATED = frozenset(
    {"abs", "c", "float", "fn", "jnp", "math", "max", "min", "numba", "out", "p", "s", "t", "y"}
    | {"close", "entry", "orders", "turn"}
)
"""Identifiers that generated code uses itself, the last four as labels of Taylor steps in assembly."""


def rate_name(coordinate: str) -> str:
    """Return the name of the rate of a coordinate: ``"x" -> "x_dot"``."""
    return coordinate + RATE_SUFFIX


def acceleration_name(coordinate: str) -> str:
    """Return the name of the second rate of a coordinate as an output: ``"x" -> "x_ddot"``."""
    return coordinate + _ACCELERATION_SUFFIX


def acceleration_input(coordinate: str) -> str:
    """Return the name of the second rate of a coordinate on the graph, which no symbol of a user has."""
    return f"second rate of {coordinate}"


def unwritable(name: str) -> bool:
    """Whether a name has a lone surrogate, half of a character, which no file and no message can hold."""
    return any("\ud800" <= character <= "\udfff" for character in name)


_KEPT = GENERATED.union(keyword.kwlist)


@lru_cache(maxsize=4096)
def _identifier(wish: str) -> str:
    """Return a name of letters, digits and underscores."""
    base = re.sub(r"[^0-9a-zA-Z]+", "_", wish).strip("_")[:_LONGEST] or "value"
    return f"n{base}" if base[0].isdigit() else base


@final
class Namer:
    """Gives every object of one generated kernel an identifier of its own.

    A wished-for name is reduced to letters, digits and underscores, so no text that a user
    wrote reaches generated code as code; names taken already get a number.

    Parameters
    ----------
    reserved : iterable of str
        Identifiers that must not be given out.
    """

    def __init__(self, reserved: Iterable[str] = ()) -> None:
        self._counts: dict[str, int] = {}
        self._taken = {*reserved, *_KEPT}

    def __call__(self, wish: str) -> str:
        """Return an identifier close to `wish` that nothing else has."""
        base = _identifier(wish)
        name, count = base, self._counts.get(base, 1)
        while name in self._taken:
            count += 1
            name = f"{base}_{count}"
        self._counts[base] = count
        self._taken.add(name)
        return name
