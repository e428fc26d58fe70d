"""Andrews' squeezing mechanism and a block with dry friction by other programs, for benchmarks/mechanisms.py."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["block_exudyn", "block_mujoco", "block_position", "squeezer_exudyn", "squeezer_sympy"]

Vector = NDArray[np.float64]


# The squeezer: seven bars in the plane, three loops that close in one point, a spring, and a constant torque.


def squeezer_sympy(scene: Any, parameters: Mapping[str, float], start: Mapping[str, float], end: float) -> Any:
    """Return a run, by tolerance, of SymPy's KanesMethod with PyDy's compiled functions and SciPy's DOP853.

    The equations take some ten seconds to derive, and PyDy's C code some to compile.
    """
    from pydy.codegen.ode_function_generators import generate_ode_function
    from scipy.integrate import solve_ivp
    from sympy import Dummy
    from sympy.physics.mechanics import KanesMethod, dynamicsymbols

    q = list(scene.coordinates)
    u = list(dynamicsymbols(f"u0:{len(q)}"))
    t = dynamicsymbols._t
    scene.origin.set_vel(scene.frame, 0)
    rates = dict(zip([x.diff(t) for x in q], u, strict=True))
    loops = list(scene.holonomic_constraints)
    velocity = [g.diff(t).subs(rates) for g in loops]
    loads = [(where, vector.subs(rates)) for where, vector in scene.loads]
    kane = KanesMethod(
        scene.frame,
        [q[0]],
        [u[0]],
        kd_eqs=[a - b for a, b in rates.items()],
        q_dependent=q[1:],
        configuration_constraints=loops,
        u_dependent=u[1:],
        velocity_constraints=velocity,
    )
    kane.kanes_equations(list(scene.bodies), loads)
    constants = sorted(kane.mass_matrix_full.free_symbols | kane.forcing_full.free_symbols, key=str)
    constants = [c for c in constants if c != t and not isinstance(c, Dummy)]
    states = [*kane.q, *kane.u]
    function = generate_ode_function(
        kane.forcing_full,
        kane.q,
        kane.u,
        constants,
        mass_matrix=kane.mass_matrix_full,
        generator="cython",
        constants_arg_type="array",
    )
    values = np.array([parameters[str(c)] for c in constants])
    y0 = np.array([start.get(x.func.__name__, 0.0) for x in states])
    order = [kane.q[:].index(x) for x in q]

    def make(tolerance: float) -> Callable[[], Vector]:
        def rates_of(time: float, y: Vector) -> Vector:
            return np.asarray(function(y, time, values))

        def run() -> Vector:
            found = solve_ivp(rates_of, (0.0, end), y0, "DOP853", [end], rtol=tolerance, atol=tolerance)
            return np.asarray(found.y[order, -1])

        return run

    return make


def squeezer_exudyn(p: Mapping[str, float], start: Mapping[str, float], end: float) -> Callable[[float], Any]:
    """Return a run, by the number of steps, of Exudyn's rigid bodies in the plane with its generalized-alpha method."""
    import exudyn as exu
    from exudyn.itemInterface import (
        LoadTorqueVector,
        MarkerBodyPosition,
        MarkerBodyRigid,
        NodeRigidBody2D,
        ObjectConnectorSpringDamper,
        ObjectGround,
        ObjectJointRevolute2D,
        ObjectRigidBody2D,
    )

    be, th, ga, ph, de, om, ep = (start[x] for x in ("be", "th", "ga", "ph", "de", "om", "ep"))
    turned = np.array([be, be + th, ga, ph + de, de, om + ep, ep])
    A, B, C = (np.array([p[f"x{k}"], p[f"y{k}"]]) for k in "abc")

    def frame(i: int) -> NDArray[np.float64]:
        c, s = np.cos(turned[i]), np.sin(turned[i])
        return np.array([[c, -s], [s, c]])

    # Places in the frame of each body, from its reference point: (where the reference point is, the centre of mass).
    pin = frame(0) @ [p["rr"], 0]
    knee = A + frame(4) @ [p["zt"], 0]
    elbow = A + frame(6) @ [0, -p["u"]]
    centres = [
        (np.zeros(2), np.array([p["ra"], 0])),
        (pin, np.array([-p["da"], 0])),
        (B, np.array([p["sa"], -p["sb"]])),
        (knee, np.array([0, -(p["e"] - p["ea"])])),
        (A, np.array([p["ta"], -p["tb"]])),
        (elbow, np.array([p["zf"] - p["fa"], 0])),
        (A, np.array([p["ua"], -p["ub"]])),
    ]
    container = exu.SystemContainer()
    system = container.AddSystem()
    ground = system.AddObject(ObjectGround())
    bodies, nodes = [], []
    for i, (origin, centre) in enumerate(centres):
        place = origin + frame(i) @ centre
        node = system.AddNode(NodeRigidBody2D(referenceCoordinates=[*place, turned[i]]))
        nodes.append(node)
        bodies.append(
            system.AddObject(
                ObjectRigidBody2D(physicsMass=p[f"m{i + 1}"], physicsInertia=p[f"I{i + 1}"], nodeNumber=node)
            )
        )

    def at(i: int, local: Any) -> Any:
        return system.AddMarker(
            MarkerBodyPosition(bodyNumber=bodies[i], localPosition=[*(np.asarray(local) - centres[i][1]), 0])
        )

    def fixed(point: Any) -> Any:
        return system.AddMarker(MarkerBodyPosition(bodyNumber=ground, localPosition=[*point, 0]))

    zero = [0.0, 0.0]
    ends = at(1, [-p["d"], 0])
    for one, other in (
        (fixed(zero), at(0, zero)),
        (at(0, [p["rr"], 0]), at(1, zero)),
        (fixed(B), at(2, zero)),
        (fixed(A), at(4, zero)),
        (at(4, [p["zt"], 0]), at(3, zero)),
        (fixed(A), at(6, zero)),
        (at(6, [0, -p["u"]]), at(5, zero)),
        (ends, at(2, [0, -p["ss"]])),
        (ends, at(3, [0, -p["e"]])),
        (ends, at(5, [p["zf"], 0])),
    ):
        system.AddObject(ObjectJointRevolute2D(markerNumbers=[one, other]))
    pull = [fixed(C), at(2, [p["sd"], -p["sc"]])]
    system.AddObject(ObjectConnectorSpringDamper(markerNumbers=pull, referenceLength=p["l0"], stiffness=p["c0"]))
    crank = system.AddMarker(MarkerBodyRigid(bodyNumber=bodies[0]))
    system.AddLoad(LoadTorqueVector(markerNumber=crank, loadVector=[0, 0, p["mom"]]))
    system.Assemble()

    def make(steps: float) -> Callable[[], Vector]:
        settings = exu.SimulationSettings()
        integration = settings.timeIntegration
        integration.numberOfSteps, integration.endTime = int(steps), end
        integration.generalizedAlpha.spectralRadius = 1.0
        integration.newton.relativeTolerance, integration.newton.absoluteTolerance = 1e-12, 1e-14
        integration.verboseMode = 0
        settings.solutionSettings.writeSolutionToFile = False
        settings.linearSolverType = exu.LinearSolverType.EXUdense

        def run() -> Vector:
            system.SolveDynamic(settings, solverType=exu.DynamicSolverType.TrapezoidalIndex2)
            angles = [system.GetNodeOutput(node, exu.OutputVariableType.Rotation) for node in nodes]
            a = [float(np.ravel(x)[-1]) for x in angles]
            return np.array([a[0], a[1] - a[0], a[2], a[3] - a[4], a[4], a[5] - a[6], a[6]])

        return run

    return make


