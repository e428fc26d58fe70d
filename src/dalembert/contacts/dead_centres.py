"""Slip velocities that do not change: at dead centres, where they depend on the rates beside, or held by others."""

from __future__ import annotations

from ..subset.compiled_subset import compiled_subset, sqrt
from .contact_forces import compliance, hold_constraints, motionless, open_contacts
from .contact_system import STICK, Combination, ContactSystem, inertial_size
from .dense_solve import solve_dense

_MOVES = 1e-9
"""Share of a motion that the constraints allow, up to which rounding makes what it does to a coordinate."""


@compiled_subset
def _add_held(system: ContactSystem, row: int) -> None:
    """Add the products of a row's entries to ``square``: those of the row of unit length, in terms of the inertia."""
    size = inertial_size(system, system.jacobian[row])
    if size > 0.0:
        for a in range(system.coordinates):
            for b in range(system.coordinates):
                product = (system.jacobian[row, a] / size) * (system.jacobian[row, b] / size)
                system.square[a, b] += product / (_root_of_inertia(system, a) * _root_of_inertia(system, b))


@compiled_subset
def _root_of_inertia(system: ContactSystem, j: int) -> float:
    inertia = system.mass[j, j]
    return sqrt(inertia) if inertia > 0.0 else 1.0


@compiled_subset
def _left_free(system: ContactSystem, chosen: Combination) -> int:
    """Find the motions that the rows leave which hold in a mode, by the roots of inertias; return their number."""
    n, held = system.coordinates, hold_constraints(system, open_contacts(chosen))
    for a in range(n):
        for b in range(n):
            system.square[a, b] = 0.0
    for h in range(held):
        _add_held(system, system.held[h])
    for row in range(system.constraints, system.constraints + system.slips):
        if chosen.mode[system.row_owner[row]] == STICK and not motionless(system, row):
            _add_held(system, row)
    return solve_dense(system.square, system.square_right, n, 0, system.dense)


@compiled_subset
def held_by_others(system: ContactSystem, chosen: Combination, r: int) -> bool:
    """Return whether a slip velocity cannot change in a mode, because of what holds in it besides."""
    slopes = system.jacobian[system.constraints + r]
    for a in range(_left_free(system, chosen)):
        along, size = 0.0, 0.0
        for j in range(system.coordinates):
            term = slopes[j] / _root_of_inertia(system, j) * system.dense.free[a, j]
            along += term
            size = max(size, abs(term))
        if abs(along) > _MOVES * size:
            return False
    return True


@compiled_subset
def turns_back(system: ContactSystem, chosen: Combination, r: int) -> bool:
    """Return whether a slip velocity does not depend on the rates here, but will where the mode that is solved moves.

    So does that of a point at the dead centre of its path. Friction has no power on any motion there: it cannot hold
    the point, and the equations of the mode in which it sticks are singular. Where the mode holds all coordinates on
    which the slip depends, there is nothing to hold, and the point may stick.
    """
    if compliance(system, r, r) != 0.0 or not motionless(system, system.constraints + r):
        return False
    for a in range(_left_free(system, chosen)):
        for j in range(system.coordinates):
            if system.slides_by[r, j] != 0 and abs(system.dense.free[a, j]) > _MOVES:
                return True
    return False
