"""Motions with contacts taken one step at a time, for exports: the loop over phases, which pauses after each step.

A step of the loop over lanes may end a phase. What follows from that, an impact among it, happens with the next step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from ..lanes.lane_steps import interpolate
from ..lanes.sweep_arguments import SweepArguments
from ..lanes.workspace import BEFORE, END, NOW
from ..loops.event_steps import corrects
from ..loops.lane_loop import EVENT_LOOP, IMPLICIT_LOOP
from ..methods.status import RUNNING, Status
from ..stops.instants import InstantTable, begin_instants, list_instants
from ..subset.arguments import Record, Vector
from ..subset.compiled_subset import call_code, compiled_subset, row
from .contact_decisions import LOOP as DECISIONS
from .contact_decisions import DecisionArguments
from .phase_loop import LOOP, PhaseArguments
from .phase_maps import EventMaps, map_state, refuse_map
from .phase_tables import JUMPS
from .slip_begins import forget_breaks

CHANGES = 2
"""Value of ``ContactPlace.pending``."""


_ERRORS = 1000.0
"""Multiple of the tolerances that errors of others' integrators may have, which add up from step to step."""


class ContactPlace(Record):
    """The runner that took the last step, where that began and ended, and the direction of time, 1 or -1.

    ``pending`` is 1 where what follows from the end of a phase has not happened yet, and before the first step;
    `CHANGES` where contacts change at that end.
    """

    runner: int
    begin: float
    time: float
    direction: float
    pending: int


class ContactSteps(NamedTuple):
    """A motion with contacts.

    ``sampled`` (2 n_q + n_z,) gets coordinates, rates and first-order states; ``own`` (n_y,) is the state of a mode
    that is to be corrected; ``maps`` are those of events of users, ``instants`` those of controllers.
    """

    phases: PhaseArguments
    sampled: Vector
    place: ContactPlace
    own: Vector
    maps: EventMaps
    instants: InstantTable


@compiled_subset
def select_modes(arguments: DecisionArguments) -> int:
    """Select the next mode; return 0."""
    DECISIONS(arguments)
    return 0


def phase_step(loop: Callable[[SweepArguments], int]) -> Callable[[ContactSteps, SweepArguments, int], int]:
    """Return a function that takes a step of a phase by a loop over lanes."""

    def run_phase(steps: ContactSteps, runner: SweepArguments, number: int) -> int:
        place, state, paused = steps.place, runner.state, loop(runner)
        if paused != 0:
            place.runner, place.begin, place.time = number, state.tally[BEFORE, 0], state.clock[NOW, 0]
            status = state.numbers.status[0]
            place.pending = 0 if status == RUNNING else CHANGES if status == Status.EVENT else 1
        return paused

    return compiled_subset(run_phase)


run_phase, run_implicit_phase = phase_step(EVENT_LOOP), phase_step(IMPLICIT_LOOP)
"""Take a step of a phase in the mode of a runner of some number; return 0 where the phase had ended before."""


@compiled_subset
def cut_phase(steps: ContactSteps, runner: SweepArguments) -> None:
    """End the run of a phase that has paused at the end of its last step; the phase continues with other parameters.

    It ends as at a stop (`dalembert.contacts.phase_stops`): guards that have another sign then fire at once.
    """
    state, space = runner.state, runner.workspace
    forget_breaks(steps.phases.table.cases, 0)
    if state.progress.paused == 0 or state.numbers.status[0] != RUNNING:
        return
    state.clock[END, 0], state.numbers.status[0] = state.clock[NOW, 0], Status.SUCCESS
    for e in range(runner.events.directions.size):
        unknown = space.zero[0, e] != 0.0 and space.seen[0, e] == 0.0
        space.carried[0, 2 * e] = 0.0 if unknown else space.signs[0, e]
        if space.seen[0, e] != 0.0:
            space.carried[0, 2 * e + 1] = 1.0


@compiled_subset
def begin_motion_instants(steps: ContactSteps, t0: float) -> bool:
    """Take the periods of controllers, in a motion that begins at a time; return whether they make sense."""
    return begin_instants(steps.instants, row(steps.phases.table.cases.p, 0), t0)


def stepping(mapped: bool) -> Callable[[ContactSteps], int]:
    """Return a function that takes a step and returns the status of the run, which events of users may map."""

    def contact_step(steps: ContactSteps) -> int:
        table, place = steps.phases.table, steps.place
        if steps.instants.listed.size > 0:
            list_instants(steps.instants, table.stops.table, table.t1[0], False)
        if LOOP(steps.phases) != 0:
            return RUNNING
        if mapped:
            while table.numbers.state[0] == RUNNING and table.numbers.runner[0] == JUMPS:
                map_state(table, steps.maps, 0)
                table.turn[0] = 0
                if LOOP(steps.phases) != 0:
                    return RUNNING
            refuse_map(table, steps.maps, 0)
        place.time, place.pending = table.cases.t[0], 0
        if table.numbers.state[0] == RUNNING:  # no equations determine the motion in the mode
            return Status.SINGULAR_CONFIGURATION
        return table.numbers.state[0]

    return compiled_subset(contact_step)


contact_step, mapped_contact_step = stepping(mapped=False), stepping(mapped=True)


@compiled_subset
def sample_phase(steps: ContactSteps, runner: SweepArguments, t: float) -> None:
    """Compute coordinates and rates at a time within the last step, which a runner took."""
    part, state = runner.part, runner.state
    part.clock[0, 0] = t
    if t == state.clock[NOW, 0]:
        for m in range(runner.shape.n):
            part.states[m, 0] = state.states[state.progress.old + m, 0]
    else:
        interpolate(runner, 0, t)
        if not corrects(runner):  # it stays as it is
            interpolate(runner, 0, t)
    _expand(steps, runner)


@compiled_subset
def _expand(steps: ContactSteps, runner: SweepArguments) -> None:
    """Compute coordinates and rates from the state in ``part``."""
    part = runner.part
    clock, states = row(part.clock, 0), row(part.states, 0)
    call_code(part.expand, clock, states, row(runner.state.constants, 0), 0, row(part.posed, 0))
    for m in range(steps.sampled.size):
        steps.sampled[m] = part.posed[m, 0]


@compiled_subset
def correct_phase(steps: ContactSteps, runner: SweepArguments, t: float) -> int:
    """Compute coordinates and rates that meet the constraints of a mode, from its state ``own``; return a status."""
    part, settings = runner.part, runner.state.settings
    part.clock[0, 0] = t
    for m in range(settings.shape[0] - 2, settings.shape[0]):
        settings[m, 0] = _ERRORS * runner.limits[0, m]
    for m in range(runner.shape.n):
        part.states[m, 0] = steps.own[m]
    if not corrects(runner):
        return Status.PROJECTION_FAILED
    _expand(steps, runner)
    return RUNNING


@compiled_subset
def sample_end(steps: ContactSteps) -> None:
    """Take coordinates and rates at the end of a run that is over."""
    for m in range(steps.sampled.size):
        steps.sampled[m] = steps.phases.table.cases.x[0, m]
