"""Sweeps of motions with contacts, by the loop over phases, or in rounds of all cases that are in one mode."""

from __future__ import annotations

import time
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...methods.status import Status
from ...progress import meter
from ...results.hybrid_sweep import HybridSweep
from ...results.sweep import SweepStatistics
from ..symbol_assumptions import warn_of_motion
from .mode_models import ModeModels
from .output_values import BROKEN, OutputValues
from .phases import PhaseExecutor, compiled_phases
from .request import SweepRequest
from .rounds import RUNNING, CaseRounds

__all__ = ["sweep"]

_BETWEEN_LOOKS = 1024
"""Cases after which a bar shows how far they are."""


def sweep(modes: ModeModels, request: SweepRequest) -> HybridSweep:
    """Return the results of all cases."""
    return _Sweep(modes, request).results()


@final
class _Sweep:
    """One sweep in progress."""

    def __init__(self, modes: ModeModels, request: SweepRequest) -> None:
        self.modes, self.request, self.reductions = modes, request, request.reductions
        self.begin = time.perf_counter()
        self.cases = cases = CaseRounds(modes, request)
        changing = None if cases.inputs is None else (cases.inputs, request.t1, cases.forward > 0.0)
        self.value = OutputValues(modes, request.layout, request.p, cases.breaks, changing)
        known = modes, request.layout, request.options, request.threads, self.reductions, cases.now, cases.table
        compiled = compiled_phases(modes)
        fits, chosen = request.options.fits, request.options.method_chosen
        self.executor = PhaseExecutor(*known, fits=fits, chosen=chosen) if compiled else None

    def results(self) -> HybridSweep:
        """Run all cases to their ends."""
        if self.executor is None:
            self.cases.begin(self.cases.going())
        with meter(len(self.cases.status), self.request.options.progress) as advance:
            advance(len(self.cases.status) - len(self.cases.going()))
            try:
                while len(going := self.cases.going()):
                    if not self._executed(going):
                        self._round(going)
                    self.cases.jump(self.cases.going(), deciding=self.executor is None)
                    advance(len(going) - len(self.cases.going()))
            except KeyboardInterrupt:
                pass
        self.cases.status[self.cases.status == RUNNING] = int(Status.INTERRUPTED)
        return self._finished()

    def _round(self, going: NDArray[np.intp]) -> None:
        """Run cases that compiled code does not serve, for a round."""
        if self.executor is None:
            self.cases.run(going)
            return
        self.cases.leave_loop(going)
        self.cases.run(going)
        self.cases.enter_loop(going)
        if len(self.executor.table.carried):
            self.executor.table.carried[going] = np.nan

    # -- compiled code ---------------------------------------------------------------------

    def _executed(self, going: NDArray[np.intp]) -> bool:
        """Let compiled code run cases as far as it can; return whether it could do anything."""
        if self.request.options.progress:
            going = going[:_BETWEEN_LOOKS]
        if self.executor is None or not self.executor.run(going):
            return False
        self.cases.methods |= dict.fromkeys(method for method in self.executor.methods.values() if method)
        broken = going[np.isin(self.cases.status[going], BROKEN)]
        self.cases.status[broken[self.value.jammed(self.cases.states(broken))]] = int(Status.CONTACT_IMPOSSIBLE)
        return True

    # -- results ---------------------------------------------------------------------------

    def _methods(self) -> dict[tuple[int, float], str]:
        """Return the method of each mode by its number and the tolerance."""
        compiled = {} if self.executor is None else self.executor.methods
        found = {mode: method for mode, (_, method) in self.cases.fits.items()}
        found |= {mode: method for mode, method in compiled.items() if method}
        number, rtol = self.modes.automaton.number, self.request.options.rtol
        return {(number(mode), rtol): method for mode, method in found.items()}

    def _finished(self) -> HybridSweep:
        request, cases = self.request, self.cases
        started = cases.now.mode_numbers() >= 0
        ends = np.column_stack([cases.now.t, cases.status.astype(float), cases.steps.astype(float)])
        stats = SweepStatistics(
            method=", ".join(cases.methods),
            threads=request.threads,
            steps=int(cases.steps.sum()),
            compile_seconds=cases.compile_seconds,
            run_seconds=time.perf_counter() - self.begin - cases.compile_seconds,
            rtol=request.options.rtol,
            atol=request.options.atol,
            methods=self._methods(),
        )
        count = len(cases.status)
        last = cases.states(np.arange(count))
        if request.t_eval is not None:
            cases.samples.case[:] = np.repeat(np.arange(count), len(request.t_eval))
        met, automaton = np.concatenate([last.mode, cases.samples.mode]), self.modes.automaton
        modes = {int(n): self.modes.named(automaton.mode(int(n))) for n in np.unique(met[met >= 0])}
        run = HybridSweep(
            self.modes.equations.name,
            request.layout,
            request.varied,
            ends,
            request.t_eval,
            request.axes,
            stats,
            (last, None if request.t_eval is None else cases.samples),
            cases.phases + started,
            [contact.name for contact in self.modes.equations.contacts],
            modes,
            self.value,
        )
        warn_of_motion(request.layout.assumptions, request.layout.coordinates, run.t, run._final)
        about = cases.occurred, cases.totals
        reduced = self.reductions.results(self.value, last, request.t, cases.status, about)
        labels = [event.label for event in self.reductions.asked]
        return run.with_events(labels, cases.occurred[:, : 3 * len(labels)], list(self.reductions.table), reduced)
