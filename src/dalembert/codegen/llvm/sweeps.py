"""Runs of many cases: arguments of the loop over lanes, and the calls of its machine code."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from time import perf_counter
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ...arrays import aligned
from ...frozen import frozen
from ...lanes.cases import BlockResult, CaseColumns
from ...lanes.row_steps import RowSteps, no_row_steps
from ...lanes.step_records import FIRST_AT
from ...lanes.sweep_arguments import (
    CaseShape,
    Columns,
    KeptStarts,
    SweepArguments,
    SweepKernels,
    no_part_samples,
    no_rows,
)
from ...lanes.workspace import (
    OCCURRENCE,
    EventKernels,
    EventWorkspace,
    LaneState,
    LoopProgress,
    event_workspace,
    lane_state,
    no_event_workspace,
)
from ...steps.row_loops import SampleArguments
from ...stops.stops import StopTable, no_stops
from ...subset.arguments import AddressTable
from ...subset.packing import owned_address, pack
from ...threads import STOPPED, check
from ..host_code import raise_failure
from ..runs import LoopCall
from ..steppers import Stepper
from .loops import Loop, loop_named

_FIRST_ROUNDS, _ROUNDS, _MOST_ROUNDS, _QUICK = 32, 256, 1 << 24, 0.02
"""Rounds after which a loop that others may join first returns to Python, any loop, and at most; seconds below which
the next may take longer."""


@final
@frozen
class SweepShape:
    """Sizes of a step in lanes.

    Attributes
    ----------
    lanes : int
        Cases that run side by side.
    n, n_c : int
        Number of components of the state, and of constants.
    degree, memory : int
        Degree of the polynomials of a step, and how many numbers it remembers.
    dense : bool
        Whether the step writes its polynomials.
    events_with_series : int
        Number of events whose series the step writes too.
    """

    lanes: int
    n: int
    n_c: int
    degree: int
    memory: int
    dense: bool
    events_with_series: int = 0


_PATIENCE, _RETURNS, _COMMON = map(LoopProgress.kind.names.index, ("patience", "returns", "common"))


def begin_progress(progress: LoopProgress, *, common: bool) -> None:
    """Set the progress of a loop that begins, and returns to Python every so often; see `LoopProgress` for `common`."""
    words = progress.words
    words[:] = 0
    words[_PATIENCE], words[_RETURNS], words[_COMMON] = _FIRST_ROUNDS, 1, common


def run_loop(
    code: Callable[[ctypes.c_void_p], int],
    pointer: ctypes.c_void_p,
    progress: LoopProgress,
    turn: NDArray[np.int64],
    paused: Callable[[], bool] | None,
) -> bool:
    """Call a loop until no case is left; return whether none is, so that it was not stopped.

    `paused` is called when it returns to Python before that, until `paused` returns that this was the last time.
    """
    going = True
    while going:  # Ctrl-C is raised here
        begin = perf_counter()
        code(pointer)
        raise_failure()
        going = progress.paused != 0 and turn[0] < STOPPED
        check()
        if going and paused is not None and paused():
            paused = None
        if going and perf_counter() - begin < _QUICK:
            progress.patience = min(2 * progress.patience, _MOST_ROUNDS)
    return progress.paused == 0


@final
class CaseArrays:
    """Arrays that the threads of one run share, and the arguments of the loop in each thread."""

    def __init__(
        self,
        kernels: SweepKernels,
        shape: SweepShape,
        stepper: Stepper,
        cases: CaseColumns,
        result: BlockResult,
        kept: KeptStarts,
        events: EventKernels,
        watched: bool,
        share: int = 1,
    ) -> None:
        self.kernels, self.shape, self.stepper, self.cases = kernels, shape, stepper, cases
        self.result, self.kept, self.events, self.watched = result, kept, events, watched
        self.share = share
        self.samples, self.inside, self.t_eval = _NOTHING, _NO_FLAGS, cases.t_eval
        n_times = len(cases.t_eval)
        if n_times:
            self.samples = result.samples.reshape(cases.count, n_times * shape.n)
            self.t_eval = np.ascontiguousarray(cases.t_eval)
            if self.projected:
                self.inside = np.zeros((cases.count, n_times), np.bool_)

    @property
    def projected(self) -> bool:
        """Whether states are projected onto constraints."""
        return bool(self.kernels.position or self.kernels.velocity)

    @property
    def loop_name(self) -> str:
        """Name of the loop that serves these cases."""
        if self.stepper.rows is not None:
            return "implicit_lane_loop"
        if self.cases.inputs is not None:
            return "stop_event_lane_loop" if self.watched else "stop_lane_loop"
        if self.watched:
            return "event_lane_loop"
        return "projected_lane_loop" if self.projected else "lane_loop"

    @property
    def loop(self) -> Loop:
        """The loop that serves these cases."""
        return loop_named(self.loop_name, 1 if self.stepper.rows is None else self.shape.lanes)

    @property
    def results(self) -> tuple[tuple[NDArray[Any], ...], tuple[NDArray[Any], ...]]:
        """What the loop reads and writes of all cases, in the order of its arguments: before and behind its memory."""
        result, kept = self.result, self.kept
        before = self.t_eval, result.y, result.ends, self.samples, self.inside, kept.constants, kept.states
        return before, (result.happened, result.totals)

    def call(self, turn: NDArray[np.int64]) -> LoopCall:
        """Return a call of the loop in one thread, for loops that do so themselves."""
        made = self.arguments(turn)
        about = made.state.progress, made.steps, made.workspace.occurrences
        return LoopCall(self.loop.entry, pack(made), *about, (self, made))

    def arguments(self, turn: NDArray[np.int64]) -> SweepArguments:
        """Return the arguments of the loop in one thread; `turn` counts the cases that all threads have taken."""
        shape, cases, n = self.shape, self.cases, self.shape.n
        checks = 0 if cases.start is None else 2 * len(cases.start.labels)
        given, parameters = len(cases.given), len(cases.parameters)
        more, n_s = n + shape.events_with_series, 2 + len(self.stepper.settings)
        size = more + 2 + shape.memory
        rows = size + (more * (shape.degree + 1) if shape.dense else 0)
        steps = np.zeros((cases.recorded, FIRST_AT + (shape.degree + 3) * n)) if cases.recorded else np.empty((0, 0))
        state = _state(lane_state(shape.lanes, n, shape.n_c, n_s, rows, max(parameters, given), n + checks + size))
        return SweepArguments(
            kernels=self.kernels,
            shape=CaseShape(
                n, more - n, shape.degree, shape.memory, parameters, given, checks, cases.count, self.share
            ),
            limits=np.array([[cases.max_step, float(cases.max_steps), *self.stepper.settings]]),
            columns=_columns(self.cases),
            turn=turn,
            t_eval=self.t_eval,
            out=self.result.y,
            ends=self.result.ends,
            samples=self.samples,
            inside=self.inside,
            kept=self.kept,
            state=state,
            events=self.events,
            workspace=self._workspace(n_s),
            happened=self.result.happened,
            totals=self.result.totals,
            stops=self.stops(),
            steps=steps,
            rows=cases.rows or no_rows(),
            part=cases.part or no_part_samples(),
            implicit=self._implicit(state),
        )

    def _implicit(self, state: LaneState) -> RowSteps:
        """Return the memory of steps that are not compiled."""
        cases, stepper = self.cases, self.stepper
        if stepper.rows is None:
            return no_row_steps()
        first = cases.first_step or 0.0
        return stepper.rows.memory(state.constants, stepper.settings, stepper.allowed, cases.max_step, first)

    def stops(self) -> StopTable:
        """Return the stops of the cases, knots of inputs among them."""
        cases, shape = self.cases, self.shape
        if cases.inputs is None:
            return no_stops()
        inputs = cases.inputs.table(shape.lanes, shape.n + 2 + shape.memory)
        return no_stops(inputs) if cases.stops is None else cases.stops.table(inputs, shape.lanes, shape.n_c)

    def _workspace(self, n_s: int) -> EventWorkspace:
        """Return the workspace of events; `n_s` is the number of settings of the step."""
        if not self.watched:
            workspace = no_event_workspace()
        else:
            shape = self.shape
            workspace = event_workspace(self.events, shape.n, shape.degree, shape.n_c, n_s, shape.lanes)
        if self.cases.recorded:
            workspace = workspace._replace(occurrences=np.zeros((1 + self.cases.recorded, OCCURRENCE)))
        if self.cases.recorded and self.cases.rows is not None and self.shape.memory == 0:
            workspace = workspace._replace(low=np.zeros((self.shape.n + 1, self.shape.lanes)))
        return workspace if self.cases.carried is None else workspace._replace(carried=self.cases.carried)

    def project_samples(self) -> None:
        """Project the samples that lie within steps onto the constraints."""
        if self.inside.size == 0 or not self.inside.any():
            return
        shape, lanes, n = self.shape, self.shape.lanes, self.shape.n
        overwritten = aligned(1, lanes), aligned(n, lanes), np.ones((max(shape.n_c, 1), lanes)), aligned(n, lanes)
        numbers = np.zeros(lanes, np.int64), np.zeros(lanes, np.int64)
        codes = self.kernels.position, self.kernels.velocity
        constants, along = self.kept.constants, self.cases.constants_at
        if along is not None:
            constants = along(np.broadcast_to(self.t_eval, self.inside.shape))
        loop = loop_named("sample_projection")
        cases, tolerances = self.samples, (self.cases.rtol, self.cases.atol)
        loop(SampleArguments(*codes, constants, self.t_eval, self.inside, cases, *overwritten, *numbers, *tolerances))


_NOTHING, _NO_FLAGS = np.empty((0, 0)), np.empty((0, 0), np.bool_)


def _state(made: LaneState) -> LaneState:
    made.progress.patience = _ROUNDS
    return made


def _columns(cases: CaseColumns) -> Columns:
    """Return address and stride of every column."""
    given = (*cases.spans, *cases.parameters, *cases.given)
    columns = [np.array((column,)) if isinstance(column, float) else column for column in given]
    assert all(column.dtype == np.float64 and column.flags.c_contiguous for column in columns)
    strides = [int(len(column) > 1) for column in columns]
    return Columns(AddressTable(map(owned_address, columns)), np.array(strides))
