"""Small linear systems with trigonometric entries, solved in closed form.

Entries become elements of the field of rational functions in the symbols, rates and tables that occur and
in u = tan(angle / 2) for every angle, with sin = 2 u / (1 + u^2) and cos = (1 - u^2) / (1 + u^2). Common
factors cancel there, sin^2 + cos^2 is 1, and a pivot is zero exactly when it is identically zero. Matrices too
large for that are eliminated as they stand, with pivots tested numerically.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import sympy as sp
from sympy.polys.fields import sfield

from ..scene.expressions.compiled_functions import CompiledCall
from ..scene.expressions.identity import vanishes
from ..scene.expressions.table_functions import TableFunction

SMALL = 2500
"""Operations of a system up to which it is treated in the field of rational functions."""


@final
class Field:
    """Rational functions in the generators of some expressions, and in the half-angle tangents.

    Attributes
    ----------
    elements : list
        The expressions as elements of the field, in order.
    """

    def __init__(self, expressions: Sequence[Any]) -> None:
        plain = [_sines(e) for e in expressions]
        angles = sorted({f.args[0] for e in plain for f in e.atoms(sp.sin, sp.cos)}, key=sp.default_sort_key)
        self._angles = dict(zip(sp.symbols(f"u_:{len(angles)}"), angles, strict=True)) if angles else {}
        table: dict[Any, Any] = {}
        for u, angle in self._angles.items():
            table[sp.sin(angle)], table[sp.cos(angle)] = 2 * u / (1 + u**2), (1 - u**2) / (1 + u**2)
        kinds = (sp.Derivative, sp.core.function.AppliedUndef, TableFunction, CompiledCall)
        found = {a for e in plain for a in e.xreplace(table).atoms(*kinds)}
        rates = sorted(found, key=lambda a: (not isinstance(a, sp.Derivative), sp.default_sort_key(a)))
        leaves = {leaf: sp.Symbol(f"v_{i}") for i, leaf in enumerate(rates)}
        named = [e.xreplace(table).xreplace(leaves) for e in plain]
        symbols = sorted({s for e in named for s in e.free_symbols}, key=lambda s: s.name) or [sp.Symbol("unit")]
        self._back = {symbol: leaf for leaf, symbol in leaves.items()}
        self._symbols = symbols
        self._moving = [i for i, s in enumerate(symbols) if s in self._back or s in self._angles]
        _, self.elements = sfield(named, *symbols)

    def zero(self, element: Any) -> bool:
        """Return whether an element is identically zero."""
        return not element

    def weight(self, element: Any) -> tuple[int, int]:
        """Rank a pivot: numbers, then parameters, then functions of the configuration; short ones first."""
        degrees = [max(a, b) for a, b in zip(element.numer.degrees(), element.denom.degrees(), strict=True)]
        moving = any(degrees[i] > 0 for i in self._moving)
        return (2 if moving else 1 if any(d > 0 for d in degrees) else 0, len(element.numer) + len(element.denom))

    def expression(self, element: Any) -> Any:
        """Return the SymPy expression of an element, half-angle tangents turned back into sines and cosines."""
        if not self._angles:
            return element.as_expr(*self._symbols).xreplace(self._back)
        places = {i: u for i, u in enumerate(self._symbols) if u in self._angles}
        degrees = [max(a, b) for a, b in zip(element.numer.degrees(), element.denom.degrees(), strict=True)]
        half = {i: (max(degrees[i], 0) + 1) // 2 for i in places}
        parts = []
        for polynomial in (element.numer, element.denom):
            total = []
            for powers, coefficient in polynomial.terms():
                term = polynomial.ring.domain.to_sympy(coefficient)
                for i, power in enumerate(powers):
                    if i in places:
                        term *= _half_angle(power, half[i], self._angles[places[i]])
                    else:
                        term *= self._back.get(self._symbols[i], self._symbols[i]) ** power
                total.append(term)
            parts.append(sp.expand(sp.Add(*total)))
        return parts[0] / parts[1]


def _half_angle(power: int, half: int, angle: Any) -> Any:
    """Return u^power / (1 + u^2)^half, times 2^half, in the sine and cosine of the angle."""
    s, c = sp.sin(angle), sp.cos(angle)
    odd = power % 2
    return s**odd * (1 - c) ** (power // 2) * (1 + c) ** (half - power // 2 - odd)


def _sines(e: Any) -> Any:
    """Return an expression with sines and cosines of single angles in place of other circular functions."""
    e = sp.sympify(e)
    if e.has(sp.tan, sp.cot, sp.sec, sp.csc):
        e = e.replace(sp.tan, lambda x: sp.sin(x) / sp.cos(x)).replace(sp.cot, lambda x: sp.cos(x) / sp.sin(x))
        e = e.replace(sp.sec, lambda x: 1 / sp.cos(x)).replace(sp.csc, lambda x: 1 / sp.sin(x))
    if e.has(sp.sin, sp.cos):
        e = e.replace(
            lambda f: isinstance(f, sp.sin | sp.cos) and (f.args[0].is_Add or f.args[0].is_Mul), sp.expand_trig
        )
    return sp.nsimplify(e, rational=True) if e.has(sp.Float) else e


@final
class Plain:
    """SymPy expressions as they stand, for systems that are too large for a `Field`; the same methods."""

    def __init__(self, expressions: Sequence[Any]) -> None:
        self.elements = [sp.sympify(e) for e in expressions]

    def zero(self, element: Any) -> bool:
        """Return whether an element is identically zero, by its values at random points."""
        return vanishes(element)

    def weight(self, element: Any) -> tuple[int, int]:
        """Rank a pivot: numbers, then parameters, then functions of the configuration; short ones first."""
        moving = element.has(sp.core.function.AppliedUndef, sp.Derivative)
        return (0 if element.is_number else 2 if moving else 1, int(element.count_ops()))

    def expression(self, element: Any) -> Any:
        """Return the element."""
        return element


def arithmetic(expressions: Sequence[Any]) -> Field | Plain:
    """Return the arithmetic in which expressions are to be combined, holding them as its `elements`."""
    if sum(sp.sympify(e).count_ops() for e in expressions) > SMALL:
        return Plain(expressions)
    try:
        return Field(expressions)
    except sp.PolynomialError:  # a root of a square, such as the length of a straight spring, is no generator
        return Plain(expressions)


def row_echelon(matrix: Any) -> tuple[Any, tuple[int, ...]]:
    """Return the reduced row echelon form of a matrix and its pivot columns, one a row, in row order.

    Pivots that are numbers or parameters are preferred to those that depend on the configuration.
    """
    rows, columns = matrix.shape
    field = arithmetic(list(matrix))
    work = [field.elements[i * columns : (i + 1) * columns] for i in range(rows)]
    pivots = _eliminate(field, work, columns)
    return sp.Matrix(rows, columns, [field.expression(e) for row in work for e in row]), pivots


def solve(field: Field | Plain, matrix: Sequence[Sequence[Any]], right: Sequence[Any]) -> list[Any]:
    """Return x with matrix x = right, elements of `field`, for a square regular matrix.

    Raises
    ------
    ZeroDivisionError
        When the matrix is singular for every value of its symbols.
    """
    size = len(matrix)
    work = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    pivots = _eliminate(field, work, size)
    if len(pivots) < size:
        raise ZeroDivisionError("the matrix is singular")
    return [work[pivots.index(j)][size] for j in range(size)]


def _eliminate(field: Field | Plain, work: list[list[Any]], columns: int) -> tuple[int, ...]:
    """Bring `work` to reduced row echelon form in place, with pivots in the first `columns` columns."""
    pivots: list[int] = []
    for row in range(len(work)):
        ranks = [
            (*field.weight(work[i][j]), j, i)
            for i in range(row, len(work))
            for j in range(columns)
            if j not in pivots and not field.zero(work[i][j])
        ]
        if not ranks:
            break
        *_, j, i = min(ranks)
        work[row], work[i] = work[i], work[row]
        pivot = work[row][j]
        work[row] = [e / pivot if e != 0 else e for e in work[row]]
        for k in range(len(work)):
            factor = work[k][j]
            if k != row and not field.zero(factor):
                work[k] = [a - factor * b if b != 0 else a for a, b in zip(work[k], work[row], strict=True)]
        pivots.append(j)
    return tuple(pivots)


def null_space(matrix: Any) -> list[Any]:
    """Return columns that span the null space, freed of denominators so that they stay regular where they can."""
    count = matrix.shape[1]
    reduced, pivots = row_echelon(matrix)
    basis = []
    for j in (j for j in range(count) if j not in pivots):
        column = [sp.S.Zero] * count
        column[j] = sp.S.One
        for row, pivot in enumerate(pivots):
            column[pivot] = -reduced[row, j]
        if sum(e.count_ops() for e in column) <= SMALL:
            common = sp.S.One
            for e in column:
                common = sp.lcm(common, sp.denom(sp.together(e)))
            column = [sp.cancel(e * common) for e in column]
        basis.append(sp.Matrix(column))
    return basis
