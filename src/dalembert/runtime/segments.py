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
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..codegen.base import Engine, Final, Prepared, PreparedStates
from ..integrators.breakpoints import break_times, break_times_of_cases
from ..integrators.cases import BlockResult, CaseBlock, CaseColumns
from ..integrators.chaining import Landing, between_knots, blocks_between_knots, chained, chained_blocks, parts_of
from ..integrators.input_records import InputRecords
from ..integrators.problem import IntegrationProblem, SamplingClock, Solution
from ..integrators.segments import KnotSegments, Segments
from ..ir.conditions import Conditions
from ..ir.interpret import interpret
from ..ir.kernel import Assignment, Kernel, Load
from ..ir.program import Program
from ..methods.status import Status
from ..options import SolveOptions
from ..reduction.starting import Start
from .inputs import prepare_rows
from .sampling import NoInstants, Sampling

if TYPE_CHECKING:
    from ..codegen.base import CaseRun, FunctionEngine, TracedEngine

__all__ = ["SegmentedEngine", "at_time", "segmented", "segments_of", "starting_constants"]

_NO_CONDITIONS = Conditions(None, (), (), (), ())
_FEW = 32
_MOST_KEPT = 16


def segments_of(program: Program, c: FloatArray, t0: float, t1: float) -> Segments:
    """Return the segments of a run of a program with conditions from t0 to t1, of constants (n_c,) as of any time.

    Raises
    ------
    BreakTimesError
        Where there are too many.
    """
    conditions = program.conditions
    assert conditions is not None
    p = c[: len(program.layout.parameters)]
    breaks = break_times(conditions, p, t0, t1)
    edges = np.concatenate([[t0], breaks, [t1]])
    return Segments(edges, _prepared(program, p, edges[:-1] + 0.5 * np.diff(edges)))


def _prepared(program: Program, p: FloatArray, middles: FloatArray) -> FloatArray:
    """Return the constants (m, n_c) of parameters (n_p,) with conditions decided at times (m,)."""
    assert program.conditions is not None
    rows = np.tile(p, (len(middles), 1))
    program.conditions.decide_at(rows, middles)
    if len(rows) > _FEW:
        return prepare_rows(program, rows)
    kernel = program.kernel("prepare")
    return np.array([interpret(kernel, {"p": row.tolist()}) for row in rows], dtype=float)


def starting_constants(program: Program, c: FloatArray, t0: float, t1: float) -> FloatArray:
    """Return the constants (n_c,) with which a run from t0 to t1 begins."""
    return c if program.conditions is None else segments_of(program, c, t0, t1).first


def at_time(program: Program, c: FloatArray, t: float) -> FloatArray:
    """Return the constants (n_c,) with conditions decided at t."""
    if program.conditions is None:
        return c
    return _prepared(program, c[: len(program.layout.parameters)], np.array([t]))[0]


def segmented(
    engine: Engine, program: Program, landing: Landing | None = None, sampling: Sampling | None = None
) -> Engine:
    """Return an engine that ends steps where functions of time break, or the engine itself where it does so.

    `landing` gives the state with which a run goes on from a break of a condition; None leaves it as it is.
    `sampling` is what controllers do at their instants.
    """
    if program.conditions is None and sampling is None and (engine.follows_inputs or not program.layout.inputs):
        return engine
    return SegmentedEngine(engine, program, landing, sampling)


