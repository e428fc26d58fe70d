"""Discs and spheres that roll: motions of constraints by hand, reactions by Newton's law, closed forms, faults."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import SceneError
from scene.sympy_trees import T, newton_euler, values_at

m, r, g = sp.symbols("m r g", positive=True)
N, O = ReferenceFrame("N"), Point("O")
COIN = {m: 0.1, r: 0.2, g: 9.81}
TIMES = {"rtol": 1e-11, "t_eval": [0, 1.5, 3]}


def coin(*, six):
    """Return a coin, in coordinates of its contact point or with the height of its centre, and its parts."""
    x, y, z, heading, lean, spin = dynamicsymbols("x y z heading lean spin")
    H = N.orientnew("H", "Axis", (heading, N.z))
    L = H.orientnew("L", "Axis", (lean, H.x))
    D = L.orientnew("D", "Axis", (spin, L.y))
    if six:
        coordinates, G = [x, y, z, heading, lean, spin], O.locatenew("G", x * N.x + y * N.y + z * N.z)
    else:
        coordinates = [x, y, heading, lean, spin]
        G = O.locatenew("P", x * N.x + y * N.y).locatenew("G", r * L.z)
    scene = da.Scene("coin", frame=N, origin=O, coordinates=coordinates)
    scene.add_bodies(RigidBody("coin", G, D, m, (inertia(D, m * r**2 / 4, m * r**2 / 2, m * r**2 / 4), G)))
    scene.apply_uniform_gravity(-g * N.z)
    return scene, G, L, D


@pytest.fixture(scope="module")
def by_hand():
    scene, G, L, D = coin(six=False)
    touching = G.pos_from(O).dt(N) + D.ang_vel_in(N).cross(-r * L.z)
    scene.add_nonholonomic_constraints(touching.dot(N.x), touching.dot(N.y))
    start = {"x": 0, "y": 0, "heading": 0, "lean": 0.3, "spin": 0, "heading_dot": 0.8, "lean_dot": 0, "spin_dot": 4.0}
    return start, da.compile_model(scene, outputs=[G], cache=False).simulate((0, 3), start, COIN, **TIMES)


@pytest.mark.parametrize("six", [False, True])
def test_a_coin(by_hand, six):
    start, exact = by_hand
    scene, G, _, D = coin(six=six)
    scene.add_joints(da.RollingDisc("coin", "coin", centre=G, radius=r, axis=D.y, plane=(O, N.z)))
    assert (len(scene.holonomic_constraints), len(scene.nonholonomic_constraints)) == (int(six), 2)
    outputs = {f"{q.func.__name__}_ddot": q.diff(T, 2) for q in scene.coordinates}
    outputs |= {**scene.reaction("coin"), **scene.reaction("coin", frame=N), "G": G, "slip": "coin.slip_1"}
    model = da.compile_model(scene, outputs=outputs, cache=False)
    if six:
        start = {**start, **{axis: exact[f"G_{axis}"][0] for axis in "xyz"}}
    run = model.simulate((0, 3), start, COIN, **TIMES)
    for axis in "xyz":
        assert run[f"G_{axis}"] == pytest.approx(exact[f"G_{axis}"], abs=1e-9)
    needed = newton_euler(G, N, scene.bodies, N, O, scene.gravity, values_at(run, -1, scene, COIN))[:3]
    assert [run[f"coin.force_{axis} on N"][-1] for axis in "xyz"] == pytest.approx(needed, abs=1e-11)
    assert run["coin.normal"][-1] == pytest.approx(needed[2], abs=1e-11) and needed[2] < 0.1 * 9.81
    assert np.hypot(run["coin.friction_1"], run["coin.friction_2"])[-1] == pytest.approx(np.hypot(*needed[:2]))
    assert np.abs(run["slip"]).max() < 1e-10
    assert "joint         coin: 'coin' rolls on the fixed frame: 2 constraints on velocities" in model.explain()


def sphere(scene, frame, moment, place):
    """Add a sphere with a quaternion at a place; return its centre."""
    da.free_orientation(scene, frame)
    G = O.locatenew("G", place)
    scene.add_bodies(RigidBody("ball", G, frame, m, (inertia(frame, moment, moment, moment), G)))
    return G


SPIN = {"omega_S_x": 0, "omega_S_y": 0, "omega_S_z": 0}
UPRIGHT = {"e0_S": 1, "e1_S": 0, "e2_S": 0, "e3_S": 0}


def test_a_sphere_on_a_slope():
    """A homogeneous one accelerates at 5/7 g sin(alpha), with a friction of 2/7 m g sin(alpha)."""
    x, y, S = *dynamicsymbols("x y"), ReferenceFrame("S")
    scene = da.Scene("slope", frame=N, origin=O, coordinates=[x, y])
    G = sphere(scene, S, 2 * m * r**2 / 5, x * N.x + y * N.y + r * N.z)
    scene.apply_uniform_gravity(9.81 * (0.6 * N.x - 0.8 * N.z))
    scene.add_joints(da.RollingSphere("ball", "ball", centre=G, radius=r, plane=(O, N.z)))
    model = da.compile_model(scene, outputs=list(scene.reaction("ball")), backend="numpy", cache=False)
    run = model.simulate((0, 1), {x: 0, y: 0, **UPRIGHT, **SPIN}, {m: 2, r: 0.1}, rtol=1e-10)
    assert run["x"][-1] == pytest.approx(5 / 7 * 9.81 * 0.6 / 2, abs=1e-8)
    assert run["ball.normal"] == pytest.approx(2 * 9.81 * 0.8, abs=1e-10)
    assert run["ball.friction_1"] == pytest.approx(-2 / 7 * 2 * 9.81 * 0.6, abs=1e-10)
    assert run["ball.friction_2"] == pytest.approx(0, abs=1e-12)


def test_a_sphere_on_a_turning_table():
    """The centre runs round a circle at 2/7 of the table's rate (Earnshaw)."""
    x, y, S = *dynamicsymbols("x y"), ReferenceFrame("S")
    rate = sp.Symbol("Omega", positive=True)
    table = N.orientnew("table", "Axis", (rate * T, N.z))
    scene = da.Scene("table", frame=N, origin=O, coordinates=[x, y])
    G = sphere(scene, S, 2 * m * r**2 / 5, x * N.x + y * N.y + r * N.z)
    scene.add_bodies(RigidBody("table", O, table, 1, (inertia(table, 1, 1, 1), O)))
    scene.add_joints(da.RollingSphere("ball", "ball", centre=G, radius=r, plane=(O, table.z), other="table"))
    model = da.compile_model(scene, backend="numpy", cache=False)
    start = {x: 0.3, y: 0, "x_dot": 0, "y_dot": 0.4, **UPRIGHT, "omega_S_z": 0}
    run = model.simulate((0, 2), start, {m: 2, r: 0.1, rate: 3.0}, rtol=1e-11, t_eval=np.linspace(0, 2, 5))
    turn = 2 / 7 * 3.0 * run.t
    assert run["x_dot"] == pytest.approx(-0.4 * np.sin(turn), abs=1e-8)
    assert run["y_dot"] == pytest.approx(0.4 * np.cos(turn), abs=1e-8)


