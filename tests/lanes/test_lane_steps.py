"""Loading, acceptance, sampling and handing in of cases in lanes, as plain Python on arrays written by hand."""

import math

import numpy as np
import pytest

from dalembert.lanes.case_loading import begin_lanes, enter_next, next_case_is_loaded, resumes, runs_on
from dalembert.lanes.lane_steps import accept_steps, next_record, project_lanes, record_part, swap_states
from dalembert.lanes.row_steps import no_row_steps
from dalembert.lanes.sweep_arguments import (
    CaseShape,
    Columns,
    KeptStarts,
    PartSamples,
    SweepArguments,
    SweepKernels,
    no_part_samples,
    no_rows,
)
from dalembert.lanes.workspace import (
    ATTEMPTS,
    BEFORE,
    END,
    IDLE,
    NEXT,
    NOW,
    REJECTIONS,
    SHORTENED,
    lane_state,
    no_event_workspace,
    no_events,
)
from dalembert.methods.status import RUNNING, Status
from dalembert.steps.projection import FAILED, NONE, PENDING
from dalembert.stops.stops import no_stops
from dalembert.subset.arguments import NO_CODE, AddressTable
from dalembert.transforms.runge_kutta_parts import GROWTH_AT, PROPOSAL_AT

N, DEGREE, MEMORY = 1, 3, 3
LANES, BUDGET, LARGEST = 2, 10.0, 2.0


def sweep(memory=0, t_eval=(), cases=2, position=0):
    """Return arguments for cases of one component whose steps have polynomials, and lanes that hold case 0 and 1."""
    size = N + 2 + memory
    state = lane_state(LANES, N, 1, 5, size + N * (DEGREE + 1), 1, N)
    times = np.array(t_eval, dtype=float)
    arguments = SweepArguments(
        kernels=SweepKernels(0, 0, position, 0, 0, 0, 0, 0),
        shape=CaseShape(N, 0, DEGREE, memory, 0, 1, 0, cases, 2),
        limits=np.array([[LARGEST, BUDGET, 1e-9, 1e-8, 1e-10]]),
        columns=Columns(AddressTable.zeros(3), np.zeros(3, np.int64)),
        turn=np.zeros(1, np.int64),
        t_eval=times,
        out=np.zeros((cases, N)),
        ends=np.zeros((cases, 3)),
        samples=np.full((cases, max(len(times), 1) * N), np.nan),
        inside=np.zeros((cases, len(times)), np.bool_),
        kept=KeptStarts.nothing(),
        state=state,
        events=no_events(),
        workspace=no_event_workspace(),
        happened=np.zeros((cases, 0)),
        totals=np.zeros((cases, 0)),
        stops=no_stops(),
        steps=np.empty((0, 0)),
        rows=no_rows(),
        part=no_part_samples(),
        implicit=no_row_steps(),
    )
    begin_lanes(arguments)
    for lane in range(LANES):
        state.numbers.case[lane], state.numbers.status[lane] = lane, RUNNING
        state.clock[NOW, lane], state.clock[END, lane], state.clock[NEXT, lane] = 1.0, 5.0, 5.0
        state.settings[1, lane] = 1.0
    state.progress.active = LANES
    return arguments


def step(arguments, lane, size, check=0.0, proposed=0.0, y=7.0, polynomial=(0.0, 0.0, 0.0, 0.0)):
    """Write what a step of a lane would have."""
    states, memory = arguments.state.states, arguments.shape.memory
    new = states.shape[0] // 2 - arguments.state.progress.old
    states[new, lane], states[new + N, lane], states[new + N + 1, lane] = y, size, check
    if memory:
        states[new + N + PROPOSAL_AT, lane] = proposed
    states[new + N + 2 + memory : new + N + 2 + memory + DEGREE + 1, lane] = polynomial


