"""Execution of phases: the loop over phases carries cases from mode to mode, each run by compiled code or by Python."""

from __future__ import annotations

import ctypes
import itertools
import threading
from collections.abc import Callable, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import aligned
from ..codegen.host_code import raise_failure
from ..codegen.llvm.loops import Loop, loop_named
from ..codegen.runs import CaseRun, LoopCall
from ..contacts.automaton import BITS
from ..contacts.contact_decisions import DecisionArguments
from ..contacts.phase_loop import PhaseArguments
from ..contacts.phase_stops import PhaseStops, no_phase_stops
from ..contacts.phase_tables import NO_RUNNER, CaseTable, PhasePlan, PhaseProgress, RunnerTable, ThreadWorkspace
from ..frozen import frozen
from ..lanes.sweep_arguments import SweepArguments
from ..methods.status import RUNNING
from ..runs.case_blocks import run_shared
from ..subset.arguments import AddressTable, kind_of
from ..subset.packing import address_of, pack
from ..threads import STOPPED, check, stopped_by
from .decisions import LOOP
from .runner_choice import RunnerChoice

# Memory of a thread that runs phases.

_WORDS = len(kind_of(SweepArguments).words)


def thread_workspace(
    choice: RunnerChoice, table: CaseTable, together: int, lanes: int, patience: int
) -> tuple[ThreadWorkspace, Sequence[LoopCall], DecisionArguments]:
    """Return memory for one thread, the calls of the runners, and what else must stay alive.

    Parameters
    ----------
    choice : RunnerChoice
        The runners.
    table : CaseTable
        The cases.
    together : int
        Cases at a time.
    lanes : int
        Lanes of the kernels.
    patience : int
        Rounds of a loop over lanes, and phases, after which it returns to Python; 0: it does not.
    """
    runners, rows, decisions, progress = choice.runners, choice.gathered, choice.modes.decisions, PhaseProgress()
    progress.patience = patience
    size = max((runner.size for runner in runners), default=0)
    events = max((len(runner.events) for runner in runners), default=0)
    numbers = len(decisions.automaton.contact_data.outputs)
    tolerances = choice.options.rtol, choice.options.atol
    deciding = decisions.arguments(table.cases, np.zeros((lanes, numbers)), np.full(lanes, -1), tolerances)
    space = ThreadWorkspace(
        gathered=aligned(rows.count, together),
        entries=AddressTable.zeros(len(runners)),
        packed_args=np.zeros((len(runners), _WORDS), np.int64),
        turns=np.zeros(len(runners), np.int64),
        y=np.zeros(together * size),
        ends=np.zeros((together, 3)),
        happened=np.zeros(together * 3 * events),
        totals=np.zeros((together, table.totals.shape[1])),
        carried=np.zeros(together * 2 * events),
        reaching=np.full((2, lanes), -1, np.int64),
        acted=aligned(int(max(np.diff(table.stops.table.columns), default=1)), lanes),
        chosen=np.zeros(together, np.int64),
        sampled=np.zeros(together, np.int64),
        clock=aligned(1, lanes),
        states=aligned(max(size, 1), lanes),
        constants=np.ones((max(rows.count, 1), lanes)),
        scene=aligned(max(table.cases.p.shape[1], 1), lanes),
        posed=aligned(table.cases.x.shape[1], lanes),
        data=aligned(numbers, lanes),
        deciding=deciding.deciding,
        ending=deciding.ending,
        values=deciding.values,
        after_impact=deciding.after_impact,
        decision=pack(deciding).reshape(1, -1),
        progress=progress,
    )
    rows.set_constants(space.gathered)
    calls = []
    for i, runner in enumerate(runners):
        call = runner.call(rows, space, table, space.turns[i : i + 1], choice.rows)
        if patience:
            call.progress.returns, call.progress.patience = 1, patience
        space.entries[i], space.packed_args[i] = call.entry, call.packed_args
        calls.append(call)
    return space, calls, deciding


_MOST_TOGETHER = 256
"""Cases that a thread runs together: enough to fill lanes, and few enough for the nearest cache."""
_BATCHES_PER_THREAD = 4
_PATIENCE = 4096
"""Rounds of a loop over lanes, and phases, after which a single thread returns to Python, where Ctrl-C is raised."""


