"""Contacts of a scene as compiled code reads them, and the numbers of an instant.

The numbers come from the kernel of `dalembert.hybrid.contact_data`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .arguments import IntVector, Matrix, Vector
from .compiled_subset import compiled_subset, sqrt
from .dense_solve import DenseWorkspace, dense_workspace

__all__ = [
    "CLOSED",
    "GAP",
    "MU",
    "MU_STATIC",
    "OPEN",
    "REGULARIZATION",
    "RESTITUTION",
    "SLIP",
    "SMOOTH",
    "STICK",
    "ContactSpace",
    "ContactTable",
    "bias",
    "contact_space",
    "drift",
    "mass",
    "number",
    "opening_power",
    "power_size",
    "reaction",
    "row_size",
    "slope",
    "velocity",
]

OPEN, CLOSED, SLIP, STICK, SMOOTH = 0, 1, 2, 3, 4
"""States of a contact, by their places in `dalembert.hybrid.modes.STATES`."""

GAP, MU, MU_STATIC, RESTITUTION, REGULARIZATION = 0, 1, 2, 3, 4
"""Places of the numbers of a contact, see `number`."""

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
        1 where friction is regularized; 1 where the normal reaction of a contact with friction may have either sign.
    tangential : (n_slips,)
        Number of the friction force along each slip velocity among the unknowns.
    angle : (n_q,)
        1 for coordinates without a unit.
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
    angle: IntVector


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
    scales : (n_q + n_constraints + n_unknowns,)
        Powers of two by which accelerations, multipliers and reactions are divided to be solved for, so that which
        systems are singular does not depend on units.
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
    scales: Vector
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
        scales=np.ones(n + m + u),
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


@compiled_subset
def row_size(table: ContactTable, space: ContactSpace, row: int) -> float:
    """Return the largest rate of a constraint, or slip velocity, for a sum of M_jj qdot_j^2 of one.

    A coordinate that moves no inertia counts as if it moved one unit.
    """
    value = 0.0
    for j in range(table.coordinates):
        entry, inertia = slope(table, space, row, j), mass(table, space, j, j)
        value += entry * entry / (inertia if inertia > 0.0 else 1.0)
    return sqrt(value)


@compiled_subset
def power_size(table: ContactTable, space: ContactSpace, unknown: int) -> float:
    """Return the size of the accelerations that a unit of a reaction causes, in the same terms as `row_size`."""
    value = 0.0
    for j in range(table.coordinates):
        entry, inertia = reaction(table, space, j, unknown), mass(table, space, j, j)
        value += entry * entry / (inertia if inertia > 0.0 else 1.0)
    return sqrt(value)
