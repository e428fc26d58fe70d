"""Dead centres: positions at which a slip velocity does not depend on the rates."""

from __future__ import annotations

from ...subset.compiled_subset import compiled_subset, sqrt
from ..contact_system import ContactSystem, inertia_of, inertial_size

_POWERLESS = 1e-12
"""Share of the slopes of a gap, or of a slip velocity itself, up to which rounding makes those of a slip velocity."""

_DEPENDENT = 1e-9
"""Share of a constraint that others leave of it, up to which it depends on them."""


@compiled_subset
def _clear(system: ContactSystem, place: int, count: int) -> float:
    """Take orthonormal rows of ``saddle``, the first ones, out of another one; return the length of the rest."""
    n, left = system.coordinates, 0.0
    for _ in range(2):
        for h in range(count):
            along = 0.0
            for j in range(n):
                along += system.saddle[h, j] * system.saddle[place, j]
            for j in range(n):
                system.saddle[place, j] -= along * system.saddle[h, j]
    for j in range(n):
        left += system.saddle[place, j] * system.saddle[place, j]
    return sqrt(left)


@compiled_subset
def _follows(system: ContactSystem, row: int) -> bool:
    """Return whether a slip velocity follows from the constraints that never open, written to ``saddle``."""
    n, count = system.coordinates, 0
    for h in range(system.constraints + 1):
        each = h if h < system.constraints else row
        if each != row and system.row_owner[each] >= 0:
            continue
        size = inertial_size(system, system.jacobian[each])
        for j in range(n):
            inertia = inertia_of(system, j)
            slope = system.jacobian[each, j] / sqrt(inertia if inertia > 0.0 else 1.0)
            system.saddle[count, j] = slope / size if size > 0.0 else 0.0
        left = _clear(system, count, count)
        if each == row:
            return left <= _POWERLESS
        if left > _DEPENDENT:
            for j in range(n):
                system.saddle[count, j] /= left
            count += 1
    return False


@compiled_subset
def motionless(system: ContactSystem, row: int) -> bool:
    """Return whether a slip velocity does not depend on the rates here, compared with how the gap does.

    Where the contact never opens, it does not depend on the rates that constraints allow which never open.
    """
    constraint = system.constraint[system.row_owner[row]]
    if constraint < 0:
        return system.loose[row - system.constraints] != 0 and _follows(system, row)
    gap = inertial_size(system, system.jacobian[constraint])
    return inertial_size(system, system.jacobian[row]) <= _POWERLESS * gap
