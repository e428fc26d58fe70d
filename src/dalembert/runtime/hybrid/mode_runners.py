"""Modes as compiled code runs them, and the memory of a thread that runs them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...codegen.runs import LoopCall
from ...hybrid import Mode
from ...hybrid.modes import allowance_name, direction_names, rest_name, side_name
from ...integrators.arguments import pack
from ...integrators.cases import BlockResult, CaseColumns
from ...integrators.event_code import Event
from ...integrators.phase_tables import CaseTable, PhaseProgress, ThreadWorkspace
from ...integrators.workspace import aligned
from ...ir.program import Layout
from ...mechanics.equations import ContactRow
from ...options import StepOptions
from ..case_blocks import fitted
from ..cases import Cases, Settings
from ..reductions import Reduction
from ..sweep import runs_unchecked
from .decisions import Decisions

if TYPE_CHECKING:
    from ..model import CompiledModel

__all__ = ["GatheredRows", "ModeRunner", "fitting_method", "thread_workspace"]


_FEWEST_ROWS, _MOST_ROWS, _ROOM = 16, 256, 2048
"""Rows for records of steps: at least, at most, and times the components of the state."""


@final
@dataclass(frozen=True)
class GatheredRows:
    """In which row of ``ThreadWorkspace.gathered`` each value of a case is."""

    parameters: Mapping[str, int]
    states: Mapping[str, int]
    count: int

    @classmethod
    def of(cls, layout: Layout, contacts: Sequence[ContactRow]) -> GatheredRows:
        """Return the rows of a scene, start and end being the first two."""
        names = list(layout.parameters)
        names += [name for contact in contacts for name in (*direction_names(contact), "", "")[:2]]
        names += [side_name(contact) or allowance_name(contact) or "" for contact in contacts]
        names += [rest_name(contact) or "" for contact in contacts]
        first = 2 + len(names)
        parameters = {name: row for row, name in enumerate(names, 2) if name}
        states = {name: row for row, name in enumerate(layout.variables, first)}
        return cls(parameters, states, first + len(states))


@final
@dataclass(frozen=True, eq=False)
class ModeRunner:
    """A mode, events and reductions along it, and a method that fits it."""

    mode: Mode
    model: CompiledModel
    events: tuple[Event, ...]
    along: Mapping[str, Reduction]
    method: str
    options: StepOptions

    @property
    def size(self) -> int:
        """Components of the state."""
        return len(self.model.layout.state)

    def call(
        self, rows: GatheredRows, memory: _Memory, turn: NDArray[np.int64], recorded: bool, stops: bool
    ) -> LoopCall | None:
        """Return the call that runs the cases that are gathered in a memory, None where the engine has none.

        Its next case is `turn` (1,). If `recorded`, it records the steps of a case that is alone. With `stops`, cases
        go on where their last run has stopped.
        """
        model, names, gathered, k = self.model, tuple(rows.states), memory.gathered, memory.gathered.shape[1]
        start = model.derived.start(names)
        columns = CaseColumns(
            count=k,
            spans=(gathered[0], gathered[1]),
            parameters=tuple(gathered[rows.parameters[name]] for name in model.layout.parameters),
            given=tuple(gathered[rows.states[name]] for name in start.given),
            start=start,
            t_eval=np.empty(0),
            watch=model.derived.events(self.events, self.along or None),
            rtol=self.options.rtol,
            atol=self.options.atol,
            max_step=self.options.max_step,
            max_steps=self.options.max_steps,
            carried=memory.carried[: k * len(self.events)].reshape(k, -1) if stops else None,
            recorded=max(_FEWEST_ROWS, min(_MOST_ROWS, _ROOM // max(self.size, 1))) if recorded else 0,
            bounded=True,  # guards are located on them
        )
        happened = memory.happened[: 3 * k * len(self.events)].reshape(k, -1)
        y = memory.y[: k * self.size].reshape(k, self.size)
        result = BlockResult(y, memory.ends, np.empty((k, 0, self.size)), happened, memory.totals)
        engine = model.engine.uncut
        run = None if engine is None else engine.sweeper(columns, self.method, result, np.empty((0, 0)), k)
        return None if run is None or run.call is None else run.call(turn)


def fitting_method(model: CompiledModel, cases: Cases, options: StepOptions, *, fits: bool) -> str | None:
    """Return the method for cases of a mode, None where they take more than runs of the engine.

    With ``fits`` the method that is chosen automatically is the one that fits some of the cases.
    """
    if (
        model.engine.uncut is None
        or not runs_unchecked(model)
        or any(name not in cases.parameters for name in model.layout.parameters)
    ):
        return None
    chosen = model.choose_method(options.method, options.rtol, options.atol, many=True)
    if fits:
        limits = options.rtol, options.atol, options.max_step, options.max_steps
        common = Settings(None, chosen, *limits, threads=1, progress=False)
        chosen = fitted(model.engine, cases, common).method
    return chosen


@final
@dataclass(frozen=True, eq=False)
class _Memory:
    """Memory in which cases are gathered and their results are written."""

    gathered: FloatArray
    y: FloatArray
    ends: FloatArray
    happened: FloatArray
    totals: FloatArray
    carried: FloatArray


def thread_workspace(
    runners: Sequence[ModeRunner],
    rows: GatheredRows,
    together: int,
    lanes: int,
    decisions: Decisions,
    table: CaseTable,
    rtol: float,
    patience: int,
    recorded: bool,
) -> tuple[ThreadWorkspace, Sequence[LoopCall], object] | None:
    """Return memory for one thread, the calls of the runners, and what else must stay alive.

    None where a runner has no call.

    Parameters
    ----------
    runners : sequence of ModeRunner
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
    memory = _Memory(
        aligned(rows.count, together),
        np.zeros(together * size),
        np.zeros((together, 3)),
        np.zeros(together * 3 * events),
        np.zeros((together, table.totals.shape[1])),
        np.full(together * events, np.nan),
    )
    turns, calls = np.zeros(len(runners), np.int64), []
    for i, runner in enumerate(runners):
        call = runner.call(rows, memory, turns[i : i + 1], recorded, len(table.stops.first) > 0)
        if call is None:
            return None
        if patience:
            call.progress.returns, call.progress.patience = 1, patience
        calls.append(call)
    numbers = len(decisions.automaton.contact_data.kernel.outputs)
    arguments = decisions.arguments(table.t, table.cases, np.zeros((lanes, numbers)), np.full(lanes, -1), rtol)
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
        chosen=np.zeros(together, np.int64),
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
