"""Conditions for a joint to be ideal, from screws that constraints leave free, and Coulomb's law between unknowns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import methodcaller
from typing import Any

import sympy as sp

from ..errors import ConstraintError, SceneError
from ..scene import CoulombFriction, Joint
from ..scene.contacts.laws import coulomb_law
from ..scene.expressions.identity import vanishes
from .actions import Actions
from .energy import readable
from .numeric import States

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


# Coulomb's law between unknown reaction components, as equation (4) of example 13.4.2 has it.


def friction_forces(laws: Sequence[CoulombFriction]) -> set[str]:
    """Return the names of the unknowns that are friction forces."""
    return {str(x) for law in map(coulomb_law, laws) if law is not None for x in _parts(law.tangential)}


def friction_laws(actions: Actions) -> dict[Any, Any]:
    """Return the friction forces of a scene while its contacts slip, in their normal reactions and the rates.

    One component is -mu N sign(w), where w is the slip velocity that it has power on: its size is mu N where the
    normal reaction N presses, and it opposes slip. Two components are -mu N w / |w|.

    Raises
    ------
    SceneError
        For a force that no joint exerts.
    """
    found: dict[Any, Any] = {}
    put = actions.geometry.put
    for law in map(coulomb_law, actions.scene.frictions):
        if law is None:  # of which the reader of the scene says so
            continue
        forces = _parts(law.tangential)
        given = law.slip is not None
        slips = [readable(put(e)) for e in _parts(law.slip)] if given else [_slip(actions, x) for x in forces]
        smooth = 0 if law.regularization is None else put(law.regularization)
        if smooth == 0 and len(forces) == 1:
            ways = [sp.sign(slips[0])]
        else:
            size = sp.sqrt(sum((w**2 for w in slips), sp.sympify(smooth) ** 2))
            ways = [w / size for w in slips]
        mu = law.mu(sp.sqrt(sum(w**2 for w in slips))) if callable(law.mu) else put(law.mu)
        found |= {force: -mu * put(law.normal) * way for force, way in zip(forces, ways, strict=True)}
    return found


def _slip(actions: Actions, force: Any) -> Any:
    """Return the slip velocity at a joint along a reaction component, on which the component has power.

    That of a component of a torque is an angular velocity.
    """
    geometry = actions.geometry
    for joint in actions.scene.joints:
        for kind, given in (("moment", joint.force), ("resultant", joint.torque)):
            vector = geometry.vector(given)
            held = {str(x): x for matrix, _ in vector.args for x in matrix.free_symbols}
            if str(force) in held:
                along = geometry.map(vector, methodcaller("diff", held[str(force)]))
                return readable(geometry.dot(along, getattr(actions.relative_screw(joint), kind)))
    raise SceneError(actions.scene.name, [f"friction: {force} is no component of the action of a joint"])


def refuse_friction(scene: str, laws: Sequence[CoulombFriction], what: str) -> None:
    """Raise for a scene with friction where the derivation needs ideal joints.

    Raises
    ------
    ConstraintError
        For a scene with friction.
    """
    if laws:
        names = ", ".join(repr(law.label) for law in laws)
        raise ConstraintError(
            f"scene {scene!r} has friction ({names}), and {what} are derived here for ideal joints. The Lagrange"
            " equations, the constraints and friction_laws determine the motion: compile the scene to have it, or take"
            " the view of the scene without friction"
        )


def _parts(value: Any) -> tuple[Any, ...]:
    return tuple(value) if isinstance(value, Sequence) else (value,)
