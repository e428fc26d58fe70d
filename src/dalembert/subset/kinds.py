"""Types of the values that compiled loops work on: integers, doubles, flags, arrays, records and tuples of these."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import final


class Kind(ABC):
    """A type; a value of it is one or more words of 8 bytes, each of a type of LLVM."""

    @property
    @abstractmethod
    def words(self) -> tuple[str, ...]:
        """LLVM types of the words."""


@final
@dataclass(frozen=True)
class Scalar(Kind):
    """A number; ``stored`` is its LLVM type in arrays, ``owned`` says that it is an address with its owner."""

    type: str
    stored: str
    owned: bool = field(default=False, compare=False)

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
class Fields(Kind):
    """A record: the address of numbers of 8 bytes each, which have names and can be changed."""

    names: tuple[str, ...]
    items: tuple[Scalar, ...]

    @property
    def words(self) -> tuple[str, ...]:
        """See `Kind.words`."""
        return ("ptr",)


@final
@dataclass(frozen=True)
class Group(Kind):
    """A tuple, with names where it is a NamedTuple."""

    parts: tuple[Kind, ...]
    names: tuple[str, ...] = ()

    @property
    def words(self) -> tuple[str, ...]:
        """See `Kind.words`."""
        return tuple(word for part in self.parts for word in part.words)


INTEGER, NUMBER, FLAG = Scalar("i64", "i64"), Scalar("double", "double"), Scalar("i1", "i8")
VECTOR, MATRIX = Array(NUMBER, 1), Array(NUMBER, 2)
INT_VECTOR, INT_MATRIX, FLAG_MATRIX = Array(INTEGER, 1), Array(INTEGER, 2), Array(FLAG, 2)
ADDRESS = Scalar("i64", "i64", owned=True)
ADDRESS_VECTOR = Array(ADDRESS, 1)
