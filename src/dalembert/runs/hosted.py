"""Runs that traced functions leave to the compiled backend on the host: those with events, reductions or contacts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..codegen.runs import HostedRuns, HostRun
from ..errors import InitialStateError, OptionError, list_names, unknown_name
from ..events.event_code import Event, event_list
from ..frozen import frozen
from ..ir.program import coefficient_places
from ..methods.names import TRACED
from ..methods.status import Status
from ..methods.step_constants import SMALLEST_OF_TIME
from ..options import SolveOptions
from ..scene.expressions.identity import symbols_called
from ..scene.symbol_table import InputSymbol
from ..stops.samples import Samples, samples
from .elapsed import check_watched
from .events import watched_expressions
from .reductions import Reduction, reduction_table

if TYPE_CHECKING:
    from ..model.model import CompiledModel


# Checks of the records of inputs of many cases, each with its own knots.


def record_statuses(symbols: Sequence[InputSymbol], records: Mapping[str, Samples], t: FloatArray) -> NDArray[np.int64]:
    """Return the statuses (k,) of cases whose records do not cover runs along times t (k, n_t), else SUCCESS.

    Records hold knots (k, n) and values (k, n). The statuses are those of traced runs.
    """
    status = np.full(len(t), int(Status.SUCCESS))
    low, high = np.minimum(t[:, 0], t[:, -1]), np.maximum(t[:, 0], t[:, -1])
    near = SMALLEST_OF_TIME * np.maximum(np.abs(low), np.abs(high))
    known = {symbol.name: symbol for symbol in symbols}
    for name, record in records.items():
        knots = record.t
        with np.errstate(invalid="ignore"):
            ordered = np.all(np.isfinite(knots), axis=1) & np.all(knots[:, 1:] > knots[:, :-1], axis=1)
            beyond = (low < knots[:, 0] - near) | (high > knots[:, -1] + near)
        if record.extrapolate != "error" and record.smoothness_everywhere >= known[name].smoothness:
            beyond[:] = False
        finite = np.all(np.isfinite(record.values), axis=1)
        for wrong, found in (
            (~finite, Status.NON_FINITE),
            (beyond, Status.OUTSIDE_TABLE),
            (~ordered, Status.TIMES_IN_NO_ORDER),
        ):
            status = np.where(wrong & (status != Status.TIMES_IN_NO_ORDER), int(found), status)
    return status


_BACKEND = "llvm"
METHODS: Mapping[str, str] = {"auto": "auto", **{name: method.compiled for name, method in TRACED.items()}}
"""Methods of the compiled loops, by those of traced runs."""


@final
@frozen(eq=False)
class HostRuns:
    """Sweeps of a model of the compiled backend, as a function of arrays.

    Attributes
    ----------
    model : CompiledModel
        Of the scene, on the compiled backend.
    given : tuple of str
        Names of the given initial values.
    columns : tuple of str
        Names of the requested quantities of the motion.
    inputs : tuple of InputSymbol
        Inputs of the scene.
    events, reductions
        Events, and reductions of every motion.
    options
        Method, tolerances and limits of steps.
    """

    model: CompiledModel
    given: tuple[str, ...]
    columns: tuple[str, ...]
    inputs: tuple[InputSymbol, ...]
    events: tuple[Event, ...]
    reductions: Mapping[str, Reduction]
    options: Mapping[str, Any]

    @property
    def _key(self) -> tuple[Any, ...]:
        requests = repr((self.events, dict(self.reductions)))
        return self.model, self.given, self.columns, self.inputs, requests, *self.options.items()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, HostRuns) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the events."""
        return tuple(event.label for event in self.events)

    def __call__(self, t: FloatArray, initial: FloatArray, p: FloatArray, records: Mapping[str, Samples]) -> HostRun:
        """Return the results of cases at times t (k, n_t), from initial values (k, n_given) and parameters p (k, n_p).

        `records` hold the knots (k, n) and values (k, n) of the inputs that have knots; the others are among the
        parameters. Cases of the same times and knots are one sweep.
        """
        count, n_times = t.shape
        out = self._nothing(count, n_times)
        steps = np.diff(t, axis=1)
        with np.errstate(invalid="ignore"):
            ordered = np.all(np.isfinite(t), axis=1) & (np.all(steps >= 0.0, axis=1) | np.all(steps <= 0.0, axis=1))
        numbers = np.all(np.isfinite(initial), axis=1) & np.all(np.isfinite(p), axis=1)
        fit = record_statuses(self.inputs, records, t)
        out.numbers[:, 1] = np.where(fit == Status.SUCCESS, float(Status.NON_FINITE), fit)
        out.numbers[~ordered, 1] = float(Status.TIMES_IN_NO_ORDER)
        able = np.flatnonzero(ordered & numbers & (fit == Status.SUCCESS))
        for cases in _alike(np.concatenate([t, *(record.t for record in records.values())], axis=1), able):
            self._sweep(t[cases[0]], cases, initial, p, records, out)
        return out

    def _nothing(self, count: int, n_times: int) -> HostRun:
        """Return the results of cases that were not run."""
        width = len(self.columns)
        happened = np.full((count, len(self.events), 3), np.nan)
        happened[:, :, 0] = 0.0
        return HostRun(
            np.full((count, n_times, width), np.nan),
            np.full((count, width), np.nan),
            np.concatenate([np.full((count, 1), np.nan), np.zeros((count, 2))], axis=1),
            happened,
            np.full((count, len(self.reductions)), np.nan),
        )

    def _sweep(
        self,
        t: FloatArray,
        cases: Any,
        initial: FloatArray,
        p: FloatArray,
        records: Mapping[str, Samples],
        out: HostRun,
    ) -> None:
        """Run the cases of some numbers, which have their times and knots in common."""
        layout = self.model.layout
        shown = {name: p[cases, i] for i, name in enumerate(layout.parameters) if name in layout.given}
        try:
            sweep = self.model.sweep(
                (t[0], t[-1]),
                {name: initial[cases, i] for i, name in enumerate(self.given)},
                shown,
                t_eval=t,
                inputs=self._inputs(cases, p, records),
                events=self.events,
                reduce=dict(self.reductions) or None,
                **self.options,
            )
        except InitialStateError:
            out.numbers[cases, 1] = float(Status.INITIAL_STATE)
            return
        final = sweep.final
        for i, name in enumerate(self.columns):
            out.rows[cases, :, i] = sweep[name]
            out.end[cases, i] = final[name]
        out.numbers[cases] = np.stack([sweep.t, sweep.status, sweep.steps], axis=1)
        for i, label in enumerate(self.labels):
            counts = sweep.events[label]
            out.happened[cases, i] = np.stack([counts.count, counts.first, counts.last], axis=1)
        for i, name in enumerate(self.reductions):
            out.reduced[cases, i] = sweep.reduced[name]
        self._judge_outputs(cases, out)

    def _inputs(self, cases: Any, p: FloatArray, records: Mapping[str, Samples]) -> dict[str, Any] | None:
        """Return the inputs of cases that have their knots in common."""
        layout = self.model.layout
        found: dict[str, Any] = {}
        for name, place in zip(layout.inputs, coefficient_places(layout.parameters, layout.inputs), strict=True):
            found[name] = p[cases, place + 1]
        for name, record in records.items():
            found[name] = samples(record.t[cases[0]], record.values[cases], record.kind, record.extrapolate)
        return found or None

    def _judge_outputs(self, cases: Any, out: HostRun) -> None:
        """Set the status NON_FINITE in runs with an output that is not finite although the motion is.

        Rows that a run did not reach are NaN, outputs that do not depend on the motion among them.
        """
        motion = len(self.columns) - len(self.model.layout.outputs)
        rows = out.rows[cases]
        reached = np.isfinite(rows[:, :, :motion]).all(axis=2, keepdims=True)
        spoiled = np.any(reached & ~np.isfinite(rows), axis=(1, 2))
        out.rows[cases] = np.where(reached, rows, np.nan)
        good = np.isin(out.numbers[cases, 1], (float(Status.SUCCESS), float(Status.EVENT)))
        out.numbers[cases[spoiled & good], 1] = float(Status.NON_FINITE)


