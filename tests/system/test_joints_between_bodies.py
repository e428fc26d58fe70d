"""Joints between two bodies, against the Newton-Euler equations of each body by itself.

The reference knows planar bodies with three coordinates each, and pins as constraints on accelerations. It takes
positions and velocities of the mechanisms from closed-form kinematics and solves for all accelerations and pin forces.
"""

import functools

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import ConstraintError, FormulationError, SceneError
from dalembert.textbook.report import _actions
from textbook.helpers import agreement, point

G = 9.81
N, O = ReferenceFrame("N"), Point("O")


def pin_forces(masses, inertias, states, pins, fixed=()):
    """Return the forces of pins (n_pins, 2) on their first bodies, from Newton-Euler equations of planar bodies.

    `states` are (x, y, phi, x_dot, y_dot, phi_dot) of mass centres; `pins` are (body, arm, other, other arm) with arms
    on the axes of the bodies, and other None for the fixed frame; `fixed` are (body, axis) that cannot accelerate.
    """
    n, k = 3 * len(masses), 2 * len(pins) + len(fixed)
    inertia_matrix = np.diag(np.ravel([(m, m, i) for m, i in zip(masses, inertias, strict=True)]))
    load = np.ravel([(0.0, -m * G, 0.0) for m in masses])
    rows, gamma = np.zeros((k, n)), np.zeros(k)
    for p, ends in enumerate(pins):
        for sign, body, arm in ((1, *ends[:2]), (-1, *ends[2:])):
            if body is None:
                continue
            phi, rate = states[body][2], states[body][5]
            r = np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]]) @ arm
            rows[2 * p : 2 * p + 2, 3 * body : 3 * body + 2] += sign * np.eye(2)
            rows[2 * p : 2 * p + 2, 3 * body + 2] += sign * np.array([-r[1], r[0]])
            gamma[2 * p : 2 * p + 2] += sign * rate**2 * r
    for j, (body, axis) in enumerate(fixed):
        rows[2 * len(pins) + j, 3 * body + axis] = 1
    matrix = np.block([[inertia_matrix, -rows.T], [rows, np.zeros((k, k))]])
    found = np.linalg.solve(matrix, np.concatenate([load, gamma]))
    return found[n : n + 2 * len(pins)].reshape(-1, 2)


def rod(name, frame, start, length, mass, number):
    centre = start.locatenew(f"G_{name}", length / 2 * frame.x)
    return RigidBody(name, centre, frame, mass, (inertia(frame, 0, 0, number), centre))


def turned(name, angle):
    frame = ReferenceFrame(name)
    frame.orient_axis(N, N.z, angle)
    return frame


m1, m2, m3, l1, l2, l3, d, J1, J2, J3 = sp.symbols("m1 m2 m3 l1 l2 l3 d J1 J2 J3", positive=True)
VALUES = {m1: 1.3, m2: 0.7, m3: 1.9, l1: 0.5, l2: 1.1, l3: 0.9, d: 1.2, J1: 0.03, J2: 0.08, J3: 0.11}
R_x, R_y = da.unknowns("R_x R_y")
PIN = R_x * N.x + R_y * N.y


def four_bar():
    """A crank and a coupler on it, a rocker, and the pin that closes the loop."""
    angles = dynamicsymbols("a b c")
    A, B, C = (turned(*pair) for pair in zip("ABC", angles, strict=True))
    P = O.locatenew("P", l1 * A.x)
    Q = P.locatenew("Q", l2 * B.x)
    D = O.locatenew("D", d * N.x)
    gap = Q.pos_from(O) - D.pos_from(O) - l3 * C.x
    scene = da.Scene("four_bar", frame=N, origin=O, coordinates=angles)
    scene.add_bodies(rod("crank", A, O, l1, m1, J1), rod("coupler", B, P, l2, m2, J2), rod("rocker", C, D, l3, m3, J3))
    scene.add_joints(da.Joint("closing", body="rocker", other="coupler", at=Q, force=PIN))
    scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
    scene.apply_uniform_gravity(-G * N.y)
    return scene


