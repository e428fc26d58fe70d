"""Runs of many cases that are cut in segments: every round takes those that are left through their next segment."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..integrators.breakpoints import break_times_of_cases
from ..integrators.cases import BlockResult, CaseBlock, CaseColumns
from ..integrators.event_continuation import not_begun
from ..integrators.input_records import InputRecords
from ..integrators.segments import Segments
from ..ir.kernel import Assignment, Kernel, Load
from ..ir.program import KnotSides
from ..methods.status import Status
from ..reduction.starting import Start
from .inputs import prepare_rows
from .sampling import NoInstants, Sampling
from .segment_constants import prepared_rows

if TYPE_CHECKING:
    from ..codegen.runs import CaseRun
    from .segments import SegmentedEngine

__all__ = ["SegmentRounds"]


def _start_from_states(states: int) -> Start:
    """Return the start of cases from states."""
    loads = tuple(Load(f"y_{i}", "y", i) for i in range(states))
    body = tuple(Assignment(f"z_{i}", "add", (f"y_{i}", 0.0)) for i in range(states))
    kernel = Kernel("start", ("t", "y", "c"), loads, body, tuple(f"z_{i}" for i in range(states)))
    return Start(kernel, tuple(f"component {i}" for i in range(states)), ())


@final
class SegmentRounds:
    """Many cases, of which every round takes those that are left through their next segment, side by side."""

    def __init__(self, engine: SegmentedEngine, block: CaseBlock, method: str, result: BlockResult) -> None:
        program = engine._program
        self.inner, self.program, self.block, self.method, self.result = engine.inner, program, block, method, result
        self.landing, self.sampling = engine.landing, engine.sampling
        self.conditions = engine._conditions
        self.p = block.c[:, : len(program.layout.parameters)].copy()
        self.start = _start_from_states(len(program.layout.state))
        self.starts, self.breaks = break_times_of_cases(self.conditions, self.p, block.spans[:, 0], block.spans[:, 1])
        self.acts, self.bad = np.zeros(0, np.int64), np.zeros(len(block.y), np.bool_)
        self.continued = None if block.watch is None else not_begun(block.spans, len(block.watch.events))
        if self.sampling is not None:
            self._sample(self.sampling)

    def _sample(self, sampling: Sampling) -> None:
        """Add the instants of controllers to the breaks, and apply the actions at the starts of the cases.

        A case whose periods make no sense fails alone.
        """
        spans, schedules = self.block.spans, sampling.schedules(self.block.c)
        known: dict[bytes, Segments] = {}
        cuts: list[Segments] = []
        for i, (t0, t1) in enumerate(spans.tolist()):
            own = self.breaks[self.starts[i] : self.starts[i + 1]]
            key = spans[i].tobytes() + schedules[i].tobytes() + own.tobytes()
            if key not in known:
                whole = Segments(np.concatenate([[t0], own, [t1]]), np.empty((len(own) + 1, 0)))
                try:
                    if np.all(np.isfinite([t0, t1])):
                        whole = whole.cut(*sampling.instants(schedules[i], t0, t1, None, self.block.t_eval))
                except NoInstants:
                    self.bad[[np.array_equal(row, schedules[i], equal_nan=True) for row in schedules]] = True
                known[key] = whole if whole.acts else replace(whole, acts=(0,) * len(whole))
            cuts.append(known[key])
        self.starts = np.concatenate([[0], np.cumsum([len(cut) - 1 for cut in cuts])]).astype(np.intp)
        self.breaks = np.concatenate([cut.edges[1:-1] for cut in cuts])
        self.acts = np.concatenate([np.array(cut.acts[1:], np.int64) for cut in cuts])
        self.first = np.array([cut.acts[0] for cut in cuts], np.int64)

    def _apply_actions(self, some: NDArray[np.intp], now: FloatArray, y: FloatArray, k: int) -> None:
        """Apply the actions of controllers where the segments k of cases begin."""
        assert self.sampling is not None
        numbers = self.acts[self.starts[some] + k - 1] if k else self.first[some]
        some, numbers = some[numbers != 0], numbers[numbers != 0]
        if not len(some):
            return
        p = self.p[some]
        self.conditions.decide_at(p, now[some])
        if self.block.inputs is not None:
            self.block.inputs.write(p, now[some], some)
        y[some] = self.sampling.act_rows(numbers, now[some], y[some], p, self.inner.rows)

    def run(self) -> bool:
        """Run all cases; return whether that could be done."""
        block, result = self.block, self.result
        some = np.flatnonzero(~self.bad)
        now, y = block.spans[:, 0].copy(), block.y.copy()
        result.ends[:, 2] = 0.0
        result.y[self.bad], result.samples[self.bad] = block.y[self.bad], np.nan
        result.ends[self.bad, :2] = np.column_stack([now, np.full(len(now), float(Status.NON_FINITE))])[self.bad]
        k = 0
        while len(some):
            left = self.starts[some + 1] - self.starts[some]
            further = k < left
            ends = block.spans[some, 1].copy()
            ends[further] = self.breaks[self.starts[some[further]] + k]
            if k and self.landing is not None:
                self._apply_impulses(some, now, ends, y, k)
            if self.sampling is not None:
                self._apply_actions(some, now, y, k)
            if self.program.knot_sides is not None and (k or self.sampling is not None):
                self._take_sides(self.program.knot_sides, some, now, ends, y)
            done = self._round(some, now[some], ends, y[some], k)
            if done is None:
                return False
            t, status, steps = done.ends.T
            now[some], y[some] = t, done.y
            result.y[some], result.happened[some], result.totals[some] = done.y, done.happened, done.totals
            result.ends[some, 2] += steps
            further &= status == Status.SUCCESS
            spent = further & (result.ends[some, 2] >= block.max_steps)
            status[spent], status[further & ~spent] = Status.MAX_STEPS, Status.INTERRUPTED
            result.ends[some, 0], result.ends[some, 1] = t, status
            some = some[further & ~spent]
            k += 1
        return True

    def _apply_impulses(self, some: NDArray[np.intp], now: FloatArray, ends: FloatArray, y: FloatArray, k: int) -> None:
        """Set the states of cases at a break to those after it."""
        assert self.landing is not None
        for i, end in zip(some.tolist(), ends.tolist(), strict=True):
            first = self.breaks[self.starts[i] + k - 2] if k > 1 else self.block.spans[i, 0]
            middles = 0.5 * np.array([first + now[i], now[i] + end])
            both = prepared_rows(self.program, self.p[i], middles)
            if self.block.inputs is not None:
                forward = self.block.spans[i, 1] >= self.block.spans[i, 0]
                times, after = np.full(2, now[i]), np.array([not forward, forward])
                self.block.inputs.write(both, times, np.full(2, i), after)
            before, after_ = both
            y[i] = self.landing(float(now[i]), y[i], before, after_)

    def _take_sides(
        self, sides: KnotSides, some: NDArray[np.intp], now: FloatArray, ends: FloatArray, y: FloatArray
    ) -> None:
        """Move the states of cases to the sides of knots and switches that their motions go to."""
        t0, t1 = now[some], ends
        forward, n = self.block.spans[some, 1] >= self.block.spans[some, 0], y.shape[1]
        p = self.p[some]
        self.conditions.decide_at(p, t0 + 0.5 * (t1 - t0))
        if self.block.inputs is not None:
            self.block.inputs.write(p, t0, some, forward)
        c = prepare_rows(self.program, p)
        near = np.flatnonzero(self.inner.rows(sides.near, t0, y[some], c)[:, 0])
        if len(near):
            found = self.inner.rows(sides.sides, t0[near], y[some[near]], c[near])
            y[some[near]] = np.where(forward[near, np.newaxis], found[:, :n], found[:, n : 2 * n])

    def _round(
        self, some: NDArray[np.intp], t0: FloatArray, t1: FloatArray, y: FloatArray, k: int
    ) -> BlockResult | None:
        block = self.block
        p = self.p[some]
        self.conditions.decide_at(p, t0 + 0.5 * (t1 - t0))
        inputs = None if block.inputs is None else block.inputs.part(some, len(block.y))
        if inputs is not None:
            inputs.write(p, t0, np.arange(len(some)), t1 >= t0)
        requested = block.t_eval
        forward = 1.0 if block.spans[0, 1] >= block.spans[0, 0] else -1.0
        lowest, highest = np.min(forward * t0), np.max(forward * t1)
        chosen = np.flatnonzero((forward * requested >= lowest) & (forward * requested <= highest))
        times = requested[chosen]
        done = BlockResult.empty(len(some), y.shape[1], len(times))
        done = replace(done, happened=self.result.happened[some], totals=self.result.totals[some])
        continued = None if self.continued is None else self.continued[some]
        if not self._step(p, y, (t0, t1), times, done, inputs, continued):
            return None
        if self.continued is not None:
            self.continued[some] = continued
        if len(times):
            own = (forward * times >= forward * t0[:, np.newaxis]) & (forward * times <= forward * t1[:, np.newaxis])
            own &= forward * times <= forward * done.ends[:, :1]
            rows, columns = np.nonzero(own)
            self.result.samples[some[rows], chosen[columns]] = done.samples[rows, columns]
        return done

    def _step(
        self,
        p: FloatArray,
        y: FloatArray,
        ends: tuple[FloatArray, FloatArray],
        times: FloatArray,
        done: BlockResult,
        inputs: InputRecords | None,
        continued: FloatArray | None,
    ) -> bool:
        """Run cases from states to the ends of their segments; return whether the engine does that side by side."""
        block, (t0, t1) = self.block, ends
        limits = block.rtol, block.atol, block.max_step, block.max_steps
        columns = CaseColumns(
            len(p),
            (np.ascontiguousarray(t0), np.ascontiguousarray(t1)),
            tuple(np.ascontiguousarray(column) for column in p.T),
            tuple(np.ascontiguousarray(column) for column in y.T),
            self.start,
            times,
            *limits,
            watch=block.watch,
            inputs=inputs,
            continued=continued,
        )
        run: CaseRun | None = self.inner.sweeper(columns, self.method, done, np.empty((0, 0)), len(p))
        if run is not None:
            run.work()
            run.finish()
            return True
        if not self.inner.whole_blocks or len(block.t_eval) or block.watch is not None:
            return False
        c = prepare_rows(self.program, p)
        spans = np.stack([t0, t1], axis=1)
        self.inner.integrate_block(CaseBlock(y, c, spans, times, *limits, inputs=inputs), self.method, done)
        return True
