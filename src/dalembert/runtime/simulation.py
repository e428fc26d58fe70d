"""Single trajectories of a compiled model."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import FloatArray
from ..codegen.base import Engine, Prepared, PreparedStates
from ..errors import OptionError, nesting_named
from ..integrators.event_code import EventCode
from ..integrators.events import Occurrence, integrate_watched
from ..integrators.problem import IntegrationProblem, Solution, prescribed
from ..ir.interpret import interpret_rows
from ..methods.status import Status
from ..once import derived_once, derived_property
from ..reduction.gimbal import Gimbals, gimbals
from ..reduction.invariants import Candidates, candidates
from ..reduction.keeping import refuse_formulation
from ..results.estimate import TIGHTER
from ..results.motion import RunStatistics
from ..results.trajectory import Trajectory
from ..values import flag, option, times_of, tolerances, whole
from . import inputs
from .assembly import assembled
from .elapsed import asked, begins_elsewhere, elapsed_times, extension, noted_from, offset_values
from .evaluation import rows_of
from .gains import with_gains
from .gimbal import locked, remedy
from .held import NO_ESTIMATE, Held, span_of
from .impulses import impulses_of
from .keeping import kept_names, kept_values, refuse_jumps, refuse_unknown
from .monitors import conserved
from .prepared import PreparedRun
from .recording import Record
from .segments import SegmentedEngine, at_time, starting_constants
from .singular import indeterminate, judged, nearly_redundant, redundant, searched, singular_start, still_redundant
from .symbol_assumptions import warn_of_motion

if TYPE_CHECKING:
    from ..pipeline import Stages

__all__ = ["Simulated"]


class Simulated(Held):
    """A compiled model that simulates trajectories one at a time."""

    def __init__(self, stages: Stages, engine: Engine, methods: Mapping[str, str]) -> None:
        super().__init__(stages, engine, methods)
        self._note = ""
        self._dropped: tuple[int, ...] = ()
        self._fewer: dict[tuple[int, ...], Simulated] = {}
        rows = range(len(self.layout.constraints))
        reduced = stages.reduced
        self._enforced = () if reduced.regular else tuple(i for i in rows if i not in reduced.left_out)
        self._keepers: dict[tuple[str, ...], Simulated] = {}
        self._impulses = impulses_of(stages.equations, stages.program)
        if isinstance(engine, SegmentedEngine) and self._impulses is not None:
            engine.landing = self._landed
        self._counters: dict[tuple[Any, ...], Simulated] = {}

    @derived_property
    def _gimbals(self) -> Gimbals | None:
        """The angles that may lock, found when a run is first judged."""
        return gimbals(self.stages.reduced)

    def _landed(self, t: float, y: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return the state with which a run goes on from a break."""
        assert self._impulses is not None
        time = np.array([t])
        x = interpret_rows(self._program.kernel("expand"), time, y[np.newaxis], before)
        rates = self._impulses.rates(t, x[0], before, after)
        if rates is None:
            return y
        names = (*self.layout.coordinates, *self.layout.rates)
        x[0, len(self.layout.coordinates) :] = rates
        start = self._start(names)
        given = x[:, [names.index(name) for name in start.given]]
        return interpret_rows(start.kernel, time, given, after)[0, : len(y)]

    def _judged(self, problem: IntegrationProblem, method: str, solution: Solution) -> tuple[Solution, str]:
        """Return a run ended where its angles lock or its constraints lose rank, and a note on where that is."""
        if self._gimbals is None and not self._enforced:
            return solution, ""
        c, steps, span = problem.constants, self._steps(problem, method, solution), (problem.t0, problem.t1)
        if self._gimbals is not None:
            solution, where = locked(self._program, self._gimbals, solution, c, steps, span)
            if where:
                return solution, f"{where}; {remedy(self.stages.scene)}"
        if self._enforced:
            where = ""
            if solution.status is not Status.SINGULAR_CONFIGURATION:
                solution, where = judged(self._program, solution, c, self._enforced, steps, span)
            loose = indeterminate(self._program, problem.t0, problem.y0, c)
            return solution, "; ".join(text for text in (where, loose) if text)
        return solution, ""

    def _steps(self, problem: IntegrationProblem, method: str, solution: Solution) -> Solution:
        """Return a run with its accepted steps for records, as far as that says more of it.

        Of a run that failed they are integrated once more, from what it recorded last.
        """
        if problem.t_eval is None or not self.layout.state:
            return solution
        if solution.dense is not None:
            return replace(solution, t=solution.dense.knots, y=solution.dense(solution.dense.knots))
        if solution.success:
            return solution
        t, y = (solution.t[-1], solution.y[-1]) if len(solution.t) else (problem.t0, problem.y0)
        again = self._engine.integrate(replace(problem, t0=float(t), y0=y, t_eval=None, first_step=None), method)
        t, y = np.concatenate([solution.t, again.t]), np.concatenate([solution.y, again.y])
        return replace(solution, t=t, y=y)

    @nesting_named
    def simulate(
        self,
        t_span: tuple[float, float],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        t_eval: Any = None,
        method: str = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
        first_step: float | None = None,
        max_step: float = np.inf,
        max_steps: int = 1_000_000,
        dense: bool = True,
        error_estimate: bool = False,
        events: Any = (),
        project_invariants: Any = False,
    ) -> Trajectory:
        """Simulate one trajectory.

        Parameters
        ----------
        t_span : (float, float)
            Start and end [s]; the end may lie before the start. A run is computed in the time since its start, so that
            what is rounded of late times is no more than each ``t - t0`` as given, and the times of events, which are
            rounded to doubles: 2e-7 s where seconds are counted from 1970. A scene that contains time itself is
            compiled once more for runs whose times are more than 16 times as large as their spans.
        initial : mapping of symbols or names to numbers
            Coordinates and rates at the start. A rate is ``x.diff()`` or ``"x_dot"``. What the constraints fix may
            be left out.
        parameters : mapping of symbols or names to numbers
            Every parameter of the scene.
        t_eval : array_like (n_t,), optional
            Times to record; without it, the accepted steps.
        method : str
            A name in `methods`, or "auto".
        rtol, atol : float
            Tolerances of the local error of every component of the state.
        first_step, max_step : float, optional
            First and largest step [s].
        max_steps : int
            Attempted steps after which the run ends with a status.
        dense : bool
            Whether the trajectory can be evaluated between the recorded times.
        error_estimate : bool
            Whether to run a twin at a hundredth of the tolerances beside it, from which
            ``trajectory.error_estimate["x"]`` estimates the global error of anything at the recorded times.
        events : sequence of Event, SymPy expressions or names
            What to watch for: sign changes, all of them, located to rounding; see `Event`. They are in
            ``trajectory.events``, by name. A sign change at the very start is none.
        project_invariants : bool, str or sequence of str
            First integrals to keep at their initial values by a correction after every step, together with the
            constraints: names as in ``trajectory.invariants``, or True for all that are conserved.

        Returns
        -------
        Trajectory
            Numerical failure is its `status`, never an exception.

        Raises
        ------
        UnknownNameError, ValueInputError, InitialStateError, OptionError, ExpressionError
            For input that is wrong, each naming what, what is allowed and what to do.
        """
        options: dict[str, Any] = {"method": method, "rtol": rtol, "atol": atol, "first_step": first_step}
        options |= {"max_step": max_step, "max_steps": max_steps, "dense": flag("dense", dense)}
        options |= {"error_estimate": flag("error_estimate", error_estimate)}
        options |= {"project_invariants": project_invariants}
        t0, t1 = span_of(t_span)
        if not begins_elsewhere(t0, t1):
            return self._simulate((t0, t1), initial, parameters, t_eval=t_eval, events=events, **options)
        other, events, _ = self._counting(t0, t1, events)
        if other is None:
            return self._simulate((t0, t1), initial, parameters, t_eval=t_eval, events=events, **options)
        times = None if t_eval is None else times_of("t_eval", t_eval)
        own = elapsed_times(t0, t1, times)
        given = self._with_offsets(other, t0, parameters)
        run = other._simulate((0.0, t1 - t0), initial, given, t_eval=own, events=events, **options)
        return run.counted_from(t0, times, noted_from(run.stats.note, t0))

    def _counting(self, t0: Any, t1: Any, events: Any = (), reduce: Any = None) -> tuple[Simulated | None, Any, Any]:
        """Return the model that runs a span, or many, in the time since its start; None where time is left as it is.

        Events and reductions are returned as it takes them.
        """
        found = asked(self.stages.equations.symbols, (t0, t1), events, reduce)
        if found is None:
            return None, events, reduce
        if not found.other:
            return self, events, reduce
        if found.watched:
            self._events(events, reduce)  # what is wrong with them is said of them as they were given
        other = derived_once(self._counters, found.watched, lambda: self._in_elapsed_time(found.watched))
        return other, found.events, found.reductions

    def _with_offsets(self, other: Simulated, start: float, parameters: Mapping[Any, Any]) -> Mapping[Any, Any]:
        """Return parameters with those that another model of the scene has for a start."""
        offsets = other.stages.equations.symbols.offsets
        if not offsets:
            return parameters
        values = dict(zip(self.layout.parameters, self.parameter_vector(parameters).tolist(), strict=True))
        return {**parameters, **offset_values(offsets, start, values)}

    def _simulate(
        self,
        t_span: tuple[float, float],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        t_eval: Any = None,
        method: str = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
        first_step: float | None = None,
        max_step: float = np.inf,
        max_steps: int = 1_000_000,
        dense: bool = True,
        error_estimate: bool = False,
        events: Any = (),
        project_invariants: Any = False,
    ) -> Trajectory:
        """Simulate one trajectory, as `simulate` does, in the time of this model."""
        options: dict[str, Any] = {"t_eval": t_eval, "method": method, "rtol": rtol, "atol": atol}
        options |= {"first_step": first_step, "max_step": max_step, "max_steps": max_steps, "dense": dense}
        options |= {"events": events, "error_estimate": error_estimate}
        if project_invariants is not False:
            refuse_jumps(events, self.layout.aliases)
            keeper, further = self._keeping(project_invariants, span_of(t_span), initial, parameters)
            return keeper._simulate(t_span, initial, {**parameters, **further}, **options)
        begin = time.perf_counter()
        rtol, atol = tolerances(rtol, atol)
        chosen = self._method(method, rtol, atol)
        t0, t1 = span_of(t_span)
        divisible = self._divisible(t0, initial, parameters)
        if divisible is not self:
            return divisible._simulate(t_span, initial, parameters, **options)
        c = inputs.constants(self._program, self.parameter_vector(parameters))
        values = inputs.given_values(self.layout, initial)
        inputs.warn_below_floor(rtol, atol, self._program, chosen, stacklevel=4)
        c = starting_constants(self._program, c, t0, t1)
        problem = IntegrationProblem(
            t0=t0,
            t1=t1,
            y0=inputs.initial_state(self._start(values), t0, values, c, self._program),
            constants=c,
            rtol=rtol,
            atol=atol,
            t_eval=None if t_eval is None else times_of("t_eval", t_eval),
            first_step=None if first_step is None else option("first_step", first_step),
            max_step=option("max_step", max_step),
            max_steps=whole("max_steps", max_steps),
            dense=dense,
        )
        watch = self._events(events)
        if watch is not None and error_estimate:
            raise OptionError(NO_ESTIMATE)
        able = self._independent(problem, chosen, begin)
        if isinstance(able, Trajectory):
            return able
        if able is not self:
            return able._simulate(t_span, initial, parameters, **options)
        problem = with_gains(self._program, lambda pilot: self._engine.integrate(pilot, chosen), problem, parameters)
        run = self._run(problem, chosen, begin, watch, automatic=method == "auto")
        if error_estimate:
            finer = replace(
                problem, rtol=problem.rtol * TIGHTER, atol=problem.atol * TIGHTER, t_eval=run.t, dense=False
            )
            again = self._method(method, finer.rtol, finer.atol)
            twin = self._run(finer, again, time.perf_counter(), automatic=method == "auto")
            run.with_twin(twin)
        return run

    def _keeping(
        self, wanted: Any, span: tuple[float, float], initial: Mapping[Any, Any], parameters: Mapping[Any, Any]
    ) -> tuple[Simulated, dict[str, float]]:
        """Return the model that keeps first integrals after every step, and its further parameters for a start."""
        t0 = span[0]
        c = inputs.constants(self._program, self.parameter_vector(parameters))
        c = starting_constants(self._program, c, *span)
        values = inputs.given_values(self.layout, initial)
        y = inputs.initial_state(self._start(values), t0, values, c, self._program)
        keeper, names = self._keeper(wanted, c, t0, y)
        rows = c[np.newaxis], np.array([t0]), y[np.newaxis]
        found = kept_values(names, self._program, self._conservable, *rows)
        return keeper, {name: float(column[0]) for name, column in found.items()}

    def _keeper(self, wanted: Any, c: FloatArray, t0: float, y: FloatArray) -> tuple[Simulated, tuple[str, ...]]:
        """Return the model that keeps first integrals, compiled once for each set of them, and their names."""
        names = kept_names(wanted, self.stages.equations, self._program, self._conservable, c, t0, y)
        left_out = self.stages.reduced.left_out
        return derived_once(self._keepers, names, lambda: self._recompiled(left_out, names)), names

    def _prepared_by(self, other: Simulated, t_span: tuple[float, float], options: Mapping[str, Any]) -> PreparedRun:
        """Return a prepared run in the time since its start, by this model or another one of the scene."""
        t0, t1 = t_span
        kept = other.prepare((0.0, t1 - t0), **options)
        offsets = other.stages.equations.symbols.offsets
        if not offsets:
            return kept
        extended = extension(other.layout.parameters, self.layout.parameters, offsets, t0)

        def run(state: FloatArray, p: FloatArray) -> tuple[FloatArray, Status]:
            final = kept(state, extended(p))
            return final, kept.status

        return PreparedRun(PreparedStates(run), kept.method, self.layout, partial(self.prepare, t_span, **options))

    def _prepared_keeping(self, wanted: Any, t_span: tuple[float, float], options: Mapping[str, Any]) -> Prepared:
        """Return a prepared run that keeps first integrals, made when it is first called."""
        t, found = np.array([t_span[0]]), self._conservable
        made: dict[str, tuple[PreparedRun, tuple[str, ...]]] = {}

        def run(state: FloatArray, p: FloatArray) -> tuple[FloatArray, Status]:
            c = starting_constants(self._program, inputs.constants(self._program, p), *t_span)

            def make() -> tuple[PreparedRun, tuple[str, ...]]:
                keeper, names = self._keeper(wanted, c, t_span[0], state)
                return keeper.prepare(t_span, **options), names

            kept, names = derived_once(made, "run", make)
            further = kept_values(names, self._program, found, c[np.newaxis], t, state[np.newaxis], self._engine.rows)
            final = kept(state, np.concatenate([p, *further.values()]))
            return final, kept.status

        return PreparedStates(run)

    def _independent(self, problem: IntegrationProblem, method: str, begin: float) -> Simulated | Trajectory:
        """Return the model that enforces no constraint which follows from others around the start of a problem.

        Where only the start itself is singular, return the run that ends there.
        """
        if not self._enforced:
            return self
        where = (self._program, problem.t0, problem.y0, problem.constants, self._enforced)
        found = redundant(*where)
        note = singular_start(*where) if found is None else nearly_redundant(*where) if found else ""
        if found is None or note:
            statistics = RunStatistics(method, 0, 0, 0, 0.0, time.perf_counter() - begin, note)
            status = Status.SINGULAR_CONFIGURATION
            y0 = problem.y0[np.newaxis]
            t0 = np.array([problem.t0])
            if problem.t_eval is not None:
                t0 = problem.t_eval[problem.t_eval == problem.t0]
            run = Trajectory(
                self._program, problem.constants, status, t0, np.repeat(y0, len(t0), axis=0), statistics, None
            )
            return run.of_scene(self.stages.scene).with_monitors(self._monitors).ended_at(problem.t0)
        if not found:
            return self
        return self._without(found)

    def _divisible(self, t0: float, initial: Mapping[Any, Any], parameters: Mapping[Any, Any]) -> Simulated:
        """Return the model without the constraints that this one divides by something that vanishes at the parameters.

        Raises
        ------
        InitialStateError
            Where one of them does not follow from the others there.
        """
        if not self.stages.reduced.pivots:
            return self
        p = self.parameter_vector(parameters)
        values = inputs.given_values(self.layout, initial)
        labels = inputs.vanishing_pivots(self._start(values), t0, values, p)
        if not labels:
            return self
        fewer = self._without(tuple(self.layout.constraints.index(label) for label in labels))
        further = fewer._divisible(t0, initial, parameters)
        if further is not fewer:
            return further
        program, rows = fewer._program, range(len(self.layout.constraints))
        c = inputs.constants(program, p)
        y = inputs.initial_state(fewer._start(values), t0, values, c, program)
        left_out = fewer.stages.reduced.left_out
        rest = [i for i in rows if i not in left_out]
        found = redundant(program, t0, y, c, rows)
        follow = found is not None and len(found) == len(left_out) and redundant(program, t0, y, c, rest) == ()
        if not follow:
            raise inputs.pivots_vanish(self._program, p, labels)
        return fewer

    def _without(self, found: tuple[int, ...]) -> Simulated:
        """Return the model that does not enforce some constraints, compiled once for each set of them."""
        without = tuple(sorted({*found, *self.stages.reduced.left_out}))

        def make() -> Simulated:
            dropped = tuple(sorted({*found, *self._dropped}))
            labels = [self.layout.constraints[i] for i in dropped]
            fewer = self._recompiled(without)
            fewer._dropped = dropped
            fewer._note = f"not enforced, because it follows from the others around the start: {'; '.join(labels)}"
            return fewer

        return derived_once(self._fewer, without, make)

    def _run(
        self,
        problem: IntegrationProblem,
        method: str,
        begin: float,
        watch: EventCode | None = None,
        *,
        automatic: bool = False,
    ) -> Trajectory:
        """Integrate one problem; its run time counts from `begin`, less what was compiled.

        Where the method was chosen automatically, a stiff run without events changes to an implicit one.
        """
        ready = time.perf_counter()
        if self.layout.state:
            self._engine.prepare(problem, method)
        compiled = time.perf_counter() - ready
        note = ""
        occurrences: list[Occurrence] = []
        if watch is not None:
            if automatic and self.layout.state:
                method, note = self._engine.fit(problem, method)
            solution, occurrences = self._watched(problem, method, watch)
        elif not self.layout.state:
            solution = prescribed(problem)
        elif self._enforced and searched(self._program) and not problem.dense:
            if automatic:
                method, note = self._engine.fit(problem, method)
            solution, crossed = self._searched(problem, method)
            note = "; ".join(text for text in (note, crossed) if text)
        elif automatic:
            solution, method, note = self._engine.integrate_automatic(problem, method)
        else:
            solution = self._engine.integrate(problem, method)
        solution, where = self._judged(problem, method, solution)
        note = "; ".join(text for text in (note, where) if text)
        if self._note:
            tolerance = 1e3 * (problem.rtol + problem.atol)
            left_out, span = self.stages.reduced.left_out, (problem.t0, problem.t1)
            solution, broken = still_redundant(
                self._program, solution, problem.constants, left_out, max(tolerance, 1e-6), span
            )
            note = "; ".join(text for text in (self._note, note, broken) if text)
        statistics = RunStatistics(
            method=method,
            steps=solution.steps,
            rejected=solution.rejected,
            evaluations=solution.evaluations,
            compile_seconds=sum(self.stages.seconds.values()) + compiled,
            run_seconds=time.perf_counter() - begin - compiled,
            note=note,
        )
        c = self._engine.course(problem)
        run = Trajectory(self._program, c, solution.status, solution.t, solution.y, statistics, solution.dense)
        run.ended_at(solution.end)
        warn_of_motion(self.layout.assumptions, self.layout.coordinates, run.t, run.__getitem__)
        run.with_monitors(self._monitors).with_near(solution.near).of_scene(self.stages.scene)
        return run if watch is None else run.with_events(watch.labels, occurrences)

    def _from_state(
        self, t_span: tuple[float, float], y: FloatArray, c: FloatArray, options: Mapping[str, Any]
    ) -> Trajectory:
        """Simulate from a state (n_y,) with constants (n_c,), known to be right as the options of `simulate` are."""
        begin = time.perf_counter()
        tolerances = options["rtol"], options["atol"]
        problem = IntegrationProblem(
            t0=t_span[0],
            t1=t_span[1],
            y0=y,
            constants=c,
            rtol=tolerances[0],
            atol=tolerances[1],
            first_step=options["first_step"],
            max_step=options["max_step"],
            max_steps=options["max_steps"],
            dense=options["dense"],
        )
        chosen = self._method(options["method"], *tolerances)
        return self._run(problem, chosen, begin, automatic=options["method"] == "auto")

    def _searched(self, problem: IntegrationProblem, method: str) -> tuple[Solution, str]:
        """Integrate one problem without continuous output, ended where it crosses a lost rank, and a note on that."""
        record, where, span = Record(self._program, problem), "", (problem.t0, problem.t1)
        for part in self._engine.step_blocks(replace(problem, t_eval=None, dense=True), method):
            found, where = judged(self._program, part, problem.constants, self._enforced, part, span)
            record.add(found)
            if found.status is Status.SINGULAR_CONFIGURATION:
                break
        return record.solution(), where

    def _watched(self, problem: IntegrationProblem, method: str, watch: EventCode) -> tuple[Solution, list[Occurrence]]:
        """Integrate one problem with events."""

        def step_blocks(part: IntegrationProblem) -> Iterator[Solution]:
            if self.layout.state or self._engine.cuts:
                return self._engine.step_blocks(part, method)
            return iter([prescribed(part)])

        # what ends modes is watched again and again, so that compiling it pays
        rows = self._engine.rows if watch.smooth else interpret_rows
        return integrate_watched(step_blocks, problem, watch.watched(self._engine.course(problem), rows))

    def _monitors(self, c: FloatArray, t: FloatArray, q: FloatArray, qdot: FloatArray) -> dict[str, FloatArray]:
        """Return the first integrals of a motion."""
        return conserved(self._program, self._conservable, c, t, q, qdot)

    @derived_property
    def _conservable(self) -> Candidates:
        """What may be conserved, derived when it is first asked for."""
        return candidates(self.stages.equations)

    @nesting_named
    def state(self, initial: Mapping[Any, Any], parameters: Mapping[Any, Any], *, t: float = 0.0) -> FloatArray:
        """Return the state y (n_y,) of the formulation at consistent initial values, as `simulate` starts from it."""
        c = inputs.constants(self._program, inputs.parameter_vector(self.layout, parameters))
        values = inputs.given_values(self.layout, initial)
        c = at_time(self._program, c, option("t", t))
        return inputs.initial_state(self._start(values), option("t", t), values, c, self._program)

    def expand(self, t: float, y: FloatArray, parameters: Mapping[Any, Any]) -> FloatArray:
        """Return coordinates and rates (2 n_q,) of a state y (n_y,) of the formulation at time t."""
        c = inputs.constants(self._program, inputs.parameter_vector(self.layout, parameters))
        state = rows_of("y", y, len(self.layout.state))
        c = at_time(self._program, c, option("t", t))
        return interpret_rows(self._program.kernel("expand"), np.array([option("t", t)]), state[np.newaxis], c)[0]

    @nesting_named
    def assemble(
        self, guess: Mapping[Any, Any], parameters: Mapping[Any, Any], *, t: float = 0.0, fixed: Iterable[Any] = ()
    ) -> dict[str, float]:
        """Return the consistent initial values nearest to a rough guess, for `simulate`.

        Parameters
        ----------
        guess : mapping of symbols or names to numbers
            Every coordinate, roughly. Rates may be given too; those that the constraints fix may be left out.
        parameters : mapping of symbols or names to numbers
            Every parameter of the scene.
        t : float
            Time [s], where constraints depend on it.
        fixed : iterable of symbols or names
            What keeps exactly the value of the guess, such as the angle of a crank.

        Returns
        -------
        dict of str to float
            Coordinates, and rates where the guess has any. Nearest is meant by the sum of the squares of the changes.

        Raises
        ------
        InitialStateError
            When the loops cannot close, with what is left of each constraint at the best position found.
        UnknownNameError, ValueInputError
            For input that is wrong.
        """
        c = inputs.constants(self._program, self.parameter_vector(parameters))
        values = inputs.given_values(self.layout, guess, plain=True)
        held = inputs.resolve_names("fixed name", fixed, values, self.layout.aliases)
        c = at_time(self._program, c, option("t", t))
        return assembled(self._program, c, option("t", t), values, held)

    @nesting_named
    def prepare(
        self,
        t_span: tuple[float, float],
        *,
        method: str = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
        max_step: float = np.inf,
        max_steps: int = 1_000_000,
        project_invariants: Any = False,
    ) -> PreparedRun:
        """Return ``run(state, p)``, which gives the final state of many short runs with next to no overhead.

        Parameters
        ----------
        t_span, method, rtol, atol, max_step, max_steps
            As for `simulate`.
        project_invariants : bool, str or sequence of str
            First integrals to keep, as for `simulate`: those that are conserved from the first state that the function
            is called with, which also compiles it. Their initial values are computed before each run, which takes some
            hundred microseconds.

        Raises
        ------
        OptionError, FormulationError, UnknownNameError
            For options that do not exist, and integrals that are not known or that the formulation cannot keep.
        """
        t0, t1 = span_of(t_span)
        if begins_elsewhere(t0, t1):
            other, _, _ = self._counting(t0, t1)
            if other is not None:
                options = {"method": method, "rtol": rtol, "atol": atol, "max_step": max_step, "max_steps": max_steps}
                options["project_invariants"] = project_invariants
                return self._prepared_by(other, (t0, t1), options)
        rtol, atol = tolerances(rtol, atol)
        further = {"max_step": max_step, "max_steps": max_steps, "project_invariants": project_invariants}
        again = partial(self.prepare, (t0, t1), method=method, rtol=rtol, atol=atol, **further)
        if project_invariants is not False:
            refuse_formulation(self.stages.reduced)
            refuse_unknown(project_invariants, self._conservable)
            options = {"method": method, "rtol": rtol, "atol": atol, "max_step": max_step, "max_steps": max_steps}
            return PreparedRun(
                self._prepared_keeping(project_invariants, (t0, t1), options),
                self._method(method, rtol, atol),
                self.layout,
                again,
            )
        chosen = self._method(method, rtol, atol)
        inputs.warn_below_floor(rtol, atol, self._program, chosen)
        problem = IntegrationProblem(
            t0=t0,
            t1=t1,
            y0=np.zeros(len(self.layout.state)),
            constants=np.zeros(self.layout.constants),
            rtol=rtol,
            atol=atol,
            max_step=option("max_step", max_step),
            max_steps=whole("max_steps", max_steps),
        )
        if not self.layout.state:  # the constraints prescribe the motion
            still = PreparedStates(lambda state, p: (np.zeros(0), Status.SUCCESS))
            return PreparedRun(still, chosen, self.layout, again)
        run = self._engine.prepared(problem, chosen, lambda p: inputs.constants(self._program, p))
        return PreparedRun(run, chosen, self.layout, again)