def four_bar_forces(q, qdot, p):
    a, b, c = q
    (da_, db, dc), L1, L2, L3 = qdot, p[l1], p[l2], p[l3]

    def spoke(angle, rate, length):
        return length * np.array([np.cos(angle), np.sin(angle)]), length * rate * np.array(
            [-np.sin(angle), np.cos(angle)]
        )

    (r1, v1), (r2, v2), (r3, v3) = spoke(a, da_, L1), spoke(b, db, L2), spoke(c, dc, L3)
    states = [
        (*(r1 / 2), a, *(v1 / 2), da_),
        (*(r1 + r2 / 2), b, *(v1 + v2 / 2), db),
        (p[d] + r3[0] / 2, r3[1] / 2, c, *(v3 / 2), dc),
    ]
    ends = [np.array([length / 2, 0.0]) for length in (L1, L2, L3)]
    pins = [
        (2, ends[2], 1, ends[1]),
        (0, -ends[0], None, None),
        (1, -ends[1], 0, ends[0]),
        (2, -ends[2], None, None),
    ]
    return pin_forces([p[m1], p[m2], p[m3]], [p[J1], p[J2], p[J3]], states, pins)[0]


def slider_crank():
    """A crank, a rod on it, and a slider without mass of its own rotation, which the closing pin drives."""
    a, b, s = coordinates = dynamicsymbols("a b s")
    A, B = turned("A", a), turned("B", b)
    P = O.locatenew("P", l1 * A.x)
    Q = P.locatenew("Q", l2 * B.x)
    S = O.locatenew("S", s * N.x)
    gap = Q.pos_from(O) - S.pos_from(O)
    scene = da.Scene("slider_crank", frame=N, origin=O, coordinates=coordinates)
    scene.add_bodies(rod("crank", A, O, l1, m1, J1), rod("rod", B, P, l2, m2, J2), Particle("slider", S, m3))
    scene.add_joints(da.Joint("wrist", body="slider", other="rod", at=Q, force=PIN))
    scene.add_holonomic_constraints(gap.dot(N.x), gap.dot(N.y))
    scene.apply_uniform_gravity(-G * N.y)
    return scene


def slider_crank_forces(q, qdot, p):
    a, b, s = q
    (da_, db, ds), L1, L2 = qdot, p[l1], p[l2]
    r1, v1 = L1 * np.array([np.cos(a), np.sin(a)]), L1 * da_ * np.array([-np.sin(a), np.cos(a)])
    r2, v2 = L2 * np.array([np.cos(b), np.sin(b)]), L2 * db * np.array([-np.sin(b), np.cos(b)])
    states = [
        (*(r1 / 2), a, *(v1 / 2), da_),
        (*(r1 + r2 / 2), b, *(v1 + v2 / 2), db),
        (s, 0.0, 0.0, ds, 0.0, 0.0),
    ]
    e1, e2 = np.array([L1 / 2, 0.0]), np.array([L2 / 2, 0.0])
    pins = [(2, np.zeros(2), 1, e2), (0, -e1, None, None), (1, -e2, 0, e1)]
    return pin_forces([p[m1], p[m2], p[m3]], [p[J1], p[J2], 1.0], states, pins, fixed=[(2, 1), (2, 2)])[0]


def double_pendulum():
    """Two rods in their angles; two released coordinates make the force of the pin between them known."""
    a, b, u, w = dynamicsymbols("a b u w")
    A, B = turned("A", a), turned("B", b)
    P = O.locatenew("P", l1 * A.x)
    Q = P.locatenew("Q", 0 * N.x)
    scene = da.Scene("double_pendulum", frame=N, origin=O, coordinates=[a, b])
    scene.add_bodies(rod("upper", A, O, l1, m1, J1), rod("lower", B, Q, l2, m2, J2))
    scene.add_joints(da.Joint("pin", body="lower", other="upper", at=P, force=PIN))
    scene.apply_uniform_gravity(-G * N.y)
    return scene, lambda: scene.release(u, Q, N.x).release(w, Q, N.y)


def double_pendulum_forces(q, qdot, p):
    (a, b), (da_, db), L1, L2 = q[:2], qdot[:2], p[l1], p[l2]
    r1, v1 = L1 * np.array([np.cos(a), np.sin(a)]), L1 * da_ * np.array([-np.sin(a), np.cos(a)])
    r2, v2 = L2 * np.array([np.cos(b), np.sin(b)]), L2 * db * np.array([-np.sin(b), np.cos(b)])
    states = [(*(r1 / 2), a, *(v1 / 2), da_), (*(r1 + r2 / 2), b, *(v1 + v2 / 2), db)]
    e1, e2 = np.array([L1 / 2, 0.0]), np.array([L2 / 2, 0.0])
    pins = [(1, -e2, 0, e1), (0, -e1, None, None)]
    return pin_forces([p[m1], p[m2]], [p[J1], p[J2]], states, pins)[0]


