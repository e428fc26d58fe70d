"""`SceneModel`: a scene read onto the expression graph. SymPy ends here.

Frames and points are numbered; components are triples of graph nodes. A vector is a tuple of
pieces, each resolved on one frame, exactly as the user wrote it; nothing is multiplied out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, final

from ..ir.graph import Graph, Node
from ..transforms.conditions import Condition
from .elapsed import Offset

__all__ = [
    "Action",
    "BodyModel",
    "Components",
    "ConstraintModel",
    "ContactModel",
    "ControllerModel",
    "Entry",
    "FrameModel",
    "GivenBody",
    "GivenLoad",
    "GivenMotion",
    "InputSymbol",
    "Piece",
    "Pieces",
    "PointModel",
    "SceneModel",
    "SpeedGroup",
    "SymbolTable",
]

Components = tuple[Node, Node, Node]


@final
@dataclass(frozen=True, slots=True)
class Piece:
    """Components of a vector on the frame with number `frame`."""

    frame: int
    components: Components

    def opposite(self) -> Piece:
        """Return the components with the other sign."""
        x, y, z = self.components
        return Piece(self.frame, (-x, -y, -z))


Pieces = tuple[Piece, ...]


@final
@dataclass(frozen=True, slots=True)
class FrameModel:
    """A frame and its rotation from its parent: components here = `rotation` times components there."""

    name: str
    parent: int | None
    rotation: tuple[Components, Components, Components] | None


@final
@dataclass(frozen=True, slots=True)
class PointModel:
    """A point and its position from its parent."""

    name: str
    parent: int | None
    position: Pieces


@final
@dataclass(frozen=True, slots=True)
class BodyModel:
    """A body: frame, mass centre, mass and central inertia (None for a particle) in its own frame."""

    name: str
    frame: int
    centre: int
    mass: Node
    inertia: tuple[Components, Components, Components] | None


@final
@dataclass(frozen=True, slots=True)
class Action:
    """An action on the scene.

    `kind` is "screw" (on body number `target`, reduced at point `at`), "force" (at point `at`,
    taken with that point's own velocity) or "torque" (on frame number `target`). A screw between two bodies is two
    opposite actions; `other` is the body of the opposite one. Loads of one actuator have its number as `actuator`.
    """

    name: str
    kind: str
    target: int | None
    at: int | None
    force: Pieces
    torque: Pieces
    other: int | None = None
    actuator: int | None = None

    def opposite(self) -> Action:
        """Return the opposite screw on the other body, reduced at the same point."""
        force, torque = (tuple(piece.opposite() for piece in pieces) for pieces in (self.force, self.torque))
        return Action(self.name, self.kind, self.other, self.at, force, torque, self.target)


@final
@dataclass(frozen=True, slots=True)
class GivenBody:
    """A body of which velocities are given: mass, velocity of the mass centre, angular velocity, and central inertia.

    The inertia (None for a particle) is that on the frame with number `frame`, on which it need not be constant.
    """

    name: str
    mass: Node
    velocity: Pieces
    spin: Pieces
    frame: int
    inertia: tuple[Components, Components, Components] | None


@final
@dataclass(frozen=True, slots=True)
class GivenLoad:
    """A force with the velocity of its point, or a torque with the angular velocity of its frame."""

    name: str
    vector: Pieces
    velocity: Pieces


@final
@dataclass(frozen=True)
class GivenMotion:
    """Velocities that a scene prescribes in place of positions."""

    bodies: tuple[GivenBody, ...]
    loads: tuple[GivenLoad, ...]


@final
@dataclass(frozen=True, slots=True)
class SpeedGroup:
    """Speeds that kinematic equations tie to the rates of as many coordinates.

    Attributes
    ----------
    names : tuple of str
    coordinates : tuple of int
        Numbers of the coordinates.
    rows : tuple of tuple of Node
        The speeds are rows . rates + something of coordinates and time.
    """

    names: tuple[str, ...]
    coordinates: tuple[int, ...]
    rows: tuple[tuple[Node, ...], ...]


@final
@dataclass(frozen=True, slots=True)
class ConstraintModel:
    """A constraint expression = 0, with a label for messages."""

    label: str
    expression: Node


@final
@dataclass(frozen=True, slots=True)
class Entry:
    """Other values that a start may be given in, such as angles in place of a quaternion.

    Attributes
    ----------
    names : tuple of str
        What these values are called; all of them are needed.
    needs : tuple of str
        Names of other entries that must be given beside them.
    targets : tuple of str
        Coordinates or rates that they stand for.
    values : tuple of Node
        Those, in terms of inputs called like the names and coordinates.
    """

    names: tuple[str, ...]
    needs: tuple[str, ...]
    targets: tuple[str, ...]
    values: tuple[Node, ...]


@final
@dataclass(frozen=True, slots=True)
class ContactModel:
    """Friction, a constraint that opens, or both, at one normal reaction.

    Attributes
    ----------
    name, normal : str
        Its name, and that of its normal reaction.
    gap, constraint, restitution : Node, int, Node, or None
        What is positive where it is open, the number of the holonomic constraint that holds while it is closed, and
        Newton's coefficient; None for friction on a constraint that never opens.
    sense : int
        1 where that constraint is the gap, -1 where it is minus the gap.
    tangential : tuple of str
        Names of the friction forces; none without friction.
    slip : tuple of Node, or None
        Slip velocities along them; None where the power of the forces tells.
    mu, mu_static, regularization : Node or None
        Coefficients of friction, and the slip speed of the smooth law.
    """

    name: str
    normal: str
    gap: Node | None = None
    constraint: int | None = None
    sense: int = 1
    restitution: Node | None = None
    tangential: tuple[str, ...] = ()
    slip: tuple[Node, ...] | None = None
    mu: Node | None = None
    mu_static: Node | None = None
    regularization: Node | None = None


@final
@dataclass(frozen=True, slots=True)
class InputSymbol:
    """An input: a given function of time.

    Attributes
    ----------
    name : str
    used : bool
        Whether anything that was read depends on it.
    smoothness : int
        How often its values must have a continuous derivative: -1 where they may jump.
    where : str
        What requires that.
    """

    name: str
    used: bool
    smoothness: int
    where: str


@final
@dataclass(frozen=True)
class ControllerModel:
    """A sampled controller.

    Attributes
    ----------
    name : str
    period, offset : Node
        Of parameters alone.
    states, inputs : tuple of str
        Names of its states, and of the inputs that it sets; all are first-order states without a rate.
    changes : mapping of str to Node
        What they are after it has acted, in terms of what everything was before; empty with a function.
    function : callable or None
        What computes them instead.
    """

    name: str
    period: Node
    offset: Node
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    changes: Mapping[str, Node]
    function: Callable[..., Any] | None = None


@final
@dataclass(frozen=True)
class SymbolTable:
    """The names of a scene and the inputs they stand for.

    Attributes
    ----------
    time : str
        Name of time.
    coordinates, rates, parameters, unknowns : tuple of str
        Names, in the order of every array.
    aliases : mapping of str to str
        What a SymPy symbol prints as -> its name, so that symbols serve as keys wherever names do.
    entries : tuple of Entry
        Other values that a start may be given in.
    assumptions : mapping of str to tuple of str
        Name -> what its symbol was declared to be, such as "positive", where that excludes numbers.
    timed : bool
        Whether time itself occurs in the scene or its outputs.
    offsets : tuple of Offset
        Parameters that stand for what expressions of time are at the start of a run, where time is counted from there.
    inputs : tuple of InputSymbol
        Given functions of time; their parameters (`dalembert.ir.input_parameters`) are among the `parameters`.
    states : tuple of str
        Names of the first-order states.
    held : tuple of str
        Names of the inputs that controllers set, which are among the states.
    """

    time: str
    coordinates: tuple[str, ...]
    rates: tuple[str, ...]
    parameters: tuple[str, ...]
    unknowns: tuple[str, ...]
    aliases: Mapping[str, str]
    entries: tuple[Entry, ...] = ()
    assumptions: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    timed: bool = False
    offsets: tuple[Offset, ...] = ()
    inputs: tuple[InputSymbol, ...] = ()
    states: tuple[str, ...] = ()
    held: tuple[str, ...] = ()

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(each.name for each in self.inputs)

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of coordinates, rates and first-order states."""
        return (*self.coordinates, *self.rates, *self.states)


@final
@dataclass(frozen=True)
class SceneModel:
    """Everything of a scene that the derivation needs, as graph nodes.

    Of a scene that gives velocities, `given` holds bodies and loads, and `bodies` and `actions` are empty; of one that
    gives its Lagrangian, `given` holds the loads. `potentials` are those that the bodies
    of the scene say themselves. `places` and `vectors` are outputs: number of a point or pieces of a vector, and of an
    axis. `chosen` are names of outputs that are not the text of what they are. `conditions` are those that
    depend on time and parameters alone. `stored` are candidates for the potential energies of the actuators.
    `state_rates` are the rates of the first-order states, `controllers` act at sampling instants.
    """

    name: str
    graph: Graph
    symbols: SymbolTable
    frames: tuple[FrameModel, ...]
    points: tuple[PointModel, ...]
    bodies: tuple[BodyModel, ...]
    actions: tuple[Action, ...]
    gravity: Pieces
    potentials: tuple[Node, ...]
    holonomic: tuple[ConstraintModel, ...]
    nonholonomic: tuple[ConstraintModel, ...]
    outputs: Mapping[str, Node]
    contacts: tuple[ContactModel, ...] = ()
    speeds: tuple[SpeedGroup, ...] = ()
    given: GivenMotion | None = None
    lagrangian: Node | None = None
    places: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    conditions: tuple[Condition, ...] = ()
    stored: tuple[Node | None, ...] = ()
    state_rates: tuple[Node, ...] = ()
    controllers: tuple[ControllerModel, ...] = ()
    vectors: Mapping[str, tuple[Pieces, int]] = field(default_factory=dict)
    chosen: tuple[str, ...] = ()
