"""Sweeps of motions with contacts."""

from __future__ import annotations

import time
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...integrators.cases import BlockResult
from ...integrators.contact_cases import UNDECIDED
from ...integrators.phase_tables import JUMPS, NOT_BEGUN
from ...integrators.workspace import RUNNING
from ...methods.status import Status
from ...progress import meter
from ...results.case_results import NO_MODE, SweepStatistics
from ...results.hybrid_sweep import HybridSweep, States
from ..symbol_assumptions import warn_of_motion
from .case_table import case_table
from .mode_models import ModeModels
from .output_values import BROKEN, OutputValues
from .phases import PhaseExecutor
from .request import SweepRequest
from .state import HybridState
from .stops import stops_of

__all__ = ["sweep"]

_BETWEEN_LOOKS = 1024
"""Cases after which a bar shows how far they are."""


def sweep(modes: ModeModels, request: SweepRequest, stop: bool = False) -> HybridSweep:
    """Return the results of all cases; with `stop` none of them is run."""
    return _Sweep(modes, request).results(stop)


@final
class _Sweep:
    """One sweep in progress."""

    def __init__(self, modes: ModeModels, request: SweepRequest) -> None:
        self.modes, self.request, self.reductions = modes, request, request.reductions
        self.begin = time.perf_counter()
        t0, t1, p, layout, options = request.t, request.t1, request.p, request.layout, request.options
        count, k = len(t0), len(modes.equations.contacts)
        given = options.inputs if options.inputs is not None and options.inputs.sampled else None
        stops = stops_of(modes, layout, given, p, (t0, t1), request.t_eval, many=True)
        wanted = 0 if request.t_eval is None else len(request.t_eval)
        self.now = HybridState.starting(t0, request.x, p, t1 - t0, k, len(layout.states))
        self.samples = States.nothing_yet(count * wanted, len(layout.variables), k)
        table = case_table(self.now, t1, self.reductions, request.t_eval, self.samples, np.empty((0, 0)))
        table.numbers.state[:], table.numbers.runner[:] = request.status, NOT_BEGUN
        if stops is not None:
            table = table._replace(stops=stops.table)
            table.numbers.state[stops.senseless & (table.numbers.state == RUNNING)] = int(Status.NON_FINITE)
        self.table, self.stops = table, stops
        self.status, self.phases = table.numbers.state, table.numbers.phases
        changing = None if given is None else (given, t1, t1 >= t0)
        self.value = OutputValues(modes, layout, p, None if stops is None else stops.breaks, changing)
        known = modes, layout, options, request.threads, self.reductions, self.now, table
        chosen = None if options.chosen is None else options.method_chosen
        self.executor = PhaseExecutor(*known, fits=options.fits, chosen=chosen)

    def results(self, stop: bool) -> HybridSweep:
        """Run all cases to their ends, unless they are to stop."""
        with meter(len(self.status), self.request.options.progress) as advance:
            advance(len(self.status) - len(self._going()))
            try:
                while not stop and len(going := self._going()):
                    self._run(going)
                    self._jump()
                    advance(len(going) - len(self._going()))
            except KeyboardInterrupt:
                pass
        self._leave_out(self._going())
        return self._finished()

    def _going(self) -> NDArray[np.intp]:
        """Return the cases that continue."""
        return np.flatnonzero(self.status == RUNNING)

    def _run(self, going: NDArray[np.intp]) -> None:
        """Run cases as far as they go."""
        if self.request.options.progress:
            going = going[:_BETWEEN_LOOKS]
        self.executor.run(going)
        broken = going[np.isin(self.status[going], BROKEN)]
        jammed = self.value.jammed(self._states(broken))
        self.status[broken[jammed]] = int(Status.CONTACT_IMPOSSIBLE)

    def _jump(self) -> None:
        """Map the states of cases in which events have occurred that do so, and let them begin anew."""
        some = self._going()
        some = some[self.table.numbers.runner[some] == JUMPS]
        if not len(some):
            return
        assert self.request.jumps is not None
        self.status[some] = self.request.jumps.apply(self.now, self.table.occurred, some)
        over = some[self.status[some] != RUNNING]
        self.phases[over] -= self.now.cases.passed[over] != 0.0
        self.table.numbers.runner[some] = NOT_BEGUN

    def _leave_out(self, some: NDArray[np.intp]) -> None:
        """Set the status of cases that an interrupt has stopped, or kept from running, and NaN for their results."""
        table, width = self.table, len(self.samples.t) // max(len(self.status), 1)
        self.status[some] = int(Status.INTERRUPTED)
        self.now.t[some], self.now.x[some], self.now.cases.modes[some] = np.nan, np.nan, UNDECIDED
        samples = (some[:, np.newaxis] * width + np.arange(width)).ravel()
        self.samples.t[samples], self.samples.x[samples], self.samples.mode[samples] = np.nan, np.nan, NO_MODE
        for counts in (table.numbers.steps, table.numbers.phases):
            counts[some] = 0
        table.occurred[some] = BlockResult.nothing_yet(len(some), table.occurred.shape[1] // 3, ())[0]

    def _states(self, some: NDArray[np.intp]) -> States:
        """Return the present states of some cases."""
        return self.now.states(some, self.table.numbers.history[some])

    # -- results ---------------------------------------------------------------------------

    def _finished(self) -> HybridSweep:
        request, numbers, methods = self.request, self.table.numbers, self.executor.methods
        started, mode_number = self.now.mode_numbers() >= 0, self.modes.automaton.number
        ends = np.column_stack([self.now.t, numbers.state.astype(float), numbers.steps.astype(float)])
        stats = SweepStatistics(
            method=", ".join(dict.fromkeys(methods.values())),
            threads=request.threads,
            steps=int(numbers.steps.sum()),
            compile_seconds=self.executor.compile_seconds,
            run_seconds=time.perf_counter() - self.begin - self.executor.compile_seconds,
            rtol=request.options.rtol,
            atol=request.options.atol,
            methods={(mode_number(mode), request.options.rtol): method for mode, method in methods.items()},
        )
        count = len(self.status)
        last = self._states(np.arange(count))
        if request.t_eval is not None:
            self.samples.case[:] = np.repeat(np.arange(count), len(request.t_eval))
        met, automaton = np.concatenate([last.mode, self.samples.mode]), self.modes.automaton
        modes = {int(n): self.modes.named(automaton.mode(int(n))) for n in np.unique(met[met >= 0])}
        run = HybridSweep(
            self.modes.equations.name,
            request.layout,
            request.varied,
            ends,
            request.t_eval,
            request.axes,
            stats,
            (last, None if request.t_eval is None else self.samples),
            self.phases + started,
            [contact.name for contact in self.modes.equations.contacts],
            modes,
            self.value,
        )
        warn_of_motion(request.layout.assumptions, request.layout.coordinates, run.t, run._final)
        about = self.table.occurred, self.table.totals
        reduced = self.reductions.results(self.value, last, request.t, self.status, about)
        labels = [event.label for event in self.reductions.requested]
        return run.with_events(labels, self.table.occurred[:, : 3 * len(labels)], list(self.reductions.table), reduced)
