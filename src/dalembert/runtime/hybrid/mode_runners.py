"""Modes as compiled code runs them, and the memory of a thread that runs them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...codegen.runs import LoopCall
from ...hybrid import Mode
from ...hybrid.modes import mode_parameters
from ...integrators.arguments import pack
from ...integrators.cases import BlockResult, CaseColumns
from ...integrators.event_code import Event
from ...integrators.phase_tables import CaseTable, PhaseProgress, ThreadWorkspace
from ...integrators.workspace import aligned
from ...ir.program import DIRECTION, Layout
from ...mechanics.equations import ContactRow
from ...options import StepOptions
from ..reductions import Reduction
from .decisions import Decisions

if TYPE_CHECKING:
    from ..model import CompiledModel
    from .host_runners import HostRunner

__all__ = ["GatheredRows", "ModeRunner", "PhaseMemory", "thread_workspace"]


_FEWEST_ROWS, _MOST_ROWS, _ROOM = 16, 256, 2048
"""Rows for records of steps: at least, at most, and times the components of the state."""


@final
@dataclass(frozen=True)
class GatheredRows:
    """In which row of ``ThreadWorkspace.gathered`` each value of a case is; the last has the direction of time."""

    parameters: Mapping[str, int]
    states: Mapping[str, int]
    count: int

    @classmethod
    def of(cls, layout: Layout, contacts: Sequence[ContactRow]) -> GatheredRows:
        """Return the rows of a scene, start and end being the first two."""
        added = [mode_parameters(contact) for contact in contacts]
        names = [*layout.parameters, *(name for first, second, _, _ in added for name in (first, second))]
        names += [*(side for _, _, side, _ in added), *(rest for _, _, _, rest in added)]
        first = 2 + len(names)
        parameters = {name: row for row, name in enumerate(names, 2) if name}
        states = {name: row for row, name in enumerate(layout.variables, first)}
        return cls(parameters, states, first + len(states) + 1)


@final
@dataclass(frozen=True, eq=False)
class ModeRunner:
    """A mode, what is watched in it, and a method: the loop over lanes, compiled.

    The events are those of users, then the guards of the mode. The states that it writes are those of the formulation
    (`expands`); the method is the one that it has.
    """

    mode: Mode
    model: CompiledModel
    events: tuple[Event, ...]
    along: Mapping[str, Reduction]
    method: str
    options: StepOptions
    expands: ClassVar[bool] = True
    taken: ClassVar[str] = ""

    def forget(self) -> None:
        """Do nothing: earlier motions leave nothing behind."""

    @property
    def size(self) -> int:
        """Components of the state."""
        return len(self.model.layout.state)

    def call(
        self, rows: GatheredRows, memory: PhaseMemory, table: CaseTable, turn: NDArray[np.int64], recorded: bool
    ) -> LoopCall:
        """Return the call that runs the cases that are gathered in a memory.

        Its next case is `turn` (1,). If `recorded`, it records the motion of a case that is alone. Where the table has
        stops, cases go on where their last run has stopped.
        """
        stops = len(table.stops.first) > 0
        model, gathered, k = self.model, memory.gathered, memory.gathered.shape[1]
        given = {**rows.states, DIRECTION: rows.count - 1}
        start = model.derived.start(given)
        columns = CaseColumns(
            count=k,
            spans=(gathered[0], gathered[1]),
            parameters=tuple(gathered[rows.parameters[name]] for name in model.layout.parameters),
            given=tuple(gathered[given[name]] for name in start.given),
            start=start,
            t_eval=np.empty(0),
            watch=model.derived.events(self.events, self.along or None),
            rtol=self.options.rtol,
            atol=self.options.atol,
            max_step=self.options.max_step,
            max_steps=self.options.max_steps,
            carried=memory.carried[: k * len(self.events)].reshape(k, -1) if stops else None,
            recorded=max(_FEWEST_ROWS, min(_MOST_ROWS, _ROOM // max(self.size, 1))) if recorded else 0,
        )
        happened = memory.happened[: 3 * k * len(self.events)].reshape(k, -1)
        y = memory.y[: k * self.size].reshape(k, self.size)
        result = BlockResult(y, memory.ends, np.empty((k, 0, self.size)), happened, memory.totals)
        engine = model.engine.uncut
        run = engine.sweeper(columns, self.method, result, np.empty((0, 0)), k)
        assert run is not None and run.call is not None
        return run.call(turn)


@final
@dataclass(frozen=True, eq=False)
class PhaseMemory:
    """Memory in which cases are gathered, by number, and their results are written."""

    gathered: FloatArray
    y: FloatArray
    ends: FloatArray
    happened: FloatArray
    totals: FloatArray
    carried: FloatArray
    chosen: NDArray[np.int64]


def thread_workspace(
    runners: Sequence[ModeRunner | HostRunner],
    rows: GatheredRows,
    together: int,
    lanes: int,
    decisions: Decisions,
    table: CaseTable,
    rtol: float,
    patience: int,
    recorded: bool,
) -> tuple[ThreadWorkspace, Sequence[LoopCall], object]:
    """Return memory for one thread, the calls of the runners, and what else must stay alive.

    Parameters
    ----------
    runners : sequence of ModeRunner or HostRunner
    rows : GatheredRows
    together : int
        Cases at a time.
    lanes : int
        Lanes of the kernels.
    decisions : Decisions
    table : CaseTable
        The cases that are decided.
    rtol : float
        Relative tolerance.
    patience : int
        Rounds of a loop over lanes after which it returns to Python; 0: it does not.
    recorded : bool
        Whether the steps of a case that is alone are recorded.
    """
    size = max((runner.size for runner in runners), default=0)
    events = max((len(runner.events) for runner in runners), default=0)
    memory = PhaseMemory(
        aligned(rows.count, together),
        np.zeros(together * size),
        np.zeros((together, 3)),
        np.zeros(together * 3 * events),
        np.zeros((together, table.totals.shape[1])),
        np.full(together * events, np.nan),
        np.zeros(together, np.int64),
    )
    turns, calls = np.zeros(len(runners), np.int64), []
    for i, runner in enumerate(runners):
        call = runner.call(rows, memory, table, turns[i : i + 1], recorded)
        if patience:
            call.progress.returns, call.progress.patience = 1, patience
        calls.append(call)
    numbers = len(decisions.automaton.contact_data.outputs)
    arguments = decisions.arguments(table.cases, np.zeros((lanes, numbers)), np.full(lanes, -1), rtol)
    scene = table.p.shape[1]
    made = ThreadWorkspace(
        gathered=memory.gathered,
        entries=np.array([call.entry for call in calls], np.int64),
        packed_args=np.array([call.packed_args for call in calls], np.int64).reshape(len(calls), -1 if calls else 0),
        turns=turns,
        y=memory.y,
        ends=memory.ends,
        happened=memory.happened,
        totals=memory.totals,
        carried=memory.carried,
        reaching=np.full((2, lanes), -1, np.int64),
        acted=aligned(int(max(np.diff(table.stops.columns), default=1)), lanes),
        chosen=memory.chosen,
        clock=aligned(1, lanes),
        states=aligned(max(size, 1), lanes),
        constants=np.ones((max(rows.count, 1), lanes)),
        scene=aligned(max(scene, 1), lanes),
        posed=aligned(table.cases.x.shape[1], lanes),
        data=aligned(numbers, lanes),
        wanted=arguments.wanted,
        values=arguments.values,
        after_impact=arguments.after_impact,
        decision=pack(arguments).reshape(1, -1),
        progress=PhaseProgress(),
    )
    return made, calls, arguments
