"""Contact forces at an instant: accelerations, or rates after an impact, in any mode of the contacts.

The numbers of an instant come from the kernel of `dalembert.hybrid.contact_data`. Motion, normal reactions, gap
accelerations and slip accelerations are affine in the friction forces; a mode makes these unknown (sticking), or
proportional to the normal reactions (sliding).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from .arguments import IntVector, Matrix, Vector
from .compiled_subset import compiled_subset, sqrt
from .dense_solve import DenseWorkspace, dense_workspace, solve_dense

__all__ = [
    "CLOSED",
    "OPEN",
    "SLIP",
    "SMOOTH",
    "STICK",
    "ContactSpace",
    "ContactTable",
    "contact_space",
    "drift",
    "load_accelerations",
    "load_impact",
    "mass",
    "number",
    "opening_power",
    "reaction",
    "respond",
    "row_size",
    "shift_forces",
    "slope",
    "solve_mode",
    "velocity",
]

OPEN, CLOSED, SLIP, STICK, SMOOTH = 0, 1, 2, 3, 4
"""What a contact does, as `dalembert.hybrid.modes` numbers it."""

GAP, MU, MU_STATIC, RESTITUTION, REGULARIZATION = 0, 1, 2, 3, 4
_NUMBERS = 5

_KEPT_RESPONSES = 8
"""Sets of open contacts whose responses are kept during one decision."""


class ContactTable(NamedTuple):
    """The contacts of a scene, one entry each where nothing else is said.

    Attributes
    ----------
    coordinates, constraints, slips, unknowns : int
        Sizes: q, constraints, slip velocities of all contacts, reactions.
    constraint, sense : (n_contacts,)
        Number of the constraint that opens (-1: none), and the sign between it and the gap.
    normal : (n_contacts,)
        Number of the normal reaction among the unknowns.
    first, width : (n_contacts,)
        First slip velocity and their number: 0 without friction, 1 along a line, 2 in a plane.
    smooth, sided : (n_contacts,)
        1 where friction is regularized; 1 where the normal reaction of a rubbing contact may have either sign.
    tangential : (n_slips,)
        Number of the friction force along each slip velocity among the unknowns.
    """

    coordinates: int
    constraints: int
    slips: int
    unknowns: int
    constraint: IntVector
    sense: IntVector
    normal: IntVector
    first: IntVector
    width: IntVector
    smooth: IntVector
    sided: IntVector
    tangential: IntVector


class ContactSpace(NamedTuple):
    """Working memory of the solution in a mode.

    Attributes
    ----------
    values : (n_values,)
        Outputs of the kernel of the contact data at the instant.
    rates : (n_q,)
        qdot at the instant.
    load, demand, slip_demand : (n_q,), (n_constraints,), (n_slips,)
        Forcing, or momentum before an impact; what constraints, and sticking, require of Jacobian times unknown.
    responses : (8, n_responses)
        For sets of open contacts, motion, normal reactions, gap and slip accelerations: without friction, and for a
        unit of each friction force.
    kept : (8,)
        The set of open contacts of each, as bits; -1 where there is none.
    saddle, saddle_right : (n, n), (n, 1 + n_slips)
        System of accelerations and multipliers.
    square, square_right : (n_unknowns, n_unknowns), (n_unknowns, 1 + n_slips)
        System of the reactions.
    laws, forces : (n_slips, n_slips), (n_slips, 1)
        System of the friction forces, and these.
    held, columns : (n_constraints,), (n_unknowns,)
        Constraints that hold, and reactions that hold them.
    motion : (n_q,)
        Accelerations, or rates after an impact.
    normal, gap : (n_contacts,)
        Normal reactions, and the excess of gap accelerations over what keeps the contact closed.
    slip : (n_slips,)
        The excess of slip accelerations over what keeps the contact sticking.
    free : (n_slips, n_slips)
        Directions in which the friction forces are not determined, as rows; the motion does not depend on them.
    undetermined : (1,)
        Their number.
    """

    values: Vector
    rates: Vector
    load: Vector
    demand: Vector
    slip_demand: Vector
    responses: Matrix
    kept: IntVector
    saddle: Matrix
    saddle_right: Matrix
    square: Matrix
    square_right: Matrix
    laws: Matrix
    forces: Matrix
    held: IntVector
    columns: IntVector
    motion: Vector
    normal: Vector
    gap: Vector
    slip: Vector
    free: Matrix
    undetermined: IntVector
    dense: DenseWorkspace


def contact_space(table: ContactTable) -> ContactSpace:
    """Return working memory for the contacts of a scene."""
    n, m, s, u = table.coordinates, table.constraints, table.slips, table.unknowns
    k = len(table.constraint)
    size = max(n + m, u, s, 1)
    return ContactSpace(
        values=np.zeros(n * n + n + (m + s) * (n + 2) + n * u + _NUMBERS * k),
        rates=np.zeros(n),
        load=np.zeros(n),
        demand=np.zeros(max(m, 1)),
        slip_demand=np.zeros(max(s, 1)),
        responses=np.zeros((_KEPT_RESPONSES, (n + 2 * k + s) * (1 + s))),
        kept=np.zeros(_KEPT_RESPONSES, np.int64),
        saddle=np.zeros((size, size)),
        saddle_right=np.zeros((size, 1 + s)),
        square=np.zeros((size, size)),
        square_right=np.zeros((size, 1 + s)),
        laws=np.zeros((max(s, 1), max(s, 1))),
        forces=np.zeros((max(s, 1), 1)),
        held=np.zeros(max(m, 1), np.int64),
        columns=np.zeros(max(u, 1), np.int64),
        motion=np.zeros(n),
        normal=np.zeros(k),
        gap=np.zeros(k),
        slip=np.zeros(max(s, 1)),
        free=np.zeros((max(s, 1), max(s, 1))),
        undetermined=np.zeros(1, np.int64),
        dense=dense_workspace(size),
    )


# -- the numbers of an instant -----------------------------------------------------------------


@compiled_subset
def mass(table: ContactTable, space: ContactSpace, i: int, j: int) -> float:
    """Return an entry of the mass matrix."""
    return space.values[i * table.coordinates + j]


@compiled_subset
def _row(table: ContactTable, row: int) -> int:
    """Return where a constraint, or behind them a slip velocity, begins among the values."""
    n = table.coordinates
    return n * n + n + row * (n + 2)


@compiled_subset
def slope(table: ContactTable, space: ContactSpace, row: int, j: int) -> float:
    """Return an entry of the Jacobian of a constraint, or behind them of a slip velocity."""
    return space.values[_row(table, row) + j]


@compiled_subset
def bias(table: ContactTable, space: ContactSpace, row: int) -> float:
    """Return what Jacobian times qddot is where a constraint, or sticking, holds."""
    return space.values[_row(table, row) + table.coordinates]


@compiled_subset
def velocity(table: ContactTable, space: ContactSpace, row: int) -> float:
    """Return the rate of a constraint, or a slip velocity."""
    return space.values[_row(table, row) + table.coordinates + 1]


@compiled_subset
def reaction(table: ContactTable, space: ContactSpace, i: int, unknown: int) -> float:
    """Return the power coefficient of a reaction for a coordinate."""
    return space.values[_row(table, table.constraints + table.slips) + i * table.unknowns + unknown]


@compiled_subset
def number(table: ContactTable, space: ContactSpace, contact: int, which: int) -> float:
    """Return gap, mu, mu_static, restitution or regularization of a contact."""
    first = _row(table, table.constraints + table.slips) + table.coordinates * table.unknowns
    return space.values[first + _NUMBERS * contact + which]


@compiled_subset
def drift(table: ContactTable, space: ContactSpace, row: int) -> float:
    """Return the part of a constraint's rate, or of a slip velocity, without rates."""
    value = velocity(table, space, row)
    for j in range(table.coordinates):
        value -= slope(table, space, row, j) * space.rates[j]
    return value


