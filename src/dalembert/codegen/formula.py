"""Formulas of elementary functions: operations on numbers, which are printed for any number of lanes, and in C."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, final

from ..ir.kernel import Lines, Operand


class Value(NamedTuple):
    """A value, and where it is good: elsewhere the C library computes it. That is None where it is good everywhere."""

    value: Operand
    usual: Operand | None = None


@final
class Formula:
    """Operations on numbers, one after the other; comparisons give flags.

    Parameters
    ----------
    fused : bool
        Whether products and sums are rounded once.
    """

    def __init__(self, *, fused: bool) -> None:
        lines = Lines()
        self.body, self.fused = lines.body, fused
        self.op, self.add, self.sub = lines.op, lines.add, lines.sub
        self.mul, self.neg, self.fma = lines.mul, lines.neg, lines.fma

    def polynomial(self, coefficients: Sequence[float], x: Operand) -> Operand:
        """Return a polynomial by Estrin's scheme."""
        terms: list[Operand] = list(coefficients)
        while len(terms) > 1:
            terms = [self.fma(high, x, low) for low, high in zip(terms[::2], [*terms[1::2], 0.0], strict=False)]
            x = self.mul(x, x)
        return terms[0]

    def sum(self, a: Operand, b: Operand) -> tuple[Operand, Operand]:
        """Return a + b, and what rounding took off it, where a is larger or 0."""
        total = self.add(a, b)
        return total, self.sub(b, self.sub(total, a))

    def quotient(
        self, top: Operand, below: Operand, below_low: Operand = 0.0, top_low: Operand = 0.0
    ) -> tuple[Operand, Operand]:
        """Return a quotient of numbers in two parts, and what rounding took off it where products are fused."""
        if not self.fused:
            return self.op("div", top, below), 0.0
        inverse = self.op("div", 1.0, below)
        found = self.mul(top, inverse)
        minus = self.neg(found)
        rest = self.add(self.fma(minus, below_low, self.fma(minus, below, top)), top_low)
        return found, self.mul(rest, inverse)
