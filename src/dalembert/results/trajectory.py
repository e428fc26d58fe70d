"""`Trajectory`: one simulated motion, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError, UnknownNameError, nesting_named, unknown_name
from ..integrators.chaining import joined
from ..integrators.dense_output import DenseOutput
from ..integrators.problem import Solution
from ..integrators.projected_states import projected
from ..integrators.segments import Constants, Segments, constants_at
from ..integrators.watched import Occurrence
from ..ir.program import Program
from ..methods.status import Status
from ..values import times_of
from .events import EventRecords, event_records
from .kernel_values import KernelValues
from .motion import ENERGIES, Motion, RunStatistics, reaction_hint, warn_of_energy

if TYPE_CHECKING:
    import xarray

    from ..scene import Scene

__all__ = ["Trajectory", "joined_runs", "joined_variables"]

Monitors = Callable[[FloatArray, FloatArray, FloatArray], dict[str, FloatArray]]


@final
class Trajectory(Motion):
    """A simulated motion.

    Attributes
    ----------
    t : ndarray (n_t,)
        Recorded times [s]: those of ``t_eval`` that the run reached, or the ends of its steps. A run that ended early,
        by a failure or a terminal event, may have reached none of them.
    y : ndarray (n_t, n_y)
        State of the formulation.
    q, qdot : ndarray (n_t, n_q)
        Coordinates and their rates.
    status : Status
        How the run ended.
    t_end : float
        Time that the run reached [s], recorded or not.
    stats : RunStatistics
        Cost of the run.
    events : EventRecords
        The events of the run, by name.

    ``trajectory["x"]``, ``["x_dot"]``, ``["energy"]``, first-order states with their rates, and every requested output
    give arrays (n_t,), by name or by SymPy symbol. ``trajectory(t)`` is the motion at other times within the span.
    """

    def __init__(
        self,
        program: Program,
        constants: Constants,
        status: Status,
        t: FloatArray,
        y: FloatArray,
        stats: RunStatistics,
        dense: DenseOutput | None,
    ) -> None:
        self._program, self._c, self._dense = program, constants, dense
        self._layout = program.layout
        self.events = EventRecords()
        self._monitors: Monitors | None = None
        self._wrapped: FloatArray | None = None
        self._scene: Scene | None = None
        self._end: float | None = None
        self.status, self.stats = status, stats
        self.t, self.elapsed, self.y = t, t, y

    @cached_property
    def _values(self) -> KernelValues:
        return KernelValues(self._program, self._c, self.elapsed, self.y, self._wrapped)

    @property
    def variables(self) -> FloatArray:
        """Coordinates, rates and first-order states (n_t, 2 n_q + n_z)."""
        return self._values.variables

    @property
    def q(self) -> FloatArray:  # type: ignore[override]
        """Coordinates (n_t, n_q)."""
        return self._values.expanded[0]

    @property
    def qdot(self) -> FloatArray:  # type: ignore[override]
        """Rates of the coordinates (n_t, n_q)."""
        return self._values.expanded[1]

    def ended_at(self, t: float | None) -> Trajectory:
        """Return this motion with the time that its run reached, where that is not the last of the recorded ones."""
        self._end = t
        return self

    @property
    def t_end(self) -> float:
        """Time that the run reached [s]; that of the last row where it is not known."""
        end = self._end if self._dense is None else float(self._dense.knots[-1])
        if end is None:
            end = float(self.elapsed[-1]) if len(self.elapsed) else float("nan")
        return end if self._begin is None else self._begin + end

    @property
    def _formulations(self) -> tuple[str, ...]:
        return (self._program.formulation,)

    def with_monitors(self, monitors: Monitors) -> Trajectory:
        """Return this motion with a function that computes first integrals from (c, t, x) on demand."""
        self._monitors = monitors
        return self

    def of_scene(self, scene: Scene | None) -> Trajectory:
        """Return this motion with the scene that it is of, for pictures."""
        self._scene = scene
        return self

    @property
    def _first(self) -> FloatArray:
        """The constants at the start, of which the first are the parameters."""
        return constants_at(self._c, self.elapsed[:1])[0] if isinstance(self._c, Segments) else self._c

    @property
    def _pictured(self) -> tuple[Scene, Constants] | None:
        return None if self._scene is None else (self._scene, self._c)

    def with_wrapped(self, wrapped: FloatArray | None) -> Trajectory:
        """Return this motion with its states (n_t, n_y) less turns of angles, from which more digits follow."""
        self._wrapped = wrapped
        return self

    @cached_property
    def invariants(self) -> dict[str, FloatArray]:
        """First integrals along the motion (n_t,) by name, to see how well they are kept.

        They are "energy" where no force, constraint or motion of the scene does work, and "p_x" = dT/dx_dot for each
        coordinate x whose momentum nothing changes. They are found from the equations, not from the motion.
        """
        if self._monitors is None:
            raise OptionError("this motion has no scene; use one that simulate returned")
        return self._monitors(self._values.constants, self.elapsed, self.variables)

    @property
    def can_evaluate(self) -> bool:
        """Whether the run can be evaluated between the recorded times."""
        return self._dense is not None

    @property
    def names(self) -> tuple[str, ...]:
        """See `Motion.names`."""
        layout = self._program.layout
        rates = (*layout.rates, *layout.state_rates)
        listed = (*layout.coordinates, *rates, *layout.state, *layout.outputs, *ENERGIES)
        return tuple(dict.fromkeys(listed))

    @nesting_named
    def __getitem__(self, key: Any) -> FloatArray:
        layout = self._program.layout
        name = layout.aliases.get(str(key), str(key))
        found = self._values.named(name)
        if found is not None:
            return found
        for output in (name, str(key)):
            if output in layout.outputs:
                return self._values.outputs[:, layout.outputs.index(output)].copy()
        if name in layout.state_rates:
            return self._values.state_rates[:, layout.state_rates.index(name)].copy()
        if name in ENERGIES:
            warn_of_energy(self._program, name)
            kinetic, potential = self._values.energies.T
            energies: dict[str, FloatArray] = {
                "energy": kinetic + potential,
                "kinetic_energy": kinetic,
                "potential_energy": potential,
            }
            return energies[name]
        known = unknown_name("output", str(key), dict.fromkeys(self.names))
        raise UnknownNameError(known + reaction_hint(layout, name))

    @property
    def constraint_violation(self) -> FloatArray:
        """Constraint residuals (n_t, n_constraints): positions of holonomic, velocities of nonholonomic ones."""
        return self._values.residuals

    @property
    def velocity_violation(self) -> FloatArray:
        """Velocity residual of each constraint, (n_t, n_constraints)."""
        return self._values.velocity_residuals

    @nesting_named
    def __call__(self, t: Any) -> Trajectory:
        """Return the motion at other times.

        Parameters
        ----------
        t : float or array_like (k,)
            Times within the span, in any order.

        Raises
        ------
        OptionError
            Outside the span of the run, or where ``dense=False`` left nothing to evaluate.
        """
        times = times_of("t", t)
        if self._dense is None:
            raise OptionError("this run kept no dense output; simulate with dense=True to evaluate between its times")
        own = self._own(times)
        y = projected(self._program, self._c, own, self._dense(own))
        motion = Trajectory(self._program, self._c, self.status, own, y, self.stats, self._dense)
        motion.of_scene(self._scene).ended_at(self._end)
        if self._begin is not None:
            motion.counted_from(self._begin, times)
        return motion if self._monitors is None else motion.with_monitors(self._monitors)

    def _own(self, times: FloatArray) -> FloatArray:
        """Return times since the start of the run, as known of recorded ones; rounding takes none out of it."""
        if self._begin is None or self._dense is None:
            return times
        own = times - self._begin
        if len(self.t):
            sign = 1.0 if self.t[-1] >= self.t[0] else -1.0
            near = np.minimum(np.searchsorted(sign * self.t, sign * times), len(self.t) - 1)
            own = np.where(self.t[near] == times, self.elapsed[near], own)
        first, last = sorted((float(self._dense.knots[0]), float(self._dense.knots[-1])))
        inside = np.clip(own, first, last)
        return np.where(np.abs(own - inside) <= 4.0 * np.spacing(np.abs(times)), inside, own)

    def at(self, t: FloatArray, y: FloatArray) -> Trajectory:
        """Return states y (k, n_y) of this scene at times t (k,) of the model that ran, by name."""
        motion = Trajectory(self._program, self._c, self.status, t, y, self.stats, None)
        return motion.of_scene(self._scene).ended_at(self._end if self._dense is None else float(self._dense.knots[-1]))

    def rows(self, some: NDArray[np.intp]) -> Trajectory:
        """Return the motion at some of the recorded times, by number (k,)."""
        motion = self.at(self.elapsed[some], self.y[some])
        return motion if self._begin is None else motion.counted_from(self._begin, self.t[some])

    def with_events(self, names: Sequence[str], occurrences: Sequence[Occurrence]) -> Trajectory:
        """Return this motion with the events that occurred on it."""
        self.events = event_records(names, occurrences, self, self._program.layout.aliases)
        return self

    def __repr__(self) -> str:
        span = f"t = {self.t[0]:g} .. {self.t[-1]:g}, " if len(self.t) else ""
        return f"<Trajectory {self._program.name!r}: {span}{len(self.t)} times, {self.status.name}>"

    def to_xarray(self, units: Mapping[Any, str] | None = None) -> xarray.Dataset:
        """Return the motion as an ``xarray.Dataset`` over ``time``: coordinates, rates, states, outputs, energy.

        Its attributes are the scene, formulation, status, method, tolerances, parameters (as JSON) and version.

        Parameters
        ----------
        units : mapping of symbols or names to str, optional
            Units of what the data set holds, and of parameters: ``{x: "m", "x_dot": "m/s", "m": "kg"}``.

        Raises
        ------
        MissingExtraError
            Without the package.
        UnknownNameError, OptionError
            For units of what is not there, or that are no texts.
        """
        layout = self._program.layout
        names = dict.fromkeys((*layout.variables, *layout.outputs, "energy"))
        values = dict(zip(layout.parameters, self._first.tolist(), strict=False))
        given = {name: values[name] for name in layout.given}
        return self._dataset(self._program.name, {name: ("time", self[name]) for name in names}, given, units)


def joined_variables(motions: Sequence[Trajectory]) -> FloatArray:
    """Return the variables of motions one after the other, those of one program computed together."""
    found = [np.empty((0, 0))] * len(motions)
    together: dict[int, list[int]] = {}
    for i, motion in enumerate(motions):
        if isinstance(motion._c, Segments) or motion._c.ndim != 1 or motion._wrapped is not None:
            found[i] = motion.variables
        else:
            together.setdefault(id(motion._program), []).append(i)
    for some in together.values():
        own = [motions[i] for i in some]
        if len(own) == 1:
            found[some[0]] = own[0].variables
            continue
        t, y = np.concatenate([motion.elapsed for motion in own]), np.concatenate([motion.y for motion in own])
        sizes = [len(motion.elapsed) for motion in own]
        c = np.repeat(np.array([motion._c for motion in own]), sizes, axis=0)
        values = KernelValues(own[0]._program, c, t, y, None).variables
        for i, last, size in zip(some, np.cumsum(sizes).tolist(), sizes, strict=True):
            found[i] = values[last - size : last]
    return np.concatenate(found)


def joined_runs(runs: Sequence[Trajectory], labels: Sequence[str], *, right: bool) -> Trajectory:
    """Return one motion from runs of one program, each of which continues the one before with other constants.

    Parameters
    ----------
    runs : sequence of Trajectory
    labels : sequence of str
        Names of the events that are kept.
    right : bool
        Whether steps hold the states behind the joints, not those before them.
    """
    first, last = runs[0], runs[-1]
    if len(runs) == 1:
        return first
    parts = [
        Solution(
            status=run.status,
            t=run.elapsed,
            y=run.y,
            steps=run.stats.steps,
            rejected=run.stats.rejected,
            evaluations=run.stats.evaluations,
            dense=run._dense,
            wrapped=run._wrapped,
        )
        for run in runs
    ]
    whole = joined(parts, recorded=False, right=right)
    edges = np.array([run.elapsed[0] for run in runs] + [last.elapsed[-1]])
    c = Segments(edges, np.array([constants_at(run._c, run.elapsed[:1]).reshape(-1) for run in runs]))
    stats = replace(last.stats, steps=whole.steps, rejected=whole.rejected, evaluations=whole.evaluations)
    found = Trajectory(first._program, c, last.status, whole.t, whole.y, stats, whole.dense)
    found._monitors, found._scene, found._wrapped, found._end = first._monitors, first._scene, whole.wrapped, last._end
    occurrences = [
        Occurrence(e, float(t), before, after, int(sign))
        for run in runs
        for e, record in enumerate(run.events[label] for label in labels)
        for t, before, after, sign in zip(record.t, record.before.y, record.after.y, record.direction, strict=True)
    ]
    return found.with_events(labels, sorted(occurrences, key=lambda one: abs(one.t - first.elapsed[0])))
