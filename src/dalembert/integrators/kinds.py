"""Types of what compiled loops work on: whole numbers, doubles, flags, arrays of these, and tuples."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

__all__ = [
    "ARRAY_OF_FLAGS",
    "FLAG",
    "INTEGER",
    "INTEGERS",
    "INTEGER_MATRIX",
    "MATRIX",
    "NUMBER",
    "VECTOR",
    "Array",
    "Group",
    "Kind",
    "Scalar",
]


class Kind(ABC):
    """A type; a value of it is one or more words, each of which LLVM knows."""

    @property
    @abstractmethod
    def words(self) -> tuple[str, ...]:
        """LLVM types of the words."""


@final
@dataclass(frozen=True)
class Scalar(Kind):
    """A number; ``stored`` is what arrays keep it as."""

    type: str
    stored: str

    @property
    def words(self) -> tuple[str, ...]:
        """See `Kind.words`."""
        return (self.type,)


@final
@dataclass(frozen=True)
class Array(Kind):
    """A C-contiguous array: the address, and the length along each dimension."""

    item: Scalar
    dimensions: int

    @property
    def words(self) -> tuple[str, ...]:
        """See `Kind.words`."""
        return ("ptr", *("i64",) * self.dimensions)


@final
@dataclass(frozen=True)
class Group(Kind):
    """A tuple, with names where it is a named one."""

    parts: tuple[Kind, ...]
    names: tuple[str, ...] = ()

    @property
    def words(self) -> tuple[str, ...]:
        """See `Kind.words`."""
        return tuple(word for part in self.parts for word in part.words)


INTEGER, NUMBER, FLAG = Scalar("i64", "i64"), Scalar("double", "double"), Scalar("i1", "i8")
VECTOR, MATRIX = Array(NUMBER, 1), Array(NUMBER, 2)
INTEGERS, INTEGER_MATRIX, ARRAY_OF_FLAGS = Array(INTEGER, 1), Array(INTEGER, 2), Array(FLAG, 2)
