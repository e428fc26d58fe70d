"""Friction that fails to hold: how slip begins, and guards that said so too early.

A contact that sticks breaks away where its guard fires. What follows is decided here: whether it slips on where its
slip ends at once, and whether the guard is believed.
"""

from __future__ import annotations

from ..methods.step_constants import EPSILON
from ..subset.compiled_subset import compiled_subset, sqrt
from .contact_cases import ADDED, ContactCases
from .contact_kinds import SOON
from .contact_system import SLIP, STICK, ContactSystem
from .selection.contact_forces import solve_mode
from .selection.dead_centres import motionless
from .selection.mode_candidates import BREAK_DOWN, BREAK_UP, STOP, Candidates, broken

_ENOUGH_STOPS = 16
"""Number of phases in a row that may end too soon, after which slip at a dead centre goes the other way."""

_NEAR = 64.0 * EPSILON
"""Share of the limit of friction by which rounding of forces, and of times for a force that grows to its limit in one
unit of time, may leave a force below it where its guard fires."""


@compiled_subset
def began_to_slip(system: ContactSystem, cases: ContactCases, case: int, i: int) -> bool:
    """Return whether a contact along a line began to slip at this instant, and no guard but the end of slip has fired.

    It does not stick again because another contact breaks away, too: bodies that are alike would take turns.
    """
    began = cases.passed[case] == 0.0 and cases.modes[case, i] == SLIP and system.width[i] == 1
    return began and (cases.fired[case, i] == 0 or cases.fired[case, i] == STOP)


@compiled_subset
def way_of_slip(system: ContactSystem, cases: ContactCases, case: int, i: int) -> int:
    """Return the guards of a contact that began to slip at this instant, by which it slips on.

    At a dead centre it may turn back. Where it misses that by rounding, its slip ends where it begins, again and again:
    then it goes the other way, whatever the slip acceleration is there.
    """
    up = cases.added[case, ADDED * i] > 0.0
    if cases.fired[case, i] == STOP and cases.soon[case] >= _ENOUGH_STOPS:
        return STOP + (BREAK_DOWN if up else BREAK_UP)
    if motionless(system, system.constraints + system.first[i]):
        return cases.fired[case, i]
    return BREAK_UP if up else BREAK_DOWN


@compiled_subset
def forget_breaks(cases: ContactCases, case: int) -> None:
    """Forget the guards that say that friction fails to hold, where a force has a kink: it may stay at its limit there.

    A contact sticks on where that breaks no law, and its guard fires again at once where the force continues to grow.
    """
    for i in range(cases.fired.shape[1]):
        cases.fired[case, i] %= BREAK_UP


@compiled_subset
def forget_early_breaks(system: ContactSystem, pick: Candidates, cases: ContactCases, case: int) -> None:
    """Forget the guards that say that friction fails to hold, where it holds by the forces at the end of the phase.

    The polynomial of a step took a force that comes near its limit beyond it. The contact sticks on where that breaks
    no law, and its guard fires again where the force reaches the limit, soon or never. A phase that took no time has
    no polynomial that could be wrong.
    """
    early = False
    for i in range(system.contacts):
        early = early or (broken(pick, i) != 0 and cases.modes[case, i] == STICK)
    if not early or cases.passed[case] <= SOON * cases.span[case]:  # backwards in time the motion ends here
        return
    solve_mode(system, pick.given)
    noise = _NEAR * (1.0 + abs(cases.t[case]) / cases.passed[case])
    for i in range(system.contacts):
        if broken(pick, i) != 0 and cases.modes[case, i] == STICK and system.solved.undetermined == 0:
            used, limit = 0.0, system.mu_static[i] * pick.given.sides[i] * system.press[i]
            for r in range(system.first[i], system.first[i] + system.width[i]):
                used += system.forces[r, 0] * system.forces[r, 0]
            if limit - sqrt(used) > noise * limit:
                pick.fired[i] = 0
