"""Interface of the languages that functions of the subset are translated to."""

from __future__ import annotations

import ast
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Protocol

from ...subset.compiled_subset import FLAG, INTEGER, NUMBER, Kind
from .values import Value


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
