"""Combinations of what contacts may do, in the order of preference."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .arguments import IntMatrix, IntVector, Matrix, Vector
from .compiled_subset import compiled_subset, sqrt
from .contact_table import (
    CLOSED,
    MU_STATIC,
    OPEN,
    REGULARIZATION,
    SLIP,
    SMOOTH,
    STICK,
    ContactSpace,
    ContactTable,
    number,
    velocity,
)

__all__ = [
    "FREE",
    "GRIPPED",
    "HOVERING",
    "LIFTING",
    "SLIDING",
    "TOUCHING",
    "Candidates",
    "candidates_space",
    "combine",
    "list_options",
    "next_combination",
]

FREE, LIFTING, TOUCHING, GRIPPED, SLIDING, HOVERING = 0, 1, 2, 3, 4, 5
"""Knowledge of a contact before a decision: open; its normal reaction has just vanished; closed without a law of
sliding; closed with a slip velocity of zero; closed with a slip velocity; after an impact so slow that it stays closed,
if no other impact follows at the same instant."""

_MOST_OPTIONS = 8


class Candidates(NamedTuple):
    """Working memory of mode selection, with one entry for each contact unless stated otherwise.

    Attributes
    ----------
    kind : (n_contacts,)
        Class of each contact: FREE, LIFTING, TOUCHING, GRIPPED or SLIDING.
    broken : (n_contacts,)
        Where friction has just failed to hold it: the direction of slip along a line, 2 in a plane; else 0.
    struck : (n_contacts,)
        1 where it is being struck, 2 without restitution: it is closed during the impact, if that contradicts nothing.
    slides : (n_contacts,)
        1 where it slides into an impact, so that sticking begins within mu and not within mu_static.
    turned : (n_contacts,)
        1 where its normal reaction has just changed its sign, so that rounding decides about it.
    former, parted : (n_contacts,)
        Its former state; 1 where contacts, this one among them, can no longer share a load in their former states.
    still, least : (n_contacts,)
        The gap acceleration, and the normal reaction, up to which rounding may make them.
    given_along, given_sides : (n_contacts, 2), (n_contacts,)
        Directions of the slip velocities, or the former ones where there is none; former signs of normal reactions.
    base_sides : (n_contacts,)
        Signs to which those of the options are relative.
    options, option_count, choice : (n_contacts, 24), (n_contacts,), (n_contacts,)
        State, side and direction of each option; their number; the number of the option in the combination.
    mode, sides, along, begins
        The combination, and 1 where slip in a plane begins in it.
    best_mode, best_sides, best_along, best_motion
        The combination that is taken, and its accelerations, or rates after an impact (n_q,).
    motion : (n_q,)
        The accelerations, or rates after an impact, of the present combination.
    clear_mode, clear_sides
        The first combination that holds beyond rounding.
    sticking
        The combination with sticking in place of slip in a plane that begins.
    """

    kind: IntVector
    broken: IntVector
    struck: IntVector
    slides: IntVector
    turned: IntVector
    former: IntVector
    parted: IntVector
    still: Vector
    least: Vector
    given_along: Matrix
    given_sides: Vector
    base_sides: Vector
    options: IntMatrix
    option_count: IntVector
    choice: IntVector
    mode: IntVector
    sides: Vector
    along: Matrix
    begins: IntVector
    best_mode: IntVector
    best_sides: Vector
    best_along: Matrix
    best_motion: Vector
    motion: Vector
    clear_mode: IntVector
    clear_sides: Vector
    sticking: IntVector


def candidates_space(table: ContactTable) -> Candidates:
    """Return working memory for the contacts of a scene."""
    k, n = len(table.constraint), table.coordinates

    def whole() -> np.ndarray:
        return np.zeros(k, np.int64)

    return Candidates(
        kind=whole(),
        broken=whole(),
        struck=whole(),
        slides=whole(),
        turned=whole(),
        former=whole(),
        parted=whole(),
        still=np.zeros(k),
        least=np.zeros(k),
        given_along=np.zeros((k, 2)),
        given_sides=np.ones(k),
        base_sides=np.ones(k),
        options=np.zeros((k, 3 * _MOST_OPTIONS), np.int64),
        option_count=whole(),
        choice=whole(),
        mode=whole(),
        sides=np.zeros(k),
        along=np.zeros((k, 2)),
        begins=whole(),
        best_mode=whole(),
        best_sides=np.zeros(k),
        best_along=np.zeros((k, 2)),
        best_motion=np.zeros(n),
        motion=np.zeros(n),
        clear_mode=whole(),
        clear_sides=np.zeros(k),
        sticking=whole(),
    )


@compiled_subset
def _side(pick: Candidates, i: int) -> int:
    """Return the side on which a contact is pushed, relative to that just before."""
    return -1 if pick.turned[i] != 0 else 1


@compiled_subset
def _add_option(pick: Candidates, i: int, state: int, side: int, way: int) -> None:
    """Add a state, a side and a direction (0: that of the slip velocity) to the options of a contact."""
    place = 3 * pick.option_count[i]
    pick.options[i, place], pick.options[i, place + 1], pick.options[i, place + 2] = state, side, way
    pick.option_count[i] += 1


@compiled_subset
def list_options(table: ContactTable, space: ContactSpace, pick: Candidates, expected: bool) -> None:
    """List what each contact may do, in the order of preference; ``expected`` leaves out other sides.

    Nothing sticks without friction.
    """
    for i in range(table.constraint.size):
        pick.option_count[i] = 0
        if pick.kind[i] == FREE or pick.kind[i] == LIFTING:
            _add_option(pick, i, OPEN, 1, 0)
            continue
        sides = 1 if pick.turned[i] != 0 or table.sided[i] == 0 or expected else 2
        state = CLOSED
        if table.width[i] > 0:
            state = SLIP
            if table.smooth[i] != 0:
                state = SMOOTH
        rough = number(table, space, i, MU_STATIC) > 0.0
        if state == SLIP and rough and pick.kind[i] == GRIPPED and pick.broken[i] == 0:
            for n in range(sides):
                _add_option(pick, i, STICK, _side(pick, i) if n == 0 else -1, 0)
        for n in range(sides):
            side = _side(pick, i) if n == 0 else -1
            if state == SLIP and rough and pick.kind[i] == GRIPPED and table.width[i] == 1:
                if pick.broken[i] != 0:
                    _add_option(pick, i, SLIP, side, pick.broken[i])
                else:
                    _add_option(pick, i, SLIP, side, 1)
                    _add_option(pick, i, SLIP, side, -1)
            else:
                _add_option(pick, i, state, side, 0)
        if table.constraint[i] >= 0 and pick.struck[i] == 0:
            _add_option(pick, i, OPEN, 1, 0)


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
def combine(table: ContactTable, space: ContactSpace, pick: Candidates) -> bool:
    """Write the combination that is chosen; return whether slip in a plane begins in it."""
    planar = False
    for i in range(table.constraint.size):
        place = 3 * pick.choice[i]
        state, way = pick.options[i, place], pick.options[i, place + 2]
        pick.mode[i], pick.sides[i] = state, pick.base_sides[i] * float(pick.options[i, place + 1])
        pick.begins[i] = 0
        pick.along[i, 0], pick.along[i, 1] = pick.given_along[i, 0], pick.given_along[i, 1]
        if state == SMOOTH:
            size = number(table, space, i, REGULARIZATION)
            size *= size
            for a in range(table.width[i]):
                pick.along[i, a] = velocity(table, space, table.constraints + table.first[i] + a)
                size += pick.along[i, a] * pick.along[i, a]
            for a in range(table.width[i]):
                pick.along[i, a] /= sqrt(size)
        elif way != 0:
            pick.along[i, 0], pick.along[i, 1] = float(way), 0.0
        elif state == SLIP and pick.kind[i] == GRIPPED:
            if table.width[i] == 1:  # without friction, no direction means anything
                pick.along[i, 0], pick.along[i, 1] = 0.0, 0.0
            else:
                pick.begins[i], planar = 1, True
    return planar
