"""Contact forces at an instant: accelerations, or rates after an impact, in any mode of the contacts.

Motion, normal reactions, gap accelerations and slip accelerations are affine in the friction forces; a mode makes these
unknown (sticking), or proportional to the normal reactions (sliding).
"""

from __future__ import annotations

from ...arrays import FloatArray
from ...subset.compiled_subset import compiled_subset, sqrt
from ..contact_system import (
    OPEN,
    SLIP,
    SMOOTH,
    STICK,
    Combination,
    ContactSystem,
    dot,
    drift,
    inertia_of,
    inertial_size,
)
from .contact_responses import respond
from .dense_solve import solve_dense

_STEP, _MOST_STEPS = 2.0**20, 50
"""Factor between scales, and most of them: sizes of ordinary units keep the scale one."""

_ALONE = 1e-9
"""Share of a direction in which friction is not determined up to which a contact has no part in it."""


@compiled_subset
def load_accelerations(system: ContactSystem) -> None:
    """Have accelerations solved for."""
    for i in range(system.coordinates):
        system.load[i] = system.forcing[i]
    for row in range(system.demand.size):
        system.demand[row] = system.bias[row]
    _begin(system)
    system.solved.accelerating = 1


@compiled_subset
def load_impact(system: ContactSystem) -> None:
    """Have the rates after an impact solved for, those of constraints and of slip that hold being zero."""
    for i in range(system.coordinates):
        system.load[i] = dot(system.mass[i], system.rates, 0.0)
    for row in range(system.demand.size):
        system.demand[row] = -drift(system, row)
    _begin(system)


@compiled_subset
def load_restitution(system: ContactSystem, compressed: FloatArray) -> None:
    """Have the rates at the end of an impact solved for, from those after its compression, by what contacts return.

    That is in ``restored``: the least normal impulses, of which the load gets the momentum.
    """
    for i in range(system.coordinates):
        system.load[i] = dot(system.mass[i], compressed, 0.0)
    for i in range(system.contacts):
        for j in range(system.coordinates):
            system.load[j] += system.restored[i] * system.power[system.normal[i], j]
    for row in range(system.demand.size):
        system.demand[row] = -drift(system, row)
    _begin(system)


@compiled_subset
def load_correction(system: ContactSystem) -> None:
    """Have the smallest change of the coordinates, by kinetic energy, solved for that makes gaps zero."""
    for i in range(system.coordinates):
        system.load[i] = 0.0
    for row in range(system.demand.size):
        system.demand[row] = 0.0
    for i in range(system.contacts):
        if system.constraint[i] >= 0:
            system.demand[system.constraint[i]] = -float(system.sense[i]) * system.gap[i]
    _begin(system)


@compiled_subset
def _begin(system: ContactSystem) -> None:
    """Forget responses, and choose the scales of accelerations, multipliers and reactions by the mass matrix."""
    system.solved.accelerating = 0
    for place in range(system.kept.size):
        system.kept[place] = -1
    n, m = system.coordinates, system.constraints
    for j in range(n):
        system.scales[j] = _scale_of(sqrt(max(inertia_of(system, j), 0.0)))
    for row in range(m):
        system.scales[n + row] = _scale_of(_largest(system, system.jacobian[row]))
    for unknown in range(system.owner.size):
        system.scales[n + m + unknown] = _scale_of(_largest(system, system.power[unknown]))
    for i in range(system.contacts):
        system.weight[i] = _weight(system, i) if system.leader[i] != i else 1.0


@compiled_subset
def _weight(system: ContactSystem, i: int) -> float:
    """Return what a unit of the friction of a further law counts beside a unit of its normal reaction."""
    size, pushing = 0.0, inertial_size(system, system.power[system.normal[i]])
    for r in range(system.first[i], system.first[i] + system.width[i]):
        size = max(size, inertial_size(system, system.power[system.tangential[r]]))
    return size / pushing if pushing > 0.0 else 1.0


@compiled_subset
def _largest(system: ContactSystem, along: FloatArray) -> float:
    """Return the largest entry of a row or of power coefficients, in the scales of the accelerations."""
    size = 0.0
    for j in range(along.size):
        size = max(size, abs(along[j]) * system.scales[j])
    return size


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
def open_contacts(chosen: Combination) -> int:
    """Return the contacts of a mode whose gaps are not held, as bits."""
    opened = 0
    for i in range(chosen.mode.size):
        if chosen.mode[i] == OPEN or chosen.released[i] != 0:
            opened += 1 << i
    return opened