def _alike(rows: FloatArray, cases: Any) -> list[Any]:
    """Return the numbers of cases (n,) whose rows (k, m) are equal, together."""
    if len(cases) < 2 or np.all(rows[cases] == rows[cases[0]]):
        return [cases] if len(cases) else []
    found, group = np.unique(rows[cases], axis=0, return_inverse=True)
    return [cases[group.ravel() == i] for i in range(len(found))]


def with_symbols(model: CompiledModel, events: Any, reduce: Any) -> CompiledModel:
    """Return the model that has the symbols, too, which only events and reductions contain; itself without any."""
    layout = model.layout
    expressions = list(watched_expressions(events, reduce, layout.aliases))
    known = {*layout.parameters, *layout.variables, *layout.state, *layout.inputs, *layout.outputs, "t"}
    free = {str(symbol) for each in expressions for symbol in getattr(each, "free_symbols", ())}
    further = {name for name in free if layout.aliases.get(name, name) not in known}
    found = symbols_called(further, expressions) if further else ()
    return model.variants.with_parameters(found) if found else model


def hosted_runs(
    model: CompiledModel, given: Iterable[str] | None, method: str, options: SolveOptions, events: Any, reduce: Any
) -> HostedRuns | None:
    """Return the host's part of a traced function with events, reductions or contacts; None for those without.

    Raises
    ------
    OptionError
        For what such runs do not support.
    UnknownNameError, ExpressionError
        For expressions that cannot be watched.
    """
    layout, watched = model.layout, None
    if model.modes is not None:
        if method not in METHODS:
            raise OptionError(unknown_name("method", str(method), METHODS))
        check_watched(model, events, reduce)
    else:
        code = model.derived.events(events, reduce)
        if code is None:
            return None
        watched = code.watch.values, code.watch.rates
    twin = model.variants.on_backend(_BACKEND)
    runner = HostRuns(
        twin,
        tuple(layout.state if given is None else given),
        (*layout.state, *layout.coordinates, *layout.rates, *layout.outputs),
        model.inputs,
        event_list(events, layout.aliases),
        reduction_table(reduce, layout.aliases),
        _options(method, options),
    )
    terminal = tuple(bool(event.terminal) for event in runner.events)
    refusal = _refusal(model, runner.events, runner.reductions)
    return HostedRuns(runner, layout, model.inputs, layout.state, watched, terminal, refusal)


