"""Actuators of SymPy in a scene: loads by hand, energies, and what is refused."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import (
    DuffingSpring,
    ForceActuator,
    LagrangesMethod,
    LinearDamper,
    LinearPathway,
    LinearSpring,
    ObstacleSetPathway,
    Particle,
    Point,
    ReferenceFrame,
    RigidBody,
    System,
    TorqueActuator,
    WrappingCylinder,
    WrappingPathway,
    dynamicsymbols,
    inertia,
)

import dalembert as da
from dalembert.errors import SceneError
from dalembert.methods.status import Status
from textbook.helpers import agreement

x, y, u, v, a, b = dynamicsymbols("x y u v a b")
m, k, l, c, g, r, k3, F, J = sp.symbols("m k l c g r k3 F J", positive=True)
P_VALUES = {m: 1.3, k: 20.0, l: 0.4, c: 0.7, g: 9.81, r: 0.5, k3: 7.0, F: 2.5, J: 0.6}
START = {"x": 1.0, "y": -0.3, "u": -0.4, "v": 0.5, "x_dot": 0.4, "y_dot": -1.0, "u_dot": 0.3, "v_dot": 0.8}
TURN = {"a": 0.8, "b": -0.3, "a_dot": 1.5, "b_dot": -0.4}


def pair():
    """Return a scene of two particles in a plane, with its points; the second is heavier."""
    N, O = ReferenceFrame("N"), Point("O")
    first, second = O.locatenew("P", x * N.x + y * N.y), O.locatenew("Q", u * N.x + v * N.y)
    scene = da.Scene("pair", frame=N, origin=O, coordinates=[x, y, u, v])
    scene.add_bodies(Particle("p", first, m), Particle("q", second, 2 * m))
    return scene, N, O, first, second


def discs():
    """Return a scene of two discs on one axis, with their frames."""
    N, O = ReferenceFrame("N"), Point("O")
    A, B = N.orientnew("A", "Axis", (a, N.z)), N.orientnew("B", "Axis", (b, N.z))
    scene = da.Scene("discs", frame=N, origin=O, coordinates=[a, b])
    for frame, number in ((A, J), (B, 2 * J)):
        scene.add_bodies(RigidBody(f"disc {frame.name}", O, frame, m, (inertia(frame, number, number, number), O)))
    return scene, N, A, B


def known(model):
    return {s: value for s, value in P_VALUES.items() if s.name in model.layout.parameters}


def acting(kind):
    """Return a scene with one actuator, its start, and forces (or torques) on the bodies by hand."""
    along = {"LinearSpring", "DuffingSpring", "LinearDamper", "ForceActuator"}
    p = {s.name: value for s, value in P_VALUES.items()}
    if kind in along:
        scene, _, _, first, second = pair()
        path = LinearPathway(first, second)
        d = np.array([START["u"] - START["x"], START["v"] - START["y"]])
        w = np.array([START["u_dot"] - START["x_dot"], START["v_dot"] - START["y_dot"]])
        length = np.hypot(*d)
        stretch = length - p["l"]
        made, force = {
            "LinearSpring": (LinearSpring(k, path, l), -p["k"] * stretch),
            "DuffingSpring": (DuffingSpring(k, k3, path, l), -p["k"] * stretch - p["k3"] * stretch**3),
            "LinearDamper": (LinearDamper(c, path), -p["c"] * (d @ w) / length),
            "ForceActuator": (ForceActuator(F, path), p["F"]),
        }[kind]
        scene.add_actuators(made)
        push = force * d / length
        return scene, START, np.concatenate([-push / p["m"], push / (2 * p["m"])])
    if kind == "ObstacleSetPathway":
        scene, N, O, first, second = pair()
        peg, post = O.locatenew("peg", 0.2 * N.x + N.y), O.locatenew("post", -0.5 * N.x + 0.9 * N.y)
        scene.add_actuators(LinearSpring(k, ObstacleSetPathway(first, peg, post, second), l))
        ends = np.array([[START["x"], START["y"]], [START["u"], START["v"]]])
        near = np.array([[0.2, 1.0], [-0.5, 0.9]])
        arms = near - ends
        sizes = np.linalg.norm(arms, axis=1)
        tension = p["k"] * (sizes.sum() + np.hypot(0.7, 0.1) - p["l"])
        return scene, START, np.concatenate((tension * arms / sizes[:, None]) / np.array([[1], [2]]) / p["m"])
    scene, N, A, B = discs()
    scene.add_actuators(TorqueActuator(-k * (a - b) + F, N.z, A, B), TorqueActuator(-c * a.diff(), N.z, A))
    torque = -p["k"] * (TURN["a"] - TURN["b"]) + p["F"]
    return scene, TURN, np.array([(torque - p["c"] * TURN["a_dot"]) / p["J"], -torque / (2 * p["J"])])


KINDS = ["LinearSpring", "DuffingSpring", "LinearDamper", "ForceActuator", "ObstacleSetPathway", "TorqueActuator"]


@pytest.mark.parametrize("kind", KINDS)
def test_loads_by_hand(kind):
    scene, start, wanted = acting(kind)
    for backend in ("llvm", "numpy"):
        model = da.compile_model(scene, backend=backend)
        names = model.layout.coordinates
        q, qdot = (np.array([start[name + end] for name in names]) for end in ("", "_dot"))
        found = model.accelerations(0.0, q, qdot, known(model))
        np.testing.assert_allclose(found, wanted, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("kind", KINDS)
def test_textbook_view_knows_them(kind):
    scene, *_ = acting(kind)
    assert agreement(scene)[0] < 1e-10


# -- energy -------------------------------------------------------------------------------------------


def check_energy(scene, start, backend="llvm", span=2.0):
    model = da.compile_model(scene, backend=backend)
    method = {} if backend in ("jax", "numpy") else {"method": "taylor"}
    run = model.simulate((0, span), start, known(model), rtol=1e-12, atol=1e-13, **method)
    assert run.success, run.message
    assert np.ptp(run["energy"]) < 1e-10 * max(1.0, np.abs(run["potential_energy"]).max())
    assert np.ptp(run["potential_energy"]) > 0.05
    return model, run


@pytest.mark.parametrize("kind", ["LinearSpring", "DuffingSpring", "ForceActuator", "ObstacleSetPathway"])
def test_energy_is_conserved(kind):
    scene, start, _ = acting(kind)
    model, _ = check_energy(scene, start)
    assert len(model.stages.equations.load_energy.included) == 1
    assert model.stages.program.energy_note == ""


@pytest.mark.parametrize("backend", ["numba", "numpy"])
def test_energy_of_torques_on_other_backends(backend):
    scene, N, A, B = discs()
    scene.add_actuators(TorqueActuator(-k * (a - b), N.z, A, B))
    check_energy(scene, TURN, backend)


def test_spring_stores_what_it_should():
    scene, start, _ = acting("LinearSpring")
    model = da.compile_model(scene, backend="numpy")
    run = model.simulate((0, 0.1), start, known(model))
    length = np.hypot(START["u"] - START["x"], START["v"] - START["y"])
    assert run["potential_energy"][0] == pytest.approx(P_VALUES[k] / 2 * (length - P_VALUES[l]) ** 2, rel=1e-14)


def test_damper_stores_nothing_and_takes_energy():
    scene, start, _ = acting("LinearDamper")
    model = da.compile_model(scene)
    assert model.stages.equations.load_energy.rates == ("LinearDamper(c, LinearPathway(P, Q))",)
    run = model.simulate((0, 1), start, known(model), rtol=1e-11)
    assert np.all(run["potential_energy"] == 0) and np.all(np.diff(run["energy"]) < 0)


def test_energy_of_a_released_spring():
    """The pathway is written without the released coordinate, and equal to it where the constraint holds."""
    N, O = ReferenceFrame("N"), Point("O")
    tip = O.locatenew("P", 0.8 * sp.sin(a) * N.x - 0.8 * sp.cos(a) * N.y)
    hook = O.locatenew("H", N.x)
    scene = da.Scene("released", frame=N, origin=O, coordinates=[a])
    scene.add_bodies(Particle("p", tip, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_actuators(LinearSpring(k, LinearPathway(hook, tip), l))
    R = da.unknowns("R")
    scene.add_joints(da.Joint("rod", body="p", at=tip, force=R * (sp.sin(a) * N.x - sp.cos(a) * N.y)))
    released = scene.release(y, tip, N.y)
    start = {"a": 0.3, "a_dot": 1.0}
    _, plain = check_energy(scene, start, span=1.0)
    _, other = check_energy(released, {**start, "y": -0.8 * np.cos(0.3)}, span=1.0)
    assert other["energy"][0] == pytest.approx(plain["energy"][0], rel=1e-13)


# -- a length of zero -----------------------------------------------------------------------------------


@pytest.mark.parametrize("plane", [False, True])
@pytest.mark.parametrize("method", ["auto", "taylor", "dop853", "tsit5"])
def test_motion_through_the_length_zero(plane, method):
    """The force turns round there; the power series of the length does not know, steps do."""
    N, O = ReferenceFrame("N"), Point("O")
    point = O.locatenew("P", x * N.x + (y if plane else 0) * N.y)
    scene = da.Scene("through", frame=N, origin=O, coordinates=[x, y] if plane else [x])
    scene.add_bodies(Particle("p", point, m))
    scene.add_actuators(LinearSpring(k, LinearPathway(O, point), l))
    start = {"x": 1.0, "x_dot": -3.0, **({"y": 0.0, "y_dot": 0.0} if plane else {})}
    p = {m: 1.0, k: 5.0, l: 0.5}
    run = da.compile_model(scene).simulate((0, 1.2), start, p, method=method, rtol=1e-9)
    omega = np.sqrt(5.0)
    times = np.linspace(0, 1, 10_001)
    free = lambda t: 0.5 + 0.5 * np.cos(omega * t) - 3 / omega * np.sin(omega * t)  # noqa: E731
    first = np.nonzero(free(times) < 0)[0][0] * 1e-4
    for _ in range(6):
        first -= free(first) / (-0.5 * omega * np.sin(omega * first) - 3 * np.cos(omega * first))
    speed = np.sqrt(9 + 5 * (0.25 - 0.25))  # as far from l as at the start
    rest = 1.2 - first
    wanted = -(0.5 - 0.5 * np.cos(omega * rest) + speed / omega * np.sin(omega * rest))
    assert run["x"][-1] == pytest.approx(wanted, abs=2e-6)
    assert np.ptp(run["energy"]) < 1e-5


def test_start_at_the_length_zero_is_named():
    scene, _, _, first, second = pair()
    scene.add_actuators(LinearSpring(k, LinearPathway(first, second), l))
    model = da.compile_model(scene, backend="numpy")
    run = model.simulate((0, 1), {**START, "u": START["x"], "v": START["y"]}, known(model))
    assert run.status == Status.NON_FINITE
    wanted = "LinearPathway(P, Q), equilibrium_length=l) has no direction, because 'P' and 'Q' are at the same place"
    assert wanted in run.message


def test_spring_without_length_is_no_kink():
    """The root cancels where a spring has no length of its own."""
    scene, _, _, first, second = pair()
    scene.add_actuators(LinearSpring(k, LinearPathway(first, second)))
    model = da.compile_model(scene)
    assert not model.stages.equations.nonanalytic
    assert model.choose_method("auto", 1e-8, 1e-10) == "taylor"


# -- other ways to the same -------------------------------------------------------------------------------


def test_system_of_sympy_has_the_same_loads():
    scene, start, _ = acting("LinearSpring")
    system = System(scene.frame, scene.origin)
    system.add_coordinates(*scene.coordinates)
    speeds = dynamicsymbols("s1:5")
    system.add_speeds(*speeds)
    system.add_kdes(*(s - q.diff() for s, q in zip(speeds, scene.coordinates, strict=True)))
    system.add_bodies(*scene.bodies)
    system.add_actuators(*scene.actuators)
    models = [da.compile_model(source, backend="numpy") for source in (scene, da.Scene.from_sympy(system))]
    q, qdot = (np.array([start[q.func.__name__ + end] for q in scene.coordinates]) for end in ("", "_dot"))
    found = [model.accelerations(0.0, q, qdot, known(model)) for model in models]
    np.testing.assert_allclose(*found, rtol=1e-14)


def test_in_a_scene_with_friction():
    """A block on rough ground at the end of a spring and a damper sticks where the spring cannot move it."""
    N, O = ReferenceFrame("N"), Point("O")
    P, wall = O.locatenew("P", x * N.x + y * N.y), O.locatenew("W", -N.x)
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("block", P, m))
    scene.add_actuators(LinearSpring(k, LinearPathway(wall, P), l), LinearDamper(c, LinearPathway(wall, P)))
    scene.apply_uniform_gravity(-g * N.y)
    X, Y = da.unknowns("X Y")
    scene.add_joints(da.Joint("ground", body="block", at=P, force=X * N.x + Y * N.y))
    scene.add_holonomic_constraints(y)
    scene.add_friction(da.CoulombFriction(Y, X, mu=r))
    model = da.compile_model(scene, backend="numpy", outputs=["X"])
    run = model.simulate((0, 6), {"x": 2, "x_dot": 0, "y": 0}, {s: P_VALUES[s] for s in (m, k, l, c, g, r)})
    assert run.phases[-1].modes["Y"] == "stick"
    assert run["X"][-1] == pytest.approx(P_VALUES[k] * (run["x"][-1] + 1 - P_VALUES[l]), rel=1e-9)


# -- faults -------------------------------------------------------------------------------------------------


def test_faults():
    scene, _, _, first, second = pair()
    scene.add_actuators(
        LinearSpring(k, LinearPathway(first, first.locatenew("P2", 0 * scene.frame.x))),
        "spring",
        LinearSpring(k, LinearPathway(first, Point("Z"))),
        ForceActuator(a, LinearPathway(first, second)),
    )
    with pytest.raises(SceneError) as caught:
        da.compile_model(scene, backend="numpy")
    text = str(caught.value)
    assert "has no direction, because the points 'P' and 'P2' are at the same place" in text
    assert "'spring' is not an actuator of sympy.physics.mechanics, which are LinearSpring, DuffingSpring" in text
    assert "LinearSpring(k, LinearPathway(P, Z)) gives no loads" in text
    assert "ForceActuator(a, LinearPathway(P, Q)): force at 'P': a(t) is a function of time" in text


def test_pathway_whose_loads_do_the_opposite():
    """SymPy's loads along a geodesic pull where it says that they push; with the sign that is meant, all is well."""
    N, O = ReferenceFrame("N"), Point("O")
    A = N.orientnew("A", "Axis", (a, N.z))
    start, end = O.locatenew("S", r * N.x), O.locatenew("E", r * A.x)
    scene = da.Scene("drum", frame=N, origin=O, coordinates=[a])
    scene.add_bodies(RigidBody("drum", O, A, m, (inertia(A, J, J, J), O)))
    spring = LinearSpring(k, WrappingPathway(start, end, WrappingCylinder(r, O, N.z)), l)
    wrong = scene.copy()
    wrong.add_actuators(spring)
    with pytest.raises(SceneError, match=r"pull the ends together.*scene\.add_loads\(\*pathway\.to_loads\(-force\)\)"):
        da.compile_model(wrong, backend="numpy")
    scene.add_loads(*spring.pathway.to_loads(-spring.force))
    _, run = check_energy(scene, {"a": 0.9, "a_dot": 0.5}, "numpy")
    stored = P_VALUES[k] / 2 * (P_VALUES[r] * run["a"] - P_VALUES[l]) ** 2
    np.testing.assert_allclose(np.diff(run["potential_energy"]), np.diff(stored), rtol=0, atol=1e-12)


def test_scene_without_positions():
    scene = da.Scene.from_sympy(LagrangesMethod(m * x.diff() ** 2 / 2, [x]))
    scene.add_actuators(acting("LinearSpring")[0].actuators[0])
    with pytest.raises(SceneError, match="no positions, cannot have actuators"):
        da.compile_model(scene, backend="numpy")
