"""What the laws of contact are asked of, on the graph: motions and reactions, affine in the friction forces.

The same as `runtime.hybrid.facts` finds numerically, but it divides by pivots, and says how far these can be trusted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

from ..ir.graph import Graph, Node
from ..mechanics.equations import ConstraintRow, ContactRow, EquationsOfMotion
from ..transforms.linear import Matrix, SingularMatrix, factorize, matmul, matvec, transpose
from .reactions import independent_columns
from .saddle import SaddlePoint

__all__ = ["Affine", "Own", "Response", "Responses", "Undetermined", "sized"]


def sized(graph: Graph, value: Node) -> Node:
    """Return the size of a number."""
    return value if value.is_zero else graph.call("abs", value)


def _singular(graph: Graph, matrix: Matrix) -> bool:
    try:
        factorize(graph, matrix)
    except SingularMatrix:
        return True
    return False


class Undetermined(ValueError):
    """A normal reaction is not determined."""


@final
class Own:
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
        """Return the slip velocity whose row this is."""
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
class Affine:
    """What is affine in the friction forces: without any, and for a unit of each."""

    terms: list[Node]

    def at(self, graph: Graph, forces: Sequence[Node]) -> Node:
        """Return the value for some friction forces."""
        return graph.sum([self.terms[0], *(a * f for a, f in zip(self.terms[1:], forces, strict=True))])


@final
@dataclass(frozen=True)
class Response:
    """Second rates or rates (n_q,), normal reactions and slips (n_contacts,), affine in the friction forces."""

    motion: list[Affine]
    normal: list[Affine]
    gap: list[Affine]
    slip: list[Affine]


@final
class Responses:
    """What forces do to a scene, for every set of contacts that are open.

    Attributes
    ----------
    regular : list of Node
        Shares of diagonal entries that are left when they become pivots: 1 at best, 0 where nothing can be solved.
    sticky : list of int
        Contacts with friction.
    """

    def __init__(self, equations: EquationsOfMotion) -> None:
        self.equations, self.graph, self.contacts = equations, equations.graph, equations.contacts
        self.sticky = [i for i, contact in enumerate(self.contacts) if contact.tangential]
        self.regular: list[Node] = []
        self._summed = _singular(self.graph, self.equations.mass_matrix)
        self._pieces: dict[frozenset[int], tuple[SaddlePoint, EquationsOfMotion]] = {}
        self._responses: dict[tuple[str, frozenset[int]], Response] = {}

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
            sized(self.graph, b) / sized(self.graph, a)
            for a, b in zip(before, after, strict=True)
            if a is not b and not a.is_zero
        ]

    def response(self, level: str, opened: frozenset[int]) -> Response:
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
        normal = [Affine([column[i] for column in normals]) for i in range(k)] if normals else []
        gap = []
        for contact in self.contacts:
            terms = [graph.zero] * len(motions)
            if contact.constraint is not None:
                row = self.equations.constraints[contact.constraint]
                demanded = -row.drift if level == "rates" else row.bias
                terms = self._along(row, motions, demanded, contact.sense)
            gap.append(Affine(terms))
        slips = []
        for i in self.sticky:
            row = self.contacts[i].slips[0]
            slips.append(Affine(self._along(row, motions, -row.drift if level == "rates" else row.bias, 1)))
        motion = [Affine([column[j] for column in motions]) for j in range(len(bare.q))]
        found = self._responses[level, opened] = Response(motion, normal, gap, slips)
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
                raise Undetermined
            normals.append(found[independent.index(place)])
        return normals