@compiled_subset
def opening_power(table: ContactTable, space: ContactSpace, contact: int) -> float:
    """Return the power of the normal reaction of a contact on the rates along its gap, positive where it opens it."""
    power, row = 0.0, table.constraint[contact]
    for j in range(table.coordinates):
        power += reaction(table, space, j, table.normal[contact]) * slope(table, space, row, j)
    return float(table.sense[contact]) * power


# -- what is solved for ------------------------------------------------------------------------


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


# -- responses to friction ---------------------------------------------------------------------


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
            space.saddle[i, j] = mass(table, space, i, j)
        space.saddle_right[i, 0] = space.load[i]
        for j in range(s):
            space.saddle_right[i, 1 + j] = reaction(table, space, i, table.tangential[j])
    for a in range(held):
        row = space.held[a]
        for j in range(n):
            space.saddle[n + a, j] = slope(table, space, row, j)
            space.saddle[j, n + a] = -slope(table, space, row, j)
        space.saddle_right[n + a, 0] = space.demand[row]
    solve_dense(space.saddle, space.saddle_right, size, width, space.dense)
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
    for a in range(count):
        for b in range(count):
            value = 0.0
            for i in range(n):
                value += reaction(table, space, i, space.columns[a]) * reaction(table, space, i, space.columns[b])
            space.square[a, b] = value
        for j in range(width):
            value = 0.0
            for h in range(held):
                power = 0.0
                for i in range(n):
                    power += reaction(table, space, i, space.columns[a]) * slope(table, space, space.held[h], i)
                value += power * space.saddle_right[n + h, j]
            space.square_right[a, j] = value
    solve_dense(space.square, space.square_right, count, width, space.dense)


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
        for j in range(width):
            value = 0.0
            for m in range(n):
                value += slope(table, space, table.constraints + r, m) * space.saddle_right[m, j]
            if j == 0:
                value -= space.slip_demand[r]
            out[(n + 2 * k + r) * width + j] = value


