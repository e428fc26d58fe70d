"""Projection onto the initial values of first integrals, combined with the projection onto the constraints.

A step's error in first integrals I(q, q_dot) is removed along their gradients, in the metric of the kinetic energy:
with d the virtual displacement and w the change of the speeds, both in directions that the constraints leave free, the
correction has the least d.M.d / tau^2 + w.M.w among those that restore I to first order. It is made together with that
onto the constraints, so that neither undoes the other, and repeated as that is (Newton's iteration; E. Hairer, C.
Lubich, G. Wanner, Geometric Numerical Integration, section IV.4). tau [s] makes displacements and speeds comparable.

The small system of the gradients' inner products is damped by a share of its diagonal. Where gradients are nearly
parallel, as in steady precession, rounding would be enlarged without bound otherwise; elsewhere a share of `DAMPING` of
the correction is left to the next. The energy's is damped by what is to be removed too: at an equilibrium its gradient
vanishes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import final

from ..errors import FormulationError
from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..mechanics.equations import EquationsOfMotion
from ..transforms.derivatives import tangents
from ..transforms.linear import Factors, factorize
from .base import Projection, ReducedSystem
from .integrals import ENERGY, JACOBI, integrals
from .saddle import SaddlePoint, velocity_residuals

DAMPING = 1e-6
"""Share of the squared gradient of a first integral by which it is damped."""

TIME_SCALE = "time scale of kept integrals"
"""The parameter tau [s]."""

_LEAST = 1e-300


def initial_name(integral: str) -> str:
    """Return the name of the parameter that holds the initial value of a first integral."""
    return f"initial {integral}"


def refuse_formulation(system: ReducedSystem) -> None:
    """Reject a system whose steps are not projected.

    Raises
    ------
    FormulationError
        Naming the formulation.
    """
    equations = system.equations
    free = [row for i, row in enumerate(equations.constraints) if i not in system.left_out]
    if free and system.formulation not in ("minimal", "projected"):
        raise FormulationError(
            f"scene {equations.name!r}: project_invariants needs steps that end on the constraints, which those of"
            f' {system.formulation!r} do not by a projection of their own. Use formulation="minimal" or'
            ' "projected"'
        )


def project_invariants(system: ReducedSystem, names: Sequence[str]) -> ReducedSystem:
    """Return a system whose steps are projected onto values of first integrals, which are added parameters.

    Parameters
    ----------
    system : ReducedSystem
        In a formulation that projects its steps or needs no projection.
    names : sequence of str
        Of `dalembert.reduction.integrals.integrals`.

    Raises
    ------
    FormulationError
        For a formulation that does not project its steps onto the constraints.
    """
    refuse_formulation(system)
    equations = system.equations
    nodes = integrals(equations)
    space = _Space.of(system)
    correction = space.correction([nodes[name].value for name in names], names)
    added = (*map(initial_name, names), TIME_SCALE)
    symbols = equations.symbols
    nothing = (equations.graph.zero,) * len(system.inputs)
    plain = system.projection or Projection(nothing, nothing)
    return replace(
        system,
        equations=replace(equations, symbols=replace(symbols, parameters=(*symbols.parameters, *added))),
        projection=Projection(plain.position, tuple(correction)),
        start_projection=plain,
        notes=(*system.notes, f"kept at their initial values after every step: {', '.join(names)}"),
    )


@final
@frozen
class _Space:
    """Coordinates and speeds of a state, and the displacements and changes that the constraints leave free.

    Attributes
    ----------
    coordinates, speeds : tuple of Node
        Inputs of the state.
    columns : tuple of tuple of Node
        Change of the coordinates by a displacement along each of the speeds.
    values : dict of Node to Node
        Coordinates and rates of the scene that are not inputs of the state.
    mass : Factors
        The metric.
    saddle : SaddlePoint or None
        Where constraints are among the rows.
    """

    graph: Graph
    equations: EquationsOfMotion
    coordinates: tuple[Node, ...]
    speeds: tuple[Node, ...]
    columns: tuple[tuple[Node, ...], ...]
    values: dict[Node, Node]
    mass: Factors
    saddle: SaddlePoint | None

    @staticmethod
    def of(system: ReducedSystem) -> _Space:
        equations, graph = system.equations, system.equations.graph
        kept = sum(name in equations.symbols.coordinates for name in system.state)
        whole = len(system.inputs) - len(equations.states)
        coordinates, speeds = system.inputs[:kept], system.inputs[kept:whole]
        values = {a: b for a, b in zip(equations.q, system.coordinates, strict=True) if a is not b}
        values |= {a: b for a, b in zip(equations.qdot, system.rates, strict=True) if a is not b}
        columns = tuple(tuple(tangents(graph, system.rhs[:kept], {u: graph.one})) for u in speeds)
        rows = tuple(row for i, row in enumerate(equations.constraints) if i not in system.left_out)
        if rows and system.formulation != "minimal":
            saddle = SaddlePoint.of(replace(equations, constraints=rows), guarded=not system.regular)
            return _Space(graph, equations, coordinates, speeds, columns, values, saddle.mass, saddle)
        if system.tree_factors is not None:
            return _Space(graph, equations, coordinates, speeds, columns, values, system.tree_factors, None)
        kinetic = graph.substitute([equations.kinetic_energy], values) if values else [equations.kinetic_energy]
        momenta = [tangents(graph, kinetic, {u: graph.one})[0] for u in speeds]
        matrix = [tangents(graph, momenta, {u: graph.one}) for u in speeds]
        return _Space(graph, equations, coordinates, speeds, columns, values, factorize(graph, matrix), None)

    def _moved(self, displacement: Sequence[Node]) -> dict[Node, Node]:
        """Return the change of each coordinate by a displacement."""
        pairs = [(d, column) for d, column in zip(displacement, self.columns, strict=True) if not d.is_zero]
        change = [self.graph.sum(column[i] * d for d, column in pairs) for i in range(len(self.coordinates))]
        return {q: value for q, value in zip(self.coordinates, change, strict=True) if not value.is_zero}

    def _onto_free(self, half: list[Node]) -> list[Node]:
        """Return a half solution M x = a less its part along the constraints."""
        if self.saddle is None:
            return half
        saddle = self.saddle
        along = [self.mass.inner(row, half) for row in saddle.halves]
        weights = saddle.schur(len(saddle.rows), self.equations.name).solve(along)
        for weight, column in zip(weights, saddle.halves, strict=True):
            half = [value - weight * entry for value, entry in zip(half, column, strict=True)]
        return half

    def _shift(self, displaced: dict[Node, Node]) -> list[Node]:
        """Return the change of the speeds that brings them onto the constraints once coordinates are displaced."""
        graph, saddle = self.graph, self.saddle
        if saddle is None:
            return [graph.zero] * len(self.speeds)
        rows = replace(self.equations, constraints=saddle.rows)
        residuals = velocity_residuals(rows)
        moved = tangents(graph, residuals, displaced) if displaced else [graph.zero] * len(residuals)
        wanted = [-(a + b) for a, b in zip(residuals, moved, strict=True)]
        solved = saddle.schur(len(saddle.rows), self.equations.name).solve(wanted)
        return saddle.combine([graph.zero] * len(self.speeds), solved)

    def _constraint_displacement(self) -> dict[Node, Node]:
        """Return the change of the coordinates onto the holonomic constraints."""
        saddle = self.saddle
        if saddle is None:
            return {}
        left = [-row.position for row in saddle.rows if row.position is not None]
        if not left:
            return {}
        solved = saddle.schur(len(left), self.equations.name).solve(left)
        return self._moved(saddle.combine([self.graph.zero] * len(self.speeds), solved))

    def _slopes(self, node: Node) -> tuple[list[Node], list[Node]]:
        """Return the half solutions of a function's gradient along displacements and along speeds, in free directions.

        A displacement takes the speeds along, onto the constraints where they are displaced to.
        """
        graph, saddle = self.graph, self.saddle
        along = [tangents(graph, [node], {u: graph.one})[0] for u in self.speeds]
        speeds = self.mass.half_solve(along)
        lifted = [graph.zero] * len(self.columns)
        if saddle is not None:
            pull = [self.mass.inner(row, speeds) for row in saddle.halves]
            weights = saddle.schur(len(saddle.rows), self.equations.name).solve(pull)
            residuals = velocity_residuals(replace(self.equations, constraints=saddle.rows))
        for i, column in enumerate(self.columns):
            seeds = {q: c for q, c in zip(self.coordinates, column, strict=True) if not c.is_zero}
            if not seeds:
                continue
            lifted[i] = tangents(graph, [node], seeds)[0]
            if saddle is not None:
                turned = tangents(graph, residuals, seeds)
                lifted[i] = lifted[i] - graph.sum(w * r for w, r in zip(weights, turned, strict=True))
        return self._onto_free(self.mass.half_solve(lifted)), self._onto_free(speeds)

    def correction(self, nodes: Sequence[Node], names: Sequence[str]) -> list[Node]:
        """Return the correction of the state for functions of coordinates and rates, the named integrals."""
        graph = self.graph
        nodes = graph.substitute(nodes, self.values) if self.values else list(nodes)
        slopes = [self._slopes(node) for node in nodes]
        tau = graph.input(TIME_SCALE)
        onto = self._constraint_displacement()
        shift = self._shift(onto)
        before = onto | {u: d for u, d in zip(self.speeds, shift, strict=True) if not d.is_zero}
        gained = tangents(graph, nodes, before) if before else [graph.zero] * len(nodes)
        left = [
            graph.input(initial_name(name)) - node - gain for name, node, gain in zip(names, nodes, gained, strict=True)
        ]
        size = range(len(nodes))
        matrix = [
            [
                tau * tau * self.mass.inner(slopes[i][0], slopes[j][0]) + self.mass.inner(slopes[i][1], slopes[j][1])
                for j in size
            ]
            for i in size
        ]
        for i, name in enumerate(names):
            damped = matrix[i][i] + graph.node(DAMPING) * matrix[i][i] + graph.node(_LEAST)
            matrix[i][i] = damped + graph.call("abs", left[i]) if name in (ENERGY, JACOBI) else damped
        weights = factorize(graph, matrix).solve(left)
        half = [graph.sum(w * s[0][k] for w, s in zip(weights, slopes, strict=True)) for k in range(len(self.speeds))]
        displacement = [tau * tau * value for value in self.mass.finish(half)]
        moved = self._moved(displacement)
        total = {q: onto.get(q, graph.zero) + moved.get(q, graph.zero) for q in self.coordinates}
        half = [graph.sum(w * s[1][k] for w, s in zip(weights, slopes, strict=True)) for k in range(len(self.speeds))]
        changed = self.mass.finish(half)
        shift = self._shift({q: value for q, value in total.items() if not value.is_zero})
        speeds = (a + b for a, b in zip(shift, changed, strict=True))
        return [*total.values(), *speeds, *([graph.zero] * len(self.equations.states))]
