"""Responses of motion and normal reactions to friction forces while some contacts are open."""

from __future__ import annotations

from ...subset.compiled_subset import compiled_subset
from ..contact_system import ContactSystem, inertial_terms
from .dead_centres import motionless
from .dense_solve import solve_dense

_POWERLESS = 1e-12
"""Share of the slip acceleration that friction would cause if nothing else held, up to which rounding makes it."""


@compiled_subset
def _accelerate(system: ContactSystem, opened: int, width: int) -> int:
    """Solve for what the motion is without friction, for a unit of each friction force, and of each normal reaction.

    These are columns of ``saddle_right``, of which the first ``width`` are solved for, with some contacts open, as
    bits. Returns the number of constraints that hold.
    """
    n, held = system.coordinates, hold_constraints(system, opened)
    for i in range(n):
        for j in range(n):
            system.saddle[i, j] = system.mass[i, j] * system.scales[i] * system.scales[j]
        system.saddle_right[i, 0] = system.load[i] * system.scales[i]
        for j in range(1, width):
            force = system.tangential[j - 1] if j <= system.slips else system.normal[j - 1 - system.slips]
            system.saddle_right[i, j] = system.power[force, i] * system.scales[i]
    for a in range(held):
        row = system.held[a]
        for j in range(n):
            entry = system.jacobian[row, j] * system.scales[n + row] * system.scales[j]
            system.saddle[n + a, j], system.saddle[j, n + a] = entry, -entry
        for b in range(held):
            system.saddle[n + a, n + b] = 0.0
        for j in range(width):
            system.saddle_right[n + a, j] = system.demand[row] * system.scales[n + row] if j == 0 else 0.0
    solve_dense(system.saddle, system.saddle_right, n + held, width, system.dense)
    for i in range(n + held):
        for j in range(width):
            system.saddle_right[i, j] *= system.scales[i if i < n else n + system.held[i - n]]
    return held


@compiled_subset
def load_compliances(system: ContactSystem) -> None:
    """Write what each friction force and each normal reaction does where all contacts that can open are open."""
    opened, k, s = 0, system.contacts, system.slips
    for i in range(k):
        if system.constraint[i] >= 0:
            opened += 1 << i
    _accelerate(system, opened, 1 + s + k)
    for r in range(s + k):
        row = system.constraints + r if r < s else system.constraint[r - s]
        sign = 1.0 if r < s else float(system.sense[r - s])
        for j in range(1 + s + k):
            system.compliances[r, j] = sign * _along(system, row, j) if row >= 0 else 0.0


@compiled_subset
def respond(system: ContactSystem, opened: int) -> None:
    """Find how the motion responds to friction with some contacts open, as bits."""
    kept = opened % system.kept.size
    system.solved.place = kept * system.solution.size
    if system.kept[kept] == opened:
        return
    system.kept[kept] = opened
    held = _accelerate(system, opened, 1 + system.slips)
    _reactions(system, held, opened)
    _write(system)


@compiled_subset
def _opens(opened: int, contact: int) -> bool:
    """Return whether a number is that of an open contact."""
    return contact >= 0 and opened >> contact & 1 != 0


@compiled_subset
def hold_constraints(system: ContactSystem, opened: int) -> int:
    """List the constraints that hold with some contacts open; return their number."""
    held = 0
    for row in range(system.constraints):
        if not _opens(opened, system.row_owner[row]):
            system.held[held] = row
            held += 1
    return held


@compiled_subset
def _columns(system: ContactSystem, opened: int) -> int:
    """List the reactions that hold constraints with some contacts open; return their number."""
    count = 0
    for unknown in range(system.owner.size):
        contact, size = system.owner[unknown], 0.0
        for i in range(system.coordinates):
            size += abs(system.power[unknown, i])
        if contact >= 0:
            system.column[contact] = -1
        if contact > -2 and not _opens(opened, contact) and (contact >= 0 or size != 0.0):
            system.columns[count] = unknown
            if contact >= 0:
                system.column[contact] = count
            count += 1
    return count


@compiled_subset
def _reactions(system: ContactSystem, held: int, opened: int) -> None:
    """Solve for the reactions that do what the multipliers do, into ``square_right``: those of least norm."""
    n, width, count = system.coordinates, 1 + system.slips, _columns(system, opened)
    for a in range(count):
        one = system.columns[a]
        for b in range(count):
            value = 0.0
            for i in range(n):
                value += _scaled_power(system, i, one) * _scaled_power(system, i, system.columns[b])
            system.square[a, b] = value
        for j in range(width):
            value = 0.0
            for h in range(held):
                power = 0.0
                for i in range(n):
                    power += _scaled_power(system, i, one) * (system.jacobian[system.held[h], i] * system.scales[i])
                value += power * system.saddle_right[n + h, j]
            system.square_right[a, j] = value
    solve_dense(system.square, system.square_right, count, width, system.dense)
    for a in range(count):
        for j in range(width):
            system.square_right[a, j] *= system.scales[n + system.constraints + system.columns[a]]


@compiled_subset
def _scaled_power(system: ContactSystem, i: int, unknown: int) -> float:
    """Return a power coefficient of a reaction, in the scales of both."""
    scale = system.scales[i] * system.scales[system.coordinates + system.constraints + unknown]
    return system.power[unknown, i] * scale


@compiled_subset
def _along(system: ContactSystem, row: int, j: int) -> float:
    """Return the excess of the acceleration along a row for a right side of the system of the accelerations."""
    value = 0.0
    for m in range(system.coordinates):
        value += system.jacobian[row, m] * system.saddle_right[m, j]
    return value - system.demand[row] if j == 0 else value


@compiled_subset
def _write(system: ContactSystem) -> None:
    """Write the responses that were solved for to their rows."""
    out, place, k = system.responses, system.solved.place, system.contacts
    for i in range(system.coordinates):
        for j in range(out.shape[1]):
            out[place + i, j] = system.saddle_right[i, j]
    place += system.coordinates
    for i in range(k):
        row, leader = system.constraint[i], system.leader[i]
        column = system.column[leader]
        for j in range(out.shape[1]):
            pressing = system.square_right[column, j] if column >= 0 else 0.0
            out[place + i, j] = pressing + (system.restored[leader] if j == 0 else 0.0)
            if system.given[i] != 0:
                out[place + i, j] = normal_load(system, i) if j == 0 else 0.0
            out[place + k + i, j] = float(system.sense[i]) * _along(system, row, j) if row >= 0 else 0.0
    place += 2 * k
    for r in range(system.slips):
        row = system.constraints + r
        still = motionless(system, row)
        for j in range(out.shape[1]):
            value = _along(system, row, j)
            if j > 0:  # what the slip acceleration for a unit of the force is if nothing else holds the system
                force = system.power[system.tangential[j - 1]]
                if still or abs(value) <= _POWERLESS * inertial_terms(system, system.jacobian[row], force):
                    value = 0.0
            out[place + r, j] = value


@compiled_subset
def normal_load(system: ContactSystem, i: int) -> float:
    """Return the given normal load of a contact, or its impulse, which is none."""
    return system.normal_load[i] if system.solved.accelerating != 0 else 0.0
