"""Tolerances of the local error of steps: numbers, and absolute tolerances of components by name.

`NamedTolerances` passes for one number wherever tolerances travel. What compares errors with them asks
`component_tolerances` for one number a component of the state, and gets None where one serves all.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, final

import numpy as np

from ..arrays import FloatArray
from ..errors import OptionError, UnknownNameError, unknown_name
from ..values import option

DEFAULT_TOLERANCES = 1e-8, 1e-10
"""Default relative and absolute tolerance."""


@final
class NamedTolerances(float):
    """Absolute tolerances by name of the component; as a number, the smallest of them.

    Parameters
    ----------
    by_name : mapping of str to float
        Positive numbers.
    default : float
        The tolerance of components that are not named.
    """

    by_name: dict[str, float]
    default: float

    def __new__(cls, by_name: Mapping[str, float], default: float = DEFAULT_TOLERANCES[1]) -> NamedTolerances:
        """Return tolerances by name."""
        made = super().__new__(cls, min(default, *by_name.values()))
        made.by_name, made.default = dict(by_name), default
        return made

    def of(self, names: Sequence[str]) -> FloatArray:
        """Return the tolerance (n,) of each of some components."""
        return np.array([self.by_name.get(name, self.default) for name in names])

    def with_derivatives(self, state: Sequence[str], size: int) -> NamedTolerances:
        """Return tolerances of a state of so many components and their derivatives, each with that of its component."""
        own = {name: self.by_name.get(state[i % size], self.default) for i, name in enumerate(state)}
        return NamedTolerances(own, self.default)

    def __reduce__(self) -> tuple[Any, ...]:
        return NamedTolerances, (self.by_name, self.default)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, NamedTolerances) and (self.by_name, self.default) == (other.by_name, other.default)

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        return hash((frozenset(self.by_name.items()), self.default))

    def __repr__(self) -> str:
        named = ", ".join(f"{name}: {value:g}" for name, value in self.by_name.items())
        return f"{named}; others: {self.default:g}"


def component_tolerances(atol: float, names: Sequence[str]) -> FloatArray | None:
    """Return the absolute tolerance (n,) of each component of a state; None where one number serves all."""
    return atol.of(names) if isinstance(atol, NamedTolerances) else None


def scaled(atol: float, factor: float) -> float:
    """Return absolute tolerances times a factor."""
    if not isinstance(atol, NamedTolerances):
        return atol * factor
    return NamedTolerances({name: value * factor for name, value in atol.by_name.items()}, atol.default * factor)


def atol_attribute(atol: float) -> float | str:
    """Return absolute tolerances for attributes of files: a number, or a text by name."""
    return repr(atol) if isinstance(atol, NamedTolerances) else atol


def atol_text(atol: float) -> str:
    """Return absolute tolerances as text."""
    return f"({atol!r})" if isinstance(atol, NamedTolerances) else f"{atol:g}"


def at_least(atol: float, least: float) -> float:
    """Return absolute tolerances, raised to at least `least`."""
    if not isinstance(atol, NamedTolerances):
        return max(atol, least)
    return NamedTolerances({name: max(value, least) for name, value in atol.by_name.items()}, max(atol.default, least))


def tolerances(rtol: Any, atol: Any) -> tuple[float, float]:
    """Return rtol and atol as numbers; `atol` may be a mapping of symbols or names to numbers.

    Raises
    ------
    OptionError
        For what is none, and for numbers that are negative or not finite; by name, also for zero.
    """
    if isinstance(atol, str):
        raise OptionError(
            f"atol must be a number, not {atol!r}: one for the whole state, one for each component by name, or"
            ' "auto" in simulate, sweep and sensitivity'
        )
    if isinstance(atol, Mapping):
        atol = _by_name(atol)
    found = option("rtol", rtol), atol if isinstance(atol, NamedTolerances) else option("atol", atol)
    for name, value in zip(("rtol", "atol"), found, strict=True):
        if not 0.0 <= value < np.inf:
            raise OptionError(f"{name} must be finite and not negative, not {value!r}")
    return found


def _by_name(given: Mapping[Any, Any]) -> float:
    """Return absolute tolerances from a mapping of symbols or names to numbers."""
    found, twice = dict[str, float](), []
    for key, value in given.items():
        name = str(key)
        if name in found:
            twice.append(name)
        found[name] = option(f"atol of {name!r}", value)
    wrong = [f"{name} = {value!r}" for name, value in found.items() if not 0.0 < value < np.inf]
    if wrong or twice or not found:
        what = "; ".join([*wrong, *(f"{name} is given twice" for name in twice)]) or "no name"
        raise OptionError(
            f"atol by name must be positive and finite numbers, not {what}: give each component that needs one a"
            f" number above 0; those left out take {DEFAULT_TOLERANCES[1]:g}"
        )
    return NamedTolerances(found)


def within(atol: float, names: Sequence[str]) -> float:
    """Return absolute tolerances without those by other names."""
    if not isinstance(atol, NamedTolerances):
        return atol
    own = {name: value for name, value in atol.by_name.items() if name in names}
    return NamedTolerances(own, atol.default) if own else atol.default


def known_components(atol: float, known: Iterable[str], aliases: Mapping[str, str], others: Mapping[str, str]) -> float:
    """Return absolute tolerances whose names are those of components of the state.

    Parameters
    ----------
    atol : float
    known : iterable of str
        Names of the components.
    aliases : mapping of str to str
        Text of a symbol -> name.
    others : mapping of str to str
        Names that are no components of the state -> why.

    Raises
    ------
    UnknownNameError
        For other names, all of them at once, with those that are known.
    OptionError
        For a component that is given twice.
    """
    if not isinstance(atol, NamedTolerances):
        return atol
    known, wrong, taken = list(known), [], dict[str, str]()
    for key in atol.by_name:
        name = aliases.get(key, key)
        if name not in known:
            wrong.append(unknown_name("component of the state", key, known) + others.get(name, ""))
        elif name in taken:
            raise OptionError(f"atol of {name!r} is given twice, as {taken[name]!r} and as {key!r}: leave one out")
        taken[name] = key
    if wrong:
        raise UnknownNameError("\n".join(wrong))
    found = {name: atol.by_name[key] for name, key in taken.items()}
    return NamedTolerances(found, min(found.values()) if {*known} <= {*found} else atol.default)