# -- the solution in a mode --------------------------------------------------------------------


@compiled_subset
def solve_mode(
    table: ContactTable,
    space: ContactSpace,
    mode: NDArray[np.int64],
    along: FloatArray,
    sides: FloatArray,
    static: bool,
) -> int:
    """Solve for motion and forces in a mode; return the row of ``responses`` that was used.

    Parameters
    ----------
    mode : (n_contacts,) of int
    along : (n_contacts, 2)
        Directions of slip.
    sides : (n_contacts,)
        Signs of the normal reactions.
    static : bool
        Whether sliding contacts have their coefficients of static friction.
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
            for j in range(s):
                space.laws[r, j] = found[first + 1 + j] if mode[i] == STICK else 0.0
            space.forces[r, 0] = -found[first] if mode[i] == STICK else 0.0
            if mode[i] != STICK:
                space.laws[r, r] = 1.0
            if mode[i] == SLIP or mode[i] == SMOOTH:
                mu = number(table, space, i, MU_STATIC if static else MU)
                kappa = mu * sides[i] * along[i, a]
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
def shift_forces(table: ContactTable, space: ContactSpace, place: int, direction: int, amount: float) -> None:
    """Change friction forces along a direction in which they are not determined, and normal reactions with them."""
    n, width = table.coordinates, 1 + table.slips
    for r in range(table.slips):
        space.forces[r, 0] += amount * space.free[direction, r]
    for i in range(table.normal.size):
        for r in range(table.slips):
            response = space.responses[place, (n + i) * width + 1 + r]
            space.normal[i] += amount * response * space.free[direction, r]


@compiled_subset
def _affine(found: FloatArray, first: int, forces: FloatArray, count: int) -> float:
    value = found[first]
    for j in range(count):
        value += found[first + 1 + j] * forces[j, 0]
    return value


@compiled_subset
def row_size(table: ContactTable, space: ContactSpace, row: int) -> float:
    """Return the length of the Jacobian of a constraint, or of a slip velocity."""
    value = 0.0
    for j in range(table.coordinates):
        value += slope(table, space, row, j) * slope(table, space, row, j)
    return sqrt(value)
