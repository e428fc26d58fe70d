"""Sweeps: many cases of a compiled model."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..arrays import FloatArray
from ..errors import InitialStateError, OptionError, UnknownNameError, ValueInputError, nesting_named, unknown_name
from ..integrators.cases import BlockResult, CaseBlock
from ..ir.program import Layout
from ..methods.status import Status
from ..results.estimate import TIGHTER
from ..results.grid import Grid
from ..results.sweep import Sweep, SweepStatistics
from ..values import flag, option, times_of, tolerances, whole
from . import inputs
from .cases import Cases, Settings, agreed, single_problem, spans_of
from .elapsed import begins_elsewhere, elapsed_times, far, offset_columns
from .gains import give_gains
from .gimbal import locked_cases
from .held import NO_ESTIMATE
from .keeping import kept_values, refuse_jumps
from .reductions import reduction_table
from .simulation import Simulated
from .singular import judged_cases, searched, unlike
from .sweeping import begin_cases, fitted
from .symbol_assumptions import warn_of_motion

__all__ = ["Swept", "with_grid"]


class Swept(Simulated):
    """A compiled model that simulates many cases side by side."""

    @nesting_named
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
        reduce: Any = None,
        project_invariants: Any = False,
    ) -> Sweep:
        """Simulate many cases, each with its own steps and status; one that fails never touches its neighbours.

        Parameters
        ----------
        t_span : (float or array_like (n_case,), float or array_like (n_case,))
            Start and end [s], for all cases or one each. Late times lose no digits, as for `simulate`.
        initial, parameters : mapping of symbols or names to numbers or array_like (n_case,)
            Scalars serve all cases. A value that is not finite, or of an array one that its symbol excludes, is the
            status of its case, not an error.
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
        project_invariants : bool, str or sequence of str
            First integrals to keep, as for `simulate`: those that are conserved in the first case that can start.

        Returns
        -------
        Sweep
            After Ctrl-C, with the cases that were finished; the others have the status INTERRUPTED.

        Raises
        ------
        UnknownNameError, ValueInputError, InitialStateError, OptionError
            For input that is wrong for all cases.
        """
        options: dict[str, Any] = {"method": method, "rtol": rtol, "atol": atol, "max_step": max_step}
        error_estimate = flag("error_estimate", error_estimate)
        options |= {"max_steps": max_steps, "threads": threads, "progress": progress, "grid": grid}
        options |= {"t_eval": t_eval, "events": events, "reduce": reduce, "error_estimate": error_estimate}
        options["project_invariants"] = project_invariants
        starts, lasts = spans_of(t_span)
        together = len(starts) == len(lasts) == 1
        if not begins_elsewhere(starts, lasts) or not (together or t_eval is None):
            return self._sweep(t_span, initial, parameters, **options)
        other, options["events"], options["reduce"] = self._counting(starts, lasts, events, reduce)
        if other is None:
            return self._sweep(t_span, initial, parameters, **options)
        assert isinstance(other, Swept)
        times = None if t_eval is None else times_of("t_eval", t_eval)
        options["t_eval"] = elapsed_times(float(starts[0]), float(lasts[0]), times)
        given = self._with_offset_columns(other, t_span, initial, parameters, grid)
        near = ~far(starts, lasts) if other is not self else np.zeros(1, bool)
        begins = np.where(near, np.nan, starts) - starts  # NaN is not run
        run = other._sweep((begins, lasts - starts), initial, given, **options)
        table = reduction_table(reduce, self.layout.aliases)
        crossings = [name for name, each in table.items() if each.kind == "first crossing"]
        run = run.counted_from(starts, times, self.layout.parameters, crossings)
        if not np.any(near):
            return run
        options |= {"events": events, "reduce": reduce, "t_eval": t_eval}
        rest = self._sweep((np.where(near, starts, np.nan), lasts), initial, parameters, **options)
        return run.with_cases(np.broadcast_to(near, len(run)), rest, starts)

    def _with_offset_columns(
        self,
        other: Swept,
        t_span: tuple[Any, Any],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        grid: Grid | None,
    ) -> Mapping[Any, Any]:
        """Return parameters with those that another model of the scene has for the start of each case."""
        offsets = other.stages.equations.symbols.offsets
        if not offsets:
            return parameters
        whole = (initial, parameters) if grid is None else with_grid(self.layout, grid, initial, parameters)
        cases = Cases(self._program, self._start, t_span, *whole)
        return {**parameters, **offset_columns(offsets, cases.span["start"], cases.parameters)}

    def _sweep(
        self,
        t_span: tuple[Any, Any],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        project_invariants: Any = False,
        **options: Any,
    ) -> Sweep:
        """Simulate many cases, as `sweep` does, in the time of this model."""
        if project_invariants is not False:
            refuse_jumps(options["events"], self.layout.aliases)
            keeper, further = self._keeping_cases(project_invariants, t_span, initial, parameters, options["grid"])
            return keeper._sweep(t_span, initial, {**parameters, **further}, **options)
        return self._begin_sweep(t_span, initial, parameters, **options)()

    def _begin_sweep(
        self,
        t_span: tuple[Any, Any],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        grid: Grid | None = None,
        t_eval: Any = None,
        method: str = "auto",
        rtol: float,
        atol: float,
        max_step: float,
        max_steps: int,
        threads: int | None,
        progress: bool = False,
        error_estimate: bool = False,
        events: Any = (),
        reduce: Any = (),
    ) -> Callable[..., Sweep]:
        """Begin a sweep, as `sweep` does; return what waits for its results (see `begin_cases`)."""
        begin = time.perf_counter()
        rtol, atol = tolerances(rtol, atol)
        max_step, max_steps = option("max_step", max_step), whole("max_steps", max_steps)
        chosen = self._method(method, rtol, atol, many=True)
        inputs.warn_below_floor(rtol, atol, self._program, chosen)
        given = (t_span, initial, parameters)
        if grid is not None:
            initial, parameters = with_grid(self.layout, grid, initial, parameters)
        cases = Cases(self._program, self._start, t_span, initial, parameters)
        divisible = self._divisible_cases(cases)
        if divisible is not self:
            options: dict[str, Any] = {"method": method, "rtol": rtol, "atol": atol, "max_step": max_step}
            options |= {"max_steps": max_steps, "threads": threads, "progress": progress, "grid": grid}
            options |= {"t_eval": t_eval, "events": events, "reduce": reduce, "error_estimate": error_estimate}
            return divisible._begin_sweep(*given, **options)
        settings = agreed(
            cases,
            t_eval=t_eval,
            method=chosen,
            rtol=rtol,
            atol=atol,
            max_step=max_step,
            max_steps=max_steps,
            threads=threads,
            progress=flag("progress", progress),
        )
        watch = self._events(events, reduce)
        if watch is not None and error_estimate:
            raise OptionError(NO_ESTIMATE)
        settings = replace(settings, watch=watch)
        tried = (single_problem(cases, settings, i) for i in range(cases.count if self._enforced else 0))
        first = next((problem for problem in tried if problem is not None), None)
        able = self if first is None else self._independent(first, chosen, begin)
        if isinstance(able, Swept) and able is not self:
            options = {"method": method, "rtol": rtol, "atol": atol, "max_step": max_step}
            options |= {"max_steps": max_steps, "threads": threads, "progress": progress, "grid": grid}
            options |= {"t_eval": t_eval, "events": events, "reduce": reduce, "error_estimate": error_estimate}
            return able._begin_sweep(*given, **options)
        if method == "auto":
            settings = fitted(self._engine, cases, settings)
        if self._ranked and settings.method != "radau":
            settings = replace(settings, watch=self._events(events, reduce, ranks=True))
        give_gains(self._engine, cases, settings, parameters)
        axes = {} if grid is None else grid.axes
        settings = self._apart(cases, settings)
        waiting = self._begin_cases(cases, settings, axes, begin)
        if not error_estimate:
            return waiting

        def estimated() -> Sweep:
            done = waiting()
            finer = replace(settings, rtol=rtol * TIGHTER, atol=atol * TIGHTER)
            finer = replace(finer, method=self._method(method, finer.rtol, finer.atol, many=True))
            if method == "auto":
                finer = fitted(self._engine, cases, finer)
            done.with_twin(self._begin_cases(cases, finer, axes, time.perf_counter())())
            return done

        return estimated

    def _divisible_cases(self, cases: Cases) -> Swept:
        """Return the model without the constraints that this one divides by what vanishes in every case.

        Where it vanishes in some cases only, those have a status.
        """
        if not self.stages.reduced.pivots or not np.any(cases.lost_pivots(slice(0, 1))):
            return self
        if not np.all(cases.lost_pivots(slice(0, cases.count))):
            return self
        initial, parameters = ({n: float(v[0]) for n, v in t.items()} for t in (cases.initial, cases.parameters))
        try:
            able = self._divisible(float(cases.span["start"][0]), initial, parameters)
        except (InitialStateError, ValueInputError):
            return self
        assert isinstance(able, Swept)
        return able

    def _keeping_cases(
        self,
        wanted: Any,
        t_span: tuple[Any, Any],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        grid: Grid | None,
    ) -> tuple[Swept, dict[str, FloatArray]]:
        """Return the model that keeps first integrals after every step, and its further parameters for all cases."""
        if grid is not None:
            initial, parameters = with_grid(self.layout, grid, initial, parameters)
        cases = Cases(self._program, self._start, t_span, initial, parameters)
        y, c, t, status = cases.starts()
        able = np.flatnonzero(status < 0)
        if not len(able):
            raise ValueInputError("project_invariants: no case of the sweep can start, so that nothing is to be kept")
        first = able[0]
        keeper, names = self._keeper(wanted, c[first], float(t[first]), y[first])
        assert isinstance(keeper, Swept)
        return keeper, kept_values(names, self._program, self._conservable, c, t, y)

    def _apart(self, cases: Cases, settings: Settings) -> Settings:
        """Return settings that set apart cases in which other constraints follow from others than in the first."""
        rows = sorted({*self._enforced, *self._dropped})
        if self._dropped and not self._enforced:  # `minimal` enforces all others
            rows = list(range(len(self.layout.constraints)))
        if cases.count < 2 or len(rows) < 2 or not self.layout.state:
            return settings
        block, status = cases.block(slice(0, cases.count), settings)
        different = unlike(self._program, block.spans[:, 0], block.y, block.c, rows, lost=bool(self._dropped))
        different &= status < 0
        count = int(np.sum(different))
        if not count:
            return settings
        note = (
            f"in {count} of {cases.count} cases other constraints follow from each other around the start than in the"
            " first: these were not run; give them a sweep of their own"
        )
        return replace(settings, apart=different, note="; ".join(text for text in (settings.note, note) if text))

    def _begin_cases(
        self, cases: Cases, settings: Settings, axes: Mapping[str, FloatArray], begin: float
    ) -> Callable[..., Sweep]:
        """Begin to run all cases; return what waits for their results. The run time counts from `begin`."""
        if self._gimbals is not None or self._ranked:
            settings = replace(settings, judge=lambda block, part: self._judge(settings.method, block, part))
        waiting = begin_cases(self._engine, cases, settings)

        def wait(stop: bool = False) -> Sweep:
            done = waiting(stop)
            if settings.apart is not None:
                done.refuse(settings.apart, Status.SINGULAR_CONFIGURATION)
            if cases.refused is not None:
                done.refuse(cases.refused, Status.ASSUMPTION)
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
                self._program, cases.constants_at, varied, done.ends, done.y, samples, settings.t_eval, axes, statistics
            )
            warn_of_motion(self.layout.assumptions, self.layout.coordinates, run.t, run._final)
            watch = settings.watch
            return run if watch is None else run.with_events(watch.labels, done.happened, list(watch.plan), done.totals)

        return wait

    @property
    def _straight(self) -> bool:
        """Whether a sweep is nothing but a run of the engine: nothing to choose at the start, nothing to judge."""
        return bool(self.layout.state) and not self._enforced and not self._dropped and self._gimbals is None

    @property
    def _ranked(self) -> bool:
        """Whether the cases of sweeps are searched for a rank that the constraints lose."""
        return bool(self._enforced) and bool(self.layout.state) and searched(self._program)

    def _judge(self, method: str, block: CaseBlock, done: BlockResult) -> None:
        """Give cases whose angles locked, or whose constraints lost rank, the status that says so."""
        if self._ranked:
            judged_cases(self._program, self._engine, method, self._enforced, block, done)
        if self._gimbals is not None:
            locked_cases(self._program, self._gimbals, block, done)


def with_grid(
    layout: Layout, grid: Grid, initial: Mapping[Any, Any], parameters: Mapping[Any, Any]
) -> tuple[dict[Any, Any], dict[Any, Any]]:
    """Return initial values and parameters with the columns of a grid, each where it belongs."""
    if not isinstance(grid, Grid):
        raise ValueInputError(f"grid must be made by dalembert.grid(name=values, ...), not {grid!r}")
    initial, parameters = dict(initial), dict(parameters)
    for name, column in grid.columns().items():
        home = parameters if name in layout.parameters else initial
        if name not in (*layout.parameters, *layout.initial):
            raise UnknownNameError(unknown_name("axis", name, (*layout.parameters, *layout.initial)))
        if any(layout.aliases.get(str(key), str(key)) == name for key in home):
            raise ValueInputError(f"{name!r} is an axis of the grid and is given beside it; give it once")
        home[name] = column
    return initial, parameters
