"""Runs of many cases by one step, whose memory is reused from run to run."""

from __future__ import annotations

import ctypes
from array import array
from collections.abc import Callable
from typing import cast, final

import numpy as np
from numpy.typing import NDArray

from ...lanes.cases import BlockResult, CaseColumns
from ...lanes.sweep_arguments import KeptStarts, SweepArguments, SweepKernels, no_columns
from ...lanes.workspace import EventKernels, LoopProgress
from ...stops.stops import no_stops
from ...subset.arguments import place_of
from ...subset.packing import pack, words_of
from ..runs import CaseRun
from ..steppers import Stepper
from .sweeps import CaseArrays, SweepShape, begin_progress, run_loop

_CASES, _SHARE = (place_of(SweepArguments, f"shape.{name}") for name in ("cases", "share"))
_COLUMNS, _TURN, _STATE = (place_of(SweepArguments, name) for name in ("columns", "turn", "state"))
_HAPPENED, _STOPS, _STEPS = (place_of(SweepArguments, name) for name in ("happened", "stops", "steps"))
_LARGEST = place_of(SweepArguments, "implicit.settings.max_step")


def _reuses_memory(cases: CaseColumns) -> bool:
    """Return whether cases are whole motions that are given as columns, of which no steps are recorded."""
    return (
        cases.stops is None
        and cases.rows is None
        and cases.part is None
        and cases.carried is None
        and cases.first_step is None
        and not cases.recorded
    )


@final
class SweepRunner:
    """Runs of cases by one step, with the same events and reductions.

    Parameters
    ----------
    kernels : SweepKernels
    shape : SweepShape
    stepper : Stepper
        The step of `kernels`.
    events : EventKernels
    watched : bool
        Whether there are events or reductions, or steps are recorded.
    """

    def __init__(
        self, kernels: SweepKernels, shape: SweepShape, stepper: Stepper, events: EventKernels, *, watched: bool
    ) -> None:
        self._kernels, self.shape, self._stepper = kernels, shape, stepper
        self._events, self._watched = events, watched
        self._memories: dict[str, list[_Memory]] = {}

    def run(self, cases: CaseColumns, result: BlockResult, kept: KeptStarts, share: int) -> CaseRun:
        """Return cases ready to run; see `dalembert.loops.lane_loop`.

        Parameters
        ----------
        cases, result
        kept : KeptStarts
            Gets constants and first states.
        share : int
            How many cases a thread takes at a time.
        """
        of_step = self._kernels, self.shape, self._stepper
        arrays = CaseArrays(*of_step, cases, result, kept, self._events, self._watched, share)
        memories = self._memories.setdefault(arrays.loop_name, []) if _reuses_memory(cases) else []
        turn = np.zeros(1, np.int64)
        _ = cases.table  # made once for all threads

        def work(paused: Callable[[], bool] | None = None) -> None:
            try:
                memory = memories.pop()
            except IndexError:
                memory = _Memory(arrays)
            memory.begin(arrays, turn)
            if run_loop(memory.code, memory.pointer, memory.progress, turn, paused):
                memory.held = None
                memories.append(memory)  # what was stopped is not used again

        return CaseRun(work, turn, arrays.project_samples, arrays.call)


@final
class _Memory:
    """Memory of one thread at a time: packed arguments of the loop, and what they point to.

    Attributes
    ----------
    held : object
        What the arguments point to of the present run.
    """

    def __init__(self, arrays: CaseArrays) -> None:
        none, made = np.empty((0, 0)), arrays.arguments(np.zeros(1, np.int64))
        # arrays of the first run are not kept alive
        made = made._replace(columns=no_columns(), t_eval=np.empty(0), out=none, ends=none, samples=none)
        made = made._replace(inside=np.empty((0, 0), np.bool_), kept=KeptStarts.nothing())
        made = made._replace(happened=none, totals=none, stops=no_stops())
        # slices of the array module are set in half of the time of NumPy's
        self._words, self._made, self._stops = array("q", pack(made).tobytes()), made, made.stops
        self._numbers = np.frombuffer(self._words, np.float64)
        self._block = cast("NDArray[np.uint8]", made.state.clock.base)  # of all arrays of the lanes
        self.code, self.pointer = arrays.loop.call, ctypes.c_void_p(self._words.buffer_info()[0])
        self.progress: LoopProgress = made.state.progress
        self.held: object = None
        self._limits: tuple[float, int] | None = None

    def begin(self, arrays: CaseArrays, turn: NDArray[np.int64]) -> None:
        """Set the arguments to those of a run that begins."""
        words, cases = self._words, arrays.cases
        self._block[:] = 0
        common = cases.inputs is None and cases.constants_at is None
        if common:
            common = all([isinstance(p, float) or p.size == 1 for p in cases.parameters])
        begin_progress(self.progress, common=common)
        limits = cases.max_step, cases.max_steps
        if limits != self._limits:
            self._limits = self._made.limits[0, :2] = limits
            self._numbers[_LARGEST] = cases.max_step
        words[_CASES], words[_SHARE] = cases.count, arrays.share
        before, behind = arrays.results
        words[_COLUMNS:_STATE] = array("q", (*cases.table.fields, *words_of((turn, *before))))
        words[_HAPPENED:_STOPS] = array("q", words_of(behind))
        stops = arrays.stops()
        if stops is not self._stops:
            words[_STOPS:_STEPS] = array("q", pack(stops).tobytes())
            self._stops = stops
        self.held = arrays, turn
