"""Values by name at states of motions with contacts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...hybrid import SLIP, Mode
from ...ir.conditions import CONDITION_TIME
from ...ir.interpret import interpret_rows
from ...results.parts import ENERGIES
from ...results.shared_loads import output_rows
from ...results.sweep_states import States
from .. import inputs
from .mode_models import ModeModels
from .stops import Stops

if TYPE_CHECKING:
    from ..model import CompiledModel

__all__ = ["JAMMED", "OutputValues"]

JAMMED = 0.05
"""Determinant of the reactions below which a failing run counts as one into Painleve's paradox."""


@final
@dataclass(frozen=True, eq=False)
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

    def __call__(self, key: str, states: States) -> FloatArray:
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

    def jammed(self, states: States) -> NDArray[np.bool_]:
        """Return at which states (k,) sliding friction hardly determines the reactions."""
        found = np.zeros(len(states.t), np.bool_)
        for number in np.unique(states.mode[states.mode >= 0]):
            if SLIP in self.modes.automaton.mode(int(number)):
                here = np.flatnonzero(states.mode == number)
                found[here] = ~(self("uniqueness of reactions", states.part(here)) > JAMMED)
        return found

    def state(self, number: int, states: States) -> tuple[CompiledModel, FloatArray, FloatArray]:
        """Return the model of a mode by number, and states (k, n_y) and constants (k, n_c) of it at states in it."""
        mode = self.modes.automaton.mode(number)
        model = self.modes.serving(mode)
        program = model.stages.program
        c = inputs.prepare_rows(program, self._rows(mode, states))
        return model, interpret_rows(program.kernel("initial"), states.t, states.x, c), c

    def _rows(self, mode: Mode, states: States) -> FloatArray:
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