def closed(scene, guess, fixed):
    """Return a start of a mechanism with its loop closed and its parameters; the crank turns at 3 rad/s."""
    model = da.compile_model(scene, backend="numpy")
    used = {s: v for s, v in VALUES.items() if s.name in model.layout.parameters}
    found = model.assemble(guess, used, fixed=fixed)
    rates = {"a_dot": 3.0, "b_dot": -2.0} if scene.name == "double_pendulum" else {"a_dot": 3.0}
    return {**{name: found[name] for name in guess}, **rates}, used


MECHANISMS = {
    "four_bar": (four_bar, four_bar_forces, {"a": 0.9, "b": 0.2, "c": 1.2}),
    "slider_crank": (slider_crank, slider_crank_forces, {"a": 0.8, "b": -0.3, "s": 1.4}),
    "double_pendulum": (lambda: double_pendulum()[1](), double_pendulum_forces, {"a": 0.3, "b": -0.4, "u": 0, "w": 0}),
}


@functools.cache
def mechanism(name):
    """Return a mechanism, its reference, a consistent start, and its parameters."""
    build, forces, guess = MECHANISMS[name]
    scene = build()
    start, p = closed(scene, guess, ["a", "b"] if name == "double_pendulum" else ["a"])
    return scene, forces, start, p


def check_forces(model, forces, start, p, worst=1e-12):
    run = model.simulate((0, 0.4), start, p, t_eval=np.linspace(0, 0.4, 9), rtol=1e-10, atol=1e-12)
    assert run.success, run.message
    wanted = np.array([forces(q, rate, VALUES) for q, rate in zip(run.q, run.qdot, strict=True)])
    found = np.column_stack([run["R_x"], run["R_y"]])
    np.testing.assert_allclose(found[0], wanted[0], rtol=0, atol=1e-12 * np.abs(wanted).max())
    np.testing.assert_allclose(found, wanted, rtol=0, atol=worst * np.abs(wanted).max())


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
@pytest.mark.parametrize("name", MECHANISMS)
def test_force_of_the_pin(name, backend):
    scene, forces, start, p = mechanism(name)
    model = da.compile_model(scene, backend=backend, outputs=["R_x", "R_y"])
    check_forces(model, forces, start, p)


@pytest.mark.parametrize("formulation", ["minimal", "projected", "baumgarte", "ggl", "augmented"])
@pytest.mark.parametrize("name", MECHANISMS)
def test_force_of_the_pin_in_every_formulation(name, formulation):
    """What drifts off the constraints has forces that are wrong by the drift."""
    scene, forces, start, p = mechanism(name)
    if formulation == "minimal" and name != "double_pendulum":
        with pytest.raises(FormulationError, match="no coordinate in closed form"):
            da.compile_model(scene, formulation=formulation, outputs=["R_x"])
        return
    model = da.compile_model(scene, backend="numpy", formulation=formulation, outputs=["R_x", "R_y"])
    check_forces(model, forces, start, p, 1e-12 if formulation in ("minimal", "projected") else 1e-9)


def test_sweep_has_the_force():
    scene, forces, start, p = mechanism("four_bar")
    model = da.compile_model(scene, outputs=["R_x", "R_y"])
    masses = np.array([0.7, 1.1, 1.7])
    sweep = model.sweep((0, 0.4), start, {**p, m2: masses}, rtol=1e-10)
    for i, mass in enumerate(masses):
        q, rate = (np.array([sweep.final[name + end][i] for name in "abc"]) for end in ("", "_dot"))
        wanted = forces(q, rate, {**VALUES, m2: mass})
        found = np.array([sweep.final["R_x"][i], sweep.final["R_y"][i]])
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())


@pytest.mark.parametrize("name", MECHANISMS)
def test_textbook_view_agrees(name):
    """Its route derives T and knows nothing of poses; the joint has no power where the loop is closed."""
    scene, *_ = mechanism(name)
    view = da.lagrange(scene)
    joint = scene.joints[0]
    assert view.ideal_conditions(joint) == []
    assert view.undetermined == ()
    own, opposite = view.action_screw(joint), view.action_screw(joint, joint.other)
    assert own.resultant == -opposite.resultant == PIN
    accelerations, reactions = agreement(scene, "projected", view=view)
    assert accelerations < 1e-9 and reactions < 1e-9


