"""[EquationsOfMotion] -> [Kernel]: what `runtime.hybrid.deciding` finds numerically, written out on the graph.

For contacts that stand in one way, the kernel has the margins of all that they may do. It divides by pivots where the
numerical way has pseudo-inverses, so it says how far it can be trusted, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

from ..errors import ConstraintError, SingularMassMatrixError
from ..ir.graph import Graph, Node
from ..ir.linear import Matrix, SingularMatrix, determinant_and_solution, factorize, matmul, matvec, transpose
from ..ir.lower import lower_kernel
from ..ir.program import Kernel
from ..mechanics.equations import ConstraintRow, ContactRow, EquationsOfMotion
from .modes import CLOSED, OPEN, SLIP, SMOOTH, STICK, Mode, side_name
from .reactions import independent_columns
from .saddle import SaddlePoint

__all__ = ["Attempt", "Verdict", "slip_kernel", "start_kernel", "verdict"]


@final
@dataclass(frozen=True)
class Attempt:
    """What contacts might do: a state each, the side relative to the given one, and the direction of slip.

    The direction is 0 where it is that of the slip velocity. `begins` holds, for each contact, whether slip begins
    in this attempt, and `broken` whether friction has just failed to hold it; `leaves` whether it is decided here
    that it opens.
    """

    mode: Mode
    sides: tuple[int, ...]
    ways: tuple[int, ...]
    begins: tuple[bool, ...]
    broken: tuple[bool, ...]
    leaves: tuple[bool, ...]


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
    own = _Own(equations)
    nothing = own.graph.zero
    slips = [own.slip_velocity(contact.slips[0]) if contact.slips else nothing for contact in own.equations.contacts]
    return lower_kernel(own.graph, "slips", slips, own.inputs([]), arguments=("t", "y", "c"))


def start_kernel(equations: EquationsOfMotion) -> Kernel:
    """Return a kernel of (t, (q, q_dot), p) with five numbers a contact, of those that slip along one direction.

    They are its slip velocity, the sum of the sizes of its terms, the coefficients of sliding and of static friction,
    and the restitution.
    """
    own = _Own(equations)
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
        return _Judge(_Own(equations), grazing).verdict(attempts, holding)
    except (ConstraintError, SingularMassMatrixError, SingularMatrix, _Undetermined):
        return None


def _singular(graph: Graph, matrix: Matrix) -> bool:
    try:
        factorize(graph, matrix)
    except SingularMatrix:
        return True
    return False


class _Undetermined(ValueError):
    """A normal reaction is not determined."""


@final
class _Own:
    """Equations on a graph of their own, so that kernels depend on the equations alone."""

    def __init__(self, equations: EquationsOfMotion) -> None:
        graph = self.graph = Graph()
        size = len(equations.q)

        def moved(row: ConstraintRow) -> ConstraintRow:
            *jacobian, drift, bias = graph.adopt([*row.jacobian, row.drift, row.bias])
            return replace(row, position=None, jacobian=tuple(jacobian), drift=drift, bias=bias)

        def one(node: Node | None) -> Node | None:
            return None if node is None else graph.adopt([node])[0]

        def contact(row: ContactRow) -> ContactRow:
            return replace(
                row,
                slips=tuple(moved(slip) for slip in row.slips),
                gap=one(row.gap),
                restitution=one(row.restitution),
                mu=one(row.mu),
                mu_static=one(row.mu_static),
                regularization=one(row.regularization),
            )

        flat = graph.adopt([entry for row in equations.mass_matrix for entry in row])
        reactions = [graph.adopt(list(row)) for row in equations.reactions]
        self.equations = replace(
            equations,
            graph=graph,
            q=tuple(graph.adopt(list(equations.q))),
            qdot=tuple(graph.adopt(list(equations.qdot))),
            mass_matrix=[flat[i * size : (i + 1) * size] for i in range(size)],
            forcing=tuple(graph.adopt(list(equations.forcing))),
            reactions=reactions,
            constraints=tuple(moved(row) for row in equations.constraints),
            contacts=tuple(contact(row) for row in equations.contacts),
        )

    def slip_velocity(self, row: ConstraintRow) -> Node:
        terms = (a * b for a, b in zip(row.jacobian, self.equations.qdot, strict=True))
        return self.graph.sum(terms) + row.drift

    def inputs(self, further: Sequence[str]) -> dict[Node, tuple[str, int | None]]:
        """Return the arguments of a kernel, with further ones behind the state."""
        graph, symbols = self.graph, self.equations.symbols
        inputs: dict[Node, tuple[str, int | None]] = {graph.input(symbols.time): ("t", None)}
        inputs |= {graph.input(name): ("c", i) for i, name in enumerate(symbols.parameters)}
        state = (*symbols.coordinates, *symbols.rates, *further)
        return inputs | {graph.input(name): ("y", i) for i, name in enumerate(state)}


@final
@dataclass(frozen=True)
class _Affine:
    """What is affine in the friction forces: without any, and for a unit of each."""

    terms: list[Node]

    def at(self, graph: Graph, forces: Sequence[Node]) -> Node:
        return graph.sum([self.terms[0], *(a * f for a, f in zip(self.terms[1:], forces, strict=True))])


@final
@dataclass(frozen=True)
class _Response:
    """Second rates or rates (n_q,), normal reactions and slips (n_contacts,), affine in the friction forces."""

    motion: list[_Affine]
    normal: list[_Affine]
    gap: list[_Affine]
    slip: list[_Affine]


@final
class _Judge:
    """The making of one verdict."""

    def __init__(self, own: _Own, grazing: float) -> None:
        self.own, self.equations, self.graph, self.grazing = own, own.equations, own.graph, grazing
        self.contacts = self.equations.contacts
        self.sticky = [i for i, contact in enumerate(self.contacts) if contact.tangential]
        self.former = [f"former direction {i}" for i in range(len(self.contacts))]
        self.sides = [f"former side {i}" for i in range(len(self.contacts))]
        self.regular: list[Node] = []
        self._summed = _singular(self.graph, self.equations.mass_matrix)
        self._pieces: dict[frozenset[int], tuple[SaddlePoint, EquationsOfMotion]] = {}
        self._responses: dict[tuple[str, frozenset[int]], _Response] = {}

    def verdict(self, attempts: Sequence[Attempt], holding: Sequence[bool]) -> Verdict:
        graph = self.graph
        margins, sums = [], []
        for attempt in attempts:
            margin, motion = self._margin(attempt)
            margins.append(margin)
            sums += [self._abs(entry) for entry in motion]
        held = [i for i, holds in enumerate(holding) if holds]
        rates = [entry for i in held for entry in self._held(attempts[i].mode)]
        regular = graph.one
        for value in self.regular:
            regular = graph.call("min", value, regular)
        inputs = self.own.inputs([*self.former, *self.sides])
        nodes = [regular, graph.sum([*sums, *(self._abs(rate) for rate in rates)]), *margins, *rates]
        kernel = lower_kernel(graph, "verdict", nodes, inputs, arguments=("t", "y", "c"))
        return Verdict(kernel, tuple(attempts), tuple(held))

    # -- the linear system -----------------------------------------------------------------

    def _saddle(self, opened: frozenset[int]) -> tuple[SaddlePoint, EquationsOfMotion]:
        """Return the factors with some contacts open, and the equations without friction."""
        if opened not in self._pieces:
            gone = {self.contacts[i].constraint for i in opened}
            rows = tuple(row for i, row in enumerate(self.equations.constraints) if i not in gone)
            lost = {j for contact in self.contacts for j in contact.tangential}
            lost |= {self.contacts[i].normal for i in opened}
            kept = [j for j in range(len(self.equations.symbols.unknowns)) if j not in lost]
            reactions = [[row[j] for j in kept] for row in self.equations.reactions]
            bare = replace(self.equations, constraints=rows, reactions=reactions)
            saddle = SaddlePoint.of(bare, guarded=False)
            n = range(len(bare.q))
            full = [[bare.mass_matrix[max(i, j)][min(i, j)] for j in n] for i in n]
            self._trust([full[i][i] for i in saddle.mass.order], saddle.mass.pivots)
            if rows:
                schur = saddle.schur(len(rows), bare.name)
                own = [saddle.mass.inner(half, half) for half in saddle.halves]
                self._trust([own[i] for i in schur.order], schur.pivots)
            self._pieces[opened] = saddle, bare
        return self._pieces[opened]

    def _trust(self, before: Sequence[Node], after: Sequence[Node]) -> None:
        """Take down the shares of diagonal entries that are left when they become pivots."""
        self.regular += [
            self._abs(b) / self._abs(a) for a, b in zip(before, after, strict=True) if a is not b and not a.is_zero
        ]

    def _response(self, level: str, opened: frozenset[int]) -> _Response:
        """Return what comes of the forcing, or of the momenta, and of a unit of each friction force."""
        if (level, opened) in self._responses:
            return self._responses[level, opened]
        graph, (saddle, bare) = self.graph, self._saddle(opened)
        if level == "rates":
            load = matvec(graph, [list(row) for row in bare.mass_matrix], bare.qdot)
            demand = [-row.drift for row in bare.constraints]
        else:
            load, demand = list(bare.forcing), [row.bias for row in bare.constraints]
        loads = [(load, demand)]
        nothing = [graph.zero] * len(demand)
        for i in self.sticky:
            loads.append(([row[self.contacts[i].tangential[0]] for row in self.equations.reactions], nothing))
        motions, normals = [], []
        for push, wanted in loads:
            regular = push
            if self._summed:  # M + J^T J takes the place of M
                weights = list(zip(bare.constraints, wanted, strict=True))
                regular = [p + graph.sum(r.jacobian[k] * w for r, w in weights) for k, p in enumerate(push)]
            motions.append(replace(saddle, forcing=tuple(regular)).accelerations(wanted, bare.name))
            if level != "rates":
                supplied = matvec(graph, [list(row) for row in bare.mass_matrix], motions[-1])
                normals.append(self._normals(bare, opened, [a - b for a, b in zip(supplied, push, strict=True)]))
        k = len(self.contacts)
        normal = [_Affine([column[i] for column in normals]) for i in range(k)] if normals else []
        gap = []
        for contact in self.contacts:
            terms = [graph.zero] * len(motions)
            if contact.constraint is not None:
                row = self.equations.constraints[contact.constraint]
                demanded = -row.drift if level == "rates" else row.bias
                terms = self._along(row, motions, demanded, contact.sense)
            gap.append(_Affine(terms))
        slips = []
        for i in self.sticky:
            row = self.contacts[i].slips[0]
            slips.append(_Affine(self._along(row, motions, -row.drift if level == "rates" else row.bias, 1)))
        motion = [_Affine([column[j] for column in motions]) for j in range(len(bare.q))]
        found = self._responses[level, opened] = _Response(motion, normal, gap, slips)
        return found

    def _along(self, row: ConstraintRow, motions: Sequence[Sequence[Node]], demanded: Node, sense: int) -> list[Node]:
        """Return by how much motions exceed what a row demands, the first of which alone has to."""
        terms = [self.graph.sum(a * b for a, b in zip(row.jacobian, motion, strict=True)) for motion in motions]
        terms[0] = terms[0] - demanded
        return [sense * term for term in terms]

    def _normals(self, bare: EquationsOfMotion, opened: frozenset[int], residual: Sequence[Node]) -> list[Node]:
        """Return the normal reactions of what is closed from what reactions have to supply, zero of what is open."""
        graph = self.graph
        lost = {j for contact in self.contacts for j in contact.tangential} | {self.contacts[i].normal for i in opened}
        kept = [j for j in range(len(self.equations.symbols.unknowns)) if j not in lost]
        independent, undetermined = independent_columns(graph, bare.reactions)
        found: list[Node] = []
        if independent:
            columns = transpose([[row[j] for j in independent] for row in bare.reactions])
            factors = factorize(graph, matmul(graph, columns, transpose(columns)))
            found = factors.solve(matvec(graph, columns, residual))
        normals = []
        for i, contact in enumerate(self.contacts):
            if i in opened:
                normals.append(graph.zero)
                continue
            place = kept.index(contact.normal)
            if place in undetermined:
                raise _Undetermined
            normals.append(found[independent.index(place)])
        return normals

    def _forces(self, response: _Response, attempt: Attempt | None, mode: Mode) -> list[Node]:
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
                scale = scale * graph.sum(self._abs(entry) for entry in row)
            self.regular.append(self._abs(determinant) / scale)
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
        response = self._response("second rates", frozenset(i for i, state in enumerate(mode) if state == OPEN))
        forces = self._forces(response, attempt, mode)
        motion = [entry.at(graph, forces) for entry in response.motion]
        normal = [entry.at(graph, forces) for entry in response.normal]
        force = graph.sum(self._abs(value) for value in (*normal, *forces))
        speed = graph.zero
        for entry in motion:
            speed = graph.call("max", self._abs(entry), speed)
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
            elif contact.constraint is not None or side_name(contact) is not None:
                conditions.append(self._share(press, force))
            if mode[i] == STICK:
                assert contact.mu_static is not None
                conditions.append(self._share(contact.mu_static * press - self._abs(friction), force))
            if mode[i] == SLIP and attempt.begins[i]:
                place = self.sticky.index(i)
                way = self._way(i, attempt)
                forward = response.slip[place].at(graph, forces) * way
                held = self._abs(response.slip[place].terms[1 + place]) * self._abs(friction)
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
        response = self._response("rates", frozenset(i for i, state in enumerate(mode) if state == OPEN))
        forces = self._forces(response, None, still)
        return [entry.at(self.graph, forces) for entry in response.motion]

    def _share(self, value: Node, scale: Node) -> Node:
        graph = self.graph
        return value / graph.call("select", graph.call("less", graph.zero, scale), scale, graph.one)

    def _norm(self, row: ConstraintRow) -> Node:
        return self.graph.call("sqrt", self.graph.sum(entry * entry for entry in row.jacobian))

    def _abs(self, value: Node) -> Node:
        return value if value.is_zero else self.graph.call("abs", value)
