"""`HybridTrajectory`: a motion in phases, each in one mode of the contacts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError, UnknownNameError, nesting_named, unknown_name
from ..integrators.event_rules import last_instants
from ..ir.program import Layout
from ..methods.event_constants import RESOLUTION
from ..methods.status import Status
from ..values import times_of
from .estimate import NamedArrays
from .events import EventRecords
from .motion import ENERGIES, Motion, RunStatistics, reaction_hint
from .trajectory import Trajectory, joined_variables

if TYPE_CHECKING:
    import xarray

    from ..integrators.segments import Constants
    from ..scene import Scene

__all__ = ["HybridTrajectory", "Part", "Phase"]


@final
@dataclass(frozen=True)
class Phase:
    """A phase of a motion from `t0` to `t1` [s]; `modes` has the state of each contact: slip, stick, closed or open."""

    t0: float
    t1: float
    modes: Mapping[str, str]


@final
@dataclass(frozen=True, eq=False)
class Part:
    """Rows of a motion that lie in one phase: the phase, its motion, and the names of its constraints."""

    phase: Phase
    motion: Trajectory
    violation: Callable[[Trajectory], FloatArray]


@final
class HybridTrajectory(Motion):
    """A simulated motion with contacts; `dalembert.results.trajectory.Trajectory` is one without.

    Attributes
    ----------
    t : ndarray (n_t,)
        Recorded times [s]; without ``t_eval`` those of the ends of phases are there twice.
    q, qdot : ndarray (n_t, n_q)
        Coordinates and their rates.
    y : ndarray (n_t, 2 n_q + n_z)
        Both, and the first-order states, side by side.
    status : Status
        How the run ended.
    t_end : float
        Time that the run reached [s], recorded or not.
    stats : RunStatistics
        Cost of the run.
    phases : tuple of Phase
        Phases, with the modes of the contacts.
    events : EventRecords
        The events of the run, by name.
    constraint_violation : ndarray (n_t, n_constraints)
        Residuals of the constraints; of an open contact, its penetration.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        phases: Sequence[Phase],
        order: NDArray[np.intp] | None,
        whole: Sequence[Part],
        status: Status,
        stats: RunStatistics,
        name: str,
        layout: Layout,
    ) -> None:
        self._parts, self._whole, self._order = tuple(parts), tuple(whole), order
        self._name, self._layout = name, layout
        self.phases = self._own_phases = tuple(phases)
        self.status, self.stats = status, stats
        self.events = EventRecords()
        self.t = self.elapsed = self._joined(lambda part: part.motion.elapsed)
        self.y, n_q = joined_variables([part.motion for part in self._parts]), len(layout.coordinates)
        if order is not None:
            self.y = self.y[order]
        self.q, self.qdot = self.y[:, :n_q].copy(), self.y[:, n_q : 2 * n_q].copy()

    @property
    def variables(self) -> FloatArray:
        """Coordinates, rates and first-order states (n_t, 2 n_q + n_z)."""
        return self.y

    def _joined(self, value: Callable[[Part], Any]) -> Any:
        """Return the values of all parts, in the order of the recorded times."""
        joined = np.concatenate([value(part) for part in self._parts])
        return joined if self._order is None else joined[self._order]

    def counted_from(self, start: float, t: FloatArray | None = None, note: str | None = None) -> Self:
        """See `Motion.counted_from`."""
        self.phases = tuple(replace(phase, t0=start + phase.t0, t1=start + phase.t1) for phase in self._own_phases)
        return super().counted_from(start, t, note)

    def _regrouped(self, parts: Sequence[Part], order: NDArray[np.intp], t: FloatArray) -> HybridTrajectory:
        """Return some rows of this motion, in an order, at times t (k,) counted as this is."""
        about = self.status, self.stats, self._name, self._layout
        motion = HybridTrajectory(parts, self._own_phases, order, self._whole, *about)
        if self._begin is not None:
            return motion.counted_from(self._begin, t)
        motion.t = t.copy()
        return motion

    def with_events(self, events: EventRecords) -> HybridTrajectory:
        """Return this motion with the events that occurred on it."""
        self.events = events
        return self

    def _compared(self, twin: HybridTrajectory) -> NamedArrays:
        return _SamePhases(self, twin)

    @property
    def t_end(self) -> float:
        """Time that the run reached [s]."""
        return self.phases[-1].t1

    @property
    def _formulations(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(name for part in self._whole for name in part.motion._formulations))

    @property
    def constraint_violation(self) -> FloatArray:
        """See the class."""
        violation: FloatArray = self._joined(lambda part: part.violation(part.motion))
        return violation

    @property
    def names(self) -> tuple[str, ...]:
        """See `Motion.names`."""
        layout = self._layout
        return tuple(dict.fromkeys((*layout.variables, *layout.state_rates, *layout.outputs, *ENERGIES)))

    @property
    def invariants(self) -> dict[str, FloatArray]:
        """First integrals that hold in every phase, along the motion (n_t,) by name; between phases they may jump."""
        every = [set(part.motion.invariants) for part in self._parts]
        common = [name for name in self._parts[0].motion.invariants if all(name in names for names in every)]
        return {name: self._joined(lambda part, name=name: part.motion.invariants[name]) for name in common}  # type: ignore[misc]

    @nesting_named
    def __getitem__(self, key: Any) -> FloatArray:
        name = self._layout.aliases.get(str(key), str(key))
        if not {name, str(key)} & {*self.names}:
            raise UnknownNameError(unknown_name("output", str(key), self.names) + reaction_hint(self._layout, name))
        values: FloatArray = self._joined(lambda part: part.motion[key])
        return values

    def mode(self, contact: str) -> NDArray[np.str_]:
        """Return the state of a contact at the recorded times (n_t,)."""
        if contact not in self.phases[0].modes:
            raise OptionError(unknown_name("contact", contact, self.phases[0].modes))
        words: NDArray[np.str_] = self._joined(lambda part: np.full(len(part.motion.t), part.phase.modes[contact]))
        return words

    @property
    def can_evaluate(self) -> bool:
        """Whether the run can be evaluated between the recorded times."""
        return all(part.motion.can_evaluate for part in self._lasting)

    @property
    def _pictured(self) -> tuple[Scene, Constants] | None:
        return self._parts[0].motion._pictured

    def rows(self, some: NDArray[np.intp]) -> HybridTrajectory:
        """Return the motion at some of the recorded times, by number (k,)."""
        sizes = [len(part.motion.t) for part in self._parts]
        places = np.arange(sum(sizes)) if self._order is None else self._order
        rows = places[some]
        ends = np.cumsum([0, *sizes])
        parts, order = [], []
        for part, first, last in zip(self._parts, ends, ends[1:], strict=False):
            mine = np.flatnonzero((first <= rows) & (rows < last))
            order.append(mine)
            parts.append(replace(part, motion=part.motion.rows(rows[mine] - first)))
        back = np.argsort(np.concatenate(order), kind="stable")
        return self._regrouped(parts, back, self.t[some])

    @property
    def _lasting(self) -> Sequence[Part]:
        """Phases that take time, of which there is something to evaluate; where there are none, all."""
        return [part for part in self._whole if part.phase.t0 != part.phase.t1] or self._whole

    @nesting_named
    def __call__(self, t: Any) -> HybridTrajectory:
        """Return the motion at other times; where a phase ends, or within rounding before, as the next one begins.

        Parameters
        ----------
        t : float or array_like (k,)
            Times within the span, in any order.

        Raises
        ------
        OptionError
            Outside the span of the run, or where ``dense=False`` left nothing to evaluate.
        """
        given = times_of("t", t)
        return self.at_elapsed(given, self._begin or 0.0, given)

    def at_elapsed(self, times: FloatArray, origin: float, given: FloatArray | None = None) -> HybridTrajectory:
        """Return the motion at times (k,) since an origin, or at times as they were given."""
        lasting = [*self._lasting]
        if self._whole[-1] is not lasting[-1]:  # the state after an impact at the end
            lasting.append(self._whole[-1])
        first, last = lasting[0].phase.t0, lasting[-1].phase.t1
        forward = 1.0 if last >= first else -1.0
        if given is not None and self._begin is not None:
            times = given - self._begin
            inside = np.clip(times, min(first, last), max(first, last))
            times = np.where(np.abs(times - inside) <= 4.0 * np.spacing(np.abs(given)), inside, times)
        if np.any((times - last) * forward > 0.0) or np.any((times - first) * forward < 0.0):
            start = self._begin or 0.0
            raise OptionError(
                f"times must lie within the span of the run, {start + first:.12g} to {start + last:.12g} s"
            )
        begins = np.array([part.phase.t0 for part in lasting]) * forward
        place = np.clip(np.searchsorted(begins, times * forward, side="right") - 1, 0, len(begins) - 1)
        until = last_instants(times, origin)
        following = np.minimum(place + 1, len(begins) - 1)
        begun = begins[following] - until * forward <= RESOLUTION * np.abs(begins[following])  # as `recorded_after`
        place = np.where(begun, following, place)
        inside = forward * np.maximum(times * forward, begins[place])  # of the phase that has begun by then
        rows = [np.flatnonzero(place == number) for number in range(len(lasting))]
        parts = [
            Part(part.phase, _at(part, inside[some]), part.violation)
            for part, some in zip(lasting, rows, strict=True)
            if len(some)
        ]
        if not parts:
            part = lasting[0]
            parts = [Part(part.phase, part.motion.at(part.motion.t[:0], part.motion.y[:0]), part.violation)]
        order = np.argsort(np.concatenate(rows), kind="stable")
        return self._regrouped(parts, order, times if given is None else given)

    def __repr__(self) -> str:
        span = f"t = {self.t[0]:g} .. {self.t[-1]:g}, " if len(self.t) else ""
        return f"<HybridTrajectory {self._name!r}: {span}{len(self.phases)} phases, {self.status.name}>"

    def to_xarray(self, units: Mapping[Any, str] | None = None) -> xarray.Dataset:
        """Return the motion as an ``xarray.Dataset`` over ``time``: coordinates, rates, outputs, energy, and modes.

        Attributes, `units` and errors are those of `dalembert.results.trajectory.Trajectory.to_xarray`.
        """
        data: dict[str, Any] = {name: ("time", self[name]) for name in self.names if "_energy" not in name}
        for contact in self.phases[0].modes:
            data[f"mode of {contact}"] = ("time", self.mode(contact))
        motion = self._parts[0].motion
        values = dict(zip(motion._layout.parameters, motion._first.tolist(), strict=False))
        given = {name: values[name] for name in self._layout.given if name in values}
        return self._dataset(self._name, data, given, units)


