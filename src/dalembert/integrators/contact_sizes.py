"""Sizes of gaps and of slow rates, by which contacts are compared with zero in any unit."""

from __future__ import annotations

from .arguments import Matrix
from .compiled_subset import compiled_subset, sqrt
from .contact_table import GAP, ContactSpace, ContactTable, mass, number, slope

__all__ = ["NOISE", "gap_noise", "slow_terms"]

NOISE = 1e-8
"""Share of a velocity, or of a position, below which it counts as zero."""

_ROUNDED_LENGTH, _AT_REST, _SLOW_SHARE = 1e-12, 1e-8, 1e-4
"""Those of `dalembert.reduction.start_limits`: a length and a speed that rounding may have left of zero, and the share
of the speed of the whole motion that counts as a rate where less moves."""


@compiled_subset
def _length_size(table: ContactTable, space: ContactSpace, x: Matrix, case: int) -> float:
    """Return the size of the coordinates with a unit, of which the variables are in a row of x (k, 2 n_q + n_z).

    The largest of them, and at least the radius of gyration where there are angles; one where that is rounding.
    """
    largest, inertia, weight = 0.0, 0.0, 0.0
    for j in range(table.coordinates):
        if table.angle[j] != 0:
            inertia += mass(table, space, j, j)
        else:
            weight += mass(table, space, j, j)
            largest = max(largest, abs(x[case, j]))
    if inertia > 0.0 and weight > 0.0:
        largest = max(largest, sqrt(inertia / weight))
    return largest if largest > _ROUNDED_LENGTH else 1.0


@compiled_subset
def gap_noise(table: ContactTable, space: ContactSpace, x: Matrix, case: int, i: int) -> float:
    """Return the size below which the gap of a contact counts as zero at a start; x as before."""
    total, length = abs(number(table, space, i, GAP)), _length_size(table, space, x, case)
    for j in range(table.coordinates):
        size = 1.0 if table.angle[j] != 0 else length
        total += abs(slope(table, space, table.constraint[i], j)) * max(abs(x[case, j]), size)
    return NOISE * total


@compiled_subset
def slow_terms(table: ContactTable, space: ContactSpace, x: Matrix, case: int, row: int) -> float:
    """Return the least size of the terms of the rate of a constraint, or of a slip velocity; x as before."""
    total, speed, length = 0.0, 0.0, _length_size(table, space, x, case)
    for j in range(table.coordinates):
        size = 1.0 if table.angle[j] != 0 else length
        total += abs(slope(table, space, row, j)) * size
        speed += abs(space.rates[j]) / size
    return _SLOW_SHARE * (speed if speed > _AT_REST else 1.0) * total
