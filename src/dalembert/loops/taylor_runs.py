"""Taylor method for one trajectory: blocks of steps, whose series are kept or sampled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from typing import Protocol, final

import numpy as np

from ..arrays import FloatArray
from ..frozen import frozen
from ..methods.status import RUNNING, Status
from ..methods.step_constants import FIRST_BLOCK, LARGEST_BLOCK
from ..steps.problem import IntegrationProblem, Solution
from ..stops.stops import no_stops, table_of
from ..subset.arguments import NO_CODE, OwnedAddress, place_of
from ..subset.compiled_subset import compiled_subset
from ..subset.packing import address_of, pack, replace_array
from ..threads import check
from ..transforms.taylor.step import scale_floor
from .prepared_loop import PreparedArguments, PreparedKernels, PreparedLimits, PreparedProgress
from .taylor_records import TURN, RunRecord

LARGEST_WINDING = 256
"""Steps after which angles lose the turns that they have made: a large angle has fewer digits to turn by."""

_FEWEST_TURNS, _MOST_TURNS = 2.0, 4.0
"""Turns that large angles keep: from that size, the step (`dalembert.transforms.taylor.step`) does not mind them."""

_LARGEST_ANGLE = 1e15
"""Angle that is left alone: it has no digits to turn by."""

_TURN_HIGH = float.fromhex("0x1.921fb54p+2")
"""A turn to 29 bits, of which multiples are exact."""

_TURN_LOW = float.fromhex("0x1.10b4611a62633p-28")
"""The rest of a turn."""

_LARGEST_KEPT = 1 << 20
"""Bytes of the largest workspace that is kept for later runs."""

_LIMITS_AT = place_of(PreparedArguments, "limits")
_T0_AT, _T1_AT, _LARGEST_AT = (_LIMITS_AT + PreparedLimits._fields.index(name) for name in ("t0", "t1", "largest"))
_ATTEMPTS_AT, _GOING_AT = (_LIMITS_AT + PreparedLimits._fields.index(name) for name in ("attempts", "going"))
_PREPARE_AT, _STATES_AT, _TIMES_AT, _STOPS_AT = (
    place_of(PreparedArguments, name) for name in ("kernels.prepare", "states", "times", "stops")
)

Watch = Callable[[float, FloatArray, float], bool]
"""Time, state and mean size of the last steps -> whether to stop there."""

_STIFFNESS_FROM, _STIFFNESS_REST = 900, 4000
"""Steps after which a run is tested for stiffness, and steps that must be left for a change of method to pay."""


class TaylorLoop(Protocol):
    """The recorded loop of `dalembert.loops.prepared_loop`, loaded."""

    @property
    def call(self) -> Callable[[int], int]:
        """The function of the address of packed arguments."""
        ...


@final
@frozen
class StepCode:
    """Compiled code: the recorded loop of `dalembert.loops.prepared_loop`, and addresses of what it calls.

    The step is a Taylor step of some order that also writes its series; the projections are 0 where there are none.
    ``angles`` are the components of the state that matter modulo a turn. The step is ``weighted`` where each component
    has an absolute tolerance of its own. ``workspaces`` are those that no run uses.
    """

    loop: TaylorLoop
    order: int
    step: OwnedAddress
    position: OwnedAddress = NO_CODE
    velocity: OwnedAddress = NO_CODE
    angles: tuple[int, ...] = ()
    weighted: bool = False
    workspaces: list[_Workspace] = field(default_factory=list, compare=False, repr=False)

    def integrate(self, problem: IntegrationProblem, watch: Watch | None = None) -> Solution | None:
        """Integrate a problem with this step.

        Parameters
        ----------
        problem
            The problem; its arrays are copied.
        watch
            Called between blocks of steps of long runs; returns whether to stop.

        Returns
        -------
        Solution
            Numerical failure is its status, never an exception. Each step is one evaluation of the series. None
            where the run was stopped.
        """
        stops = problem.stops
        try:
            work = self.workspaces.pop()
        except IndexError:
            work = _Workspace(self, problem)
        call, record = self.loop.call, RunRecord(problem, self.order)
        # what happens at stops reads angles, and not modulo a turn
        turns, angles = None, [] if stops is not None and stops.actions else list(self.angles)
        status, size = RUNNING if work.begin(problem) else int(Status.NON_FINITE), FIRST_BLOCK
        while status == RUNNING:
            check(record.end)
            start, before = record.end, record.steps
            if angles and work.has_turned(angles):
                turns = np.zeros(len(problem.y0)) if turns is None else turns.copy()
                turns[angles] += _unwound(work.y, work.low, angles)
                record.wound = record.wound or bool(np.any(turns))
            status, times, rows = work.run(call, min(size, problem.max_steps - record.steps))
            if stops is not None:
                stops.raise_failure()
                if before == 0:
                    record.start = work.started
            record.add(times, rows, turns if record.wound else None)
            size = min(2 * size, LARGEST_WINDING if angles else LARGEST_BLOCK)
            if watch is not None and status == RUNNING and record.steps >= _STIFFNESS_FROM:
                step = abs(record.end - start) / (record.steps - before)
                if abs(problem.t1 - record.end) >= _STIFFNESS_REST * step and watch(record.end, work.y.copy(), step):
                    return None
        if work.states.nbytes <= _LARGEST_KEPT:
            self.workspaces.append(work)
        return record.solution(Status(status))


@final
class _Workspace:
    """Memory of one run at a time, and the packed arguments that point to it."""

    def __init__(self, code: StepCode, problem: IntegrationProblem) -> None:
        n, constants = len(problem.y0), len(problem.constants)
        self._width = n + 2 + n * (code.order + 1)
        self.low, self.progress, nothing = np.zeros(n + 1), PreparedProgress(), np.zeros((0, 1))
        self.states, self.times = self._rows(FIRST_BLOCK)
        self._arguments = PreparedArguments(
            kernels=PreparedKernels(NO_CODE, code.step, NO_CODE, code.position, code.velocity),
            limits=PreparedLimits(0.0, 0.0, 0.0, 0, 0, going=False, slack=1.0),
            n=n,
            memory=0,
            parameters=nothing,
            constants=np.zeros((constants, 1)),
            settings=np.zeros((1, 5 + n * code.weighted)),
            clock=np.empty((1, 1)),
            states=self.states,
            times=self.times,
            low=self.low,
            delta=np.empty((n, 1)),
            mark=np.zeros(1, np.int64),
            tests=nothing,
            progress=self.progress,
            stops=no_stops(),
        )
        self._nothing = np.zeros(n), np.zeros(constants)
        self._stops, self._prepare = self._arguments.stops, NO_CODE
        self._words = pack(self._arguments)
        self._doubles, self.address = self._words.view(np.float64), address_of(self._words)
        self.y, self._begun = self.states[0, :n], self.states[0, : n + 1]
        self.started = self.y
        self._constants, self._settings = self._arguments.constants[:, 0], self._arguments.settings[0]

    def _rows(self, limit: int) -> tuple[FloatArray, FloatArray]:
        """Return the first state and so many steps as rows, with room behind the last for a state behind a stop."""
        return np.empty((limit + 2, self._width)), np.empty(limit + 2)

    def begin(self, problem: IntegrationProblem) -> bool:
        """Load the start of a problem; return whether its numbers are finite."""
        y, c, settings, numbers, words = self.y, self._constants, self._settings, self._doubles, self._words
        y[...], c[...] = problem.y0, problem.constants
        self.low.fill(0.0)
        settings[0], settings[1] = 0.0, 1.0 if problem.t1 >= problem.t0 else -1.0
        settings[2], settings[-2], settings[-1] = scale_floor(problem.rtol, problem.atol), problem.rtol, problem.atol
        if problem.allowed is not None:
            settings[3:-2] = problem.atol / problem.allowed
        numbers[_T0_AT], numbers[_T1_AT], numbers[_LARGEST_AT] = problem.t0, problem.t1, problem.max_step
        words[_ATTEMPTS_AT], words[_GOING_AT] = problem.max_steps, 0
        table = table_of(problem.stops, problem.inputs, len(c))
        if table is not self._stops:
            prepare = NO_CODE if problem.stops is None else problem.stops.prepare
            words[_STOPS_AT:], words[_PREPARE_AT] = pack(table), prepare
            self._stops, self._prepare = table, prepare
        state, constants = self._nothing
        return bool(y.dot(state) + c.dot(constants) == 0.0)

    def has_turned(self, angles: list[int]) -> bool:
        """Return whether one of these components of the state has become large."""
        y = self.y.tolist()
        return any(abs(y[i]) > _MOST_TURNS * TURN for i in angles)

    def run(self, call: Callable[[int], int], limit: int) -> tuple[int, FloatArray, FloatArray]:
        """Take at most so many steps; return the status, the times of rows (k,) and the rows (k, width)."""
        if limit <= FIRST_BLOCK:
            status = call(self.address)
            last = self.progress.row + 1
            rows, times = self.states[1:last].copy(), self.times[1:last].copy()
        else:
            states, ends = self._rows(limit)
            states[0, : len(self._begun)] = self._begun
            words = self._words.copy()
            replace_array(words, _STATES_AT, states)
            replace_array(words, _TIMES_AT, ends)
            status = call(address_of(words))
            last = self.progress.row + 1
            rows, times = states[1:last], ends[1:last]
            if last <= limit:
                rows, times = rows.copy(), times.copy()
        if not self._words[_GOING_AT]:
            self.started = self.y.copy()
            self._words[_GOING_AT] = 1
        if last > 1 and status == RUNNING:
            self._begun[...] = rows[-1, : len(self._begun)]
        return status, times, rows


@compiled_subset
def turns_to_take(angle: float) -> float:
    """Return the whole turns to be taken off an angle, 0 unless it is large."""
    if not abs(angle) <= _LARGEST_ANGLE:
        return 0.0
    whole = float(int(angle / TURN))
    if abs(whole) <= _MOST_TURNS:
        return 0.0
    return whole - (_FEWEST_TURNS if whole > 0.0 else -_FEWEST_TURNS)


@compiled_subset
def unwound(angle: float, turns: float) -> tuple[float, float]:
    """Return an angle less so many turns, and what rounding has taken from that."""
    wrapped, rest = angle - turns * _TURN_HIGH, turns * _TURN_LOW
    found = wrapped - rest
    return found, (wrapped - found) - rest


def _unwound(y: FloatArray, low: FloatArray, angles: list[int]) -> FloatArray:
    """Subtract whole turns from large angles of a state y (n,), and return how many; `low` gets the rounding errors."""
    turns = np.array([turns_to_take(y[i]) for i in angles])
    for i, taken in zip(angles, turns, strict=True):
        y[i], lost = unwound(y[i], taken)
        low[i] += lost
    return turns
