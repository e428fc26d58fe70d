"""Engines whose runs stop: where conditions on time change, and where controllers act.

Along a segment such conditions hold or not, whatever time a stage is evaluated at, and a step ends at each of its
ends. `dalembert.runs.stop_lists` lists the stops of all kinds of runs. The loops of an engine pass them in place, or
the host takes its runs from stop to stop (`dalembert.lanes.host_stops`), at knots of inputs, too. Scenes without
stops have no such engine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np

from ..arrays import FloatArray
from ..codegen.engine import Engine
from ..codegen.runs import Final, Prepared, PreparedStates
from ..ir.conditions import NO_CONDITIONS, Conditions
from ..ir.program import Program
from ..lanes.cases import BlockResult, CaseBlock, CaseColumns
from ..lanes.host_stops import ALONE, CasesAtStops, in_blocks, in_pieces, side_by_side
from ..methods.status import Status
from ..starts.inputs import prepare_rows
from ..starts.segment_constants import constants_of_rows, prepared_rows, segments_of
from ..steps.problem import IntegrationProblem, SamplingClock, Solution, prescribed_blocks
from ..stops.breakpoints import CaseBreaks
from ..stops.segments import Segments
from ..stops.stops import Landing
from .sampling import NoInstants, Sampling
from .stop_lists import Stopping

if TYPE_CHECKING:
    from ..codegen.llvm.prepared import Admission
    from ..codegen.runs import CaseRun
    from ..events.event_code import EventCode
    from ..events.recorded_motion import RecordedCase
    from ..lanes.sweep_arguments import KeptStarts

_MOST_KEPT = 16


def _of_inner(name: str) -> Any:
    """Return a property that is one of the inner engine."""
    return property(lambda engine: getattr(engine.inner, name))


@final
class SegmentedEngine(Engine):
    """An engine that gives another the stops of its runs, or runs every piece between them with it."""

    def __init__(
        self, inner: Engine, program: Program, landing: Landing | None = None, sampling: Sampling | None = None
    ) -> None:
        self.inner, self._program, self.sampling = inner, program, sampling
        self._stopping = partial(Stopping.of, program, sampling=sampling, landing=landing)
        self._kept: dict[tuple[bytes, float, float], Segments] = {}
        self.controlled = sampling is not None
        self.parallel, self.whole_blocks = inner.parallel, inner.whole_blocks  # type: ignore[misc]

    accept_as_static, folder, functions, source_of, rows, automatic, prepare, code = map(
        _of_inner, ("accept_as_static", "folder", "functions", "source_of", "rows", "automatic", "prepare", "code")
    )
    vector_field, state_functions, solve_fn, hosted_solve_fn = map(
        _of_inner, ("vector_field", "state_functions", "solve_fn", "hosted_solve_fn")
    )
    cuts: ClassVar[bool] = True
    passes_stops: ClassVar[bool] = True

    @property
    def for_segments(self) -> Engine:
        """See `Engine.for_segments`."""
        return self.inner

    @property
    def _conditions(self) -> Conditions:
        return self._program.conditions or NO_CONDITIONS

    def _alone(self, problem: IntegrationProblem, clock: SamplingClock | None = None) -> CasesAtStops:
        """Return the case of a problem; `clock` gets the times at which controllers act."""
        place, parameters = self._conditions.place, len(self._program.layout.parameters)
        along, at_knots = self.constants_along(problem), not self.inner.passes_stops

        def prepare(rows: FloatArray) -> FloatArray:
            found = along.constants[along.number(rows[:, place])]
            if found[0, place] != rows[0, place]:  # decided at another time than the middle of a segment
                return constants_of_rows(self._program, rows)
            found[:, :parameters] = rows[:, :parameters]
            return found

        return CasesAtStops.alone(self._with_stops(problem), prepare, at_knots=at_knots, clock=clock)

    def after_start(self, problem: IntegrationProblem) -> IntegrationProblem:
        """See `Engine.after_start`."""
        if self.sampling is None:
            return problem
        clock = problem.sampled or SamplingClock(problem.t0, requested=problem.t_eval)
        case = self._alone(replace(problem, sampled=clock), clock)
        case.take(ALONE)
        return replace(problem, sampled=clock, y0=case.y[0])

    def constants_along(self, problem: IntegrationProblem) -> Segments:
        """See `Engine.constants_along`; they do not change at instants of controllers."""
        if self._program.conditions is None:
            return Segments(np.array([problem.t0, problem.t1]), problem.constants[np.newaxis], problem.inputs)
        parameters = len(self._program.layout.parameters)
        p = problem.constants[:parameters].copy()
        self._conditions.decide_at(p, 0.0)
        key = p.tobytes(), problem.t0, problem.t1
        found = self._kept.get(key)
        if found is None:
            found = segments_of(self._program, problem.constants, problem.t0, problem.t1)
            while len(self._kept) >= _MOST_KEPT:
                self._kept.pop(next(iter(self._kept)), None)
            self._kept[key] = found
        return found if problem.inputs is None else replace(found, inputs=problem.inputs)

    def evaluate(self, kernel: str, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """See `Engine.evaluate`; conditions are decided at each time."""
        if not self._conditions.decides:
            return self.inner.evaluate(kernel, t, y, c)
        rows = prepared_rows(self._program, c[: len(self._program.layout.parameters)], t)
        return self.inner.rows(self._program.kernel(kernel), t, y, rows)

    def fit(self, problem: IntegrationProblem, method: str) -> tuple[str, str]:
        """See `Engine.fit`: the first segment decides."""
        try:
            case = self._alone(problem)
        except NoInstants:  # of a case whose controllers have no instants; its run raises the error
            return method, ""
        case.look_ahead(ALONE)
        return self.inner.fit(case.piece(problem, None, problem.first_step, problem.max_steps), method)

    def _with_stops(self, problem: IntegrationProblem) -> IntegrationProblem:
        """Return a problem with its stops."""
        along = self.constants_along(problem)
        edges, p = along.edges, problem.constants[np.newaxis, : len(self._program.layout.parameters)]
        breaks = CaseBreaks(
            self._conditions.place, edges[:1], edges[-1:], np.array([0, len(edges) - 2], np.intp), edges[1:-1]
        )
        clock = problem.sampled
        requested = problem.t_eval if clock is None else clock.requested
        found = self._stopping(p, (edges[:1], edges[-1:]), requested, many=False, clock=clock, breaks=breaks)
        problem = replace(problem, constants=along.first)
        return found.problem(problem, along, behind=self.sampling is not None) if len(found.lists.times) else problem

    def integrate(self, problem: IntegrationProblem, method: str) -> Solution:
        """See `Engine.integrate`."""
        if self.inner.passes_stops:
            return self.inner.integrate(self._with_stops(problem), method)
        run, behind = partial(self.inner.integrate, method=method), self.sampling is not None
        return in_pieces(self._alone(problem), problem, run, behind)

    def integrate_automatic(self, problem: IntegrationProblem, method: str) -> tuple[Solution, str, str]:
        """See `Engine.integrate_automatic`.

        Laws that are Python functions are called once an instant, so that a run with them is not repeated by another
        method: it is chosen behind the start.
        """
        called = self.sampling is not None and self.sampling.called_back
        if self.inner.passes_stops and not called:
            return self.inner.integrate_automatic(self._with_stops(problem), method)
        problem = self.after_start(problem)
        taken, note = self.fit(problem, method)
        return self.integrate(problem, taken), taken, note

    def recorded(
        self, problem: IntegrationProblem, method: str, watch: EventCode, carried: FloatArray | None
    ) -> RecordedCase:
        """See `Engine.recorded`: a run passes its stops in the loop of the inner engine."""
        if not self.inner.records(method):
            return super().recorded(problem, method, watch, carried)
        return self.inner.recorded(self._with_stops(problem), method, watch, carried)

    def step_blocks(self, problem: IntegrationProblem, method: str) -> Iterator[Solution]:
        """See `Engine.step_blocks`; none of them reaches beyond a stop."""
        blocks = partial(self.inner.step_blocks, method=method) if len(problem.y0) else prescribed_blocks
        yield from in_blocks(self._alone(problem, problem.sampled), replace(problem, t_eval=None), blocks)

    def prepared(
        self,
        problem: IntegrationProblem,
        method: str,
        constants: Callable[[FloatArray], FloatArray],
        admission: Admission | None = None,
    ) -> Prepared:
        """See `Engine.prepared`: runs that the inner engine cannot take through their stops go piece by piece."""
        knots = problem.inputs is not None and not self.inner.passes_stops
        whole = self.inner.prepared(replace(problem, inputs=None) if knots else problem, method, constants, admission)
        spans = np.array([problem.t0]), np.array([problem.t1])
        known: dict[bytes, tuple[Stopping, Prepared]] = {}

        def stopped(p: FloatArray) -> tuple[Stopping, Prepared]:
            found = self._stopping(p[np.newaxis], spans, None, many=False)
            if not len(found.lists.times) and not knots:
                return found, whole
            if not self.inner.passes_stops:
                return found, Engine.prepared(self, problem, method, constants, admission)
            return found, self.inner.prepared(found.problem(problem), method, constants, admission)

        def run(state: FloatArray, p: FloatArray) -> Final:
            key = p.tobytes()
            entry = known.get(key)
            if entry is None:
                known.clear()
                entry = known[key] = stopped(p)
            own, (found, prepared) = p[np.newaxis].copy(), entry
            found.decide(own, ALONE, found.begin)
            return prepared(state, own[0]), prepared.status()

        return PreparedStates(run)

    def sweeper(
        self, cases: CaseColumns, method: str, result: BlockResult, kept: KeptStarts, share: int
    ) -> CaseRun | None:
        """See `Engine.sweeper`: cases pass their stops in the loop of the inner engine."""
        knots = cases.inputs is not None and not self.inner.passes_stops
        if knots or cases.carried is not None:
            return None
        t0, t1 = (np.broadcast_to(span, cases.count) for span in cases.spans)
        p = np.empty((cases.count, len(cases.parameters)))
        for i, column in enumerate(cases.parameters):
            p[:, i] = column
        found = self._stopping(p, (t0, t1), cases.t_eval)
        run = self.inner.sweeper(found.columns(cases), method, result, kept, share)
        if run is None or not np.any(found.bad):
            return run

        def finish() -> None:
            run.finish()
            result.ends[found.bad, 0] = t0[found.bad]

        return replace(run, finish=finish)

    def integrate_block(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        """See `Engine.integrate_block`: side by side from stop to stop where the engine can, else one by one."""
        knots = block.inputs is not None and not self.inner.passes_stops
        if self._program.conditions is None and not knots and self.sampling is None:
            self.inner.integrate_block(block, method, result)
        elif self.inner.whole_blocks and not (knots or len(block.t_eval) or block.watch):
            p, prepare = block.c[:, : len(self._program.layout.parameters)].copy(), partial(prepare_rows, self._program)
            found = self._stopping(p, (block.spans[:, 0], block.spans[:, 1]), block.t_eval)
            found.decide(p, np.arange(len(p)), found.begin)
            cases = CasesAtStops(found.stops, block.spans, block.y, prepare(p), prepare, found.inputs(None))
            run = self.inner.integrate_block
            side_by_side(cases, np.flatnonzero(~found.bad), block, lambda part, done: run(part, method, done), result)
        else:
            super().integrate_block(block, method, result)

    def integrate_case(self, block: CaseBlock, i: int, method: str, result: BlockResult) -> None:
        """See `Engine.integrate_case`: one whose controllers have no instants fails alone."""
        try:
            super().integrate_case(block, i, method, result)
        except NoInstants:
            result.y[i], result.samples[i] = block.y[i], np.nan
            result.ends[i] = block.spans[i, 0], float(Status.NON_FINITE), 0.0
