"""Execution of phases: the loop over phases carries cases from mode to mode, each run by compiled code or by Python."""

from __future__ import annotations

import ctypes
import itertools
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...codegen.host_code import raise_failure
from ...codegen.llvm.loops import loop_named
from ...codegen.runs import CaseRun, LoopCall
from ...errors import ValueInputError
from ...hybrid import Mode
from ...hybrid.automaton import BITS
from ...integrators.arguments import address_of, pack
from ...integrators.phase_loop import PhaseArguments
from ...integrators.phase_stops import StopTable, no_stops
from ...integrators.phase_tables import NOBODY, CaseTable, PhasePlan, RunnerTable, ThreadWorkspace
from ...interrupts import STOPPED, check, stopped_by
from ...ir.program import Layout
from ...options import StepOptions
from ..case_blocks import begin_whole, fitted
from ..cases import Cases, Settings
from ..sweep import runs_unchecked
from .decisions import LOOP
from .host_runners import HostRunner
from .mode_models import ModeModels
from .mode_runners import GatheredRows, ModeRunner, thread_workspace
from .reductions import PhaseReductions
from .state import HybridState

__all__ = ["PhaseExecutor"]

_MOST_TOGETHER = 256
"""Cases that a thread runs together: enough to fill lanes, and few enough for the nearest cache."""
_BATCHES_PER_THREAD = 4
_PATIENCE = 4096
"""Rounds of a loop over lanes after which a case alone returns to Python, where Ctrl-C is raised."""


@final
@dataclass(frozen=True, eq=False)
class _Threads:
    """Runners as the loop sees them, the memory of threads, the calls of the first, and what must stay alive."""

    plan: PhasePlan
    spaces: list[ThreadWorkspace]
    turn: NDArray[np.int64]
    calls: Sequence[LoopCall]
    held: object

    def packed(self, table: CaseTable, order: NDArray[np.int64]) -> list[NDArray[np.int64]]:
        """Return the packed arguments of the loop of each thread, for cases in an order."""
        table = table._replace(order=order, turn=self.turn)
        return [pack(PhaseArguments(self.plan, table, space)) for space in self.spaces]


