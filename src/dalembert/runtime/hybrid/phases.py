"""Execution of phases by compiled code: cases run from mode to mode as long as the modes have been compiled."""

from __future__ import annotations

import ctypes
import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...codegen.llvm.loops import loop_named
from ...codegen.runs import CaseRun, LoopCall
from ...errors import ValueInputError
from ...hybrid import Mode
from ...integrators.arguments import address_of, pack
from ...integrators.phase_loop import PhaseArguments
from ...integrators.phase_stops import StopTable
from ...integrators.phase_tables import NOBODY, CaseTable, PhasePlan, RunnerTable, ThreadWorkspace
from ...interrupts import STOPPED, check
from ...ir.program import Layout
from ...options import StepOptions
from ..case_blocks import begin_whole
from ..cases import Cases
from .decisions import LOOP, flag
from .mode_models import ModeModels
from .mode_runners import GatheredRows, ModeRunner, fitting_method, thread_workspace
from .reductions import PhaseReductions
from .state import HybridState

__all__ = ["PhaseExecutor", "compiled_phases"]

_MOST_TOGETHER = 256
"""Cases that a thread runs together: enough to fill lanes, and few enough for the nearest cache."""
_BATCHES_PER_THREAD = 4
_PATIENCE = 4096
"""Rounds of a loop over lanes after which a case alone returns to Python, where Ctrl-C is raised."""


