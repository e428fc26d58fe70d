"""Runs of many cases without events, samples and stops, whose memory is kept from call to call."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import replace
from typing import cast, final

import numpy as np
from numpy.typing import NDArray

from ...lanes.cases import BlockResult, CaseColumns
from ...lanes.sweep_arguments import KeptStarts, SweepArguments, SweepKernels, no_columns
from ...lanes.workspace import EventKernels, LoopProgress, no_events
from ...subset.arguments import address_of, pack, place_of
from ..runs import CaseRun, LoopCall
from ..steppers import Stepper
from .loops import loop_named
from .sweeps import CaseArrays, SweepShape, begin_progress, case_run, run_loop

_CASES, _SHARE = (place_of(SweepArguments, f"shape.{name}") for name in ("cases", "share"))
_COLUMNS, _TURN, _OUT, _ENDS = (place_of(SweepArguments, name) for name in ("columns", "turn", "out", "ends"))
_CONSTANTS, _END = place_of(SweepArguments, "kept.constants"), place_of(SweepArguments, "state")


def is_plain(cases: CaseColumns) -> bool:
    """Return whether cases have nothing but values of their own, a span, and tolerances."""
    return (
        cases.inputs is None
        and cases.stops is None
        and cases.rows is None
        and cases.part is None
        and cases.carried is None
        and cases.first_step is None
        and not cases.recorded
    )


@final
class PlainRuns:
    """Runs of cases of one kind, of which `is_plain` holds, with nothing to watch and no times to record.

    Parameters
    ----------
    kernels : SweepKernels
    shape : SweepShape
        Of which the share is that of each run.
    stepper : Stepper
        The step of `kernels`.
    """

    def __init__(self, kernels: SweepKernels, shape: SweepShape, stepper: Stepper) -> None:
        self._kernels, self._shape, self._stepper = kernels, shape, stepper
        self._memories: list[_Memory] = []

    def run(self, cases: CaseColumns, result: BlockResult, kept: KeptStarts, share: int) -> CaseRun:
        """Return cases ready to run; see `case_run`."""
        turn = np.zeros(1, np.int64)
        _ = cases.table  # made once for all threads

        def work(paused: Callable[[], None] | None = None) -> None:
            try:
                memory = self._memories.pop()
            except IndexError:
                memory = _Memory(CaseArrays(*self._about(cases, result, kept, share)))
            memory.begin(cases, share, turn, result, kept)
            if run_loop(memory.code, memory.pointer, memory.progress, turn, paused):
                memory.held = None
                self._memories.append(memory)  # what was stopped is not used again

        def call(turn: NDArray[np.int64]) -> LoopCall:
            run = case_run(*self._about(cases, result, kept, share))
            assert run.call is not None
            return run.call(turn)

        return CaseRun(work, turn, _nothing, call)

    def _about(
        self, cases: CaseColumns, result: BlockResult, kept: KeptStarts, share: int
    ) -> tuple[SweepKernels, SweepShape, Stepper, CaseColumns, BlockResult, KeptStarts, EventKernels, bool]:
        shape = replace(self._shape, share=share)
        return self._kernels, shape, self._stepper, cases, result, kept, no_events(), False


def _nothing() -> None:
    """Finish a run of which nothing is left to do."""


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
        made = made._replace(columns=no_columns(), out=none, ends=none, happened=none, totals=none)
        made = made._replace(kept=KeptStarts.nothing())  # arrays of the first run are not kept alive
        self._words, self._made = pack(made), made
        self._block = cast("NDArray[np.uint8]", made.state.clock.base)  # of all arrays of the lanes
        self._to_out = self._words[_TURN + 1 : _OUT].tolist()
        self._to_kept = self._words[_ENDS + 3 : _CONSTANTS].tolist()
        self.code, self.pointer = loop_named(arrays.loop_name).call, ctypes.c_void_p(address_of(self._words))
        self.progress: LoopProgress = made.state.progress
        self.held: object = None

    def begin(
        self, cases: CaseColumns, share: int, turn: NDArray[np.int64], result: BlockResult, kept: KeptStarts
    ) -> None:
        """Set the arguments to those of a run that begins."""
        self.held = cases, turn, result, kept
        words = self._words
        self._block[:] = 0
        begin_progress(self.progress)
        self.progress.common = all([column.size == 1 for column in cases.parameters])
        self._made.limits[0, :2] = cases.max_step, cases.max_steps
        words[_CASES], words[_SHARE] = cases.count, share
        arrays = (result.y, result.ends, kept.constants, kept.states)
        assert all([array.flags.c_contiguous for array in arrays])
        out, ends, constants, states = [(address_of(array), *array.shape) for array in arrays]
        words[_COLUMNS:_END] = (
            *cases.table.fields,
            address_of(turn),
            *self._to_out,
            *out,
            *ends,
            *self._to_kept,
            *constants,
            *states,
        )
