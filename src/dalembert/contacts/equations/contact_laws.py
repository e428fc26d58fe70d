"""Laws of one contact as values on the graph: friction factors, guards, the parameters that they add, and a kernel.

Mode selection and impacts are computed from the numbers of this kernel (`dalembert.contacts.contact_system`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import final

from ...ir.graph import Graph
from ...ir.kernel import Kernel
from ...ir.node import Node
from ...mechanics.equations import ConstraintRow, ContactRow, EquationsOfMotion, Guard
from ...transforms.lower_kernels import lower_kernel

OPEN, CLOSED, SLIP, STICK, SMOOTH = "open", "closed", "slip", "stick", "smooth"

STATES = (OPEN, CLOSED, SLIP, STICK, SMOOTH)
"""Their places are their numbers in compiled code (`dalembert.contacts.contact_system`)."""

Mode = tuple[str, ...]
"""One word a contact."""

_ONSET = 0.05
"""Share of the rest speed in a plane within which slip that begins keeps the direction in which it begins."""


_MARGIN, _BEGUN = 0.2, 5.0
"""Multiples of the rest speed, of ten tolerances: by how much slip that begins may seem to go backwards, which is the
error of two steps, and from which it has begun."""


def mode_parameters(contact: ContactRow, state: str = SLIP) -> tuple[str, str, str, str]:
    """Return the names of the parameters that a contact in a state adds to those of the scene, "" where it adds none.

    They hold the direction of slip (a sign along a line, a unit vector in a plane); the sign of a normal reaction that
    can push and pull, or, where the contact opens, the allowance: what is added to its normal reaction or gap in a
    guard, so that rounding cannot make it fire; and the slip speed in a plane below which it counts as at rest, which
    is negative in phases that do not begin at rest. A contact that slips has all that it can have.
    """
    name, width = contact.name, len(contact.tangential) if state == SLIP else 0
    directions = (f"slip direction {n} of {name}" if width > 1 else "" for n in (1, 2))
    first, second = (f"slip direction of {name}", "") if width == 1 else directions
    sided = contact.tangential and contact.normal_load is None and state in (SLIP, STICK)
    side = f"side of {name}" if sided else ""
    if contact.opens:
        side = f"allowance of {name}"
    return first, second, side, f"rest speed of {name}" if width > 1 else ""


@final
class ContactLaws:
    """Laws of the contacts of a scene.

    Attributes
    ----------
    behind_guards : list of Node
        Values in the factors of friction so far that `EquationsOfMotion.behind_guards` is to have.
    """

    def __init__(self, equations: EquationsOfMotion) -> None:
        self.whole, self.behind_guards = equations, list[Node]()
        self.graph: Graph = equations.graph

    def factors(self, contact: ContactRow, state: str, free: Node, slips_now: Node | None = None) -> list[Node]:
        """Return kappa: friction is -kappa N. `free` is N without friction, whose sign the smooth law takes.

        `slips_now` is 1 where the contact slips and 0 where it does not, and kappa is 0; it always slips without it.
        """
        graph = self.graph
        slips = [self.speed(row) for row in contact.slips]
        if state == SMOOTH:
            assert contact.regularization is not None
            size = graph.call("sqrt", graph.sum(w * w for w in (*slips, contact.regularization)))
            side = graph.one
            if not contact.opens and contact.normal_load is None:
                side = graph.call("select", graph.call("less", graph.zero, free), graph.one, graph.const(-1))
            return [self.coefficient(contact, lambda: size) * side * w / size for w in slips]
        held, rests = self.directions(contact), self.graph.zero
        if slips_now is not None:
            rests = graph.one - slips_now
            slips, held = [slips_now * w for w in slips], [slips_now * d for d in held]
        if len(held) == 1:
            return [self.coefficient(contact, lambda: held[0] * slips[0]) * self.side(contact) * held[0]]
        # At w = 0 friction keeps the direction d in which slip begins, for |w| well above s it is along w: the law of
        # w + s exp(-|w|^2 / s^2) d is smooth at the beginning of slip, and within rounding that of w from |w| = 6 s on.
        rest = graph.input(mode_parameters(contact)[3])
        begins, onset = graph.call("less", graph.zero, rest), graph.node(_ONSET) * graph.call("abs", rest)
        # A step that continues beyond the end of slip, where w reverses, has the same friction as before it; where slip
        # begins at rest, what goes backwards within the margin of the guard has friction as if it went forwards.
        forward, speed = graph.sum(w * d for w, d in zip(slips, held, strict=True)), graph.sum(w * w for w in slips)
        reversed_by = 4 * forward * graph.call("abs", forward) + speed
        back = graph.call("less", reversed_by, graph.zero)
        sign = graph.call("select", begins, graph.one, graph.call("select", back, graph.const(-1), graph.one))
        backwards = graph.call("select", begins, forward, graph.zero)
        self.behind_guards += [forward, reversed_by, backwards]
        backwards = graph.call("select", graph.call("less", backwards, graph.zero), backwards, graph.zero)
        ahead = onset * graph.call("exp", -speed / (onset * onset)) - 2 * backwards
        along = [sign * w + ahead * d for w, d in zip(slips, held, strict=True)]
        size = graph.call("sqrt", graph.sum(a * a for a in along) + rests)
        mu = self.coefficient(contact, lambda: size) * self.side(contact)
        return [mu * a / size for a in along]

    def coefficient(self, contact: ContactRow, speed: Callable[[], Node]) -> Node:
        """Return mu at a slip speed, which is only computed where mu depends on it."""
        assert contact.mu is not None
        if contact.slip_speed is None:
            return contact.mu
        return self.graph.substitute([contact.mu], {contact.slip_speed: speed()})[0]

    def coefficients_now(self, contact: ContactRow) -> tuple[Node | None, Node | None]:
        """Return mu and mu_static at the present slip velocity, of which the second is not smaller."""
        if contact.slip_speed is None or contact.mu_static is None:
            return contact.mu, contact.mu_static
        slips = [self.speed(row) for row in contact.slips]
        speed = self.graph.call("sqrt", self.graph.sum(w * w for w in slips))
        mu = self.coefficient(contact, lambda: speed)
        return mu, self.graph.call("max", mu, contact.mu_static)

    def normal(self, contact: ContactRow) -> Node:
        """Return the normal reaction: an input, or what is given for it."""
        names = self.whole.symbols.unknowns
        return self.graph.input(names[contact.normal]) if contact.normal_load is None else contact.normal_load

    def directions(self, contact: ContactRow) -> list[Node]:
        """Return the direction of slip: a sign along a line, a unit vector in a plane."""
        return [self.graph.input(name) for name in mode_parameters(contact)[:2] if name]

    def side(self, contact: ContactRow) -> Node:
        """Return the sign of the normal reaction."""
        sided = not contact.opens and contact.tangential and contact.normal_load is None
        return self.graph.input(mode_parameters(contact)[2]) if sided else self.graph.one

    def allowance(self, contact: ContactRow) -> Node:
        """Return what is added to the normal reaction, to the gap or to the most friction in a guard."""
        return self.graph.input(mode_parameters(contact)[2]) if contact.opens else self.graph.zero

    def open_gap(self, contact: ContactRow, support: Node | None) -> Node:
        """Return the gap of an open contact, in its guard.

        Where it touches, the distance of its `support` counts, too, which is None where no compliance lets it move.
        """
        assert contact.gap is not None
        if support is None:
            return contact.gap
        graph, twice = self.graph, self.allowance(contact) + self.allowance(contact)
        touches = graph.call("less", contact.gap, twice)
        return contact.gap + graph.call("select", touches, graph.call("min", support, graph.zero), graph.zero)

    def speed(self, row: ConstraintRow) -> Node:
        """Return the rate along a row."""
        terms = (a * b for a, b in zip(row.jacobian, self.whole.qdot, strict=True))
        return self.graph.sum(terms) + row.drift

    def stopping(self, i: int) -> list[tuple[Guard, Node]]:
        """Return the slip velocity along its former direction.

        Where slip in a plane begins, rounding and integration leave of it more than there is: the guard then has a
        margin, and the phase ends as soon as there is slip well above it.
        """
        graph, contact = self.graph, self.whole.contacts[i]
        held = zip(contact.slips, self.directions(contact), strict=True)
        forward = graph.sum(self.speed(row) * d for row, d in held)
        if len(contact.slips) == 1:
            return [(Guard(f"slip speed of {contact.name}", i, "stop"), forward)]
        speed = graph.input(mode_parameters(contact)[3])
        begins = graph.call("less", graph.zero, speed)
        margin = graph.call("select", begins, graph.node(_MARGIN) * speed, graph.zero)
        left = graph.call("select", begins, graph.node(_BEGUN) * speed - forward, graph.one)
        return [
            (Guard(f"slip speed of {contact.name}", i, "stop"), forward + margin),
            (Guard(f"slip speed left to begin of {contact.name}", i, "stop"), left),
        ]

    def most_friction(self, contact: ContactRow, press: Node) -> Node:
        """Return how large friction may be where a contact sticks by itself."""
        assert contact.mu_static is not None
        return contact.mu_static * press + self.allowance(contact)

    def holding(self, i: int, most: Node, forces: Sequence[Node]) -> list[tuple[Guard, Node]]:
        """Return by how much friction forces could be larger that may be as large as `most` where a contact sticks."""
        graph, contact = self.graph, self.whole.contacts[i]
        if len(forces) > 1:
            rest = most * most - graph.sum(f * f for f in forces)
            return [(Guard(f"hold of {contact.name}", i, "break"), rest)]
        return [(Guard(f"hold of {contact.name} against {s:+d}", i, "break", s), most + s * forces[0]) for s in (1, -1)]


NUMBERS = "gap", "mu", "mu_static", "restitution", "regularization", "normal_load"
"""Numbers of each contact, in the order of the outputs."""


def contact_data(equations: EquationsOfMotion) -> Kernel:
    """Return a kernel of (t, (q, q_dot), c), c beginning with the parameters of the scene.

    Its outputs are M (n_q, n_q) and the forcing (n_q,); of the constraints and, behind them, the slip velocities the
    Jacobians (n_rows, n_q), the biases of their accelerations (n_rows,) and their values on the rates (n_rows,); the
    power coefficients of the reactions (n_reactions, n_q); and of the contacts gaps, mu, mu_static, restitutions,
    regularizations and given normal loads (n_contacts,), zero where they have none.
    """
    graph = Graph()  # a graph of its own, so that the kernel depends on the equations alone
    rows = [*equations.constraints, *(row for contact in equations.contacts for row in contact.slips)]
    nodes: list[Node] = [entry for row in equations.mass_matrix for entry in row]
    nodes += equations.forcing
    nodes += [entry for row in rows for entry in row.jacobian]
    nodes += [row.bias for row in rows]
    for row in rows:
        terms = (a * b for a, b in zip(row.jacobian, equations.qdot, strict=True))
        nodes.append(equations.graph.sum(terms) + row.drift)
    nodes += [row[i] for i in range(len(equations.symbols.unknowns)) for row in equations.reactions]
    now = [ContactLaws(equations).coefficients_now(contact) for contact in equations.contacts]
    coefficients = {"mu": [mu for mu, _ in now], "mu_static": [static for _, static in now]}
    for name in NUMBERS:
        numbers = coefficients.get(name) or [getattr(contact, name) for contact in equations.contacts]
        nodes += [equations.graph.zero if node is None else node for node in numbers]
    inputs: dict[Node, tuple[str, int | None]] = {graph.input(equations.symbols.time): ("t", None)}
    inputs |= {graph.input(name): ("c", i) for i, name in enumerate(equations.symbols.parameters)}
    inputs |= {graph.input(name): ("y", i) for i, name in enumerate(equations.symbols.variables)}
    return lower_kernel(graph, "contact_data", graph.adopt(nodes), inputs, arguments=("t", "y", "c"))
