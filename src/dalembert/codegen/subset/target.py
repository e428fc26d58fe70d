"""Values of a function that is being translated, and the interface of the languages that it is translated to."""

from __future__ import annotations

import ast
from abc import ABC, abstractmethod
from collections.abc import Callable
from itertools import pairwise
from typing import Any, Protocol, final

from ...frozen import frozen
from ...subset.compiled_subset import FLAG, INTEGER, NUMBER, Group, Kind, Scalar

_ORDER = (FLAG, INTEGER, NUMBER)


@final
@frozen
class Value:
    """A value: its kind, and the operands that hold its words.

    A NamedTuple of arguments is the address of its words instead, and the number of the first of them: `base` is set.
    """

    kind: Kind
    words: tuple[str, ...]
    base: str = ""
    first: int = 0


def by_reference(kind: Kind) -> bool:
    """Return whether functions take a value as the address of its words: NamedTuples of arguments."""
    return isinstance(kind, Group) and bool(kind.names)


def parts(value: Value) -> list[Value]:
    """Return the values in a tuple."""
    assert isinstance(value.kind, Group) and not value.base
    ends = zip(value.kind.parts, pairwise(value.kind.places), strict=True)
    return [Value(kind, value.words[first:last]) for kind, (first, last) in ends]


def unified(a: Kind, b: Kind) -> Kind:
    """Return the kind that holds values of both: doubles hold whole numbers, and these hold flags."""
    if a == b:
        return a
    if isinstance(a, Group) and isinstance(b, Group) and len(a.parts) == len(b.parts):
        return Group(tuple(unified(x, y) for x, y in zip(a.parts, b.parts, strict=True)))
    if isinstance(a, Scalar) and isinstance(b, Scalar):
        return max(a, b, key=_ORDER.index)
    raise TypeError(f"{a} and {b} are not the same kind")


class Target(ABC):
    """Prints the expressions and statements of one function."""

    def literal(self, number: bool | int | float) -> Value:
        """Return a constant."""
        if isinstance(number, bool):
            return Value(FLAG, ("true" if number else "false",))
        if isinstance(number, int):
            return Value(INTEGER, (str(int(number)),))
        return Value(NUMBER, (self.double(number),))

    @abstractmethod
    def double(self, number: float) -> str:
        """Return the text of a double."""

    @abstractmethod
    def variable(self, name: str) -> Value:
        """Return the value of a variable that has one."""

    @abstractmethod
    def negated(self, value: Value) -> Value:
        """Return a number with the other sign."""

    @abstractmethod
    def arithmetic(self, op: ast.operator, kind: Kind, a: Value, b: Value) -> Value:
        """Return a combination of two numbers of a kind."""

    @abstractmethod
    def divided(self, rest: bool, a: Value, b: Value) -> Value:
        """Return quotient or rest of a whole number and a positive one, rounded down; 0 divides as 1 does."""

    @abstractmethod
    def compared(self, op: ast.cmpop, kind: Kind, a: Value, b: Value) -> Value:
        """Return the flag of a comparison of two numbers of a kind."""

    @abstractmethod
    def both(self, a: Value, b: Value) -> Value:
        """Return whether two flags are set."""

    @abstractmethod
    def replaced(self, op: ast.cmpop, kind: Kind, a: Value, b: Value) -> Value:
        """Return `b` where it compares so with `a`, else `a`."""

    @abstractmethod
    def chosen(self, test: ast.expr, yes: Callable[[], Value], no: Callable[[], Value]) -> Value:
        """Return one of two values; only the one that the test selects is computed."""

    @abstractmethod
    def cast(self, value: Value, kind: Kind) -> Value:
        """Return a number as one of a larger kind."""

    @abstractmethod
    def place(self, array: Value, index: list[Value]) -> Value:
        """Return the row of an array at an index, or the place of an element where the index is whole.

        The place is a value of the kind of the array without dimensions.
        """

    @abstractmethod
    def argument(self, kind: Kind, base: str, first: int) -> Value:
        """Return an argument, of which the first word has this place among the words at a base."""

    @abstractmethod
    def member(self, record: Value, number: int) -> str:
        """Return the place of a field of a record."""

    @abstractmethod
    def load(self, place: Value) -> Value:
        """Return the value at a place."""

    @abstractmethod
    def store(self, value: Value, place: Value) -> None:
        """Write a value to a place."""

    @abstractmethod
    def called(self, function: Any, given: list[Value]) -> Value:
        """Return the result of a call of a translated function."""

    @abstractmethod
    def assign_name(self, name: str, value: Value) -> None:
        """Keep a value in a variable, whose kind is that of the first value in the text; `_` keeps none."""

    @abstractmethod
    def branch_if(self, test: ast.expr, body: list[ast.stmt], other: list[ast.stmt]) -> None:
        """Translate statements of which a test decides."""

    @abstractmethod
    def loop_while(self, test: ast.expr, body: list[ast.stmt]) -> None:
        """Translate a loop with a test."""

    @abstractmethod
    def loop_range(self, name: str, given: list[Value], body: list[ast.stmt]) -> None:
        """Count as `range` does; what happens to the variable inside does not change the count."""

    @abstractmethod
    def loop_each(self, target: ast.expr, elements: list[ast.expr], body: list[ast.stmt]) -> None:
        """Write the body of a loop over a tuple once for each element."""

    @abstractmethod
    def leave(self, loop: bool) -> None:
        """Leave a round of the innermost loop, or the loop."""

    @abstractmethod
    def give(self, value: Value | None) -> None:
        """Return from the function."""

    @property
    @abstractmethod
    def reachable(self) -> bool:
        """Whether what follows can be reached."""


class Arrays(Protocol):
    """The constants of a module."""

    def array(self, array: Any) -> Value:
        """Return a constant array."""