def test_report_has_both_screws():
    section = _actions(da.lagrange(double_pendulum()[0]))
    assert [name for name, _ in section.lines if name] == [
        "action screw of the joint pin on lower",
        "action screw of the joint pin on upper",
    ]


# -- what is determined -----------------------------------------------------------------------------


def test_force_that_has_no_power_comes_from_balances_of_bodies():
    """The textbook view needs a released coordinate; models do not, and have the same forces."""
    scene, released = double_pendulum()
    assert da.lagrange(scene).undetermined == (R_x, R_y)
    assert da.compile_model(scene, backend="numpy").layout.undetermined == ("R_x", "R_y")
    _, forces, start, p = mechanism("double_pendulum")
    start = {name: value for name, value in start.items() if name[0] in "ab"}
    check_forces(da.compile_model(scene, backend="numpy", outputs=["R_x", "R_y"]), forces, start, p)
    back = released()
    for q in back.coordinates[2:]:
        back = back.impose(q)
    assert da.lagrange(back).undetermined == (R_x, R_y)


def test_forces_that_only_open_loops_tell_apart():
    """Two pins at the same place of a closed loop: their x components differ only where the loop is open."""
    scene = four_bar()
    C = scene.bodies[2].frame
    end = point(scene, "D").locatenew("E", l3 * C.x)
    S_x = da.unknowns("S_x")
    scene.add_joints(da.Joint("twice", body="rocker", other="coupler", at=end, force=S_x * N.x))
    model = da.compile_model(scene, backend="numpy", outputs=["R_x", "R_y", "S_x"])
    _, forces, start, p = mechanism("four_bar")
    run = model.simulate((0, 0.1), start, p)
    assert "the reactions R_x, S_x are not determined here, and the least ones are given" in run.message
    wanted = forces(run.q[-1], run.qdot[-1], VALUES)
    assert run["R_y"][-1] == pytest.approx(wanted[1], rel=1e-9)
    assert run["R_x"][-1] + run["S_x"][-1] == pytest.approx(wanted[0], rel=1e-7)


def test_pin_that_cannot_hold_the_loop():
    scene = four_bar()
    scene.joints = (da.Joint("closing", body="rocker", other="coupler", at=scene.joints[0].at, force=R_x * N.x),)
    with pytest.raises(ConstraintError, match=r"no joint exerts the reaction of holonomic constraint 2, .*Give"):
        da.compile_model(scene, backend="numpy", outputs=["R_x"])


# -- friction -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["llvm", "numba", "numpy"])
def test_discs_that_rub_until_they_turn_together(backend):
    """A torque of friction between two bodies; it opposes their relative spin, and each has the other's opposite."""
    a, b, z = dynamicsymbols("a b z")
    mu, g = sp.symbols("mu g", positive=True)
    A, B = turned("A", a), turned("B", b)
    low, high = O.locatenew("L", 0 * N.z), O.locatenew("H", z * N.z)
    F_n, T_z = da.unknowns("F_n T_z")
    scene = da.Scene("discs", frame=N, origin=O, coordinates=[a, b, z])
    scene.add_bodies(
        RigidBody("lower", low, A, m1, (inertia(A, J1, J1, J1), low)),
        RigidBody("upper", high, B, m2, (inertia(B, J2, J2, J2), high)),
    )
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_holonomic_constraints(z)
    scene.add_joints(da.Joint("pad", body="upper", other="lower", at=high, force=F_n * N.z, torque=T_z * N.z))
    scene.add_friction(da.CoulombFriction(F_n, T_z, mu=mu))
    law = da.lagrange(scene).friction_laws[T_z]
    assert law == -mu * F_n * sp.sign(b.diff() - a.diff())
    model = da.compile_model(scene, backend=backend, outputs=["T_z", "F_n"])
    p = {m1: 1, m2: 1.5, mu: 0.1, g: 10, J1: 0.5, J2: 0.25}
    run = model.simulate((0, 1), {"a": 0, "b": 0, "z": 0, "a_dot": 0, "b_dot": 5}, p)
    stuck = 5 / (1.5 * (1 / 0.25 + 1 / 0.5))
    assert [phase.modes["F_n"] for phase in run.phases] == ["slip", "stick"]
    assert run.phases[1].t0 == pytest.approx(stuck, rel=1e-9)
    assert run["T_z"][0] == pytest.approx(-1.5, rel=1e-12)
    np.testing.assert_allclose([run["a_dot"][-1], run["b_dot"][-1]], 5 - stuck * 1.5 / 0.25, rtol=1e-9)


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_balls_that_hit_each_other(backend):
    """The impulse of a contact between two bodies conserves their momentum."""
    x, y = dynamicsymbols("x y")
    e, r = sp.symbols("e r", positive=True)
    first, second = O.locatenew("B1", x * N.x), O.locatenew("B2", y * N.x)
    F = da.unknowns("F")
    scene = da.Scene("balls", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("first", first, m1), Particle("second", second, m2))
    scene.add_joints(da.Joint("touch", body="second", other="first", at=second, force=F * N.x))
    scene.add_contacts(da.UnilateralContact(F, y - x - 2 * r, restitution=e, name="touch"))
    model = da.compile_model(scene, backend=backend)
    run = model.simulate((0, 2), {"x": 0, "y": 1, "x_dot": 1, "y_dot": -0.5}, {m1: 1, m2: 3, r: 0.1, e: 0.7})
    common, rebound = (1 - 3 * 0.5) / 4, 0.7 * 1.5
    np.testing.assert_allclose(run["x_dot"][-1], common - rebound * 3 / 4, rtol=1e-13)
    np.testing.assert_allclose(run["y_dot"][-1], common + rebound * 1 / 4, rtol=1e-13)