@final
class SegmentedEngine(Engine):
    """An engine that runs every segment with another."""

    def __init__(
        self, inner: Engine, program: Program, landing: Landing | None = None, sampling: Sampling | None = None
    ) -> None:
        self.inner, self._program, self.landing, self.sampling = inner, program, landing, sampling
        self._kept: dict[tuple[bytes, float, float], Segments] = {}
        self.parallel, self.whole_blocks = inner.parallel, inner.whole_blocks  # type: ignore[misc]

    cuts: ClassVar[bool] = True

    @property
    def _conditions(self) -> Conditions:
        return self._program.conditions or _NO_CONDITIONS

    @property
    def follows_inputs(self) -> bool:
        """See `Engine.follows_inputs`."""
        return True

    def _following(
        self, integrate: Callable[[IntegrationProblem], Solution]
    ) -> Callable[[IntegrationProblem], Solution]:
        """Return what integrates problems whose inputs have knots."""
        return integrate if self.inner.follows_inputs else between_knots(integrate)

    def segments(self, problem: IntegrationProblem) -> Segments:
        """Return the segments of a problem between changes of its conditions, and instants of controllers."""
        found = self._unsampled(problem)
        if self.sampling is None:
            return found
        wanted = problem.t_eval if problem.sampled is None else problem.sampled.wanted
        schedule = self.sampling.schedules(problem.constants[np.newaxis])[0]
        return found.cut(*self.sampling.instants(schedule, problem.t0, problem.t1, problem.sampled, wanted))

    def begun(self, problem: IntegrationProblem) -> IntegrationProblem:
        """See `Engine.begun`."""
        if self.sampling is None:
            return problem
        own = replace(problem, sampled=SamplingClock(problem.t0, wanted=problem.t_eval))
        return self._begun(own, self.segments(own))[0]

    def _begun(self, problem: IntegrationProblem, segments: Segments) -> tuple[IntegrationProblem, Landing | None]:
        """Return a problem after what controllers do at its start, and what happens at the breaks of it, in order."""
        sampling, impulses = self.sampling, self.landing
        if sampling is None:
            return problem, impulses
        acts, program, clock = iter(segments.acts), self._program, problem.sampled

        def act(t: float, y: FloatArray, c: FloatArray) -> FloatArray:
            number = next(acts)
            if number and clock is not None:
                clock.last = t
            return sampling.act(number, t, y, at_time(program, c, t))

        def landing(t: float, y: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
            return act(t, y if impulses is None else impulses(t, y, before, after), after)

        return replace(problem, y0=act(problem.t0, problem.y0, segments.of(0))), landing

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

    def course(self, problem: IntegrationProblem) -> Segments:
        """See `Engine.course`."""
        return self.segments(problem)

    def accept_as_static(self, kind: type) -> None:
        """See `Engine.accept_as_static`."""
        self.inner.accept_as_static(kind)

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
        rows = _prepared(self._program, c[: len(self._program.layout.parameters)], t)
        return self.inner.rows(self._program.kernel(kernel), t, y, rows)

    def rows(self, kernel: Kernel, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """See `Engine.rows`."""
        return self.inner.rows(kernel, t, y, c)

    def automatic(self, methods: Sequence[str], rtol: float, atol: float, *, many: bool = False) -> str:
        """See `Engine.automatic`."""
        return self.inner.automatic(methods, rtol, atol, many=many)

    def prepare(self, problem: IntegrationProblem, method: str) -> None:
        """See `Engine.prepare`."""
        self.inner.prepare(problem, method)

    def fit(self, problem: IntegrationProblem, method: str) -> tuple[str, str]:
        """See `Engine.fit`: the first segment decides."""
        try:
            segments = self.segments(problem)
        except NoInstants:  # of a case whose controllers have no instants, which is told where it is run
            segments = self._unsampled(problem)
        part = replace(next(parts_of(problem, segments)), t_eval=None)
        if part.inputs is not None and not self.inner.follows_inputs:
            part = next(parts_of(part, KnotSegments(part)))
        return self.inner.fit(part, method)

    def integrate(self, problem: IntegrationProblem, method: str) -> Solution:
        """See `Engine.integrate`."""
        run, segments = self._following(partial(self.inner.integrate, method=method)), self.segments(problem)
        begun, landing = self._begun(problem, segments)
        return chained(run, begun, segments, landing, right=self.sampling is not None)

    def integrate_automatic(self, problem: IntegrationProblem, method: str) -> tuple[Solution, str, str]:
        """See `Engine.integrate_automatic`: what one segment found unfit the others do not try."""
        taken, notes = method, ""

        def run(part: IntegrationProblem) -> Solution:
            nonlocal taken, notes
            if taken != method:
                return self.inner.integrate(part, taken)
            solution, taken, notes = self.inner.integrate_automatic(part, method)
            return solution

        segments = self.segments(problem)
        begun, landing = self._begun(problem, segments)
        found = chained(self._following(run), begun, segments, landing, right=self.sampling is not None)
        return found, taken, notes

    def step_blocks(self, problem: IntegrationProblem, method: str) -> Iterator[Solution]:
        """See `Engine.step_blocks`; none of them reaches beyond its segment."""
        segments = self.segments(problem)
        problem, landing = self._begun(problem, segments)
        parts = parts_of(replace(problem, t_eval=None), segments)

        def step_blocks(part: IntegrationProblem) -> Iterator[Solution]:
            if self.inner.follows_inputs:
                return self.inner.step_blocks(part, method)
            return blocks_between_knots(partial(self.inner.step_blocks, method=method), part)

        yield from chained_blocks(parts, problem, step_blocks, landing, lambda k: segments.of(k, ending=True))

    def prepared(
        self, problem: IntegrationProblem, method: str, constants: Callable[[FloatArray], FloatArray]
    ) -> Prepared:
        """See `Engine.prepared`: runs without a break are prepared, others are chained."""
        conditions, knots = self._conditions, problem.inputs is not None and not self.inner.follows_inputs
        whole = self.inner.prepared(replace(problem, inputs=None) if knots else problem, method, constants)
        middle = problem.t0 + 0.5 * (problem.t1 - problem.t0)

        unbroken: dict[bytes, bool] = {}

        def run(state: FloatArray, p: FloatArray) -> Final:
            p = p.copy()
            conditions.decide_at(p, middle)
            key = p.tobytes()
            if key not in unbroken:
                unbroken.clear()
                unbroken[key] = len(break_times(conditions, p, problem.t0, problem.t1)) == 0
            if unbroken.get(key) and not knots and self.sampling is None:
                return whole(state, p), whole.status()
            own = replace(problem, y0=state, constants=constants(p), t_eval=np.array([problem.t1]))
            solution = self.integrate(own, method)
            return (solution.y[-1] if len(solution.y) else np.full_like(state, np.nan)), Status(solution.status)

        return PreparedStates(run)

    @property
    def vector_field(self) -> Callable[[Any, Any, Any], Any]:
        """See `TracedEngine.vector_field`."""
        return cast("TracedEngine", self.inner).vector_field

    @property
    def state_functions(self) -> Any:
        """See `TracedEngine.state_functions`."""
        return cast("TracedEngine", self.inner).state_functions

    def solve_fn(self, start: Start | None, options: SolveOptions) -> Any:
        """See `TracedEngine.solve_fn`."""
        return cast("TracedEngine", self.inner).solve_fn(start, options)

    def code(self, kernel: Kernel) -> tuple[int, int]:
        """See `Engine.code`."""
        return self.inner.code(kernel)

    def sweeper(
        self, cases: CaseColumns, method: str, result: BlockResult, constants: FloatArray, share: int
    ) -> CaseRun | None:
        """See `Engine.sweeper`: where nothing is decided, and nothing narrow happens in any case."""
        conditions = self._conditions
        if self.sampling is not None or (cases.inputs is not None and not self.inner.follows_inputs):
            return None
        columns = [cases.parameters[i] for i in sorted(conditions.parameters)]
        if conditions.decides or any(len(column) > 1 for column in (*cases.spans, *columns)):
            return None
        p = np.array([float(column[0]) if len(column) else 0.0 for column in cases.parameters])
        if len(break_times(conditions, p, float(cases.spans[0][0]), float(cases.spans[1][0]))):
            return None
        return self.inner.sweeper(cases, method, result, constants, share)

    def integrate_block(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        """See `Engine.integrate_block`: side by side a segment at a time where the engine can, else one by one."""
        knots = block.inputs is not None and not self.inner.follows_inputs
        if self._program.conditions is None and not knots and self.sampling is None:
            self.inner.integrate_block(block, method, result)
        elif knots or block.watch is not None or not _Rounds(self, block, method, result).run():
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


def _going_on(states: int) -> Start:
    """Return what starts cases from states."""
    loads = tuple(Load(f"y_{i}", "y", i) for i in range(states))
    body = tuple(Assignment(f"z_{i}", "add", (f"y_{i}", 0.0)) for i in range(states))
    kernel = Kernel("start", ("t", "y", "c"), loads, body, tuple(f"z_{i}" for i in range(states)))
    return Start(kernel, tuple(f"component {i}" for i in range(states)), ())


@final
class _Rounds:
    """Many cases, of which every round takes those that are left through their next segment, side by side."""

    def __init__(self, engine: SegmentedEngine, block: CaseBlock, method: str, result: BlockResult) -> None:
        program = engine._program
        self.inner, self.program, self.block, self.method, self.result = engine.inner, program, block, method, result
        self.landing, self.sampling = engine.landing, engine.sampling
        self.conditions = engine._conditions
        self.p = block.c[:, : len(program.layout.parameters)].copy()
        self.start = _going_on(len(program.layout.state))
        self.starts, self.breaks = break_times_of_cases(self.conditions, self.p, block.spans[:, 0], block.spans[:, 1])
        self.acts, self.bad = np.zeros(0, np.int64), np.zeros(len(block.y), np.bool_)
        if self.sampling is not None:
            self._sample(self.sampling)

    def _sample(self, sampling: Sampling) -> None:
        """Add the instants of controllers to the breaks, and to the cases what happens at their starts.

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

    def _act(self, some: NDArray[np.intp], now: FloatArray, y: FloatArray, k: int) -> None:
        """Let controllers act where the segments k of cases begin."""
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
        result.ends[:] = 0.0
        result.y[self.bad], result.samples[self.bad] = block.y[self.bad], np.nan
        result.ends[self.bad, :2] = np.column_stack([now, np.full(len(now), float(Status.NON_FINITE))])[self.bad]
        k = 0
        while len(some):
            left = self.starts[some + 1] - self.starts[some]
            further = k < left
            ends = block.spans[some, 1].copy()
            ends[further] = self.breaks[self.starts[some[further]] + k]
            if k and self.landing is not None:
                self._land(some, now, ends, y, k)
            if self.sampling is not None:
                self._act(some, now, y, k)
            done = self._round(some, now[some], ends, y[some], k)
            if done is None:
                return False
            t, status, steps = done.ends.T
            now[some], y[some] = t, done.y
            result.y[some] = done.y
            result.ends[some, 0], result.ends[some, 1] = t, status
            result.ends[some, 2] += steps
            spent = further & (status == Status.SUCCESS) & (result.ends[some, 2] >= block.max_steps)
            result.ends[some[spent], 1] = float(Status.MAX_STEPS)
            some = some[further & (status == Status.SUCCESS) & ~spent]
            k += 1
        return True

    def _land(self, some: NDArray[np.intp], now: FloatArray, ends: FloatArray, y: FloatArray, k: int) -> None:
        """Let the states of cases at a break be those with which they go on."""
        assert self.landing is not None
        for i, end in zip(some.tolist(), ends.tolist(), strict=True):
            first = self.breaks[self.starts[i] + k - 2] if k > 1 else self.block.spans[i, 0]
            middles = 0.5 * np.array([first + now[i], now[i] + end])
            both = _prepared(self.program, self.p[i], middles)
            if self.block.inputs is not None:
                forward = self.block.spans[i, 1] >= self.block.spans[i, 0]
                times, after = np.full(2, now[i]), np.array([not forward, forward])
                self.block.inputs.write(both, times, np.full(2, i), after)
            before, after_ = both
            y[i] = self.landing(float(now[i]), y[i], before, after_)

    def _round(
        self, some: NDArray[np.intp], t0: FloatArray, t1: FloatArray, y: FloatArray, k: int
    ) -> BlockResult | None:
        block = self.block
        p = self.p[some]
        self.conditions.decide_at(p, t0 + 0.5 * (t1 - t0))
        inputs = None if block.inputs is None else block.inputs.part(some, len(block.y))
        if inputs is not None:
            inputs.write(p, t0, np.arange(len(some)), t1 >= t0)
        wanted = block.t_eval
        forward = 1.0 if block.spans[0, 1] >= block.spans[0, 0] else -1.0
        lowest, highest = np.min(forward * t0), np.max(forward * t1)
        chosen = np.flatnonzero((forward * wanted >= lowest) & (forward * wanted <= highest))
        times = wanted[chosen]
        done = BlockResult.empty(len(some), y.shape[1], len(times))
        if not self._step(p, y, (t0, t1), times, done, inputs):
            return None
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
            inputs=inputs,
        )
        run: CaseRun | None = self.inner.sweeper(columns, self.method, done, np.empty((0, 0)), len(p))
        if run is not None:
            run.work()
            run.finish()
            return True
        if not self.inner.whole_blocks or len(block.t_eval):
            return False
        c = prepare_rows(self.program, p)
        spans = np.stack([t0, t1], axis=1)
        self.inner.integrate_block(CaseBlock(y, c, spans, times, *limits, inputs=inputs), self.method, done)
        return True
