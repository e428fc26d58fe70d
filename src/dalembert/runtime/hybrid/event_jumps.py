"""Jumps of the state at events of users, on coordinates and rates of a scene with contacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...integrators.contact_cases import UNDECIDED, ContactCases
from ...integrators.event_code import Event
from ...integrators.workspace import RUNNING
from ...ir.conditions import CONDITION_TIME
from ...ir.interpret import interpret_rows
from ...methods.status import Status
from .. import inputs

if TYPE_CHECKING:
    from ..model import CompiledModel

__all__ = ["EventJumps"]


@final
class EventJumps:
    """The maps of some events, which the constraints that hold in all modes may forbid.

    Parameters
    ----------
    model : CompiledModel
        Of the mode in which all that can open is open.
    events : sequence of Event
    names : sequence of str
        Parameters of the scene.
    """

    def __init__(self, model: CompiledModel, events: Sequence[Event], names: Sequence[str]) -> None:
        self.model = model
        self._events, self._names = tuple(events), tuple(names)
        jumping = [replace(event, terminal=False) for event in events if event.apply is not None]
        self._codes = {event.label: model.derived.events((event,)) for event in jumping}

    def __contains__(self, label: str) -> bool:
        return label in self._codes

    def apply(self, cases: ContactCases, occurred: FloatArray, some: NDArray[np.intp]) -> NDArray[np.int64]:
        """Map the states of cases by the events that have just occurred in them, whose modes are to be selected then.

        Parameters
        ----------
        cases : ContactCases
        occurred : ndarray (n_case, 3 n_events)
            Number, first and last time of each event.
        some : ndarray (k,)
            Numbers of the cases.

        Returns
        -------
        ndarray (k,)
            RUNNING, or the status of cases that end: EVENT_STATE where the constraints forbid the state, EVENT where
            the event was the last.
        """
        status = np.full(len(some), RUNNING, np.int64)
        for i, event in enumerate(self._events):
            here = (occurred[some, 3 * i + 2] == cases.t[some]) & (status == RUNNING)
            if event.label in self and np.any(here):
                jumping = some[here]
                x, allowed = self._mapped(event.label, cases, jumping)
                cases.x[jumping[allowed]] = x[allowed]
                status[np.flatnonzero(here)[~allowed]] = Status.EVENT_STATE
        for i, event in enumerate(self._events):
            if event.label in self and event.terminal:
                over = (occurred[some, 3 * i] >= int(event.terminal)) & (status == RUNNING)
                status[over] = Status.EVENT
        going = some[status == RUNNING]
        cases.modes[going], cases.number[going] = UNDECIDED, UNDECIDED
        return status

    def motion_state(self, t: FloatArray, x: FloatArray, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return states (k, n_y) and constants (k, n_c) of `model` at times, variables and parameters."""
        program = self.model.stages.program
        columns = {name: p[:, i] for i, name in enumerate(self._names)}
        columns = {name: np.full(len(t), value) for name, value in program.layout.defaults.items()} | columns
        if CONDITION_TIME in columns:
            columns[CONDITION_TIME] = t
        own = np.array([columns[name] for name in program.layout.parameters]).T.reshape(len(t), -1)
        c = inputs.prepare_rows(program, own)
        return interpret_rows(program.kernel("initial"), t, x, c), c

    def _mapped(self, label: str, cases: ContactCases, some: NDArray[np.intp]) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return variables (k, 2 n_q + n_z) of cases after an event, and whether the constraints allow them (k,)."""
        program, code, t = self.model.stages.program, self._codes[label], cases.t[some]
        assert code is not None
        jump = code.jumps[0]
        assert jump is not None
        y, c = self.motion_state(t, cases.x[some], cases.p[some])
        states, allowed = code.after_jump(jump, t, y, c, np.where(cases.span[some] < 0.0, -1.0, 1.0))
        return interpret_rows(program.kernel("expand"), t, states, c), allowed
