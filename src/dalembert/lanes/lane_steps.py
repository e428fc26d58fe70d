"""One step of all lanes: taken together, then accepted or rejected lane by lane, sampled and projected."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..methods.status import RUNNING, Status
from ..steps.projection import FAILED, NONE, PENDING, correct
from ..steps.step_control import ACCEPTED, REJECTED, attempt_test, blind_retry, end_of_step, status_after
from ..subset.compiled_subset import call_code, call_test, compiled_subset, fma, lowest, row
from ..transforms.runge_kutta_parts import GROWTH_AT, PROPOSAL_AT
from .step_records import drop_compensation
from .sweep_arguments import SweepArguments
from .workspace import ATTEMPTS, BEFORE, END, NOW, REJECTIONS, SHORTENED


@compiled_subset
def take_step(arguments: SweepArguments) -> None:
    """Take a step in every lane, or attempt one: from one half of the states to the other."""
    state, old = arguments.state, arguments.state.progress.old
    new = state.states.shape[0] // 2 - old
    settings, constants = row(state.settings, 0), row(state.constants, 0)
    call_code(
        arguments.kernels.step, row(state.clock, 0), row(state.states, old), constants, settings, row(state.states, new)
    )


@compiled_subset
def swap_states(arguments: SweepArguments) -> None:
    """Make the ends of the steps the states that the next begin from."""
    state = arguments.state
    state.progress.old = state.states.shape[0] // 2 - state.progress.old


@compiled_subset
def advance_together(arguments: SweepArguments) -> int:
    """Accept the steps of all lanes in which nothing else happens; return the other lanes, as bits."""
    state, shape = arguments.state, arguments.shape
    new = state.states.shape[0] // 2 - state.progress.old
    size, tally, settings = (
        row(state.states, new + shape.n + shape.events_with_series),
        row(state.tally, 0),
        row(state.settings, 0),
    )
    return call_test(arguments.kernels.advance, row(state.clock, 0), size, tally, settings, row(arguments.limits, 0))


@compiled_subset
def accept_steps(arguments: SweepArguments) -> None:
    """Accept or reject the steps of the lanes that are looked at; mark accepted steps for projection."""
    numbers, left = arguments.state.numbers, arguments.state.progress.look
    while left != 0:
        lane = lowest(left)
        left &= left - 1
        numbers.mark[lane] = NONE
        if numbers.status[lane] == RUNNING:
            _accept(arguments, lane)


@compiled_subset
def _accept(arguments: SweepArguments, lane: int) -> None:
    """Accept or reject the step of a lane."""
    state, shape, states = arguments.state, arguments.shape, arguments.state.states
    numbers, old, n = state.numbers, state.progress.old, shape.n
    new = states.shape[0] // 2 - old
    now, size_at = state.clock[NOW, lane], new + n + shape.events_with_series
    size, rest, proposed = states[size_at, lane], abs(state.clock[END, lane] - now), 0.0
    if shape.memory > 0:
        proposed = states[size_at + PROPOSAL_AT, lane]
    failed = states[size_at + 1, lane]
    outcome = attempt_test(size, failed != 0.0, proposed, shape.memory > 0, now, rest)
    if outcome == Status.NON_FINITE and failed == Status.PROJECTION_FAILED:
        outcome = Status.PROJECTION_FAILED
    state.tally[ATTEMPTS, lane] += 1.0
    if outcome == ACCEPTED:
        t = end_of_step(now, state.clock[END, lane], state.settings[1, lane], size, rest)
        _sample(arguments, lane, t)
        state.tally[BEFORE, lane], state.clock[NOW, lane], numbers.mark[lane] = now, t, PENDING
        numbers.status[lane] = status_after(size == rest, state.tally[ATTEMPTS, lane], arguments.limits[0, 1])
        return
    state.tally[REJECTIONS, lane] += 1.0
    if outcome == REJECTED:
        numbers.status[lane] = status_after(False, state.tally[ATTEMPTS, lane], arguments.limits[0, 1])
        return
    numbers.status[lane] = outcome
    for m in range(n):
        states[new + m, lane] = states[old + m, lane]


@compiled_subset
def _sample(arguments: SweepArguments, lane: int, t: float) -> None:
    """Record what lies inside the step of a lane up to a time, by the polynomials of the step."""
    state, shape, t_eval = arguments.state, arguments.shape, arguments.t_eval
    states, numbers, n = state.states, state.numbers, shape.n
    now, direction = state.clock[NOW, lane], state.settings[1, lane]
    new = states.shape[0] // 2 - state.progress.old
    size_at = new + n + shape.events_with_series
    sampled = numbers.sampled_before[lane] = numbers.sampled[lane]
    unit, count = 1.0, 1
    if shape.memory > 0:
        unit = direction * states[size_at, lane]
    while count > 0:
        count, left = 0, t_eval.size - sampled
        while count < _AT_ONCE and count < left and (t_eval[sampled + count] - t) * direction < 0.0:
            count += 1
        if count >= _SEVERAL:
            _take_samples(arguments, size_at, lane, sampled, count, now, unit)
        for i in range(sampled, sampled + count):
            if count < _SEVERAL:
                x = t_eval[i] - now
                if shape.memory > 0:
                    x /= unit
                for m in range(n):
                    arguments.samples[numbers.case[lane], i * n + m] = _inside(arguments, size_at, lane, m, x)
            if arguments.inside.size > 0:
                arguments.inside[numbers.case[lane], i] = True
        sampled += count
    numbers.sampled[lane] = sampled


_SEVERAL, _AT_ONCE = 3, 4
"""Samples in a step from which on they are interpolated together, because sums of a polynomial wait for each other, and
the most of them."""


@compiled_subset
def _take_samples(
    arguments: SweepArguments, size_at: int, lane: int, first: int, count: int, now: float, unit: float
) -> None:
    """Record samples in a row, at most `_AT_ONCE`, by the polynomials of the step of a lane.

    The step begins at `now`, and time counts in a `unit`.
    """
    t_eval, states, samples, n = arguments.t_eval, arguments.state.states, arguments.samples, arguments.shape.n
    last, terms, case = first + count - 1, arguments.shape.degree + 1, arguments.state.numbers.case[lane]
    w, x = (t_eval[first] - now) / unit, (t_eval[first + 1] - now) / unit
    y, z = (t_eval[first + 2] - now) / unit, (t_eval[last] - now) / unit
    for m in range(n):
        a = b = c = d = 0.0
        for k in range(terms - 1, -1, -1):
            term = states[size_at + 2 + arguments.shape.memory + m * terms + k, lane]
            a, b, c, d = fma(a, w, term), fma(b, x, term), fma(c, y, term), fma(d, z, term)
        place = first * n + m
        samples[case, place], samples[case, place + n], samples[case, place + 2 * n] = a, b, c
        if count > 3:
            samples[case, place + 3 * n] = d


@compiled_subset
def _inside(arguments: SweepArguments, size_at: int, lane: int, m: int, x: float) -> float:
    """Return a component of the state of a lane inside its step, whose size is in a row, by its polynomial of x."""
    first, value = size_at + 2 + arguments.shape.memory + m * (arguments.shape.degree + 1), 0.0
    for k in range(arguments.shape.degree, -1, -1):
        value = fma(value, x, arguments.state.states[first + k, lane])
    return value


@compiled_subset
def next_record(arguments: SweepArguments, lane: int) -> float:
    """Return the time to which the steps of a lane need not be looked at: its next sample, or the end of its steps."""
    part, state, case = arguments.part, arguments.state, arguments.state.numbers.case[lane]
    end = state.clock[END, lane]
    if part.times.size == 0 or case < 0 or part.next[case] == part.times.size:
        return end
    time = part.times[part.next[case]]
    return time if (time - end) * state.settings[1, lane] < 0.0 else end


@compiled_subset
def record_part(arguments: SweepArguments) -> None:
    """Record the samples of `PartSamples` inside the steps that were accepted, up to where events cut these."""
    part, state, kernels = arguments.part, arguments.state, arguments.kernels
    if part.times.size == 0:
        return
    clock, states, lone = row(part.clock, 0), row(part.states, 0), state.numbers.lone
    tolerances, own = state.settings.shape[0] - 2, part.states
    rtol, atol = state.settings[tolerances, 0], state.settings[tolerances + 1, 0]
    position, velocity = kernels.position, kernels.velocity
    while _interpolate_part(arguments):
        correct(position, velocity, part.clock, own, 0, own, 0, state.constants, state.delta, lone, rtol, atol)
        for lane in range(state.clock.shape[1]):
            if lone[lane] == FAILED:  # it stays as it is
                interpolate(arguments, lane, part.clock[0, lane])
        call_code(part.expand, clock, states, row(state.constants, 0), 0, row(part.posed, 0))
        for lane in range(state.clock.shape[1]):
            if lone[lane] != NONE:
                case = state.numbers.case[lane]
                place = part.motion[case] * part.times.size + part.next[case]
                for m in range(part.x.shape[1]):
                    part.x[place, m] = part.posed[m, lane]
                part.next[case] += 1


@compiled_subset
def _interpolate_part(arguments: SweepArguments) -> bool:
    """Compute the states of lanes at their next samples, where these are inside their steps; return whether any is."""
    part, state, numbers, some = arguments.part, arguments.state, arguments.state.numbers, False
    for lane in range(state.clock.shape[1]):
        numbers.lone[lane], case = NONE, numbers.case[lane]
        if numbers.mark[lane] != PENDING or part.next[case] == part.times.size:
            continue
        if (part.times[part.next[case]] - state.clock[NOW, lane]) * state.settings[1, lane] < 0.0:
            numbers.lone[lane], some = PENDING, True
            part.clock[0, lane] = part.times[part.next[case]]
            interpolate(arguments, lane, part.clock[0, lane])
    return some


@compiled_subset
def interpolate(arguments: SweepArguments, lane: int, time: float) -> None:
    """Compute the state of a lane at a time within its step."""
    part, state, shape = arguments.part, arguments.state, arguments.shape
    size_at = state.progress.old + shape.n + shape.events_with_series
    x = time - state.tally[BEFORE, lane]
    if shape.memory > 0:
        x /= state.settings[1, lane] * state.states[size_at, lane]
    for m in range(shape.n):
        part.states[m, lane] = _inside(arguments, size_at, lane, m, x)


@compiled_subset
def project_lanes(arguments: SweepArguments) -> None:
    """Project the ends of the steps that were accepted, where there are projections; undo steps where that fails."""
    kernels, state = arguments.kernels, arguments.state
    if kernels.position == 0 and kernels.velocity == 0:
        return
    project_marked(arguments, state.numbers.mark)
    for lane in range(state.clock.shape[1]):
        if state.numbers.mark[lane] == FAILED:
            _undo(arguments, lane)


@compiled_subset
def project_marked(arguments: SweepArguments, mark: NDArray[np.int64]) -> None:
    """Project the lanes that are `PENDING` in ``mark`` (lanes,), which becomes `FAILED` where that fails."""
    kernels, state = arguments.kernels, arguments.state
    states, old, tolerances = state.states, state.progress.old, state.settings.shape[0] - 2
    correct(
        kernels.position,
        kernels.velocity,
        state.clock,
        states,
        old,
        states,
        states.shape[0] // 2 - old,
        state.constants,
        state.delta,
        mark,
        state.settings[tolerances, 0],
        state.settings[tolerances + 1, 0],
    )


@compiled_subset
def _undo(arguments: SweepArguments, lane: int) -> None:
    """Return a lane to the state before its step, for an attempt of a smaller one where the step can be rejected."""
    state, shape, states = arguments.state, arguments.shape, arguments.state.states
    old = state.progress.old
    before, new = state.tally[BEFORE, lane], states.shape[0] // 2 - old
    size_at = old + shape.n + shape.events_with_series
    size, rest = abs(state.clock[NOW, lane] - before), abs(state.clock[END, lane] - before)
    for m in range(shape.n + shape.events_with_series + 2 + shape.memory):
        states[old + m, lane] = states[new + m, lane]
    state.clock[NOW, lane], state.numbers.sampled[lane] = before, state.numbers.sampled_before[lane]
    state.tally[REJECTIONS, lane] += 1.0
    smaller = blind_retry(size, before, rest)
    if smaller == 0.0:
        state.numbers.status[lane] = Status.PROJECTION_FAILED
        return
    state.numbers.status[lane] = status_after(False, state.tally[ATTEMPTS, lane], arguments.limits[0, 1])
    if shape.memory > 0:
        states[size_at + PROPOSAL_AT, lane], states[size_at + GROWTH_AT, lane] = smaller, 1.0
    else:
        state.tally[SHORTENED, lane] = smaller
        drop_compensation(arguments, lane)
