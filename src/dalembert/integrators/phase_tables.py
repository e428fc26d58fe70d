"""What the loop over phases works with: the cases of a sweep, what is known of their modes, and room of a thread."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from .kinds import INTEGER, INTEGER_MATRIX, INTEGERS, MATRIX, VECTOR, Group

__all__ = [
    "APART",
    "ATTEMPT",
    "ATTEMPTS",
    "ATTEMPT_MODE",
    "ATTEMPT_STATION",
    "BENCH",
    "CAUSE",
    "CODE",
    "EVENTS",
    "EXPAND",
    "FIRED",
    "FIRST_ATTEMPT",
    "FLEET",
    "HELD",
    "KNOWN",
    "MODE",
    "NEXT",
    "NOTHING_FIRED",
    "PARADOX",
    "PARAMETERS",
    "PHASES",
    "PLAIN",
    "PLAN",
    "RULE_CAUSE",
    "RULE_FIRED",
    "RULE_SLIDING",
    "RULE_STATION",
    "SIZE",
    "SOON",
    "STATE",
    "STATION",
    "STEPS",
    "WHOLE",
    "WORDS",
    "Bench",
    "Fleet",
    "Plan",
]

STATE, MODE, CAUSE, STATION, FIRED, PHASES, STEPS, SOON, NEXT, WHOLE = range(10)
"""Rows of ``Fleet.whole``, and how many there are.

The status, the mode and why it began, the station (-1: none), what ended the last phase while that is not decided
(`NOTHING_FIRED` otherwise), how many phases others have followed, steps, phases in a row that ended too soon, the next
sample.
"""

NOTHING_FIRED = -1

SIZE, EVENTS, PARAMETERS, EXPAND, PLAIN, PARADOX, WORDS = range(7)
"""Columns of ``Plan.stations``.

Sizes of the state, of the events and of the parameters, the code that gives coordinates and rates, the station of
motions that nothing has ended, and the events, as bits, with which the reactions are no longer determined.
"""

RULE_STATION, RULE_FIRED, RULE_SLIDING, CODE, ATTEMPTS, FIRST_ATTEMPT, KNOWN, RULE_CAUSE = range(8)
"""Columns of ``Plan.rules``.

From a station, with these points fired and these contacts sliding, as bits, the code of a verdict decides between so
many attempts from the first on; whether sides are those just before; and the number of the cause.
"""

ATTEMPT_MODE, ATTEMPT_STATION, HELD, APART, ATTEMPT = range(5)
"""Columns of ``Plan.attempts``.

Mode, station, where the verdict has its rates (0: nowhere), the attempts before that it must not hold with, as bits.
Behind them are the ways and the sides of the contacts.
"""


class Plan(NamedTuple):
    """What is known of the modes.

    ``slips`` is the code of the slip velocities; ``columns`` (n_stations, n) says in which row of ``Bench.gathered``
    each parameter of a station is. ``count_at`` is the place of the number of cases among the words of a station. Of
    the events, those that were asked for come first; ``terminal`` is 1 for those that end a case.
    """

    slips: int
    count_at: int
    stations: NDArray[np.int64]
    columns: NDArray[np.int64]
    rules: NDArray[np.int64]
    attempts: NDArray[np.int64]
    terminal: NDArray[np.int64]


class Fleet(NamedTuple):
    """All cases, see `dalembert.runtime.hybrid.instants.Instants`, and those of them, in their ``order``, that go on.

    ``span`` is signed, ``directions`` are (k, 2 n_contacts). ``occurred`` (k, 3 n) are numbers, first and last times of
    the events that were asked for. What follows are the samples, and the ``log`` of a case that is alone: for every
    phase that it begins its time, mode, cause, number of phases that were too short, directions, sides, speeds,
    coordinates and rates. A full log ends the work.
    """

    t: FloatArray
    t1: FloatArray
    span: FloatArray
    passed: FloatArray
    x: FloatArray
    p: FloatArray
    directions: FloatArray
    sides: FloatArray
    speeds: FloatArray
    whole: NDArray[np.int64]
    occurred: FloatArray
    order: NDArray[np.int64]
    turn: NDArray[np.int64]
    t_eval: FloatArray
    sampled_t: FloatArray
    sampled_x: FloatArray
    sampled_mode: NDArray[np.int64]
    sampled_directions: FloatArray
    sampled_sides: FloatArray
    log: FloatArray


class Bench(NamedTuple):
    """Room of one thread, for so many cases at a time as ``gathered`` has columns.

    Its rows are start, end, parameters, directions, sides, coordinates and rates. ``entries`` are the loops over lanes
    of the stations, ``addresses`` those of the words for which they are called, which are rows of ``words``; their
    results are in ``y``, ``ends`` and ``happened``. The rest has one column a lane.
    """

    gathered: FloatArray
    words: NDArray[np.int64]
    entries: NDArray[np.int64]
    addresses: NDArray[np.int64]
    turns: NDArray[np.int64]
    y: FloatArray
    ends: FloatArray
    happened: FloatArray
    chosen: NDArray[np.int64]
    rules: NDArray[np.int64]
    clock: FloatArray
    states: FloatArray
    constants: FloatArray
    scene: FloatArray
    posed: FloatArray
    slips: FloatArray
    verdict: FloatArray


PLAN = Group((*(INTEGER,) * 2, *(INTEGER_MATRIX,) * 4, INTEGERS), Plan._fields)
FLEET = Group(
    (
        *(VECTOR,) * 4,
        *(MATRIX,) * 5,
        INTEGER_MATRIX,
        MATRIX,
        *(INTEGERS,) * 2,
        *(VECTOR,) * 2,
        MATRIX,
        INTEGERS,
        *(MATRIX,) * 3,
    ),
    Fleet._fields,
)
BENCH = Group(
    (
        MATRIX,
        INTEGER_MATRIX,
        *(INTEGERS,) * 3,
        VECTOR,
        MATRIX,
        VECTOR,
        *(INTEGERS,) * 2,
        *(MATRIX,) * 7,
    ),
    Bench._fields,
)
