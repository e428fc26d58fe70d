"""`HybridAutomaton`: modes, guards and transitions of a scene with contacts.

In a mode each contact is open or closed, and slips or sticks; the equations of a mode have no contacts any more. A mode
ends where one of its guards falls through zero. The consequence is a row of `TRANSITIONS`; it ends in a selection
among all modes, which takes the one that contradicts no law of contact.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from keyword import iskeyword
from typing import final

from ..errors import ConstraintError
from ..frozen import frozen
from ..ir.kernel import Kernel
from ..mechanics.equations import ContactRow, EquationsOfMotion
from ..mechanics.manifold import outside_span_on_manifold
from ..mechanics.power_checks import parallel
from .equations.contact_laws import CLOSED, OPEN, SLIP, SMOOTH, STATES, STICK, Mode, contact_data
from .equations.modes import mode_equations

# Check that the normal reactions of contacts that open act along their gaps.


def require_normals_along_gaps(equations: EquationsOfMotion) -> None:
    """Raise unless every contact that opens can be held closed by normal reactions, without its friction.

    Impacts and the selection of modes take the reaction of a gap to have power along it, and none along the slip
    velocity; with another direction sliding has no equations.

    Raises
    ------
    ConstraintError
        With the contact, the coordinates along which power is missing, and what to do.
    """
    tangential = {i for contact in equations.contacts for i in contact.tangential}
    opening = {contact.constraint for contact in equations.contacts}
    rows = equations.constraints
    lasting = [row for i, row in enumerate(rows) if i not in opening]
    names = equations.symbols.unknowns
    others = [[row[i] for row in equations.reactions] for i in range(len(names)) if i not in tangential]
    for contact in equations.contacts:
        if contact.constraint is None:
            continue
        gap = rows[contact.constraint]
        if parallel(equations.graph, gap.jacobian, [row[contact.normal] for row in equations.reactions]):
            continue
        covectors = [*others, *(row.jacobian for row in lasting)]
        held = [(row.position, row.jacobian) for row in (gap, *lasting) if row.position is not None]
        positions, jacobian = [position for position, _ in held], [row for _, row in held]
        missing = outside_span_on_manifold(equations.q, covectors, positions, jacobian)
        if missing:
            along = ", ".join(equations.symbols.coordinates[i] for i in missing)
            raise ConstraintError(
                f"scene {equations.name!r}: the normal reaction {names[contact.normal]!r} of the contact"
                f" {contact.name!r} does not act along its gap (their powers on {along} differ): it would have power on"
                " motions that keep the gap. Let its force in the joint be normal to the surfaces that touch, and"
                " friction the rest"
            )


@final
@frozen
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
        Transition("kink", "the gradient of the gap jumps", (CLOSED, SLIP, STICK, SMOOTH), ()),
    )
}
"""Ends of a mode and their consequences, by the kind of the guard. After a paradox, or a kink, nothing follows."""

BITS: Mapping[tuple[str, int], int] = {
    guard: 1 << bit
    for bit, guard in enumerate((row.guard, sign) for row in TRANSITIONS.values() if row.target for sign in row.signs)
}
"""Guards of a contact as bits in compiled code (`contacts.selection.mode_candidates`), by their kinds and signs."""


@final
@frozen(eq=False)
class HybridAutomaton:
    """A scene with contacts.

    Attributes
    ----------
    equations : EquationsOfMotion
        With all constraints and reactions of the contacts, without friction.
    contact_data : Kernel
        The numbers from which mode selection and impacts are computed.
    impacts : str
        "newton", "poisson" or "sequence", see `dalembert.compile_model`.
    """

    equations: EquationsOfMotion
    contact_data: Kernel
    impacts: str = "newton"

    @classmethod
    def of(cls, equations: EquationsOfMotion, impacts: str = "newton") -> HybridAutomaton:
        """Return the automaton of equations with contacts.

        Raises
        ------
        ConstraintError
            When a normal reaction does not act along its gap.
        """
        require_normals_along_gaps(equations)
        return cls(equations, contact_data(equations), impacts)

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
        return (*closed, OPEN) if row.opens else closed

    @property
    def example(self) -> str:
        """Text of the arguments of `mode` for what opens to be open, and of others for their first closed state."""
        chosen = {row.name: self.states(i)[-1 if row.opens else 0] for i, row in enumerate(self.contacts)}
        leaders = {row.name: chosen[row.name] for row in self.contacts if row.leader is None}
        if len(leaders) > 3 and {*leaders.values()} == {OPEN}:
            return f"**dict.fromkeys(model.contacts, {OPEN!r})"
        if all(name.isidentifier() and not iskeyword(name) for name in leaders):
            return ", ".join(f"{name}={state!r}" for name, state in leaders.items())
        return f"**{leaders!r}"

    def sliding_mode(self, opened: Collection[int]) -> Mode:
        """Return the mode in which contacts of some numbers are open, and all others are closed and slip."""
        every = range(len(self.contacts))
        return self.with_followers(tuple(OPEN if i in opened else self.states(i)[0] for i in every))

    def with_followers(self, mode: Mode) -> Mode:
        """Return a mode in which further laws of friction are open where their contacts are."""
        leaders = [i if contact.leader is None else contact.leader for i, contact in enumerate(self.contacts)]
        return tuple(OPEN if mode[leader] == OPEN else state for leader, state in zip(leaders, mode, strict=True))

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

    def number(self, mode: Mode) -> int:
        """Return the number of a mode, of which `mode` is the inverse."""
        return sum(STATES.index(state) * len(STATES) ** i for i, state in enumerate(mode))
