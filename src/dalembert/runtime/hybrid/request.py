"""Request of a sweep of motions with contacts, and values by name at states of its cases."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...hybrid import Mode
from ...integrators.breakpoints import CaseBreaks
from ...integrators.event_code import Event
from ...ir.conditions import CONDITION_TIME
from ...ir.interpret import interpret_rows
from ...ir.program import Layout
from ...options import SweepOptions
from ...results.hybrid_sweep import States
from ...results.motion import ENERGIES
from .. import inputs
from ..reductions import Reduction
from .mode_models import ModeModels

__all__ = ["OutputValues", "SweepRequest"]


@final
@dataclass(frozen=True, eq=False)
class SweepRequest:
    """What a sweep is asked for.

    Attributes
    ----------
    t, t1 : ndarray (k,)
        Spans [s].
    x : ndarray (k, 2 n_q)
        Consistent coordinates and rates to start from.
    p : ndarray (k, n_p)
        Parameters in the order of the scene.
    status : ndarray (k,) of int
        Of cases that cannot start; -1 for the others.
    t_eval : ndarray or None
    events : tuple of Event
    reductions : mapping of str to Reduction
    options : SweepOptions
        Method, tolerances, limits and progress.
    threads : int
    layout : Layout
        Of the scene.
    varied, axes
        What was varied, for the results.
    """

    t: FloatArray
    t1: FloatArray
    x: FloatArray
    p: FloatArray
    status: NDArray[np.int64]
    t_eval: FloatArray | None
    events: tuple[Event, ...]
    reductions: Mapping[str, Reduction]
    options: SweepOptions
    threads: int
    layout: Layout
    varied: tuple[dict[str, FloatArray], dict[str, FloatArray]]
    axes: Mapping[str, FloatArray]


@final
@dataclass(frozen=True, eq=False)
class OutputValues:
    """Gives values by name, of the scene with this layout and parameters (k, n_p)."""

    modes: ModeModels
    layout: Layout
    p: FloatArray
    breaks: CaseBreaks | None = None

    def __call__(self, key: str, states: States) -> FloatArray:
        """Return something by name at states (k,)."""
        layout = self.layout
        name, names = layout.aliases.get(key, key), (*layout.coordinates, *layout.rates)
        if name in names:
            return states.x[:, names.index(name)]
        values = np.full(len(states.t), np.nan)
        for number in np.unique(states.mode[states.mode >= 0]):
            here, mode = np.flatnonzero(states.mode == number), self.modes.automaton.mode(int(number))
            program, part = self.modes.model(mode).stages.program, states.part(here)
            c = inputs.prepare_rows(program, self._rows(mode, part))
            if name in ENERGIES:
                kinetic, potential = interpret_rows(program.kernel("energy"), part.t, part.x, c).T
                values[here] = dict(zip(ENERGIES, (kinetic + potential, kinetic, potential), strict=True))[name]
                continue
            outputs = program.layout.outputs
            y = interpret_rows(program.kernel("initial"), part.t, part.x, c)
            column = outputs.index(key if key in outputs else name)
            values[here] = interpret_rows(program.kernel("outputs"), part.t, y, c)[:, column]
        return values

    def _rows(self, mode: Mode, states: States) -> FloatArray:
        """Return the parameters (k, n_p) of a mode's model at some states."""
        layout = self.modes.model(mode).layout
        own = {name: self.p[states.case, i] for i, name in enumerate(self.layout.parameters)}
        if self.breaks is not None and self.breaks.place is not None:
            own[CONDITION_TIME] = self.breaks.middles(states.case, states.t)
        columns = {**own, **self.modes.added(mode, states.directions, states.sides, states.rest)}
        return np.array([columns[name] for name in layout.parameters]).T.reshape(len(states.t), len(layout.parameters))
