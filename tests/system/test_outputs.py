"""Outputs: accelerations, vectors, names of the user's choice, and what they clash with."""

import pickle

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import (
    KanesMethod,
    LinearPathway,
    LinearSpring,
    Particle,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da
from dalembert.errors import OptionError, SceneError, UnknownNameError

pytestmark = pytest.mark.usefixtures("quick_xla")

T = dynamicsymbols._t
a, b = dynamicsymbols("a b")
m, l, g, k = sp.symbols("m l g k", positive=True)
N, O = ReferenceFrame("N"), Point("O")
A = N.orientnew("A", "Axis", (a, N.z))
B = A.orientnew("B", "Axis", (b, A.z))
P = O.locatenew("P", l * A.x)
Q = P.locatenew("Q", l * B.x)
VELOCITY = Q.pos_from(O).dt(N)
ACCELERATION = VELOCITY.dt(N)
VALUES = {m: 1.2, l: 0.7, g: 9.81}
START = {"a": 0.3, "b": 0.5, "a_dot": 1.0, "b_dot": -2.0}
WANTED = {
    "height": Q.pos_from(O).dot(N.y),
    "v": VELOCITY,
    "acc": ACCELERATION,
    "tip": Q,
    "E": "energy",
    "spin": "a_dot",
    "alpha": a.diff(T, 2),
    "tension": -m * (ACCELERATION + g * N.y).dot(B.x),
}


def double_pendulum():
    scene = da.Scene("double_pendulum", frame=N, origin=O, coordinates=[a, b])
    scene.add_bodies(Particle("p", P, m), Particle("q", Q, m))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def by_hand(q, rate):
    """Return accelerations of the angles, velocity and acceleration of the tip, and tension, by Newton's laws.

    The unknowns are both accelerations (four numbers) and both tensions.
    """
    (a1, b1), (w1, w2), L, M, G = q, rate, 0.7, 1.2, 9.81
    c1, c2 = a1, a1 + b1
    s1, s2 = w1, w1 + w2
    e1, e2 = np.array([np.cos(c1), np.sin(c1)]), np.array([np.cos(c2), np.sin(c2)])
    n1, n2 = np.array([-e1[1], e1[0]]), np.array([-e2[1], e2[0]])
    # unknowns alpha1, alpha1 + alpha2, tension of the first rod, of the second
    matrix, right = np.zeros((4, 4)), np.zeros(4)
    matrix[:2, 0], matrix[:2, 2], matrix[:2, 3] = M * L * n1, e1, -e2
    right[:2] = M * L * s1**2 * e1 - M * G * np.array([0, 1])
    matrix[2:, 0], matrix[2:, 1], matrix[2:, 3] = M * L * n1, M * L * n2, e2
    right[2:] = M * L * (s1**2 * e1 + s2**2 * e2) - M * G * np.array([0, 1])
    first, second, _, tension = np.linalg.solve(matrix, right)
    velocity = L * (s1 * n1 + s2 * n2)
    acceleration = L * (first * n1 - s1**2 * e1 + second * n2 - s2**2 * e2)
    return np.array([first, second - first]), velocity, acceleration, tension


def check_run(run):
    for i in range(len(run.t)):
        alpha, velocity, acceleration, tension = by_hand(run.q[i], run.qdot[i])
        assert run["alpha"][i] == pytest.approx(alpha[0], rel=1e-11, abs=1e-11)
        found = [run[name][i] for name in ("v_x", "v_y", "acc_x", "acc_y", "tension")]
        np.testing.assert_allclose(found, [*velocity, *acceleration, tension], rtol=1e-11, atol=1e-10)
    assert np.all(run["v_z"] == 0) and np.all(run["acc_z"] == 0)
    # two kernels: NumPy's functions round differently for one value and for many where it has vector forms of them
    np.testing.assert_allclose(run["E"], run["energy"], rtol=4e-15)
    np.testing.assert_array_equal(run["spin"], run["a_dot"])
    np.testing.assert_allclose(run["height"], run["tip_y"], rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("backend", ["llvm", "numba", "numpy"])
@pytest.mark.parametrize("formulation", ["minimal", "projected"])
def test_values_by_newton(backend, formulation):
    model = da.compile_model(double_pendulum(), backend=backend, formulation=formulation, outputs=WANTED)
    names = "height v_x v_y v_z acc_x acc_y acc_z tip_x tip_y tip_z E spin alpha tension"
    assert model.layout.outputs == tuple(names.split())
    check_run(model.simulate((0, 1), START, VALUES, t_eval=np.linspace(0, 1, 6)))


def test_values_on_jax():
    """A spring, a joint between two bodies, accelerations, vectors, and a parameter of an event, in one run."""
    u, w = dynamicsymbols("u w")
    scene = double_pendulum()
    scene.add_actuators(LinearSpring(k, LinearPathway(O, Q)))
    R, S = da.unknowns("R S")
    scene.add_joints(da.Joint("rod", body="q", other="p", at=P, force=R * B.x + S * B.y))
    released = scene.release(u, Q, N.x).release(w, Q, N.y)
    outputs = {"acc": ACCELERATION, "alpha": a.diff(T, 2), "pull": R}
    level = sp.Symbol("level", positive=True)
    start = {**START, "u": 0.7 * (np.cos(0.3) + np.cos(0.8)), "w": 0.7 * (np.sin(0.3) + np.sin(0.8))}
    found, wanted = (
        da.compile_model(released, backend=backend, outputs=outputs).simulate(
            (0, 0.5), start, {**VALUES, k: 3.0, level: 0.2}, t_eval=[0, 0.5], events=[da.Event(a - level, name="low")]
        )
        for backend in ("jax", "numpy")
    )
    for name in ("acc_x", "acc_y", "acc_z", "alpha", "pull"):
        np.testing.assert_allclose(found[name], wanted[name], rtol=1e-6, atol=1e-12)
    assert len(found.events["low"].t) == len(wanted.events["low"].t) > 0
    np.testing.assert_allclose(found.events["low"].t, wanted.events["low"].t, rtol=1e-6)
    assert np.ptp(found["energy"]) < 1e-6


def test_lists_of_outputs():
    """An acceleration is called like the rate; a vector without a name by its text."""
    speed = a.diff() * N.x
    model = da.compile_model(
        double_pendulum(), backend="numpy", outputs=[a.diff(T, 2), "b_ddot", b.diff(T, 2) + a, speed]
    )
    assert model.layout.outputs[:3] == ("a_ddot", "b_ddot", "a(t) + Derivative(b(t), (t, 2))")
    assert model.layout.outputs[3:] == tuple(f"{speed}_{axis}" for axis in "xyz")
    run = model.simulate((0, 0.1), START, VALUES)
    alpha, *_ = by_hand(run.q[-1], run.qdot[-1])
    assert run["a_ddot"][-1] == run[a.diff(T, 2)][-1] == pytest.approx(alpha[0], rel=1e-11)
    assert run["b_ddot"][-1] == pytest.approx(alpha[1], rel=1e-11)
    assert run[b.diff(T, 2) + a][-1] == pytest.approx(alpha[1] + run["a"][-1], rel=1e-11)


def test_sweeps_events_and_reductions():
    model = da.compile_model(double_pendulum(), outputs=WANTED)
    kept = {
        "peak": da.maximum(a.diff(T, 2)),
        "end": da.final(a.diff(T, 2) + 1),
        "mean": da.mean("b_ddot"),
        "low": da.minimum("height"),
    }
    lengths = np.array([0.5, 0.7, 0.9])
    sweep = model.sweep((0, 1), START, {**VALUES, l: lengths}, reduce=kept, rtol=1e-10)
    run = model.simulate((0, 1), START, VALUES, rtol=1e-10, events=[a.diff(T, 2), "b_ddot"])
    ends = [by_hand(run.q[i], run.qdot[i])[0] for i in (0, -1)]
    assert sweep.reduced["end"][1] == pytest.approx(1 + ends[1][0], rel=1e-7)
    assert sweep.reduced["mean"][1] == pytest.approx(run["b_dot"][-1] - run["b_dot"][0], rel=1e-7)
    assert sweep.reduced["low"][1] == pytest.approx(run(np.linspace(0, 1, 2001))["height"].min(), abs=1e-5)
    fine = run(np.linspace(0, 1, 2001))["alpha"]
    assert sweep.reduced["peak"][1] == pytest.approx(fine.max(), rel=1e-5)
    times = run.events[a.diff(T, 2)].t
    assert len(times) == np.sum(np.diff(np.sign(fine)) != 0) > 0
    np.testing.assert_allclose(run(times)["alpha"], 0, atol=1e-8)
    plain = model.sweep((0, 1), START, {**VALUES, l: lengths}, rtol=1e-10)
    assert plain.final["alpha"][1] == pytest.approx(ends[1][0], rel=1e-7)
    assert {"height", "acc_x", "alpha"} <= set(plain.to_xarray()) and "acc_y" in set(run.to_xarray())


def test_in_every_formulation_of_a_loop():
    """The acceleration of the constrained motion, not the stabilised one."""
    x, y = dynamicsymbols("x y")
    point = O.locatenew("R", x * N.x + y * N.y)
    scene = da.Scene("circle", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bead", point, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_holonomic_constraints(x**2 + y**2 - l**2)
    for formulation in ("projected", "baumgarte", "ggl", "augmented"):
        model = da.compile_model(
            scene, backend="numpy", formulation=formulation, outputs={"acc": point.pos_from(O).dt(N).dt(N)}
        )
        run = model.simulate((0, 0.3), {"x": 0.7, "y": 0, "y_dot": 1}, VALUES, rtol=1e-9)
        x1, y1, u1, v1 = *run.q[-1], *run.qdot[-1]
        pull = (u1**2 + v1**2 - 9.81 * y1) / 0.49
        np.testing.assert_allclose([run["acc_x"][-1], run["acc_y"][-1]], [-pull * x1, -pull * y1 - 9.81], rtol=1e-7)


def test_in_a_scene_with_contacts():
    h = dynamicsymbols("h")
    ball = O.locatenew("ball", h * N.y)
    F = da.unknowns("F")
    scene = da.Scene("ball", frame=N, origin=O, coordinates=[h])
    scene.add_bodies(Particle("ball", ball, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_joints(da.Joint("floor", body="ball", at=ball, force=F * N.y))
    scene.add_contacts(da.UnilateralContact(F, h, name="floor"))
    model = da.compile_model(
        scene, backend="numpy", outputs={"acc": h.diff(T, 2), "force": F, "v": ball.pos_from(O).dt(N)}
    )
    run = model.simulate((0, 1), {"h": 1, "h_dot": 0}, {m: 1.2, g: 9.81})
    assert run["acc"][0] == pytest.approx(-9.81) and run["acc"][-1] == 0
    assert run["force"][0] == 0 and run["force"][-1] == pytest.approx(1.2 * 9.81)
    np.testing.assert_array_equal(run["v_y"], run["h_dot"])


def test_angles_and_speeds():
    """Second rates of angles that quaternions stand for, and rates of speeds, are the derivatives of the first."""
    angles = dynamicsymbols("phi theta psi")
    S = ReferenceFrame("S")
    S.orient_body_fixed(N, angles, "ZXZ")
    top = da.Scene("top", frame=N, origin=O, coordinates=angles)
    top.add_bodies(RigidBody("top", O, S, m, (inertia(S, 1, 2, 3), O)))
    start = {"phi": 0.2, "theta": 0.9, "psi": 0.1, "phi_dot": 1, "theta_dot": 0.3, "psi_dot": 2}
    wanted = {"spin": S.ang_vel_in(N), "alpha": angles[1].diff(T, 2)}
    runs = [
        da.compile_model(top, backend="numpy", outputs=wanted, orientation=way).simulate(
            (0, 0.5), start, {m: 1}, rtol=1e-10
        )
        for way in ("scene", "quaternion")
    ]
    for name in ("spin_x", "spin_y", "spin_z", "alpha"):
        assert runs[0][name][-1] == pytest.approx(runs[1][name][-1], rel=1e-7)

    q, u = dynamicsymbols("q u")
    mass = O.locatenew("M", q * N.x)
    mass.set_vel(N, u * N.x)
    O.set_vel(N, 0)
    kane = KanesMethod(N, [q], [u], kd_eqs=[q.diff() - u])
    kane.kanes_equations([Particle("mass", mass, m)], [(mass, -k * q * N.x)])
    run = da.compile_model(kane, backend="numpy", outputs={"rate": u.diff()}).simulate(
        (0, 1), {q: 1, u: 0}, {m: 1, k: 4}
    )
    np.testing.assert_allclose(run["rate"], -4 * run["q"], rtol=1e-13)


def test_rates_of_first_order_states():
    z = dynamicsymbols("z")
    scene = double_pendulum()
    scene.add_states({z: (a.diff() - z) / l})
    outputs = {"rate": z.diff(), "same": "z_dot", "both": z.diff() * b.diff(T, 2)}
    model = da.compile_model(scene, backend="numpy", outputs=outputs)
    run = model.simulate((0, 0.5), {**START, z: 0.4}, VALUES, events=[z.diff() - a.diff(T, 2)])
    rate = (run["a_dot"] - run["z"]) / 0.7
    alpha = np.array([by_hand(q, rates)[0][1] for q, rates in zip(run.q, run.qdot, strict=True)])
    np.testing.assert_allclose(run["rate"], rate, rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(run["same"], rate, rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(run["both"], rate * alpha, rtol=1e-10, atol=1e-10)


def test_model_can_be_pickled():
    model = pickle.loads(
        pickle.dumps(da.compile_model(double_pendulum(), backend="numpy", outputs={"alpha": a.diff(T, 2)}))
    )
    assert model.layout.outputs == ("alpha",)


# -- names --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("outputs", "error", "message"),
    [
        ({"a": b}, OptionError, "output 'a' has the name of a coordinate, which is something else"),
        ({"a_dot": b}, OptionError, "'a_dot' has the name of a rate"),
        ({"m": a}, OptionError, "'m' has the name of a parameter"),
        ({"t": a}, OptionError, "'t' has the name of time"),
        ({"energy": a}, OptionError, "'energy' has the name of an output of every model"),
        ({"a_ddot": a}, OptionError, "'a_ddot' has the name of an acceleration"),
        ({"v": VELOCITY, "v_x": a}, OptionError, "two outputs have the name v_x"),
        ({"": a}, OptionError, "the name of an output must be a text"),
        ({3: a}, OptionError, "the name of an output must be a text"),
        ({"h": 3}, OptionError, "'h' is 3"),
        ({"h": "nothing"}, UnknownNameError, r"output 'h': unknown name 'nothing'. Known: a, b, a_dot"),
        ([3], OptionError, "names, expressions of the scene's symbols, Vectors or Points, or a mapping"),
        ({"jerk": a.diff(T, 3)}, SceneError, "is beyond what outputs contain: second rates of coordinates"),
        ({"v": ReferenceFrame("F").x}, SceneError, "frame 'F' is not oriented in 'N'"),
    ],
)
def test_names_that_clash(outputs, error, message):
    with pytest.raises(error, match=message):
        da.compile_model(double_pendulum(), backend="numpy", outputs=outputs)


def test_names_of_what_they_are():
    outputs = {"a": a, "b_dot": "b_dot", "a_ddot": a.diff(T, 2)}
    model = da.compile_model(double_pendulum(), backend="numpy", outputs=outputs)
    assert model.layout.outputs == tuple(outputs)


SAME = sp.Symbol("a_ddot")


@pytest.mark.parametrize("outputs", [["a_ddot"], [a.diff(T, 2)], {"a_ddot": SAME}, {"b": "a_ddot"}])
def test_parameter_with_the_name_of_an_acceleration(outputs):
    """A result called a_ddot would be one of two things."""
    scene = da.Scene("ambiguous", frame=N, origin=O, coordinates=[a])
    block = O.locatenew("block", a * N.x)
    scene.add_bodies(Particle("block", block, 2))
    scene.add_loads((block, -SAME * a * N.x))
    with pytest.raises(OptionError, match="has the name of a parameter"):
        da.compile_model(scene, backend="numpy", outputs=outputs)
    model = da.compile_model(scene, backend="numpy", outputs={"own": a.diff(T, 2), "given": SAME})
    run = model.simulate((0, 1), {a: 1, a.diff(): 0}, {SAME: 3})
    assert (run["own"][0], run["given"][0]) == (-1.5, 3.0)


def test_point_with_the_name_of_a_coordinate():
    """That the coordinate is the component is no clash; that it is another one is."""
    x = dynamicsymbols("G_x")
    point = O.locatenew("G", x * N.x)
    scene = da.Scene("slider", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("p", point, m))
    assert da.compile_model(scene, backend="numpy", outputs=[point]).layout.outputs == ("G_x", "G_y", "G_z")
    with pytest.raises(OptionError, match="'G_x' has the name of a coordinate"):
        da.compile_model(scene, backend="numpy", outputs=[O.locatenew("G", 2 * x * N.x)])


def test_state_of_the_formulation():
    """A name of an independent speed that the formulation adds is taken."""
    free = da.Scene("free", frame=N, origin=O, coordinates=[])
    S = ReferenceFrame("T")
    da.free_orientation(free, S)
    free.add_bodies(RigidBody("body", O, S, m, (inertia(S, 1, 2, 3), O)))
    with pytest.raises(OptionError, match="omega_T_x have the names of components of the state"):
        da.compile_model(free, backend="numpy", outputs={"omega_T_x": free.coordinates[0]})


def test_no_acceleration_in_what_the_motion_depends_on():
    scene = double_pendulum()
    scene.add_loads((P, m * a.diff(T, 2) * N.x))
    with pytest.raises(SceneError, match="is an acceleration, which may stand in outputs, events and reductions"):
        da.compile_model(scene, backend="numpy", outputs=[a.diff(T, 2)])