def _options(method: str, options: SolveOptions) -> dict[str, Any]:
    """Return the options of sweeps."""
    return {
        "method": METHODS[method],
        "rtol": options.tolerances[0],
        "atol": options.tolerances[1],
        "max_step": options.max_step,
        "max_steps": options.max_steps,
    }


def _refusal(model: CompiledModel, events: tuple[Event, ...], table: Mapping[str, Reduction]) -> str:
    """Return why runs have no derivatives; nothing where they have."""
    if model.modes is not None:
        return (
            f"derivatives across changes of contacts ({list_names(model.contacts)}) are not computed: differentiate"
            f" runs of one mode, as model.mode({model.modes.automaton.example}).solve_fn(), or take differences of runs"
        )
    jumps = [event.label for event in events if event.apply is not None]
    if jumps:
        return (
            f"derivatives across jumps of the state (events with apply=: {list_names(jumps)}) are not computed: stop at"
            " the event (terminal=True), whose state is differentiated, and continue from the state after it with a"
            " second run"
        )
    if table:
        return (
            f"derivatives of reductions ({list_names(table)}) are not computed: leave out reduce=, and compute what is"
            " wanted of states at times"
        )
    if model.stages.program.conditions is not None:
        return (
            "derivatives of runs with events are not computed where conditions on time change: smooth the conditions"
            " (tanh), or leave out events="
        )
    return ""
