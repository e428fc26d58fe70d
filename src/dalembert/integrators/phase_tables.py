"""Tables of the loop over phases: the cases of a sweep, what is known of their modes, and arrays of a thread."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .arguments import Address, IntMatrix, IntVector, Matrix, Vector

__all__ = [
    "NOTHING_FIRED",
    "AttemptTable",
    "Bench",
    "CaseNumbers",
    "Fleet",
    "Plan",
    "RuleTable",
    "StationTable",
    "case_numbers",
]

NOTHING_FIRED = -1
"""Value of `CaseNumbers.fired` where nothing waits for a decision."""


class CaseNumbers(NamedTuple):
    """Integers of the cases.

    The status, the mode and why it began, the station (-1: none), what ended the last phase while that is not decided
    (`NOTHING_FIRED` otherwise), how many phases others have followed, steps, phases in a row that ended too soon, the
    next sample.
    """

    state: IntVector
    mode: IntVector
    cause: IntVector
    station: IntVector
    fired: IntVector
    phases: IntVector
    steps: IntVector
    soon: IntVector
    next: IntVector


def case_numbers(count: int) -> CaseNumbers:
    """Return zeros for so many cases."""
    return CaseNumbers(*np.zeros((len(CaseNumbers._fields), count), np.int64))


class StationTable(NamedTuple):
    """Sizes of the state, of the events and of the parameters of each station, and code.

    The code gives coordinates and rates; ``plain`` is the station of motions that nothing has ended, ``paradox`` the
    events, as bits, with which the reactions are no longer determined.
    """

    size: IntVector
    events: IntVector
    parameters: IntVector
    expand: IntVector
    plain: IntVector
    paradox: IntVector


class RuleTable(NamedTuple):
    """How cases go on.

    From a station, with these points fired and these contacts sliding, as bits, the code of a verdict decides between
    so many attempts from the first on; whether sides are those just before; and the number of the cause.
    """

    station: IntVector
    fired: IntVector
    sliding: IntVector
    code: IntVector
    attempts: IntVector
    first_attempt: IntVector
    known: IntVector
    cause: IntVector


class AttemptTable(NamedTuple):
    """Mode, station, where the verdict has its rates (0: nowhere), the attempts that it must not hold with, as bits.

    ``ways`` and ``sides`` (n_attempts, n_contacts) are those of the contacts.
    """

    mode: IntVector
    station: IntVector
    held: IntVector
    apart: IntVector
    ways: IntMatrix
    sides: IntMatrix


class Plan(NamedTuple):
    """What is known of the modes.

    ``slips`` is the code of the slip velocities; ``columns`` (n_stations, n) says in which row of ``Bench.gathered``
    each parameter of a station is. Of the events, those that were asked for come first; ``terminal`` is 1 for those
    that end a case.
    """

    slips: Address
    stations: StationTable
    columns: IntMatrix
    rules: RuleTable
    attempts: AttemptTable
    terminal: IntVector


class Fleet(NamedTuple):
    """All cases, see `dalembert.runtime.hybrid.instants.Instants`, and those of them, in their ``order``, that go on.

    ``span`` is signed, ``directions`` are (k, 2 n_contacts). ``occurred`` (k, 3 n) are numbers, first and last times of
    the events that were asked for. What follows are the samples, and the ``log`` of a case that is alone: for every
    phase that it begins its time, mode, cause, number of phases that were too short, directions, sides, speeds,
    coordinates and rates. A full log ends the work.
    """

    t: Vector
    t1: Vector
    span: Vector
    passed: Vector
    x: Matrix
    p: Matrix
    directions: Matrix
    sides: Matrix
    speeds: Matrix
    numbers: CaseNumbers
    occurred: Matrix
    order: IntVector
    turn: IntVector
    t_eval: Vector
    sampled_t: Vector
    sampled_x: Matrix
    sampled_mode: IntVector
    sampled_directions: Matrix
    sampled_sides: Matrix
    log: Matrix


class Bench(NamedTuple):
    """Room of one thread, for so many cases at a time as ``gathered`` has columns.

    Its rows are start, end, parameters, directions, sides, coordinates and rates. ``entries`` are the loops over lanes
    of the stations, rows of ``packed_args`` their arguments; their results are in ``y``, ``ends`` and ``happened``. The
    rest has one column a lane.
    """

    gathered: Matrix
    packed_args: IntMatrix
    entries: IntVector
    turns: IntVector
    y: Vector
    ends: Matrix
    happened: Vector
    chosen: IntVector
    rules: IntVector
    clock: Matrix
    states: Matrix
    constants: Matrix
    scene: Matrix
    posed: Matrix
    slips: Matrix
    verdict: Matrix
