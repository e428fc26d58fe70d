"""[EquationsOfMotion] -> [Kernel]: what `runtime.hybrid.deciding` finds numerically, written out on the graph.

For contacts that stand in one way, the kernel has the margins of all that they may do. It divides by pivots where the
numerical way has pseudo-inverses, so it says how far it can be trusted, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

from ..errors import ConstraintError, SingularMassMatrixError
from ..ir.graph import Node
from ..ir.kernel import Kernel
from ..mechanics.equations import ConstraintRow, EquationsOfMotion
from ..transforms.linear import SingularMatrix, determinant_and_solution
from ..transforms.lower_kernels import lower_kernel
from .modes import CLOSED, OPEN, SLIP, SMOOTH, STICK, Mode, side_name
from .responses import Own, Response, Responses, Undetermined, sized

__all__ = ["Attempt", "Verdict", "slip_kernel", "start_kernel", "verdict"]


@final
@dataclass(frozen=True)
class Attempt:
    """What contacts might do: a state each, the side relative to the given one, and the direction of slip.

    The direction is 0 where it is that of the slip velocity. `begins` holds, for each contact, whether slip begins
    in this attempt, and `broken` whether friction has just failed to hold it; `leaves` whether it is decided here
    that it opens, and `turned` whether its normal reaction is known to change its side.
    """

    mode: Mode
    sides: tuple[int, ...]
    ways: tuple[int, ...]
    begins: tuple[bool, ...]
    broken: tuple[bool, ...]
    leaves: tuple[bool, ...]
    turned: tuple[bool, ...]


@final
@dataclass(frozen=True)
class Verdict:
    """A kernel of (t, (q, q_dot, former direction and side of each contact), p), and what its outputs are.

    They are how regular the equations are (1 at best, 0 where they cannot be solved), a sum that is finite where the
    motions are, and one margin an attempt; then, for each attempt in `held`, the rates (n_q,) nearest to the present
    ones that it allows.
    """

    kernel: Kernel
    attempts: tuple[Attempt, ...]
    held: tuple[int, ...]


def slip_kernel(equations: EquationsOfMotion) -> Kernel:
    """Return a kernel of (t, (q, q_dot), p) with the slip velocity along the first direction of each contact."""
    own = Own(equations)
    nothing = own.graph.zero
    slips = [own.slip_velocity(contact.slips[0]) if contact.slips else nothing for contact in own.equations.contacts]
    return lower_kernel(own.graph, "slips", slips, own.inputs([]), arguments=("t", "y", "c"))


def start_kernel(equations: EquationsOfMotion) -> Kernel:
    """Return a kernel of (t, (q, q_dot), p) with five numbers a contact, of those that slip along one direction.

    They are its slip velocity, the sum of the sizes of its terms, the coefficients of sliding and of static friction,
    and the restitution.
    """
    own = Own(equations)
    graph, nodes = own.graph, list[Node]()
    for contact in own.equations.contacts:
        (slip,) = contact.slips
        terms = (graph.call("abs", a * b) for a, b in zip(slip.jacobian, own.equations.qdot, strict=True))
        numbers = (contact.mu, contact.mu_static, contact.restitution)
        nodes += [own.slip_velocity(slip), graph.sum(terms), *(graph.zero if n is None else n for n in numbers)]
    return lower_kernel(graph, "starts", nodes, own.inputs([]), arguments=("t", "y", "c"))


def verdict(
    equations: EquationsOfMotion, attempts: Sequence[Attempt], holding: Sequence[bool], grazing: float
) -> Verdict | None:
    """Return the verdict on attempts, or None where it takes pseudo-inverses, or contacts that slip in a plane.

    Parameters
    ----------
    equations : EquationsOfMotion
    attempts : sequence of Attempt
    holding : sequence of bool
        For which of them the rates are corrected.
    grazing : float
        Share of the motion within which slip that friction has just failed to hold may seem to go backwards.
    """
    if any(len(contact.tangential) > 1 for contact in equations.contacts):
        return None
    try:
        return _Judge(Own(equations), grazing).verdict(attempts, holding)
    except (ConstraintError, SingularMassMatrixError, SingularMatrix, Undetermined):
        return None


@final
class _Judge:
    """The making of one verdict."""

    def __init__(self, own: Own, grazing: float) -> None:
        self.own, self.equations, self.graph, self.grazing = own, own.equations, own.graph, grazing
        self.contacts = self.equations.contacts
        self.responses = Responses(self.equations)
        self.sticky, self.regular = self.responses.sticky, self.responses.regular
        self.former = [f"former direction {i}" for i in range(len(self.contacts))]
        self.sides = [f"former side {i}" for i in range(len(self.contacts))]

    def verdict(self, attempts: Sequence[Attempt], holding: Sequence[bool]) -> Verdict:
        graph = self.graph
        margins, sums = [], []
        for attempt in attempts:
            margin, motion = self._margin(attempt)
            margins.append(margin)
            sums += [sized(graph, entry) for entry in motion]
        held = [i for i, holds in enumerate(holding) if holds]
        rates = [entry for i in held for entry in self._held(attempts[i].mode)]
        regular = graph.one
        for value in self.regular:
            regular = graph.call("min", value, regular)
        inputs = self.own.inputs([*self.former, *self.sides])
        nodes = [regular, graph.sum([*sums, *(sized(graph, rate) for rate in rates)]), *margins, *rates]
        kernel = lower_kernel(graph, "verdict", nodes, inputs, arguments=("t", "y", "c"))
        return Verdict(kernel, tuple(attempts), tuple(held))

    def _forces(self, response: Response, attempt: Attempt | None, mode: Mode) -> list[Node]:
        """Return the friction forces, one for each contact that has one, that the laws give; see `facts.solve`."""
        graph, size = self.graph, len(self.sticky)
        rows: list[list[Node]] = []
        right: list[Node] = []
        active = []
        for place, i in enumerate(self.sticky):
            if mode[i] == STICK:
                rows.append(list(response.slip[place].terms[1:]))
                right.append(-response.slip[place].terms[0])
            elif mode[i] in (SLIP, SMOOTH) and attempt is not None:
                kappa = self._kappa(i, attempt)
                row = [kappa * value for value in response.normal[i].terms[1:]]
                row[place] = row[place] + 1
                rows.append(row)
                right.append(-kappa * response.normal[i].terms[0])
            else:
                continue
            active.append(place)
        forces = [graph.zero] * size
        if not active:
            return forces
        matrix = [[row[place] for place in active] for row in rows]
        determinant, found = determinant_and_solution(graph, matrix, right)
        if len(active) > 1:
            scale = graph.one
            for row in matrix:
                scale = scale * graph.sum(sized(self.graph, entry) for entry in row)
            self.regular.append(sized(self.graph, determinant) / scale)
        for place, force in zip(active, found, strict=True):
            forces[place] = force
        return forces

    # -- what the laws say -----------------------------------------------------------------

    def _kappa(self, i: int, attempt: Attempt) -> Node:
        mu = self.contacts[i].mu
        assert mu is not None
        return mu * self._side(i, attempt) * self._way(i, attempt)

    def _side(self, i: int, attempt: Attempt) -> Node:
        if side_name(self.contacts[i]) is None:
            return self.graph.const(attempt.sides[i])
        return self.graph.input(self.sides[i]) * attempt.sides[i]

    def _way(self, i: int, attempt: Attempt) -> Node:
        """Return the direction of slip, a sign, or what the smooth law has instead."""
        graph, contact = self.graph, self.contacts[i]
        if attempt.mode[i] == SMOOTH:
            assert contact.regularization is not None
            slip = self.own.slip_velocity(contact.slips[0])
            return slip / graph.call("sqrt", slip * slip + contact.regularization * contact.regularization)
        if attempt.ways[i]:
            return graph.const(attempt.ways[i])
        slip = self.own.slip_velocity(contact.slips[0])
        back = graph.call("select", graph.call("less", slip, graph.zero), graph.const(-1), graph.input(self.former[i]))
        return graph.call("select", graph.call("less", graph.zero, slip), graph.one, back)

    def _margin(self, attempt: Attempt) -> tuple[Node, list[Node]]:
        """Return by which share of the forces, at least, an attempt contradicts nothing, and its second rates."""
        graph, mode = self.graph, attempt.mode
        response = self.responses.response(
            "second rates", frozenset(i for i, state in enumerate(mode) if state == OPEN)
        )
        forces = self._forces(response, attempt, mode)
        motion = [entry.at(graph, forces) for entry in response.motion]
        normal = [entry.at(graph, forces) for entry in response.normal]
        force = graph.sum(sized(self.graph, value) for value in (*normal, *forces))
        speed = graph.zero
        for entry in motion:
            speed = graph.call("max", sized(self.graph, entry), speed)
        margin = graph.one
        for i, contact in enumerate(self.contacts):
            press = self._side(i, attempt) * normal[i]
            friction = forces[self.sticky.index(i)] if i in self.sticky else graph.zero
            conditions = []
            if mode[i] == OPEN:
                if not attempt.leaves[i]:
                    assert contact.constraint is not None
                    size = self._norm(self.equations.constraints[contact.constraint])
                    conditions.append(self._share(response.gap[i].at(graph, forces), speed * size))
            elif (contact.constraint is not None or side_name(contact) is not None) and not attempt.turned[i]:
                conditions.append(self._share(press, force))
            if mode[i] == STICK:
                assert contact.mu_static is not None
                conditions.append(self._share(contact.mu_static * press - sized(self.graph, friction), force))
            if mode[i] == SLIP and attempt.begins[i]:
                place = self.sticky.index(i)
                way = self._way(i, attempt)
                forward = response.slip[place].at(graph, forces) * way
                held = sized(self.graph, response.slip[place].terms[1 + place]) * sized(self.graph, friction)
                share = self._share(forward, speed * self._norm(contact.slips[0]) + held)
                if attempt.broken[i]:
                    grazes = graph.call("less_equal", graph.node(-self.grazing), share)
                    share = graph.call("select", grazes, graph.call("max", share, graph.zero), share)
                conditions.append(share)
            for condition in conditions:
                margin = graph.call("min", condition, margin)
        return margin, motion

    def _held(self, mode: Mode) -> list[Node]:
        """Return the rates nearest to the present ones, by kinetic energy, that a mode allows."""
        still = tuple(state if state in (OPEN, STICK) else CLOSED for state in mode)
        response = self.responses.response("rates", frozenset(i for i, state in enumerate(mode) if state == OPEN))
        forces = self._forces(response, None, still)
        return [entry.at(self.graph, forces) for entry in response.motion]

    def _share(self, value: Node, scale: Node) -> Node:
        graph = self.graph
        return value / graph.call("select", graph.call("less", graph.zero, scale), scale, graph.one)

    def _norm(self, row: ConstraintRow) -> Node:
        return self.graph.call("sqrt", self.graph.sum(entry * entry for entry in row.jacobian))
