"""Jumps of rates where prescribed velocities jump between two runs of a phase by Python."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...errors import CapabilityError, list_names
from ...hybrid import OPEN, STICK, Mode
from ...methods.status import Status
from .. import inputs
from ..impulses import Impulses
from .mode_models import ModeModels

if TYPE_CHECKING:
    from ..model import CompiledModel

__all__ = ["CaseGroup", "VelocityJumps", "velocity_jumps"]


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
        """Refuse a jump that strikes, opens or drags contacts."""
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
