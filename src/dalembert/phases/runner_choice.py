"""Choice of the runner of a mode: its method, and whether compiled code or Python runs it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ..contacts.contact_cases import UNDECIDED, slip_begins
from ..contacts.equations.contact_laws import SLIP, Mode
from ..contacts.phase_tables import ANY_PHASE, NO_RUNNER, CaseTable
from ..errors import DalembertError, ValueInputError
from ..methods.status import Status
from ..options import StepOptions
from ..runs.case_blocks import fitted
from ..runs.case_settings import CaseSettings
from ..runs.cases import Cases
from ..runs.sampling import DivergenceCheck
from .host_runners import HostMode
from .mode_models import ModeModels
from .mode_runners import FEWEST_ROWS, GatheredRows, ModeRunner
from .output_values import PhaseReductions

if TYPE_CHECKING:
    from ..model.model import CompiledModel


def runs_unchecked(model: CompiledModel) -> bool:
    """Whether no results of a model are checked, but for divergence under controllers, which `CaseRuns` marks."""
    return bool(model.layout.state) and all(isinstance(check, DivergenceCheck) for check in model.checks)


@final
class RunnerChoice:
    """The runners of the modes that motions have entered.

    Parameters
    ----------
    modes : ModeModels
    options : StepOptions
        Method, tolerances, largest step and number of steps.
    reductions : PhaseReductions
        What users watch.
    fits : bool
        Whether "auto" looks at the motions to find a method that fits.
    chosen : callable, optional
        Returns the method for the number of a mode, given the one that would be taken.
    recorded : bool
        Whether the motion of the case, which is alone, is recorded.

    Attributes
    ----------
    runners : list of ModeRunner or HostRunner
    served : ndarray (n_runners,) of int
        Number of the mode that each serves; `NO_RUNNER` where another does.
    begins : ndarray (n_runners,) of int
        Which phases of the mode it serves (`RunnerTable.begins`).
    rows : int
        Least number of records of steps, and of what occurs, that a recorded run has room for; 0 records nothing.
    gathered : GatheredRows
    requested : list of Event
        What users watch, as phases have it: an event that maps the state ends a phase.
    compile_seconds : float
    """

    def __init__(
        self,
        modes: ModeModels,
        options: StepOptions,
        reductions: PhaseReductions,
        *,
        fits: bool = False,
        chosen: Callable[[int, str], str] | None = None,
        recorded: bool = False,
    ) -> None:
        self.modes, self.options, self.reductions, self.recorded = modes, options, reductions, recorded
        self.rows = FEWEST_ROWS if recorded else 0
        self.gathered = GatheredRows.of(modes.layout, modes.equations.contacts)
        self.runners: list[ModeRunner | HostMode] = []
        self.served, self.begins = np.zeros(0, np.int64), np.zeros(0, np.int64)
        self.parallel, self.compile_seconds = modes.engine().parallel, 0.0
        self.requested = [
            replace(event, name=event.label, terminal=1 if event.apply else int(event.terminal), apply=None)
            for event in reductions.events
        ]
        self._first_step: float | None = None
        self._places: dict[tuple[int, str, bool, int], int] = {}
        self._serving: dict[tuple[int, int], int] = {}
        self._left: dict[int, tuple[float, dict[str, float]]] = {}
        self._fitted: dict[str, str] = {}
        self._fits, self._chosen = fits and options.automatic, chosen

    @property
    def methods(self) -> dict[int, str]:
        """Method of each mode that has a runner, by its number: that of phases in which no slip begins, if any."""
        latest = sorted(self._serving.items(), key=lambda item: -item[0][1])
        serving = ((key[0], self.runners[place]) for key, place in latest)
        return {number: runner.taken or runner.method for number, runner in serving}

    def begin(self, first_step: float | None, *, anew: bool) -> None:
        """Prepare for cases that begin, for which it is found anew which methods fit.

        `first_step` is the size of the first step of a case that is recorded, None where it is to be chosen. If
        `anew`, no mode has a runner until a case enters it.
        """
        for runner in self.runners:
            runner.forget()
        if self._fits or first_step is not None or anew:
            self._serve({})
        self.compile_seconds, self._first_step = 0.0, first_step
        self._fitted.clear()

    def _take_first_step(self) -> float | None:
        """Return the size of the first step; what comes after its phase is run as if it had not been given."""
        step, self._first_step = self._first_step, None
        if step is not None:
            self._serve({})
        return step

    def _serve(self, serving: dict[tuple[int, int], int]) -> None:
        """Let phases, by number of the mode and kind, be served by these runners, by their places, and by no others."""
        self._serving = serving
        self.served[:] = NO_RUNNER
        for (number, begins), place in serving.items():
            self.served[place], self.begins[place] = number, begins

    def place(self, table: CaseTable, some: NDArray[np.intp]) -> None:
        """Give cases without a runner the one of their mode.

        Cases whose mode is not supported end there, unless all do.
        """
        serving, modes = dict(self._serving), table.cases.number[some]
        implicit = self.parallel and self.options.automatic
        kinds = [int(slip_begins(table.cases, i)) if implicit else ANY_PHASE for i in some.tolist()]
        for number, begins in sorted({*zip(modes.tolist(), kinds, strict=True)}):
            here, begin = some[(modes == number) & (np.array(kinds) == begins)], time.perf_counter()
            mode, first = self.modes.automaton.mode(number), here[:1]
            try:
                self.modes.settle(mode, table.cases.t[first], table.cases.x[first], table.cases.p[first])
                self.modes.serving(mode)
            except DalembertError:
                if len(here) == len(table.t1):
                    raise
                table.numbers.state[here], table.cases.number[here] = Status.CONTACT_UNSUPPORTED, UNDECIDED
                continue
            self.compile_seconds += time.perf_counter() - begin
            if (number, begins) not in serving:
                serving[number, begins] = self._runner(number, begins, table, here)
            table.numbers.runner[here] = serving[number, begins]
        if len(self.served) != len(self.runners):
            self.served, self.begins = np.zeros((2, len(self.runners)), np.int64)
        self._serve(serving)

    def _runner(self, number: int, begins: int, table: CaseTable, some: NDArray[np.intp]) -> int:
        """Return the place of the runner of a mode, some cases of which are to be run.

        Slip in a plane that begins decays towards its direction at the rate of friction over its speed, which is near
        zero: explicit steps are held there at that time scale.
        """
        mode = self.modes.automaton.mode(number)
        model, switched = self.modes.serving(mode), self.modes.switched(mode)
        compiled = self.parallel and self._first_step is None and self.modes.impulses(mode) is None
        known = {*self.gathered.parameters, *switched}
        compiled = compiled and runs_unchecked(model) and {*model.layout.parameters} <= known
        cases = self._first_cases(mode, table, some)
        if begins == 1 and compiled:
            method = "radau"
        else:
            method = self._method(number, cases, compiled=compiled and cases is not None)
        compiled = compiled and method != "auto"
        key = number, method, compiled, begins
        if key not in self._places:
            self._places[key] = len(self.runners)
            events = (*self.requested, *self.modes.events(mode))
            if compiled:
                along = self.reductions.along
                expand = model.engine.code(self.modes.expansion(mode))[0]
                about = events, along, method, self.options, expand, switched
                self.runners.append(ModeRunner(number, mode, model, *about))
            else:
                others = events, self.reductions, method, self.options, self._take_first_step, self._left
                self.runners.append(HostMode(self.modes, number, *others))
        return self._places[key]

    def _method(self, number: int, cases: Cases | None, *, compiled: bool) -> str:
        """Return the method of a mode: "auto" where each run by Python is to find one that fits.

        Modes of the common program differ in what contacts hold: the first one in which contacts slip decides for all
        of these, the first one without slip for the others.
        """
        own, model = self.options, self.modes.serving(self.modes.automaton.mode(number))
        if self.recorded and not compiled:
            return own.method
        method = model.choose_method(own.method, own.rtol, own.atol, many=True)
        if self._chosen is not None:
            return self._chosen(number, method)
        if not self._fits or cases is None:
            return method if compiled else own.method
        mode = self.modes.automaton.mode(number)
        alike = str(SLIP in mode if self.modes.switched(mode) else number)
        if alike not in self._fitted:
            limits = own.rtol, own.atol, own.max_step, own.max_steps
            settings = CaseSettings(None, method, *limits, threads=1, progress=False)
            self._fitted[alike] = fitted(model.engine, cases, settings, model.derived.quick_start, whole=False).method
        return self._fitted[alike]

    def _first_cases(self, mode: Mode, table: CaseTable, some: NDArray[np.intp]) -> Cases | None:
        """Return the first, the middle and the last of some cases; None where a symbol excludes a value of theirs."""
        some = some[sorted({0, len(some) // 2, len(some) - 1})]
        model, own = self.modes.serving(mode), table.cases
        columns = dict(zip(self.modes.layout.parameters, own.p[some].T, strict=True))
        columns |= self.modes.added(mode, own.added[some])
        given = {name: columns[name] for name in model.layout.parameters if name in columns}
        initial = dict(zip(self.gathered.states, own.x[some].T, strict=True))
        try:
            return Cases(model.stages.program, model.derived.start, (own.t[some], table.t1[some]), initial, given)
        except ValueInputError:  # the run of the phase says so
            return None