def test_hinge_in_space():
    """Force and torque of a hinge between two free bodies, by the equations of Newton and Euler of each along a run."""
    first, second = dynamicsymbols("x1 y1 z1 a1 b1 c1"), dynamicsymbols("x2 y2 z2 a2 b2 c2")
    A, B = ReferenceFrame("A"), ReferenceFrame("B")
    A.orient_body_fixed(N, first[3:], "XYZ")
    B.orient_body_fixed(N, second[3:], "XYZ")
    one = O.locatenew("one", first[0] * N.x + first[1] * N.y + first[2] * N.z)
    two = O.locatenew("two", second[0] * N.x + second[1] * N.y + second[2] * N.z)
    pin, eye = one.locatenew("pin", l1 * A.x + l1 / 3 * A.y), two.locatenew("eye", -l1 / 2 * B.x)
    scene = da.Scene("hinge", frame=N, origin=O, coordinates=[*first, *second])
    scene.add_bodies(
        RigidBody("one", one, A, m1, (inertia(A, J1, J2, J3), one)),
        RigidBody("two", two, B, m2, (inertia(B, J2, J1, J3), two)),
    )
    scene.apply_uniform_gravity(-G * N.z)
    scene.add_loads((one, d * N.x), (B, d * B.y))
    T_x, T_y, R_z = da.unknowns("T_x T_y R_z")
    force, torque = R_x * A.x + R_y * A.y + R_z * A.z, T_x * A.x + T_y * A.y
    scene.add_joints(da.Joint("hinge", body="two", other="one", at=pin, force=force, torque=torque))
    gap = eye.pos_from(O) - pin.pos_from(O)
    scene.add_holonomic_constraints(*(gap.dot(n) for n in (N.x, N.y, N.z)), A.x.dot(B.z), A.y.dot(B.z))
    vectors = {"force": force, "torque": torque, "arm_one": pin.pos_from(one), "arm_two": pin.pos_from(two)}
    for name, frame, point_ in (("one", A, one), ("two", B, two)):
        spin = frame.ang_vel_in(N)
        vectors |= {f"a_{name}": point_.pos_from(O).dt(N).dt(N), f"w_{name}": spin, f"w_dot_{name}": spin.dt(N)}
        vectors |= {f"{name}_{i}": axis for i, axis in enumerate(frame)}
    model = da.compile_model(scene, outputs=vectors)
    p = {m1: 1, m2: 2, l1: 0.5, J1: 0.1, J2: 0.2, J3: 0.15, d: 0.8}
    drawn = np.random.default_rng(0).uniform(-0.4, 0.4, 19)
    names = [q.func.__name__ for q in (*first, *second)]
    start = model.assemble(dict(zip(names, drawn[:12], strict=True)), p)
    start |= {f"{name}_dot": 2 * x for name, x in zip([*names[:6], "c2"], drawn[12:], strict=True)}
    run = model.simulate((0, 1), start, p, t_eval=np.linspace(0, 1, 6), rtol=1e-10)
    found = {name: np.array([run[f"{name}_{axis}"] for axis in "xyz"]).T for name in vectors}
    gravity, size = np.array([0, 0, -G]), np.abs(found["force"]).max()
    for name, mass, own, sign in (("one", 1, (0.1, 0.2, 0.15), -1), ("two", 2, (0.2, 0.1, 0.15), 1)):
        axes = np.stack([found[f"{name}_{i}"] for i in range(3)], axis=2)
        about = axes @ np.diag(own) @ axes.transpose(0, 2, 1)
        spin, faster = found[f"w_{name}"], found[f"w_dot_{name}"]
        momentum = np.einsum("nij,nj->ni", about, spin)
        pull, moment = sign * found["force"], sign * found["torque"]
        pull = pull + (np.array([0.8, 0, 0]) if name == "one" else 0)
        moment = moment + np.cross(found[f"arm_{name}"], sign * found["force"])
        moment = moment + (0.8 * found["two_1"] if name == "two" else 0)
        rate = np.einsum("nij,nj->ni", about, faster) + np.cross(spin, momentum)
        np.testing.assert_allclose(mass * (found[f"a_{name}"] - gravity), pull, rtol=0, atol=1e-11 * size)
        np.testing.assert_allclose(rate, moment, rtol=0, atol=1e-11 * size)


