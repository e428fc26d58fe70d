"""`Trajectory`: one simulated motion, by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, cast, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError, UnknownNameError, nesting_named, unknown_name
from ..ir.program import Layout
from ..methods.status import Status
from ..values import times_of
from . import labels, plots
from .events import EventRecords
from .labels import ranges, summary
from .other_times import own_times, rows_by_number, rows_of_phases
from .parts import ENERGIES, Part, Phase, joined_variables
from .statistics import Estimated, NamedArrays, RunStatistics, SamePhases

if TYPE_CHECKING:
    from ..scene import Scene
    from ..stops.segments import Constants

_NO_EVENTS = EventRecords()


@final
class Trajectory(Estimated):
    """A simulated motion.

    Attributes
    ----------
    t : ndarray (n_t,)
        Recorded times [s]: those of ``t_eval`` that the run reached, or the ends of its steps, and of phases twice. A
        run that ended early, by a failure or a terminal event, may have reached none of them.
    elapsed : ndarray (n_t,)
        The same in the time of the model that ran: since the start of the run, where it is counted so.
    y : ndarray (n_t, n_y)
        State of the formulation; with contacts that change, `variables`.
    q, qdot : ndarray (n_t, n_q)
        Coordinates and their rates.
    status : Status
        How the run ended.
    t_end : float
        Time that the run reached [s], recorded or not.
    stats : RunStatistics
        Cost of the run.
    parts : sequence of Part
        The recorded rows, those of each phase in a part of their own.
    phases : tuple of Phase
        Phases, each in one mode of the contacts; empty where contacts do not change.
    events : EventRecords
        The events of the run, by name.

    ``trajectory["x"]``, ``["x_dot"]``, ``["energy"]``, first-order states with their rates, and every requested output
    give arrays (n_t,), by name or by SymPy symbol. ``trajectory(t)`` is the motion at other times within the span.
    """

    _begin: float | None = None

    def __init__(
        self,
        parts: Sequence[Part],
        status: Status,
        stats: RunStatistics,
        layout: Layout | None = None,
        phases: tuple[Phase, ...] = (),
        whole: Sequence[Part] | None = None,
        order: NDArray[np.intp] | None = None,
    ) -> None:
        """Initialise a motion.

        Parameters
        ----------
        parts : sequence of Part
            The recorded rows.
        status : Status
        stats : RunStatistics
        layout : Layout, optional
            Names of the scene; by default those of the program of the only part.
        phases : tuple of Phase
        whole : sequence of Part, optional
            The motion that other times are evaluated of, by default the same.
        order : ndarray (n_t,), optional
            Places of the rows among those of all parts.
        """
        self.parts, self.status, self.stats = parts, status, stats
        self._layout = parts[0].program.layout if layout is None else layout
        self.phases = self._own_phases = phases
        self._whole, self._order, self.events = whole or parts, order, _NO_EVENTS
        self.t = self.elapsed = self._joined(lambda part: part.t) if phases else parts[0].t

    def _joined(self, value: Callable[[Part], Any]) -> Any:
        """Return the values of all parts, in the order of the recorded times."""
        if len(self.parts) == 1 and self._order is None:
            return value(self.parts[0])
        joined = np.concatenate([value(part) for part in self.parts])
        return joined if self._order is None else joined[self._order]

    def _of_parts(self, parts: Sequence[Part], t: FloatArray, order: NDArray[np.intp] | None = None) -> Self:
        """Return other rows of this motion, in an order, at times t (k,) counted as this is."""
        motion = type(self)(parts, self.status, self.stats, self._layout, self._own_phases, self._whole, order)
        if self._begin is not None:
            return motion.counted_from(self._begin, t)
        motion.t = t.copy()
        return motion

    def counted_from(self, start: float, t: FloatArray | None = None, note: str | None = None) -> Self:
        """Return this motion with its times, which are counted from its start, counted as `start` is.

        Requested times `t` (k,), of which the run reached the first, are recorded without rounding; `note` takes the
        place of the note of the statistics.
        """
        self._begin = start
        self.t = start + self.elapsed if t is None else t[: len(self.elapsed)].copy()
        self.phases = tuple(replace(phase, t0=start + phase.t0, t1=start + phase.t1) for phase in self._own_phases)
        self.events.counted_from(start)
        if note is not None:
            self.stats = replace(self.stats, note=note)
        return self

    def with_events(self, events: EventRecords) -> Self:
        """Return this motion with the events that occurred on it."""
        self.events = events
        return self

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self.parts[0].program.name

    @property
    def t_end(self) -> float:
        """Time that the run reached [s]; that of the last row where it is not known."""
        end = self._own_phases[-1].t1 if self._own_phases else self.parts[0].t_end
        return end if self._begin is None else self._begin + end

    @property
    def _formulations(self) -> tuple[str, ...]:
        """The formulations that the run was made in."""
        return tuple(dict.fromkeys(part.program.formulation for part in self._whole))

    @property
    def _pictured(self) -> tuple[Scene, Constants] | None:
        """The scene, and constants that begin with its parameters; None where the motion does not have them."""
        return None if self.parts[0].scene is None else (self.parts[0].scene, self.parts[0].c)

    @property
    def success(self) -> bool:
        """Whether the end of the span, or a terminal event, was reached."""
        return self.status.success

    @property
    def message(self) -> str:
        """The status of the run, as a sentence."""
        note, said = self.stats.note, self.status.message_for(self._formulations, self.stats.method)
        return f"{said} Note: {note}." if note else said

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return self._layout.coordinates

    @cached_property
    def variables(self) -> FloatArray:
        """Coordinates, rates and first-order states (n_t, 2 n_q + n_z)."""
        variables = joined_variables(self.parts)
        return variables if self._order is None else variables[self._order]

    def _ends(self) -> FloatArray:
        return self.y[-1:]

    @property
    def y(self) -> FloatArray:
        """See the class."""
        return self.variables if self.phases else self.parts[0].y

    @property
    def q(self) -> FloatArray:
        """Coordinates (n_t, n_q)."""
        return self.variables[:, : len(self._layout.coordinates)].copy()

    @property
    def qdot(self) -> FloatArray:
        """Rates of the coordinates (n_t, n_q)."""
        size = len(self._layout.coordinates)
        return self.variables[:, size : 2 * size].copy()

    @property
    def names(self) -> tuple[str, ...]:
        """All names that ``self[name]`` takes."""
        layout = self._layout
        rates = (*layout.rates, *layout.state_rates)
        return tuple(dict.fromkeys((*layout.coordinates, *rates, *layout.state, *layout.outputs, *ENERGIES)))

    @nesting_named
    def __getitem__(self, key: Any) -> FloatArray:
        text = str(key)
        name = self._layout.aliases.get(text, text)
        found: FloatArray | None = None
        if not self.phases or not {name, text}.isdisjoint(self.names):
            found = self._joined(lambda part: part.named(text))
        if found is None:
            raise UnknownNameError(unknown_name("output", text, self.names) + labels.request_hint(self._layout, name))
        return found

    @property
    def modes(self) -> dict[str, NDArray[np.str_]]:
        """The states of each contact at the recorded times (n_t,); empty where contacts do not change."""
        return {contact: self.mode(contact) for contact in (self.phases[0].modes if self.phases else ())}

    def mode(self, contact: str) -> NDArray[np.str_]:
        """Return the state of a contact at the recorded times (n_t,)."""
        known = self.phases[0].modes if self.phases else {}
        if contact not in known:
            raise OptionError(unknown_name("contact", contact, known))
        return cast(NDArray[np.str_], self._joined(lambda part: np.full(len(part.t), part.modes[contact])))

    @property
    def constraint_violation(self) -> FloatArray:
        """Constraint residuals (n_t, n_constraints): positions of holonomic, velocities of nonholonomic ones.

        Of an open contact it is the penetration.
        """
        return cast(FloatArray, self._joined(lambda part: part.violation))

    @property
    def velocity_violation(self) -> FloatArray:
        """Velocity residual of each constraint, (n_t, n_constraints); zero of an open contact."""
        return cast(FloatArray, self._joined(lambda part: part.velocity_violation))

    @cached_property
    def invariants(self) -> dict[str, FloatArray]:
        """First integrals along the motion (n_t,) by name, to see how well they are kept.

        - "energy", where no force, constraint or motion of the scene does work
        - "jacobi", Jacobi's integral T2 - T0 + V (parts of T of degree 2 and 0 in the rates), where what is prescribed
          changes nothing but speeds, as on a hoop that turns at a constant rate
        - "p_x" = dT/dx_dot, for each coordinate x whose momentum nothing changes
        - "p_omega_S_z" and "p_omega_N_z", angular momenta of what a unit quaternion turns, about axes of its frame S
          and of the frame N that it turns in

        They are found from the equations, not from the motion. With contacts they are those that hold in every phase;
        between phases they may jump.
        """
        every = {id(part): part.invariants for part in self.parts}
        common = [name for name in every[id(self.parts[0])] if all(name in found for found in every.values())]
        return {name: self._joined(lambda part, name=name: every[id(part)][name]) for name in common}  # type: ignore[misc]

    @property
    def _lasting(self) -> Sequence[Part]:
        """Phases that take time, of which there is something to evaluate; where there are none, all."""
        return [part for part in self._whole if part.phase is None or part.phase.t0 != part.phase.t1] or self._whole

    @property
    def can_evaluate(self) -> bool:
        """Whether the run can be evaluated between the recorded times."""
        return all(part.dense is not None for part in self._lasting)

    @nesting_named
    def __call__(self, t: Any) -> Trajectory:
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
        if self.phases:
            return self.at_elapsed(self._own(given), self._begin or 0.0, given)
        part = self._whole[0]
        return self._of_parts([part(self._own(given) if part.dense is not None else given)], given)

    def at_elapsed(self, times: FloatArray, origin: float, given: FloatArray | None = None) -> Trajectory:
        """Return a motion with phases at times (k,) since an origin, or at times as they were given."""
        parts, order = rows_of_phases(self._lasting, self._whole[-1], times, origin, self._begin or 0.0)
        return self._of_parts(parts, times if given is None else given, order)

    def _own(self, times: FloatArray) -> FloatArray:
        """Return times since the start of the run, as known of recorded ones; rounding takes none out of it."""
        if self._begin is None:
            return times
        return own_times(self._lasting, times, times - self._begin, self.t, self.elapsed)

    def at(self, t: FloatArray, y: FloatArray) -> Trajectory:
        """Return states y (k, n_y) of this motion, which has no phases, at times t (k,) of the model that ran."""
        return Trajectory([self.parts[0].at(t, y)], self.status, self.stats)

    def rows(self, some: NDArray[np.intp]) -> Trajectory:
        """Return the motion at some of the recorded times, by number (k,)."""
        parts, order = rows_by_number(self.parts, self._order, some)
        return self._of_parts(parts, self.t[some], order)

    def _compared(self, twin: Trajectory) -> NamedArrays:
        return SamePhases(self, twin) if self.phases else twin

    plot = plots.plot
    animate = plots.animate
    to_xarray = labels.to_xarray
    to_dataframe = labels.to_dataframe

    def __repr__(self) -> str:
        span = f"t = {self.t[0]:g} .. {self.t[-1]:g}, " if len(self.t) else ""
        phases = f"{len(self.phases)} phases, " if self.phases else ""
        return f"<Trajectory {self.name!r}: {span}{len(self.t)} times, {phases}{self.status.name}>"

    def _repr_html_(self) -> str:
        facts = [("status", f"{self.status.name}. {self.message}")]
        facts += [("time", f"{self.t[0]:g} to {self.t[-1]:g} s, {len(self.t)} times")] if len(self.t) else []
        facts += [("method", f"{self.stats.method}, {self.stats.steps} steps, {self.stats.rejected} rejected")]
        names = dict.fromkeys((*self._layout.variables, *self._layout.outputs)) if len(self.t) else {}
        rows = ranges(names, (self[name] for name in names))
        return summary(repr(self)[1:-1], facts, ("name", "least", "largest", "last"), rows)

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.names)
