"""Execution of phases by compiled code: cases run from mode to mode as long as the modes have been compiled."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...codegen.base import CaseRun
from ...codegen.llvm.loops import loop_named
from ...errors import ValueInputError
from ...hybrid import Mode
from ...integrators.event_code import Event
from ...integrators.phase_loop import PhaseArguments
from ...integrators.phase_tables import CaseTable, PhasePlan, RunnerTable, ThreadWorkspace
from ...interrupts import STOPPED
from ...ir.program import Layout
from ...options import StepOptions
from ..case_blocks import begin_whole
from ..cases import Cases
from .decisions import LOOP, flag
from .mode_models import ModeModels
from .mode_runners import GatheredRows, ModeRunner, fitting_method, thread_workspace
from .state import HybridState

__all__ = ["PhaseExecutor"]

_MOST_TOGETHER = 256
"""Cases that a thread runs together: enough to fill lanes, and few enough for the nearest cache."""
_BATCHES_PER_THREAD = 4


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
    events : sequence of Event
        What users watch.
    state : HybridState
        The cases.
    table : CaseTable
        The same arrays, and what is recorded, with nothing in ``order``.
    """

    def __init__(
        self,
        modes: ModeModels,
        layout: Layout,
        options: StepOptions,
        threads: int,
        events: Sequence[Event],
        state: HybridState,
        table: CaseTable,
    ) -> None:
        self.modes, self.options, self.threads, self.state, self.table = modes, options, threads, state, table
        self.parameters, self.rows = layout.parameters, GatheredRows.of(layout, modes.equations.contacts)
        self.asked = [replace(event, name=event.label) for event in events]
        self.methods: dict[Mode, str | None] = {}
        self.numbers: dict[Mode, int] = {}
        self.runners: list[ModeRunner] = []

    # -- runners ---------------------------------------------------------------------------

    def _place(self, some: NDArray[np.intp]) -> None:
        """Give running cases without a runner the one of their mode, where there is any."""
        numbers = self.table.numbers
        alike = self.state.mode_numbers(some)
        for number in np.unique(alike):
            here = some[alike == number]
            mode = self.modes.automaton.mode(int(number))
            if mode not in self.methods:
                self.methods[mode] = self._method(mode, here)
            numbers.runner[here] = self._runner(mode)

    def _runner(self, mode: Mode) -> int:
        """Return the number of the runner of a mode; -1 where compiled code does not serve it."""
        method = self.methods.get(mode)
        if method is None or method == "radau":
            return -1
        if mode not in self.numbers:
            self.numbers[mode] = len(self.runners)
            events = (*self.asked, *self.modes.events(mode))
            self.runners.append(ModeRunner(mode, self.modes.model(mode), events, method, self.options))
        return self.numbers[mode]

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
        return fitting_method(model, ready, self.options)

    # -- running ---------------------------------------------------------------------------

    def run(self, some: NDArray[np.intp]) -> bool:
        """Run those of some cases whose modes have runners as far as they go; return whether there are any.

        Raises KeyboardInterrupt where Ctrl-C stopped it.
        """
        numbers, loop = self.table.numbers, self.modes.engine().phases
        if loop is None:
            return False
        self._place(some[numbers.runner[some] < 0])
        order = np.ascontiguousarray(some[numbers.runner[some] >= 0], np.int64)
        if not len(order):
            return False
        plan, lanes = self._plan()
        threads = self.threads
        together = min(_MOST_TOGETHER, max(lanes, len(order) // (threads * _BATCHES_PER_THREAD)))
        threads = min(threads, -(-len(order) // together))
        spaces: list[tuple[ThreadWorkspace, object]] = []
        for _ in range(threads):
            about = lanes, self.modes.decisions, self.table, self.options.rtol
            made = thread_workspace(self.runners, self.rows, together, *about)
            if made is None:
                self.methods = dict.fromkeys(self.methods)
                numbers.runner[:] = -1
                return False
            spaces.append(made)
        turn = np.zeros(1, np.int64)
        table, threads_begun = self.table._replace(order=order, turn=turn), itertools.count()

        def work() -> None:
            loop(PhaseArguments(plan, table, spaces[next(threads_begun)][0]))

        def stop() -> None:
            for space, _ in spaces:
                space.turns[:] = STOPPED

        run = CaseRun(work, turn, lambda: None, stop=stop)
        if not begin_whole(run, len(order), threads, False)(False):
            raise KeyboardInterrupt
        return True

    def _plan(self) -> tuple[PhasePlan, int]:
        """Return what is the same for all cases, and the lanes of kernels."""
        engine, automaton = self.modes.engine(), self.modes.automaton
        data, lanes = engine.code(automaton.contact_data.kernel)
        width = max(len(runner.model.layout.parameters) for runner in self.runners)
        columns = np.zeros((len(self.runners), max(width, 1)), np.int64)
        lines, guards = [], list[tuple[int, int]]()
        for row, runner in zip(columns, self.runners, strict=True):
            names = runner.model.layout.parameters
            row[: len(names)] = [self.rows.parameters[name] for name in names]
            expand, _ = runner.model.engine.code(self.modes.expansion(runner.mode))
            number = automaton.number(runner.mode)
            lines.append([number, runner.size, len(names), len(runner.events), len(guards), expand])
            guards += [(guard.contact, flag(guard)) for guard in self.modes.guards(runner.mode)]
        table = np.ascontiguousarray(np.array(lines, np.int64).T)
        return PhasePlan(
            contact_data=data,
            decide=loop_named(LOOP).address,
            runners=RunnerTable(*table),
            columns=columns,
            guards=np.array(guards, np.int64).reshape(len(guards), 2),
            terminal=np.array([int(bool(event.terminal)) for event in self.asked], np.int64),
            most_steps=self.options.max_steps,
        ), lanes
