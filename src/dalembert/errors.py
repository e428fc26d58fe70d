"""The exception tree: misuse raises one of these, numerical failure is a status on the result.

Every message says what is wrong, where, what is allowed and what to do.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

RELEASE = (
    "scene = scene.release(coordinate, point or frame, direction). This returns a new scene; the old one stays as it is"
)
"""The call that releases the coordinate along which a hidden reaction acts."""

TOO_DEEP = (
    "an expression is nested more deeply than Python can read, about 150 functions in one another: write it flatter, or"
    " give inner parts as coordinates of their own with holonomic constraints"
)


class DalembertError(Exception):
    """Base of every error that the library raises on purpose."""


class SceneError(DalembertError, ValueError):
    """The scene is not complete or contradicts itself; `faults` lists everything found, all at once."""

    def __init__(self, scene: str, faults: Sequence[str]) -> None:
        self.faults = tuple(faults)
        count = "1 fault" if len(self.faults) == 1 else f"{len(self.faults)} faults"
        super().__init__(f"scene {scene!r} has {count}:\n" + "\n".join(f"  - {fault}" for fault in self.faults))

    def __reduce__(self) -> tuple[type[Exception], tuple[str]]:
        return (DalembertError, (str(self),))


class ExpressionError(DalembertError, ValueError):
    """An expression uses a symbol or function that cannot be compiled."""


class ConstraintError(DalembertError, ValueError):
    """Constraints are dependent on each other or contradict each other."""


class SingularMassMatrixError(DalembertError, ValueError):
    """A coordinate moves no inertia, so that its acceleration is not determined."""


class FormulationError(DalembertError, ValueError):
    """A formulation does not support the scene; the message says why and which one does."""


class OptionError(DalembertError, ValueError):
    """An option has a value that is not allowed."""


class CapabilityError(OptionError):
    """The backend or the scene does not support the call; the message says which one does."""


class BreakTimesError(DalembertError, ValueError):
    """A condition on time changes too often within the span of a run."""


class UnknownNameError(DalembertError, KeyError):
    """A name is missing from, or unknown in, a mapping that the user gave."""

    def __str__(self) -> str:
        return str(self.args[0])


class ValueInputError(DalembertError, ValueError):
    """A number that the user gave is not finite, or not a number."""


class InitialStateError(DalembertError, ValueError):
    """The initial state contradicts a constraint, or leaves something undetermined."""


class RunFailedError(DalembertError, RuntimeError):
    """A run with ``throw=True`` failed; the message says why and what to do."""


class StoredSweepError(DalembertError, RuntimeError):
    """Chunks of a stored sweep could not be computed; a later call continues with them."""


class MissingExtraError(DalembertError, ImportError):
    """An optional package is needed; the message says how to install it."""


class ProgramTextError(DalembertError, ValueError):
    """The text of a program or kernel cannot be read; `line` (from 1) is where, and `expected` what belongs there."""

    def __init__(self, line: int, expected: str, found: str) -> None:
        self.line, self.expected, self.found = line, expected, found
        super().__init__(f"line {line}: expected {expected}, found {found}")

    def __reduce__(self) -> tuple[type[Exception], tuple[int, str, str]]:
        return (ProgramTextError, (self.line, self.expected, self.found))


class AssumptionWarning(UserWarning):
    """A coordinate left, along a motion, the sign that its symbol was declared to have."""


class CacheWarning(UserWarning):
    """A file of the module cache was damaged and has been rebuilt, or the cache is not used; the message says why."""


class CompileTimeWarning(UserWarning):
    """Equations are so long that the backend takes minutes to compile them, where another takes seconds."""


class EnergyWarning(UserWarning):
    """A potential energy is not that of the loads, or the energy is requested and a load has no known potential."""


class FileWarning(UserWarning):
    """A file has values that no body can have; the message says which."""


class LoadWarning(UserWarning):
    """A force acts at a point that moves over a body without saying that it acts on that body."""


class PrecisionWarning(UserWarning):
    """A tolerance is below what double precision gives, or large against the motion; the message names another."""


class StoredSweepWarning(UserWarning):
    """A sweep into a store waits for a cluster that has no worker."""


def nesting_named(function: Callable[P, T]) -> Callable[P, T]:
    """Return a function that raises a named error for expressions nested too deeply for Python."""

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return function(*args, **kwargs)
        except RecursionError:
            raise ExpressionError(TOO_DEEP) from None

    return call


def warn_caller(message: str, category: type[Warning]) -> None:
    """Warn where the package was called from, however deep inside it the reason was found."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] == __package__:
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)


def list_names(names: Iterable[str]) -> str:
    """Return names as a readable list, or "none"."""
    return ", ".join(names) or "none"


def unknown_name(kind: str, name: str, known: Iterable[str]) -> str:
    """Return the sentence for an unknown name, with the known names and the nearest of them."""
    known = list(known)
    close = get_close_matches(name, known, n=1)
    hint = f" Did you mean {close[0]!r}?" if close else ""
    return f"unknown {kind} {name!r}.{hint} Known: {list_names(known)}."
