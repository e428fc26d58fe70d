"""Formulations in q and q_dot with index-1 accelerations: `projected` and `augmented`.

Both solve the saddle-point system M q_ddot - J^T lam = forcing, J q_ddot = bias, by the sparse
L D L^T of M and of J M^-1 J^T. Where M alone is singular, M + J^T J takes its place; the
solution is the same, and the sum is regular exactly when the dynamics on the free directions is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

from ..errors import ConstraintError
from ..ir.graph import Graph, Node
from ..ir.linear import Factorization, SingularMatrix, factorize
from ..mechanics.equations import ConstraintRow, EquationsOfMotion
from .base import Formulation, Projection, ReducedSystem, factorize_inertia
from .reactions import requested_outputs

__all__ = ["Augmented", "Projected"]


@final
@dataclass(frozen=True)
class _Saddle:
    """The factors of one saddle-point system."""

    graph: Graph
    mass: Factorization
    forcing: tuple[Node, ...]
    rows: tuple[ConstraintRow, ...]
    halves: tuple[list[Node], ...]

    def schur(self, count: int, scene: str) -> Factorization:
        """Return the factors of J M^-1 J^T for the first `count` constraints."""
        halves = self.halves[:count]
        matrix = [[self.mass.inner(halves[i], halves[j]) for j in range(i + 1)] for i in range(count)]
        full = [[matrix[max(i, j)][min(i, j)] for j in range(count)] for i in range(count)]
        try:
            return factorize(self.graph, full)
        except SingularMatrix as singular:
            label = self.rows[singular.index].label
            raise ConstraintError(
                f"scene {scene!r}: {label} depends on the other constraints, whatever the state: it follows from them"
                " or contradicts them. Remove it, or correct the one that it repeats"
            ) from None

    def combine(self, start: Sequence[Node], weights: Sequence[Node]) -> list[Node]:
        """Return M^-1 (start + J^T weights), `start` already half solved."""
        half = list(start)
        for weight, column in zip(weights, self.halves, strict=False):
            half = [value + weight * entry for value, entry in zip(half, column, strict=True)]
        return self.mass.finish(half)


def _saddle(equations: EquationsOfMotion) -> _Saddle:
    graph, rows = equations.graph, equations.constraints
    matrix, forcing = equations.mass_matrix, list(equations.forcing)
    names = equations.symbols.coordinates
    try:
        mass = factorize(graph, matrix)
    except SingularMatrix:
        size = range(len(names))
        matrix = [[matrix[i][j] + graph.sum(r.jacobian[i] * r.jacobian[j] for r in rows) for j in size] for i in size]
        forcing = [forcing[i] + graph.sum(r.jacobian[i] * r.bias for r in rows) for i in size]
        mass = factorize_inertia(graph, matrix, names, equations.name)
    halves = tuple(mass.half_solve(row.jacobian) for row in rows)
    return _Saddle(graph, mass, tuple(forcing), rows, halves)


def _accelerations(equations: EquationsOfMotion, saddle: _Saddle) -> list[Node]:
    free = saddle.mass.half_solve(saddle.forcing)
    if not saddle.rows:
        return saddle.mass.finish(free)
    schur = saddle.schur(len(saddle.rows), equations.name)
    demand = [row.bias - saddle.mass.inner(half, free) for row, half in zip(saddle.rows, saddle.halves, strict=True)]
    return saddle.combine(free, schur.solve(demand))


def _projection(equations: EquationsOfMotion, saddle: _Saddle) -> Projection | None:
    """Return the mass-orthogonal Newton corrections onto the position and velocity constraints."""
    graph, rows = equations.graph, saddle.rows
    if not rows:
        return None
    nothing = [graph.zero] * len(equations.q)
    velocity = [
        -(graph.sum(a * b for a, b in zip(row.jacobian, equations.qdot, strict=True)) + row.drift) for row in rows
    ]
    rates = saddle.combine(nothing, saddle.schur(len(rows), equations.name).solve(velocity))
    holonomic = [-row.position for row in rows if row.position is not None]
    moves = nothing
    if holonomic:
        moves = saddle.combine(nothing, saddle.schur(len(holonomic), equations.name).solve(holonomic))
    return Projection((*moves, *nothing), (*nothing, *rates))


def _reduce(
    name: str, equations: EquationsOfMotion, requested: Sequence[str], project: bool, note: str
) -> ReducedSystem:
    saddle = _saddle(equations)
    accelerations = tuple(_accelerations(equations, saddle))
    wanted = requested_outputs(equations, requested, {}, accelerations)
    state = (*equations.q, *equations.qdot)
    return ReducedSystem(
        formulation=name,
        equations=equations,
        state=(*equations.symbols.coordinates, *equations.symbols.rates),
        inputs=state,
        rhs=(*equations.qdot, *accelerations),
        coordinates=equations.q,
        rates=equations.qdot,
        accelerations=accelerations,
        initial=state,
        projection=_projection(equations, saddle) if project else None,
        outputs=wanted.outputs,
        undetermined=wanted.undetermined,
        notes=(note,),
    )


@final
class Projected(Formulation):
    """State q, q_dot; after each accepted step, mass-orthogonal projection onto positions and velocities."""

    name = "projected"

    def reduce(self, equations: EquationsOfMotion, requested: Sequence[str]) -> ReducedSystem:
        """See `Formulation.reduce`."""
        note = "q and q_dot, accelerations from the saddle-point system, projected onto the constraints at every step"
        return _reduce(self.name, equations, requested, True, note)


@final
class Augmented(Formulation):
    """State q, q_dot, nothing holds the constraints: the baseline whose drift the others are measured against."""

    name = "augmented"

    def reduce(self, equations: EquationsOfMotion, requested: Sequence[str]) -> ReducedSystem:
        """See `Formulation.reduce`."""
        note = "q and q_dot, accelerations from the saddle-point system, nothing done against drift"
        return _reduce(self.name, equations, requested, False, note)