def test_block_on_a_cart():
    """Dry friction between two bodies opposes the velocity of one relative to the other, and drives both."""
    x, y, w = dynamicsymbols("x y w")
    mu, g = sp.symbols("mu g", positive=True)
    cart, block = O.locatenew("cart", x * N.x), O.locatenew("block", y * N.x + w * N.y)
    N_n, F_t = da.unknowns("N_n F_t")
    scene = da.Scene("stack", frame=N, origin=O, coordinates=[x, y, w])
    scene.add_bodies(Particle("cart", cart, m1), Particle("block", block, m2))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_joints(da.Joint("bed", body="block", other="cart", at=block, force=F_t * N.x + N_n * N.y))
    scene.add_holonomic_constraints(w)
    scene.add_friction(da.CoulombFriction(N_n, F_t, mu=mu))
    view = da.lagrange(scene)
    assert view.friction_laws[F_t] == -mu * N_n * sp.sign(y.diff() - x.diff())
    assert view.slip_velocity("bed").dot(N.x) == y.diff() - x.diff()
    model = da.compile_model(scene, backend="numpy", outputs=["F_t"])
    run = model.simulate((0, 2), {"x": 0, "y": 0, "w": 0, "x_dot": 0, "y_dot": 3}, {m1: 4, m2: 2, mu: 0.3, g: 10})
    stuck = 3 / (3 + 1.5)
    assert run.phases[1].t0 == pytest.approx(stuck, rel=1e-9) and run["F_t"][0] == pytest.approx(-6, rel=1e-13)
    np.testing.assert_allclose([run["x_dot"][-1], run["y_dot"][-1]], 1, rtol=1e-9)