@pytest.mark.parametrize(
    ("memory", "made", "attempts", "status", "time", "mark"),
    [
        (0, {"size": 0.5}, 3.0, RUNNING, 1.5, PENDING),
        (0, {"size": 4.0}, 3.0, Status.SUCCESS, 5.0, PENDING),
        (0, {"size": 0.5}, 9.0, Status.MAX_STEPS, 1.5, PENDING),
        (0, {"size": 4.0}, 9.0, Status.SUCCESS, 5.0, PENDING),
        (0, {"size": 0.5, "check": math.nan}, 3.0, Status.NON_FINITE, 1.0, NONE),
        (0, {"size": 1e-17}, 3.0, Status.STEP_TOO_SMALL, 1.0, NONE),
        (MEMORY, {"size": 0.5}, 3.0, RUNNING, 1.5, PENDING),
        (MEMORY, {"size": 0.0, "proposed": 0.1}, 3.0, RUNNING, 1.0, NONE),
        (MEMORY, {"size": 0.0, "proposed": 0.1}, 9.0, Status.MAX_STEPS, 1.0, NONE),
        (MEMORY, {"size": 0.0, "proposed": 1e-17}, 3.0, Status.STEP_TOO_SMALL, 1.0, NONE),
        (MEMORY, {"size": 0.0, "proposed": 1e-17, "check": 1.0}, 9.0, Status.NON_FINITE, 1.0, NONE),
    ],
)
def test_a_step_is_accepted_or_rejected(memory, made, attempts, status, time, mark):
    arguments = sweep(memory)
    state = arguments.state
    state.tally[ATTEMPTS] = attempts
    state.states[state.progress.old] = 2.0
    step(arguments, 0, 0.25)
    step(arguments, 1, **made)
    accept_steps(arguments)
    assert (state.numbers.status[1], state.clock[NOW, 1], state.numbers.mark[1]) == (status, time, mark)
    assert state.tally[ATTEMPTS, 1] == attempts + 1.0
    assert state.tally[REJECTIONS, 1] == (mark == NONE)
    stuck = mark == NONE and status not in (RUNNING, Status.MAX_STEPS)
    swap_states(arguments)
    assert state.states[state.progress.old, 1] == (2.0 if stuck else 7.0)
    assert (state.clock[NOW, 0], state.tally[BEFORE, 0]) == (1.25, 1.0)  # the other lane is its own


def test_only_lanes_that_are_looked_at_are_accepted():
    arguments = sweep()
    arguments.state.progress.look = 0b10
    step(arguments, 0, 0.5)
    step(arguments, 1, 0.5)
    accept_steps(arguments)
    assert list(arguments.state.clock[NOW]) == [1.0, 1.5]


@pytest.mark.parametrize("memory", [0, MEMORY])
def test_times_inside_a_step_are_sampled_and_its_end_is_not(memory):
    arguments = sweep(memory, t_eval=[1.25, 1.5, 1.5, 2.0])
    step(arguments, 1, 0.5, polynomial=(1.0, 2.0, 0.0, 8.0))
    accept_steps(arguments)
    x = 0.5 if memory else 0.25  # of the step, or in time
    assert arguments.samples[1, 0] == 1.0 + 2.0 * x + 8.0 * x**3
    assert list(arguments.inside[1]) == [True, False, False, False]
    swap_states(arguments)
    assert resumes(arguments, 1)
    assert list(arguments.samples[1, 1:3]) == [7.0, 7.0] and np.isnan(arguments.samples[1, 3])
    assert arguments.state.clock[NEXT, 1] == 2.0
    assert not runs_on(arguments, 1)  # there is more to record


@pytest.mark.parametrize("memory", [0, MEMORY])
def test_samples_of_parts_up_to_where_a_step_is_cut(memory, monkeypatch):
    """Each case from its own next sample on, as variables, here twice the state; its motion has a row each time."""
    samples = PartSamples(
        times=np.array([1.25, 1.375, 1.5, 2.0]),
        motion=np.array([1, 0]),
        next=np.array([1, 0]),
        x=np.full((8, 1), np.nan),
        expand=NO_CODE,
        clock=np.zeros((1, LANES)),
        states=np.zeros((N, LANES)),
        posed=np.zeros((1, LANES)),
    )

    def expand(code, clock, states, constants, settings, out):
        samples.posed[:] = 2.0 * samples.states

    monkeypatch.setattr("dalembert.lanes.lane_steps.call_code", expand)
    arguments = sweep(memory)._replace(part=samples)
    for lane in range(LANES):
        step(arguments, lane, 0.5, polynomial=(1.0, 2.0, 0.0, 8.0))
    accept_steps(arguments)
    swap_states(arguments)
    arguments.state.clock[NOW, 0] = 1.375  # cut, there
    record_part(arguments)
    values = [2.0 * (1.0 + 2.0 * x + 8.0 * x**3) for x in ((0.5, 0.75) if memory else (0.25, 0.375))]
    np.testing.assert_array_equal(samples.x[:, 0], [*values, *[np.nan] * 6])
    assert list(samples.next) == [1, 2]
    assert [next_record(arguments, lane) for lane in range(LANES)] == [1.375, 1.5]
    arguments.state.clock[END, 1], samples.next[0] = 1.25, 4
    assert [next_record(arguments, lane) for lane in range(LANES)] == [5.0, 1.25]