def _at(part: Part, t: FloatArray) -> Trajectory:
    """Return the motion of a phase at times t (k,); a phase that takes no time has one state."""
    if part.phase.t0 == part.phase.t1 and len(part.motion.t):
        return part.motion.rows(np.full(len(t), len(part.motion.t) - 1))
    return part.motion(t)


@final
@dataclass(frozen=True, eq=False)
class _SamePhases:
    """The values of a twin by name at the times of a run, NaN where it is not in the same phase."""

    run: HybridTrajectory
    twin: HybridTrajectory

    def __getitem__(self, key: Any) -> FloatArray:
        mine, theirs = self.run._lasting, self.twin._lasting
        alike = 0
        while alike < min(len(mine), len(theirs)) and mine[alike].phase.modes == theirs[alike].phase.modes:
            alike += 1
        numbers = {id(part.phase): number for number, part in enumerate(mine[:alike])}

        def values(part: Part) -> FloatArray:
            t, found = part.motion.elapsed, np.full(len(part.motion.elapsed), np.nan)
            number = numbers.get(id(part.phase))
            if number is None:
                return found
            other = theirs[number]
            first, last = sorted((other.phase.t0, other.phase.t1))
            there = (first <= t) & (t <= last)
            found[there] = other.motion(t[there])[key]
            return found

        joined: FloatArray = self.run._joined(values)
        return joined
