"""Cases of a sweep carried through their phases by compiled code, as far as that is sure of how they go on."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ...codegen.base import CaseRun
from ...errors import ValueInputError
from ...integrators.event_code import Event
from ...integrators.phase_loop import PhaseArguments
from ...integrators.phase_tables import AttemptTable, Bench, Fleet, Plan, RuleTable, StationTable
from ...interrupts import STOPPED
from ...ir.program import Layout
from ...mechanics.equations import Watchpoint
from ...reduction.modes import OPEN, Mode, side_name
from ...reduction.verdicts import Attempt, Verdict
from ..cases import Cases
from ..sweeping import begin_whole
from .instants import Instants
from .modes import Modes
from .stations import Rows, Station, bench, fitting_method

__all__ = ["Carrier"]

_MOST_TOGETHER = 256
"""Cases that a thread carries together: enough to fill lanes, and few enough for the nearest cache."""
_BATCHES_PER_THREAD = 4

Cause = tuple[Mode | None, tuple[Watchpoint, ...]]
Key = tuple[Mode, tuple[int, ...]]


@final
class Carrier:
    """Carries the cases of a sweep.

    Parameters
    ----------
    modes : Modes
    layout : Layout
        Of the scene.
    options : mapping
        Method, tolerances, largest step, number of steps and threads.
    events : sequence of Event
        What was asked for.
    cases : Fleet
        All of them, with nothing in ``order``.
    table, causes : list
        Modes and causes by number, which grow.
    """

    def __init__(
        self,
        modes: Modes,
        layout: Layout,
        options: Mapping[str, Any],
        events: Sequence[Event],
        cases: Fleet,
        table: list[Mode],
        causes: list[Cause],
    ) -> None:
        self.modes, self.options, self.cases, self.table, self.causes = modes, options, cases, table, causes
        self.parameters, self.rows = layout.parameters, Rows.of(layout, modes.equations.contacts)
        self.settings = {name: options[name] for name in ("rtol", "atol", "max_step", "max_steps")}
        self.asked = [replace(event, name=event.label) for event in events]
        self.methods: dict[Mode, str | None] = {}
        self.numbers: dict[Key, int] = {}
        self.stations: list[Station] = []

    # -- stations --------------------------------------------------------------------------

    def _key(self, mode: Mode, cause: Cause) -> Key:
        return mode, tuple(event.direction for event in self.modes.events(mode, *cause))

    def _station(self, mode: Mode, cause: Cause) -> int:
        """Return the station of a mode that came about by a cause; -1 where its method is not known, or there is none.

        Only models that are compiled anyhow have a method.
        """
        method = self.methods.get(mode)
        if method is None or method == "radau":
            return -1
        key = self._key(mode, cause)
        if key not in self.numbers:
            events = (*self.asked, *self.modes.events(mode, *cause))
            self.numbers[key] = len(self.stations)
            self.stations.append(Station(mode, self.modes.model(mode), events, method, self.settings))
        return self.numbers[key]

    def _place(self, some: NDArray[np.intp]) -> None:
        """Give running cases without a station the one that they need, where there is any."""
        numbers = self.cases.numbers
        mixed = numbers.mode[some] * len(self.causes) + numbers.cause[some]
        for number in np.unique(mixed):
            here = some[mixed == number]
            mode, cause = self.table[numbers.mode[here[0]]], self.causes[numbers.cause[here[0]]]
            if mode not in self.methods:
                self.methods[mode] = self._method(mode, here)
            numbers.station[here] = self._station(mode, cause)

    def _method(self, mode: Mode, some: NDArray[np.intp]) -> str | None:
        """Return the method that fits the first, the middle and the last of some cases."""
        some = some[sorted({0, len(some) // 2, len(some) - 1})]
        model, cases = self.modes.model(mode), self.cases
        names = self.parameters
        columns = {name: cases.p[some, i] for i, name in enumerate(names)}
        columns |= self.modes.added(mode, cases.directions.reshape(len(cases.t), -1, 2)[some], cases.sides[some])
        if any(name not in columns for name in model.layout.parameters):
            return None
        given = {name: columns[name] for name in model.layout.parameters}
        initial = {name: cases.x[some, i] for i, name in enumerate(self.rows.states)}
        try:
            ready = Cases(model.stages.program, model.derived.start, (cases.t[some], cases.t1[some]), initial, given)
        except ValueInputError:  # a value that its symbol excludes, which is told where the phase is run
            return None
        return fitting_method(model, ready, self.settings, self.options["method"])

    # -- carrying --------------------------------------------------------------------------

    def carry(self, some: NDArray[np.intp]) -> bool:
        """Carry those of some running cases that have a station as far as it goes; return whether there are any.

        Raises KeyboardInterrupt where Ctrl-C stopped it.
        """
        numbers, loop = self.cases.numbers, self.modes.engine().phases
        if loop is None:
            return False
        self._place(some[numbers.station[some] < 0])
        order = np.ascontiguousarray(some[numbers.station[some] >= 0])
        if not len(order):
            return False
        plan, outputs, lanes = self._plan()
        threads = int(self.options["threads"])
        together = min(_MOST_TOGETHER, max(lanes, len(order) // (threads * _BATCHES_PER_THREAD)))
        threads = min(threads, -(-len(order) // together))
        benches: list[tuple[Bench, object]] = []
        for _ in range(threads):
            made = bench(self.stations, self.rows, together, lanes, outputs, len(self.modes.equations.contacts))
            if made is None:
                self.methods = dict.fromkeys(self.methods)
                numbers.station[:] = -1
                return False
            benches.append(made)
        turn = np.zeros(1, np.int64)
        cases, threads_begun = self.cases._replace(order=order, turn=turn), itertools.count()

        def work() -> None:
            loop(PhaseArguments(plan, cases, benches[next(threads_begun)][0]))

        def stop() -> None:
            for room, _ in benches:
                room.turns[:] = STOPPED

        run = CaseRun(work, turn, lambda: None, stop=stop)
        if not begin_whole(run, len(order), threads, False)(False):
            raise KeyboardInterrupt
        return True

    def learn(self, some: NDArray[np.intp], mode: Mode, fired: Sequence[Watchpoint]) -> None:
        """Find the verdicts on cases that wait for a decision, for those that come after them."""
        cases = self.cases
        directions = cases.directions.reshape(len(cases.t), -1, 2)
        here = Instants(
            *(
                values[some]
                for values in (cases.t, cases.x, cases.p, directions, cases.sides, cases.speeds, cases.passed)
            )
        )
        known = self.modes.rulings.setdefault((mode, tuple(fired)), {})
        known |= self.modes.laws.rulings(here, mode, fired)

    # -- what is known ---------------------------------------------------------------------

    def _plan(self) -> tuple[Plan, int, int]:
        """Return what is known of the modes, the most outputs of a verdict, and the lanes of kernels."""
        engine = self.modes.engine()
        slips, lanes = engine.code(self.modes.laws.quick.slip_kernel)
        lines, known = _Lines([], [], [], []), int(self.modes.laws.quick.sided(True))
        number = outputs = 0
        while number < len(self.stations):  # what is known of one may call for another
            station = self.stations[number]
            points = self.modes.points(station.mode)
            lines.stations.append(self._line(station, points))
            lines.columns.append([self.rows.parameters[name] for name in station.model.layout.parameters])
            for (mode, fired), rulings in list(self.modes.rulings.items()):
                if mode != station.mode or any(point not in points for point in fired):
                    continue
                cause = self._cause((mode, fired))
                bits = sum(1 << points.index(point) for point in fired)
                for sliding, verdict in list(rulings.items()):
                    if verdict is None:
                        continue
                    code, first = engine.code(verdict.kernel)[0], len(lines.attempts)
                    lines.rules.append([number, bits, sliding, code, len(verdict.attempts), first, known, cause])
                    lines.attempts.extend(self._attempts(verdict, cause))
                    outputs = max(outputs, len(verdict.kernel.outputs))
            number += 1
        terminal = np.array([int(bool(event.terminal)) for event in self.asked], np.int64)
        tables = lines.tables(len(self.modes.equations.contacts))
        return Plan(slips, *tables, terminal=terminal), outputs, lanes

    def _cause(self, cause: Cause) -> int:
        if cause not in self.causes:
            self.causes.append(cause)
        return self.causes.index(cause)

    def _line(self, station: Station, points: Sequence[Watchpoint]) -> list[int]:
        paradox = sum(1 << i for i, point in enumerate(points) if point.kind == "paradox")
        plain = -1 if not len(self.cases.t_eval) else self._station(station.mode, (None, ()))
        expand, _ = station.model.engine.code(self.modes.expansion(station.mode))
        return [station.size, len(station.events), len(station.model.layout.parameters), expand, plain, paradox]

    def _attempts(self, verdict: Verdict, cause: int) -> list[list[int]]:
        """Return what the attempts of a verdict lead to."""
        attempts, held, lines = verdict.attempts, verdict.held, []
        n_q = len(self.rows.states) // 2
        for number, attempt in enumerate(attempts):
            if attempt.mode not in self.table:
                self.table.append(attempt.mode)
            rates = 2 + len(attempts) + held.index(number) * n_q if number in held else 0
            apart = sum(1 << i for i, other in enumerate(attempts[:number]) if self._apart(attempt, other))
            mode, station = self.table.index(attempt.mode), self._station(attempt.mode, self.causes[cause])
            lines.append([mode, station, rates, apart, *attempt.ways, *attempt.sides])
        return lines

    def _apart(self, a: Attempt, b: Attempt) -> bool:
        """Return whether two attempts cannot hold both; see `deciding.judge`."""
        return any(
            (a.mode[i] == OPEN) != (b.mode[i] == OPEN) or (side_name(contact) is not None and a.sides[i] != b.sides[i])
            for i, contact in enumerate(self.modes.equations.contacts)
        )


@final
@dataclass(frozen=True)
class _Lines:
    """Lines of the tables of a plan."""

    stations: list[list[int]]
    columns: list[list[int]]
    rules: list[list[int]]
    attempts: list[list[int]]

    def tables(self, contacts: int) -> tuple[StationTable, NDArray[np.int64], RuleTable, AttemptTable]:
        """Return the tables, of a scene with so many contacts."""
        columns = np.zeros((len(self.columns), max((len(line) for line in self.columns), default=1)), np.int64)
        for line, row in zip(self.columns, columns, strict=True):
            row[: len(line)] = line
        stations, rules = StationTable(*_turned(self.stations, 6)), RuleTable(*_turned(self.rules, 8))
        mode, station, held, apart, *contact = _turned(self.attempts, 4 + 2 * contacts)
        turned = np.array(contact, np.int64).reshape(2, contacts, len(mode))
        ways, sides = (np.ascontiguousarray(part.T) for part in turned)
        return stations, columns, rules, AttemptTable(mode, station, held, apart, ways, sides)


def _turned(lines: Sequence[Sequence[int]], columns: int) -> NDArray[np.int64]:
    """Return the columns of a table as rows."""
    return np.ascontiguousarray(np.array(lines, np.int64).reshape(len(lines), columns).T)
