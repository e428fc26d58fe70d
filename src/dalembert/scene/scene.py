"""The scene: bodies, coordinates, constraints, loads and joints, in SymPy's vocabulary.

A `Scene` only stores its contents. It is checked as a whole, and all its faults are reported at once, when it is
read for compilation (`dalembert.scene.reading`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, final

from sympy import Expr
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody
from sympy.physics.vector import Vector

from ..errors import SceneError, nesting_named
from .additions import add_connection, add_joints, add_shapes
from .contacts.geometry import GeometricContact
from .contacts.laws import CoulombFriction, UnilateralContact
from .controllers import Controller
from .joints.compliances import add_compliances
from .joints.joints import Joint
from .joints.reactions import Connection, reaction
from .orientation import FreeOrientation
from .release_impose import Release, impose, release
from .robots import RobotParts, from_mjcf, from_urdf
from .shapes import Shape


@final
class Scene:
    """A constrained mechanical scene, written with ``sympy.physics.mechanics``.

    The velocities of points and frames follow from positions and orientations and need not be
    set; where they were, they must not contradict them. Every plain symbol that the scene uses is a
    parameter; every function of time must be one of the coordinates, of the inputs (`add_inputs`) or of the states
    (`add_states`).

    Parameters
    ----------
    name : str
        Name of the scene, for messages and generated files.
    frame : ReferenceFrame
        The Newtonian referential.
    origin : Point
        A point fixed in it.
    coordinates : sequence of dynamicsymbols, optional
        The coordinates q, in the order of every array of the compiled model; those of SymPy's joints need not be among
        them. They need not be independent: the kinetic energy is formed as if they were (assumption 13.1.2).

    Raises
    ------
    SceneError
        Only for arguments that are not what the signature says; everything else is checked as a whole
        by `dalembert.compile_model`.

    Examples
    --------
    A pendulum::

        theta, (m, l, g) = dynamicsymbols("theta"), symbols("m l g", positive=True)
        N, O = ReferenceFrame("N"), Point("O")
        scene = da.Scene("pendulum", frame=N, origin=O, coordinates=[theta])
        P = O.locatenew("P", l * sin(theta) * N.x - l * cos(theta) * N.y)
        scene.add_bodies(Particle("bob", P, m))
        scene.apply_uniform_gravity(-g * N.y)
    """

    @nesting_named
    def __init__(self, name: str, frame: ReferenceFrame, origin: Point, coordinates: Sequence[Expr] = ()) -> None:
        faults = []
        if not isinstance(frame, ReferenceFrame):
            faults.append(f"frame must be a ReferenceFrame, not {frame!r}")
        if not isinstance(origin, Point):
            faults.append(f"origin must be a Point, not {origin!r}")
        listed: Any = coordinates
        if not isinstance(listed, Iterable) or isinstance(listed, str) or getattr(listed, "ndim", 1) == 0:
            faults.append(f"coordinates must be a sequence of dynamicsymbols, such as [x, y], not {coordinates!r}")
        if faults:
            raise SceneError(str(name), faults)
        self.name = str(name)
        self.frame = frame
        self.origin = origin
        self.coordinates: tuple[Expr, ...] = tuple(coordinates)
        self.bodies: tuple[RigidBody | Particle, ...] = ()
        self.joints: tuple[Joint, ...] = ()
        self.connections: tuple[Connection, ...] = ()
        self.constraint_names: tuple[tuple[Expr, str], ...] = ()
        self.loads: tuple[Any, ...] = ()
        self.actuators: tuple[Any, ...] = ()
        self.holonomic_constraints: tuple[Expr, ...] = ()
        self.nonholonomic_constraints: tuple[Expr, ...] = ()
        self.gravity: Vector | None = None
        self.contacts: tuple[UnilateralContact | GeometricContact, ...] = ()
        self.frictions: tuple[CoulombFriction, ...] = ()
        self.compliances: tuple[tuple[Any, Any], ...] = ()
        self.made_contacts: tuple[Any, ...] = ()
        self.releases: tuple[Release, ...] = ()
        self.imposed: tuple[tuple[Expr, Expr], ...] = ()
        self.orientations: tuple[FreeOrientation, ...] = ()
        self.shapes: tuple[tuple[str, Shape], ...] = ()
        self.speeds: tuple[Expr, ...] = ()
        self.kinematic_equations: tuple[Expr, ...] = ()
        self.inputs: tuple[Expr, ...] = ()
        self.elapsed: tuple[Expr, ...] | None = None
        self.further_parameters: tuple[Expr, ...] = ()
        self.velocities: tuple[tuple[Point | ReferenceFrame, Vector], ...] = ()
        self.lagrangian: Expr | None = None
        self.states: tuple[tuple[Expr, Expr], ...] = ()
        self.controllers: tuple[Controller, ...] = ()
        self.robot: RobotParts | None = None

    @classmethod
    @nesting_named
    def from_sympy(cls, source: Any, *, name: str | None = None) -> Scene:
        """Return the scene of a ``System``, a ``KanesMethod`` or a ``LagrangesMethod`` of SymPy.

        Bodies, coordinates, generalized speeds, loads, actuators and constraints are taken over, and nothing that SymPy
        derives from them. Speeds that are no rates keep their names: initial values may be given in them, and they
        are results. A speed that no kinematic equation has, such as ``u``, is the rate of a further coordinate
        ``u_integral``. Bodies at rest and loads on them, which do nothing, are left out.

        Where the velocities that SymPy has are the rates of positions, the scene is like any other. Otherwise, and for
        a Lagrangian, it can be compiled, but holds no positions to draw or to put joints and contacts at.

        Parameters
        ----------
        source : System, KanesMethod or LagrangesMethod
            With its bodies; equations need not have been formed.
        name : str, optional
            Name of the scene; that of the class by default.

        Raises
        ------
        SceneError
            For contents that a `Scene` does not support.
        """
        from ..interop.sympy_systems import scene_from_sympy  # a package that comes later

        return scene_from_sympy(source, name)

    from_urdf = classmethod(from_urdf)
    from_mjcf = classmethod(from_mjcf)

    def copy(self) -> Scene:
        """Return an independent scene with the same contents."""
        twin = Scene(self.name, frame=self.frame, origin=self.origin, coordinates=self.coordinates)
        twin.__dict__.update(self.__dict__)
        return twin

    def in_elapsed_time(self, watched: Sequence[Expr] = ()) -> Scene:
        """Return the same scene with time counted from the start of each run, for runs far from zero.

        The expressions `watched` (events, reductions) contain time, too; their values at the start become parameters.
        """
        twin = self.copy()
        twin.elapsed = tuple(watched)
        return twin

    def with_parameters(self, symbols: Sequence[Expr]) -> Scene:
        """Return the same scene with further parameters, which only events and reductions of its runs contain."""
        twin = self.copy()
        twin.further_parameters = (*self.further_parameters, *symbols)
        return twin

    def add_bodies(self, *bodies: RigidBody | Particle) -> None:
        """Add bodies. A frame or mass centre that the body was not given is SymPy's own and must be located.

        As in SymPy, the ``potential_energy`` of a body exerts no force. It need not be given for loads that have one,
        see `add_loads`; where it is given, it counts in the energies in place of that of the loads, and a warning
        names the coordinates along which it is not theirs, or along which no load acts. One that is the body's own
        weight in the field of `apply_uniform_gravity` counts once.
        """
        for body in bodies:
            if not any(body is own for own in self.bodies):
                self.bodies += (body,)

    add_joints = add_joints
    reaction = reaction

    def add_loads(self, *loads: Any) -> None:
        """Add given actions: ``Force``/``Torque`` of SymPy, pairs (point, force), (frame, torque), or forces on bodies.

        A pair keeps SymPy's meaning: the power of the force is taken with the velocity of the point itself. A force
        on a body, (body, point, force), has the power of the velocity that the body has at the point, v_G + omega x
        (point - G). The two differ where the point moves over the body, such as the contact point of a wheel: the force
        of the road on a tyre is (wheel, contact, force). The body is a RigidBody or Particle of the scene, or its name.

        Those that have a potential energy, such as constant forces, springs along a coordinate or between points, and
        torques that are a function of an angle, have it in ``"energy"``. The loads that it leaves out are named by
        ``model.explain()``: loads that depend on rates (dampers, friction) or on time, and
        others for which no potential energy is known. Requesting the energy warns of the last.
        """
        self.loads += loads

    def add_actuators(self, *actuators: Any) -> None:
        """Add actuators of ``sympy.physics.mechanics``: springs, dampers, forces along pathways, torques.

        `LinearSpring`, `DuffingSpring`, `LinearDamper`, `ForceActuator`, `TorqueActuator`, on a `LinearPathway` or an
        `ObstacleSetPathway`; others count by their ``to_loads()``. A positive force pushes the ends of its pathway
        apart; a pathway whose loads do the opposite, as those of SymPy's `WrappingPathway` do, is an error that says
        what to add in its place. Springs, constant forces, and torques that are a function of an angle have their
        potential energy in ``"energy"``; dampers have none.

        A pathway whose length is zero has no direction: one that always is so is an error, a run that starts there
        ends with the status `NON_FINITE` and names it, and one that passes through such a position takes short steps
        there.
        """
        self.actuators += actuators

    def add_holonomic_constraints(self, *constraints: Expr) -> None:
        """Add expressions in coordinates and time that vanish."""
        self.holonomic_constraints += constraints

    def add_nonholonomic_constraints(self, *constraints: Expr) -> None:
        """Add expressions, affine in the rates, that vanish."""
        self.nonholonomic_constraints += constraints

    def add_inputs(self, *inputs: Expr) -> None:
        """Add given functions of time, such as forces, motor torques or the height of a road.

        They may occur wherever time may, with their first rates: in loads, positions, orientations, constraints and
        outputs. Each run is given their values as ``inputs=``: numbers, which are constant in time, or records made by
        `dalembert.samples`.

        Parameters
        ----------
        *inputs : dynamicsymbols
            ``u, road = dynamicsymbols("u road")``. None of them is a coordinate.
        """
        self.inputs += inputs

    @nesting_named
    def add_states(self, rates: Mapping[Expr, Expr]) -> None:
        """Add first-order states beside the coordinates: filters, motors, integrators, muscles.

        They may stand in loads, joints, nonholonomic constraints, laws of friction, rates of states, outputs and
        events; their initial values are given with those of the coordinates. A quantity in positions must be a
        coordinate instead. Impacts leave them as they are.

        Parameters
        ----------
        rates : mapping of dynamicsymbol to Expr
            For each state its rate, in time, coordinates, rates, states and parameters.

        Raises
        ------
        SceneError
            For what is no mapping; everything else is checked when the scene is compiled.

        Examples
        --------
        A motor with the time constant tau that drives the coordinate x::

            F = dynamicsymbols("F")
            scene.add_states({F: (k * (r - x) - F) / tau})
            scene.add_loads((P, F * N.x))
        """
        given: Any = rates
        if not isinstance(given, Mapping):
            raise SceneError(self.name, [f"add_states takes a mapping of states to their rates, not {rates!r}"])
        self.states += tuple(given.items())

    def add_controllers(self, *controllers: Controller) -> None:
        """Add sampled controllers, which set inputs of the scene at instants and hold them in between.

        Their states and the inputs that they set are results by name, and among ``layout.states``.
        """
        self.controllers += controllers

    def add_friction(self, *laws: CoulombFriction) -> None:
        """Add Coulomb friction between reaction components of joints."""
        self.frictions += laws

    add_compliances = add_compliances

    def add_contacts(self, *contacts: UnilateralContact | GeometricContact) -> None:
        """Add unilateral constraints: they push, do not pull, and may open and close.

        Contacts by geometry, such as ``PointPlane`` or ``SphereSphere``, make their joint and friction themselves when
        the scene is compiled.
        """
        for contact in contacts:
            if not add_connection(self, contact):
                self.contacts += (contact,)

    add_shapes = add_shapes

    def apply_uniform_gravity(self, acceleration: Vector) -> None:
        """Add a uniform gravitational field with the given acceleration [m/s^2], such as ``-g*N.z``."""
        self.gravity = acceleration

    release = release
    impose = impose

    def body_names(self) -> Iterable[str]:
        """Return the names of the bodies, in order."""
        return (str(getattr(body, "name", body)) for body in self.bodies)

    def _repr_markdown_(self) -> str:
        from .notebook import description

        return description(self)

    def __repr__(self) -> str:
        bodies, coordinates = len(self.bodies), len(self.coordinates)
        return (
            f"<Scene {self.name!r}: {bodies} {'body' if bodies == 1 else 'bodies'},"
            f" {coordinates} {'coordinate' if coordinates == 1 else 'coordinates'}>"
        )
