"""What a scene with contacts offers its motions: equations, laws, and a model for every mode."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ...arrays import FloatArray
from ...codegen.base import Engine
from ...integrators.breakpoints import CaseBreaks
from ...integrators.event_code import Event, leaving
from ...ir.conditions import Conditions
from ...ir.kernel import Kernel
from ...mechanics.equations import EquationsOfMotion, Watchpoint
from ...once import derived_once
from ...reduction.modes import OPEN, SLIP, STICK, Mode, direction_names, side_name
from ...reduction.time_conditions import decided
from ...reduction.verdicts import Verdict
from ...reduction.watching import expanding
from ...results.trajectory import Trajectory
from .settling import Laws

if TYPE_CHECKING:
    from ..model import CompiledModel

__all__ = ["Modes", "Violation"]


@final
@dataclass(frozen=True, eq=False)
class Modes:
    """What a scene with contacts offers its motions: equations, laws, and the model of every mode.

    `engine` evaluates kernels that belong to no mode. `rulings` are the verdicts met so far: by the mode that ended, by
    what ended it, and by the contacts that slide, as bits; None where there is no verdict.
    """

    equations: EquationsOfMotion
    laws: Laws
    model: Callable[[Mode], CompiledModel]
    engine: Callable[[], Engine]
    rulings: dict[tuple[Mode, tuple[Watchpoint, ...]], dict[int, Verdict | None]] = field(
        default_factory=dict, init=False
    )
    _points: dict[Mode, list[Watchpoint]] = field(default_factory=dict, init=False)
    _expansions: dict[Mode, Kernel] = field(default_factory=dict, init=False)

    @cached_property
    def conditions(self) -> Conditions | None:
        """The conditions on time alone, in the parameters of the scene."""
        return decided(self.equations)

    def breaks(self, p: FloatArray, t0: FloatArray, t1: FloatArray) -> CaseBreaks | None:
        """Return when conditions change in cases of parameters (k, n_p) between t0 and t1 (k,); None without any."""
        if self.conditions is None:
            return None
        found = CaseBreaks.of(self.conditions, p, t0, t1)
        return found if self.conditions.decides or len(found.times) else None

    def points(self, mode: Mode) -> list[Watchpoint]:
        """Return what can end a mode; what is constant along its motions cannot."""

        def make() -> list[Watchpoint]:
            reduced = self.model(mode).stages.reduced
            graph, moving = reduced.equations.graph, [*reduced.inputs, *reduced.equations.timing]
            found = reduced.equations.watchpoints
            return [p for p in found if graph.freed_of(reduced.outputs[p.output], moving) is None]

        return derived_once(self._points, mode, make)

    def events(self, mode: Mode, before: Mode | None, fired: Sequence[Watchpoint]) -> list[Event]:
        """Return what can end a mode as events, for motions that come from the mode `before` because of `fired`."""
        found = []
        for point in self.points(mode):
            event = Event(point.output, terminal=True, direction=-1, name=point.output)
            kinds = {other.kind for other in fired if other.contact == point.contact}
            leaves = before is not None and (
                (point.kind == "meet" and ("lift" in kinds or "meet" in kinds))
                or (point.kind == "turn" and "turn" in kinds)
                or (point.kind == "stop" and ("stop" in kinds or before[point.contact] == STICK))
            )
            found.append(leaving(event) if leaves else event)
        return found

    def expand(self, mode: Mode, t: FloatArray, y: FloatArray, columns: Mapping[str, FloatArray]) -> FloatArray:
        """Return coordinates and rates (k, 2 n_q) of states (k, n_y) of a mode at times (k,).

        `columns` are the parameters of the mode's model in their order, (k,) or (1,) each.
        """
        p = np.empty((len(t), len(columns)))
        for i, column in enumerate(columns.values()):
            p[:, i] = column
        return self.model(mode).engine.rows(self.expansion(mode), t, y, p)

    def states(self, mode: Mode, t: FloatArray, x: FloatArray, c: FloatArray) -> FloatArray:
        """Return the states (k, n_y) of a mode with coordinates and rates (k, 2 n_q), for its constants (k, n_c)."""
        model = self.model(mode)
        start = model.derived.start((*model.layout.coordinates, *model.layout.rates))
        names = [*model.layout.coordinates, *model.layout.rates]
        given = x[:, [names.index(name) for name in start.given]]
        return np.ascontiguousarray(model.engine.rows(start.kernel, t, given, c)[:, : len(model.layout.state)])

    def expansion(self, mode: Mode) -> Kernel:
        """Return the kernel of coordinates and rates in a mode."""
        return derived_once(self._expansions, mode, lambda: expanding(self.model(mode).stages.reduced))

    def added(self, mode: Mode, directions: FloatArray, sides: FloatArray) -> dict[str, Any]:
        """Return the parameters of a mode for directions (..., n_contacts, 2) and sides (..., n_contacts)."""
        values: dict[str, Any] = {}
        for i, (contact, state) in enumerate(zip(self.equations.contacts, mode, strict=True)):
            if state == SLIP:
                names = direction_names(contact)
                values |= {name: directions[..., i, j] for j, name in enumerate(names)}
            side = side_name(contact)
            if side is not None and state in (SLIP, STICK):
                values[side] = sides[..., i]
        return values

    def named(self, mode: Mode) -> dict[str, str]:
        """Return what each contact does in a mode."""
        return {contact.name: state for contact, state in zip(self.equations.contacts, mode, strict=True)}

    def violation(self, mode: Mode) -> Violation:
        """Return what tells the violation of the scene's constraints (n_t, n_c) from a motion in a mode."""
        opened = {c.constraint: c.name for c, s in zip(self.equations.contacts, mode, strict=True) if s == OPEN}
        return Violation(tuple(opened.get(i) for i in range(len(self.equations.constraints))))


@final
@dataclass(frozen=True)
class Violation:
    """Tells the violation of the scene's constraints (n_t, n_c) from a motion in a mode; it can be pickled.

    `opened` has for each constraint the name of the contact that is open instead, or None.
    """

    opened: tuple[str | None, ...]

    def __call__(self, motion: Trajectory) -> FloatArray:
        """Return the violation along a motion."""
        found = iter(motion.constraint_violation.T)
        columns = [
            next(found) if contact is None else np.minimum(motion[f"gap of {contact}"], 0.0) for contact in self.opened
        ]
        return np.array(columns).T.reshape(len(motion.t), len(columns))
