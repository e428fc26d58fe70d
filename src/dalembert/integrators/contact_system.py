"""Contact forces at an instant: accelerations, or rates after an impact, in any mode of the contacts.

Motion, normal reactions, gap
accelerations and slip accelerations are affine in the friction forces; a mode makes these unknown (sticking), or
proportional to the normal reactions (sliding).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from .compiled_subset import compiled_subset, sqrt
from .contact_table import (
    MU,
    OPEN,
    SLIP,
    SMOOTH,
    STICK,
    ContactSpace,
    ContactTable,
    bias,
    drift,
    mass,
    number,
    reaction,
    row_size,
    slope,
)
from .dense_solve import solve_dense

__all__ = [
    "compliance",
    "load_accelerations",
    "load_impact",
    "normal_response",
    "respond",
    "shift_forces",
    "solve_mode",
]


_STEP, _MOST_STEPS = 2.0**20, 50
"""Factor between scales, and most of them: sizes of ordinary units keep the scale one."""

_POWERLESS = 1e-12
"""Share of the slip acceleration that friction would cause if nothing else held, up to which rounding makes it; and
share of the slopes of a gap, up to which it makes those of a slip velocity."""


@compiled_subset
def load_accelerations(table: ContactTable, space: ContactSpace) -> None:
    """Have accelerations solved for."""
    n = table.coordinates
    for i in range(n):
        space.load[i] = space.values[n * n + i]
    for row in range(table.constraints):
        space.demand[row] = bias(table, space, row)
    for row in range(table.slips):
        space.slip_demand[row] = bias(table, space, table.constraints + row)
    for place in range(space.kept.size):
        space.kept[place] = -1
    _choose_scales(table, space)


@compiled_subset
def load_impact(table: ContactTable, space: ContactSpace, after: FloatArray) -> None:
    """Have the rates after an impact solved for, ``after`` (n_constraints,) being those of the constraints."""
    n = table.coordinates
    for i in range(n):
        value = 0.0
        for j in range(n):
            value += mass(table, space, i, j) * space.rates[j]
        space.load[i] = value
    for row in range(table.constraints):
        space.demand[row] = after[row] - drift(table, space, row)
    for row in range(table.slips):
        space.slip_demand[row] = -drift(table, space, table.constraints + row)
    for place in range(space.kept.size):
        space.kept[place] = -1
    _choose_scales(table, space)


@compiled_subset
def _scale_of(size: float) -> float:
    """Return a power of two that brings a size near one; one where there is nothing to scale."""
    scale = 1.0
    if size > 0.0:
        for _ in range(_MOST_STEPS):
            if size * scale > 1024.0:
                scale /= _STEP
            elif size * scale < 1.0 / 1024.0:
                scale *= _STEP
            else:
                break
    return scale


@compiled_subset
def _choose_scales(table: ContactTable, space: ContactSpace) -> None:
    """Choose the scales of accelerations, multipliers and reactions, by the mass matrix."""
    n, m = table.coordinates, table.constraints
    for j in range(n):
        space.scales[j] = _scale_of(sqrt(max(mass(table, space, j, j), 0.0)))
    for row in range(m):
        size = 0.0
        for j in range(n):
            size = max(size, abs(slope(table, space, row, j)) * space.scales[j])
        space.scales[n + row] = _scale_of(size)
    for unknown in range(table.unknowns):
        size = 0.0
        for j in range(n):
            size = max(size, abs(reaction(table, space, j, unknown)) * space.scales[j])
        space.scales[n + m + unknown] = _scale_of(size)


@compiled_subset
def respond(table: ContactTable, space: ContactSpace, opened: int) -> int:
    """Find how the motion responds to friction with some contacts open, as bits; return the row of ``responses``."""
    place = opened % space.kept.size
    if space.kept[place] == opened:
        return place
    space.kept[place] = opened
    n, s, width = table.coordinates, table.slips, 1 + table.slips
    held = _hold(table, space, opened)
    size = n + held
    for i in range(size):
        for j in range(size):
            space.saddle[i, j] = 0.0
        for j in range(width):
            space.saddle_right[i, j] = 0.0
    for i in range(n):
        for j in range(n):
            space.saddle[i, j] = mass(table, space, i, j) * space.scales[i] * space.scales[j]
        space.saddle_right[i, 0] = space.load[i] * space.scales[i]
        for j in range(s):
            space.saddle_right[i, 1 + j] = reaction(table, space, i, table.tangential[j]) * space.scales[i]
    for a in range(held):
        row = space.held[a]
        for j in range(n):
            entry = slope(table, space, row, j) * space.scales[n + row] * space.scales[j]
            space.saddle[n + a, j] = entry
            space.saddle[j, n + a] = -entry
        space.saddle_right[n + a, 0] = space.demand[row] * space.scales[n + row]
    solve_dense(space.saddle, space.saddle_right, size, width, space.dense)
    for i in range(size):
        for j in range(width):
            space.saddle_right[i, j] *= space.scales[i if i < n else n + space.held[i - n]]
    _reactions(table, space, held, opened)
    _write(table, space, place, opened)
    return place


@compiled_subset
def _opening(table: ContactTable, opened: int, row: int) -> bool:
    """Return whether a constraint is that of an open contact."""
    for i in range(table.constraint.size):
        if table.constraint[i] == row and opened >> i & 1 != 0:
            return True
    return False


@compiled_subset
def _hold(table: ContactTable, space: ContactSpace, opened: int) -> int:
    """List the constraints that hold with some contacts open; return their number."""
    held = 0
    for row in range(table.constraints):
        if not _opening(table, opened, row):
            space.held[held] = row
            held += 1
    return held


@compiled_subset
def _columns(table: ContactTable, space: ContactSpace, opened: int) -> int:
    """List the reactions that hold constraints with some contacts open; return their number."""
    count = 0
    for unknown in range(table.unknowns):
        kept, needed = True, False
        for j in range(table.slips):
            kept = kept and table.tangential[j] != unknown
        for i in range(table.normal.size):
            if table.normal[i] == unknown:
                needed = True
                kept = kept and opened >> i & 1 == 0
        size = 0.0
        for i in range(table.coordinates):
            size += abs(reaction(table, space, i, unknown))
        if kept and (needed or size != 0.0):
            space.columns[count] = unknown
            count += 1
    return count


@compiled_subset
def _reactions(table: ContactTable, space: ContactSpace, held: int, opened: int) -> None:
    """Solve for the reactions that do what the multipliers do, into ``square_right``: those of least norm."""
    n, width, count = table.coordinates, 1 + table.slips, _columns(table, space, opened)
    first = n + table.constraints
    for a in range(count):
        for b in range(count):
            value = 0.0
            for i in range(n):
                value += _scaled_power(table, space, i, space.columns[a]) * _scaled_power(
                    table, space, i, space.columns[b]
                )
            space.square[a, b] = value
        for j in range(width):
            value = 0.0
            for h in range(held):
                power = 0.0
                for i in range(n):
                    entry = slope(table, space, space.held[h], i) * space.scales[i]
                    power += _scaled_power(table, space, i, space.columns[a]) * entry
                value += power * space.saddle_right[n + h, j]
            space.square_right[a, j] = value
    solve_dense(space.square, space.square_right, count, width, space.dense)
    for a in range(count):
        for j in range(width):
            space.square_right[a, j] *= space.scales[first + space.columns[a]]


@compiled_subset
def _scaled_power(table: ContactTable, space: ContactSpace, i: int, unknown: int) -> float:
    """Return a power coefficient of a reaction, in the scales of both."""
    scale = space.scales[i] * space.scales[table.coordinates + table.constraints + unknown]
    return reaction(table, space, i, unknown) * scale


@compiled_subset
def _free_compliance(table: ContactTable, space: ContactSpace, r: int, unknown: int) -> float:
    """Return the size of the slip acceleration for a unit of a reaction if nothing else held the system."""
    value = 0.0
    for m in range(table.coordinates):
        inertia = mass(table, space, m, m)
        if inertia > 0.0:
            force = reaction(table, space, m, unknown)
            value += abs(slope(table, space, table.constraints + r, m) * force) / inertia
    return value


@compiled_subset
def _motionless(table: ContactTable, space: ContactSpace, r: int) -> bool:
    """Return whether a slip velocity does not depend on the rates here, compared with how the gap does."""
    for i in range(table.constraint.size):
        if table.constraint[i] >= 0 and table.first[i] <= r and r < table.first[i] + table.width[i]:
            size = row_size(table, space, table.constraints + r)
            return size <= _POWERLESS * row_size(table, space, table.constraint[i])
    return False


@compiled_subset
def _write(table: ContactTable, space: ContactSpace, place: int, opened: int) -> None:
    """Write the responses that were solved for to their row."""
    n, k, s, width = table.coordinates, table.normal.size, table.slips, 1 + table.slips
    out = space.responses[place]
    for i in range(n):
        for j in range(width):
            out[i * width + j] = space.saddle_right[i, j]
    for i in range(k):
        column = -1
        if opened >> i & 1 == 0:
            column = 0
            while space.columns[column] != table.normal[i]:
                column += 1
        row = table.constraint[i]
        for j in range(width):
            out[(n + i) * width + j] = space.square_right[column, j] if column >= 0 else 0.0
            value = 0.0
            if row >= 0:
                for m in range(n):
                    value += slope(table, space, row, m) * space.saddle_right[m, j]
                if j == 0:
                    value -= space.demand[row]
                value *= float(table.sense[i])
            out[(n + k + i) * width + j] = value
    for r in range(s):
        still = _motionless(table, space, r)
        for j in range(width):
            value = 0.0
            for m in range(n):
                value += slope(table, space, table.constraints + r, m) * space.saddle_right[m, j]
            if j == 0:
                value -= space.slip_demand[r]
            elif still or abs(value) <= _POWERLESS * _free_compliance(table, space, r, table.tangential[j - 1]):
                value = 0.0
            out[(n + 2 * k + r) * width + j] = value


@compiled_subset
def solve_mode(
    table: ContactTable,
    space: ContactSpace,
    mode: NDArray[np.int64],
    along: FloatArray,
    sides: FloatArray,
) -> int:
    """Solve for motion and forces in a mode; return the row of ``responses`` that was used.

    Parameters
    ----------
    mode : (n_contacts,) of int
    along : (n_contacts, 2)
        Directions of slip.
    sides : (n_contacts,)
        Signs of the normal reactions.
    """
    n, k, s, width = table.coordinates, table.normal.size, table.slips, 1 + table.slips
    opened = 0
    for i in range(k):
        if mode[i] == OPEN:
            opened += 1 << i
    place = respond(table, space, opened)
    found = space.responses[place]
    for i in range(k):
        for a in range(table.width[i]):
            r = table.first[i] + a
            first = (n + 2 * k + r) * width
            scale = 1.0
            if mode[i] == STICK:
                scale = _scale_of(abs(found[first + 1 + r]))
            for j in range(s):
                space.laws[r, j] = found[first + 1 + j] * scale if mode[i] == STICK else 0.0
            space.forces[r, 0] = -found[first] * scale if mode[i] == STICK else 0.0
            if mode[i] != STICK:
                space.laws[r, r] = 1.0
            if mode[i] == SLIP or mode[i] == SMOOTH:
                kappa = number(table, space, i, MU) * sides[i] * along[i, a]
                for j in range(s):
                    space.laws[r, j] += kappa * found[(n + i) * width + 1 + j]
                space.forces[r, 0] = -kappa * found[(n + i) * width]
    count = solve_dense(space.laws, space.forces, s, 1, space.dense)
    space.undetermined[0] = count
    for a in range(count):
        for r in range(s):
            space.free[a, r] = space.dense.free[a, r]
    for i in range(n):
        space.motion[i] = _affine(found, i * width, space.forces, s)
    for i in range(k):
        space.normal[i] = _affine(found, (n + i) * width, space.forces, s)
        space.gap[i] = _affine(found, (n + k + i) * width, space.forces, s)
    for r in range(s):
        space.slip[r] = _affine(found, (n + 2 * k + r) * width, space.forces, s)
    return place


@compiled_subset
def compliance(table: ContactTable, space: ContactSpace, place: int, a: int, b: int) -> float:
    """Return the acceleration along one slip velocity for a unit of friction force along another."""
    n, k = table.coordinates, table.normal.size
    return space.responses[place, (n + 2 * k + a) * (1 + table.slips) + 1 + b]


@compiled_subset
def normal_response(table: ContactTable, space: ContactSpace, place: int, i: int, r: int) -> float:
    """Return the change of the normal reaction of a contact for a unit of friction force along a slip velocity."""
    return space.responses[place, (table.coordinates + i) * (1 + table.slips) + 1 + r]


@compiled_subset
def shift_forces(table: ContactTable, space: ContactSpace, place: int, direction: int, amount: float) -> None:
    """Change friction forces along a direction in which they are not determined, and normal reactions with them."""
    for r in range(table.slips):
        space.forces[r, 0] += amount * space.free[direction, r]
    for i in range(table.normal.size):
        for r in range(table.slips):
            space.normal[i] += amount * normal_response(table, space, place, i, r) * space.free[direction, r]


@compiled_subset
def _affine(found: FloatArray, first: int, forces: FloatArray, count: int) -> float:
    value = found[first]
    for j in range(count):
        value += found[first + 1 + j] * forces[j, 0]
    return value
