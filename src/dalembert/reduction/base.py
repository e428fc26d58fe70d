"""Interface of formulations: `ReducedSystem`, and the functions that formulations share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import final

from ..errors import SingularMassMatrixError
from ..frozen import frozen
from ..ir.conditions import CONDITION_TIME, Conditions
from ..ir.graph import Graph
from ..ir.kernel import Kernel
from ..ir.node import Node
from ..mechanics.equations import EquationsOfMotion, moved_to
from ..mechanics.inertia_tree import WORTH, InertiaTree
from ..mechanics.tree_elimination import TreeFactorization
from ..transforms.linear import Factorization, Factors, Matrix, SingularMatrix, factorize
from ..transforms.lower_kernels import lower_kernel
from ..transforms.rank_one import diagonal_less_dyad
from .dependent_rows import Redundancy


@final
@frozen
class ReductionSettings:
    """Options of a formulation.

    Attributes
    ----------
    regular : bool
        Whether the constraints are known to be independent at every configuration.
    redundancy : Redundancy or None
        Where constraints are enforced together that depend on each other at all configurations.
    """

    regular: bool = False
    redundancy: Redundancy | None = None


@final
@frozen
class Projection:
    """Newton corrections onto the constraints: add them to the state. One node a component of the state."""

    position: tuple[Node, ...]
    velocity: tuple[Node, ...]

    def kernels(self) -> dict[str, tuple[Node, ...]]:
        """Return the corrections that do anything, by the names of their kernels."""
        named = {"project_position": self.position, "project_velocity": self.velocity}
        return {name: nodes for name, nodes in named.items() if not all(node.is_zero for node in nodes)}


@final
@frozen
class StageSystem:
    """Index-2 system E Y' = rhs(t, Y) of the same motion, for implicit methods.

    Attributes
    ----------
    inputs : tuple of Node
        Y: the components of the state, which have rates, then multipliers, which have none.
    rhs : tuple of Node
        Rates, then what constraints leave.
    multipliers : tuple of Node
        Multipliers in terms of t and the state, to start from.
    """

    inputs: tuple[Node, ...]
    rhs: tuple[Node, ...]
    multipliers: tuple[Node, ...]


@final
@frozen
class ReducedSystem:
    """A system of ordinary differential equations, y' = rhs(t, y), and the maps from y to the quantities of the scene.

    Attributes
    ----------
    formulation : str
        Name of the formulation.
    equations : EquationsOfMotion
        Equations that were reduced.
    state : tuple of str
        Names of the components of y.
    inputs, rhs : tuple of Node
        The components of y and their rates.
    coordinates, rates, accelerations : tuple of Node, length n_q
        q, q_dot and q_ddot in terms of t and y.
    initial : tuple of Node
        y in terms of t, q and q_dot.
    projection : Projection or None
        Corrections after each step, where the formulation needs them.
    outputs : mapping of str to Node
        Requested outputs in terms of t and y.
    undetermined : tuple of str
        Reaction components that the equations do not determine.
    notes : tuple of str
        Choices and their reasons, for `explain()`.
    start_projection : Projection or None
        Corrections of the initial state alone, where steps are held otherwise.
    stages : StageSystem or None
        System that implicit methods integrate instead; explicit methods cannot.
    defaults : mapping of str to float
        Parameters that the formulation adds and that may be left out.
    regular : bool
        Whether the constraints are known to be independent at every configuration.
    left_out : tuple of int
        Numbers of constraints that follow from the others and are not enforced.
    unproven : tuple of int
        Those of them that need not follow everywhere: they do around the start of a run, or by weights that vary.
    redundancy : Redundancy or None
        Where constraints are enforced together of which some follow from others.
    pivots : tuple of (str, Node)
        Label of a constraint, and the function of the parameters that the formulation divides it by.
    inertia : tuple of (str, Node)
        Name of a coordinate or speed, and the pivot of the mass matrix for it, where that is a function of the
        parameters that could vanish.
    released : str
        Reactions that come from balances of bodies, and the bodies that were moved for them; else empty.
    balanced : tuple of str
        Names of reactions that come from balances of bodies or share loads by compliances.
    tree_factors : TreeFactorization or None
        Of the inertia of the speeds, where it is eliminated along the tree of bodies.
    """

    formulation: str
    equations: EquationsOfMotion
    state: tuple[str, ...]
    inputs: tuple[Node, ...]
    rhs: tuple[Node, ...]
    coordinates: tuple[Node, ...]
    rates: tuple[Node, ...]
    accelerations: tuple[Node, ...]
    initial: tuple[Node, ...]
    projection: Projection | None
    outputs: Mapping[str, Node]
    undetermined: tuple[str, ...]
    notes: tuple[str, ...]
    start_projection: Projection | None = None
    stages: StageSystem | None = None
    defaults: Mapping[str, float] = field(default_factory=dict)
    regular: bool = True
    left_out: tuple[int, ...] = ()
    unproven: tuple[int, ...] = ()
    redundancy: Redundancy | None = None
    pivots: tuple[tuple[str, Node], ...] = ()
    inertia: tuple[tuple[str, Node], ...] = ()
    released: str = ""
    balanced: tuple[str, ...] = ()
    tree_factors: TreeFactorization | None = None

    @property
    def state_rates(self) -> tuple[Node, ...]:
        """Rates of the first-order states, which are the last components of y, in terms of t and y."""
        return self.rhs[len(self.rhs) - len(self.equations.states) :]

    @property
    def places(self) -> dict[Node, int]:
        """Index in y of each input; a projection may also name the coordinates in it as the equations do."""
        coordinates = zip(self.equations.symbols.coordinates, self.equations.q, strict=True)
        named = {node: self.state.index(name) for name, node in coordinates if name in self.state}
        return named | {node: i for i, node in enumerate(self.inputs)}


class Formulation(ABC):
    """A formulation of the constraints. A new one takes one file and one line in `dalembert.reduction`."""

    name: str

    @abstractmethod
    def reduce(
        self,
        equations: EquationsOfMotion,
        requested: Sequence[str],
        settings: ReductionSettings = ReductionSettings(),  # noqa: B008 - frozen
    ) -> ReducedSystem:
        """Return the reduced system with the `requested` outputs.

        Raises
        ------
        FormulationError
            When the formulation does not support the scene, with the reason.
        """


def factorize_inertia(graph: Graph, matrix: Matrix, names: Sequence[str], scene: str) -> Factorization:
    """Return the factors of a mass matrix; a pivot that is identically zero is an error naming its coordinate."""
    try:
        return factorize(graph, matrix)
    except SingularMatrix as singular:
        raise _singular(singular, names, scene) from None


def _singular(singular: SingularMatrix, names: Sequence[str], scene: str) -> SingularMassMatrixError:
    return SingularMassMatrixError(
        f"scene {scene!r}: the mass matrix is singular at every state: {names[singular.index]!r} moves no"
        " inertia of its own in a direction that the constraints leave free. Give the bodies it moves mass or"
        " inertia, drop the coordinate, or add the constraint that fixes it"
    )


def factorize_tree(graph: Graph, tree: InertiaTree | None, demand: Sequence[Node]) -> TreeFactorization | None:
    """Return the factors of the mass matrix of a tree; None where the unrolled elimination has fewer operations.

    Those of the solution for a demand are counted; those of the mass matrix on a copy of the graph, where they decide.

    Raises
    ------
    SingularMatrix
        When a pivot is identically zero.
    """
    if tree is None or tree.dense_operations(WORTH) <= WORTH:
        return None
    factors, given = TreeFactorization(graph, tree), [*tree.nodes, *demand]
    count = _added(graph, given, factors.solve(demand))
    unrolled = tree.dense_operations(count, entry=0)
    if unrolled <= count:
        trial = graph.copy()
        bodies = moved_to(tree, graph, trial)
        entries = [entry for row in bodies.mass_matrix(trial) for entry in row]
        unrolled += _added(trial, bodies.nodes, entries)
    return factors if unrolled > count else None


def _added(graph: Graph, given: Sequence[Node], made: Sequence[Node]) -> int:
    """Return how many operations values take beyond those of given values."""
    return sum(1 for _ in graph.topological([*given, *made])) - sum(1 for _ in graph.topological(given))


def factorize_inertia_of_tree(
    equations: EquationsOfMotion, tree: InertiaTree | None, demand: Sequence[Node], names: Sequence[str]
) -> TreeFactorization | None:
    """Return what `factorize_tree` does; a pivot that is identically zero is an error naming its coordinate."""
    try:
        return factorize_tree(equations.graph, tree, demand)
    except SingularMatrix as singular:
        raise _singular(singular, names, equations.name) from None


def inertia_pivots(
    equations: EquationsOfMotion, factors: Factors, names: Sequence[str]
) -> tuple[tuple[str, Node], ...]:
    """Return the pivots of a mass matrix that are differences of functions of the parameters, with their names."""
    moving = ~equations.graph.mask(equations.symbols.parameters)
    rows = zip(factors.order, factors.reduced, factors.pivots, strict=True)
    return tuple((names[i], pivot) for i, reduced, pivot in rows if reduced and pivot.deps and not pivot.deps & moving)


def tree_notes(factors: Factors | None) -> list[str]:
    """Return a note on the elimination along a tree, for `explain()`; none for an unrolled one."""
    if not isinstance(factors, TreeFactorization):
        return []
    bodies = sum(step.inertia is not None for step in factors.tree.steps)
    return [f"the mass matrix is eliminated along the tree of {bodies} bodies: operations grow linearly with them"]


def solve_inertia(
    equations: EquationsOfMotion, matrix: Matrix, demand: Sequence[Node], names: Sequence[str]
) -> tuple[list[Node], Factors | None]:
    """Return matrix^-1 demand, by the structure of the matrix where that saves work, else with its factors."""
    graph = equations.graph
    moving = ~graph.mask(equations.symbols.parameters)
    parts = diagonal_less_dyad(graph, matrix, moving)
    if parts is not None and parts.regular:
        return parts.solve(demand), None
    factors = factorize_inertia(graph, matrix, names, equations.name)
    return factors.solve(demand), factors


# Conditions on time and parameters as kernels.


def condition_kernels(equations: EquationsOfMotion) -> Conditions | None:
    """Return the conditions of equations as kernels, None where there are none."""
    if not equations.conditions:
        return None
    graph, parameters = equations.graph, equations.symbols.parameters
    inputs: dict[Node, tuple[str, int | None]] = {equations.time: ("t", None)}
    inputs |= {graph.input(name): ("p", i) for i, name in enumerate(parameters)}
    functions = [condition.function for condition in equations.conditions]
    within = graph.input(CONDITION_TIME).deps

    def lowered(node: Node) -> Kernel:
        return lower_kernel(graph, "condition", [node], inputs, arguments=("t", "p"))

    return Conditions(
        place=parameters.index(CONDITION_TIME) if CONDITION_TIME in parameters else None,
        functions=tuple(map(lowered, functions)),
        kinds=tuple(condition.kind for condition in equations.conditions),
        nested=tuple(bool(node.deps & within) for node in functions),
        sharpness=tuple(None if c.sharpness is None else lowered(c.sharpness) for c in equations.conditions),
    )
