"""Combinations of what contacts may do, in the order of preference, by what is known of each contact."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...subset.arguments import IntMatrix, IntVector, Matrix, Record, Vector
from ...subset.compiled_subset import compiled_subset, sqrt
from ..automaton import BITS
from ..contact_system import OPEN, SLIP, SMOOTH, STICK, Combination, ContactSystem, combination

MEET, LIFT, TURN, STOP, BREAK_UP, BREAK_DOWN, BREAK_PLANE, SHARE = BITS.values()
"""Guards of a contact that have fired, as bits: the gap closes; the normal reaction vanishes; it changes its sign; slip
ends; friction fails to hold against slip forwards, backwards, or in a plane; contacts can no longer share a load."""

FREE, LIFTING, TOUCHING, GRIPPED, SLIDING, HOVERING = 0, 1, 2, 3, 4, 5
"""Knowledge of a contact before a decision: open; its normal reaction has just vanished; closed without a law of
sliding; closed with a slip velocity of zero; closed with a slip velocity; after an impact so slow that it stays closed,
if no other impact follows at the same instant."""

RELEASED = 2
"""Side of an option in which a contact separates while it returns a part of its impulse."""

JAMS = 3
"""Of `Candidates.struck`: an impulse of friction stops the slip of a contact."""

_MOST_OPTIONS = 8

FEW_CONTACTS, _FEW, ALL = 3, 256, 2**62
"""Contacts up to which every combination is tried; with more, the most combinations that are all tried."""


class Found(Record):
    """Combinations that obey the laws of contact, as far as they have been tried.

    Attributes
    ----------
    best : int
        2 where one holds, 1 where one does within rounding, else 0.
    clear, lost, ambiguous : int
        The number of those that hold beyond rounding; 1 where a motion was not finite; 1 where two exclude each other.
    most : int
        Number of combinations up to which all are tried; where there are more, a search goes from one to the next.
    guided : int
        1 where the given directions of contacts at rest are guesses of those in which they begin to slip.
    backwards : int
        1 in a motion backwards in time: slip that begins there has come to rest, against its acceleration.
    """

    best: int
    clear: int
    lost: int
    ambiguous: int
    most: int
    guided: int
    backwards: int


class Candidates(NamedTuple):
    """Working memory of mode selection, with one entry for each contact unless stated otherwise.

    Attributes
    ----------
    kind : (n_contacts,)
        Class of each contact: FREE, LIFTING, TOUCHING, GRIPPED or SLIDING.
    fired : (n_contacts,)
        Guards that have fired, as bits: what has just failed to hold is not tried in its old state.
    struck : (n_contacts,)
        1 where it is being struck, 2 without restitution: it is closed during the impact, if that contradicts nothing;
        `JAMS` where it sticks at its end, in the same way.
    rebounds : (n_contacts,)
        1 where it returns a part of its impulse, by Poisson's law.
    slides : (n_contacts,)
        1 where it slides into an impact, so that sticking begins within mu and not within mu_static.
    still, least : (n_contacts,)
        The gap acceleration, or the rate after an impact, and the normal reaction, up to which rounding may make them.
    base_sides : (n_contacts,)
        Signs to which those of the options are relative.
    options, option_count, choice : (n_contacts, 24), (n_contacts,), (n_contacts,)
        State, side and direction of each option; their number; the number of the option in the combination.
    begins : (n_contacts,)
        1 where slip in a plane begins in the combination.
    taken, wanted : (n_contacts,)
        Numbers of the options in the best combination, and of those that violated laws call for, -1 for none.
    pushed, shares : (n_contacts,)
        Change of the normal reaction along a direction in which forces are not determined, and 1 where forces change.
    guessed : (n_slips + n_contacts,)
        Friction forces and normal reactions as iterations, or pivots, find them.
    table, basis : (m, 2 m + 2), (m,)
        Memory of `guessed_forces`, m = n_contacts + 3 n_slips; none for few contacts.
    lawful, sizes : (1 + 2 n_slips + n_contacts + 2 n_slips, 2 + n_slips), (n_slips,)
        Columns of the linear program of `load_shares`, and the sizes of the directions in which forces are not
        determined.
    amounts, weights, sharing : (n_slips,), (1 + n_slips,), (1 + n_slips,)
        Shares along these directions; the weights of the laws in the basis, and these.
    given : Combination
        The former states and signs, and directions of the slip velocities, or the former ones where there is none.
    now, best, clear : Combination
        The one that is tried, the one that is taken, and the first that holds beyond rounding.
    found : Found
    """

    kind: IntVector
    fired: IntVector
    struck: IntVector
    rebounds: IntVector
    slides: IntVector
    still: Vector
    least: Vector
    base_sides: Vector
    options: IntMatrix
    option_count: IntVector
    choice: IntVector
    begins: IntVector
    taken: IntVector
    wanted: IntVector
    pushed: Vector
    shares: IntVector
    guessed: Vector
    table: Matrix
    basis: IntVector
    lawful: Matrix
    sizes: Vector
    amounts: Vector
    weights: Vector
    sharing: IntVector
    given: Combination
    now: Combination
    best: Combination
    clear: Combination
    found: Found


def candidates_space(system: ContactSystem) -> Candidates:
    """Return working memory for the contacts of a scene."""
    k = system.contacts
    kind, fired, struck, rebounds, slides, count, choice, begins, taken, wanted, shares = np.zeros((11, k), np.int64)
    still, least, base_sides, pushed = np.zeros((4, k))
    options = np.zeros((k, 3 * _MOST_OPTIONS), np.int64)
    given, now, best, clear = (combination(k, system.coordinates) for _ in range(4))
    made = kind, fired, struck, rebounds, slides, still, least, base_sides, options, count, choice, begins
    m = k + 3 * system.slips if k > FEW_CONTACTS else 0
    memory = taken, wanted, pushed, shares, np.zeros(system.slips + k), np.zeros((m, 2 * m + 2)), np.zeros(m, np.int64)
    s = system.slips
    program = np.zeros((1 + k + 4 * s, 2 + s)), np.zeros(s), np.zeros(s), np.zeros(1 + s), np.zeros(1 + s, np.int64)
    found = Found()
    found.most = ALL if k <= FEW_CONTACTS else _FEW
    return Candidates(*made, *memory, *program, given, now, best, clear, found)


@compiled_subset
def closed_kind(system: ContactSystem, i: int, speed: float, limit: float) -> int:
    """Return what is known of a closed contact with a slip speed, which counts as zero up to a limit."""
    if system.closed[i] != SLIP:
        return TOUCHING
    return GRIPPED if speed <= limit else SLIDING


@compiled_subset
def turned(pick: Candidates, i: int) -> bool:
    """Return whether the normal reaction has just changed its sign, so that rounding decides about it."""
    return pick.fired[i] & TURN != 0


@compiled_subset
def broken(pick: Candidates, i: int) -> int:
    """Return where friction, and nothing else but slip the other way, has just failed to hold a contact.

    1 or -1 for slip forwards or backwards along a line, 2 in a plane; 0 where it has not.
    """
    fired = pick.fired[i] - (pick.fired[i] & STOP)
    return 2 if fired == BREAK_PLANE else 1 if fired == BREAK_UP else -1 if fired == BREAK_DOWN else 0


@compiled_subset
def rests(system: ContactSystem, pick: Candidates, i: int) -> bool:
    """Return whether a contact has no slip velocity, and friction that may hold it."""
    return pick.kind[i] == GRIPPED and system.mu_static[i] > 0.0


@compiled_subset
def copy_combination(source: Combination, target: Combination) -> None:
    """Copy a combination."""
    for i in range(source.mode.size):
        target.mode[i], target.sides[i] = source.mode[i], source.sides[i]
        target.released[i], target.press[i] = source.released[i], source.press[i]
        target.along[i, 0], target.along[i, 1] = source.along[i, 0], source.along[i, 1]
    for j in range(source.motion.size):
        target.motion[j] = source.motion[j]


@compiled_subset
def _add_option(pick: Candidates, i: int, state: int, side: int, way: int) -> None:
    """Add a state, a side and a direction (0: that of the slip velocity) to the options of a contact."""
    place = 3 * pick.option_count[i]
    pick.options[i, place], pick.options[i, place + 1], pick.options[i, place + 2] = state, side, way
    pick.option_count[i] += 1


@compiled_subset
def _side(system: ContactSystem, pick: Candidates, i: int, n: int) -> int:
    """Return the side of the options of a contact that is not open, the preferred one where n is 0."""
    if system.restored[i] > 0.0:
        return RELEASED if n == 0 else 1
    return -1 if n > 0 or turned(pick, i) else 1


@compiled_subset
def list_options(system: ContactSystem, pick: Candidates, expected: bool) -> None:
    """List what each contact may do, in the order of preference; ``expected`` leaves out other sides.

    Nothing sticks without friction. Slip that has just stopped reverses rather than begins anew.
    """
    for i in range(system.contacts):
        pick.option_count[i] = pick.choice[i] = 0
        pick.base_sides[i] = pick.given.sides[i] if expected or turned(pick, i) else 1.0
        if pick.kind[i] == FREE or pick.kind[i] == LIFTING:
            _add_option(pick, i, OPEN, 1, 0)
            continue
        if pick.struck[i] == JAMS:
            _add_option(pick, i, STICK, 1, 0)
            continue
        sides = 1 if turned(pick, i) or system.sided[i] == 0 or expected else 2
        sides = 2 if system.restored[i] > 0.0 else sides
        way, line = broken(pick, i), rests(system, pick, i) and system.width[i] == 1
        for n in range(sides):
            side = _side(system, pick, i, n)
            if rests(system, pick, i) and way == 0:
                _add_option(pick, i, STICK, side, 0)
        for n in range(sides):
            side = _side(system, pick, i, n)
            if line and way == 0:
                forwards = -1 if pick.fired[i] & STOP != 0 and pick.given.along[i, 0] > 0.0 else 1
                _add_option(pick, i, SLIP, side, forwards)
                _add_option(pick, i, SLIP, side, -forwards)
            else:
                _add_option(pick, i, system.closed[i], side, way if line else 0)
        if system.constraint[i] >= 0 and pick.struck[i] == 0 and system.restored[i] == 0.0:
            _add_option(pick, i, OPEN, 1, 0)


@compiled_subset
def find_option(pick: Candidates, i: int, state: int, side: int, way: int) -> int:
    """Return the number of the option of a contact with a state; -1 where it has none.

    A side of 0 is any, and so is a direction of 0.
    """
    for n in range(pick.option_count[i]):
        place = 3 * n
        if pick.options[i, place] == state and (side == 0 or pick.options[i, place + 1] == side):
            if way == 0 or pick.options[i, place + 2] == 0 or pick.options[i, place + 2] == way:
                return n
    return -1


@compiled_subset
def combinations(pick: Candidates) -> float:
    """Return the number of combinations of the listed options."""
    number = 1.0
    for i in range(pick.option_count.size):
        number *= float(pick.option_count[i])
    return number


@compiled_subset
def next_combination(pick: Candidates) -> bool:
    """Go to the next combination, the options of the last contact changing first; return whether there is one."""
    for n in range(pick.option_count.size - 1, -1, -1):
        pick.choice[n] += 1
        if pick.choice[n] < pick.option_count[n]:
            return True
        pick.choice[n] = 0
    return False


@compiled_subset
def choose_all(pick: Candidates, last: bool) -> None:
    """Choose the first option of each contact, or the last."""
    for i in range(pick.choice.size):
        pick.choice[i] = pick.option_count[i] - 1 if last else 0


@compiled_subset
def combine(system: ContactSystem, pick: Candidates) -> bool:
    """Write the combination that is chosen; return whether slip in a plane begins in it."""
    planar, along = False, pick.now.along
    for i in range(system.contacts):
        place = 3 * pick.choice[i]
        state, side, way = pick.options[i, place], pick.options[i, place + 1], pick.options[i, place + 2]
        pick.now.released[i] = 1 if side == RELEASED else 0
        pick.now.mode[i], pick.now.sides[i] = state, pick.base_sides[i] * (1.0 if side == RELEASED else float(side))
        along[i, 0], along[i, 1] = pick.given.along[i, 0], pick.given.along[i, 1]
        pick.begins[i] = 0
        if pick.now.mode[system.leader[i]] == OPEN:  # no friction of any law without the normal reaction
            pick.now.mode[i] = OPEN
        elif state == SMOOTH:
            size = system.regularization[i] * system.regularization[i]
            for a in range(system.width[i]):
                along[i, a] = system.velocity[system.row[i] + a]
                size += along[i, a] * along[i, a]
            for a in range(system.width[i]):
                along[i, a] /= sqrt(size)
        elif way != 0:
            along[i, 0], along[i, 1] = float(way), 0.0
        elif state == SLIP and pick.kind[i] == GRIPPED:
            if system.width[i] == 1:  # without friction, no direction means anything
                along[i, 0], along[i, 1] = 0.0, 0.0
            else:
                pick.begins[i], planar = 1, True
    return planar