# A block on a rough floor, held by a spring: it slides to and fro, and sticks.


def block_position(mass: float, stiffness: float, friction: float, start: float) -> float:
    """Return where the block comes to rest: each half oscillation ends nearer by twice friction / stiffness."""
    x, rest = start, friction / stiffness
    while abs(x) > rest:
        x = -np.sign(x) * (abs(x) - 2 * rest)
    return float(x)


def block_mujoco(mass: float, stiffness: float, friction: float, start: float, end: float) -> Callable[[float], Any]:
    """Return a run, by the step, of MuJoCo's slide joint with a spring and a very hard friction loss."""
    import mujoco

    text = f"""<mujoco><option gravity="0 0 0" integrator="implicitfast" tolerance="1e-12"/><worldbody><body>
    <joint type="slide" axis="1 0 0" stiffness="{stiffness}" frictionloss="{friction}"
           solreffriction="1e-4 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"/>
    <inertial pos="0 0 0" mass="{mass}" diaginertia="1 1 1"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)

    def make(step: float) -> Callable[[], Vector]:
        def run() -> Vector:
            model.opt.timestep = step
            mujoco.mj_resetData(model, data)
            data.qpos[0] = start
            mujoco.mj_step(model, data, nstep=round(end / step))
            return np.array(data.qpos)

        return run

    return make


def block_exudyn(mass: float, stiffness: float, friction: float, start: float, end: float) -> Callable[[float], Any]:
    """Return a run, by the step, of Exudyn's spring with a friction force whose slope at rest is very steep."""
    import exudyn as exu
    from exudyn.itemInterface import (
        CoordinateSpringDamperExt,
        MarkerNodeCoordinate,
        NodePoint,
        NodePointGround,
        ObjectMassPoint,
    )

    container = exu.SystemContainer()
    system = container.AddSystem()
    node = system.AddNode(NodePoint(initialCoordinates=[start, 0, 0]))
    system.AddObject(ObjectMassPoint(physicsMass=mass, nodeNumber=node))
    ground = system.AddMarker(MarkerNodeCoordinate(nodeNumber=system.AddNode(NodePointGround()), coordinate=0))
    place = system.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=0))
    system.AddObject(
        CoordinateSpringDamperExt(
            markerNumbers=[ground, place],
            stiffness=stiffness,
            fDynamicFriction=friction,
            fStaticFrictionOffset=0.0,
            frictionProportionalZone=1e-5,
        )
    )
    system.Assemble()

    def make(step: float) -> Callable[[], Vector]:
        settings = exu.SimulationSettings()
        integration = settings.timeIntegration
        integration.numberOfSteps, integration.endTime = round(end / step), end
        integration.generalizedAlpha.spectralRadius = 0.6
        integration.verboseMode = 0
        settings.solutionSettings.writeSolutionToFile = False

        def run() -> Vector:
            system.SolveDynamic(settings, solverType=exu.DynamicSolverType.GeneralizedAlpha)
            return np.asarray(system.GetNodeOutput(node, exu.OutputVariableType.Displacement))[:1]

        return run

    return make
