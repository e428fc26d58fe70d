"""Saddle-point system of formulations in q and q_dot; formulations `projected` and `augmented`.

M q_ddot - J^T lam = forcing, J q_ddot = bias is solved by the sparse L D L^T of M and of J M^-1 J^T. Where M alone is
singular, M + J^T J takes its place; the solution is the same, and the sum is regular exactly when the dynamics on the
free directions is. Where the constraints may depend on each other at some configurations, the pivots of J M^-1 J^T are
guarded: a constraint that follows from those before it gets the multiplier 0 there, and the others hold it. So does
one whose own row vanishes (`dalembert.reduction.dependent_rows.row_scale`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import final

from ..errors import ConstraintError
from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..mechanics.equations import ConstraintRow, EquationsOfMotion
from ..transforms.linear import (
    SET_ASIDE,
    Factorization,
    Factors,
    Matrix,
    SingularMatrix,
    factorize,
    guarded_pivot,
    product,
)
from .base import (
    Formulation,
    Projection,
    ReducedSystem,
    ReductionSettings,
    factorize_inertia,
    factorize_tree,
    inertia_pivots,
    tree_notes,
)
from .dependent_rows import Redundancy, row_scale
from .grouped_rows import Solver, solver_of, turning_demand
from .reactions import requested_outputs


@final
@frozen
class SaddlePoint:
    """The factors of the saddle-point system of a scene.

    Attributes
    ----------
    mass : Factors
        Of M, or of M + J^T J.
    forcing : tuple of Node, length n_q
    rows : tuple of ConstraintRow
    halves : tuple of list of Node
        Half solutions of M x = J^T, one a constraint.
    guarded : bool
        Whether constraints may depend on each other at some configurations.
    scales : tuple of Node
        Where guarded, the sizes beside which diagonal entries of J M^-1 J^T count as zero; zero for rows that do not
        vanish.
    redundancy : Redundancy or None
        Where constraints are enforced together that depend on each other at all configurations.
    """

    graph: Graph
    mass: Factors
    forcing: tuple[Node, ...]
    rows: tuple[ConstraintRow, ...]
    halves: tuple[list[Node], ...]
    guarded: bool
    scales: tuple[Node, ...]
    redundancy: Redundancy | None = None

    @staticmethod
    def of(equations: EquationsOfMotion, *, guarded: bool, redundancy: Redundancy | None = None) -> SaddlePoint:
        """Return the factors of the equations.

        Raises
        ------
        SingularMassMatrixError
            When a coordinate moves no inertia in a direction that the constraints leave free.
        """
        graph, rows = equations.graph, equations.constraints
        forcing, names = list(equations.forcing), equations.symbols.coordinates
        try:
            mass: Factors = factorize_tree(graph, equations.tree, forcing) or factorize(graph, equations.mass_matrix)
            inertias = equations.diagonal
        except SingularMatrix:
            n, matrix = range(len(names)), equations.mass_matrix
            matrix = [[matrix[i][j] + graph.sum(r.jacobian[i] * r.jacobian[j] for r in rows) for j in n] for i in n]
            forcing = [forcing[i] + graph.sum(r.jacobian[i] * r.bias for r in rows) for i in n]
            mass = factorize_inertia(graph, matrix, names, equations.name)
            inertias = [matrix[i][i] for i in n]
        halves = tuple(mass.half_solve(row.jacobian) for row in rows)
        # rows that vanish belong to folds of mechanisms; where contacts close and open, they decide no branch
        folding = guarded and not equations.guards
        scales = tuple(row_scale(graph, row.jacobian, inertias) if folding else graph.zero for row in rows)
        return SaddlePoint(graph, mass, tuple(forcing), rows, halves, guarded, scales, redundancy)

    def schur(self, count: int, scene: str) -> Factorization | Solver:
        """Return the factors of J M^-1 J^T for the first `count` constraints.

        Raises
        ------
        ConstraintError
            When a constraint depends on the others whatever the state.
        """
        full = self._inner_products(count)
        if self.redundancy is not None:
            return solver_of(self.graph, full, self.redundancy)
        try:
            undecided = any(row.undecided for row in self.rows[:count])
            return factorize(self.graph, full, self._guard if self.guarded else None, set_aside=undecided)
        except SingularMatrix as singular:
            label = self.rows[singular.index].label
            raise ConstraintError(
                f"scene {scene!r}: {label} depends on the other constraints at every state, within double"
                " precision: it follows from them or contradicts them. Remove it, correct the one that it repeats, or"
                " use formulation='minimal', which resolves smaller differences"
            ) from None

    def _inner_products(self, count: int) -> Matrix:
        matrix = self._products
        return [[matrix[max(i, j)][min(i, j)] for j in range(count)] for i in range(count)]

    @cached_property
    def _products(self) -> Matrix:
        """The lower triangle of J M^-1 J^T."""
        return self.mass.inner_products(self.halves)

    def set_aside(self) -> Node:
        """Return the number of constraints that guarded pivots set aside."""
        graph, found = self.graph, []

        def guard(pivot: Node, diagonal: Node, row: int) -> Node:
            guarded = self._guard(pivot, diagonal, row)
            if guarded is not pivot:
                found.append(graph.call("less_equal", graph.node(SET_ASIDE), guarded))
            return guarded

        pivots = factorize(graph, self._inner_products(len(self.rows)), guard, set_aside=True).pivots
        always = sum(pivot.number == SET_ASIDE for pivot in pivots)
        return graph.sum(found) + graph.node(float(always))

    def _guard(self, pivot: Node, diagonal: Node, row: int) -> Node:
        terms = self.scales[row] if pivot is diagonal else diagonal + self.scales[row]
        return pivot if terms.is_zero else guarded_pivot(pivot, terms)

    def combine(self, start: Sequence[Node], weights: Sequence[Node]) -> list[Node]:
        """Return M^-1 (start + J^T weights), `start` already half solved."""
        half = list(start)
        for weight, column in zip(weights, self.halves, strict=False):
            for place, entry in enumerate(column):
                if not entry.is_zero:
                    half[place] = half[place] + weight * entry
        return self.mass.finish(half)

    def multipliers(self, demand: Sequence[Node], scene: str) -> list[Node]:
        """Return lam such that J q_ddot = demand."""
        if not self.rows:
            return []
        free = self.mass.half_solve(self.forcing)
        rest = [want - self.mass.inner(half, free) for want, half in zip(demand, self.halves, strict=True)]
        return self.schur(len(self.rows), scene).solve(rest)

    def accelerations(self, demand: Sequence[Node], scene: str) -> list[Node]:
        """Return q_ddot such that J q_ddot = demand."""
        return self.combine(self.mass.half_solve(self.forcing), self.multipliers(demand, scene))

    def demand(self, equations: EquationsOfMotion) -> list[Node]:
        """Return what is demanded of J q_ddot where steps are not projected."""
        demand = [row.bias for row in self.rows]
        if self.redundancy is None:
            return demand
        flow = dict(zip(equations.q, equations.qdot, strict=True)) | {equations.time: self.graph.one}
        solver = solver_of(self.graph, self._inner_products(len(self.rows)), self.redundancy)
        further = turning_demand(self.graph, self.rows, solver, flow | equations.state_flow)
        return [a + b for a, b in zip(demand, further, strict=True)]

    def projection(self, equations: EquationsOfMotion) -> Projection | None:
        """Return the mass-orthogonal Newton corrections onto the position and velocity constraints."""
        rows, nothing = self.rows, [self.graph.zero] * len(equations.q)
        if not rows:
            return None
        velocity = [-residual for residual in velocity_residuals(equations)]
        rates = self.combine(nothing, self.schur(len(rows), equations.name).solve(velocity))
        holonomic = [-row.position for row in rows if row.position is not None]
        moves = nothing
        if holonomic:
            moves = self.combine(nothing, self.schur(len(holonomic), equations.name).solve(holonomic))
        return Projection((*moves, *nothing), (*nothing, *rates))


def velocity_residuals(equations: EquationsOfMotion) -> list[Node]:
    """Return the velocity residual of each constraint."""
    graph, qdot = equations.graph, equations.qdot
    return [product(graph, row.jacobian, qdot) + row.drift for row in equations.constraints]


def reduce_saddle(
    name: str,
    equations: EquationsOfMotion,
    requested: Sequence[str],
    accelerations: Sequence[Node],
    notes: Sequence[str],
    projection: Projection | None = None,
    *,
    saddle: SaddlePoint,
) -> ReducedSystem:
    """Return the system with the state q, q_dot and the given accelerations."""
    plain = None
    if saddle.guarded and requested:
        unguarded = saddle if saddle.redundancy else SaddlePoint.of(equations, guarded=False)
        plain = unguarded.accelerations([row.bias for row in unguarded.rows], equations.name)
    wanted = requested_outputs(equations, requested, {}, accelerations, plain)
    state = (*equations.q, *equations.qdot)
    return ReducedSystem(
        formulation=name,
        equations=equations,
        state=(*equations.symbols.coordinates, *equations.symbols.rates),
        inputs=state,
        rhs=(*equations.qdot, *accelerations),
        coordinates=equations.q,
        rates=equations.qdot,
        accelerations=tuple(accelerations),
        initial=state,
        projection=projection,
        outputs=wanted.outputs,
        undetermined=wanted.undetermined,
        released=wanted.released,
        balanced=wanted.balanced,
        inertia=inertia_pivots(equations, saddle.mass, equations.symbols.coordinates),
        notes=(*notes, *tree_notes(saddle.mass)),
    )


@final
class Projected(Formulation):
    """State q, q_dot; after each accepted step, mass-orthogonal projection onto positions and velocities."""

    name = "projected"

    def reduce(
        self,
        equations: EquationsOfMotion,
        requested: Sequence[str],
        settings: ReductionSettings = ReductionSettings(),  # noqa: B008 - frozen
    ) -> ReducedSystem:
        """See `Formulation.reduce`."""
        note = "q and q_dot, accelerations from the saddle-point system, projected onto the constraints at every step"
        saddle = SaddlePoint.of(equations, guarded=not settings.regular, redundancy=settings.redundancy)
        found = saddle.accelerations([row.bias for row in saddle.rows], equations.name)
        return reduce_saddle(
            self.name, equations, requested, found, [note], saddle.projection(equations), saddle=saddle
        )


@final
class Augmented(Formulation):
    """State q, q_dot without stabilisation of the constraints: the reference for the drift of other formulations."""

    name = "augmented"

    def reduce(
        self,
        equations: EquationsOfMotion,
        requested: Sequence[str],
        settings: ReductionSettings = ReductionSettings(),  # noqa: B008 - frozen
    ) -> ReducedSystem:
        """See `Formulation.reduce`."""
        note = "q and q_dot, accelerations from the saddle-point system, without stabilisation"
        saddle = SaddlePoint.of(equations, guarded=not settings.regular, redundancy=settings.redundancy)
        found = saddle.accelerations(saddle.demand(equations), equations.name)
        return reduce_saddle(self.name, equations, requested, found, [note], saddle=saddle)
