"""`HybridAutomaton`: modes, guards and transitions of a scene with contacts.

In a mode each contact is open or closed, and slips or sticks; the equations of a mode have no contacts any more. A mode
ends where one of its guards falls through zero. The consequence is a row of `TRANSITIONS`; it ends in a selection
among all modes, which takes the one that contradicts no law of contact.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import final

from ..ir.kernel import Kernel
from ..mechanics.equations import ContactRow, EquationsOfMotion
from .contact_data import contact_data
from .modes import CLOSED, OPEN, SLIP, SMOOTH, STATES, STICK, Mode, mode_equations
from .normal_directions import require_normals_along_gaps

__all__ = ["BITS", "TRANSITIONS", "HybridAutomaton", "Transition"]


@final
@dataclass(frozen=True)
class Transition:
    """Consequence of a guard of a contact that falls through zero.

    Attributes
    ----------
    guard : str
        Kind of the guard, see `dalembert.mechanics.equations.Guard`.
    meaning : str
        Quantity of the guard, and meaning of its zero.
    source : tuple of str
        States of the contact that have such a guard.
    target : tuple of str
        States of the contact among which mode selection chooses; what the other contacts do may change at the same
        time.
    impact : bool
        Whether rates may jump first.
    signs : tuple of int
        Signs of such guards, see `Guard.sign`.
    """

    guard: str
    meaning: str
    source: tuple[str, ...]
    target: tuple[str, ...]
    impact: bool = False
    signs: tuple[int, ...] = (0,)


TRANSITIONS: Mapping[str, Transition] = {
    row.guard: row
    for row in (
        Transition("meet", "the gap closes", (OPEN,), (CLOSED, SLIP, STICK, SMOOTH, OPEN), impact=True),
        Transition("lift", "the normal reaction vanishes", (CLOSED, SLIP, STICK, SMOOTH), (OPEN,)),
        Transition(
            "turn",
            "the normal reaction of a constraint that never opens changes its sign",
            (SLIP, STICK),
            (SLIP, STICK),
        ),
        Transition("stop", "the slip velocity along its former direction vanishes", (SLIP,), (STICK, SLIP, OPEN)),
        Transition(
            "break", "friction reaches mu_static times the normal reaction", (STICK,), (SLIP, OPEN), signs=(1, -1, 0)
        ),
        Transition(
            "share",
            "contacts that hold each other while they stick can no longer share their load",
            (STICK,),
            (STICK, SLIP, OPEN),
        ),
        Transition("paradox", "sliding friction no longer determines the normal reactions", (SLIP,), ()),
    )
}
"""Ends of a mode and their consequences, by the kind of the guard. After a paradox nothing follows."""

BITS: Mapping[tuple[str, int], int] = {
    guard: 1 << bit
    for bit, guard in enumerate((row.guard, sign) for row in TRANSITIONS.values() if row.target for sign in row.signs)
}
"""Guards of a contact as bits in compiled code (`dalembert.integrators.mode_candidates`), by their kinds and signs."""


@final
@dataclass(frozen=True, eq=False)
class HybridAutomaton:
    """A scene with contacts.

    Attributes
    ----------
    equations : EquationsOfMotion
        With all constraints and reactions of the contacts, without friction.
    contact_data : Kernel
        The numbers from which mode selection and impacts are computed.
    """

    equations: EquationsOfMotion
    contact_data: Kernel

    @classmethod
    def of(cls, equations: EquationsOfMotion) -> HybridAutomaton:
        """Return the automaton of equations with contacts.

        Raises
        ------
        ConstraintError
            When a normal reaction does not act along its gap.
        """
        require_normals_along_gaps(equations)
        return cls(equations, contact_data(equations))

    @property
    def contacts(self) -> tuple[ContactRow, ...]:
        """The contacts of the scene."""
        return tuple(self.equations.contacts)

    def states(self, contact: int) -> tuple[str, ...]:
        """Return the states that a contact may have, its ordinary closed state first."""
        row = self.contacts[contact]
        if not row.tangential:
            closed: tuple[str, ...] = (CLOSED,)
        elif row.regularization is not None:
            closed = (SMOOTH,)
        else:
            closed = (SLIP, STICK)
        return closed if row.constraint is None else (*closed, OPEN)

    def sliding_mode(self, opened: Collection[int]) -> Mode:
        """Return the mode in which contacts of some numbers are open, and all others are closed and slip."""
        return tuple(OPEN if i in opened else self.states(i)[0] for i in range(len(self.contacts)))

    def equations_of(self, mode: Mode) -> EquationsOfMotion:
        """Return the equations in a mode, with its guards.

        Raises
        ------
        ConstraintError
            When the equations do not determine the normal reaction of a contact that slides.
        """
        return mode_equations(self.equations, mode)

    def mode(self, number: int) -> Mode:
        """Return the mode of a number: the states of its contacts as digits, the first contact being the lowest."""
        return tuple(STATES[number // len(STATES) ** i % len(STATES)] for i in range(len(self.contacts)))
