"""Loading of cases: made ahead, as many together as there are lanes, and put into lanes one by one."""

from __future__ import annotations

from typing import NamedTuple

from ..arrays import FloatArray
from ..methods.status import Status
from .arguments import Address, IntVector
from .compiled_subset import call_code, call_test, compiled_subset, element, prefetch, row
from .workspace import ATTEMPTS, END, FIRST, NEXT, NOW, REFUSED, RUNNING, LaneState

__all__ = ["CaseShape", "Columns", "SweepKernels", "enter_lane", "load_cases"]

_SUCCESS, _NON_FINITE, _INITIAL_STATE = int(Status.SUCCESS), int(Status.NON_FINITE), int(Status.INITIAL_STATE)


class SweepKernels(NamedTuple):
    """Addresses of what the loop over lanes calls, 0 for what there is not.

    The step, what fills in its memory before the first step, the projections, constants from parameters, states from
    given values, the function that lets time move on (`dalembert.codegen.llvm.advance_lanes`), and the test of what
    cases are made from (`dalembert.codegen.llvm.check_inputs`).
    """

    step: Address
    begin: Address
    position: Address
    velocity: Address
    prepare: Address
    start: Address
    advance: Address
    check: Address


class CaseShape(NamedTuple):
    """Sizes of cases.

    Degree of the polynomials of a step; how many outputs it remembers; how many parameters, given values and checks of
    these a case has; how many cases there are, and how many a thread takes at a time. Polynomials of a step with a
    memory are in the fraction of the step, others in time.
    """

    degree: int
    memory: int
    parameters: int
    given: int
    checks: int
    cases: int
    share: int


class Columns(NamedTuple):
    """Addresses of the values of start, end, parameters and given values, and the stride from case to case: 0 or 1."""

    address: IntVector
    stride: IntVector


@compiled_subset
def _fill(columns: Columns, column: int, rows: FloatArray, wanted: int, first: int, count: int) -> None:
    """Write what `wanted` columns of values give cases to the first rows."""
    for m in range(wanted):
        address, stride = columns.address[column + m], columns.stride[column + m]
        for lane in range(rows.shape[1]):
            rows[m, lane] = element(address, stride * (first + min(lane, count - 1)))
        prefetch(address, stride * (first + 2 * rows.shape[1]))


@compiled_subset
def load_cases(
    kernels: SweepKernels,
    shape: CaseShape,
    limits: FloatArray,
    columns: Columns,
    first: int,
    count: int,
    state: LaneState,
) -> None:
    """Make constants, states and memory of `count` cases from number `first` on, as many as there are lanes at most."""
    check, lanes, n = kernels.check, state.clock.shape[1], state.delta.shape[0]
    clock, settings, given, begun = state.clock_ahead, state.settings_ahead, state.given, state.begun
    target = row(state.constants_ahead, 0)
    _fill(columns, 0, clock, 2, first, count)
    for lane in range(lanes):
        t0, t1 = clock[0, lane], clock[1, lane]
        settings[0, lane], settings[1, lane] = min(limits[0, 0], abs(t1 - t0)), 1.0 if t1 >= t0 else -1.0
    _fill(columns, 2, given, shape.parameters, first, count)
    finite = call_test(check, row(clock, 0), 2, 0, 0, 0) & call_test(check, row(given, 0), shape.parameters, 0, 0, 0)
    call_code(kernels.prepare, row(given, 0), 0, 0, 0, target)
    _fill(columns, 2 + shape.parameters, given, shape.given, first, count)
    finite &= call_test(check, target, state.constants_ahead.shape[0], 0, 0, 0)
    finite &= call_test(check, row(given, 0), shape.given, 0, 0, 0)
    call_code(kernels.start, row(clock, 0), row(given, 0), target, 0, row(begun, 0))
    fits = call_test(check, row(begun, 0), n, shape.checks, 0, 0)
    for lane in range(lanes):
        state.numbers.loaded[lane] = RUNNING if fits >> lane & 1 else _INITIAL_STATE
        if not finite >> lane & 1:
            state.numbers.loaded[lane] = _NON_FINITE
    if kernels.begin != 0:
        memory = row(begun, n + shape.checks)
        call_code(kernels.begin, row(clock, 0), row(begun, 0), target, row(settings, 0), memory)


@compiled_subset
def enter_lane(state: LaneState, lane: int, place: int, case: int, old: int, from_: int, rows: int) -> None:
    """Put a case that was loaded into a lane, with `rows` numbers of its state and memory."""
    for m in range(rows):
        state.states[old + m, lane] = state.begun[from_ + m, place]
    for m in range(state.constants.shape[0]):
        state.constants[m, lane] = state.constants_ahead[m, place]
    t0, t1 = state.clock_ahead[0, place], state.clock_ahead[1, place]
    state.clock[NOW, lane], state.clock[END, lane], state.clock[NEXT, lane] = t0, t1, t1
    state.settings[1, lane] = state.settings_ahead[1, place]
    state.tally[ATTEMPTS, lane], state.tally[REFUSED, lane], state.tally[FIRST, lane] = 0.0, 0.0, t0
    state.numbers.case[lane], state.numbers.sampled[lane] = case, 0
    state.numbers.status[lane] = _SUCCESS if t0 == t1 else RUNNING
