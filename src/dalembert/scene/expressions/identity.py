"""Test of identities of SymPy expressions by values at random points."""

from __future__ import annotations

import random
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
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


_BRANCHING = (sp.Abs, sp.sign, sp.floor, sp.ceiling, sp.Max, sp.Min, sp.Heaviside, sp.Piecewise)
"""Functions that may be different expressions on two sides of a value, so that values on one side say nothing."""
_SIZES, _DECADES = 24, (-3.0, 3.0)
"""Sizes that leaves are tried with where an expression has such functions, with both signs, and between which powers of
ten they lie."""


def _random_values(leaves: Iterable[Any], seed: int) -> dict[Any, Any]:
    """Return a positive number of moderate size for every leaf."""
    draw = random.Random(seed)
    return {leaf: sp.Float(str(draw.uniform(0.4, 1.3)), DIGITS) for leaf in leaves}


def _places(expressions: Sequence[Any], points: int) -> Iterator[tuple[dict[Any, Any], bool]]:
    """Yield values of the leaves of expressions, and whether these must have a value there.

    Where they have branches, further points are of many sizes, and of both signs as far as assumptions of symbols go.
    """
    leaves = leaves_of(expressions)
    for seed in range(points):
        yield _random_values(leaves, seed), True
    if any(e.has(*_BRANCHING) for e in expressions):
        sizes = {leaf: _sizes(number) for number, leaf in enumerate(leaves)}
        for place in range(2 * _SIZES):
            values = {leaf: _of_sign(leaf, sizes[leaf][place]) for leaf in leaves}
            yield {leaf: sp.Float(repr(value), DIGITS) for leaf, value in values.items()}, False


def _sizes(number: int) -> list[float]:
    """Return values of both signs, spread evenly over the decades, in an order of its own for each leaf."""
    draw, (low, high) = random.Random(f"leaf {number}"), _DECADES
    exponents = [low + (high - low) * (place + draw.random()) / _SIZES for place in range(_SIZES)]
    values = [sign * 10.0**exponent for exponent in exponents for sign in (1.0, -1.0)]
    draw.shuffle(values)
    return values


def _of_sign(leaf: Any, value: float) -> float:
    """Return a value with the sign that the assumptions of a leaf demand."""
    return abs(value) if leaf.is_nonnegative else -abs(value) if leaf.is_nonpositive else value


def _number(expression: Any, place: Mapping[Any, Any]) -> Any:
    """Return the value of an expression, NaN where it has none."""
    try:
        number = sp.N(expression.xreplace(place), DIGITS)
    except TypeError:  # a comparison of what is not real
        return sp.nan
    return number if number.is_number and number is not sp.zoo else sp.nan


def _exact(expression: Any) -> Any:
    """Return an expression with its decimals as the rational numbers that the doubles are."""
    return expression.xreplace({x: sp.Rational(x) for x in expression.atoms(sp.Float)})


def vanishes(expression: Any, values: Mapping[Any, Any] | None = None, *, points: int = 2) -> bool:
    """Return whether `expression` is zero for all values of its symbols.

    It is evaluated with 50 digits at random points: an expression that is zero is never mistaken, one
    that is not could only be if it vanished at all of them (Schwartz and Zippel); one with branches is tried on both
    sides of them. Where decimals occur in it, it is zero when what remains is as small as their rounding makes it,
    relative to the terms that it is a sum of.

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
    for place, necessary in _places([e], points):
        number = _number(e, place)
        if number is sp.nan:
            if necessary:
                return False
            continue
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
    for place, necessary in _places([a, b], 2):
        x, y = (_number(e, place) for e in (a, b))
        if sp.nan in (x, y):
            if necessary:
                return False
            continue
        if abs(x - y) > ROUNDING * max(abs(x), abs(y)):
            return False
    return True


def symbols_called(names: Collection[str], expressions: Iterable[Any]) -> tuple[Any, ...]:
    """Return the symbols in expressions that print as one of some names, in an order that is always the same."""
    held = (e.atoms(sp.Symbol) for e in expressions if isinstance(e, sp.Basic))
    found = {symbol for symbols in held for symbol in symbols if str(symbol) in names}
    return tuple(sorted(found, key=lambda symbol: (str(symbol.name), str(symbol.assumptions0))))