def compiled_phases(modes: ModeModels) -> bool:
    """Whether the engine of a scene has the loop over phases, which calls no Python functions."""
    functions = [item for item in modes.equations.controllers if item.function is not None]
    return modes.engine().phases is not None and not functions


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
        Of an engine that has the loop (`compiled_phases`).
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
        The same arrays, and what is recorded, with nothing in ``order``.
    fits : bool
        Whether "auto" looks at the motions to find a method that fits.
    chosen : callable
        Returns the method for the number of a mode, given the one that would be taken.
    recorded : bool
        Whether the steps of the case, which is alone, are recorded.
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
        chosen: Callable[[int, str], str] = lambda mode, method: method,
        recorded: bool = False,
    ) -> None:
        self.modes, self.options, self.threads, self.state, self.table = modes, options, threads, state, table
        self.parameters, self.rows = layout.parameters, GatheredRows.of(layout, modes.equations.contacts)
        self.reductions = reductions
        self.asked = [
            replace(event, name=event.label, terminal=1 if event.apply else int(event.terminal), apply=None)
            for event in reductions.events
        ]
        self.methods: dict[Mode, str | None] = {}
        self.numbers: dict[tuple[Mode, str], int] = {}
        self.runners: list[ModeRunner] = []
        self._fits, self._chosen, self._recorded = fits and options.automatic, chosen, recorded
        self._made: tuple[tuple[int, int, int], _Threads] | None = None
        self._packed: list[NDArray[np.int64]] = []
        self.compile_seconds = 0.0
        self._alone = np.zeros(1, np.int64)

    # -- runners ---------------------------------------------------------------------------

    def forget_methods(self) -> None:
        """Find out anew which methods fit, because other motions follow."""
        if self._fits:
            self.methods.clear()
            self._activate()

    def _place(self, some: NDArray[np.intp]) -> None:
        """Give running cases without a runner the one of their mode, where there is any."""
        numbers = self.table.numbers
        alike = self.state.mode_numbers(some)
        for number in np.unique(alike):
            here = some[alike == number]
            mode, begin = self.modes.automaton.mode(int(number)), time.perf_counter()
            self.modes.model(mode)
            self.compile_seconds += time.perf_counter() - begin
            if mode not in self.methods:
                self.methods[mode] = self._method(mode, here)
            numbers.runner[here] = self._runner(mode)

    def _runner(self, mode: Mode) -> int:
        """Return the number of the runner of a mode; `NOBODY` where compiled code does not serve it."""
        method = self.methods.get(mode)
        if method is None or method == "radau":
            return NOBODY
        key = mode, method
        if key not in self.numbers:
            self.numbers[key] = len(self.runners)
            events, along = (*self.asked, *self.modes.events(mode)), self.reductions.along
            self.runners.append(ModeRunner(mode, self.modes.model(mode), events, along, method, self.options))
        self._activate()
        return self.numbers[key]

    def _activate(self) -> None:
        """Let modes be served by the runners of their methods, and by no others."""
        if self._made is None:
            return
        served = self._made[1].plan.runners.mode
        for i, runner in enumerate(self.runners[: len(served)]):
            active = self.methods.get(runner.mode) == runner.method
            served[i] = self.modes.automaton.number(runner.mode) if active else NOBODY

    def _method(self, mode: Mode, some: NDArray[np.intp]) -> str | None:
        """Return the method that fits the first, the middle and the last of some cases."""
        some = some[sorted({0, len(some) // 2, len(some) - 1})]
        model, state, cases = self.modes.model(mode), self.state, self.state.cases
        columns = {name: state.c[some, i] for i, name in enumerate(self.parameters)}
        columns |= self.modes.added(mode, state.directions(some), cases.sides[some], cases.rest[some])
        if any(name not in columns for name in model.layout.parameters):
            return None
        given = {name: columns[name] for name in model.layout.parameters}
        initial = {name: state.x[some, i] for i, name in enumerate(self.rows.states)}
        try:
            spans = state.t[some], self.table.t1[some]
            ready = Cases(model.stages.program, model.derived.start, spans, initial, given)
        except ValueInputError:  # a value that its symbol excludes; the run of the phase says so
            return None
        found = fitting_method(model, ready, self.options, fits=self._fits)
        return found and self._chosen(self.modes.automaton.number(mode), found)

    # -- running ---------------------------------------------------------------------------

    def run(self, some: NDArray[np.intp]) -> bool:
        """Run those of some cases whose modes have runners as far as they go; return whether there are any.

        Raises KeyboardInterrupt where Ctrl-C stopped it.
        """
        numbers = self.table.numbers
        self._place(some[numbers.runner[some] == NOBODY])
        return self._run(np.ascontiguousarray(some[numbers.runner[some] != NOBODY], np.int64))

    def run_alone(self, paused: Callable[[], None] | None = None) -> bool:
        """Run the only case as far as it goes; return whether its mode has a runner.

        `paused` is called whenever the loop returns before that.
        """
        if self.table.numbers.runner[0] == NOBODY:
            self._place(self._alone)
        return self.table.numbers.runner[0] != NOBODY and self._run(self._alone, paused)

    @property
    def calls(self) -> Sequence[LoopCall]:
        """The calls of the runners of the only case, as its last run made them."""
        return () if self._made is None else self._made[1].calls

    def _run(self, order: NDArray[np.int64], paused: Callable[[], None] | None = None) -> bool:
        """Run cases that have runners, or are to begin."""
        if not len(order):
            return False
        threads = self._thread_memory(len(order))
        if threads is None:
            self.methods = dict.fromkeys(self.methods)
            self.table.numbers.runner[order] = NOBODY
            return False
        try:
            self._work(threads, order, paused)
        except KeyboardInterrupt:
            self._made = None  # its loops are in the middle of something
            raise
        return True

    def _work(self, threads: _Threads, order: NDArray[np.int64], paused: Callable[[], None] | None) -> None:
        """Call the loop, in threads unless a case is alone."""
        loop, threads.turn[0] = loop_named("phase_loop").call, 0
        if not self.threads:
            if not self._packed:
                self._packed = threads.packed(self.table, self._alone)
            pointer = ctypes.c_void_p(address_of(self._packed[0]))
            while loop(pointer):
                check()
                if paused is not None:
                    paused()
            return
        packed, begun = threads.packed(self.table, order), itertools.count()

        def work() -> None:
            loop(ctypes.c_void_p(address_of(packed[next(begun)])))

        def stop() -> None:
            for space in threads.spaces:
                space.turns[:] = STOPPED

        run = CaseRun(work, threads.turn, lambda: None, stop=stop)
        if not begin_whole(run, len(order), len(threads.spaces), False)(False):
            raise KeyboardInterrupt

    def _thread_memory(self, count: int) -> _Threads | None:
        """Return the memory of threads for a number of cases, that of the last time where it fits.

        None where a runner has no call.
        """
        if not self.threads and self._made is not None and self._made[0][0] == len(self.runners):
            return self._made[1]
        lanes = self.modes.engine().code(self.modes.automaton.contact_data.kernel)[1]
        threads = max(self.threads, 1)
        together = min(_MOST_TOGETHER, max(lanes, count // (threads * _BATCHES_PER_THREAD)))
        key = len(self.runners), together, min(threads, -(-count // together))
        if self._made is not None and self._made[0] == key:
            return self._made[1]
        self._carry_signs()
        patience = 0 if self.threads else _PATIENCE
        about = lanes, self.modes.decisions, self.table, self.options.rtol, patience, self._recorded
        made = [thread_workspace(self.runners, self.rows, together, *about) for _ in range(key[2])]
        spaces = [each[0] for each in made if each is not None]
        calls = [each[1] for each in made if each is not None]
        if len(spaces) < len(made):
            return None
        self._made, self._packed = (key, _Threads(self._plan(), spaces, np.zeros(1, np.int64), calls[0], made)), []
        self._activate()
        return self._made[1]

    def stop_at(self, stops: StopTable) -> None:
        """Let cases stop at the stops of a table; there must have been one before, or no run."""
        if not len(stops.first) == len(self.table.stops.first):
            self._made = None
        self.table, self._packed = self.table._replace(stops=stops), []
        self._carry_signs()

    def _carry_signs(self) -> None:
        """Make room for the signs of all events of a runner, where there are stops."""
        width = max((len(runner.events) for runner in self.runners), default=0)
        before = self.table.carried
        if len(self.table.stops.first) and width > before.shape[1]:
            carried = np.full((len(self.table.t), width), np.nan)
            carried[: len(before), : before.shape[1]] = before
            self.table, self._packed = self.table._replace(carried=carried), []

    def _plan(self) -> PhasePlan:
        """Return what is the same for all cases."""
        engine, automaton = self.modes.engine(), self.modes.automaton
        data, _ = engine.code(automaton.contact_data.kernel)
        width = max((len(runner.model.layout.parameters) for runner in self.runners), default=0)
        columns = np.zeros((len(self.runners), max(width, 1)), np.int64)
        lines, guards = np.zeros((len(self.runners), len(RunnerTable._fields)), np.int64), list[tuple[int, int]]()
        for line, row, runner in zip(lines, columns, self.runners, strict=True):
            names = runner.model.layout.parameters
            row[: len(names)] = [self.rows.parameters[name] for name in names]
            expand, _ = runner.model.engine.code(self.modes.expansion(runner.mode))
            number = automaton.number(runner.mode)
            line[:] = number, runner.size, len(names), len(runner.events), len(guards), expand
            guards += [(guard.contact, flag(guard)) for guard in self.modes.guards(runner.mode)]
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
