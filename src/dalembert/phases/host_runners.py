"""Modes that Python runs, by the integrators of their models, where the loop over lanes does not support them.

These are modes of engines without such loops, modes whose prescribed velocities jump at a break, and those of
which results are checked. The loop over phases calls such a runner as it calls compiled ones.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..codegen.host_code import host_code
from ..codegen.runs import LoopCall
from ..contacts.phase_ends import begins_motion
from ..contacts.phase_tables import CaseTable, ThreadWorkspace
from ..errors import InitialStateError
from ..events.event_code import Event
from ..lanes.sweep_arguments import SweepArguments
from ..lanes.workspace import OCCURRENCE, LoopProgress
from ..methods.status import Status
from ..options import SimulateOptions, StepOptions, SweepOptions
from ..results.sweep import Sweep
from ..results.trajectory import Trajectory
from ..runs.simulate import simulate_in_own_time
from ..runs.sweep import sweep_in_own_time
from ..subset.arguments import NO_CODE, OwnedAddress, kind_of, place_of
from .mode_models import ModeModels
from .mode_runners import GatheredRows
from .output_values import PhaseReductions
from .velocity_jumps import CaseGroup, velocity_jumps

_WORDS, _COUNT = len(kind_of(SweepArguments).words), place_of(SweepArguments, "shape.cases")


@final
class HostMode:
    """A mode, what is watched in it, and a method.

    Parameters
    ----------
    modes : ModeModels
    number : int
        Number of the mode.
    events : tuple of Event
        Those of users, which map nothing, then the guards of the mode.
    reductions : PhaseReductions
    method : str
        A method of the backend, or "auto".
    options : StepOptions
        Tolerances, largest step and number of steps.
    first_step : callable
        Returns the size of the first step of a case that is recorded, None where it is to be chosen.
    left : dict of int to (float, dict of str to float)
        Times and parameters of cases at the ends of their last runs, which all runners share.

    Attributes
    ----------
    runs : list of Trajectory
        Motions of a case that is recorded.
    taken : str
        Method of the last run.
    """

    expand: ClassVar[OwnedAddress] = NO_CODE

    def __init__(
        self,
        modes: ModeModels,
        number: int,
        events: tuple[Event, ...],
        reductions: PhaseReductions,
        method: str,
        options: StepOptions,
        first_step: Callable[[], float | None],
        left: dict[int, tuple[float, dict[str, float]]],
    ) -> None:
        self.number, self.mode = number, (mode := modes.automaton.mode(number))
        self.model, self.events, self.method = modes.serving(mode).for_segments, events, method
        self.runs: list[Trajectory] = []
        self.taken = ""
        self._jumps, self._expansion = velocity_jumps(modes, mode, left), modes.expansion(mode)
        self._reductions, self._options, self._first_step = reductions, options, first_step
        self._requested, self._switched = len(reductions.events), modes.switched(mode)
        self._numbered = np.array([int(event.terminal) > 1 for event in events[: self._requested]], np.bool_)
        self._counted: dict[bytes, tuple[Event, ...]] = {}

    @property
    def size(self) -> int:
        """Components of the states that it writes, which are variables."""
        return len(self.model.layout.variables)

    @property
    def samples_inside(self) -> bool:
        """Whether a sweep records samples inside its runs: where nothing ends these, they end at samples."""
        return bool(self.events)

    def forget(self) -> None:
        """Forget earlier motions."""
        if self._jumps is not None:
            self._jumps.left.clear()
        self.runs.clear()

    def call(
        self, rows: GatheredRows, space: ThreadWorkspace, table: CaseTable, turn: NDArray[np.int64], recorded: int
    ) -> LoopCall:
        """Return the call that runs the cases that are gathered in the memory of a thread; see `ModeRunner.call`."""

        def run(packed: int, *others: int) -> int:
            count = ctypes.c_int64.from_address(packed + 8 * _COUNT).value
            width = (len(self.events) if recorded else self._width) if len(table.carried) > 0 else None
            group = self._group(rows, space, count, width)
            if self._jumps is not None:
                self._jumps.apply(group)
            if recorded:
                self._simulate(group, space, table)
            else:
                self._sweep(group, space, table)
            if self._jumps is not None:
                self._jumps.leave(group, space.ends)
            if group.carried is not None:
                n = len(self.events)
                space.carried[: count * 2 * n] = group.carried[:, : 2 * n].ravel()
            return 0

        nothing, occurrences = np.empty((0, 0)), np.zeros((1, OCCURRENCE))
        return LoopCall(host_code(run), np.zeros(_WORDS, np.int64), LoopProgress(), nothing, occurrences, None)

    def _group(self, rows: GatheredRows, space: ThreadWorkspace, count: int, width: int | None) -> CaseGroup:
        """Return the cases that are gathered, with what they carry of so many events, if anything."""
        values, names = space.gathered[:, :count].copy(), self.model.layout.parameters
        places = rows.with_switches(self._switched)
        p = {name: values[places[name]] for name in names if name in places}
        x = {name: values[row] for name, row in rows.states.items()}
        carried = None
        if width is not None:
            n = len(self.events)
            carried = np.zeros((count, 2 * max(n, width)))
            carried[:, 2 * n :: 2] = np.nan
            carried[:, : 2 * n] = space.carried[: count * 2 * n].reshape(count, -1)
        return CaseGroup(space.chosen[:count].copy(), values[0], values[1], p, x, carried)

    @property
    def _width(self) -> int:
        """Number of events that a sweep watches for, of which some may be guards of its own."""
        guards = tuple(check.guards("") for check in self.model.checks)
        code = self.model.derived.events(self.events, self._reductions.along or None, guards=guards)
        return 0 if code is None else len(code.events)

    # -- runs ------------------------------------------------------------------------------

    def _events(self, counts: FloatArray) -> tuple[Event, ...]:
        """Return the events, those of users with the occurrence that ends a run after so many (n_requested,) before."""
        counts = np.where(self._numbered, counts, 0.0)
        key = counts.tobytes()
        if key not in self._counted:
            own = zip(self.events, counts.tolist(), strict=False)
            requested = [replace(event, terminal=int(event.terminal) - int(count)) for event, count in own]
            self._counted[key] = (*requested, *self.events[self._requested :])
        return self._counted[key]

    def _alike(self, counts: FloatArray) -> Iterator[tuple[FloatArray, NDArray[np.intp]]]:
        """Yield groups of cases whose runs may be ended by the same occurrences, from counts (k, n_requested)."""
        if not np.any(self._numbered):
            yield counts[0], np.arange(len(counts))
            return
        kinds, places = np.unique(np.where(self._numbered, counts, 0.0), axis=0, return_inverse=True)
        for k, kind in enumerate(kinds):
            yield kind, np.flatnonzero(places.ravel() == k)

    def _happened(self, space: ThreadWorkspace, count: int) -> FloatArray:
        """Return what happened (k, 3 n_events), a view."""
        return space.happened[: count * 3 * len(self.events)].reshape(count, -1)

    def _sweep(self, group: CaseGroup, space: ThreadWorkspace, table: CaseTable) -> None:
        """Run cases, and write how they end."""
        happened, times = self._happened(space, len(group.t0)), None
        first = int(np.min(space.sampled[: len(happened)]))
        if self.samples_inside and first < len(table.t_eval):
            times = table.t_eval[first:]
        for counts, some in self._alike(happened[:, : 3 * self._requested : 3]):
            own = self._options
            options = SweepOptions(
                method=self.method,
                rtol=own.rtol,
                atol=own.atol,
                max_step=own.max_step,
                max_steps=own.max_steps,
                events=self._events(counts),
                reduce=self._reductions.along or None,
                threads=1,
            )
            carried = None if group.carried is None else group.carried[some]
            x, p = ({name: values[some] for name, values in table.items()} for table in (group.x, group.p))
            run = sweep_in_own_time(self.model, (group.t0[some], group.t1[some]), x, p, options, carried, times)
            if np.any(run.status == Status.INTERRUPTED):
                raise KeyboardInterrupt
            self.taken = run.stats.method
            if group.carried is not None:
                group.carried[some] = carried
            happened[some] = self._counted_on(happened[some], run)
            y = space.y[: len(happened) * self.size].reshape(len(happened), -1)
            y[some] = self._variables(run, p)
            if times is not None:
                self._record(run, group, some, space.sampled, table)
            space.ends[some] = np.column_stack([run.t, run.status, run.steps])
            space.totals[some] = self._reductions.keep(space.totals[some], run.reduced, run.t - group.t0[some])

    def _variables(self, run: Sweep, p: Mapping[str, FloatArray]) -> FloatArray:
        """Return the variables (k, 2 n_q + n_z) in which cases end, of parameters by name."""
        layout = self.model.layout
        if run._layout.state != layout.state:  # of a model without constraints that others imply
            return np.column_stack(run._states.at_ends(layout.variables))
        columns = np.array([p[name] for name in layout.parameters]).reshape(len(layout.parameters), -1)
        return self.model.engine.rows(self._expansion, run.t, run.y, columns.T)

    def _record(
        self, run: Sweep, group: CaseGroup, some: NDArray[np.intp], following: NDArray[np.int64], table: CaseTable
    ) -> None:
        """Record the samples before the ends of the runs of some cases, of which `following` are the next."""
        recorded = np.stack(run._states.at_samples(self.model.layout.variables), axis=2)
        count = len(table.t_eval)
        before = count - recorded.shape[1]
        for place, t, own in zip(some.tolist(), run.t.tolist(), recorded, strict=True):
            forward, first = 1.0 if group.t1[place] >= group.t0[place] else -1.0, int(following[place])
            until = first + int(np.sum((table.t_eval[first:] - t) * forward < 0.0))
            rows = slice(int(group.cases[place]) * count + first, int(group.cases[place]) * count + until)
            table.samples.x[rows] = own[first - before : until - before]
            following[place] = until

    def _counted_on(self, happened: FloatArray, run: Sweep) -> FloatArray:
        """Return what happened (k, 3 n_events) with what has happened in a run."""
        for i, event in enumerate(self.events):
            record, own = run.events[event.label], happened[:, 3 * i : 3 * i + 3]
            own[:, 0] += record.count
            own[:, 1] = np.where(np.isnan(own[:, 1]), record.first, own[:, 1])
            own[:, 2] = np.where(record.count > 0, record.last, own[:, 2])
        return happened

    def _simulate(self, group: CaseGroup, space: ThreadWorkspace, table: CaseTable) -> None:
        """Run and record the only case, and write how it ends."""
        assert isinstance(self._options, SimulateOptions)
        happened, t1 = self._happened(space, 1)[0], float(group.t1[0])
        events = self._events(happened[: 3 * self._requested : 3])
        options = replace(self._options, method=self.method, events=events, first_step=self._first_step())
        x, p = ({name: float(values[0]) for name, values in table.items()} for table in (group.x, group.p))
        carried = None if group.carried is None else group.carried[0]
        try:
            run = simulate_in_own_time(self.model, (float(group.t0[0]), t1), x, p, options, carried)
        except InitialStateError:
            if begins_motion(table, 0, float(group.t0[0])):
                raise
            space.ends[0] = group.t0[0], Status.INITIAL_STATE, 0.0
            return
        t = t1 if run.status is Status.SUCCESS else float(run.t[-1])
        for i, event in enumerate(self.events):
            record = run.events[event.label]
            if len(record):
                first = record.t[0] if np.isnan(happened[3 * i + 1]) else happened[3 * i + 1]
                happened[3 * i : 3 * i + 3] = happened[3 * i] + len(record), first, record.t[-1]
        space.y[: self.size] = run.variables[-1]
        space.ends[0] = t, run.status, run.stats.steps + run.stats.rejected
        self.taken = run.stats.method
        self.runs.append(run)
