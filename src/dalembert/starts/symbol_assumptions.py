"""Numbers given by name or symbol: their reading, and what their symbols are assumed to be, such as positive.

SymPy simplifies with declared assumptions: sqrt(k**2) is k for a positive k before a scene is read. The equations are
therefore wrong for numbers that the declarations exclude. Zero passes for what is positive or negative: it stands for
the limit from the side that was declared. So does, for a state, what rounding leaves of zero: the end of one motion is
the start of another.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import AssumptionWarning, ValueInputError, warn_caller
from ..values import number

_SIGNED = ("positive", "nonnegative", "negative", "nonpositive")
_SLACK = 1e-6
ROUNDING = 1e-9
"""Size of values of a state whose sign says nothing."""

_Test = Callable[[Any], Any]


def _divides(number: int, rest: int) -> _Test:
    return lambda v: np.mod(v, number) != rest


_BROKEN: dict[str, tuple[str, _Test]] = {
    "positive": ("negative", lambda v: v < 0.0),
    "nonnegative": ("negative", lambda v: v < 0.0),
    "negative": ("positive", lambda v: v > 0.0),
    "nonpositive": ("positive", lambda v: v > 0.0),
    "zero": ("not zero", lambda v: v != 0.0),
    "integer": ("not whole", _divides(1, 0)),
    "even": ("not even", _divides(2, 0)),
    "odd": ("not odd", _divides(2, 1)),
}
"""Declaration -> what a number is that it excludes, and which numbers (k,) are."""


def contradicts(declared: Sequence[str], values: FloatArray, rounding: float = 0.0) -> NDArray[np.bool_]:
    """Return which numbers (k,) contradict the declared assumptions of their symbol; NaN and infinity do not.

    Signs of numbers of at most the size `rounding` are let pass.
    """
    broken = np.zeros(values.shape, bool)
    with np.errstate(invalid="ignore"):
        for name in declared:
            wrong = _BROKEN[name][1](values)
            broken |= wrong & (np.abs(values) > rounding) if name in _SIGNED else wrong
    return broken & np.isfinite(values)


def limits_of(declared: Sequence[str], rounding: float) -> tuple[float, float, tuple[str, ...]]:
    """Return the least and the largest number that declared signs allow, and the declarations that are no signs.

    `rounding` as for `contradicts`.
    """
    least = -rounding if "positive" in declared or "nonnegative" in declared else -math.inf
    largest = rounding if "negative" in declared or "nonpositive" in declared else math.inf
    return least, largest, tuple(name for name in declared if name not in _SIGNED)


def excluded(declared: Sequence[str], value: float) -> bool:
    """Return whether declarations that are no signs exclude a finite number."""
    return any(_BROKEN[name][1](value) for name in declared)


def signed_names(assumptions: Mapping[str, Sequence[str]], names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of symbols that were declared to have a sign."""
    return tuple(name for name in names if any(what in _SIGNED for what in assumptions.get(name, ())))


def _number_contradicts(declared: Sequence[str], value: float, rounding: float) -> bool:
    """Return the answer of `contradicts` for one number, at a tenth of the cost."""
    small = abs(value) <= rounding
    return math.isfinite(value) and any(
        _BROKEN[name][1](value) and not (small and name in _SIGNED) for name in declared
    )


def refuse_contradictions(
    assumptions: Mapping[str, Sequence[str]], values: Mapping[str, float], rounding: float = 0.0
) -> None:
    """Reject numbers that their symbols exclude; `rounding` as for `contradicts`.

    Raises
    ------
    ValueInputError
        That names all of them, what they contradict, and the remedy.
    """
    wrong = []
    for name, value in values.items():
        if name in assumptions and _number_contradicts(assumptions[name], value, rounding):
            declared = ", ".join(f"{what}=True" for what in assumptions[name])
            wrong.append(f"{name} = {value:g} contradicts {declared}, with which the symbol {name!r} was declared")
    if wrong:
        raise ValueInputError(
            f"{'; '.join(wrong)}. SymPy has simplified the scene with that (as sqrt(k**2) to k for positive k), so that"
            " its equations may be wrong there: give another value, or declare the symbol without it (real=True) and"
            " compile anew"
        )


def rows_that_contradict(
    assumptions: Mapping[str, Sequence[str]], names: Sequence[str], rows: FloatArray, rounding: float = 0.0
) -> NDArray[np.bool_]:
    """Return which of the rows (k, n), one column a name, hold numbers that their symbols exclude.

    `rounding` as for `contradicts`.
    """
    broken = np.zeros(len(rows), bool)
    for place, name in enumerate(names):
        if name in assumptions:
            broken |= contradicts(assumptions[name], rows[:, place], rounding)
    return broken


def warn_of_motion(
    assumptions: Mapping[str, Sequence[str]],
    names: Sequence[str],
    t: FloatArray,
    of: Callable[[str], FloatArray],
) -> None:
    """Warn where coordinates left, along motions, the sign that they were declared to have.

    Excursions next to zero, as of a projection onto constraints, do not count.

    Parameters
    ----------
    assumptions : mapping of str to sequence of str
    names : sequence of str
        Of the coordinates.
    t : ndarray (k,)
        Times [s].
    of : function of a name
        Gives the values (k,) of a coordinate at these times.
    """
    for name in names:
        signs = [what for what in assumptions.get(name, ()) if what in _SIGNED]
        if not signs or not len(t):
            continue
        values = of(name)
        size = np.max(np.abs(values), initial=0.0, where=np.isfinite(values))
        broken = np.flatnonzero(contradicts(signs, values) & (np.abs(values) > _SLACK * size))
        if len(broken):
            first = broken[0]
            warn_caller(
                f"{name} = {values[first]:g} at t = {t[first]:g} ({len(broken)} of {len(values)} records): the"
                f" coordinate was declared with {signs[0]}=True, and SymPy has simplified the scene with that (as"
                " sqrt(k**2) to k for positive k), so that motions may be wrong beyond it. Declare it without, or end"
                " the run there with a terminal event",
                AssumptionWarning,
            )


# Reading of mappings from names or symbols to numbers, whose keys are resolved once for each tuple of them.

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
