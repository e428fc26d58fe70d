"""Small linear systems with trigonometric entries, solved in closed form.

Entries become elements of the field of rational functions in the sines, cosines, symbols and rates
that occur; sin^2 = 1 - cos^2 is used after every operation, so that a pivot is zero exactly when
its normal form is. Matrices too large for that are eliminated as they stand, with pivots tested
numerically.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import sympy as sp
from sympy.polys.fields import sfield

from ..scene.identity import vanishes

__all__ = ["Field", "null_space", "row_echelon", "solve"]

SMALL = 2500
"""Operations of a system up to which it is treated in the field of rational functions."""


@final
class Field:
    """Rational functions in the generators of some expressions, with sin^2 + cos^2 = 1."""

    def __init__(self, expressions: Sequence[Any]) -> None:
        plain = [self._plain(e) for e in expressions]
        angles = sorted({f.args[0] for e in plain for f in e.atoms(sp.sin, sp.cos)}, key=sp.default_sort_key)
        self._names: dict[Any, Any] = {}
        relations = []
        for i, angle in enumerate(angles):
            s, c = sp.Symbol(f"s_{i}"), sp.Symbol(f"c_{i}")
            self._names[sp.sin(angle)], self._names[sp.cos(angle)] = s, c
            relations.append(s**2 + c**2 - 1)
        leaves = sorted(
            {a for e in plain for a in e.atoms(sp.Derivative, sp.core.function.AppliedUndef)},
            key=lambda a: (-a.count(sp.Derivative), sp.default_sort_key(a)),
        )
        for i, leaf in enumerate(leaves):
            self._names[leaf] = sp.Symbol(f"v_{i}")
        self._back = {symbol: leaf for leaf, symbol in self._names.items()}
        named = [e.xreplace(self._names) for e in plain]
        symbols = sorted({s for e in (*named, *relations) for s in e.free_symbols}, key=self._order)
        if not symbols:
            symbols = [sp.Symbol("unit")]
        self.field, elements = sfield([*named, *relations, *symbols], *symbols, order="lex")
        count = len(named)
        self.elements = elements[:count]
        self._relations = [e.numer for e in elements[count : count + len(relations)]]
        self.elements = [self.normal(e) for e in self.elements]

    @staticmethod
    def _order(symbol: Any) -> tuple[int, str]:
        """Put the sines first, so that their squares are the leading terms of the relations."""
        return (0 if symbol.name.startswith("s_") else 1, symbol.name)

    @staticmethod
    def _plain(e: Any) -> Any:
        e = sp.sympify(e)
        if e.has(sp.tan, sp.cot, sp.sec, sp.csc):
            e = e.replace(sp.tan, lambda x: sp.sin(x) / sp.cos(x)).replace(sp.cot, lambda x: sp.cos(x) / sp.sin(x))
            e = e.replace(sp.sec, lambda x: 1 / sp.cos(x)).replace(sp.csc, lambda x: 1 / sp.sin(x))
        e = e.replace(
            lambda f: isinstance(f, sp.sin | sp.cos) and (f.args[0].is_Add or f.args[0].is_Mul), sp.expand_trig
        )
        return sp.nsimplify(e, rational=True) if e.has(sp.Float) else e

    def normal(self, element: Any) -> Any:
        """Return the element with every sin^2 replaced by 1 - cos^2."""
        if not self._relations or not element:
            return element
        numerator = element.numer.rem(self._relations)
        if not numerator:
            return self.field.zero
        return self.field.new(numerator, element.denom.rem(self._relations))

    def expression(self, element: Any) -> Any:
        """Return the SymPy expression of an element."""
        return element.as_expr().xreplace(self._back)


def _fits(entries: Sequence[Any]) -> bool:
    return sum(sp.sympify(e).count_ops() for e in entries) <= SMALL


def row_echelon(matrix: Any) -> tuple[Any, tuple[int, ...]]:
    """Return the reduced row echelon form of a matrix and its pivot columns.

    Pivots that are numbers or parameters are preferred to those that depend on the configuration.
    """
    matrix = sp.Matrix(matrix)
    rows, columns = matrix.shape
    if _fits(list(matrix)):
        field = Field(list(matrix))
        work = [[field.elements[i * columns + j] for j in range(columns)] for i in range(rows)]
        pivots = _eliminate(work, columns, field.normal, lambda e: not e, lambda e: _weight(field.expression(e)))
        back = [[field.expression(e) for e in row] for row in work]
    else:
        back = [list(matrix.row(i)) for i in range(rows)]
        pivots = _eliminate(back, columns, lambda e: e, vanishes, _weight)
    return sp.Matrix(back), pivots


def _weight(entry: Any) -> tuple[int, int]:
    """Rank a pivot: numbers, then parameters, then functions of the configuration."""
    moving = entry.has(sp.core.function.AppliedUndef, sp.Derivative)
    return (0 if entry.is_number else 2 if moving else 1, int(entry.count_ops()))


def _eliminate(work: list[list[Any]], columns: int, normal: Any, zero: Any, weight: Any) -> tuple[int, ...]:
    """Bring `work` to reduced row echelon form in place; return the pivot columns, one a row, in row order."""
    pivots: list[int] = []
    row = 0
    while row < len(work):
        best: Any = None
        for i in range(row, len(work)):
            for j in range(columns):
                if j in pivots or zero(work[i][j]):
                    continue
                rank = (*weight(work[i][j]), j, i)
                if best is None or rank < best[0]:
                    best = (rank, i, j)
        if best is None:
            break
        _, i, j = best
        work[row], work[i] = work[i], work[row]
        pivot = work[row][j]
        work[row] = [normal(e / pivot) if e != 0 else e for e in work[row]]
        for k in range(len(work)):
            factor = work[k][j]
            if k != row and not zero(factor):
                work[k] = [normal(a - factor * b) if b != 0 else a for a, b in zip(work[k], work[row], strict=True)]
        pivots.append(j)
        row += 1
    return tuple(pivots)


def solve(matrix: Any, right: Sequence[Any]) -> list[Any]:
    """Return x with matrix x = right for a square regular matrix, by elimination with the best pivots.

    Raises
    ------
    ZeroDivisionError
        When the matrix is singular for every value of its symbols.
    """
    matrix = sp.Matrix(matrix)
    size = matrix.shape[0]
    whole = matrix.row_join(sp.Matrix(size, 1, list(right)))
    if _fits(list(whole)):
        field = Field(list(whole))
        columns = size + 1
        work = [[field.elements[i * columns + j] for j in range(columns)] for i in range(size)]
        pivots = _eliminate(work, size, field.normal, lambda e: not e, lambda e: _weight(field.expression(e)))
        if len(pivots) < size:
            raise ZeroDivisionError("singular")
        return [field.expression(work[pivots.index(j)][size]) for j in range(size)]
    work = [list(whole.row(i)) for i in range(size)]
    pivots = _eliminate(work, size, lambda e: e, vanishes, _weight)
    if len(pivots) < size:
        raise ZeroDivisionError("singular")
    return [work[pivots.index(j)][size] for j in range(size)]


def null_space(matrix: Any) -> list[Any]:
    """Return columns that span the null space, freed of denominators so that they stay regular where they can."""
    matrix = sp.Matrix(matrix)
    count = matrix.shape[1]
    reduced, pivots = row_echelon(matrix)
    basis = []
    for j in (j for j in range(count) if j not in pivots):
        column = [sp.S.Zero] * count
        column[j] = sp.S.One
        for row, pivot in enumerate(pivots):
            column[pivot] = -reduced[row, j]
        if _fits(column):
            denominators = [sp.denom(sp.together(e)) for e in column]
            common = denominators[0]
            for d in denominators[1:]:
                common = sp.lcm(common, d)
            column = [sp.cancel(e * common) for e in column]
        basis.append(sp.Matrix(column))
    return basis
