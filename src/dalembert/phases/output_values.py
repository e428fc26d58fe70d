"""Values by name at states of motions with contacts, and reductions over all phases."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..contacts.equations.contact_laws import SLIP, Mode
from ..errors import list_names
from ..events.event_code import Event
from ..frozen import frozen
from ..ir.conditions import CONDITION_TIME
from ..ir.interpret import interpret_rows
from ..lanes.cases import BlockResult
from ..methods.status import Status
from ..results.parts import ENERGIES
from ..results.shared_loads import output_rows, shared_outputs
from ..results.sweep_states import SweepStates
from ..runs.reductions import Reduction
from ..starts import inputs
from .mode_models import ModeModels
from .stops import Stops

if TYPE_CHECKING:
    from ..model.model import CompiledModel


JAMMED = 0.05
"""Determinant of the reactions below which a failing run counts as one into Painleve's paradox."""

KINK = 1e-6
"""Value that vanishes at the kink of a gap below which a failing run counts as one into it."""


@final
@frozen(eq=False)
class OutputValues:
    """Values by name at states of cases.

    Attributes
    ----------
    modes : ModeModels
    p : ndarray (k, n_p)
        Parameters of the cases.
    stops : Stops or None
        Changes of the parameters along the motions.
    ends : (ndarray, ndarray) or None
        Final times of the cases (k,) [s], and whether they run forward in time.
    """

    modes: ModeModels
    p: FloatArray
    stops: Stops | None = None
    ends: tuple[FloatArray, NDArray[np.bool_]] | None = None

    def __call__(self, key: str, states: SweepStates) -> FloatArray:
        """Return something by name at states (k,)."""
        layout = self.modes.layout
        name, names = layout.aliases.get(key, key), layout.variables
        if name in names:
            return states.x[:, names.index(name)]
        values = np.full(len(states.t), np.nan)
        for number in np.unique(states.mode[states.mode >= 0]):
            here = np.flatnonzero(states.mode == number)
            part = states.part(here)
            model, y, c = self.state(int(number), part)
            program = model.stages.program
            if name in ENERGIES:
                kinetic, potential = interpret_rows(program.kernel("energy"), part.t, part.x, c).T
                values[here] = dict(zip(ENERGIES, (kinetic + potential, kinetic, potential), strict=True))[name]
                continue
            if name in layout.state_rates:
                place = len(layout.state_rates) - layout.state_rates.index(name)
                values[here] = interpret_rows(program.kernel("rhs"), part.t, y, c)[:, -place]
                continue
            outputs = program.layout.outputs
            column = outputs.index(key if key in outputs else name)
            values[here] = output_rows(program, part.t, y, c)[:, column]
        return values

    def jammed(self, states: SweepStates) -> NDArray[np.bool_]:
        """Return at which states (k,) sliding friction hardly determines the reactions."""
        found = np.zeros(len(states.t), np.bool_)
        for number in np.unique(states.mode[states.mode >= 0]):
            if SLIP in self.modes.automaton.mode(int(number)):
                here = np.flatnonzero(states.mode == number)
                found[here] = ~(self("uniqueness of reactions", states.part(here)) > JAMMED)
        return found

    def at_kinks(self, states: SweepStates) -> NDArray[np.bool_]:
        """Return at which states (k,) a closed contact is at a kink of its gap."""
        found = np.zeros(len(states.t), np.bool_)
        for number in np.unique(states.mode[states.mode >= 0]):
            here = np.flatnonzero(states.mode == number)
            for guard in self.modes.kinks(self.modes.automaton.mode(int(number))):
                found[here] |= np.abs(self(guard.output, states.part(here))) < KINK
        return found

    def state(self, number: int, states: SweepStates) -> tuple[CompiledModel, FloatArray, FloatArray]:
        """Return the model of a mode by number, and states (k, n_y) and constants (k, n_c) of it at states in it."""
        mode = self.modes.automaton.mode(number)
        model = self.modes.serving(mode)
        program = model.stages.program
        c = inputs.prepare_rows(program, self._rows(mode, states))
        return model, interpret_rows(program.kernel("initial"), states.t, states.x, c), c

    def _rows(self, mode: Mode, states: SweepStates) -> FloatArray:
        """Return the parameters (k, n_p) of a mode's model at some states."""
        layout = self.modes.serving(mode).layout
        own = {name: self.p[states.case, i] for i, name in enumerate(self.modes.layout.parameters)}
        breaks, given = (None, None) if self.stops is None else (self.stops.breaks, self.stops.inputs)
        if breaks is not None and breaks.place is not None:
            own[CONDITION_TIME] = breaks.middles(states.case, states.t)
        if given is not None and self.ends is not None:
            ends, forward = self.ends
            last = states.t == ends[states.case]
            own |= given.columns(states.t, states.case, forward[states.case] != last)
        columns = {**own, **self.modes.added(mode, states.added)}
        return np.array([columns[name] for name in layout.parameters]).T.reshape(len(states.t), len(layout.parameters))


