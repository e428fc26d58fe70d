"""`EquationsOfMotion`: the equations from virtual power, before constraints are eliminated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, fields, is_dataclass, replace
from functools import cached_property
from typing import Any, final

from ..frozen import frozen
from ..ir.conditions import CONDITION_TIME
from ..ir.graph import Graph
from ..ir.node import Node
from ..scene.model import ControllerModel, SceneModel
from ..scene.symbol_table import SymbolTable
from ..transforms.conditions import Condition, decide
from ..transforms.linear import Matrix, matvec
from .inertia_tree import InertiaTree
from .load_energy import LoadEnergy
from .quasi_velocities import VelocityGroup


@final
@frozen
class ConstraintRow:
    """One constraint: jacobian . q_dot + drift = 0, and q_ddot form jacobian . q_ddot = bias.

    Attributes
    ----------
    label : str
        Text of the constraint as the user wrote it.
    position : Node or None
        The expression that vanishes in coordinates and time; None for a nonholonomic constraint.
    jacobian : tuple of Node, length n_q
    drift : Node
        The part of the velocity constraint without rates.
    bias : Node
        Minus the part of the acceleration constraint without second rates.
    undecided : bool
        Whether its row depends on others at every state, as far as the rounding of decimals shows, by weights that
        vary: runs decide whether it follows from them.
    opens : bool
        Whether it holds while a contact is closed, which is decided by the size of its gap beside all lengths.
    """

    label: str
    position: Node | None
    jacobian: tuple[Node, ...]
    drift: Node
    bias: Node
    undecided: bool = False
    opens: bool = False


@final
@frozen
class ContactRow:
    """Friction, a constraint that opens, or both.

    Attributes
    ----------
    name : str
    normal : int
        Number of the normal reaction among the unknowns.
    gap, constraint, restitution : Node, int, Node, or None
        The gap, the number of the constraint that holds while it is closed, and Newton's
        coefficient; None for friction on a constraint that never opens.
    sense : int
        1 where that constraint is the gap, -1 where it is minus the gap.
    tangential : tuple of int
        Numbers of the friction forces; none without friction.
    slips : tuple of ConstraintRow
        The slip velocities along them, as constraints that hold while it sticks.
    mu, mu_static, regularization : Node or None
        Coefficients of friction, and the slip speed of the smooth law.
    normal_load : Node or None
        What friction has for its normal reaction where that is given; the unknown has no power then.
    slip_speed : Node or None
        The input that `mu` has for the slip speed where it is a function of that.
    normal_value : Node or None
        The normal reaction with its sign, where a balance of bodies gives it.
    leader : int or None
        The number of the contact that opens, of which this is a further law of friction: it has that normal reaction.
    kinks : tuple of Node
        Values that change their signs where the gradient of the gap jumps.
    """

    name: str
    normal: int
    gap: Node | None
    constraint: int | None
    sense: int
    restitution: Node | None
    tangential: tuple[int, ...]
    slips: tuple[ConstraintRow, ...]
    mu: Node | None
    mu_static: Node | None
    regularization: Node | None
    normal_load: Node | None = None
    slip_speed: Node | None = None
    normal_value: Node | None = None
    leader: int | None = None
    kinks: tuple[Node, ...] = ()

    @property
    def opens(self) -> bool:
        """Whether it has no normal reaction while a gap is open."""
        return self.constraint is not None or self.leader is not None


@final
@frozen
class Guard:
    """An output whose fall through zero ends a mode.

    Attributes
    ----------
    output : str
        Its name.
    contact : int
        Number of the contact; -1 for all of them, and -2 for what is beyond the equations.
    kind : str
        "stop" (the slip velocity along its former direction vanishes), "break" (friction cannot hold, towards `sign`),
        "lift" (the normal reaction vanishes), "turn" (it changes its sign, at a constraint that never opens), "meet"
        (the gap closes), "share" (contacts that hold each other can no longer share a load), "paradox" (the normal
        reactions are no longer determined) or "kink" (the value changes its sign where the gradient of the gap jumps).
    sign : int
        Direction of the slip that begins where friction breaks along one direction.
    """

    output: str
    contact: int
    kind: str
    sign: int = 0


@final
@frozen
class EquationsOfMotion:
    """M(q, t) q_ddot = forcing(t, q, q_dot) + reactions . X + J^T lam, with constraints that vanish.

    Attributes
    ----------
    dense : Matrix, n_q by n_q, or None
        The mass matrix, as it was derived; None where `tree` stands for it.
    forcing : tuple of Node, length n_q
        Given actions and bias terms, no reactions.
    reactions : Matrix, n_q by n_unknown
        Power coefficients of the unknown reaction components, one column each.
    constraints : tuple of ConstraintRow
        Holonomic ones first.
    groups : tuple of VelocityGroup
        Quasi-velocities found in the frames of the scene.
    outputs : mapping of str to Node
        Requested expressions; they may contain reactions as inputs.
    contacts : tuple of ContactRow
        Laws of friction and constraints that open, which `dalembert.contacts.equations.modes` applies.
    defaults : mapping of str to float
        Parameters that were added to those of the scene, and may be left out.
    guards : tuple of Guard
        Guards of the mode of the contacts.
    minimum_norm : bool
        Whether reactions that are not determined are those of minimum norm; they are an error otherwise.
    cones : tuple of list of Node
        Rows of as many columns as `reactions`, four a law of a closed contact where reactions are not determined: the
        first is not less than the length of the next two, and the last, on which given friction depends, is kept.
    reaction_values : mapping of str to Node
        All reactions in terms of coordinates, rates and time, where these are given forces too; none otherwise.
    nonanalytic : bool
        Whether the equations have exponential functions of state or time or, in scenes with contacts, kinks or jumps:
        forces on what rests in a mode occur in no rates, so that no step ends there.
    load_energy : LoadEnergy
        The potential energy of its loads, on another graph, which is part of the energy.
    conditions : tuple of Condition
        Conditions on time and parameters alone, each of which is constant within a segment of a run.
    states, state_rates : tuple of Node
        First-order states as inputs, and their rates in time, coordinates, rates and states.
    controllers : tuple of ControllerModel
        Controllers, which change some of the states at sampling instants.
    angles : tuple of str
        Coordinates without a unit: angles and components of quaternions.
    scene : SceneModel or None
        The scene on the graph that the equations were derived on, for balances of bodies; None where it has no
        positions.
    mode_reactions : mapping of str to Node
        Reactions that a mode of the contacts gives, in terms of those that it leaves: zero, or friction of a sliding
        contact.
    compliances : mapping of str to Node
        Compliances of unknown reactions, by which they share loads that the balances of bodies leave undetermined.
    tree : InertiaTree or None
        The bodies, where they are so many that the mass matrix is long.
    kinked_locks : tuple of Node
        What vanishes where angles of a body lock and positions or constraints have a kink.
    behind_guards : tuple of Node
        Values on which kinks of the laws of friction depend, and which pass zero only where a guard has ended the mode,
        or within its margin: no step needs to end there.
    """

    name: str
    graph: Graph
    symbols: SymbolTable
    q: tuple[Node, ...]
    qdot: tuple[Node, ...]
    dense: Matrix | None
    forcing: tuple[Node, ...]
    reactions: Matrix
    constraints: tuple[ConstraintRow, ...]
    kinetic_energy: Node
    potential_energy: Node
    groups: tuple[VelocityGroup, ...]
    outputs: Mapping[str, Node]
    contacts: tuple[ContactRow, ...] = ()
    defaults: Mapping[str, float] = field(default_factory=dict)
    guards: tuple[Guard, ...] = ()
    minimum_norm: bool = False
    cones: tuple[list[Node], ...] = ()
    reaction_values: Mapping[str, Node] = field(default_factory=dict)
    nonanalytic: bool = False
    load_energy: LoadEnergy = field(default_factory=LoadEnergy)
    conditions: tuple[Condition, ...] = ()
    states: tuple[Node, ...] = ()
    state_rates: tuple[Node, ...] = ()
    controllers: tuple[ControllerModel, ...] = ()
    angles: tuple[str, ...] = ()
    scene: SceneModel | None = None
    mode_reactions: Mapping[str, Node] = field(default_factory=dict)
    compliances: Mapping[str, Node] = field(default_factory=dict)
    tree: InertiaTree | None = None
    behind_guards: tuple[Node, ...] = ()
    kinked_locks: tuple[Node, ...] = ()

    def energies(self, graph: Graph) -> tuple[Node, Node]:
        """Return kinetic and potential energy, loads included, as nodes of a graph."""
        kinetic, potential = graph.adopt([self.kinetic_energy, self.potential_energy])
        if self.load_energy.potential is not None:
            potential = potential + graph.adopt([self.load_energy.potential])[0]
        return kinetic, potential

    @cached_property
    def mass_matrix(self) -> Matrix:
        """The mass matrix (n_q, n_q); of many bodies it is long, and made when it is first asked for."""
        if self.dense is not None:
            return self.dense
        assert self.tree is not None
        return self.tree.mass_matrix(self.graph)

    @property
    def diagonal(self) -> list[Node]:
        """The diagonal of the mass matrix."""
        if self.tree is not None:
            return self.tree.diagonal(self.graph)
        return [row[i] for i, row in enumerate(self.mass_matrix)]

    @property
    def inertia(self) -> list[Node]:
        """All values that the mass matrix is made of."""
        if self.dense is not None:
            return [entry for row in self.dense for entry in row]
        assert self.tree is not None
        return self.tree.nodes

    def momenta(self, rates: Sequence[Node]) -> list[Node]:
        """Return the mass matrix times a vector (n_q,)."""
        if self.tree is not None:
            return self.tree.product(self.graph, rates)
        return matvec(self.graph, self.mass_matrix, rates)

    @property
    def variables(self) -> tuple[Node, ...]:
        """Coordinates, rates and first-order states as inputs."""
        return (*self.q, *self.qdot, *self.states)

    @property
    def state_flow(self) -> dict[Node, Node]:
        """First-order states and their rates."""
        return dict(zip(self.states, self.state_rates, strict=True))

    @property
    def time(self) -> Node:
        """Time."""
        return self.graph.input(self.symbols.time)

    @property
    def unknowns(self) -> tuple[Node, ...]:
        """The reaction components, as inputs."""
        return tuple(self.graph.input(name) for name in self.symbols.unknowns)

    @property
    def moving(self) -> tuple[Node, ...]:
        """Inputs that may change along a motion; a value that depends on none of them is constant."""
        return (*self.timing, *self.variables)

    @property
    def timing(self) -> tuple[Node, ...]:
        """Time, and that of conditions where there are any."""
        return (self.time, self.graph.input(CONDITION_TIME)) if decide(self.conditions) else (self.time,)


# Copies of equations of motion, on a copy of their graph.


def copied(equations: EquationsOfMotion) -> EquationsOfMotion:
    """Return equal equations on a graph of their own, which has the same values in the same forms and order.

    Derivations from the copy leave the original unchanged. Nodes of other graphs, as that of the potential energy
    of loads, are shared.
    """
    graph = equations.graph.copy()
    changed = {
        field.name: moved_to(getattr(equations, field.name), equations.graph, graph)
        for field in fields(equations)
        if field.name not in ("graph", "symbols", "scene")  # names have no nodes, and a scene has its own graph
    }
    return replace(equations, graph=graph, **changed)


def moved_to(value: Any, old: Graph, new: Graph) -> Any:
    """Return a value whose nodes are those of a copied graph."""
    if isinstance(value, Node):
        return new.nodes[value.index] if value.graph is old else value
    if isinstance(value, tuple | list):
        moved = [moved_to(each, old, new) for each in value]
        return value if all(a is b for a, b in zip(value, moved, strict=True)) else type(value)(moved)
    if isinstance(value, Mapping):
        table = {key: moved_to(each, old, new) for key, each in value.items()}
        return value if all(value[key] is each for key, each in table.items()) else table
    if is_dataclass(value) and not isinstance(value, type):
        changed = {field.name: moved_to(getattr(value, field.name), old, new) for field in fields(value)}
        different = {name: each for name, each in changed.items() if each is not getattr(value, name)}
        return replace(value, **different) if different else value
    return value
