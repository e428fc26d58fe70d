"""`CompiledModel`: what `dalembert.compile_model` hands back."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..codegen.base import Engine, FloatArray
from ..errors import OptionError, UnknownNameError, ValueInputError, unknown_name
from ..integrators.problem import IntegrationProblem, Solution, prescribed
from ..integrators.status import Status
from ..integrators.watched import Occurrence, integrate_watched
from ..ir.program import Layout
from ..reduction.invariants import Candidates, candidates
from ..reduction.starting import Start, starting
from ..results.comparison import Comparison
from ..results.estimate import TIGHTER
from ..results.grid import Grid
from ..results.linearization import Linearization
from ..results.sensitivity import Sensitivity
from ..results.sweep import Sweep, SweepStatistics
from ..results.trajectory import RunStatistics, Trajectory
from . import inputs
from .assembly import assembled
from .comparing import compare
from .evaluation import Evaluated
from .events import EventCode, compiled_events, event_list
from .explain import explain
from .gains import give_gains, with_gains
from .linear import linearized
from .monitors import conserved
from .prepared import PreparedRun
from .reductions import reduction_table
from .sensitivity import Variation, chosen_names, vary
from .singular import indeterminate, judged, redundant, singular_start, still_redundant
from .sweeping import Cases, Settings, available_threads, fitted, run_cases, single_problem

if TYPE_CHECKING:
    from ..compiler import Stages

__all__ = ["CompiledModel"]

_MOST_WATCHES = 64
"""Sets of events of which the kernels are kept."""

_NO_ESTIMATE = "error_estimate compares motions time by time, which events may end or cut: leave out one of the two"


@final
class CompiledModel(Evaluated):
    """A scene compiled for one backend in one formulation.

    Attributes
    ----------
    stages : Stages
        Every object of the pipeline, from the scene to the rendered module.
    layout : Layout
        Names of everything that arrays hold.
    """

    def __init__(self, stages: Stages, engine: Engine, methods: Mapping[str, str]) -> None:
        self.stages = stages
        self.layout: Layout = stages.program.layout
        self._program = stages.program
        self._engine = engine
        self._methods = methods
        self._starts: dict[frozenset[str], Start] = {}
        self._others: dict[str, CompiledModel] = {}
        self._note = ""
        self._fewer: dict[tuple[int, ...], CompiledModel] = {}
        rows = range(len(self.layout.constraints))
        reduced = stages.reduced
        self._enforced = () if reduced.regular else tuple(i for i in rows if i not in reduced.left_out)
        self._watches: dict[str, EventCode] = {}
        self._candidates: Candidates | None = None
        self._variations: dict[tuple[tuple[str, ...], ...], Variation] = {}

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self._program.name

    @property
    def backend(self) -> str:
        """Name of the backend."""
        return self.stages.rendered.backend

    @property
    def formulation(self) -> str:
        """Name of the formulation."""
        return self._program.formulation

    @property
    def methods(self) -> tuple[str, ...]:
        """Integration methods of the backend; "auto" takes the first."""
        return tuple(self._methods)

    @property
    def source(self) -> str:
        """The generated code."""
        return self.stages.rendered.source

    def explain(self) -> str:
        """Return, in a few lines, what was chosen and why, what was left out, and operation counts."""
        automatic = {
            rtol: self._engine.automatic(self.methods, rtol, rtol) for rtol in (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
        }
        return explain(self.stages, self._methods, automatic)

    def __repr__(self) -> str:
        return f"<CompiledModel {self.name!r}: {self.formulation}, {self.backend}>"

    # -- simulation -----------------------------------------------------------------------

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
    ) -> Trajectory:
        """Simulate one trajectory.

        Parameters
        ----------
        t_span : (float, float)
            Start and end [s]; the end may lie before the start.
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

        Returns
        -------
        Trajectory
            Numerical failure is its `status`, never an exception.

        Raises
        ------
        UnknownNameError, ValueInputError, InitialStateError, OptionError, ExpressionError
            For input that is wrong, each naming what, what is allowed and what to do.
        """
        begin = time.perf_counter()
        chosen = self._method(method, rtol, atol)
        t0, t1 = _span(t_span)
        c = inputs.constants(self._program, self.parameter_vector(parameters))
        values = inputs.given_values(self.layout, initial)
        inputs.warn_below_floor(rtol, atol)
        problem = IntegrationProblem(
            t0=t0,
            t1=t1,
            y0=inputs.initial_state(self._start(values), t0, values, c, self._program),
            constants=c,
            rtol=float(rtol),
            atol=float(atol),
            t_eval=None if t_eval is None else np.atleast_1d(np.asarray(t_eval, dtype=float)),
            first_step=first_step,
            max_step=float(max_step),
            max_steps=int(max_steps),
            dense=dense,
        )
        watch = self._events(events)
        if watch is not None and error_estimate:
            raise OptionError(_NO_ESTIMATE)
        able = self._independent(problem, chosen, begin)
        if isinstance(able, Trajectory):
            return able
        if able is not self:
            options: dict[str, Any] = {"t_eval": t_eval, "method": method, "rtol": rtol, "atol": atol}
            options |= {"first_step": first_step, "max_step": max_step, "max_steps": max_steps, "dense": dense}
            options |= {"events": events, "error_estimate": error_estimate}
            return able.simulate(t_span, initial, parameters, **options)
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

    def _independent(self, problem: IntegrationProblem, method: str, begin: float) -> CompiledModel | Trajectory:
        """Return the model that enforces no constraint which follows from others around the start of a problem.

        Where only the start itself is singular, return the run that ends there.
        """
        if not self._enforced:
            return self
        where = (self._program, problem.t0, problem.y0, problem.constants, self._enforced)
        found = redundant(*where)
        if found is None:
            statistics = RunStatistics(method, 0, 0, 0, 0.0, time.perf_counter() - begin, singular_start(*where))
            status = Status.SINGULAR_CONFIGURATION
            y0 = problem.y0[np.newaxis]
            return Trajectory(self._program, problem.constants, status, np.array([problem.t0]), y0, statistics, None)
        if not found:
            return self
        from ..compiler import recompile

        without = tuple(sorted({*found, *self.stages.reduced.left_out}))
        if without not in self._fewer:
            labels = [self.layout.constraints[i] for i in found]
            self._fewer[without] = recompile(self.stages, without)
            self._fewer[
                without
            ]._note = f"not enforced, because it follows from the others around the start: {'; '.join(labels)}"
        return self._fewer[without]

    def _events(self, events: Any, reduce: Any = ()) -> EventCode | None:
        """Return the kernels of events and reductions, made once for each set of them; None where there are none."""
        listed = event_list(events, self.layout.aliases)
        reductions = reduction_table(reduce, self.layout.aliases)
        if not listed and not reductions:
            return None
        key = repr((listed, reductions))
        if key not in self._watches:
            if len(self._watches) >= _MOST_WATCHES:
                self._watches.clear()
            self._watches[key] = compiled_events(self.stages, listed, self._start, reductions)
        return self._watches[key]

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
        elif automatic:
            solution, method, note = self._engine.integrate_automatic(problem, method)
        else:
            solution = self._engine.integrate(problem, method)
        if self._enforced:
            solution, where = judged(self._program, solution, problem.constants, self._enforced)
            loose = indeterminate(self._program, problem.t0, problem.y0, problem.constants)
            note = "; ".join(text for text in (note, where, loose) if text)
        if self._note:
            tolerance = 1e3 * (problem.rtol + problem.atol)
            solution, broken = still_redundant(
                self._program, solution, problem.constants, self.stages.reduced.left_out, max(tolerance, 1e-6)
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
        c = problem.constants
        run = Trajectory(self._program, c, solution.status, solution.t, solution.y, statistics, solution.dense)
        run.with_monitors(self._monitors)
        return run if watch is None else run.with_events(watch.labels, occurrences)

    def _watched(self, problem: IntegrationProblem, method: str, watch: EventCode) -> tuple[Solution, list[Occurrence]]:
        """Integrate one problem with events."""

        def stretches(part: IntegrationProblem) -> Iterator[Solution]:
            if self.layout.state:
                return self._engine.stretches(part, method)
            return iter([prescribed(part)])

        return integrate_watched(stretches, problem, watch.watched(problem.constants))

    def _monitors(self, c: FloatArray, t: FloatArray, q: FloatArray, qdot: FloatArray) -> dict[str, FloatArray]:
        """Return the first integrals of a motion; what may be conserved is derived once."""
        if self._candidates is None:
            self._candidates = candidates(self.stages.equations)
        return conserved(self._program, self._candidates, c, t, q, qdot)

    def state(self, initial: Mapping[Any, Any], parameters: Mapping[Any, Any], *, t: float = 0.0) -> FloatArray:
        """Return the state y (n_y,) of the formulation at consistent initial values, as `simulate` starts from it."""
        c = inputs.constants(self._program, inputs.parameter_vector(self.layout, parameters))
        values = inputs.given_values(self.layout, initial)
        return inputs.initial_state(self._start(values), float(t), values, c, self._program)

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
        values = inputs.given_values(self.layout, guess)
        held = inputs.resolve_names("fixed name", fixed, values, self.layout.aliases)
        return assembled(self._program, c, float(t), values, held)

    def prepare(
        self,
        t_span: tuple[float, float],
        *,
        method: str = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
        max_step: float = np.inf,
        max_steps: int = 1_000_000,
    ) -> PreparedRun:
        """Return ``run(state, p)``, which gives the final state of many short runs with next to no overhead.

        Parameters
        ----------
        t_span, method, rtol, atol, max_step, max_steps
            As for `simulate`.
        """
        inputs.warn_below_floor(rtol, atol)
        t0, t1 = _span(t_span)
        chosen = self._method(method, rtol, atol)
        problem = IntegrationProblem(
            t0=t0,
            t1=t1,
            y0=np.zeros(len(self.layout.state)),
            constants=np.zeros(self.layout.constants),
            rtol=rtol,
            atol=atol,
            max_step=max_step,
            max_steps=max_steps,
        )
        run = self._engine.prepared(problem, chosen, lambda p: inputs.constants(self._program, p))
        return PreparedRun(run, chosen)

    def sweep(
        self,
        t_span: tuple[Any, Any],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        grid: Grid | None = None,
        t_eval: Any = None,
        method: str = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
        max_step: float = np.inf,
        max_steps: int = 1_000_000,
        threads: int | None = None,
        progress: bool = False,
        error_estimate: bool = False,
        events: Any = (),
        reduce: Any = (),
    ) -> Sweep:
        """Simulate many cases, each with its own steps and status; one that fails never touches its neighbours.

        Parameters
        ----------
        t_span : (float or array_like (n_case,), float or array_like (n_case,))
            Start and end [s], for all cases or one each.
        initial, parameters : mapping of symbols or names to numbers or array_like (n_case,)
            Scalars serve all cases. A value that is not finite is the status of its case, not an error.
        grid : Grid, optional
            From ``dalembert.grid(b=..., x_dot=...)``: every combination of some parameters and initial values.
        t_eval : array_like (n_t,), optional
            Times to record for all cases; without it, final states only.
        method, rtol, atol, max_step, max_steps
            As for `simulate`.
        threads : int, optional
            Threads to use; by default as many as there are processors.
        progress : bool
            Whether to show a bar with cases per second (needs tqdm).
        error_estimate : bool
            Whether to run every case once more at a hundredth of the tolerances, from which
            ``sweep.error_estimate["x"]`` estimates the global errors.
        events : sequence of Event, SymPy expressions or names
            What to watch for in every case, as for `simulate`. ``sweep.events["name"]`` has how often each occurred,
            and when first and last.
        reduce : mapping of str to reductions, or sequence of expressions or names
            What to keep of every motion: `dalembert.final`, `minimum`, `maximum`, `mean` and `first_crossing` of
            expressions as in `Event`; a sequence stands for final values. ``sweep.reduced["name"]`` has them, NaN
            for cases that failed.

        Returns
        -------
        Sweep
            After Ctrl-C, with the cases that were finished; the others have the status INTERRUPTED.

        Raises
        ------
        UnknownNameError, ValueInputError, InitialStateError, OptionError
            For input that is wrong for all cases.
        """
        begin = time.perf_counter()
        inputs.warn_below_floor(rtol, atol)
        t_eval = None if t_eval is None else np.atleast_1d(np.asarray(t_eval, dtype=float))
        given = (t_span, initial, parameters)
        if grid is not None:
            initial, parameters = _with_grid(self.layout, grid, initial, parameters)
        cases = Cases(self._program, self._start, t_span, initial, parameters)
        if t_eval is not None and any(len(ends) > 1 for ends in cases.span.values()):
            raise OptionError("t_eval is common to all cases; give one t_span for all of them, or no t_eval")
        count = available_threads() if threads is None else int(threads)
        if count < 1:
            raise OptionError(f"threads must be at least 1, not {threads!r}")
        chosen = self._method(method, rtol, atol, many=True)
        IntegrationProblem(
            t0=float(cases.span["start"][0]),
            t1=float(cases.span["end"][0]),
            y0=np.zeros(0),
            constants=np.zeros(0),
            rtol=rtol,
            atol=atol,
            t_eval=t_eval,
            max_step=max_step,
            max_steps=max_steps,
        )
        watch = self._events(events, reduce)
        if watch is not None and error_estimate:
            raise OptionError(_NO_ESTIMATE)
        settings = Settings(t_eval, chosen, rtol, atol, max_step, max_steps, count, progress, watch)
        first = single_problem(cases, settings, 0) if self._enforced else None
        able = self if first is None else self._independent(first, chosen, begin)
        if isinstance(able, CompiledModel) and able is not self:
            options: dict[str, Any] = {"method": method, "rtol": rtol, "atol": atol, "max_step": max_step}
            options |= {"max_steps": max_steps, "threads": threads, "progress": progress, "grid": grid}
            options |= {"t_eval": t_eval, "events": events, "reduce": reduce, "error_estimate": error_estimate}
            return able.sweep(*given, **options)
        if method == "auto":
            settings = fitted(self._engine, cases, settings)
        give_gains(self._engine, cases, settings, parameters)
        axes = {} if grid is None else grid.axes
        done = self._run_cases(cases, settings, axes, begin)
        if error_estimate:
            finer = replace(settings, rtol=rtol * TIGHTER, atol=atol * TIGHTER)
            finer = replace(finer, method=self._method(method, finer.rtol, finer.atol, many=True))
            if method == "auto":
                finer = fitted(self._engine, cases, finer)
            done.with_twin(self._run_cases(cases, finer, axes, time.perf_counter()))
        return done

    def compare_formulations(
        self,
        t_span: tuple[float, float],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        formulations: Sequence[str] | None = None,
        method: str | Mapping[str, str] = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
    ) -> Comparison:
        """Run one motion in every formulation and return a table of errors, violations, energy drift, steps and time.

        Parameters
        ----------
        t_span, initial, parameters, rtol, atol
            As for `simulate`.
        formulations : sequence of str, optional
            Which to compare; all by default.
        method : str or mapping of str to str
            The method for all formulations, or one each; a formulation that does not have it takes "auto".

        Returns
        -------
        Comparison
            One row a formulation, also for those that cannot serve the scene; ``print`` shows it.

        Raises
        ------
        OptionError
            For unknown formulations, and as `simulate`.
        """
        run = (t_span, initial, parameters)
        return compare(self._in_formulation, self.name, formulations, run, (float(rtol), float(atol)), method)

    def linearize(
        self,
        t: float,
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        states: Sequence[str] | None = None,
    ) -> Linearization:
        """Linearise the motion about a state, in independent coordinates and speeds.

        Parameters
        ----------
        t : float
            Time [s].
        initial, parameters : mapping of symbols or names to numbers
            The state and the parameters, as for `simulate`: what the constraints fix may be left out.
        states : sequence of str, optional
            Names of the independent components to use, of ``layout.state``; by default the formulation's own, or those
            that the constraints fix least.

        Returns
        -------
        Linearization
            With named rows and columns, and `eigenvalues`.

        Raises
        ------
        UnknownNameError, ValueInputError, InitialStateError, OptionError
            For input that is wrong.
        """
        p = self.parameter_vector(parameters)
        c = inputs.constants(self._program, p)
        values = inputs.given_values(self.layout, initial)
        y = inputs.initial_state(self._start(values), float(t), values, c, self._program)
        return linearized(self._program, float(t), y, p, c, states)

    def _in_formulation(self, name: str) -> CompiledModel:
        """Return the scene's model in another formulation, on the same backend, compiled once."""
        from ..compiler import compile_model

        if name == self.formulation:
            return self
        if name not in self._others:
            self._others[name] = compile_model(self.stages.scene, backend=self.backend, formulation=name)
        return self._others[name]

    def _run_cases(self, cases: Cases, settings: Settings, axes: Mapping[str, FloatArray], begin: float) -> Sweep:
        """Run all cases; the run time counts from `begin`."""
        done = run_cases(self._engine, cases, settings)
        statistics = SweepStatistics(
            method=settings.method,
            threads=settings.threads,
            steps=int(done.ends[:, 2].sum()),
            compile_seconds=sum(self.stages.seconds.values()),
            run_seconds=time.perf_counter() - begin,
            note=settings.note,
        )
        samples = None if settings.t_eval is None else done.samples
        varied = (cases.initial, cases.parameters)
        run = Sweep(
            self._program, cases.constants, varied, done.ends, done.y, samples, settings.t_eval, axes, statistics
        )
        watch = settings.watch
        return run if watch is None else run.with_events(watch.labels, done.happened, list(watch.plan), done.totals)

    def _start(self, given: Iterable[str]) -> Start:
        """Return the kernel from given initial values to the state, made once for each set of names."""
        key = frozenset(given)
        if key not in self._starts:
            self._starts[key] = starting(self.stages.reduced, sorted(key))
        return self._starts[key]

    def _method(self, method: Any, rtol: float, atol: float, *, many: bool = False) -> str:
        if method == "auto":
            return self._engine.automatic(self.methods, rtol, atol, many=many)
        if not isinstance(method, str) or method not in self._methods:
            raise OptionError(
                unknown_name("method", str(method), ["auto", *self._methods]) + f" (of the backend {self.backend!r})"
            )
        return method

    def sensitivity(
        self,
        t_span: tuple[float, float],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        wrt: Iterable[Any],
        of: Iterable[Any] | None = None,
        t_eval: Any = None,
        method: str = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
        max_steps: int = 1_000_000,
    ) -> Sensitivity:
        """Simulate one trajectory with the derivatives of what happens along it.

        Generated variational equations are integrated beside the equations of motion, under the same control of
        error. The consistent start and the projection onto constraints are differentiated along.

        Parameters
        ----------
        t_span, initial, parameters, t_eval, method, rtol, atol, max_steps
            As for `simulate`.
        wrt : iterable of symbols or names
            Parameters, and values given in `initial`. What the constraints fix varies with them where it is left out.
        of : iterable of symbols or names, optional
            Coordinates, rates, components of the state and outputs; by default all coordinates and rates.

        Returns
        -------
        Sensitivity
            ``.jacobian("x", "m")`` (n_t,) and so on.

        Raises
        ------
        UnknownNameError, ValueInputError, InitialStateError, OptionError
            For input that is wrong.
        """
        t0, t1 = _span(t_span)
        p = self.parameter_vector(parameters)
        values = inputs.given_values(self.layout, initial)
        start = self._start(values)
        names = chosen_names(self._program, start.given, of, wrt)
        key = (start.given, *names)
        if key not in self._variations:
            self._variations[key] = vary(self.stages, start.given, *names)
        variation = self._variations[key]
        c = inputs.constants(self._program, p)
        problem = IntegrationProblem(
            t0=t0,
            t1=t1,
            y0=inputs.initial_state(start, t0, values, c, self._program),
            constants=c,
            rtol=float(rtol),
            atol=float(atol),
            t_eval=None if t_eval is None else np.atleast_1d(np.asarray(t_eval, dtype=float)),
            max_steps=int(max_steps),
        )
        if method == "auto":
            chosen = variation.engine.automatic(self.methods, rtol, atol)
        else:
            chosen = self._method(method, rtol, atol)
        given = np.array([values[name] for name in start.given])
        return replace(variation.run(problem, given, p, chosen), aliases=self.layout.aliases)

    # -- pure functions of the jax backend ------------------------------------------------

    def vector_field(self, t: Any, y: Any, args: Any) -> Any:
        """Return dy/dt (n_y,) of the state y (n_y,) at parameters args (n_p,), traced: made for ``diffrax.ODETerm``.

        The components are those of ``layout.state`` and ``layout.parameters``; `state` and `parameter_vector` make
        such arrays.

        Raises
        ------
        OptionError
            For a backend other than "jax".
        """
        return self._engine.vector_field(t, y, args)

    def solve_fn(
        self,
        given: Iterable[str] | None = None,
        *,
        method: str = "auto",
        mode: str = "reverse",
        rtol: float = 1e-8,
        atol: float = 1e-10,
        max_steps: int = 4096,
    ) -> Any:
        """Return a pure function ``solve(t, initial, p)`` that JAX can trace, vectorise and differentiate.

        Parameters
        ----------
        given : iterable of str, optional
            Names of the coordinates and rates that `initial` holds; the others follow from the constraints, as in
            `simulate`. Without it, `initial` is the state y (n_y,).
        method, rtol, atol
            As for `simulate`.
        mode : str
            "reverse" for gradients (``jax.grad``, ``jax.vjp``), "forward" for ``jax.jvp`` and ``jax.jacfwd``.
        max_steps : int
            Attempted steps after which the run ends with a status.

        Returns
        -------
        Solve
            Its docstring describes arguments and result.

        Raises
        ------
        OptionError
            For a backend other than "jax", and for options that do not exist.
        UnknownNameError, InitialStateError
            For names that are not known or not enough.
        """
        start = None
        if given is not None:
            names = [self.layout.aliases.get(str(name), str(name)) for name in given]
            start = self._start(inputs.given_values(self.layout, dict.fromkeys(names, 0.0)))
        options = {"mode": mode, "rtol": rtol, "atol": atol, "max_steps": max_steps}
        return self._engine.solve_fn(start, self._method(method, rtol, atol), options)

    def __reduce__(self) -> tuple[Any, ...]:
        options = self.stages.options
        return _recompiled, (self.stages.scene, options)


