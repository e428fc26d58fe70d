"""Straight-line code under construction."""

from __future__ import annotations

from typing import final

from .kernel import Assignment, Operand

__all__ = ["Lines"]


@final
class Lines:
    """Assignments in the order of the calls; each operation is written once, trivial ones never."""

    def __init__(self) -> None:
        self.body: list[Assignment] = []
        self._known: dict[tuple[str, tuple[Operand, ...]], str] = {}

    def op(self, name: str, *args: Operand) -> Operand:
        """Return the value of an operation."""
        key = (name, args)
        if key not in self._known:
            self._known[key] = f"v_{len(self.body)}_"
            self.body.append(Assignment(self._known[key], name, args))
        return self._known[key]

    def add(self, a: Operand, b: Operand) -> Operand:
        """Return a + b."""
        if a == 0.0 or b == 0.0:
            return b if a == 0.0 else a
        return self.op("add", a, b)

    def sub(self, a: Operand, b: Operand) -> Operand:
        """Return a - b."""
        if a == 0.0 or b == 0.0:
            return self.neg(b) if a == 0.0 else a
        return self.op("sub", a, b)

    def mul(self, a: Operand, b: Operand) -> Operand:
        """Return a * b."""
        if not isinstance(a, str) and not isinstance(b, str):
            return a * b
        if a in (0.0, 1.0):
            return 0.0 if a == 0.0 else b
        if b in (0.0, 1.0):
            return 0.0 if b == 0.0 else a
        return self.op("mul", a, b)

    def neg(self, a: Operand) -> Operand:
        """Return -a."""
        return self.op("neg", a) if isinstance(a, str) else -a

    def fma(self, a: Operand, b: Operand, c: Operand) -> Operand:
        """Return a * b + c, rounded once where the target can."""
        if a == 0.0 or b == 0.0:
            return c
        return self.mul(a, b) if c == 0.0 else self.op("fma", a, b, c)