def test_a_case_that_has_ended_is_handed_in_with_its_accepted_steps():
    arguments = sweep()
    state = arguments.state
    state.tally[ATTEMPTS, 1], state.tally[REJECTIONS, 1], state.clock[NOW, 1] = 9.0, 2.0, 3.0
    state.states[state.progress.old, 1], state.numbers.status[1] = 4.0, Status.MAX_STEPS
    assert runs_on(arguments, 0) and not runs_on(arguments, 1)
    assert resumes(arguments, 0) and not resumes(arguments, 1)
    assert arguments.out[1, 0] == 4.0
    assert list(arguments.ends[1]) == [3.0, Status.MAX_STEPS, 7.0]
    assert (state.numbers.case[1], state.numbers.status[1], state.progress.active) == (-1, IDLE, 1)
    assert list(state.settings[0]) == [LARGEST, 0.0]
    assert not resumes(arguments, 1) and not runs_on(arguments, 1)
    assert state.progress.active == 1


@pytest.mark.parametrize("status", [RUNNING, Status.INITIAL_STATE])
def test_a_loaded_case_enters_or_is_refused(status):
    arguments = sweep()
    state, progress = arguments.state, arguments.state.progress
    progress.filled, progress.place, progress.loaded = 1, 0, 1
    state.numbers.loaded[0] = status
    state.clock_ahead[:, 0], state.begun[0, 0], state.settings_ahead[1, 0] = (2.0, -2.0), 3.0, -1.0
    state.numbers.status[0], state.numbers.case[0], progress.active = IDLE, -1, 1
    assert next_case_is_loaded(arguments)
    assert enter_next(arguments, 0) == (status == RUNNING)
    if status == RUNNING:
        assert (state.numbers.case[0], state.states[progress.old, 0], progress.active) == (1, 3.0, 2)
        assert list(state.clock[:, 0]) == [2.0, -2.0, -2.0] and state.settings[1, 0] == -1.0
        assert runs_on(arguments, 0) and state.settings[0, 0] == LARGEST
    else:
        assert np.isnan(arguments.out[1, 0]) and list(arguments.ends[1]) == [2.0, status, 0.0]
        assert (state.numbers.case[0], progress.active) == (-1, 1)


def test_the_step_after_a_failed_projection_is_a_shorter_one():
    arguments = sweep()
    state = arguments.state
    state.tally[SHORTENED, 0] = 0.25 * LARGEST
    assert runs_on(arguments, 0) and state.settings[0, 0] == 0.25 * LARGEST
    assert runs_on(arguments, 0) and state.settings[0, 0] == LARGEST


def test_no_case_is_left_after_the_last():
    arguments = sweep(cases=2)
    arguments.turn[0] = 2  # other threads took them
    assert not next_case_is_loaded(arguments)


@pytest.mark.parametrize(
    ("memory", "attempts", "status"),
    [(0, 3.0, RUNNING), (0, 9.0, Status.MAX_STEPS), (MEMORY, 3.0, RUNNING), (MEMORY, 9.0, Status.MAX_STEPS)],
)
def test_a_step_whose_end_cannot_be_projected_is_undone(monkeypatch, memory, attempts, status):
    arguments = sweep(memory, t_eval=[1.25], position=1)
    state = arguments.state
    state.tally[ATTEMPTS], state.states[state.progress.old] = attempts, 2.0
    step(arguments, 0, 0.5)
    step(arguments, 1, 0.5)

    def correct(position, velocity, clock, states, first, earlier, before, constants, delta, mark, rtol, atol):
        assert (earlier[before, 1], states[first, 1], rtol, atol) == (2.0, 7.0, 1e-8, 1e-10)
        mark[1] = FAILED

    monkeypatch.setattr("dalembert.lanes.lane_steps.correct", correct)
    accept_steps(arguments)
    assert state.numbers.sampled[1] == 1
    swap_states(arguments)
    project_lanes(arguments)
    old = state.progress.old
    assert (state.clock[NOW, 1], state.states[old, 1], state.numbers.sampled[1]) == (1.0, 2.0, 0)
    assert (state.numbers.status[1], state.tally[REJECTIONS, 1]) == (status, 1.0)
    assert (state.clock[NOW, 0], state.states[old, 0]) == (1.5, 7.0)
    if memory:
        assert state.states[old + N + PROPOSAL_AT, 1] == pytest.approx(0.05)
        assert state.states[old + N + GROWTH_AT, 1] == 1.0
    else:
        assert state.tally[SHORTENED, 1] == pytest.approx(0.05)