def test_ball_joint_in_angles_and_in_quaternions():
    """A spinning top on the end of an arm: the same force on the joint whatever orients the top."""
    a, *angles, px, py, pz = dynamicsymbols("a phi theta psi px py pz")
    S, A = ReferenceFrame("S"), turned("A", a)
    S.orient_body_fixed(N, angles, "ZXZ")
    top = O.locatenew("G", px * N.x + py * N.y + pz * N.z)
    tip, end, arm = top.locatenew("tip", -l1 * S.z), O.locatenew("end", l1 * A.x), O.locatenew("C", l1 / 2 * A.x)
    scene = da.Scene("top_on_arm", frame=N, origin=O, coordinates=[a, *angles, px, py, pz])
    scene.add_bodies(
        RigidBody("arm", arm, A, m2, (inertia(A, J1, J1, J1), arm)),
        RigidBody("top", top, S, m1, (inertia(S, J1, J1, 2 * J1), top)),
    )
    scene.apply_uniform_gravity(-G * N.z)
    R_z = da.unknowns("R_z")
    scene.add_joints(da.Joint("ball", body="top", other="arm", at=end, force=PIN + R_z * N.z))
    scene.add_holonomic_constraints(*((tip.pos_from(O) - end.pos_from(O)).dot(n) for n in (N.x, N.y, N.z)))
    p, lean, turn = {m1: 1, m2: 2, l1: 0.3, J1: 0.02}, 0.9, 0.2
    up = np.array([np.sin(lean) * np.sin(turn), -np.sin(lean) * np.cos(turn), np.cos(lean)])
    place = 0.3 * (np.array([np.cos(0.1), np.sin(0.1), 0]) + up)
    start = {"a": 0.1, "phi": turn, "theta": lean, "psi": 0.1, **dict(zip(("px", "py", "pz"), place, strict=True))}
    start |= {"a_dot": 0.5, "phi_dot": 1, "theta_dot": 0.2, "psi_dot": 20}
    names = ["R_x", "R_y", "R_z"]
    outputs = {**dict(zip(names, names, strict=True)), "acc": top.pos_from(O).dt(N).dt(N)}
    ends = []
    for way in ("scene", "quaternion"):
        model = da.compile_model(scene, outputs=outputs, orientation=way)
        run = model.simulate((0, 0.3), start, p, rtol=1e-10)
        force = np.array([run[name] for name in names])
        carried = np.array([run[f"acc_{axis}"] for axis in "xyz"]) + np.array([[0], [0], [G]])
        np.testing.assert_allclose(force, carried, rtol=0, atol=1e-10 * np.abs(force).max())  # Newton's law, m1 = 1
        ends.append(force[:, -1])
    np.testing.assert_allclose(*ends, rtol=1e-7)


# -- faults -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("joint", "wanted"),
    [
        ({"other": "crank", "body": "crank"}, r"'crank' and itself.*known: coupler, rocker"),
        ({"other": "crunk"}, r"reacts on 'crunk', which is no body; known: crank, coupler, rocker"),
        ({"other": "crank"}, r"acts between 'crank' and 'rocker' at 'Q', which is a point of neither"),
    ],
)
def test_faults(joint, wanted):
    scene = four_bar()
    given = {"body": "rocker", "at": scene.joints[0].at, "force": PIN, **joint}
    scene.joints = (da.Joint("closing", **given),)
    with pytest.raises(SceneError, match=wanted):
        da.compile_model(scene, backend="numpy")


def test_no_torque_on_a_particle():
    scene = slider_crank()
    old = scene.joints[0]
    scene.joints = (da.Joint("wrist", body="slider", other="rod", at=old.at, torque=R_x * N.z),)
    with pytest.raises(SceneError, match="'slider' is a particle, which has no orientation"):
        da.compile_model(scene, backend="numpy")


def carried_particle(at, **joint):
    """A particle on a bar that turns, and a joint on the particle at a share of the way to it."""
    a, r = dynamicsymbols("a r")
    A = turned("A", a)
    P = O.locatenew("P", r * A.x)
    Q = P if at == 1 else O.locatenew("Q", at * r * A.x)
    scene = da.Scene("carried", frame=N, origin=O, coordinates=[a, r])
    scene.add_bodies(Particle("bead", P, 1))
    scene.add_joints(da.Joint("hand", body="bead", at=Q, **joint))
    return scene, a, r, A


@pytest.mark.parametrize("at, joint", [(0, {}), (sp.S.Half, {}), (1, {"torque": 3 * N.z})])
def test_a_particle_has_one_point_and_no_orientation(at, joint):
    wanted = (
        "'bead' at 'Q', which is not the point 'P' of that particle"
        if at != 1
        else "'bead' is a particle, which has no orientation"
    )
    with pytest.raises(SceneError, match=wanted):
        da.compile_model(carried_particle(at, force=3 * N.y, **joint)[0], backend="numpy")


def test_a_constraint_may_bring_the_joint_to_the_particle():
    """The power of its force is that on the particle, whatever the frame that carries it; both routes agree."""
    scene, a, r, A = carried_particle(1)
    Q = O.locatenew("Q", l1 * A.x)
    scene.joints = (da.Joint("hand", body="bead", at=Q, force=3 * A.y),)
    scene.add_holonomic_constraints(r - l1)
    model = da.compile_model(scene, backend="numpy", formulation="projected")
    found = model.forcing(0.0, [0.3, 2.0], [0.0, 0.0], {l1: 1.0})
    np.testing.assert_allclose(found, [6.0, 0.0], atol=1e-14)
    view = da.lagrange(scene)
    assert sp.simplify(view.power_coefficient(a) - 3 * r) == 0 and view.power_coefficient(r) == 0
