"""Runs cut at the times at which conditions on time change, and chained.

Along a segment such conditions hold or not, whatever time a stage is evaluated at, and a step ends at each of its
ends. This is the one place where runs are cut: every kind of run asks an engine, and `SegmentedEngine` is one that asks
another for each segment. Scenes without such conditions have no such engine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, cast, final

import numpy as np

from ..arrays import FloatArray
from ..codegen.base import Engine
from ..codegen.runs import Final, Prepared, PreparedStates
from ..integrators.addresses import OwnedAddress
from ..integrators.breakpoints import CaseBreaks
from ..integrators.cases import BlockResult, CaseBlock, CaseColumns
from ..integrators.chaining import (
    Landing,
    between_knots,
    blocks_between_knots,
    chained,
    chained_blocks,
    in_turn,
    parts_of,
    side_landing,
)
from ..integrators.problem import IntegrationProblem, SamplingClock, Solution
from ..integrators.segments import KnotSegments, Segments
from ..ir.conditions import NO_CONDITIONS, Conditions
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..methods.status import Status
from .inputs import prepare_rows
from .sampling import NoInstants, Sampling
from .segment_constants import at_time, prepared_rows, segments_of
from .segment_rounds import SegmentRounds
from .stop_lists import Stopping

if TYPE_CHECKING:
    from pathlib import Path

    from ..codegen.base import FunctionEngine, TracedEngine
    from ..codegen.llvm.admission import Admission
    from ..codegen.runs import CaseRun
    from ..integrators.event_code import EventCode
    from ..integrators.recorded_motion import RecordedCase

__all__ = ["SegmentedEngine"]

_MOST_KEPT = 16


@final
class SegmentedEngine(Engine):
    """An engine that runs every segment with another."""

    def __init__(
        self, inner: Engine, program: Program, landing: Landing | None = None, sampling: Sampling | None = None
    ) -> None:
        self.inner, self._program, self.landing, self.sampling = inner, program, landing, sampling
        self._kept: dict[tuple[bytes, float, float], Segments] = {}
        self.controlled = sampling is not None
        self.parallel, self.whole_blocks = inner.parallel, inner.whole_blocks  # type: ignore[misc]

    cuts: ClassVar[bool] = True
    passes_stops: ClassVar[bool] = True

    @property
    def _conditions(self) -> Conditions:
        return self._program.conditions or NO_CONDITIONS

    def segments(self, problem: IntegrationProblem) -> Segments:
        """Return the segments of a problem between changes of its conditions, and instants of controllers."""
        found = self._unsampled(problem)
        if self.sampling is None:
            return found
        requested = problem.t_eval if problem.sampled is None else problem.sampled.requested
        schedule = self.sampling.schedules(problem.constants[np.newaxis])[0]
        return found.cut(*self.sampling.instants(schedule, problem.t0, problem.t1, problem.sampled, requested))

    def after_start(self, problem: IntegrationProblem) -> IntegrationProblem:
        """See `Engine.after_start`."""
        if self.sampling is None:
            return problem
        clock = problem.sampled or SamplingClock(problem.t0, requested=problem.t_eval)
        own = replace(problem, sampled=clock)
        return self._started(own, self.segments(own), clock)[0]

    def _started(
        self, problem: IntegrationProblem, segments: Segments, clock: SamplingClock | None = None
    ) -> tuple[IntegrationProblem, Landing | None]:
        """Return a problem after the actions of controllers at its start, and the actions at its breaks, in order.

        Acts are taken down in `clock`.
        """
        sampling, impulses = self.sampling, self.landing
        sides = side_landing(self._program.knot_sides, problem.t1 >= problem.t0)
        if sampling is None:
            return problem, in_turn(impulses, sides)
        acts, program = iter(segments.acts), self._program

        def act(t: float, y: FloatArray, c: FloatArray) -> FloatArray:
            number = next(acts)
            if number and clock is not None:
                clock.last = t
            return sampling.act(number, t, y, at_time(program, c, t))

        def landing(t: float, y: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
            return act(t, y, after)

        y0 = act(problem.t0, problem.y0, segments.of(0))
        if sides is not None:
            y0 = sides(problem.t0, y0, segments.of(0), segments.of(0))
        return replace(problem, y0=y0), in_turn(impulses, landing, sides)

    def _unsampled(self, problem: IntegrationProblem) -> Segments:
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

    @property
    def for_segments(self) -> Engine:
        """See `Engine.for_segments`."""
        return self.inner

    def constants_along(self, problem: IntegrationProblem) -> Segments:
        """See `Engine.constants_along`; they do not change at instants of controllers."""
        return self._unsampled(problem)

    def accept_as_static(self, kind: type) -> None:
        """See `Engine.accept_as_static`."""
        self.inner.accept_as_static(kind)

    @property
    def folder(self) -> Path | None:
        """See `Engine.folder`."""
        return self.inner.folder

    @property
    def functions(self) -> Any:
        """See `FunctionEngine.functions`."""
        return cast("FunctionEngine", self.inner).functions

    def source_of(self, method: str, rtol: float, atol: float) -> str:
        """See `Engine.source_of`."""
        return self.inner.source_of(method, rtol, atol)

    def evaluate(self, kernel: str, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """See `Engine.evaluate`; conditions are decided at each time."""
        if not self._conditions.decides:
            return self.inner.evaluate(kernel, t, y, c)
        rows = prepared_rows(self._program, c[: len(self._program.layout.parameters)], t)
        return self.inner.rows(self._program.kernel(kernel), t, y, rows)

    def rows(self, kernel: Kernel, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """See `Engine.rows`."""
        return self.inner.rows(kernel, t, y, c)

    def automatic(self, methods: Sequence[str], rtol: float, atol: float, *, many: bool = False) -> str:
        """See `Engine.automatic`."""
        return self.inner.automatic(methods, rtol, atol, many=many)

    def prepare(self, problem: IntegrationProblem, method: str, watch: EventCode | None = None) -> None:
        """See `Engine.prepare`."""
        self.inner.prepare(problem, method, watch)

    def fit(self, problem: IntegrationProblem, method: str) -> tuple[str, str]:
        """See `Engine.fit`: the first segment decides."""
        try:
            segments = self.segments(problem)
        except NoInstants:  # of a case whose controllers have no instants; its run raises the error
            segments = self._unsampled(problem)
        part = replace(next(parts_of(problem, segments)), t_eval=None)
        if part.inputs is not None and not self.inner.passes_stops:
            part = next(parts_of(part, KnotSegments(part)))
        return self.inner.fit(part, method)

    def _with_stops(self, problem: IntegrationProblem) -> IntegrationProblem:
        """Return a problem with its stops, which the inner engine passes."""
        along = self._unsampled(problem)
        edges, p = along.edges, problem.constants[np.newaxis, : len(self._program.layout.parameters)]
        breaks = CaseBreaks(
            self._conditions.place, edges[:1], edges[-1:], np.array([0, len(edges) - 2], np.intp), edges[1:-1]
        )
        clock, requested = problem.sampled, problem.t_eval
        found = Stopping.of(
            self._program,
            p,
            (edges[:1], edges[-1:]),
            requested if clock is None else clock.requested,
            self.sampling,
            self.landing,
            many=False,
            clock=clock,
            breaks=breaks,
        )
        problem = replace(problem, constants=along.of(0))
        return found.problem(problem, along, behind=self.sampling is not None) if len(found.lists.times) else problem

    def integrate(self, problem: IntegrationProblem, method: str) -> Solution:
        """See `Engine.integrate`."""
        if self.inner.passes_stops:
            return self.inner.integrate(self._with_stops(problem), method)
        run, segments = between_knots(partial(self.inner.integrate, method=method)), self.segments(problem)
        started, landing = self._started(problem, segments)
        return chained(run, started, segments, landing, right=self.sampling is not None)

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
        if not (self.inner.records(method) and self.inner.passes_stops):
            return super().recorded(problem, method, watch, carried)
        p = problem.constants[np.newaxis, : len(self._program.layout.parameters)].copy()
        spans = np.array([problem.t0]), np.array([problem.t1])
        found = Stopping.of(self._program, p, spans, problem.t_eval, self.sampling, self.landing, many=False)
        if self._program.conditions is not None:
            found.decide(p, np.zeros(1, np.intp), found.begin)
            problem = replace(problem, constants=prepare_rows(self._program, p)[0])
        own = found.problem(problem) if len(found.lists.times) else problem
        return self.inner.recorded(own, method, watch, carried)

    def step_blocks(self, problem: IntegrationProblem, method: str) -> Iterator[Solution]:
        """See `Engine.step_blocks`; none of them reaches beyond its segment."""
        segments = self.segments(problem)
        problem, landing = self._started(problem, segments, problem.sampled)
        parts = parts_of(replace(problem, t_eval=None), segments)

        def step_blocks(part: IntegrationProblem) -> Iterator[Solution]:
            if self.inner.passes_stops:
                return self.inner.step_blocks(part, method)
            return blocks_between_knots(partial(self.inner.step_blocks, method=method), part)

        yield from chained_blocks(parts, problem, step_blocks, landing, lambda k: segments.of(k, ending=True))

    def prepared(
        self,
        problem: IntegrationProblem,
        method: str,
        constants: Callable[[FloatArray], FloatArray],
        admission: Admission | None = None,
    ) -> Prepared:
        """See `Engine.prepared`: runs that the inner engine cannot take through their stops are chained."""
        knots = problem.inputs is not None and not self.inner.passes_stops
        whole = self.inner.prepared(replace(problem, inputs=None) if knots else problem, method, constants, admission)
        spans = np.array([problem.t0]), np.array([problem.t1])
        known: dict[bytes, tuple[Stopping, Prepared]] = {}

        def stopped(p: FloatArray) -> tuple[Stopping, Prepared]:
            found = Stopping.of(self._program, p[np.newaxis], spans, None, self.sampling, self.landing, many=False)
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
            found.decide(own, np.zeros(1, np.intp), found.begin)
            return prepared(state, own[0]), prepared.status()

        return PreparedStates(run)

    @property
    def vector_field(self) -> Callable[[Any, Any, Any], Any]:
        """See `TracedEngine.vector_field`."""
        return cast("TracedEngine", self.inner).vector_field

    @property
    def state_functions(self) -> Any:
        """See `TracedEngine.state_functions`."""
        return cast("TracedEngine", self.inner).state_functions

    @property
    def solve_fn(self) -> Callable[..., Any]:
        """See `TracedEngine.solve_fn`."""
        return cast("TracedEngine", self.inner).solve_fn

    @property
    def hosted_solve_fn(self) -> Callable[..., Any]:
        """See `TracedEngine.hosted_solve_fn`."""
        return cast("TracedEngine", self.inner).hosted_solve_fn

    def code(self, kernel: Kernel) -> tuple[OwnedAddress, int]:
        """See `Engine.code`."""
        return self.inner.code(kernel)

    def sweeper(
        self, cases: CaseColumns, method: str, result: BlockResult, constants: FloatArray, share: int
    ) -> CaseRun | None:
        """See `Engine.sweeper`: cases pass their stops in the loop of the inner engine."""
        knots = cases.inputs is not None and not self.inner.passes_stops
        if knots or cases.carried is not None:
            return None
        t0, t1 = (np.broadcast_to(span, cases.count) for span in cases.spans)
        p = np.empty((cases.count, len(cases.parameters)))
        for i, column in enumerate(cases.parameters):
            p[:, i] = column
        found = self._stopping(p, t0, t1, cases.t_eval)
        run = self.inner.sweeper(found.columns(cases), method, result, constants, share)
        if run is None or not np.any(found.bad):
            return run

        def finish() -> None:
            run.finish()
            result.ends[found.bad, 0] = t0[found.bad]

        return replace(run, finish=finish)

    def _stopping(self, p: FloatArray, t0: FloatArray, t1: FloatArray, t_eval: FloatArray) -> Stopping:
        return Stopping.of(self._program, p, (t0, t1), t_eval, self.sampling, self.landing)

    def integrate_block(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        """See `Engine.integrate_block`: side by side from stop to stop where the engine can, else one by one."""
        knots = block.inputs is not None and not self.inner.passes_stops
        if self._program.conditions is None and not knots and self.sampling is None:
            self.inner.integrate_block(block, method, result)
        elif self.inner.whole_blocks and not (knots or len(block.t_eval) or block.watch):
            p, (t0, t1) = block.c[:, : len(self._program.layout.parameters)], block.spans.T
            found = self._stopping(p, t0, t1, block.t_eval)
            SegmentRounds(self.inner, block, found).run(method, result)
        else:
            self._one_by_one(block, method, result)

    def _one_by_one(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        """Write the results of many cases, of which one whose controllers have no instants fails alone."""
        if self.sampling is None:
            super().integrate_block(block, method, result)
            return
        for i in range(len(block.y)):
            one = slice(i, i + 1)
            inputs = None if block.inputs is None else block.inputs.part(one, len(block.y))
            part = replace(block, y=block.y[one], c=block.c[one], spans=block.spans[one], inputs=inputs)
            try:
                super().integrate_block(part, method, result[one])
            except NoInstants:
                result.y[i], result.samples[i] = block.y[i], np.nan
                result.ends[i] = block.spans[i, 0], float(Status.NON_FINITE), 0.0
