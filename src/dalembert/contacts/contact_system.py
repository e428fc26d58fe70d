"""Contacts of a scene as compiled code sees them: their numbers at an instant, and the motion and forces in a mode."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..options.other_calls import IMPACTS
from ..subset.arguments import IntMatrix, IntVector, Matrix, Record, Vector
from ..subset.compiled_subset import compiled_subset, sqrt
from .equations.contact_laws import STATES
from .selection.dense_solve import DenseWorkspace

if TYPE_CHECKING:
    pass

OPEN, CLOSED, SLIP, STICK, SMOOTH = range(len(STATES))
"""States of a contact, by their places in `dalembert.contacts.equations.modes.STATES`."""

NEWTON, POISSON, SEQUENCE = range(len(IMPACTS))
"""Laws of impacts, by their places in `dalembert.options.other_calls.IMPACTS`."""


class Combination(NamedTuple):
    """The state of each contact, and the motion with it.

    Attributes
    ----------
    mode, sides : (n_contacts,)
        States, and signs of normal reactions.
    released : (n_contacts,)
        1 where a contact separates while it returns a part of its impulse, with friction of that.
    along : (n_contacts, 2)
        Directions of slip.
    press : (n_contacts,)
        Normal reactions, or impulses.
    motion : (n_q,)
        Accelerations, or rates after an impact.
    """

    mode: IntVector
    sides: Vector
    released: IntVector
    along: Matrix
    press: Vector
    motion: Vector


def combination(contacts: int, coordinates: int) -> Combination:
    """Return memory for a combination."""
    mode, released = np.zeros((2, contacts), np.int64)
    sides, along, press = np.ones(contacts), np.zeros((contacts, 2)), np.zeros(contacts)
    return Combination(mode, sides, released, along, press, np.zeros(coordinates))


class Solved(Record):
    """The first row of the responses that were used, and the number of directions in which forces are free.

    `accelerating` is 1 where accelerations are solved for: given loads act then, and have no impulse.
    """

    place: int
    undetermined: int
    accelerating: int


class ContactSystem(NamedTuple):
    """Contacts with one entry each where nothing else is said. A row is a constraint, or behind them a slip velocity.

    Attributes
    ----------
    coordinates, constraints, contacts, slips : int
        Sizes: q, constraints, contacts, slip velocities of all contacts.
    impacts : int
        The law of impacts: NEWTON, POISSON or SEQUENCE.
    several : int
        1 where a contact has several laws of friction.
    leader : (n_contacts,)
        The contact that has the normal reaction: another one for a further law of its friction, else the same.
    constraint, sense : (n_contacts,)
        Number of the constraint that opens (-1: none), and the sign between it and the gap.
    normal : (n_contacts,)
        Number of the normal reaction among the reactions.
    first, row, width : (n_contacts,)
        First slip velocity, its row, and their number: 0 without friction, 1 along a line, 2 in a plane.
    closed : (n_contacts,)
        State while it is closed and does not stick: CLOSED without friction, SLIP, or SMOOTH.
    sided : (n_contacts,)
        1 where the normal reaction of a contact with friction may have either sign.
    soft : (n_contacts,)
        1 where the normal reaction has a compliance.
    given : (n_contacts,)
        1 where the normal reaction is a given load.
    jumping : (n_contacts,)
        1 where a condition on time stands in the slip velocity, which may jump.
    tangential : (n_slips,)
        Number of the friction force along each slip velocity among the reactions.
    slides_by : (n_slips, n_q)
        1 where a slip velocity depends on a rate, at one position at least.
    loose : (n_slips,)
        1 where a slip velocity is independent of the constraints that never open, but at dead centres.
    row_owner, owner : (n_rows,), (n_reactions,)
        Contact of each row, and the one that leads at each normal reaction; -1 for others, -2 for friction forces.
    angle : (n_q,)
        0 for coordinates with a unit, 1 for those without, and a number of its own for each unit quaternion.
    values : (n_values,)
        Outputs of the kernel of the contact data at the instant; those up to `normal_load` are views of them.
    mass, forcing : (n_q, n_q), (n_q,)
        The mass matrix and the given forces.
    jacobian, bias, velocity : (n_rows, n_q), (n_rows,), (n_rows,)
        Jacobians; what Jacobian times qddot is where a row holds; rates of constraints and slip velocities.
    power : (n_reactions, n_q)
        Power coefficients of the reactions.
    gap, mu, mu_static, restitution, regularization, normal_load : (n_contacts,)
        Gaps, coefficients and given normal loads of the contacts, zero where they have none.
    rates : (n_q,)
        qdot at the instant.
    weight : (n_contacts,)
        What a unit of its friction counts beside one of the normal reaction: 1, or for a further law the ratio of the
        accelerations that they cause, since its friction is a moment.
    load, demand : (n_q,), (n_rows,)
        Forcing, or momentum before an impact; what is required of Jacobian times unknown where a row holds.
    restored : (n_contacts,)
        Normal impulses that contacts return at least, and that the load has; zero except while they do.
    responses : (8 n, 1 + n_slips)
        For 8 sets of open contacts, of n = n_q + 2 n_contacts + n_slips each: motion, normal reactions, accelerations
        of gaps and of slip, without friction and for a unit of each friction force.
    kept : (8,)
        The set of open contacts of each, as bits; -1 where there is none.
    scales : (n_q + n_constraints + n_reactions,)
        Powers of two by which accelerations, multipliers and reactions are divided to be solved for, so that which
        systems are singular does not depend on units.
    saddle, saddle_right : (n, n), (n, 1 + n_slips + n_contacts)
        System of accelerations and multipliers.
    compliances : (n_slips + n_contacts, 1 + n_slips + n_contacts)
        With all contacts open: accelerations of slip and of gaps, without contact forces and for a unit of each
        friction force and of each normal reaction.
    square, square_right : (n_reactions, n_reactions), (n_reactions, 1 + n_slips)
        System of the reactions.
    laws, forces : (n_slips, n_slips), (n_slips, 1)
        System of the friction forces, and these.
    held, columns, column : (n_constraints,), (n_reactions,), (n_contacts,)
        Constraints that hold, the reactions that hold them, and the place of each normal reaction among these.
    solution : (n,)
        As a column of the responses: the four that follow are views of it.
    motion : (n_q,)
        Accelerations, or rates after an impact.
    press, opening : (n_contacts,)
        Normal reactions, and the excess of gap accelerations over what keeps the contact closed.
    slip : (n_slips,)
        The excess of slip accelerations over what keeps the contact sticking.
    free : (n_slips, n_slips)
        Directions in which the friction forces are not determined, as rows; the motion does not depend on them.
    solved, dense
        Numbers of the solution, and memory of the solver.
    """

    coordinates: int
    constraints: int
    contacts: int
    slips: int
    impacts: int
    several: int
    leader: IntVector
    constraint: IntVector
    sense: IntVector
    normal: IntVector
    first: IntVector
    row: IntVector
    width: IntVector
    closed: IntVector
    sided: IntVector
    soft: IntVector
    given: IntVector
    jumping: IntVector
    tangential: IntVector
    slides_by: IntMatrix
    loose: IntVector
    row_owner: IntVector
    owner: IntVector
    angle: IntVector
    values: Vector
    mass: Matrix
    forcing: Vector
    jacobian: Matrix
    bias: Vector
    velocity: Vector
    power: Matrix
    gap: Vector
    mu: Vector
    mu_static: Vector
    restitution: Vector
    regularization: Vector
    normal_load: Vector
    rates: Vector
    weight: Vector
    load: Vector
    demand: Vector
    restored: Vector
    responses: Matrix
    kept: IntVector
    scales: Vector
    saddle: Matrix
    saddle_right: Matrix
    compliances: Matrix
    square: Matrix
    square_right: Matrix
    laws: Matrix
    forces: Matrix
    held: IntVector
    columns: IntVector
    column: IntVector
    solution: Vector
    motion: Vector
    press: Vector
    opening: Vector
    slip: Vector
    free: Matrix
    solved: Solved
    dense: DenseWorkspace


@compiled_subset
def dot(a: FloatArray, b: FloatArray, value: float) -> float:
    """Return the product of two vectors, added to a value."""
    for j in range(a.size):
        value += a[j] * b[j]
    return value


@compiled_subset
def terms(a: FloatArray, b: FloatArray, value: float) -> float:
    """Return the sizes of the terms of the product of two vectors, added to a value."""
    for j in range(a.size):
        value += abs(a[j] * b[j])
    return value


@compiled_subset
def inertial_terms(system: ContactSystem, a: FloatArray, b: FloatArray) -> float:
    """Return the sum of the sizes of a_j b_j / M_jj, over the coordinates that move inertia."""
    value = 0.0
    for j in range(system.coordinates):
        inertia = inertia_of(system, j)
        if inertia > 0.0:
            value += abs(a[j] * b[j]) / inertia
    return value


@compiled_subset
def inertia_of(system: ContactSystem, j: int) -> float:
    """Return the inertia M_jj of a coordinate, of a component of a unit quaternion the largest of the four.

    Where a body has the axes of the scene, the scalar component moves nothing but rounding.
    """
    inertia = system.mass[j, j]
    if system.angle[j] > 1:
        for m in range(system.coordinates):
            if system.angle[m] == system.angle[j]:
                inertia = max(inertia, system.mass[m, m])
    return inertia


@compiled_subset
def inertial_size(system: ContactSystem, a: FloatArray) -> float:
    """Return the largest product of a row with rates for a sum of M_jj qdot_j^2 of one.

    Of power coefficients it is the size of the accelerations that a unit of the reaction causes, in the same terms. A
    coordinate that moves no inertia counts as if it moved one unit.
    """
    value = 0.0
    for j in range(system.coordinates):
        inertia = inertia_of(system, j)
        value += a[j] * a[j] / (inertia if inertia > 0.0 else 1.0)
    return sqrt(value)


@compiled_subset
def drift(system: ContactSystem, row: int) -> float:
    """Return the part of a constraint's rate, or of a slip velocity, without rates."""
    value = system.velocity[row]
    for j in range(system.coordinates):
        value -= system.jacobian[row, j] * system.rates[j]
    return value


@compiled_subset
def opening_power(system: ContactSystem, i: int) -> float:
    """Return the power of the normal reaction of a contact on the rates along its gap, positive where it opens it."""
    return float(system.sense[i]) * dot(system.power[system.normal[i]], system.jacobian[system.constraint[i]], 0.0)
