"""Single runs with events: one lane of the loop over lanes, whose steps are recorded."""

from __future__ import annotations

import ctypes
from typing import final

import numpy as np

from ...arrays import FloatArray
from ...events.event_code import EventCode
from ...events.recorded_motion import RecordedCase
from ...lanes.cases import BlockResult, CaseColumns
from ...lanes.step_records import ENDED_AT
from ...lanes.sweep_arguments import CaseRows, KeptStarts, SweepKernels
from ...lanes.workspace import LONG_ENDS, OCCURRENCE, EventKernels
from ...methods.status import Status
from ...steps.problem import IntegrationProblem
from ...subset.arguments import OwnedAddress
from ...subset.compiled_subset import call_code
from ...subset.packing import address_of, pack
from ...threads import check, is_observed
from ...transforms.runge_kutta_parts import PROPOSAL_AT
from ..host_code import columns_at, host_code, raise_failure
from ..steppers import Stepper
from .loops import loop_named
from .sweeps import CaseArrays, SweepShape

_ROWS, _ROOM = 256, 1 << 16
"""Rows for records of steps, at most; numbers in them, at most, of a large state."""
_OBSERVED = 2
"""Rounds after which the loop first returns where its progress is shown."""


@final
class RecordedLane:
    """Memory of one run at a time with events, and the packed arguments that point to it.

    Parameters
    ----------
    kernels : SweepKernels
        For one lane.
    shape : SweepShape
    stepper : Stepper
        The step of `kernels`.
    problem : IntegrationProblem
        Has the sizes of runs, their inputs and their stops, as code.
    watch, events : EventCode, EventKernels
    carried : ndarray (n_events,) or None
        Signs of events with which a run continues, and with which it ends.

    Attributes
    ----------
    arguments : SweepArguments
        Of the loop.
    """

    def __init__(
        self,
        kernels: SweepKernels,
        shape: SweepShape,
        stepper: Stepper,
        problem: IntegrationProblem,
        watch: EventCode,
        events: EventKernels,
        carried: FloatArray | None,
    ) -> None:
        self._kernels, self._shape, self._stepper, self._events = kernels, shape, stepper, events
        self._watch, self._carried = watch, carried
        rows = min(_ROWS, max(8, _ROOM // (max(shape.n, 1) * (shape.degree + 3))))
        self._allocate(problem, rows)

    def _allocate(self, problem: IntegrationProblem, rows: int) -> None:
        """Make the arguments of the loop, with so many rows for records."""
        n, first = self._shape.n, problem.first_step
        if first is not None and self._kernels.begin != 0:
            begin = _beginning_with(self._kernels.begin, n, first)
            self._kernels = self._kernels._replace(begin=begin)
        happened, totals = BlockResult.at_start(1, len(self._watch.events), ())
        cases = CaseColumns(
            count=1,
            spans=(np.zeros(1), np.zeros(1)),
            parameters=(),
            given=(),
            start=None,
            t_eval=np.empty(0),
            rtol=problem.rtol,
            atol=problem.atol,
            max_step=problem.max_step,
            max_steps=problem.max_steps,
            first_step=first,
            watch=self._watch,
            inputs=problem.inputs,
            recorded=rows,
            carried=None if self._carried is None else self._carried[np.newaxis].copy(),
            stops=problem.stops,
            rows=CaseRows(np.zeros((1, 2)), np.zeros((1, n)), np.zeros((1, len(problem.constants))), np.empty((0, 0))),
        )
        result = BlockResult(np.zeros((1, n)), np.zeros((1, LONG_ENDS)), np.empty((1, 0, n)), happened, totals)
        arrays = CaseArrays(
            self._kernels, self._shape, self._stepper, cases, result, KeptStarts.nothing(), self._events, True
        )
        self.arguments = arrays.arguments(np.zeros(1, np.int64))
        self._packed_args = pack(self.arguments)
        self._call, self._address = loop_named(arrays.loop_name).call, ctypes.c_void_p(address_of(self._packed_args))

    def run(self, problem: IntegrationProblem) -> RecordedCase:
        """Run a problem to its end, and return what was recorded."""
        steps, occurrences, happened = self._record(problem)
        while happened != len(occurrences):  # more than there were rows for occurred in one step
            self._allocate(problem, 2 * happened)
            steps, occurrences, happened = self._record(problem)
        if self._carried is not None:
            self._carried[:] = self.arguments.workspace.carried[0]
        _, status, accepted, attempts, _ = self.arguments.ends[0].tolist()
        before, each = self._stepper.evaluations
        evaluations = int(before + each * attempts)
        if self._stepper.rows is not None:
            evaluations = self.arguments.implicit.run.progress.evaluations
        return RecordedCase(
            steps,
            occurrences,
            self.arguments.out[0].copy(),
            Status(int(status)),
            (int(accepted), int(attempts - accepted), evaluations),
            in_time=self._shape.memory == 0,
            jumping=[jump is not None for jump in self._watch.jumps],
        )

    def _record(self, problem: IntegrationProblem) -> tuple[FloatArray, FloatArray, int]:
        """Run a problem; return records of steps, those of occurrences, and how many of these there were."""
        made, given = self.arguments, self.arguments.rows
        progress, occurred = made.state.progress, made.workspace.occurrences
        given.times[0] = problem.t0, problem.t1
        given.states[0], given.constants[0] = problem.y0, problem.constants
        made.limits[0, :2] = problem.max_step, problem.max_steps
        made.happened[0, ::3], made.turn[0], occurred[0] = 0.0, 0, 0.0
        progress.paused, progress.recorded, progress.returns = 0, 0, 1
        made.implicit.run.progress.evaluations = 0
        progress.patience = _OBSERVED if is_observed() else _ROWS
        steps: list[FloatArray] = []
        found: list[FloatArray] = []
        recorded, happened, going = 0, 0, True
        while going:
            self._call(self._address)
            raise_failure()
            going = progress.paused != 0
            count, some = progress.recorded, int(occurred[0, 0])
            steps.append(made.steps[:count].copy())
            if some:
                happened += some
                found.append(occurred[1 : 1 + some].copy())
                found[-1][:, 4] += recorded
                occurred[0, 0] = 0.0
            recorded, progress.recorded = recorded + count, 0
            if going and count:
                check(float(steps[-1][-1, ENDED_AT]))
            progress.patience = min(2 * progress.patience, _ROWS)
        rows = steps[0] if len(steps) == 1 else np.concatenate(steps)
        return rows, np.concatenate(found) if found else np.empty((0, OCCURRENCE)), happened


def _beginning_with(begin: OwnedAddress, n: int, size: float) -> OwnedAddress:
    """Return what precedes the first step of a state (n_y,), with a given size of that step."""

    def run(t: int, y: int, c: int, s: int, out: int) -> int:
        call_code(begin, t, y, c, s, out)
        columns_at(out, n + PROPOSAL_AT + 1, 1)[-1] = size
        return 0

    return host_code(run)
