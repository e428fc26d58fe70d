"""Runs of many cases: arguments of the loop over lanes, and the calls of its machine code."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...integrators.arguments import address_of, pack
from ...integrators.cases import BlockResult, CaseColumns
from ...integrators.input_steps import no_inputs
from ...integrators.sample_projection import SampleArguments
from ...integrators.step_records import FIRST_AT
from ...integrators.sweep_arguments import CaseShape, Columns, SweepArguments, SweepKernels
from ...integrators.workspace import (
    OCCURRENCE,
    EventKernels,
    LaneState,
    aligned,
    event_workspace,
    lane_state,
    no_event_workspace,
)
from ...interrupts import STOPPED, check
from ..runs import CaseRun, LoopCall
from .loops import loop_named

__all__ = ["SweepShape", "case_run"]

_ROUNDS, _MOST_ROUNDS, _QUICK = 256, 1 << 24, 0.02
"""Rounds after which a loop first returns to Python, and at most; seconds below which the next may take longer."""


@final
@dataclass(frozen=True)
class SweepShape:
    """Lanes, components of the state, constants, degree and memory of a step, and how many cases are taken at a time.

    ``dense`` says whether the step writes its polynomials; it writes the series of so many ``events_with_series`` too.
    """

    lanes: int
    n: int
    n_c: int
    degree: int
    memory: int
    share: int
    dense: bool
    events_with_series: int = 0


def case_run(
    codes: tuple[int, int, int, int, int, int, int, int],
    shape: SweepShape,
    settings: Sequence[float],
    cases: CaseColumns,
    result: BlockResult,
    constants: FloatArray,
    events: EventKernels,
    watched: bool,
) -> CaseRun:
    """Return cases ready to run; see `dalembert.integrators.lane_loop`.

    Parameters
    ----------
    codes : addresses
        As the loop takes them.
    settings : sequence of float
        What the step reads behind the largest step and the direction of time.
    constants : (k, n_c) or (0, 0)
        Gets the constants.
    watched : bool
        Whether there are events or reductions, or steps are recorded.
    """
    k, n, wanted = cases.count, shape.n, len(cases.t_eval)
    kernels, (columns, held) = SweepKernels(*codes), _columns(cases)
    given, checks = len(cases.given), 2 * len(cases.start.labels)
    samples = result.samples.reshape(k, wanted * n) if wanted else np.empty((1, 1))
    projected = bool(kernels.position or kernels.velocity)
    inside = np.zeros((k, wanted) if wanted and projected else (0, 0), np.bool_)
    turn, t_eval = np.zeros(1, np.int64), np.ascontiguousarray(cases.t_eval)
    more = n + shape.events_with_series
    size = more + 2 + shape.memory
    rows = size + (more * (shape.degree + 1) if shape.dense else 0)
    loop = loop_named("event_lane_loop" if watched else "projected_lane_loop" if projected else "lane_loop")
    if cases.inputs is not None:
        loop = loop_named("input_event_lane_loop" if watched else "input_lane_loop")

    def arguments(turn: NDArray[np.int64]) -> SweepArguments:
        n_s, parameters = 2 + len(settings), len(cases.parameters)
        sizes = n, shape.degree, shape.n_c, n_s, shape.lanes
        workspace = event_workspace(events, *sizes) if watched else no_event_workspace()
        if cases.recorded:
            workspace = workspace._replace(occurrences=np.zeros((1 + cases.recorded, OCCURRENCE)))
        if cases.carried is not None:
            workspace = workspace._replace(carried=cases.carried)
        return SweepArguments(
            kernels=kernels,
            shape=CaseShape(n, more - n, shape.degree, shape.memory, parameters, given, checks, k, shape.share),
            limits=np.array([[cases.max_step, float(cases.max_steps), *settings]]),
            columns=columns,
            turn=turn,
            t_eval=t_eval,
            out=result.y,
            ends=result.ends,
            samples=samples,
            inside=inside,
            kept_constants=constants,
            state=_state(lane_state(shape.lanes, n, shape.n_c, n_s, rows, max(parameters, given), n + checks + size)),
            events=events,
            workspace=workspace,
            happened=result.happened,
            totals=result.totals,
            inputs=no_inputs() if cases.inputs is None else cases.inputs.table(shape.lanes, n + 2 + shape.memory),
            steps=np.zeros((cases.recorded, FIRST_AT + (shape.degree + 3) * n)) if cases.recorded else np.empty((0, 0)),
        )

    def call(turn: NDArray[np.int64]) -> LoopCall:
        made = arguments(turn)
        about = made.state.progress, made.steps, made.workspace.occurrences
        return LoopCall(loop.address, pack(made), *about, (held, made))

    def work() -> None:
        made, code = arguments(turn), loop.call
        packed_args, progress = pack(made), made.state.progress
        pointer = ctypes.c_void_p(address_of(packed_args))
        progress.returns, going = 1, True
        while going:  # Ctrl-C is raised here
            begin = perf_counter()
            code(pointer)
            going = progress.paused != 0 and turn[0] < STOPPED
            check()
            if going and perf_counter() - begin < _QUICK:
                progress.patience = min(2 * progress.patience, _MOST_ROUNDS)

    def finish() -> None:
        if np.any(inside):
            _project(kernels, constants, t_eval, inside, samples, shape)

    return CaseRun(work, turn, finish, call)


def _state(made: LaneState) -> LaneState:
    made.progress.patience = _ROUNDS
    return made


def _columns(cases: CaseColumns) -> tuple[Columns, tuple[FloatArray, ...]]:
    """Return address and stride of every column, and the columns."""
    columns = (*cases.spans, *cases.parameters, *cases.given)
    assert all(column.dtype == np.float64 and column.flags.c_contiguous for column in columns)
    strides = [int(len(column) > 1) for column in columns]
    return Columns(np.array([address_of(column) for column in columns]), np.array(strides)), columns


def _project(
    kernels: SweepKernels,
    constants: FloatArray,
    t_eval: FloatArray,
    inside: NDArray[np.bool_],
    samples: FloatArray,
    shape: SweepShape,
) -> None:
    lanes, n = shape.lanes, shape.n
    overwritten = aligned(1, lanes), aligned(n, lanes), np.ones((max(shape.n_c, 1), lanes)), aligned(n, lanes)
    numbers = np.zeros(lanes, np.int64), np.zeros(lanes, np.int64)
    codes = kernels.position, kernels.velocity
    loop_named("sample_projection")(SampleArguments(*codes, constants, t_eval, inside, samples, *overwritten, *numbers))