def _recompiled(scene: Any, options: Any) -> CompiledModel:
    """Return the model that was pickled: the scene is compiled again, to the same program."""
    from ..compiler import compile_model

    return compile_model(
        scene,
        backend=options.backend,
        formulation=options.formulation,
        outputs=options.outputs,
        cache=options.cache,
        gains=options.gains,
    )


def _with_grid(
    layout: Layout, grid: Grid, initial: Mapping[Any, Any], parameters: Mapping[Any, Any]
) -> tuple[dict[Any, Any], dict[Any, Any]]:
    """Return initial values and parameters with the columns of a grid, each where it belongs."""
    initial, parameters = dict(initial), dict(parameters)
    for name, column in grid.columns().items():
        home = parameters if name in layout.parameters else initial
        if name not in (*layout.parameters, *layout.coordinates, *layout.rates):
            raise UnknownNameError(unknown_name("axis", name, (*layout.parameters, *layout.coordinates, *layout.rates)))
        if any(layout.aliases.get(str(key), str(key)) == name for key in home):
            raise ValueInputError(f"{name!r} is an axis of the grid and is given beside it; give it once")
        home[name] = column
    return initial, parameters


def _span(t_span: Sequence[float]) -> tuple[float, float]:
    try:
        t0, t1 = (float(t) for t in t_span)
    except (TypeError, ValueError):
        raise ValueInputError(f"t_span must be two numbers, start and end, not {t_span!r}") from None
    return t0, t1
