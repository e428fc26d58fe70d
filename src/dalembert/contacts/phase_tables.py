"""Tables of the loop over phases: cases, modes as compiled code runs them, and memory of a thread."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..subset.arguments import Address, AddressVector, IntMatrix, IntVector, Matrix, Record, Vector
from .contact_cases import ContactCases
from .phase_stops import PhaseStops

NO_RUNNER, NOT_STARTED, JUMPS = -1, -2, -3
"""In place of the number of a runner: the mode has none yet; the case starts, and its mode is to be selected; an event
of a user has occurred that maps the state, after which the mode is to be selected."""

ANY_PHASE = -1
"""In place of a kind of phases (`RunnerTable.begins`): all phases of a mode."""


class CaseNumbers(NamedTuple):
    """Integers of the cases.

    Attributes
    ----------
    state : (k,)
        Status, or RUNNING.
    runner : (k,)
        Number of the runner of its mode, or `NO_RUNNER`, `NOT_STARTED` or `JUMPS`.
    phases, steps : (k,)
        Phases that took time and that others have followed; steps.
    history : (k,)
        A hash of the modes of the phases that took time, in their order.
    next : (k,)
        The next sample.
    logged : (k,)
        Lines of the log.
    """

    state: IntVector
    runner: IntVector
    phases: IntVector
    steps: IntVector
    history: IntVector
    next: IntVector
    logged: IntVector


def case_numbers(count: int) -> CaseNumbers:
    """Return zeros for so many cases."""
    return CaseNumbers(*np.zeros((len(CaseNumbers._fields), count), np.int64))


class RunnerTable(NamedTuple):
    """Modes as compiled code runs them, one entry each.

    Attributes
    ----------
    mode : (n,)
        Number of the mode, see `ContactCases`.
    size, parameters : (n,)
        Components of the state, and parameters.
    events : (n,)
        Events: those that users watch, then the guards of the mode.
    first_guard : (n,)
        Row of the first guard in ``PhasePlan.guards``.
    expand : (n,)
        Code of coordinates and rates; 0 where these are the state.
    inside : (n,)
        1 where it records samples inside its runs; those of others end at samples.
    begins : (n,)
        1 where it serves phases in which slip in a plane begins, 0 for all others of its mode, -1 for all.
    """

    mode: IntVector
    size: IntVector
    parameters: IntVector
    events: IntVector
    first_guard: IntVector
    expand: AddressVector
    inside: IntVector
    begins: IntVector


class PhasePlan(NamedTuple):
    """Modes, guards and code that all cases have in common.

    Attributes
    ----------
    contact_data : Address
        Code of the numbers of the contacts.
    decide : Address
        Loop of `dalembert.contacts.contact_decisions`.
    runners : RunnerTable
    columns : (n_runners, n)
        Rows of ``ThreadWorkspace.gathered`` that hold the parameters of each runner.
    guards : (n_guards, 3)
        Contact of each guard, the bit that it sets (-1 and 0 for a paradox), and 1 where it may have a kink within a
        phase.
    terminal, jumps : (n_requested,)
        Of events of users: the occurrence that ends a case (0: none does), and 1 for those that map the state.
    most_steps : int
        Steps of all phases together after which a case ends.
    """

    contact_data: Address
    decide: Address
    runners: RunnerTable
    columns: IntMatrix
    guards: IntMatrix
    terminal: IntVector
    jumps: IntVector
    most_steps: int


class CaseSamples(NamedTuple):
    """Samples, case by case; the attributes are those of `ContactCases`, and the histories of `CaseNumbers`."""

    t: Vector
    x: Matrix
    added: Matrix
    number: IntVector
    history: IntVector


class CaseTable(NamedTuple):
    """All cases, and those of them, in their ``order``, that continue.

    Attributes
    ----------
    t0, t1 : (k,)
        Times when the present phase began, and final times [s].
    cases : ContactCases
    numbers : CaseNumbers
    occurred : (k, 3 n_requested)
        Number, first and last time of each event that users watch.
    totals : (k, n_running)
        Minima, maxima and integrals so far.
    order, turn : (k,), (2,)
        Cases that continue come first; how many of them threads have taken, and how many there are.
    t_eval, t_last : (m,)
        Times of samples [s], and the last instants that they mean (`event_rules.last_instants`).
    samples : CaseSamples
    log : (n_lines, n)
        For a case that is alone, a line for each phase that begins: time, number of the mode, parameters that the
        contacts add, coordinates, rates and first-order states. A full log ends the work.
    stops : PhaseStops
    carried : (k, 2 n) or (0, 0)
        Where cases stop and go on or events map states, the sign of each event of a case in its present phase, and 1
        if it was seen beyond rounding since an event last mapped the state (`EventWorkspace.carried`).
    """

    t0: Vector
    t1: Vector
    cases: ContactCases
    numbers: CaseNumbers
    occurred: Matrix
    totals: Matrix
    order: IntVector
    turn: IntVector
    t_eval: Vector
    t_last: Vector
    samples: CaseSamples
    log: Matrix
    stops: PhaseStops
    carried: Matrix


class PhaseProgress(Record):
    """Progress of the loop over phases: the cases that it has taken, those of the present phase, and whether it paused.

    ``paused`` is 1 where the loop over lanes returned before its end, and is to be called again, and 2 between phases:
    the loop returns after ``patience`` of them, if that is not 0, and ``phases`` is how many it has run since.
    """

    paused: int
    first: int
    last: int
    size: int
    phases: int
    patience: int


class ThreadWorkspace(NamedTuple):
    """Memory of one thread, for so many cases at a time as ``gathered`` has columns.

    Attributes
    ----------
    gathered
        Start, end, parameters of the scene, those that the contacts add, coordinates, rates and first-order states of
        the cases, and their directions of time.
    entries, packed_args, turns
        Loops over lanes of the runners, their arguments, and their turns.
    y, ends, happened, totals
        Results of these loops.
    carried
        Signs of events with which cases continue in them and end, and which were seen (`EventWorkspace.carried`).
    reaching, acted
        Cases that reach stops, one a lane, with the controllers that act there; and what these set.
    chosen, sampled
        The cases at hand, and the next sample of each.
    clock, states, constants, scene, posed, data
        Arguments and results of kernels, one column a lane.
    deciding, ending, values, after_impact, decision
        Arguments of the decisions: cases or -1, one row a lane; 1 and the number of the mode of those that end; packed.
    progress
        See `PhaseProgress`.
    """

    gathered: Matrix
    entries: AddressVector
    packed_args: IntMatrix
    turns: IntVector
    y: Vector
    ends: Matrix
    happened: Vector
    totals: Matrix
    carried: Vector
    reaching: IntMatrix
    acted: Matrix
    chosen: IntVector
    sampled: IntVector
    clock: Matrix
    states: Matrix
    constants: Matrix
    scene: Matrix
    posed: Matrix
    data: Matrix
    deciding: IntVector
    ending: IntVector
    values: Matrix
    after_impact: IntVector
    decision: IntMatrix
    progress: PhaseProgress