@compiled_subset
def solve_mode(system: ContactSystem, chosen: Combination) -> None:
    """Solve for motion and forces in a mode, with its directions of slip and signs of normal reactions."""
    respond(system, open_contacts(chosen))
    found, laws, forces = system.responses, system.laws, system.forces
    presses = system.solved.place + system.coordinates
    for i in range(system.contacts):
        for a in range(system.width[i]):
            r, state = system.first[i] + a, chosen.mode[i]
            row = presses + 2 * system.contacts + r
            scale = _scale_of(abs(found[row, 1 + r])) if state == STICK else 1.0
            for j in range(system.slips):
                laws[r, j] = found[row, 1 + j] * scale if state == STICK else 0.0
            forces[r, 0] = -found[row, 0] * scale if state == STICK else 0.0
            if state != STICK:
                laws[r, r] = 1.0
            if state == SLIP or state == SMOOTH:
                kappa = system.mu[i] * chosen.sides[i] * chosen.along[i, a]
                for j in range(system.slips):
                    laws[r, j] += kappa * found[presses + i, 1 + j]
                forces[r, 0] = -kappa * found[presses + i, 0]
    system.solved.undetermined = solve_dense(laws, forces, system.slips, 1, system.dense)
    for a in range(system.solved.undetermined):
        for r in range(system.slips):
            system.free[a, r] = system.dense.free[a, r]
    if system.solved.undetermined > 1:
        _separate(system)
    _leave_out_single(system)
    for i in range(system.solution.size):
        value = found[system.solved.place + i, 0]
        for j in range(system.slips):
            value += found[system.solved.place + i, 1 + j] * forces[j, 0]
        system.solution[i] = value


@compiled_subset
def _separate(system: ContactSystem) -> None:
    """Combine the directions in which forces are not determined so that each changes few contacts (Gauss-Jordan)."""
    free, count = system.free, system.solved.undetermined
    for a in range(count):
        pivot = 0
        for r in range(1, system.slips):
            if abs(free[a, r]) > abs(free[a, pivot]):
                pivot = r
        largest = free[a, pivot]
        for r in range(system.slips):
            free[a, r] /= largest
        for b in range(count):
            if b != a:
                factor = free[b, pivot]
                for r in range(system.slips):
                    free[b, r] -= factor * free[a, r]


@compiled_subset
def _leave_out_single(system: ContactSystem) -> None:
    """Leave out the directions that change the friction of one contact alone: constraints hold it, friction does not.

    Where a wall would have to pull for that, it is open (`dalembert.contacts.equations.sticking_rows`).
    """
    count = 0
    for a in range(system.solved.undetermined):
        changed, largest = 0, 0.0
        for r in range(system.slips):
            largest = max(largest, abs(system.free[a, r]))
        for i in range(system.contacts):
            most = 0.0
            for r in range(system.first[i], system.first[i] + system.width[i]):
                most = max(most, abs(system.free[a, r]))
            changed += 1 if most > _ALONE * largest else 0
        if changed > 1:
            for r in range(system.slips):
                system.free[count, r] = system.free[a, r]
            count += 1
    system.solved.undetermined = count


@compiled_subset
def compliance(system: ContactSystem, a: int, b: int) -> float:
    """Return the acceleration along one slip velocity for a unit of friction force along another."""
    return system.responses[system.solved.place + system.coordinates + 2 * system.contacts + a, 1 + b]


@compiled_subset
def gap_compliance(system: ContactSystem, i: int, r: int) -> float:
    """Return the acceleration of the gap of a contact for a unit of friction force along a slip velocity."""
    return system.responses[system.solved.place + system.coordinates + system.contacts + i, 1 + r]


@compiled_subset
def press_compliance(system: ContactSystem, i: int, r: int) -> float:
    """Return the change of the normal reaction of a contact for a unit of friction force along a slip velocity."""
    return system.responses[system.solved.place + system.coordinates + i, 1 + r]


@compiled_subset
def shift_forces(system: ContactSystem, direction: int, amount: float) -> None:
    """Change friction forces along a direction in which they are not determined, and normal reactions with them."""
    for r in range(system.slips):
        system.forces[r, 0] += amount * system.free[direction, r]
    for i in range(system.contacts):
        for r in range(system.slips):
            system.press[i] += amount * press_compliance(system, i, r) * system.free[direction, r]
