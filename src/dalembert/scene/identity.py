"""Test of identities of SymPy expressions by values at random points."""

from __future__ import annotations

import random
from collections.abc import Iterable, Mapping
from typing import Any

import sympy as sp
from sympy.core.function import AppliedUndef

DIGITS = 50
THRESHOLD = sp.Float(10, DIGITS) ** -30
ROUNDING = sp.Float(10, DIGITS) ** -13
"""Relative size of what the rounding of decimals leaves of a zero."""


def leaves_of(expressions: Iterable[Any]) -> list[Any]:
    """Return the symbols, functions of time and rates in `expressions`, in an order that is always the same."""
    found: set[Any] = set()
    for expression in expressions:
        found |= sp.sympify(expression).atoms(sp.Symbol, AppliedUndef, sp.Derivative)
    return sorted(found, key=sp.default_sort_key)


def _random_values(leaves: Iterable[Any], seed: int) -> dict[Any, Any]:
    """Return a positive number of moderate size for every leaf."""
    draw = random.Random(seed)
    return {leaf: sp.Float(str(draw.uniform(0.4, 1.3)), DIGITS) for leaf in leaves}


def _exact(expression: Any) -> Any:
    """Return an expression with its decimals as the rational numbers that the doubles are."""
    return expression.xreplace({x: sp.Rational(x) for x in expression.atoms(sp.Float)})


def vanishes(expression: Any, values: Mapping[Any, Any] | None = None, *, points: int = 2) -> bool:
    """Return whether `expression` is zero for all values of its symbols.

    It is evaluated with 50 digits at random points: an expression that is zero is never mistaken, one
    that is not could only be if it vanished at all of them (Schwartz and Zippel). Where decimals occur in it, it is
    zero when what remains is as small as their rounding makes it, relative to the terms that it is a sum of.

    Parameters
    ----------
    expression : Expr
    values : mapping, optional
        Leaves that are to be replaced first.
    points : int
        Number of points to try.
    """
    e = sp.sympify(expression)
    if values:
        e = e.subs(values).doit()
    if e.is_number and e.is_Rational:
        return bool(e == 0)
    decimals = e.has(sp.Float)
    if decimals:
        e = _exact(e)
    leaves = leaves_of([e])
    for seed in range(points):
        place = _random_values(leaves, seed)
        number = sp.N(e.xreplace(place), DIGITS)
        if not number.is_number or number is sp.nan:
            return False
        size = sum(abs(sp.N(term.xreplace(place), DIGITS)) for term in sp.Add.make_args(e)) if decimals else 0
        if abs(number) > max(THRESHOLD, ROUNDING * size):
            return False
    return True


def equal(first: Any, second: Any) -> bool:
    """Return whether two expressions are the same function, up to rounding where decimals occur in them.

    A difference that SymPy has evaluated, such as 0.36 + 0.64 - 1, does not show the size of its terms.
    """
    a, b = sp.sympify(first), sp.sympify(second)
    if not (a.has(sp.Float) or b.has(sp.Float)):
        return vanishes(a - b)
    a, b = _exact(a), _exact(b)
    leaves = leaves_of([a, b])
    for seed in range(2):
        place = _random_values(leaves, seed)
        x, y = (sp.N(e.xreplace(place), DIGITS) for e in (a, b))
        if not (x.is_number and y.is_number) or sp.nan in (x, y):
            return False
        if abs(x - y) > ROUNDING * max(abs(x), abs(y)):
            return False
    return True
