"""Modes as compiled code runs them: one station for each mode, and for each set of events that a phase leaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...codegen.base import LoopCall
from ...integrators.cases import BlockResult, CaseColumns
from ...integrators.event_code import Event
from ...integrators.phase_tables import Bench
from ...integrators.workspace import aligned
from ...ir.program import Layout
from ...mechanics.equations import ContactRow
from ...reduction.modes import Mode, direction_names, side_name
from .. import inputs
from ..cases import Cases, Settings
from ..sweep import runs_unchecked
from ..sweeping import fitted

if TYPE_CHECKING:
    from ..model import CompiledModel

__all__ = ["Rows", "Station", "bench", "fitting_method"]


@final
@dataclass(frozen=True)
class Rows:
    """In which row of ``Bench.gathered`` each value of a case is; see `dalembert.integrators.phase_tables`."""

    parameters: Mapping[str, int]
    states: Mapping[str, int]
    count: int

    @classmethod
    def of(cls, layout: Layout, contacts: Sequence[ContactRow]) -> Rows:
        """Return the rows of a scene, start and end being the first two."""
        names = list(layout.parameters)
        names += [name for contact in contacts for name in (*direction_names(contact), "", "")[:2]]
        names += [side_name(contact) or "" for contact in contacts]
        first = 2 + len(names)
        parameters = {name: row for row, name in enumerate(names, 2) if name}
        states = {name: row for row, name in enumerate((*layout.coordinates, *layout.rates), first)}
        return cls(parameters, states, first + len(states))


@final
@dataclass(frozen=True, eq=False)
class Station:
    """A mode, what is watched in it, and the method that fits it."""

    mode: Mode
    model: CompiledModel
    events: tuple[Event, ...]
    method: str
    settings: Mapping[str, Any]

    @property
    def size(self) -> int:
        """Components of the state."""
        return len(self.model.layout.state)

    def call(self, rows: Rows, room: _Room, turn: NDArray[np.int64]) -> LoopCall | None:
        """Return the call that runs the cases that are gathered in a room, None where the engine has none.

        Its next case is `turn` (1,).
        """
        model, names, gathered, k = self.model, tuple(rows.states), room.gathered, room.gathered.shape[1]
        start = model.derived.start(names)
        columns = CaseColumns(
            count=k,
            spans=(gathered[0], gathered[1]),
            parameters=tuple(gathered[rows.parameters[name]] for name in model.layout.parameters),
            given=tuple(gathered[rows.states[name]] for name in start.given),
            start=start,
            t_eval=np.empty(0),
            watch=model.derived.events(self.events),
            **self.settings,
        )
        happened = room.happened[: 3 * k * len(self.events)].reshape(k, -1)
        y = room.y[: k * self.size].reshape(k, self.size)
        result = BlockResult(y, room.ends, np.empty((k, 0, self.size)), happened, np.empty((k, 0)))
        run = model.engine.sweeper(columns, self.method, result, np.empty((0, 0)), k)
        return None if run is None or run.call is None else run.call(turn)


def fitting_method(model: CompiledModel, cases: Cases, settings: Mapping[str, Any], method: str) -> str | None:
    """Return the method for cases of a mode, None where they take more than runs of the engine."""
    if not runs_unchecked(model) or any(name not in cases.parameters for name in model.layout.parameters):
        return None
    chosen = model.choose_method(method, settings["rtol"], settings["atol"], many=True)
    inputs.warn_below_floor(settings["rtol"], settings["atol"], model.stages.program, chosen)
    if method == "auto":
        common = Settings(None, chosen, **settings, threads=1, progress=False)
        chosen = fitted(model.engine, cases, common).method
    return chosen


@final
@dataclass(frozen=True, eq=False)
class _Room:
    """Where cases are gathered, and what becomes of them."""

    gathered: FloatArray
    y: FloatArray
    ends: FloatArray
    happened: FloatArray


def bench(
    stations: Sequence[Station], rows: Rows, together: int, lanes: int, outputs: int, contacts: int
) -> tuple[Bench, object] | None:
    """Return room for one thread, and what must stay alive.

    None where a station has no call.

    Parameters
    ----------
    stations : sequence of Station
    rows : Rows
    together : int
        Cases at a time.
    lanes, outputs, contacts : int
        Lanes of the kernels, and the most outputs of a verdict.
    """
    size = max(station.size for station in stations)
    events = max(len(station.events) for station in stations)
    room = _Room(
        aligned(rows.count, together),
        np.zeros(together * size),
        np.zeros((together, 3)),
        np.zeros(together * 3 * events),
    )
    turns, calls = np.zeros(len(stations), np.int64), []
    for i, station in enumerate(stations):
        call = station.call(rows, room, turns[i : i + 1])
        if call is None:
            return None
        calls.append(call)
    packed_args = np.array([call.packed_args for call in calls])
    n_q2, parameters = len(rows.states), rows.count - 2 - len(rows.states) - 3 * contacts
    made = Bench(
        room.gathered,
        packed_args,
        np.array([call.entry for call in calls], np.int64),
        turns,
        room.y,
        room.ends,
        room.happened,
        np.zeros(together, np.int64),
        np.zeros(lanes, np.int64),
        aligned(1, lanes),
        aligned(size, lanes),
        np.ones((max(parameters + 3 * contacts, 1), lanes)),
        aligned(parameters, lanes),
        aligned(n_q2 + 2 * contacts, lanes),
        aligned(max(contacts, 1), lanes),
        aligned(max(outputs, 2), lanes),
    )
    return made, calls
