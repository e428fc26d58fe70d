"""Formulation `minimal`: independent speeds u with q_dot = S u + s, which satisfy the constraints by construction.

Systems without degrees of freedom are those without speeds: q_dot is a function of q and time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import final

from ..errors import FormulationError, SingularMassMatrixError
from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node, UnitName
from ..mechanics.equations import ConstraintRow, EquationsOfMotion
from ..mechanics.tree_elimination import TreeFactorization
from ..transforms.derivatives import tangents
from ..transforms.forms import Forms
from ..transforms.linear import Factors, Matrix, SingularMatrix, factorize, matmul, matvec, transpose
from .base import (
    Formulation,
    ReducedSystem,
    ReductionSettings,
    factorize_inertia_of_tree,
    inertia_pivots,
    solve_inertia,
    tree_notes,
)
from .parametrization import NoRegularBasis, Parametrization, parametrizations
from .reactions import requested_outputs
from .unit_sphere import from_unit_sphere, normalisation, on_unit_sphere, unit_notes

# Removal of inputs on which values do not depend.


def drop_independent(graph: Graph, nodes: Sequence[Node], inputs: Sequence[Node], limit: int = 3000) -> list[Node]:
    """Return `nodes`, each freed of those `inputs` that it does not depend on in value.

    A node such as (m b sin(a)) sin(a) u + (m b cos(a)) cos(a) u becomes m b u. Nodes whose expressions
    together have more than `limit` operations are returned as they are. The components of a unit quaternion are
    independent of each other in no value, so that a node is freed of all four or of none.
    """
    if sum(1 for node in graph.topological(nodes) if node.args) > limit:
        return list(nodes)
    groups: dict[str, list[Node]] = {}
    for source in inputs:
        key = source.payload.quaternion if isinstance(source.payload, UnitName) else str(source.payload)
        groups.setdefault(key, []).append(source)
    for group in groups.values():
        graph.free(nodes, group)
    return list(nodes)


@final
@frozen
class _SpeedEquations:
    """Rates of the state: of the kept coordinates, of the speeds, q_ddot, and the factors of the inertia."""

    coordinate_rates: tuple[Node, ...]
    speed_rates: tuple[Node, ...]
    accelerations: tuple[Node, ...]
    factors: Factors | None = None

    @property
    def along_tree(self) -> TreeFactorization | None:
        """The factors, where they are those of a tree of bodies."""
        return self.factors if isinstance(self.factors, TreeFactorization) else None


def _kane(equations: EquationsOfMotion, p: Parametrization) -> _SpeedEquations:
    """Project the equations of motion on the free directions: S^T M S u_dot = S^T (forcing - M (S_dot u + s_dot))."""
    graph, size = equations.graph, len(equations.q)
    plain = p.coordinates == equations.q and p.rates == equations.qdot
    values: dict[Node, Node] = {}
    if not plain:
        values = {a: b for a, b in zip(equations.q, p.coordinates, strict=True) if a is not b}
        values |= {a: b for a, b in zip(equations.qdot, p.rates, strict=True) if a is not b}
    flow = {equations.q[i]: p.rates[i] for i in p.kept} | {equations.time: graph.one}
    rates = dict(zip((*equations.q, *equations.qdot), (*p.coordinates, *p.rates), strict=True))

    def bias_and_basis() -> tuple[list[Node], Matrix]:
        turning = dict(zip(equations.states, graph.substitute(equations.state_rates, rates), strict=True))
        bias = tangents(graph, p.rates, flow | turning)
        return bias, transpose([_slopes(graph, p.rates, speed) for speed in p.speeds]) if p.speeds else []

    along_tree = _along_tree(equations, p, values, bias_and_basis, plain=plain)
    if along_tree is not None:
        return along_tree
    flat = [entry for row in equations.mass_matrix for entry in row] + list(equations.forcing)
    if not plain:
        flat = graph.substitute(flat, values)
    mass = [flat[i * size : (i + 1) * size] for i in range(size)]
    forcing = flat[size * size :]
    bias, basis = bias_and_basis()
    if not p.speeds:
        accelerations = tuple(bias)
        speed_rates: list[Node] = []
        factors = None
    elif plain:
        speed_rates, factors = solve_inertia(equations, mass, forcing, p.names)
        accelerations = tuple(speed_rates)
    else:
        across = transpose(basis)
        load = [f - b for f, b in zip(forcing, matvec(graph, mass, bias), strict=True)]
        inertia = matmul(graph, across, matmul(graph, mass, basis))
        demand = matvec(graph, across, load)
        drop_independent(graph, [*(entry for row in inertia for entry in row), *demand], equations.q)
        speed_rates, factors = solve_inertia(equations, inertia, demand, p.names)
        drop_independent(graph, speed_rates, equations.q)
        moved = matvec(graph, basis, speed_rates)
        accelerations = tuple(a + b for a, b in zip(moved, bias, strict=True))
    return _SpeedEquations(tuple(p.rates[i] for i in p.kept), tuple(speed_rates), accelerations, factors)


def _slopes(graph: Graph, rates: Sequence[Node], speed: Node) -> list[Node]:
    """Return the derivatives of rates by a speed."""
    found = iter(tangents(graph, [rate for rate in rates if rate.deps & speed.deps], {speed: graph.one}))
    return [next(found) if rate.deps & speed.deps else graph.zero for rate in rates]


def _along_tree(
    equations: EquationsOfMotion,
    p: Parametrization,
    values: dict[Node, Node],
    bias_and_basis: Callable[[], tuple[list[Node], Matrix]],
    *,
    plain: bool,
) -> _SpeedEquations | None:
    """Return the rates by elimination along the tree of bodies, where that takes fewer operations; else None."""
    graph, tree = equations.graph, equations.tree
    if tree is None or not p.speeds:
        return None
    if plain:
        factors = factorize_inertia_of_tree(equations, tree, equations.forcing, p.names)
        if factors is None:
            return None
        found = factors.solve(equations.forcing)
        return _SpeedEquations(tuple(p.rates[i] for i in p.kept), tuple(found), tuple(found), factors)
    moved = tree.substituted(graph, values)
    bias, basis = bias_and_basis()
    given = graph.substitute(equations.forcing, values)
    load = [f - b for f, b in zip(given, moved.product(graph, bias), strict=True)]
    demand = _sparse_products(graph, transpose(basis), load)
    factors = factorize_inertia_of_tree(equations, moved.in_speeds(graph, basis), demand, p.names)
    if factors is None:
        return None
    found = factors.solve(demand)
    turned = _sparse_products(graph, basis, found)
    accelerations = tuple(a + b for a, b in zip(turned, bias, strict=True))
    return _SpeedEquations(tuple(p.rates[i] for i in p.kept), tuple(found), accelerations, factors)


def _sparse_products(graph: Graph, rows: Matrix, x: Sequence[Node]) -> list[Node]:
    return [graph.sum(a * b for a, b in zip(row, x, strict=True) if not a.is_zero) for row in rows]


@final
class Minimal(Formulation):
    """State: the coordinates that no holonomic constraint gives, and independent speeds."""

    name = "minimal"

    def reduce(
        self,
        equations: EquationsOfMotion,
        requested: Sequence[str],
        settings: ReductionSettings = ReductionSettings(),  # noqa: B008 - frozen
    ) -> ReducedSystem:
        """See `Formulation.reduce`."""
        scene, equations = equations, on_unit_sphere(equations)
        try:
            best = parametrizations(equations, lambda p: self._cost(equations, p))
        except NoRegularBasis as reason:
            raise FormulationError(
                f"scene {equations.name!r} cannot be put in the formulation 'minimal': {reason}."
                " Use formulation='projected', or 'auto', which takes it"
            ) from None
        motion = _kane(equations, best)
        values = {a: b for a, b in zip(scene.q, best.coordinates, strict=True) if a is not b}
        values |= {a: b for a, b in zip(scene.qdot, best.rates, strict=True) if a is not b}
        wanted = requested_outputs(scene, requested, values, motion.accelerations)
        kept = [equations.symbols.coordinates[i] for i in best.kept]
        return ReducedSystem(
            formulation=self.name,
            equations=scene,
            state=(*kept, *best.names),
            inputs=(*(equations.q[i] for i in best.kept), *best.speeds),
            rhs=(*motion.coordinate_rates, *motion.speed_rates),
            coordinates=best.coordinates,
            rates=best.rates,
            accelerations=motion.accelerations,
            initial=(*(scene.q[i] for i in best.kept), *from_unit_sphere(scene, equations, best.definitions)),
            projection=normalisation(scene, kept, len(best.names)),
            outputs=wanted.outputs,
            undetermined=wanted.undetermined,
            released=wanted.released,
            balanced=wanted.balanced,
            pivots=best.pivots,
            inertia=inertia_pivots(equations, motion.factors, best.names) if motion.factors else (),
            tree_factors=motion.along_tree if equations is scene else None,
            notes=(
                f"independent speeds: {', '.join(best.names) or 'none'}",
                *best.notes,
                *unit_notes(scene),
                *tree_notes(motion.factors),
            ),
        )

    def _cost(self, equations: EquationsOfMotion, p: Parametrization) -> float:
        try:
            motion = _kane(equations, p)
        except SingularMassMatrixError:
            if p.rates == equations.qdot:  # no choice of speeds makes an unconstrained singular matrix regular
                raise
            return float("inf")
        moving = ~equations.graph.mask(equations.symbols.parameters)
        return Forms(equations.graph, moving).work((*motion.coordinate_rates, *motion.speed_rates))


def prescribed(equations: EquationsOfMotion, requested: Sequence[str]) -> ReducedSystem | None:
    """Return the system with the state q of a scene whose constraints fix every rate; None where they do not.

    Coordinates at rest stay exactly where they are: no rounding of accelerations is integrated.
    """
    graph, size = equations.graph, len(equations.q)
    rows: list[ConstraintRow] = []
    for row in equations.constraints:
        trial = [list(r.jacobian) for r in (*rows, row)]
        try:
            factorize(graph, matmul(graph, trial, transpose(trial)))
        except SingularMatrix:
            continue
        rows.append(row)
        if len(rows) == size:
            break
    if len(rows) < size:
        return None
    matrix = [list(row.jacobian) for row in rows]
    across = transpose(matrix)
    normal = factorize(graph, matmul(graph, across, matrix))

    def solved(demand: Sequence[Node]) -> list[Node]:
        return normal.solve(matvec(graph, across, demand))

    rates = solved([-row.drift for row in rows])
    known = {a: b for a, b in zip(equations.qdot, rates, strict=True) if a is not b}
    accelerations = solved(graph.substitute([row.bias for row in rows], known))
    wanted = requested_outputs(equations, requested, known, accelerations)
    still = all(rate.is_zero for rate in rates)
    return ReducedSystem(
        formulation="prescribed",
        equations=equations,
        state=equations.symbols.coordinates,
        inputs=equations.q,
        rhs=tuple(rates),
        coordinates=equations.q,
        rates=tuple(rates),
        accelerations=tuple(accelerations),
        initial=equations.q,
        projection=None,
        outputs=wanted.outputs,
        undetermined=wanted.undetermined,
        released=wanted.released,
        balanced=wanted.balanced,
        notes=("all contacts stick: nothing moves" if still else "all contacts stick: the constraints fix every rate",),
    )