# Reductions over all phases of motions with contacts.


@final
@frozen(eq=False)
class PhaseReductions:
    """Requested reductions, and the events and expressions that every phase needs for them.

    Attributes
    ----------
    table : mapping of str to Reduction
    requested : tuple of Event
        The events that users watch.
    """

    table: Mapping[str, Reduction]
    requested: tuple[Event, ...]

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """The events that users watch, then those whose first times are reductions."""
        crossings = [each.event(name) for name, each in self.table.items() if each.kind == "first crossing"]
        return (*self.requested, *crossings)

    @cached_property
    def along(self) -> dict[str, Reduction]:
        """The other reductions."""
        return {name: each for name, each in self.table.items() if each.kind != "first crossing"}

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of those that are continued from phase to phase: "minimum", "maximum" or "mean"."""
        return tuple(each.kind for each in self.along.values() if each.kind != "final")

    def at_start(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return what happened (k, 3 n_events), and minima, maxima and integrals (k, n_running), of cases at rest."""
        return BlockResult.at_start(count, len(self.events), self.kinds)

    def keep(self, totals: FloatArray, reduced: Mapping[str, FloatArray], passed: FloatArray) -> FloatArray:
        """Return minima, maxima and integrals (k, n_running) with what a phase of a duration (k,) reduced to, by name.

        What is not finite, of a phase that failed, is left out.
        """
        totals = totals.copy()
        names = [name for name, each in self.along.items() if each.kind != "final"]
        for column, name, kind in zip(totals.T, names, self.kinds, strict=True):
            new = reduced[name]
            if kind == "mean":
                column += np.where(np.isfinite(new), new * passed, 0.0)
            else:
                column[:] = (np.fmin if kind == "minimum" else np.fmax)(column, new)
        return totals

    def results(
        self,
        value: OutputValues,
        last: SweepStates,
        begin: FloatArray,
        status: NDArray[np.int64],
        about: tuple[FloatArray, FloatArray],
    ) -> FloatArray:
        """Return the reductions (k, n), NaN for cases that failed.

        Parameters
        ----------
        value : OutputValues
        last : States
            Where the cases ended.
        begin, status : ndarray (k,)
            Times of their starts [s], and how they ended.
        about : (ndarray, ndarray)
            What happened, and minima, maxima and integrals, as `at_start` has them.
        """
        if not self.table:
            return np.empty((len(last.t), 0))
        self._warn_of_shared_loads(value)
        happened, totals = about
        found = np.full((len(last.t), len(self.table)), np.nan)
        names = list(self.table)
        crossings = [name for name in names if name not in self.along]
        for i, name in enumerate(crossings, len(self.requested)):
            found[:, names.index(name)] = happened[:, 3 * i + 1]
        columns = np.array([names.index(name) for name in self.along], np.intp)
        for number in np.unique(last.mode[last.mode >= 0]) if len(columns) else ():
            here = np.flatnonzero(last.mode == number)
            model, y, c = value.state(int(number), last.part(here))
            code = model.derived.events((), self.along)
            assert code is not None
            spans, ends = np.column_stack([begin, last.t])[here], np.column_stack([last.t, status, status])[here]
            found[np.ix_(here, columns)] = code.reduced(spans[:, 0], ends, y, c, totals[here], np.empty((len(here), 0)))
        found[~np.isin(status, (Status.SUCCESS, Status.EVENT))] = np.nan
        return found

    def _warn_of_shared_loads(self, value: OutputValues) -> None:
        """Warn of reductions of reactions that contacts may have shared: they are of least norm, whatever the laws."""
        shared = frozenset[str]().union(
            *(shared_outputs(model.stages.program) for model in value.modes.compiled.values())
        )
        lost = [
            name
            for name, each in self.table.items()
            if str(each.expression) in shared or not shared.isdisjoint(re.findall(r"\w+", str(each.expression)))
        ]
        if lost:
            warnings.warn(
                f"reductions {list_names(lost)}: contacts may share loads that the equations do not determine, and"
                " reductions take reactions of least norm, which may pull at contacts or leave their cones of friction."
                " Samples at t_eval have those of least norm that do not",
                UserWarning,
                stacklevel=2,
            )
