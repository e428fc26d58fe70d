"""The conditions for a joint to be ideal, from the partial kinematic screws that the constraints leave free."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import sympy as sp

from ..scene import Joint
from ..scene.identity import vanishes
from .actions import Actions
from .energy import readable
from .numeric import States

__all__ = ["ideal_conditions", "single_unknowns"]


Clean = Callable[[Any], Any]
"""Returns a coefficient in readable form, zero where it vanishes."""


def ideal_conditions(
    actions: Actions, joint: Joint, unknowns: Sequence[Any], free: Sequence[Any], states: States
) -> list[sp.Expr]:
    """Return the expressions in the joint's unknowns that vanish when it has no power in any free virtual motion.

    Parameters
    ----------
    actions : Actions
    joint : Joint
    unknowns : sequence of Unknown
        All unknowns of the scene.
    free : sequence of column Matrix
        Virtual speeds that the constraints leave free.
    states : States
        States that satisfy the constraints: a pin that closes a loop has no power there, and only there.
    """

    def clean(expression: Any) -> Any:
        if vanishes(expression) or states.vanishes_on_constraints(expression):
            return sp.S.Zero
        return readable(expression)

    powers = sp.Matrix([actions.joint_power(joint, q) for q in actions.coordinates])
    rows = []
    for direction in free:
        power = (direction.T * powers)[0]
        row = {x: clean(power.diff(x)) for x in unknowns if power.has(x)}
        row = {x: e for x, e in row.items() if e != 0}
        if row:
            rows.append(row)
    conditions = [_condition(row) for row in _reduced(rows, clean)]
    return sorted(conditions, key=lambda e: [unknowns.index(x) for x in unknowns if e.has(x)])


def _reduced(rows: list[dict[Any, Any]], clean: Clean) -> list[dict[Any, Any]]:
    """Solve for single unknowns first, and put them into the other conditions, until nothing changes."""
    done: list[dict[Any, Any]] = []
    rows = list(rows)
    while True:
        single = next((row for row in rows if len(row) == 1), None)
        if single is None:
            break
        (x,) = single
        done.append({x: sp.S.One})
        rows = [{y: e for y, e in row.items() if y != x} for row in rows]
        rows = [row for row in rows if row]
    while rows:
        pivot = next(((row, x) for row in rows for x, e in row.items() if e.is_number), None)
        if pivot is None:
            done += _independent(rows)
            break
        row, x = pivot
        rows = [other if other is row else _eliminate(other, row, x, clean) for other in rows]
        rows.remove(row)
        rows = [other for other in rows if other]
        done = [other if x not in other else _eliminate(other, row, x, clean) for other in done]
        done.append(row)
        if any(len(other) == 1 for other in rows):
            return _reduced([*done, *rows], clean)
    return done


def _eliminate(other: dict[Any, Any], row: dict[Any, Any], x: Any, clean: Clean) -> dict[Any, Any]:
    if x not in other:
        return other
    factor = other[x] / row[x]
    keys = [*other, *(y for y in row if y not in other)]
    new = {y: clean(other.get(y, 0) - factor * row.get(y, 0)) for y in keys if y != x}
    return {y: e for y, e in new.items() if e != 0}


def _independent(rows: list[dict[Any, Any]]) -> list[dict[Any, Any]]:
    """Return rows without those that are multiples of an earlier one; further dependence cannot hide a condition."""
    kept: list[dict[Any, Any]] = []
    for row in rows:
        if not any(_parallel(row, other) for other in kept):
            kept.append(row)
    return kept


def _parallel(a: dict[Any, Any], b: dict[Any, Any]) -> bool:
    if a.keys() != b.keys():
        return False
    first = next(iter(a))
    return all(vanishes(a[x] * b[first] - b[x] * a[first]) for x in a)


def _condition(row: dict[Any, Any]) -> sp.Expr:
    """Return the condition as an expression, common factors dropped."""
    if len(row) == 1:
        return next(iter(row))
    total = sum((e * x for x, e in row.items()), sp.S.Zero)
    content, primitive = sp.factor_terms(sp.expand(total)).as_independent(*row, as_Add=False)
    return sp.expand(primitive) if content != 0 else total


def single_unknowns(conditions: Sequence[Any]) -> list[Any]:
    """Return the unknowns that conditions of the form X = 0 make vanish."""
    return [e for e in conditions if e.is_Symbol]
