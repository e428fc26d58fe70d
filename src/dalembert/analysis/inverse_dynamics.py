"""Inverse dynamics: loads that give a motion its accelerations.

With a basis N of what the constraints leave free, N^T B u = N^T (M q_ddot - f) is solved for the inputs u, by least
norm (`dalembert.analysis.inverse_kernel` has the terms).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import FloatArray
from ..errors import ValueInputError, list_names
from ..ir.conditions import CONDITION_TIME
from ..ir.interpret import interpret_rows
from .inverse_kernel import DEPENDENT, InverseKernel, Terms

if TYPE_CHECKING:
    from ..model.model import CompiledModel

TOLERANCE = 1e-8
"""Share of the terms of an equation below which its residual counts as rounding."""

ROUNDING = 1e-12
"""Size of rounding beside squares of rates, of which the bias of a constraint is a difference."""


def inverse_dynamics_at(
    model: CompiledModel, inverse: InverseKernel, t: FloatArray, y: FloatArray, p: FloatArray
) -> FloatArray:
    """Return the inputs, or generalised forces, (k, n_u) at times (k,), rows (k, n) and parameters (n_p,) or (k, n_p).

    The rows hold coordinates, rates, first-order states and second rates.

    Raises
    ------
    ValueInputError
        Where accelerations contradict the constraints, or no inputs give them, with the residual.
    """
    size, found = len(inverse.coordinates), np.empty((len(t), len(inverse.unknown)))
    for place, (where, terms) in enumerate(terms_at(model, inverse, t, y, at_times(model, t, p))):
        _refuse_contradiction(inverse, terms, y[place, size : 2 * size], y[place, -size:], where)
        found[place] = _solved(inverse, terms, where)
    return found


def at_times(model: CompiledModel, t: FloatArray, p: FloatArray) -> FloatArray:
    """Return parameters (k, n_p) with the times (k,) of conditions."""
    p = np.array(np.broadcast_to(p, (len(t), p.shape[-1])), order="C")
    if CONDITION_TIME in model.layout.parameters:
        p[:, model.layout.parameters.index(CONDITION_TIME)] = t
    return p


def terms_at(
    model: CompiledModel, inverse: InverseKernel, t: FloatArray, y: FloatArray, p: FloatArray
) -> Iterator[tuple[str, Terms]]:
    """Yield a text that says where, and the terms, at times (k,), rows (k, n) and parameters (k, n_p).

    Raises
    ------
    ValueInputError
        For terms that are not finite, and contacts that are closed.
    """
    if model.modes is None:
        rows = model.engine.rows(inverse.kernel, t, y, p)
    else:
        rows = interpret_rows(inverse.kernel, t, y, p)
    for place, row in enumerate(rows):
        where = f"at t = {t[place]:g}" + (f" (state {place} of {len(t)})" if len(t) > 1 else "")
        if not np.all(np.isfinite(row)):
            raise ValueInputError(f"{where} the equations have values that are not finite")
        terms = inverse.terms(row)
        closed = [f"{name!r} ({gap:.3g})" for name, gap in zip(inverse.stops, terms.gaps, strict=True) if gap <= 0.0]
        if closed:
            raise ValueInputError(
                f"{where} the gap of {list_names(closed)} is not open: the motion does not determine the force of a"
                " contact"
            )
        yield where, terms


def _refuse_contradiction(
    inverse: InverseKernel, terms: Terms, rates: FloatArray, second: FloatArray, where: str
) -> None:
    """Reject second rates (n_q,) that the constraints do not allow."""
    left, sizes = terms.jacobian @ second - terms.bias, np.abs(terms.jacobian)
    terms_of_bias = np.max(sizes, axis=1, initial=0.0) * np.max(np.abs(rates), initial=0.0) ** 2
    allowed = TOLERANCE * (sizes @ np.abs(second) + np.abs(terms.bias)) + ROUNDING * terms_of_bias
    broken = [
        f"{label} (by {value:.3g})"
        for label, value, most in zip(inverse.constraints, left, allowed, strict=True)
        if abs(value) > most
    ]
    if broken:
        raise ValueInputError(
            f"{where} the accelerations contradict {'; '.join(broken)}: its second rate does not vanish. Take second"
            " rates of a motion on the constraints, such as those of model.accelerations"
        )


def _solved(inverse: InverseKernel, terms: Terms, where: str) -> FloatArray:
    """Return the loads at one state."""
    forces = terms.forces - (terms.friction_senses * terms.friction[0]) @ terms.friction[3]
    scales, free = terms.roots, terms.free_directions
    demand, by_input = (terms.inertia - forces) / scales, terms.by_input / scales[:, np.newaxis]
    wanted, able = free.T @ demand, free.T @ by_input
    loads = inverse_of(able) @ wanted
    left = wanted - able @ loads
    size = np.max(np.abs(np.concatenate([terms.inertia, terms.forces])) / np.tile(scales, 2), initial=0.0)
    size = max(size, float(np.max(np.abs(by_input) @ np.abs(loads), initial=0.0)))
    if np.max(np.abs(left), initial=0.0) > TOLERANCE * size:
        lacking = scales * (free @ left)
        shares = np.abs(lacking / scales)
        named = [
            f"{name} ({lacking[i]:.3g})"
            for i, name in enumerate(inverse.coordinates)
            if shares[i] > 0.01 * np.max(shares)
        ]
        raise ValueInputError(
            f"{where} the inputs {list_names(inverse.unknown)} cannot produce these accelerations: generalised forces"
            f" along {list_names(named)} are lacking. Give accelerations that the inputs can produce, or more inputs"
        )
    return loads


def inverse_of(able: FloatArray) -> FloatArray:
    """Return the pseudo-inverse of what inputs do along the free directions."""
    return np.asarray(np.linalg.pinv(able, rcond=DEPENDENT)) if able.size else np.zeros(able.shape[::-1])
