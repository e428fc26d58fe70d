"""Whether an expression is identically zero, decided by its values at random points."""

from __future__ import annotations

import random
from collections.abc import Iterable, Mapping
from typing import Any

import sympy as sp
from sympy.core.function import AppliedUndef

__all__ = ["leaves_of", "vanishes"]

DIGITS = 50
THRESHOLD = sp.Float(10, DIGITS) ** -30


def leaves_of(expressions: Iterable[Any]) -> list[Any]:
    """Return the symbols, functions of time and rates in `expressions`, in an order of their own."""
    found: set[Any] = set()
    for expression in expressions:
        found |= sp.sympify(expression).atoms(sp.Symbol, AppliedUndef, sp.Derivative)
    return sorted(found, key=sp.default_sort_key)


def _random_values(leaves: Iterable[Any], seed: int) -> dict[Any, Any]:
    """Return a positive number of moderate size for every leaf."""
    draw = random.Random(seed)
    return {leaf: sp.Float(str(draw.uniform(0.4, 1.3)), DIGITS) for leaf in leaves}


def vanishes(expression: Any, values: Mapping[Any, Any] | None = None, *, points: int = 2) -> bool:
    """Return whether `expression` is zero for all values of its symbols.

    It is evaluated with 50 digits at random points: an expression that is zero is never mistaken, one
    that is not could only be if it vanished at all of them (Schwartz and Zippel).

    Parameters
    ----------
    expression : Expr
    values : mapping, optional
        Leaves that are to be replaced first.
    points : int
        How many points to try.
    """
    e = sp.sympify(expression)
    if values:
        e = e.subs(values).doit()
    if e.is_number and e.is_Rational:
        return bool(e == 0)
    leaves = leaves_of([e])
    for seed in range(points):
        number = sp.N(e.xreplace(_random_values(leaves, seed)), DIGITS)
        if not number.is_number or number is sp.nan or abs(number) > THRESHOLD:
            return False
    return True