def test_a_wheel_in_a_plane():
    """Of two slip velocities one vanishes by itself; a torque M drives a hoop at M / (2 m r)."""
    x, a, torque = *dynamicsymbols("x a"), sp.Symbol("M")
    W = N.orientnew("W", "Axis", (a, N.z))
    C = O.locatenew("C", x * N.x + r * N.y)
    scene = da.Scene("wheel", frame=N, origin=O, coordinates=[x, a])
    scene.add_bodies(RigidBody("wheel", C, W, m, (inertia(W, 0, 0, m * r**2), C)))
    scene.add_loads((W, -torque * N.z))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_joints(da.RollingDisc("wheel", "wheel", centre=C, radius=r, axis=W.z, plane=(O, N.y)))
    assert len(scene.nonholonomic_constraints) == 1 and not scene.holonomic_constraints
    model = da.compile_model(scene, outputs=["wheel.normal", "wheel.friction_1"], backend="numpy", cache=False)
    run = model.simulate((0, 1), {x: 0, a: 0, "x_dot": 0}, {m: 2, r: 0.25, g: 9.81, torque: 3.0}, rtol=1e-10)
    assert run["x"][-1] == pytest.approx(3.0 / (2 * 2 * 0.25) / 2, abs=1e-9)
    assert run["wheel.normal"] == pytest.approx(2 * 9.81, abs=1e-12)
    assert np.abs(run["wheel.friction_1"]) == pytest.approx(2 * 3.0 / (2 * 2 * 0.25), abs=1e-12)


