"""Cases with contacts at an instant, and the sizes by which contacts are compared with zero in any unit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..subset.arguments import IntMatrix, IntVector, Matrix, Vector
from ..subset.compiled_subset import compiled_subset, sqrt
from .contact_system import SLIP, ContactSystem, drift, terms
from .equations.contact_laws import STATES

UNDECIDED = -1
"""Mode of a contact, and of a case, before the first decision, and `ContactCases.after` without an impact."""

ADDED, SIDE, REST = 4, 2, 3
"""Parameters that a contact adds to those of the scene, which begin with the direction of slip, and two of their places
(`dalembert.contacts.equations.modes.mode_parameters`)."""

_STATES = len(STATES)


class ContactCases(NamedTuple):
    """Cases at an instant; of k cases with c contacts each.

    Attributes
    ----------
    t : (k,)
        Times [s].
    x : (k, 2 n_q + n_z)
        Coordinates, rates and first-order states; the rates change.
    p : (k, n_p)
        Parameters of the scene.
    added : (k, 4 c)
        Those that each contact adds: direction of slip (2); sign of the normal reaction, or of a contact that opens
        what is added to its guard; and slip speed in a plane below which it counts as at rest, negative in phases that
        do not begin at rest.
    speeds, approach : (k, c)
        Largest slip speed, and largest speed at which the gap closed, so far.
    flight : (k, c)
        How long each contact has been open [s].
    loads : (k, c)
        Largest size of the terms of each gap's acceleration so far; of contacts without a gap, of the normal reaction.
    impacts, soon : (k,)
        Impacts at the instant so far; phases in a row that ended too soon.
    shared, shared_at : (k,)
        Impacts so far in which several contacts took part, or that followed others at the same instant; time of the
        first of them [s].
    span, passed : (k,)
        Duration of the whole motion, and of the last phase [s].
    modes, fired : (k, c)
        What each contact does, `UNDECIDED` before the start; guards that have fired, as bits.
    number : (k,)
        Number of the mode (`dalembert.contacts.automaton.HybridAutomaton.mode`), `UNDECIDED` before the start.
    after : (k, c)
        What is known of each contact after an impact, else `UNDECIDED`.
    status : (k,)
        SUCCESS where a mode was selected; CONTACT_IMPOSSIBLE before, where the last mode has lost its reactions.
    motion : (k, n_q)
        Accelerations in the mode.
    """

    t: Vector
    x: Matrix
    p: Matrix
    added: Matrix
    speeds: Matrix
    approach: Matrix
    flight: Matrix
    loads: Matrix
    impacts: IntVector
    soon: IntVector
    shared: IntVector
    shared_at: Vector
    span: Vector
    passed: Vector
    modes: IntMatrix
    fired: IntMatrix
    number: IntVector
    after: IntMatrix
    status: IntVector
    motion: Matrix


def contact_cases(
    t: FloatArray, x: FloatArray, p: FloatArray, span: FloatArray, contacts: int, states: int = 0
) -> ContactCases:
    """Return cases before their first decision, in memory of their own.

    They start at times t (k,) from x (k, 2 n_q + n_z), with parameters p (k, n_p) and signed spans (k,). `states` is
    n_z, the number of first-order states.
    """
    t, x, p, span = (np.array(values, dtype=float, order="C") for values in (t, x, p, span))
    k, nothing = len(x), np.zeros((4, len(x), contacts))
    undecided = np.full((2, k, contacts), UNDECIDED)
    return ContactCases(
        t=t,
        x=x,
        p=p,
        added=np.tile([1.0, 0.0, 1.0, -1.0], (k, contacts)),
        speeds=nothing[0],
        approach=nothing[1],
        flight=nothing[2],
        loads=nothing[3],
        impacts=np.zeros(k, np.int64),
        soon=np.zeros(k, np.int64),
        shared=np.zeros(k, np.int64),
        shared_at=np.zeros(k),
        span=span,
        passed=np.zeros(k),
        modes=undecided[0],
        fired=np.zeros((k, contacts), np.int64),
        number=np.full(k, UNDECIDED),
        after=undecided[1],
        status=np.zeros(k, np.int64),
        motion=np.zeros((k, (x.shape[1] - states) // 2)),
    )


@compiled_subset
def set_mode(cases: ContactCases, case: int, mode: IntVector) -> None:
    """Write the mode of a case, the states of its contacts, and its number: these as digits, the first the lowest."""
    number, digit = 0, 1
    for i in range(mode.size):
        cases.modes[case, i] = mode[i]
        number += digit * mode[i]
        digit *= _STATES
    cases.number[case] = number


NOISE = 1e-8
"""Share of a velocity, or of a position, below which it counts as zero."""

_ROUNDED_LENGTH, _AT_REST, _SLOW_SHARE = 1e-12, 1e-8, 1e-4
"""Those of `dalembert.reduction.start_limits`: a length and a speed that rounding may have left of zero, and the share
of the speed of the whole motion that counts as a rate where less moves."""

_MOTIONLESS, _LIGHT = 1e-12, 1e-8
"""Share of the rate that a gap could have with the kinetic energy there is, up to which it has none; and share of the
largest inertia up to which a coordinate counts as that heavy in this: light bodies do not take all energy."""


@compiled_subset
def _length_size(system: ContactSystem, x: FloatArray) -> float:
    """Return the size of the coordinates with a unit, which are the first of x (2 n_q + n_z,).

    The largest of them, and at least the radius of gyration where there are angles; one where that is rounding.
    """
    largest, inertia, weight = 0.0, 0.0, 0.0
    for j in range(system.coordinates):
        if system.angle[j] != 0:
            inertia += system.mass[j, j]
        else:
            weight += system.mass[j, j]
            largest = max(largest, abs(x[j]))
    if inertia > 0.0 and weight > 0.0:
        largest = max(largest, sqrt(inertia / weight))
    return largest if largest > _ROUNDED_LENGTH else 1.0


@compiled_subset
def position_terms(system: ContactSystem, x: FloatArray, row: int, total: float) -> float:
    """Return the sizes of what coordinates add to a gap, or to a way slipped, added to a total; x as before."""
    length = _length_size(system, x)
    for j in range(system.coordinates):
        size = 1.0 if system.angle[j] != 0 else length
        total += abs(system.jacobian[row, j]) * max(abs(x[j]), size)
    return total


@compiled_subset
def slip_begins(cases: ContactCases, case: int) -> bool:
    """Return whether slip in a plane begins in the phase of a case: it turns fast there, and friction is stiff."""
    for i in range(cases.modes.shape[1]):
        if cases.modes[case, i] == SLIP and cases.added[case, ADDED * i + REST] > 0.0:
            return True
    return False


@compiled_subset
def gap_noise(system: ContactSystem, x: FloatArray, i: int) -> float:
    """Return the size below which the gap of a contact counts as zero at a start; x as before."""
    return NOISE * position_terms(system, x, system.constraint[i], abs(system.gap[i]))


@compiled_subset
def slow_terms(system: ContactSystem, x: FloatArray, row: int) -> float:
    """Return the least size of the terms of the rate of a constraint, or of a slip velocity; x as before.

    Where a slip velocity depends on no rate, it is that of a point that moves as fast as coordinates do.
    """
    total, speed, length = 0.0, 0.0, _length_size(system, x)
    for j in range(system.coordinates):
        size = 1.0 if system.angle[j] != 0 else length
        total += abs(system.jacobian[row, j]) * size
        speed += abs(system.rates[j]) / size
    if total == 0.0:
        total = length
    return _SLOW_SHARE * (speed if speed > _AT_REST else 1.0) * total


@compiled_subset
def gap_rate(system: ContactSystem, i: int) -> float:
    """Return the rate of the gap of a contact."""
    return float(system.sense[i]) * system.velocity[system.constraint[i]]


@compiled_subset
def motionless_rate(system: ContactSystem, i: int) -> float:
    """Return the rate of a gap up to which a contact does not move, beside the kinetic energy there is."""
    slopes, energy, heavy, turning, most = system.jacobian[system.constraint[i]], 0.0, 0.0, 0.0, 0.0
    for j in range(system.coordinates):
        if system.angle[j] != 0:
            turning = max(turning, system.mass[j, j])
        else:
            heavy = max(heavy, system.mass[j, j])
        for m in range(system.coordinates):
            energy += system.rates[j] * system.mass[j, m] * system.rates[m]
    for j in range(system.coordinates):
        if system.mass[j, j] > 0.0:
            inertia = max(system.mass[j, j], _LIGHT * (turning if system.angle[j] != 0 else heavy))
            most += slopes[j] * slopes[j] / inertia
    return _MOTIONLESS * sqrt(max(energy * most, 0.0))


@compiled_subset
def rate_noise(system: ContactSystem, i: int) -> float:
    """Return the size below which the rate of a gap counts as zero."""
    return NOISE * terms(system.jacobian[system.constraint[i]], system.rates, 0.0) + motionless_rate(system, i)


@compiled_subset
def rate_terms(system: ContactSystem, row: int) -> float:
    """Return the sum of the sizes of the terms of a slip velocity, or of the rate of a constraint."""
    return terms(system.jacobian[row], system.rates, abs(drift(system, row)))


@compiled_subset
def slip_speed(system: ContactSystem, i: int) -> float:
    """Return the size of the slip velocity of a contact."""
    total = 0.0
    for a in range(system.width[i]):
        total += system.velocity[system.row[i] + a] * system.velocity[system.row[i] + a]
    return sqrt(total)


@compiled_subset
def slip_terms(system: ContactSystem, i: int) -> float:
    """Return the sum of the sizes of the terms of a slip velocity, the larger of two."""
    largest = 0.0
    for a in range(system.width[i]):
        largest = max(largest, rate_terms(system, system.row[i] + a))
    return largest
