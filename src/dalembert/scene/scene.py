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
from . import release_impose
from .contacts.geometry import GeometricContact
from .contacts.laws import CoulombFriction, UnilateralContact
from .controllers import Controller
from .joints.connections import add_connection
from .joints.joints import Joint
from .joints.reactions import Connection, reaction, require_new_name
from .orientation import FreeOrientation
from .robots import RobotParts, from_mjcf, from_urdf
from .shapes import Shape, checked_shapes


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
        self.releases: tuple[release_impose.Release, ...] = ()
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

    @nesting_named
    def add_joints(self, *joints: Any) -> None:
        """Add joints: those of ``sympy.physics.mechanics``, those that constrain, or a `Joint` with unknown reactions.

        `PinJoint`, `PrismaticJoint`, `CylindricalJoint`, `PlanarJoint`, `SphericalJoint` and `WeldJoint` build a tree.
        Each adds its bodies and coordinates, unless the scene has them, and its speeds. A parent at rest is the fixed
        frame. `Closure`, `Rod`, `Gear`, `RollingDisc` and `RollingSphere` add constraints, `Rope` and `Stop` contacts.
        The reaction of a joint "elbow" is an output by name: "elbow.force_x", ..., "elbow.torque_z" act on the child at
        the joint's ``child_point``, with axes of its ``parent_interframe``. See `reaction` for other axes.

        A reaction need not have power on the coordinates. It is computed where it is the same whatever connections of
        bodies carry that no joint declares; otherwise the error names the bodies.

        Raises
        ------
        SceneError
            For a second joint of the same name, and for arguments that contradict the scene, such as a SymPy joint that
            closes a loop.
        """
        for joint in joints:
            if isinstance(joint, Joint):
                if any(joint.name == item.name for item in self.connections):
                    require_new_name(self, joint.name)
                self.joints += (joint,)
            elif not add_connection(self, joint):
                self.joints += (joint,)

    def reaction(self, joint: str, frame: ReferenceFrame | None = None) -> dict[str, Expr]:
        """Return the reaction of a joint that constrains, as outputs by name.

        Parameters
        ----------
        joint : str
            Name of a joint of the scene that constrains.
        frame : ReferenceFrame, optional
            Axes of the components, which are called such as "elbow.force_x on N"; by default those of the joint.

        Returns
        -------
        dict of str to Expr
            Forces [N] and torques [N m] on the child at the joint's point, for ``outputs=``.

        Raises
        ------
        UnknownNameError
            For a joint that the scene does not have, or that does not constrain.
        OptionError
            For axes of a joint whose reaction is no force or torque at a point, such as that of a gear.

        Examples
        --------
        ::

            model = da.compile_model(scene, outputs=scene.reaction("elbow", frame=N))
        """
        return reaction(self, joint, frame)

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

    def add_compliances(self, compliances: Mapping[Any, Any]) -> None:
        """Add compliances of reaction components, by which joints share a load that rigid bodies leave undetermined.

        Of all reactions that balance the bodies, those are returned that minimise the elastic energy, 1/2 sum c_i
        R_i^2, as those of elastic supports do in the limit of great stiffness. The motion does not depend on them, nor
        does any reaction that the balances determine; only the ratios of the compliances matter.

        Parameters
        ----------
        compliances : mapping of names or unknowns to Expr or number
            For each reaction component its positive compliance [m/N], or [rad/(N m)] of a torque: a number, or an
            expression of parameters that are declared positive.

        Raises
        ------
        SceneError
            For what is no mapping; everything else is checked when the scene is compiled.

        Examples
        --------
        A door whose upper hinge is softer than its lower one along their common axis::

            c_1, c_2 = symbols("c_1 c_2", positive=True)
            scene.add_compliances({"upper.force_z": c_1, "lower.force_z": c_2})
        """
        given: Any = compliances
        if not isinstance(given, Mapping):
            what = f"add_compliances takes a mapping of reaction components to compliances, not {compliances!r}"
            raise SceneError(self.name, [what])
        self.compliances += tuple(given.items())

    def add_contacts(self, *contacts: UnilateralContact | GeometricContact) -> None:
        """Add unilateral constraints: they push, do not pull, and may open and close.

        Contacts by geometry, such as ``PointPlane`` or ``SphereSphere``, make their joint and friction themselves when
        the scene is compiled.
        """
        for contact in contacts:
            if not add_connection(self, contact):
                self.contacts += (contact,)

    def add_shapes(self, shapes: Mapping[str, Shape | Sequence[Shape]]) -> None:
        """Add shapes for pictures; the motion does not depend on them.

        Parameters
        ----------
        shapes : mapping of str to shape or sequence of shapes
            `Sphere`, `Disk`, `Box` and `Cylinder` move with the body whose name is their key. `Rod`, `Spring`,
            `Path` and `Ground` have any name.

        Raises
        ------
        OptionError
            For what is no shape, and for arguments of shapes of the wrong kind.

        Examples
        --------
        A wheel::

            scene.add_shapes({"wheel": da.Disk(radius=r, axis=W.y), "floor": da.Ground(normal=N.z)})
        """
        self.shapes += checked_shapes(shapes)

    def apply_uniform_gravity(self, acceleration: Vector) -> None:
        """Add a uniform gravitational field with the given acceleration [m/s^2], such as ``-g*N.z``."""
        self.gravity = acceleration

    @nesting_named
    def release(self, coordinate: Expr, target: Point | ReferenceFrame, direction: Vector) -> Scene:
        """Return a new scene with a further coordinate that the parametrization had eliminated.

        This scene stays as it is: write ``scene = scene.release(...)``, and compile what it returns.

        This is the "fictitious" coordinate of section 13.4: a further Lagrange equation, which determines
        the reaction that the parametrization hides. The motion stays as it is. Outputs do not need it:
        `dalembert.compile_model` computes reactions that the parametrization hides by itself.

        Parameters
        ----------
        coordinate : dynamicsymbol
            The coordinate; the scene must not have it yet.
        target : Point or ReferenceFrame
            The point to move, and with it all that is located from it; or the frame to turn, and with it all
            that is oriented from it.
        direction : Vector
            Unit vector: `coordinate` takes the place of the component of the position of `target` along it, or is
            the angle of a further rotation about it.

        Returns
        -------
        Scene
            With the coordinate, and the holonomic constraint that sets it to its former value.

        Raises
        ------
        SceneError
            When the coordinate exists, the target is fixed, or the direction is not a unit vector.

        Examples
        --------
        The normal force under the rolling sphere, of which G is the centre::

            scene = scene.release(z, G, N.z)  # with z, and the constraint z - r

        A point from which a body, and all that it carries, is located moves them together: so a pin at the origin is
        released as a point of its own, ``pin = O.locatenew("pin", 0)``.
        """
        return release_impose.release(self, coordinate, target, direction)

    @nesting_named
    def impose(self, coordinate: Expr, expression: Expr | None = None) -> Scene:
        """Return a new scene without a coordinate that a holonomic constraint determines: "compatible" equations.

        This scene stays as it is: write ``scene = scene.impose(...)``.

        Parameters
        ----------
        coordinate : dynamicsymbol
            The coordinate to eliminate.
        expression : Expr, optional
            Its value, in the other coordinates and time. Without it, a holonomic constraint that is affine in
            the coordinate is solved for it.

        Returns
        -------
        Scene
            Without the coordinate and without the constraints that this fulfils. Reactions that only held those
            constraints have no power left and become undetermined.

        Raises
        ------
        SceneError
            When no constraint gives the coordinate in closed form, or `expression` contradicts one.
        """
        return release_impose.impose(self, coordinate, expression)

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
