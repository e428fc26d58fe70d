"""Constraints as Pfaffian forms, classified by the Frobenius condition."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any, final

import sympy as sp

from ..frozen import frozen
from ..scene.expressions.identity import vanishes
from .energy import readable
from .linear import null_space


@final
@frozen
class Constraint:
    """One constraint of a scene.

    Attributes
    ----------
    expression : Expr
        Expression that vanishes.
    holonomic : bool
        Whether it was given in coordinates and time.
    rheonomic : bool
        Whether time occurs in it.
    form : tuple of Expr, length n_q + 1
        Coefficients of dq and dt in the Pfaffian form: form . (q_dot, 1) = 0.
    integrable : bool
        Whether it is equivalent to a holonomic constraint, together with the others.
    obstruction : Expr
        For one that is not integrable, a coefficient of the Frobenius condition that does not vanish; else zero.
    reason : str
        Reason for the classification.
    """

    expression: Any
    holonomic: bool
    rheonomic: bool
    form: tuple[Any, ...]
    integrable: bool
    obstruction: Any
    reason: str

    @property
    def equation(self) -> sp.Eq:
        """The constraint as an equation."""
        return sp.Eq(self.expression, 0, evaluate=False)


def exterior(form: Sequence[Any], variables: Sequence[Any]) -> Any:
    """Return the matrix of d(omega): entry (i, j) is d a_j / dx_i - d a_i / dx_j."""
    size = len(variables)
    return sp.Matrix(size, size, lambda i, j: form[j].diff(variables[i]) - form[i].diff(variables[j]))


def frobenius(form: Sequence[Any], variables: Sequence[Any]) -> dict[tuple[Any, ...], Any]:
    """Return the coefficients of omega ^ d(omega) by triple of variables; all vanish for an integrable form.

    In three variables the only coefficient is a . curl a.
    """
    d = exterior(form, variables)
    return {
        (variables[i], variables[j], variables[k]): form[i] * d[j, k] + form[j] * d[k, i] + form[k] * d[i, j]
        for i, j, k in combinations(range(len(variables)), 3)
    }


def pfaffian(
    holonomic: Sequence[Any], nonholonomic: Sequence[Any], coordinates: Sequence[Any], time: Any
) -> list[tuple[Any, ...]]:
    """Return the coefficients of dq and dt of every constraint, holonomic ones first."""
    rates = [q.diff(time) for q in coordinates]
    still = dict.fromkeys(rates, sp.S.Zero)
    forms = [(*(c.diff(q) for q in coordinates), explicit_rate(c, coordinates, time)) for c in holonomic]
    forms += [(*(c.diff(v).doit() for v in rates), c.xreplace(still)) for c in nonholonomic]
    return forms


def classify(
    holonomic: Sequence[Any], nonholonomic: Sequence[Any], coordinates: Sequence[Any], time: Any
) -> tuple[Constraint, ...]:
    """Return the constraints with their Pfaffian forms and the result of the Frobenius condition.

    A nonholonomic constraint is integrable when d(omega) vanishes on all pairs of directions that the
    constraints together leave free (Frobenius); for a single one that is omega ^ d(omega) = 0.
    """
    forms = pfaffian(holonomic, nonholonomic, coordinates, time)
    variables = [*coordinates, time]
    found = []
    for c, form in zip(holonomic, forms, strict=False):
        rheonomic = _explicit(c, coordinates, time)
        found.append(Constraint(c, True, rheonomic, form, True, sp.S.Zero, "given in coordinates"))
    free = null_space(sp.Matrix(forms)) if nonholonomic and len(forms) > 1 else []
    for c, form in zip(nonholonomic, forms[len(holonomic) :], strict=True):
        rheonomic = _explicit(c, coordinates, time)
        found.append(_nonholonomic(c, rheonomic, form, variables, coordinates, free, alone=len(forms) == 1))
    return tuple(found)


def explicit_rate(c: Any, coordinates: Sequence[Any], time: Any) -> Any:
    """Return the partial derivative in time, coordinates and rates held."""
    rates = {q.diff(time): sp.Dummy() for q in coordinates}
    names = {q: sp.Dummy() for q in coordinates}
    back = {d: q for q, d in (*rates.items(), *names.items())}
    return sp.sympify(c).xreplace(rates).xreplace(names).diff(time).xreplace(back)


def _explicit(c: Any, coordinates: Sequence[Any], time: Any) -> bool:
    """Return whether time occurs in `c` otherwise than in coordinates and rates."""
    names = {q: sp.Dummy() for q in coordinates}
    rates = {q.diff(time): sp.Dummy() for q in coordinates}
    return bool(sp.sympify(c).xreplace(rates).xreplace(names).has(time))


def _nonholonomic(
    c: Any,
    rheonomic: bool,
    form: Sequence[Any],
    variables: Sequence[Any],
    coordinates: Sequence[Any],
    free: Sequence[Any],
    *,
    alone: bool,
) -> Constraint:
    names = {q: sp.Symbol(f"x_{i}") for i, q in enumerate(coordinates)}
    back = {symbol: q for q, symbol in names.items()}
    plain = [e.xreplace(names) for e in form]
    axes = [names.get(x, x) for x in variables]
    if alone:
        coefficients = list(frobenius(plain, axes).values())
        condition = "omega ^ d(omega)"
    else:
        d = exterior(plain, axes)
        vectors = [v.xreplace(names) for v in free]
        coefficients = [(u.T * d * v)[0] for u, v in combinations(vectors, 2)]
        condition = "d(omega) on the directions that the constraints leave free"
    for value in coefficients:
        if not vanishes(value):
            obstruction = readable(value.xreplace(back))
            return Constraint(c, False, rheonomic, tuple(form), False, obstruction, f"{condition} does not vanish")
    return Constraint(c, False, rheonomic, tuple(form), True, sp.S.Zero, f"{condition} vanishes")
