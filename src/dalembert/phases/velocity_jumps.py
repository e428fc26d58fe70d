"""Jumps of rates in phases: where prescribed velocities jump, and by events of users."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray, aligned
from ..contacts.equations.contact_laws import OPEN, STICK, Mode
from ..contacts.phase_maps import AT_TIME, DEFAULT, EventMaps
from ..errors import CapabilityError, list_names
from ..events.event_code import Event
from ..frozen import frozen
from ..ir.conditions import CONDITION_TIME
from ..ir.interpret import interpret_rows
from ..methods.status import Status
from ..runs.impulses import Impulses
from ..starts import inputs
from ..subset.arguments import NO_CODE, AddressTable
from .mode_models import ModeModels

if TYPE_CHECKING:
    from ..model.model import CompiledModel


@final
@frozen(eq=False)
class CaseGroup:
    """Cases that begin a part of a phase: numbers, spans, parameters and variables by name, and signs of events."""

    cases: NDArray[np.int64]
    t0: FloatArray
    t1: FloatArray
    p: Mapping[str, FloatArray]
    x: dict[str, FloatArray]
    carried: FloatArray | None


@final
@frozen(eq=False)
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
    modes : ModeModels
    events : sequence of Event

    Attributes
    ----------
    model : CompiledModel
        Of the mode in which all that can open is open.
    """

    def __init__(self, modes: ModeModels, events: Sequence[Event]) -> None:
        self._modes, self.model = modes, modes.model(modes.open_mode)
        self._events, self._names = tuple(events), modes.layout.parameters
        jumping = [replace(event, terminal=False) for event in events if event.apply is not None]
        self._labels = {event.label for event in jumping}
        self._code = self.model.derived.events(tuple(jumping))

    def __contains__(self, label: str) -> bool:
        return label in self._labels

    def maps(self, count: int) -> EventMaps:
        """Return the maps as compiled code has them, for so many cases."""
        code, names = self._code, self._names
        assert code is not None
        program, engine = self.model.stages.program, self.model.engine
        layout, start, prepare = program.layout, code.start, self._modes.constants_when_open
        lanes = engine.code(start.kernel)[1]
        columns = [names.index(name) if name in names else DEFAULT for name in layout.parameters]
        columns = [AT_TIME if n == CONDITION_TIME else c for n, c in zip(layout.parameters, columns, strict=True)]
        n, n_x, jumps = len(layout.state), len(layout.variables), iter(code.jumps)
        own = [next(jumps) if event.apply is not None else None for event in self._events]

        def room(rows: int) -> FloatArray:
            return aligned(max(rows, 1), lanes)

        return EventMaps(
            prepare=engine.code(prepare)[0],
            initial=engine.code(program.kernel("initial"))[0],
            start=engine.code(start.kernel)[0],
            expand=engine.code(program.kernel("expand"))[0],
            jumps=AddressTable([NO_CODE if jump is None else engine.code(jump)[0] for jump in own]),
            terminal=np.array([int(event.terminal) for event in self._events], np.int64),
            columns=np.array(columns, np.int64),
            defaults=np.array([layout.defaults.get(name, 0.0) for name in layout.parameters]),
            size=n,
            clock=room(1),
            parameters=room(len(columns)),
            constants=room(len(prepare.outputs)),
            states=room(n),
            given=room(len(start.given)),
            begun=room(len(start.kernel.outputs)),
            posed=room(n_x),
            last=np.full(count, np.nan),
            before=np.zeros((count, n_x)),
            number=np.zeros(count, np.int64),
        )

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