def test_faults():
    scene, G, L, D = coin(six=True)
    scene.add_bodies(Particle("bead", O.locatenew("B", 0), m))
    good = {"name": "coin", "body": "coin", "centre": G, "radius": r, "axis": D.y, "plane": (O, N.z)}
    for changed, text in (
        ({"body": "wheel"}, "'wheel' is no body of the scene; known: coin, bead"),
        ({"body": "bead"}, "its body must be a RigidBody"),
        ({"other": "bead"}, "its plane cannot be that of a particle"),
        ({"plane": N.z}, "plane must be a point and a normal, such as (O, N.z)"),
        ({"plane": (N.z, O)}, "the point of plane must be a Point"),
        ({"plane": (O, 2 * N.z)}, "the normal 2*N.z is not a unit vector"),
        ({"plane": (O, L.z)}, "the normal L.z is not fixed in the fixed frame"),
        ({"axis": N.x}, "the axis N.x is not fixed in 'coin'"),
        ({"radius": -1}, "radius must be a positive length, not -1"),
        ({"centre": O}, "the point 'O' is not fixed on 'coin'; locate it from a point of 'coin'"),
        ({"centre": Point("lost")}, "the point 'lost' is not located from 'O'"),
    ):
        with pytest.raises(SceneError) as caught:
            scene.add_joints(da.RollingDisc(**good | changed))
        assert text in str(caught.value)


def test_a_ball_on_a_turntable_goes_round_in_a_circle():
    """At 2/7 of the table's angular velocity (E. J. Routh, Dynamics of a System of Rigid Bodies II, 1905, ch. V)."""
    x, y, z = dynamicsymbols("x y z")
    table, speed = N.orientnew("table", "Axis", (2 * T, N.z)), 2.0
    S = ReferenceFrame("S")
    scene = da.Scene("table", frame=N, origin=O, coordinates=[x, y, z])
    G = sphere(scene, S, 2 * m * r**2 / 5, x * N.x + y * N.y + z * N.z)
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_joints(da.RollingSphere("floor", "ball", centre=G, radius=r, plane=(O, table.z)))
    forces = scene.reaction("floor", frame=N)
    model = da.compile_model(scene, outputs={**forces, "x_ddot": x.diff(T, 2), "y_ddot": y.diff(T, 2)}, cache=False)
    at, v = np.array([0.4, 0.2]), np.array([0.3, 0.1])
    start = {"x": at[0], "y": at[1], "z": 0.2, "x_dot": v[0], "y_dot": v[1], "z_dot": 0}
    rates = {"omega_S_x": -(v[1] - speed * at[0]) / 0.2, "omega_S_y": (v[0] + speed * at[1]) / 0.2, "omega_S_z": 0.3}
    pose = {"e0_S": 1, "e1_S": 0, "e2_S": 0, "e3_S": 0}
    run = model.simulate((0, 3), start | rates | pose, COIN, **TIMES)
    w, t = 2 * speed / 7, run.t
    turned = np.array([[np.sin(w * t), np.cos(w * t) - 1], [1 - np.cos(w * t), np.sin(w * t)]]) / w
    x_t, y_t = at[:, None] + np.einsum("ijt,j->it", turned, v)
    np.testing.assert_allclose(run["x"], x_t, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run["y"], y_t, rtol=0, atol=1e-9)
    for axis in "xy":
        pushed = run[f"floor.force_{axis} on N"]
        np.testing.assert_allclose(pushed, 0.1 * run[f"{axis}_ddot"], rtol=0, atol=1e-10)


def test_a_disc_on_a_turntable_moves_as_by_hand():
    runs = []
    table = N.orientnew("table", "Axis", (2 * T, N.z))
    for joint in (True, False):
        scene, G, L, D = coin(six=False)
        if joint:
            scene.add_joints(da.RollingDisc("coin", "coin", centre=G, radius=r, axis=D.y, plane=(O, table.z)))
        else:
            touching = G.pos_from(O).dt(N) + D.ang_vel_in(N).cross(-r * L.z)
            slip = touching - (2 * N.z).cross(G.pos_from(O) - r * L.z)
            scene.add_nonholonomic_constraints(slip.dot(N.x), slip.dot(N.y))
        start = {"x": 0.2, "y": 0, "heading": 0, "lean": 0.3, "spin": 0, "heading_dot": 0.8, "lean_dot": 0}
        runs.append(da.compile_model(scene, cache=False).simulate((0, 3), start | {"spin_dot": 4.0}, COIN, **TIMES))
    for name in ("x", "y", "heading", "lean", "spin"):
        np.testing.assert_allclose(runs[0][name], runs[1][name], rtol=0, atol=1e-8)


def test_a_normal_on_a_frame_that_turns_with_coordinates_is_that_of_a_floor_at_rest(by_hand):
    start, exact = by_hand
    scene, G, L, D = coin(six=False)
    heading = next(frame for frame in L._dcm_dict if frame.name == "H")
    scene.add_joints(da.RollingDisc("coin", "coin", centre=G, radius=r, axis=D.y, plane=(O, heading.z)))
    run = da.compile_model(scene, outputs=[G], cache=False).simulate((0, 3), start, COIN, **TIMES)
    for axis in "xyz":
        assert run[f"G_{axis}"] == pytest.approx(exact[f"G_{axis}"], abs=1e-9)
