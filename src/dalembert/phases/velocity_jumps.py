"""Jumps of rates in phases: where prescribed velocities jump, and by events of users."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..contacts.contact_cases import UNDECIDED, ContactCases
from ..contacts.contact_laws import OPEN, STICK, Mode
from ..errors import CapabilityError, list_names
from ..events.event_code import Event
from ..events.event_rules import accumulates
from ..ir.conditions import CONDITION_TIME
from ..ir.interpret import interpret_rows
from ..methods.status import RUNNING, Status
from ..runs.impulses import Impulses
from ..starts import inputs
from .mode_models import ModeModels

if TYPE_CHECKING:
    from ..model.model import CompiledModel


@final
@dataclass(frozen=True, eq=False)
class CaseGroup:
    """Cases that begin a part of a phase: numbers, spans, parameters and variables by name, and signs of events."""

    cases: NDArray[np.int64]
    t0: FloatArray
    t1: FloatArray
    p: Mapping[str, FloatArray]
    x: dict[str, FloatArray]
    carried: FloatArray | None


@final
@dataclass(frozen=True, eq=False)
class VelocityJumps:
    """Jumps of the rates of cases whose parameters have changed since their last run in a mode.

    Attributes
    ----------
    model : CompiledModel
        Of the mode.
    impulses : Impulses
    contact_rows : dict of int to str
        Rows of the mode's constraints that contacts hold, each with the velocity that jumps where the row does.
    scene : frozenset of str
        Parameters of the scene.
    left : dict of int to (float, dict of str to float)
        Times and parameters of cases at the ends of their last runs, which all runners share.
    """

    model: CompiledModel
    impulses: Impulses
    contact_rows: dict[int, str]
    scene: frozenset[str]
    left: dict[int, tuple[float, dict[str, float]]]

    def leave(self, group: CaseGroup, ends: FloatArray) -> None:
        """Store the parameters of cases that continue after their ends (k, 3): times, statuses and steps."""
        for place, i in enumerate(group.cases.tolist()):
            t, status, _ = ends[place]
            if status in (Status.SUCCESS, Status.EVENT):  # a guard may fire at the very stop
                own = {name: float(values[place]) for name, values in group.p.items() if name in self.scene}
                self.left[i] = float(t), own

    def apply(self, group: CaseGroup) -> None:
        """Change the rates of the cases.

        Raises
        ------
        CapabilityError
            Where contacts are struck, opened or dragged.
        """
        program, n = self.model.stages.program, len(self.model.layout.coordinates)
        for place, i in enumerate(group.cases.tolist()):
            t, own = self.left.pop(i, (np.nan, {}))
            if t != group.t0[place]:
                continue
            now = {name: float(group.p[name][place]) for name in self.model.layout.parameters}
            p = np.array([[own.get(name, value), value] for name, value in now.items()]).T
            x = np.array([values[place] for values in group.x.values()])
            before, after = inputs.prepare_rows(program, p)
            found = self.impulses.rates(t, x, before, after)
            if found is not None:
                self._refuse(t, self.impulses.broken(t, x, before, after, list(self.contact_rows)))
            for name, rate in zip(list(group.x)[n : 2 * n], [] if found is None else found, strict=False):
                group.x[name][place] = rate

    def _refuse(self, t: float, broken: list[int]) -> None:
        """Reject a jump that strikes, opens or drags contacts."""
        if broken:
            what = list_names([self.contact_rows[i] for i in broken])
            raise CapabilityError(
                f"at t = {t:g} a prescribed velocity jumps, and with it {what}, while the contact is closed: impacts of"
                " surfaces that are set in motion at once are not computed. Let the velocity change in a short time,"
                " such as by a ramp"
            )


def velocity_jumps(
    modes: ModeModels, mode: Mode, left: dict[int, tuple[float, dict[str, float]]]
) -> VelocityJumps | None:
    """Return the jumps of rates in a mode; None where no prescribed velocity can jump."""
    impulses = modes.impulses(mode)
    if impulses is None:
        return None
    scene = frozenset(modes.equations.symbols.parameters)
    return VelocityJumps(modes.model(mode).for_segments, impulses, _contact_rows(modes, mode), scene, left)


def _contact_rows(modes: ModeModels, mode: Mode) -> dict[int, str]:
    """Return the rows of a mode's constraints that contacts hold, each with the velocity that jumps where it does."""
    labels = [row.label for row in modes.model(mode).stages.equations.constraints]
    found: dict[int, str] = {}
    for contact, state in zip(modes.equations.contacts, mode, strict=True):
        if contact.gap is not None and contact.constraint is not None and state != OPEN:
            own = modes.equations.constraints[contact.constraint].label
            found |= {labels.index(own): f"the rate of the gap of {contact.name!r}"} if own in labels else {}
        if state == STICK:
            what = f"the slip velocity of {contact.name!r}"
            found |= {labels.index(slip.label): what for slip in contact.slips if slip.label in labels}
    return found


# Jumps of the state at events of users, on coordinates and rates of a scene with contacts.


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

    def apply(
        self,
        cases: ContactCases,
        occurred: FloatArray,
        carried: FloatArray,
        some: NDArray[np.intp],
        before: FloatArray,
    ) -> NDArray[np.int64]:
        """Map the states of cases by the events that have just occurred in them, whose modes are to be selected then.

        Parameters
        ----------
        cases : ContactCases
        occurred : ndarray (n_case, 3 n_events)
            Number, first and last time of each event.
        carried : ndarray (n_case, 2 n)
            Which events were seen beyond rounding since the last jump (`CaseTable.carried`); none is from this one on.
        some : ndarray (k,)
            Numbers of the cases.
        before : ndarray (k,)
            Times of their last jumps before these, NaN before the first.

        Returns
        -------
        ndarray (k,)
            RUNNING, or the status of cases that end: EVENT_STATE where the constraints forbid the state, EVENT where
            the event was the last, EVENTS_ACCUMULATE where no time has passed since the last jump or what jumps was not
            seen in between.
        """
        status, seen = np.full(len(some), RUNNING, np.int64), np.ones(len(some), bool)
        for i, event in enumerate(self._events):
            here = (occurred[some, 3 * i + 2] == cases.t[some]) & (status == RUNNING)
            if event.label in self and np.any(here):
                jumping = some[here]
                seen[here] &= carried[jumping, 2 * i + 1] != 0.0
                x, allowed = self._mapped(event.label, cases, jumping)
                cases.x[jumping[allowed]] = x[allowed]
                status[np.flatnonzero(here)[~allowed]] = Status.EVENT_STATE
        for i, event in enumerate(self._events):
            if event.label in self and event.terminal:
                over = (occurred[some, 3 * i] >= int(event.terminal)) & (status == RUNNING)
                status[over] = Status.EVENT
        for place, i in enumerate(some.tolist()):
            gap, t, span = abs(cases.t[i] - before[place]), cases.t[i], abs(cases.span[i])
            if status[place] == RUNNING and not math.isnan(gap) and accumulates(gap, t, span, seen[place], 0.0):
                status[place] = Status.EVENTS_ACCUMULATE
        carried[some, 1::2] = 0.0
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
