"""`SceneModel`: a scene read onto the expression graph. SymPy ends here.

Frames and points are numbered; components are triples of graph nodes. A vector is a tuple of
pieces, each resolved on one frame, exactly as the user wrote it; nothing is multiplied out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Any, final

from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node, deps_of
from ..transforms.conditions import Condition
from .symbol_table import SymbolTable

Components = tuple[Node, Node, Node]


@final
@frozen
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
@frozen
class FrameModel:
    """A frame and its rotation from its parent: components here = `rotation` times components there."""

    name: str
    parent: int | None
    rotation: tuple[Components, Components, Components] | None


@final
@frozen
class PointModel:
    """A point and its position from its parent."""

    name: str
    parent: int | None
    position: Pieces


@final
@frozen
class BodyModel:
    """A body: frame, mass centre, mass and central inertia (None for a particle) in its own frame."""

    name: str
    frame: int
    centre: int
    mass: Node
    inertia: tuple[Components, Components, Components] | None


@final
@frozen
class Action:
    """An action on the scene.

    `kind` is "screw" (of a joint, on body number `target`, reduced at point `at`), "body force" (a load, taken with the
    velocity of body number `target` at point `at`), "force" (at point `at`, taken with that point's own velocity) or
    "torque" (on frame number `target`). A screw between two bodies is two opposite actions; `other` is the body of the
    opposite one. Loads of one actuator have its number as `actuator`.
    """

    name: str
    kind: str
    target: int | None
    at: int | None
    force: Pieces
    torque: Pieces
    other: int | None = None
    actuator: int | None = None

    @property
    def of_joint(self) -> bool:
        """Whether a joint exerts it."""
        return self.kind == "screw"

    @property
    def on_body(self) -> bool:
        """Whether its power is taken with the velocity field of a body."""
        return self.kind in ("screw", "body force")

    @property
    def deps(self) -> int:
        """The inputs that its vectors contain, as a mask."""
        return deps_of(x for piece in (*self.force, *self.torque) for x in piece.components)

    def opposite(self) -> Action:
        """Return the opposite screw on the other body, reduced at the same point."""
        force, torque = (tuple(piece.opposite() for piece in pieces) for pieces in (self.force, self.torque))
        return Action(self.name, self.kind, self.other, self.at, force, torque, self.target)


@final
@frozen
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
@frozen
class GivenLoad:
    """A force with the velocity of its point, or a torque with the angular velocity of its frame."""

    name: str
    vector: Pieces
    velocity: Pieces


@final
@frozen
class GivenMotion:
    """Velocities that a scene prescribes in place of positions."""

    bodies: tuple[GivenBody, ...]
    loads: tuple[GivenLoad, ...]


@final
@frozen
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
@frozen
class ConstraintModel:
    """A constraint expression = 0, with a label for messages."""

    label: str
    expression: Node


@final
@frozen
class ContactModel:
    """Friction, a constraint that opens, or both, at one normal reaction.

    Attributes
    ----------
    name, normal : str
        Its name, and that of its normal reaction.
    gap, constraint, restitution : Node, int, Node, or None
        The gap, the number of the holonomic constraint that holds while it is closed, and
        Newton's coefficient; None for friction on a constraint that never opens.
    sense : int
        1 where that constraint is the gap, -1 where it is minus the gap.
    tangential : tuple of str
        Names of the friction forces; none without friction.
    slip : tuple of Node, or None
        Slip velocities along them; None where the power of the forces determines them.
    mu, mu_static, regularization : Node or None
        Coefficients of friction, and the slip speed of the smooth law.
    normal_load : Node or None
        What friction has for its normal reaction where that is given, not negative.
    slip_speed : Node or None
        The input that `mu` has for the slip speed where it is a function of that.
    follows : str or None
        The contact that opens, of which this is a further law of friction.
    kinks : tuple of Node
        Values that change their signs where the gradient of the gap jumps.
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
    normal_load: Node | None = None
    slip_speed: Node | None = None
    follows: str | None = None
    kinks: tuple[Node, ...] = ()


@final
@frozen
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
        Their values after an action, in terms of all values before; empty with a function.
    function : callable or None
        Python function that computes them instead.
    """

    name: str
    period: Node
    offset: Node
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    changes: Mapping[str, Node]
    function: Callable[..., Any] | None = None


@final
@frozen
class SceneModel:
    """Everything of a scene that the derivation needs, as graph nodes.

    Attributes
    ----------
    potentials : tuple of Node
        Potential energies that the bodies declare.
    outputs : mapping of str to Node
        Requested expressions.
    places, vectors : mappings of str to (int, int) and (Pieces, int)
        Requested components: number of a point or pieces of a vector, and number of the axis.
    chosen : tuple of str
        Names of outputs that a user chose, and that are not the text of the expression.
    given : GivenMotion or None
        Bodies and loads of a scene that prescribes velocities, in place of `bodies` and `actions`; the loads of a scene
        with a `lagrangian`.
    conditions : tuple of Condition
        Conditions on time and parameters alone.
    stored : tuple of Node or None
        Candidates for the potential energies of the actuators.
    state_rates : tuple of Node
        Rates of the first-order states.
    controllers : tuple of ControllerModel
        Sampled controllers.
    compliances : mapping of str to Node
        Those of unknown reaction components.
    kinks : tuple of (str, Node)
        Faults of kinks in positions and constraints, unless motions end where a value changes its sign.
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
    compliances: Mapping[str, Node] = field(default_factory=dict)
    kinks: tuple[tuple[str, Node], ...] = ()
