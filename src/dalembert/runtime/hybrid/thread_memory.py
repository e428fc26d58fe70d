"""Memory of a thread that runs phases."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...codegen.runs import LoopCall
from ...integrators.addresses import AddressTable
from ...integrators.arguments import kind_of, pack
from ...integrators.phase_tables import CaseTable, PhaseProgress, ThreadWorkspace
from ...integrators.sweep_arguments import SweepArguments
from ...integrators.workspace import aligned
from .runner_choice import RunnerChoice

__all__ = ["thread_workspace"]

_WORDS = len(kind_of(SweepArguments).words)


def thread_workspace(
    choice: RunnerChoice, table: CaseTable, together: int, lanes: int, patience: int
) -> tuple[ThreadWorkspace, Sequence[LoopCall], object]:
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
        Rounds of a loop over lanes after which it returns to Python; 0: it does not.
    """
    runners, rows, decisions = choice.runners, choice.gathered, choice.modes.decisions
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
        carried=np.full(together * events, np.nan),
        reaching=np.full((2, lanes), -1, np.int64),
        acted=aligned(int(max(np.diff(table.stops.columns), default=1)), lanes),
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
        progress=PhaseProgress(),
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
