"""Runs cut at the times at which conditions on time change, and chained.

Along a segment such conditions hold or not, whatever time a stage is evaluated at, and a step ends at each of its
ends. This is the one place where runs are cut: every kind of run asks an engine, and `SegmentedEngine` is one that asks
another for each segment. Scenes without such conditions have no such engine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, cast, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..codegen.base import Engine, Final, Prepared, PreparedStates
from ..integrators.breakpoints import break_times, break_times_of_cases
from ..integrators.cases import BlockResult, CaseBlock, CaseColumns
from ..integrators.problem import (
    DenseOutput,
    IntegrationProblem,
    JoinedOutput,
    PiecewisePolynomial,
    Solution,
    prescribed,
)
from ..integrators.segments import Segments
from ..ir.conditions import Conditions
from ..ir.interpret import interpret
from ..ir.kernel import Assignment, Kernel, Load
from ..ir.program import Program
from ..methods.status import Status
from ..reduction.starting import Start
from .inputs import prepare_rows

if TYPE_CHECKING:
    from ..codegen.base import CaseRun, FunctionEngine, TracedEngine

__all__ = ["SegmentedEngine", "at_time", "segmented", "segments_of", "starting_constants"]

Landing = Callable[[float, FloatArray, FloatArray, FloatArray], FloatArray]
"""From a time, a state (n_y,) and the constants (n_c,) before and after it to the state with which the run goes on."""

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


def segmented(engine: Engine, program: Program, landing: Landing | None = None) -> Engine:
    """Return an engine that ends steps where conditions on time change, or the engine itself where there are none.

    `landing` gives the state with which a run goes on from a break; None leaves it as it is.
    """
    return engine if program.conditions is None else SegmentedEngine(engine, program, landing)


@final
class SegmentedEngine(Engine):
    """An engine that runs every segment with another."""

    def __init__(self, inner: Engine, program: Program, landing: Landing | None = None) -> None:
        self.inner, self._program, self.landing = inner, program, landing
        self._kept: dict[tuple[bytes, float, float], Segments] = {}
        self.parallel, self.whole_blocks = inner.parallel, inner.whole_blocks  # type: ignore[misc]

    cuts: ClassVar[bool] = True

    @property
    def _conditions(self) -> Conditions:
        assert self._program.conditions is not None
        return self._program.conditions

    def segments(self, problem: IntegrationProblem) -> Segments:
        """Return the segments of a problem."""
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
        return found

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
        parts = _parts(problem, self.segments(problem))
        return self.inner.fit(replace(next(parts), t_eval=None), method)

    def integrate(self, problem: IntegrationProblem, method: str) -> Solution:
        """See `Engine.integrate`."""
        run = partial(self.inner.integrate, method=method)
        return _chained(run, problem, self.segments(problem), self.landing)

    def integrate_automatic(self, problem: IntegrationProblem, method: str) -> tuple[Solution, str, str]:
        """See `Engine.integrate_automatic`: what one segment found unfit the others do not try."""
        taken, notes = method, ""

        def run(part: IntegrationProblem) -> Solution:
            nonlocal taken, notes
            if taken != method:
                return self.inner.integrate(part, taken)
            solution, taken, notes = self.inner.integrate_automatic(part, method)
            return solution

        return _chained(run, problem, self.segments(problem), self.landing), taken, notes

    def step_blocks(self, problem: IntegrationProblem, method: str) -> Iterator[Solution]:
        """See `Engine.step_blocks`; none of them reaches beyond its segment."""
        y, left, first = problem.y0, problem.max_steps, problem.first_step
        whole = replace(problem, t_eval=None)
        before: FloatArray | None = None
        for part in _parts(whole, self.segments(problem)):
            status = Status.SUCCESS
            if before is not None and self.landing is not None and len(y):
                y = self.landing(part.t0, y, before, part.constants)
            before = part.constants
            own = replace(part, y0=y, max_steps=left, first_step=first)
            for block in self.inner.step_blocks(own, method) if len(y) else [prescribed(own)]:
                status = Status(block.status)
                left -= block.steps + block.rejected
                y = block.y[-1] if len(block.y) else y
                yield block
            if status is not Status.SUCCESS or left <= 0:
                return
            first = None

    def prepared(
        self, problem: IntegrationProblem, method: str, constants: Callable[[FloatArray], FloatArray]
    ) -> Prepared:
        """See `Engine.prepared`: runs without a break are prepared, others are chained."""
        conditions = self._program.conditions
        assert conditions is not None
        whole = self.inner.prepared(problem, method, constants)
        middle = problem.t0 + 0.5 * (problem.t1 - problem.t0)

        unbroken: dict[bytes, bool] = {}

        def run(state: FloatArray, p: FloatArray) -> Final:
            p = p.copy()
            conditions.decide_at(p, middle)
            key = p.tobytes()
            if key not in unbroken:
                unbroken.clear()
                unbroken[key] = len(break_times(conditions, p, problem.t0, problem.t1)) == 0
            if unbroken.get(key):
                return whole(state, p), whole.status()
            own = replace(problem, y0=state, constants=constants(p), t_eval=np.array([problem.t1]))
            solution = self.integrate(own, method)
            return (solution.y[-1] if len(solution.y) else np.full_like(state, np.nan)), Status(solution.status)

        return PreparedStates(run)

    @property
    def vector_field(self) -> Callable[[Any, Any, Any], Any]:
        """See `TracedEngine.vector_field`."""
        return cast("TracedEngine", self.inner).vector_field

    def solve_fn(self, start: Start | None, method: str, options: Mapping[str, Any]) -> Any:
        """See `TracedEngine.solve_fn`."""
        return cast("TracedEngine", self.inner).solve_fn(start, method, options)

    def code(self, kernel: Kernel) -> tuple[int, int]:
        """See `Engine.code`."""
        return self.inner.code(kernel)

    def sweeper(
        self, cases: CaseColumns, method: str, result: BlockResult, constants: FloatArray, share: int
    ) -> CaseRun | None:
        """See `Engine.sweeper`: where nothing is decided, and nothing narrow happens in any case."""
        conditions = self._conditions
        columns = [cases.parameters[i] for i in sorted(conditions.parameters)]
        if conditions.decides or any(len(column) > 1 for column in (*cases.spans, *columns)):
            return None
        p = np.array([float(column[0]) if len(column) else 0.0 for column in cases.parameters])
        if len(break_times(conditions, p, float(cases.spans[0][0]), float(cases.spans[1][0]))):
            return None
        return self.inner.sweeper(cases, method, result, constants, share)

    def integrate_block(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        """See `Engine.integrate_block`: side by side a segment at a time where the engine can, else one by one."""
        if block.watch is None and _Rounds(self, block, method, result).run():
            return
        super().integrate_block(block, method, result)


def _parts(problem: IntegrationProblem, segments: Segments) -> Iterator[IntegrationProblem]:
    """Yield the problem of each segment; one with times to record records its end, too, one without its steps."""
    edges, wanted = segments.edges, problem.t_eval
    forward = 1.0 if problem.t1 >= problem.t0 else -1.0
    places = None if wanted is None else np.searchsorted(forward * wanted, forward * edges[1:-1], side="left")
    bounds = None if places is None or wanted is None else [0, *places.tolist(), len(wanted)]
    for k in range(len(segments)):
        times = None
        if wanted is not None and bounds is not None and bounds[k] < bounds[k + 1]:
            times = np.append(wanted[bounds[k] : bounds[k + 1]], edges[k + 1])
        yield replace(
            problem,
            t0=float(edges[k]),
            t1=float(edges[k + 1]),
            constants=segments.constants[k],
            t_eval=times,
            first_step=problem.first_step if k == 0 else None,
        )


def _chained(
    integrate: Callable[[IntegrationProblem], Solution],
    problem: IntegrationProblem,
    segments: Segments,
    landing: Landing | None,
) -> Solution:
    """Return the solution of a problem, segment by segment."""
    if len(segments) == 1:
        return integrate(replace(problem, constants=segments.first))
    y, left = problem.y0, problem.max_steps
    done: list[Solution] = []
    recorded = problem.t_eval is not None
    before: FloatArray | None = None
    for part in _parts(problem, segments):
        if before is not None and landing is not None:
            y = landing(part.t0, y, before, part.constants)
        before = part.constants
        if left <= 0:
            done[-1] = replace(done[-1], status=Status.MAX_STEPS)
            break
        solution = integrate(replace(part, y0=y, max_steps=left))
        left -= solution.steps + solution.rejected
        if not solution.success:
            done.append(_asked(solution, part.t_eval, whole=True) if recorded else solution)
            break
        y = solution.y[-1]
        done.append(_asked(solution, part.t_eval) if recorded else solution)
    return _joined(done, recorded)


def _asked(solution: Solution, times: FloatArray | None, *, whole: bool = False) -> Solution:
    """Return a solution with the times that were asked for alone: without its end, and none where none were."""
    last = 0 if times is None else len(solution.t) - (not whole)
    near = None if solution.near is None else solution.near[:last]
    end = solution.end
    if end is None and len(solution.t):
        end = float(solution.t[-1])
    return replace(solution, t=solution.t[:last], y=solution.y[:last], near=near, end=end)


def _joined(done: Sequence[Solution], recorded: bool) -> Solution:
    """Return solutions that follow each other as one; what accepted steps share is kept once."""
    first = [0 if recorded or k == 0 else 1 for k in range(len(done))]
    near = None
    if any(part.near is not None for part in done):
        near = np.concatenate(
            [(part.y if part.near is None else part.near)[i:] for i, part in zip(first, done, strict=True)]
        )
    return Solution(
        status=done[-1].status,
        t=np.concatenate([part.t[i:] for i, part in zip(first, done, strict=True)]),
        y=np.concatenate([part.y[i:] for i, part in zip(first, done, strict=True)]),
        steps=sum(part.steps for part in done),
        rejected=sum(part.rejected for part in done),
        evaluations=sum(part.evaluations for part in done),
        dense=_dense([part.dense for part in done]),
        near=near,
        end=done[-1].end,
    )


def _dense(parts: Sequence[DenseOutput | None]) -> DenseOutput | None:
    """Return continuous outputs that follow each other as one; None where there is none."""
    found = [part for part in parts if part is not None and len(part.knots) > 1]
    if not found:
        return parts[0]
    polynomials = [part for part in found if isinstance(part, PiecewisePolynomial)]
    if len(polynomials) == len(found) and len({part.coefficients.shape[1] for part in polynomials}) == 1:
        knots = np.concatenate([found[0].knots[:1], *(part.knots[1:] for part in found)])
        return PiecewisePolynomial(knots, np.concatenate([part.coefficients for part in polynomials]))
    edges = np.array([float(found[0].knots[0]), *(float(part.knots[-1]) for part in found)])
    return JoinedOutput(edges, found)


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
        assert program.conditions is not None
        self.inner, self.program, self.block, self.method, self.result = engine.inner, program, block, method, result
        self.landing = engine.landing
        self.conditions = program.conditions
        self.p = block.c[:, : len(program.layout.parameters)].copy()
        self.start = _going_on(len(program.layout.state))
        self.starts, self.breaks = break_times_of_cases(
            program.conditions, self.p, block.spans[:, 0], block.spans[:, 1]
        )

    def run(self) -> bool:
        """Run all cases; return whether that could be done."""
        block, result = self.block, self.result
        some = np.arange(len(block.y))
        now, y = block.spans[:, 0].copy(), block.y.copy()
        result.ends[:] = 0.0
        k = 0
        while len(some):
            left = self.starts[some + 1] - self.starts[some]
            further = k < left
            ends = block.spans[some, 1].copy()
            ends[further] = self.breaks[self.starts[some[further]] + k]
            if k and self.landing is not None:
                self._land(some, now, ends, y, k)
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
            before, after = _prepared(self.program, self.p[i], middles)
            y[i] = self.landing(float(now[i]), y[i], before, after)

    def _round(
        self, some: NDArray[np.intp], t0: FloatArray, t1: FloatArray, y: FloatArray, k: int
    ) -> BlockResult | None:
        block = self.block
        p = self.p[some]
        self.conditions.decide_at(p, t0 + 0.5 * (t1 - t0))
        wanted = block.t_eval
        forward = 1.0 if block.spans[0, 1] >= block.spans[0, 0] else -1.0
        lowest, highest = np.min(forward * t0), np.max(forward * t1)
        chosen = np.flatnonzero((forward * wanted >= lowest) & (forward * wanted <= highest))
        times = wanted[chosen]
        done = BlockResult.empty(len(some), y.shape[1], len(times))
        if not self._step(p, y, t0, t1, times, done):
            return None
        if len(times):
            own = (forward * times >= forward * t0[:, np.newaxis]) & (forward * times <= forward * t1[:, np.newaxis])
            own &= forward * times <= forward * done.ends[:, :1]
            rows, columns = np.nonzero(own)
            self.result.samples[some[rows], chosen[columns]] = done.samples[rows, columns]
        return done

    def _step(
        self, p: FloatArray, y: FloatArray, t0: FloatArray, t1: FloatArray, times: FloatArray, done: BlockResult
    ) -> bool:
        """Run cases from states to the ends of their segments; return whether the engine does that side by side."""
        block = self.block
        limits = block.rtol, block.atol, block.max_step, block.max_steps
        columns = CaseColumns(
            len(p),
            (np.ascontiguousarray(t0), np.ascontiguousarray(t1)),
            tuple(np.ascontiguousarray(column) for column in p.T),
            tuple(np.ascontiguousarray(column) for column in y.T),
            self.start,
            times,
            *limits,
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
        self.inner.integrate_block(CaseBlock(y, c, spans, times, *limits), self.method, done)
        return True
