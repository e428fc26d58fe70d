"""Kinetic energy, and the operator of Lagrange."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import sympy as sp
from sympy.physics.mechanics import Particle
from sympy.physics.vector import dynamicsymbols

from ..errors import SceneError
from ..scene.expressions.identity import vanishes
from ..scene.frames import matrix_of
from .geometry import Geometry, squares
from .printing import text

if TYPE_CHECKING:
    from .numeric import States

READABLE = 400
"""Operations up to which an expression is expanded and simplified for reading."""

IDENTITIES = 100
"""Operations up to which SymPy's search for trigonometric identities is quick."""


def readable(expression: Any, limit: int = READABLE) -> Any:
    """Return an expression expanded and simplified by trigonometric identities, where it is small enough.

    SymPy's search for identities is most of the time of a view, and views of scenes that share bodies have many
    expressions in common: results are kept.
    """
    return _readable(sp.sympify(expression), limit)


@lru_cache(maxsize=4096, typed=True)
def _readable(expression: Any, limit: int) -> Any:
    if expression.count_ops() > limit:
        return expression
    expanded = sp.expand(expression)
    if not expanded.has(sp.sin, sp.cos, sp.tan, sp.cot):
        return expanded
    forms = [expanded, squares(expanded, sp.cos, sp.sin), squares(expanded, sp.sin, sp.cos)]
    if expanded.count_ops() <= IDENTITIES:
        forms.append(sp.trigsimp(expanded))
    angles = _angles(expanded)
    kept = [form for form in forms if all(_plain_sum(angle) for angle in _angles(form) - angles)]
    return min(kept, key=lambda e: (e.count_ops(), str(e)))


def _angles(expression: Any) -> set[Any]:
    return {f.args[0] for f in expression.atoms(sp.sin, sp.cos)}


def _plain_sum(angle: Any) -> bool:
    """Return whether an angle is a sum or difference of others, such as theta_1 - theta_2, without multiples."""
    return all(abs(factor) == 1 for factor in angle.as_coefficients_dict().values())


def readable_fraction(expression: Any) -> Any:
    """Return a quotient of polynomials with numerator and denominator made readable."""
    expression = sp.sympify(expression)
    if expression.count_ops() > 5 * READABLE:
        return expression
    numerator, denominator = sp.fraction(expression)
    if denominator.is_number or not denominator.has(sp.sin, sp.cos):
        return sp.factor_terms(readable(expression))
    top, bottom = (sp.factor_terms(readable(e, limit=2000)) for e in (numerator, denominator))
    if bottom.could_extract_minus_sign():
        top, bottom = -top, -bottom
    return sp.factor_terms(top) / bottom


def kinetic_energy(geometry: Geometry, body: Any) -> sp.Expr:
    """Return m v_G^2 / 2 + omega . I_G . omega / 2 of a body, all rates taken as independent (13.1.2)."""
    put = geometry.put
    if isinstance(body, Particle):
        v = geometry.velocity(body.point)
        return put(body.mass) * geometry.dot(v, v) / 2
    v = geometry.velocity(body.masscenter)
    omega = geometry.components(geometry.angular_velocity(body.frame), body.frame)
    inertia = matrix_of(body.central_inertia, body.frame).applyfunc(put)
    return put(body.mass) * geometry.dot(v, v) / 2 + (omega.T * inertia * omega)[0] / 2


def lagrange_operator(kinetic: Any, coordinate: Any) -> sp.Expr:
    """Return (d/dt d/dq_dot - d/dq) T, the left-hand side of a Lagrange equation (13.4.4).

    Parameters
    ----------
    kinetic : Expr
        Kinetic energy, formed with all constraints ignored (assumption 13.1.2). With any other expression the
        result is a wrong equation (remark 13.4.8).
    coordinate : dynamicsymbol
        The coordinate q.
    """
    time = dynamicsymbols._t
    kinetic = sp.sympify(kinetic)
    return kinetic.diff(coordinate.diff(time)).diff(time) - kinetic.diff(coordinate)


def check_kinetic_energy(
    scene: str, given: Any, derived: Any, constraints: Sequence[Any], coordinates: Sequence[Any], states: States
) -> None:
    """Reject a kinetic energy that is not T with all coordinates and rates independent (remark 13.4.8).

    Raises
    ------
    SceneError
        With the reason: it was simplified with a constraint, or it is the energy of something else.
    """
    functions = {*coordinates, *derived.atoms(sp.core.function.AppliedUndef)}
    strange = sorted(str(f) for f in sp.sympify(given).atoms(sp.core.function.AppliedUndef) if f not in functions)
    difference = given - derived
    if strange:
        raise SceneError(
            scene, [f"the kinetic energy contains {', '.join(strange)}, which is no coordinate of the scene"]
        )
    if vanishes(difference):
        return
    shown = text(readable(difference))
    used = [text(c.equation) for c in constraints if _multiple(difference, c.expression)]
    if states.vanishes_on_constraints(difference):
        named = " and ".join(used or [text(c.equation) for c in constraints])
        raise SceneError(
            scene,
            [
                "the kinetic energy given is right only where the constraints hold: it was simplified with"
                f" {named} before differentiation. Its value is correct, but its derivatives are not, because "
                f"coordinates"
                " and rates must be independent variables in it (assumption 13.1.2, remark 13.4.8), and the Lagrange"
                f" equations that would follow are wrong. It lacks {text(readable(-difference))}. Leave the constraint"
                " out of the kinetic energy, or let dalembert derive it"
            ],
        )
    raise SceneError(
        scene,
        [f"the kinetic energy given is not that of the scene: it exceeds it by {shown}. Correct it, or leave it out"],
    )


def _multiple(difference: Any, constraint: Any) -> bool:
    """Return whether `constraint` divides `difference`, for the message."""
    quotient = sp.cancel(sp.together(difference / constraint)) if difference.count_ops() < READABLE else sp.nan
    return bool(sp.denom(quotient).is_number or not sp.denom(quotient).has(sp.Derivative))