@final
@frozen(eq=False)
class _Threads:
    """The loop, runners as it sees them, the memory of threads, the calls of the first, and what must stay alive."""

    loop: Loop
    plan: PhasePlan
    spaces: list[ThreadWorkspace]
    order: NDArray[np.int64]
    turn: NDArray[np.int64]
    calls: Sequence[LoopCall]
    held: Sequence[tuple[ThreadWorkspace, Sequence[LoopCall], DecisionArguments]]

    def packed(self, table: CaseTable) -> list[NDArray[np.int64]]:
        """Return the packed arguments of the loop of each thread."""
        table = table._replace(order=self.order, turn=self.turn)
        return [pack(PhaseArguments(self.plan, table, space)) for space in self.spaces]


@final
class PhaseExecutor:
    """Runs cases with contacts through their phases.

    Parameters
    ----------
    choice : RunnerChoice
        The runners of the modes.
    table : CaseTable
        The cases, and what is recorded of them, with nothing in ``order``, and no stops.
    threads : int
        0 for a case that is always alone. What takes one thread runs in the one that calls.
    """

    def __init__(self, choice: RunnerChoice, table: CaseTable, threads: int) -> None:
        self.choice, self.table, self.threads = choice, table, threads
        self._made: tuple[tuple[int, int, int], _Threads] | None = None
        self._packed: list[NDArray[np.int64]] = []

    def begin(self, stops: PhaseStops | None) -> None:
        """Prepare for cases that begin, with stops or without."""
        self.table.carried[:, 1::2] = 0.0
        if stops is None and not len(self.table.stops.table.first):
            return
        stops = no_phase_stops() if stops is None else stops
        if len(stops.table.first) != len(self.table.stops.table.first):
            self._made = None
        self.table, self._packed = self.table._replace(stops=stops), []
        self._carry_signs()

    def forget_memory(self) -> None:
        """Have the memory of threads made anew."""
        self._made, self._packed = None, []

    @property
    def calls(self) -> Sequence[LoopCall]:
        """The calls of the runners of the only case, as its last run made them."""
        return () if self._made is None else self._made[1].calls

    def arguments_alone(
        self, *, continued: bool = False
    ) -> tuple[PhaseArguments, DecisionArguments, list[SweepArguments]]:
        """Return the arguments of all loops for a case that is alone: of phases, decisions, and each runner.

        `continued`: its end may be moved when it is reached, over which signs of events are carried.
        """
        if continued:
            self._carry_signs(True)
        threads = self._thread_memory(1)
        space, calls, decision = threads.held[0]
        table = self.table._replace(order=threads.order, turn=threads.turn)
        held: list[Any] = [call.held for call in calls]
        return PhaseArguments(threads.plan, table, space), decision, [arguments for _, arguments in held]

    def run(self, some: NDArray[np.intp], paused: Callable[[], None] | None = None) -> None:
        """Run cases as far as possible: to their ends, to a jump, or to a mode that has no runner yet.

        `paused` is called whenever the loop returns before that. Raises KeyboardInterrupt where Ctrl-C stopped it.
        """
        unplaced = some[self.table.numbers.runner[some] == NO_RUNNER]
        if len(unplaced):
            self.choice.place(self.table, unplaced)
            some = some[self.table.numbers.state[some] == RUNNING]
            if not len(some):
                return
        threads = self._thread_memory(len(some))
        threads.order[: len(some)], threads.turn[:] = some, (0, len(some))
        self._packed = self._packed or threads.packed(self.table)
        try:
            if len(threads.spaces) > 1:
                self._work(threads, len(some))
            else:
                self._work_here(threads, paused)
        except BaseException:
            self.forget_memory()  # its loops are in the middle of something
            raise

    def _work_here(self, threads: _Threads, paused: Callable[[], None] | None) -> None:
        """Call the loop in this thread."""
        loop, pointer, going = threads.loop.call, ctypes.c_void_p(address_of(self._packed[0])), True
        while going:
            going = bool(loop(pointer))
            raise_failure()
            if going:
                check()
                if paused is not None:
                    paused()

    def _work(self, threads: _Threads, count: int) -> None:
        """Call the loop in threads, for so many cases."""
        loop, packed, numbers = threads.loop.call, self._packed, itertools.count()
        stopping = threading.Event()

        def work() -> None:
            with stopped_by(stopping):
                loop(ctypes.c_void_p(address_of(packed[next(numbers)])))
                raise_failure()

        def stop() -> None:
            stopping.set()
            for space in threads.spaces:
                space.turns[:] = STOPPED

        run = CaseRun(work, threads.turn, lambda: None, stop=stop)
        if not run_shared(run, count, len(threads.spaces), False):
            raise KeyboardInterrupt

    # -- memory ----------------------------------------------------------------------------

    def _thread_memory(self, count: int) -> _Threads:
        """Return the memory of threads for a number of cases, that of the last time where it fits."""
        choice, modes = self.choice, self.choice.modes
        if not self.threads and self._made is not None and self._made[0][0] == len(choice.runners):
            return self._made[1]
        engine = modes.engine()
        lanes = engine.code(modes.automaton.contact_data)[1]
        threads = max(self.threads, 1) if choice.parallel else 1
        together = min(_MOST_TOGETHER, max(lanes, count // (threads * _BATCHES_PER_THREAD)))
        together = max(count, lanes) if engine.whole_blocks else together
        key = len(choice.runners), together, min(threads, -(-count // together))
        if self._made is not None and self._made[0] == key:
            return self._made[1]
        self._carry_signs()
        patience = _PATIENCE if key[2] == 1 else 0
        made = [thread_workspace(choice, self.table, together, lanes, patience) for _ in range(key[2])]
        spaces, calls = [each[0] for each in made], made[0][1]
        order, turn = np.zeros(len(self.table.t1), np.int64), np.array([0, 1])
        loop, plan = loop_named("phase_loop"), self._plan()
        self._made, self._packed = (key, _Threads(loop, plan, spaces, order, turn, calls, made)), []
        return self._made[1]

    def _carry_signs(self, stops: bool = False) -> None:
        """Make room for what cases carry of all events of a runner, where events map states or cases stop."""
        width = 2 * max((len(runner.events) for runner in self.choice.runners), default=0)
        before, maps = self.table.carried, any(event.apply is not None for event in self.choice.reductions.events)
        if (stops or maps or len(self.table.stops.table.first)) and width > before.shape[1]:
            carried = np.zeros((len(self.table.t1), width))
            carried[:, ::2] = np.nan
            carried[: len(before), : before.shape[1]] = before
            self.table, self._packed = self.table._replace(carried=carried), []

    def _plan(self) -> PhasePlan:
        """Return what is the same for all cases."""
        choice, modes, runners = self.choice, self.choice.modes, self.choice.runners
        width = max((len(runner.model.layout.parameters) for runner in runners), default=0)
        columns = np.zeros((len(runners), max(width, 1)), np.int64)
        lines, guards = np.zeros((5, len(runners)), np.int64), list[tuple[int, int, int]]()
        expand = AddressTable.zeros(len(runners))
        for i, (row, runner) in enumerate(zip(columns, runners, strict=True)):
            names = runner.model.layout.parameters if runner.expand else ()
            places = choice.gathered.with_switches(modes.switched(runner.mode))
            row[: len(names)] = [places[name] for name in names]
            expand[i] = runner.expand
            lines[:, i] = runner.size, len(names), len(runner.events), len(guards), runner.samples_inside
            own, kinked = modes.guards(runner.mode), modes.kinked(runner.mode)
            guards += [(g.contact, BITS.get((g.kind, g.sign), 0), int(g.output in kinked)) for g in own]
        watched = choice.reductions.events
        return PhasePlan(
            contact_data=modes.engine().code(modes.automaton.contact_data)[0],
            decide=loop_named(LOOP).entry,
            runners=RunnerTable(choice.served, lines[0], lines[1], lines[2], lines[3], expand, lines[4], choice.begins),
            columns=columns,
            guards=np.array(guards, np.int64).reshape(len(guards), 3),
            terminal=np.array([int(event.terminal) for event in watched], np.int64),
            jumps=np.array([int(event.apply is not None) for event in watched], np.int64),
            most_steps=choice.options.max_steps,
        )
