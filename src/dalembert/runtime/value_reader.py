"""Reading of mappings from names or symbols to numbers, whose keys are resolved once for each tuple of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, final

from ..values import number
from .symbol_assumptions import excluded, limits_of

__all__ = ["ValueReader"]

_MOST_KEPT = 64
"""Tuples of keys that are remembered."""

_Limits = tuple[str, float, float, tuple[str, ...]]
"""Name, least and largest number that its symbol allows, and what else it was declared to be."""


@final
class ValueReader:
    """Reads mappings of one kind; errors are those of the function that reads any mapping.

    Parameters
    ----------
    read : function of a mapping
        Returns its numbers by name, or raises an error.
    aliases : mapping of str to str
        Text of a symbol -> its name.
    assumptions : mapping of str to sequence of str
        Declared assumptions of symbols, by name.
    rounding : float
        Size of numbers whose sign says nothing.
    """

    def __init__(
        self,
        read: Callable[[Mapping[Any, Any]], dict[str, float]],
        aliases: Mapping[str, str],
        assumptions: Mapping[str, Sequence[str]],
        rounding: float = 0.0,
    ) -> None:
        self._read, self._aliases = read, aliases
        self._limits = {name: (name, *limits_of(declared, rounding)) for name, declared in assumptions.items()}
        self._resolved: dict[tuple[Any, ...], tuple[tuple[str, ...], tuple[_Limits, ...]]] = {}

    def __call__(self, given: Mapping[Any, Any]) -> dict[str, float]:
        """Return the numbers of a mapping by name.

        Raises
        ------
        UnknownNameError, ValueInputError
            As the function that reads any mapping.
        """
        if type(given) is not dict and not isinstance(given, Mapping):
            return self._read(given)
        keys = tuple(given)
        resolved = self._resolved.get(keys)
        if resolved is None:
            found = self._read(given)
            self._remember(keys)
            return found
        names, limits = resolved
        values = dict(zip(names, map(_float, given.values()), strict=True))
        if not math.isfinite(sum(values.values())):
            return self._read(given)
        for name, least, largest, others in limits:
            if not least <= values[name] <= largest or (others and excluded(others, values[name])):
                return self._read(given)
        return values

    def _remember(self, keys: tuple[Any, ...]) -> None:
        """Keep the names of keys that have been read without an error."""
        names = tuple(self._aliases.get(str(key), str(key)) for key in keys)
        if len(self._resolved) >= _MOST_KEPT:
            self._resolved.clear()
        self._resolved[keys] = names, tuple(self._limits[name] for name in names if name in self._limits)


def _float(value: Any) -> float:
    """Return a value as a number, NaN where it is not one."""
    if type(value) is float:
        return value
    try:
        return number(value)
    except ValueError:
        return math.nan