@final
class PhaseExecutor:
    """Runs cases with contacts through their phases.

    Parameters
    ----------
    modes : ModeModels
    layout : Layout
        Of the scene.
    options : StepOptions
        Method, tolerances, largest step and number of steps.
    threads : int
        0 for a case that is always alone and runs in the thread that calls.
    reductions : PhaseReductions
        What users watch.
    state : HybridState
        The cases.
    table : CaseTable
        The same arrays, and what is recorded, with nothing in ``order``, and no stops.
    fits : bool
        Whether "auto" looks at the motions to find a method that fits.
    chosen : callable, optional
        Returns the method for the number of a mode, given the one that would be taken.
    recorded : bool
        Whether the motion of the case, which is alone, is recorded.

    Attributes
    ----------
    runners : list of ModeRunner or HostRunner
    first_step : float or None
        Size of the first step of the case that is recorded and is to begin.
    compile_seconds : float
    """

    def __init__(
        self,
        modes: ModeModels,
        layout: Layout,
        options: StepOptions,
        threads: int,
        reductions: PhaseReductions,
        state: HybridState,
        table: CaseTable,
        *,
        fits: bool = True,
        chosen: Callable[[int, str], str] | None = None,
        recorded: bool = False,
    ) -> None:
        self.modes, self.options, self.threads, self.state, self.table = modes, options, threads, state, table
        self.parameters, self.rows = layout.parameters, GatheredRows.of(layout, modes.equations.contacts)
        self.reductions = reductions
        self.requested = [
            replace(event, name=event.label, terminal=1 if event.apply else int(event.terminal), apply=None)
            for event in reductions.events
        ]
        self.runners: list[ModeRunner | HostRunner] = []
        self.first_step: float | None = None
        self._numbers: dict[tuple[Mode, str, bool], int] = {}
        self._serving: dict[Mode, int] = {}
        self._left: dict[int, tuple[float, dict[str, float]]] = {}
        self._parallel = modes.engine().parallel
        self._fits, self._chosen, self._recorded = fits and options.automatic, chosen, recorded
        self._made: tuple[tuple[int, int, int], _Threads] | None = None
        self._packed: list[NDArray[np.int64]] = []
        self.compile_seconds = 0.0
        self._alone = np.zeros(1, np.int64)

    # -- runners ---------------------------------------------------------------------------

    @property
    def methods(self) -> dict[Mode, str]:
        """Method of each mode that has been run."""
        found = {runner.mode: runner.taken or runner.method for runner in self.runners}
        return found | {mode: self.runners[i].taken or self.runners[i].method for mode, i in self._serving.items()}

    def begin(self, stops: StopTable | None, first_step: float | None) -> None:
        """Prepare for cases that begin: they have stops, or none, and find anew which methods fit.

        `first_step` is the size of the first step of a case that is recorded, None where it is to be chosen.
        """
        if stops is not None or len(self.table.stops.first):
            self._stop_at(no_stops() if stops is None else stops)
        for runner in self.runners:
            runner.forget()
        if self._fits or first_step is not None:
            self._serving.clear()
            self._activate()
        self.compile_seconds, self.first_step = 0.0, first_step

    def _take_first_step(self) -> float | None:
        """Return the size of the first step; what comes after its phase is run as if it had not been given."""
        step, self.first_step = self.first_step, None
        if step is not None:
            self._serving.clear()
            self._activate()
        return step

    def _place(self, some: NDArray[np.intp]) -> None:
        """Give running cases without a runner the one of their mode."""
        numbers = self.table.numbers
        alike = self.state.mode_numbers(some)
        for number in np.unique(alike):
            here = some[alike == number]
            mode, begin = self.modes.automaton.mode(int(number)), time.perf_counter()
            self.modes.model(mode)
            self.compile_seconds += time.perf_counter() - begin
            if mode not in self._serving:
                self._serving[mode] = self._runner(mode, here)
            numbers.runner[here] = self._serving[mode]
        self._activate()

    def _runner(self, mode: Mode, some: NDArray[np.intp]) -> int:
        """Return the number of the runner of a mode, some cases of which are to be run."""
        model = self.modes.model(mode)
        compiled = self._parallel and self.first_step is None and self.modes.impulses(mode) is None
        compiled = compiled and runs_unchecked(model) and {*model.layout.parameters} <= {*self.rows.parameters}
        cases = self._first_cases(mode, some)
        method = self._method(mode, cases, compiled=compiled and cases is not None)
        compiled = compiled and method not in ("auto", "radau")
        key = mode, method, compiled
        if key not in self._numbers:
            self._numbers[key] = len(self.runners)
            events = (*self.requested, *self.modes.events(mode))
            if compiled:
                self.runners.append(ModeRunner(mode, model, events, self.reductions.along, method, self.options))
            else:
                about = events, self.reductions, method, self.options, self._take_first_step, self._left
                self.runners.append(HostRunner(self.modes, mode, *about))
        return self._numbers[key]

    def _method(self, mode: Mode, cases: Cases | None, *, compiled: bool) -> str:
        """Return the method of a mode: "auto" where each run by Python is to find one that fits."""
        own, model = self.options, self.modes.model(mode)
        if self._recorded and not compiled:
            return own.method
        method = model.choose_method(own.method, own.rtol, own.atol, many=True)
        if self._chosen is not None:
            return self._chosen(self.modes.automaton.number(mode), method)
        if not self._fits or cases is None:
            return method if compiled else own.method
        limits = own.rtol, own.atol, own.max_step, own.max_steps
        return fitted(model.engine, cases, Settings(None, method, *limits, threads=1, progress=False)).method

    def _activate(self) -> None:
        """Let modes be served by the runners that were chosen for them, and by no others."""
        if self._made is None:
            return
        served = self._made[1].plan.runners.mode
        for i, runner in enumerate(self.runners[: len(served)]):
            active = self._serving.get(runner.mode) == i
            served[i] = self.modes.automaton.number(runner.mode) if active else NOBODY

    def _first_cases(self, mode: Mode, some: NDArray[np.intp]) -> Cases | None:
        """Return the first, the middle and the last of some cases; None where a symbol excludes a value of theirs."""
        some = some[sorted({0, len(some) // 2, len(some) - 1})]
        model, state, cases = self.modes.model(mode), self.state, self.state.cases
        columns = {name: state.c[some, i] for i, name in enumerate(self.parameters)}
        columns |= self.modes.added(mode, state.directions(some), cases.sides[some], cases.rest[some])
        given = {name: columns[name] for name in model.layout.parameters if name in columns}
        initial = {name: state.x[some, i] for i, name in enumerate(self.rows.states)}
        try:
            return Cases(
                model.stages.program, model.derived.start, (state.t[some], self.table.t1[some]), initial, given
            )
        except ValueInputError:  # the run of the phase says so
            return None

    # -- running ---------------------------------------------------------------------------

    @property
    def calls(self) -> Sequence[LoopCall]:
        """The calls of the runners of the only case, as its last run made them."""
        return () if self._made is None else self._made[1].calls

    def run(self, some: NDArray[np.intp], paused: Callable[[], None] | None = None) -> None:
        """Run cases as far as they go: to their ends, to a jump, or to a mode that has no runner yet.

        `paused` is called whenever the loop returns before that. Raises KeyboardInterrupt where Ctrl-C stopped it.
        """
        unplaced = some[self.table.numbers.runner[some] == NOBODY]
        if len(unplaced):
            self._place(unplaced)
        order = np.ascontiguousarray(some, np.int64) if self.threads else self._alone
        threads = self._thread_memory(len(order))
        threads.turn[0] = 0
        try:
            if self.threads and self._parallel:
                self._work(threads, order)
            else:
                self._work_here(threads, order, paused)
        except BaseException:
            self._made = None  # its loops are in the middle of something
            raise

    def _work_here(self, threads: _Threads, order: NDArray[np.int64], paused: Callable[[], None] | None) -> None:
        """Call the loop in this thread."""
        loop, packed = loop_named("phase_loop").call, self._packed
        if not packed:
            packed = threads.packed(self.table, order)
            self._packed = [] if self.threads else packed
        pointer, going = ctypes.c_void_p(address_of(packed[0])), True
        while going:
            going = bool(loop(pointer))
            raise_failure()
            if going:
                check()
                if paused is not None:
                    paused()

    def _work(self, threads: _Threads, order: NDArray[np.int64]) -> None:
        """Call the loop in threads."""
        loop, packed, begun = loop_named("phase_loop").call, threads.packed(self.table, order), itertools.count()
        stopping = threading.Event()

        def work() -> None:
            with stopped_by(stopping):
                loop(ctypes.c_void_p(address_of(packed[next(begun)])))
                raise_failure()

        def stop() -> None:
            stopping.set()
            for space in threads.spaces:
                space.turns[:] = STOPPED

        run = CaseRun(work, threads.turn, lambda: None, stop=stop)
        if not begin_whole(run, len(order), len(threads.spaces), False)(False):
            raise KeyboardInterrupt

    def _thread_memory(self, count: int) -> _Threads:
        """Return the memory of threads for a number of cases, that of the last time where it fits."""
        if not self.threads and self._made is not None and self._made[0][0] == len(self.runners):
            return self._made[1]
        engine = self.modes.engine()
        lanes = engine.code(self.modes.automaton.contact_data)[1]
        threads = max(self.threads, 1) if self._parallel else 1
        together = min(_MOST_TOGETHER, max(lanes, count // (threads * _BATCHES_PER_THREAD)))
        together = max(count, lanes) if engine.whole_blocks else together
        key = len(self.runners), together, min(threads, -(-count // together))
        if self._made is not None and self._made[0] == key:
            return self._made[1]
        self._carry_signs()
        patience = 0 if self.threads else _PATIENCE
        about = lanes, self.modes.decisions, self.table, self.options.rtol, patience, self._recorded
        made = [thread_workspace(self.runners, self.rows, together, *about) for _ in range(key[2])]
        spaces, calls = [each[0] for each in made], made[0][1]
        self._made, self._packed = (key, _Threads(self._plan(), spaces, np.zeros(1, np.int64), calls, made)), []
        self._activate()
        return self._made[1]

    def _stop_at(self, stops: StopTable) -> None:
        """Take a table of stops."""
        if len(stops.first) != len(self.table.stops.first):
            self._made = None
        self.table, self._packed = self.table._replace(stops=stops), []
        self._carry_signs()

    def _carry_signs(self) -> None:
        """Make room for the signs of all events of a runner, where there are stops."""
        width = max((len(runner.events) for runner in self.runners), default=0)
        before = self.table.carried
        if len(self.table.stops.first) and width > before.shape[1]:
            carried = np.full((len(self.table.t1), width), np.nan)
            carried[: len(before), : before.shape[1]] = before
            self.table, self._packed = self.table._replace(carried=carried), []

    def _plan(self) -> PhasePlan:
        """Return what is the same for all cases."""
        engine, automaton = self.modes.engine(), self.modes.automaton
        data, _ = engine.code(automaton.contact_data)
        width = max((len(runner.model.layout.parameters) for runner in self.runners), default=0)
        columns = np.zeros((len(self.runners), max(width, 1)), np.int64)
        lines, guards = np.zeros((len(self.runners), len(RunnerTable._fields)), np.int64), list[tuple[int, int]]()
        for line, row, runner in zip(lines, columns, self.runners, strict=True):
            names = runner.model.layout.parameters if runner.expands else ()
            row[: len(names)] = [self.rows.parameters[name] for name in names]
            expand = runner.model.engine.code(self.modes.expansion(runner.mode))[0] if runner.expands else 0
            number = automaton.number(runner.mode)
            line[:] = number, runner.size, len(names), len(runner.events), len(guards), expand
            guards += [(g.contact, BITS.get((g.kind, g.sign), 0)) for g in self.modes.guards(runner.mode)]
        return PhasePlan(
            contact_data=data,
            decide=loop_named(LOOP).address,
            runners=RunnerTable(*np.ascontiguousarray(lines.T)),
            columns=columns,
            guards=np.array(guards, np.int64).reshape(len(guards), 2),
            terminal=np.array([int(event.terminal) for event in self.reductions.events], np.int64),
            jumps=np.array([int(event.apply is not None) for event in self.reductions.events], np.int64),
            most_steps=self.options.max_steps,
        )
