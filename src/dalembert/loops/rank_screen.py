"""Screen of starts of cases: whether their constraints are independent, by far, in all of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..subset.arguments import Address, IntVector, Matrix
from ..subset.compiled_subset import call_code, compiled_subset, row, sqrt
from .screened_starts import ScreenedStarts, starts_are_made

_SHORT = 0.101
"""Share of the longest row from which a row has its own length in `dalembert.starts.constraint_rows`, rounded up."""


class RankArguments(NamedTuple):
    """Arguments of the loop.

    Attributes
    ----------
    starts : ScreenedStarts
        Its numbers of cases are overwritten.
    expand, jacobian, masses : Address
        Coordinates and rates of a state, the constraint Jacobian there, and the mass matrix or, where there is none,
        the momenta.
    by_rates : int
        Whether there are momenta.
    n_cases : int
        Number of cases.
    rows : (k,)
        Numbers of the constraints.
    angles : (n_q,) or (0,)
        1 for coordinates without a unit, else 0; none where all coordinates have one unit.
    least : float
        Product of what is new of each unit row, beside those before it, from which on rows are independent.
    x, whole, mass, unit, sizes : (n_x, lanes), (n_rows n_q, lanes), (n_q n_q or n_q, lanes), (k n_q, lanes), (n_q, 1)
        Are overwritten.
    """

    starts: ScreenedStarts
    expand: Address
    jacobian: Address
    masses: Address
    by_rates: int
    n_cases: int
    rows: IntVector
    angles: IntVector
    least: float
    x: Matrix
    whole: Matrix
    mass: Matrix
    unit: Matrix
    sizes: Matrix


@compiled_subset
def LOOP(arguments: RankArguments) -> int:
    """Return 1 where all cases can start and have independent constraints, else 0: then more has to be found out."""
    starts, first = arguments.starts, 0
    lanes, clock, constants = starts.clock.shape[1], row(starts.clock, 0), row(starts.constants, 0)
    while first < arguments.n_cases:
        for lane in range(lanes):
            starts.cases[lane] = min(first + lane, arguments.n_cases - 1)
        if not starts_are_made(starts):
            return 0
        call_code(arguments.expand, clock, row(starts.begun, 0), constants, 0, row(arguments.x, 0))
        call_code(arguments.jacobian, clock, row(arguments.x, 0), constants, 0, row(arguments.whole, 0))
        if first == 0 and not _has_sizes(arguments):
            return 0
        for lane in range(lanes):
            if not _is_independent(arguments, lane):
                return 0
        first += lanes
    return 1


@compiled_subset
def _has_sizes(arguments: RankArguments) -> bool:
    """Find the sizes of coordinates in the first case; return whether there are any.

    They are those of `dalembert.starts.state_sizes.gyration_sizes`.
    """
    angles, sizes, mass, starts = arguments.angles, arguments.sizes, arguments.mass, arguments.starts
    clock, x, constants, n = row(starts.clock, 0), arguments.x, row(starts.constants, 0), sizes.shape[0]
    for m in range(n):
        sizes[m, 0] = 1.0
    if angles.size == 0:
        return True
    if arguments.by_rates == 0:
        call_code(arguments.masses, clock, row(x, 0), constants, 0, row(mass, 0))
    inertia = total = 0.0
    for m in range(n):
        if arguments.by_rates != 0:
            for k in range(n):
                for lane in range(x.shape[1]):
                    x[n + k, lane] = 1.0 if k == m else 0.0
            call_code(arguments.masses, clock, row(x, 0), constants, 0, row(mass, 0))
        own = mass[m if arguments.by_rates != 0 else m * n + m, 0]
        if angles[m] != 0:
            inertia += own
        else:
            total += own
    if not (inertia > 0.0 and total > 0.0):
        return False
    for m in range(n):
        if angles[m] == 0:
            sizes[m, 0] = sqrt(inertia / total)
    return True


@compiled_subset
def _is_independent(arguments: RankArguments, lane: int) -> bool:
    """Return whether the constraints of a lane are independent, by far.

    The least singular value of unit rows is more than half the product of what is new of each, because the squares of
    all have the number of rows for their sum.
    """
    rows, unit, n = arguments.rows, arguments.unit, arguments.sizes.shape[0]
    longest, shortest, product = 0.0, np.inf, 1.0
    for i in range(rows.size):
        total = 0.0
        for m in range(n):
            value = arguments.whole[rows[i] * n + m, lane] * arguments.sizes[m, 0]
            unit[i * n + m, lane] = value
            total += value * value
        length = sqrt(total)
        if not length > 0.0:
            return False
        longest, shortest = max(longest, length), min(shortest, length)
        for m in range(n):
            unit[i * n + m, lane] /= length
        product *= _new(arguments, lane, i)
        if not product > arguments.least:
            return False
    return shortest > _SHORT * longest


@compiled_subset
def _new(arguments: RankArguments, lane: int, i: int) -> float:
    """Return how much of unit row i is new beside those before it, and leave that as a row of length one."""
    unit, n, total = arguments.unit, arguments.sizes.shape[0], 0.0
    for j in range(i):
        along = 0.0
        for m in range(n):
            along += unit[j * n + m, lane] * unit[i * n + m, lane]
        for m in range(n):
            unit[i * n + m, lane] -= along * unit[j * n + m, lane]
    for m in range(n):
        total += unit[i * n + m, lane] * unit[i * n + m, lane]
    for m in range(n):
        unit[i * n + m, lane] /= sqrt(total)
    return sqrt(total)
