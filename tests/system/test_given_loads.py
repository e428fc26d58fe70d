"""Friction with a given normal load, and coefficients that are functions of the slip speed."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from sympy import Piecewise, exp, sin, sqrt, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import ConstraintError, SceneError

N, O = ReferenceFrame("N"), Point("O")
angle, x, y, z = dynamicsymbols("angle x y z")
m, J, T_0, k, g, r, mu, arm = symbols("m J T_0 k g r mu arm", positive=True)
T = da.unknowns("T")
TIME = dynamicsymbols._t
STILL = {angle: 0, angle.diff(): 0}


def rotor(normal=T_0, load=0, **law):
    scene = da.Scene("rotor", frame=N, origin=O, coordinates=[angle])
    S = N.orientnew("S", "Axis", (angle, N.z))
    scene.add_bodies(RigidBody("rotor", O, S, m, (inertia(S, 0, 0, J), O)))
    scene.add_loads((S, load * N.z))
    scene.add_joints(da.Joint("bearing", body="rotor", at=O, torque=T * N.z))
    scene.add_friction(da.CoulombFriction(**({"normal": normal, "tangential": T, "mu": 1, "name": "bearing"} | law)))
    return scene


def states(run):
    return [phase.modes["bearing"] for phase in run.phases]


def test_a_bearing_stops_a_rotor_and_holds_it():
    """omega falls by T_0 / J; a spring is held within the dead band (2 n T_0 / k less amplitude each half turn)."""
    model = da.compile_model(rotor(load=-k * angle), outputs=["T", "bearing.normal"])
    p = {m: 1, J: 2, T_0: 3, k: 0}
    run = model.simulate((0, 3), {angle: 0, angle.diff(): 3}, p)
    assert run.success and states(run) == ["slip", "stick"] and abs(run.phases[1].t0 - 2) < 1e-12
    assert abs(run["angle"][-1] - 3) < 1e-12 and set(run["bearing.normal"]) == {3.0} and run["T"][0] == -3
    run = model.simulate((0, 30), {angle: 1.02, angle.diff(): 0}, {**p, T_0: 0.5, k: 8})
    halves, rest = 8, 1.02 - 8 * 0.125
    assert states(run) == ["slip"] * halves + ["stick"]
    assert abs(run.phases[halves].t0 - halves * np.pi / 2) < 1e-8
    assert abs(run["angle"][-1] - rest) < 1e-9 and abs(run["T"][-1] - 8 * rest) < 1e-8


def test_a_clamp_opens_and_closes():
    """It holds until t = 1, lets go until t = 2, and stops what has begun to turn at t = 3."""
    clamp = Piecewise((2, TIME < 1), (0, TIME < 2), (2, True))
    model = da.compile_model(rotor(clamp, load=1))
    run = model.simulate((0, 4), STILL, {m: 1, J: 2})
    assert run.success and states(run) == ["stick", "slip", "stick"]
    assert np.allclose([phase.t0 for phase in run.phases], [0, 1, 3], atol=1e-12, rtol=0)
    assert abs(run["angle"][-1] - (0.25 + 0.25)) < 1e-12
    sweep = model.sweep((0, 4), STILL, {m: 1, J: np.array([2.0, 4.0])})
    assert sweep.success.all() and abs(sweep["angle"] - [0.5, 0.25]).max() < 1e-12


def test_the_size_of_a_load_counts():
    model, start = da.compile_model(rotor(T_0 * sin(TIME))), {angle: 0, angle.diff(): 5}
    run = model.simulate((0, 10), start, {m: 1, J: 2, T_0: 1}, rtol=1e-11)
    assert run.success and abs(run["angle_dot"][-1] - (5 - (7 + np.cos(10)) / 2)) < 1e-9


def test_an_impact_transmits_nothing_of_a_given_load():
    """A body in a clamp is struck: momentum goes to it, and the clamp stops it afterwards."""
    a, b = O.locatenew("a", x * N.x), O.locatenew("b", y * N.x)
    scene = da.Scene("struck", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("a", a, m), Particle("b", b, m))
    scene.add_joints(da.Joint("clamp", body="b", at=b, force=T * N.x))
    scene.add_friction(da.CoulombFriction(T_0, T, mu=mu, name="clamp"))
    scene.add_contacts(da.SphereSphere("touch", bodies=("b", "a"), centres=(b, a), radii=(r, r), restitution=1))
    start = {x: 0, y: 1, x.diff(): 1, y.diff(): 0}
    for backend in ("llvm", "numpy"):
        run = da.compile_model(scene, backend=backend).simulate((0, 4), start, {m: 1, r: 0.1, T_0: 2, mu: 0.25})
        assert [phase.modes["clamp"] for phase in run.phases] == ["stick", "slip", "stick"]
        assert np.allclose([phase.t0 for phase in run.phases], [0, 0.8, 2.8], atol=1e-10, rtol=0)
        assert abs(run["y"][-1] - 2) < 1e-10 and abs(run["x"][-1] - 0.8) < 1e-10


def test_rolling_resistance_of_a_ball():
    """A rolling ball decelerates by 5/7 g arm / r (moment arm m g about its contact point, inertia 7/5 m r^2)."""
    scene = da.Scene("slow", frame=N, origin=O, coordinates=[x, y, angle])
    S, G = N.orientnew("S", "Axis", (angle, N.z)), O.locatenew("G", x * N.x + y * N.y)
    scene.add_bodies(RigidBody("ball", G, S, m, (inertia(S, 0, 0, 2 * m * r**2 / 5), G)))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_contacts(da.SpherePlane("floor", body="ball", centre=G, radius=r, plane=(O, N.y), friction=mu))
    scene.add_joints(da.Joint("rolling", body="ball", at=G, torque=T * N.z))
    scene.add_friction(da.CoulombFriction(normal=m * g, tangential=T, mu=arm, name="rolling"))
    start = {x: 0, y: 0.1, angle: 0, x.diff(): 1, y.diff(): 0, angle.diff(): -10}
    run = da.compile_model(scene).simulate((0, 3), start, {m: 0.2, g: 9.81, r: 0.1, mu: 0.5, arm: 0.01})
    slowed = 5 / 7 * 9.81 * 0.1
    assert run.success and abs(run.phases[-1].t0 - 1 / slowed) < 1e-10
    assert abs(run["x"][-1] - 1 / (2 * slowed)) < 1e-10 and run.phases[-1].modes == {
        "floor": "stick",
        "rolling": "stick",
    }


CURVE = {"mk": 0.1, "ms": 0.3, "vs": 0.5, "c": 0.2}
mk, ms, vs, c = symbols("mk ms vs c", positive=True)


def stribeck(v):
    return mk + (ms - mk) * exp(-((v / vs) ** 2)) + c * v


def mu_at(v):
    return 0.1 + 0.2 * np.exp(-((v / 0.5) ** 2)) + 0.2 * v


def test_a_stribeck_curve_along_a_line():
    """A block that slows down by mu(v) g, and sticks on while it is pushed by less than mu(0) m g."""
    block, push = O.locatenew("B", x * N.x + y * N.y), symbols("push")
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("block", block, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_loads((block, push * TIME * N.x))
    law = da.CoulombFriction(mu=stribeck)
    scene.add_contacts(da.PointPlane("floor", body="block", point=block, plane=(O, N.y), friction=law))
    model = da.compile_model(scene, outputs=["floor.friction_1"])
    p, start = {m: 1, g: 10, push: 0, **CURVE}, {x: 0, y: 0, y.diff(): 0}
    run = model.simulate((0, 2), {**start, x.diff(): 3}, p, rtol=1e-11)
    stop = lambda t, s: s[1]  # noqa: E731
    stop.terminal = True
    exact = solve_ivp(
        lambda t, s: [s[1], -10 * mu_at(s[1])], (0, 2), [0, 3], events=stop, rtol=1e-12, atol=1e-13, method="DOP853"
    )
    assert run.success and abs(run.phases[1].t0 - exact.t[-1]) < 1e-10
    assert abs(run["x"][-1] - exact.y[0, -1]) < 1e-10
    run = model.simulate((0, 3.5), {**start, x.diff(): 0}, {**p, push: 1})
    assert [phase.modes["floor"] for phase in run.phases] == ["stick", "slip"]
    assert abs(run.phases[1].t0 - 3) < 1e-10  # mu(0) m g = 3
    slides = run.t > 3
    assert abs(run["floor.friction_1"] + 10 * mu_at(run["x_dot"]))[slides].max() < 1e-9


def test_a_stribeck_curve_in_a_plane():
    puck = O.locatenew("A", x * N.x + y * N.y + z * N.z)
    scene = da.Scene("puck", frame=N, origin=O, coordinates=[x, y, z])
    scene.add_bodies(Particle("puck", puck, m))
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_loads((puck, -4 * m * x * N.x))
    law = da.CoulombFriction(mu=stribeck)
    scene.add_contacts(da.PointPlane("floor", body="puck", point=puck, plane=(O, N.z), friction=law))
    start = {x: 0.2, y: 0, z: 0, x.diff(): 1, y.diff(): 2, z.diff(): 0}
    run = da.compile_model(scene).simulate((0, 0.6), start, {m: 1, g: 10, **CURVE}, rtol=1e-11)

    def rates(t, s):
        v = np.hypot(s[2], s[3])
        return [s[2], s[3], -10 * mu_at(v) * s[2] / v - 4 * s[0], -10 * mu_at(v) * s[3] / v]

    exact = solve_ivp(rates, (0, 0.6), [0.2, 0, 1, 2], rtol=1e-12, atol=1e-13, method="DOP853").y[:, -1]
    assert run.success and len(run.phases) == 1
    assert abs(np.array([run[name][-1] for name in ("x", "y", "x_dot", "y_dot")]) - exact).max() < 1e-9


def test_the_smooth_law_has_the_load_and_the_curve():
    law = {"mu": lambda v: 1 + v, "regularization": 1e-3}
    run = da.compile_model(rotor(**law), outputs=["T"]).simulate(
        (0, 1), {angle: 0, angle.diff(): 3}, {m: 1, J: 2, T_0: 2}
    )
    w = run["angle_dot"]
    size = np.sqrt(w**2 + 1e-6)
    assert run.success and abs(run["T"] + 2 * (1 + size) * w / size).max() < 1e-9


@pytest.mark.parametrize(
    "law, texts",
    [
        ({"name": None}, ["normal load T_0 has no name", "name="]),
        ({"normal": -1}, ["normal load of friction 'bearing' is -1", "not be negative"]),
        ({"normal": T}, ["normal and tangential reactions must be different"]),
        ({"normal": da.unknowns("Z")}, ["Z", "no unknown of a joint"]),
        ({"normal": sqrt(k**2 + da.unknowns("Z") ** 2)}, ["'bearing' contains Z", "size by hand"]),
        ({"normal": x}, ["x(t)", "coordinates of the scene"]),
        ({"mu": lambda v: undefined + v}, ["mu of friction 'bearing' as a function", "NameError"]),  # noqa: F821
        ({"mu": lambda v: 1 + v, "mu_static": 0.5}, ["mu_static is 0.5, less than mu = 1"]),
    ],
    ids=lambda value: value[0][:30] if isinstance(value, list) else "",
)
def test_faults(law, texts):
    with pytest.raises(SceneError) as error:
        da.compile_model(rotor(**law), backend="numpy")
    assert all(text in str(error.value) for text in texts), str(error.value)


def test_two_laws_of_one_slip_are_refused_as_one_with_a_given_load():
    scene = rotor()
    other = da.unknowns("T_brake")
    scene.add_joints(da.Joint("brake", body="rotor", at=O, torque=other * N.z))
    scene.add_friction(da.CoulombFriction(normal=k, tangential=other, mu=1, name="brake"))
    with pytest.raises(ConstraintError, match="the sum of the loads"):
        da.compile_model(scene, backend="numpy").simulate((0, 1), STILL, {m: 1, J: 1, T_0: 1, k: 1})


@pytest.mark.parametrize("given", [True, False], ids=["clamp", "weight"])
def test_other_reactions_of_a_joint_with_friction(given):
    """A block slides in its one coordinate under a side load k, with friction at the arm r below its centre."""
    Y, Z, M = da.unknowns("Y Z M")
    scene = da.Scene("guided", frame=N, origin=O, coordinates=[x])
    S, G = N.orientnew("S", "Axis", (0, N.z)), O.locatenew("G", x * N.x)
    scene.add_bodies(RigidBody("block", G, S, m, (inertia(S, J, J, J), G)))
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_loads((G, -k * N.y))
    foot = G.locatenew("foot", -r * N.z)
    L, K = da.unknowns("L K")
    force, torque = T * N.x + Y * N.y + Z * N.z, L * N.x + M * N.y + K * N.z
    scene.add_joints(da.Joint("guide", body="block", at=foot, force=force, torque=torque))
    scene.add_friction(da.CoulombFriction(T_0 if given else Z, T, mu=mu, name="guide"))
    model = da.compile_model(scene, backend="numpy", outputs=["T", "Y", "Z", "L", "M", "K"])
    p = {m: 2, J: 1, g: 10, k: 3, r: 0.4, mu: 0.25} | ({T_0: 8} if given else {})
    run = model.simulate((0, 2), {x: 0, x.diff(): 1}, p)
    size = 0.25 * (8 if given else 20)
    assert [phase.modes["guide"] for phase in run.phases] == ["slip", "stick"]
    assert run.phases[1].t0 == pytest.approx(2 / size, rel=1e-9)
    slip = run.t < 2 / size - 1e-9
    for name, value in {"T": -size, "Y": 3, "Z": 20, "L": -0.4 * 3, "M": -0.4 * size, "K": 0}.items():
        np.testing.assert_allclose(run[name][slip], value, rtol=1e-12, atol=1e-12)
        held = 0 if name in "TM" else value
        np.testing.assert_allclose(run[name][-1], held, rtol=1e-12, atol=1e-12)
