"""Reactions of declared joints that the coordinates hide, without `release`, against Newton and Euler by hand."""

import numpy as np
import pytest
import sympy as sp
from sympy import cos, sin, sqrt, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import ConstraintError
from system.test_joints_between_bodies import VALUES, l2, l3, mechanism, pin_forces

t = dynamicsymbols._t
m, M, g, l, L, b, J, r, mu = symbols("m M g l L b J r mu", positive=True)
theta, x, y = dynamicsymbols("theta x y")
T, F, X, Y = da.unknowns("T F X Y")
N, O = ReferenceFrame("N"), Point("O")


def scene_of(name, coordinates, gravity=True):
    scene = da.Scene(name, frame=N, origin=O, coordinates=coordinates)
    if gravity:
        scene.apply_uniform_gravity(-g * N.y)
    return scene


def pendulum():
    """A bob on a rod, in the angle of the rod; T pulls it towards the pivot."""
    S = N.orientnew("S", "Axis", (theta, N.z))
    P = O.locatenew("P", -l * S.y)
    scene = scene_of("pendulum", [theta])
    scene.add_bodies(Particle("bob", P, m))
    scene.add_joints(da.Joint("rod", body="bob", at=P, force=T * S.y))
    return scene


PENDULUM = {m: 1.3, l: 0.7, g: 9.81}
SWING = {theta: 0.6, theta.diff(): 1.1}


def tension(run, p=PENDULUM):
    return p[m] * (p[l] * run["theta_dot"] ** 2 + p[g] * np.cos(run["theta"]))


# -- one body -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("formulation", ["minimal", "projected", "baumgarte", "ggl", "augmented"])
def test_tension_of_a_string_in_every_formulation(formulation):
    model = da.compile_model(pendulum(), backend="numpy", formulation=formulation, outputs=["T"])
    run = model.simulate((0, 1), SWING, PENDULUM, rtol=1e-9)
    np.testing.assert_allclose(run["T"], tension(run), rtol=1e-12)
    assert "T by moving 'bob' in the program of reactions alone" in model.explain()
    assert "T, which the equations do not determine" not in model.explain()


@pytest.fixture(scope="module")
def compiled_pendulum():
    return da.compile_model(pendulum(), outputs=["T"])


def test_motion_is_the_same_to_the_last_bit(compiled_pendulum):
    plain = da.compile_model(pendulum())
    first, second = (model.simulate((0, 3), SWING, PENDULUM) for model in (plain, compiled_pendulum))
    np.testing.assert_array_equal(first.t, second.t)
    np.testing.assert_array_equal(first.q, second.q)
    np.testing.assert_array_equal(first.qdot, second.qdot)
    assert first.stats.steps == second.stats.steps


def test_event_reduction_and_derivative_of_a_tension(compiled_pendulum):
    model = compiled_pendulum
    level = 1.3 * 9.81
    run = model.simulate((0, 3), SWING, PENDULUM, events=[da.Event(T - level, terminal=True)], rtol=1e-10)
    assert run["T"][-1] == pytest.approx(level, rel=1e-9) and run.t[-1] < 3
    lengths = np.array([0.5, 0.7])
    sweep = model.sweep((0, 2), SWING, {**PENDULUM, l: lengths}, reduce={"most": da.maximum("T")}, rtol=1e-10)
    for length, most in zip(lengths, sweep.reduced["most"], strict=True):
        energy = 0.5 * (length * 1.1) ** 2 + 9.81 * length * (1 - np.cos(0.6))
        assert most == pytest.approx(1.3 * (2 * energy / length + 9.81), rel=1e-6)
    slopes = model.sensitivity((0, 1), SWING, PENDULUM, wrt=["l"], of=["T"], rtol=1e-11)
    ends = [model.simulate((0, 1), SWING, {**PENDULUM, l: 0.7 + h}, rtol=1e-12)["T"][-1] for h in (1e-5, -1e-5)]
    assert slopes.jacobian("T", "l")[-1] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-6)


def test_sphere_has_its_normal_force_beside_multipliers():
    model = da.compile_model(da.scenes.rolling_sphere(), backend="numpy", outputs=["N", "F_u"])
    start = {"x": 0, "y": 0, "psi": 0.3, "theta": 1.0, "phi": 0.2, "psi_dot": 0.7, "theta_dot": 0.2, "phi_dot": 1.1}
    run = model.simulate((0, 0.5), start, {"m": 1.3, "r": 0.4, "g": 9.81})
    np.testing.assert_allclose(run["N"], 1.3 * 9.81, rtol=1e-12)
    assert np.abs(run["F_u"]).max() < 1e-12


# -- power that vanishes on a branch, or on the constraints, alone ----------------------------------------


def coin(components):
    """A coin in coordinates of its contact point, and the arm to it by a root: the height is r |cos(lean)| there."""
    heading, lean, spin = dynamicsymbols("heading lean spin")
    H = N.orientnew("H", "Axis", (heading, N.z))
    S = H.orientnew("S", "Axis", (lean, H.x))
    D = S.orientnew("D", "Axis", (spin, S.y))
    G = O.locatenew("P", x * N.x + y * N.y).locatenew("G", r * S.z)
    scene = da.Scene("coin", frame=N, origin=O, coordinates=[x, y, heading, lean, spin])
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_bodies(RigidBody("coin", G, D, m, (inertia(D, m * r**2 / 4, m * r**2 / 2, m * r**2 / 4), G)))
    arm = -r * (N.z - N.z.dot(D.y) * D.y) / sqrt(1 - N.z.dot(D.y) ** 2)
    slip = G.pos_from(O).dt(N) + D.ang_vel_in(N).cross(arm)
    scene.add_nonholonomic_constraints(slip.dot(N.x), slip.dot(N.y))
    force = sum((f * axis for f, axis in zip(da.unknowns("A B C"), components(S), strict=True)), 0 * N.x)
    scene.add_joints(da.Joint("floor", body="coin", at=G.locatenew("C", arm), force=force))
    needed = m * (G.pos_from(O).dt(N).dt(N) + g * N.z)
    return scene, [force.dot(axis) - needed.dot(axis) for axis in N], force.dot(N.z)


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
@pytest.mark.parametrize("components", [lambda S: (N.x, N.y, N.z), lambda S: (S.x, S.y, S.z)])
def test_normal_force_of_a_coin_whose_arm_has_a_root(formulation, components):
    """No column of power vanishes identically; one does, or a combination of three, where the coin is upright."""
    scene, missing, normal = coin(components)
    outputs = {f"missing_{i}": value for i, value in enumerate(missing)} | {"normal": normal}
    model = da.compile_model(scene, backend="numpy", formulation=formulation, outputs=outputs)
    start = {"x": 0, "y": 0, "heading": 0, "lean": 0.3, "spin": 0, "heading_dot": 0.8, "lean_dot": 0, "spin_dot": 4}
    run = model.simulate((0, 0.2), start, {m: 0.1, r: 0.2, g: 9.81})
    assert run["normal"][0] == pytest.approx(0.8897115, abs=1e-7)
    for i in range(3):
        np.testing.assert_allclose(run[f"missing_{i}"], 0, atol=1e-13)


def test_tension_by_a_root_is_nan_on_the_other_branch():
    """Beyond the horizontal the direction of the force is not that of the rod."""
    S = N.orientnew("S", "Axis", (theta, N.z))
    P = O.locatenew("P", -l * S.y)
    scene = scene_of("branch", [theta])
    scene.add_bodies(Particle("bob", P, m))
    scene.add_joints(da.Joint("rod", body="bob", at=P, force=T * (-sin(theta) * N.x + sqrt(1 - sin(theta) ** 2) * N.y)))
    model = da.compile_model(scene, backend="numpy", outputs=["T"])
    run = model.simulate((0, 0.2), SWING, PENDULUM)
    np.testing.assert_allclose(run["T"], tension(run), rtol=1e-12)
    run = model.simulate((0, 0.2), {theta: 2.5, theta.diff(): 1.0}, PENDULUM)
    assert np.isnan(run["T"]).all() and "the reactions T are not determined at t = 0, 0.2, and NaN" in run.message
    angles = {theta: [0.6, 2.5, np.nan, 0.3], theta.diff(): 0.1}
    sweep = model.sweep((0, 0.2), angles, PENDULUM)
    assert [failure.case for failure in sweep.failures()] == [2]
    assert "reactions are not determined at the end, and NaN: T in 1 of 4 cases; the config" in sweep.stats.note
    assert not model.sweep((0, 0.2), {theta: [0.6, 0.3], theta.diff(): 0.1}, PENDULUM).stats.note


def test_power_that_vanishes_on_the_constraint_alone():
    """A bead in a parabolic slot: F has power only beside the slot."""
    gap = y - x**2 / 2
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("slot", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bead", P, m))
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_holonomic_constraints(gap)
    scene.add_joints(da.Joint("slot", body="bead", at=P, force=T * (N.y - x * N.x) + F * (N.z + gap * N.x)))
    for formulation in ("minimal", "projected"):
        model = da.compile_model(scene, backend="numpy", formulation=formulation, outputs=["T", "F"])
        run = model.simulate((0, 0.2), {"x": 0.3, "x_dot": 1.0}, {m: 1.3, g: 9.81})
        np.testing.assert_allclose(run["F"], 1.3 * 9.81, rtol=1e-12)
        wanted = 1.3 * run["x_dot"] ** 2 / (1 + run["x"] ** 2)  # x x'' + x'^2 along y, of forces across the slot alone
        np.testing.assert_allclose(run["T"], wanted, rtol=1e-8)


def test_force_of_a_dome_by_a_root():
    """Random places beside the dome have no height, and are left out."""
    P = O.locatenew("P", x * N.x + y * N.y + sqrt(r**2 - x**2 - y**2) * N.z)
    scene = da.Scene("dome", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bead", P, m))
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_joints(da.Joint("dome", body="bead", at=P, force=T * P.pos_from(O) / r))
    model = da.compile_model(scene, backend="numpy", outputs=["T"])
    run = model.simulate((0, 0.1), {"x": 0.1, "y": 0.05, "x_dot": 0.2, "y_dot": -0.1}, {m: 1.3, r: 0.4, g: 9.81})
    height = np.sqrt(0.16 - run["x"] ** 2 - run["y"] ** 2)
    square = run["x_dot"] ** 2 + run["y_dot"] ** 2
    square += ((run["x"] * run["x_dot"] + run["y"] * run["y_dot"]) / height) ** 2
    np.testing.assert_allclose(run["T"], 1.3 * (9.81 * height - square) / 0.4, rtol=1e-10)


# -- chains ----------------------------------------------------------------------------------------------

alpha, beta = dynamicsymbols("alpha beta")
X_1, Y_1, X_2, Y_2 = da.unknowns("X_1 Y_1 X_2 Y_2")


def double_pendulum(pins):
    A, B = N.orientnew("A", "Axis", (alpha, N.z)), N.orientnew("B", "Axis", (beta, N.z))
    G_1, P = O.locatenew("G_1", b * A.x), O.locatenew("P", l * A.x)
    G_2 = P.locatenew("G_2", b * B.x)
    scene = scene_of("double_pendulum", [alpha, beta])
    scene.add_bodies(
        RigidBody("upper", G_1, A, m, (inertia(A, 0, 0, J), G_1)),
        RigidBody("lower", G_2, B, m, (inertia(B, 0, 0, J), G_2)),
    )
    if 1 in pins:
        scene.add_joints(da.Joint("first", body="upper", at=O, force=X_1 * N.x + Y_1 * N.y))
    if 2 in pins:
        scene.add_joints(da.Joint("second", body="lower", other="upper", at=P, force=X_2 * N.x + Y_2 * N.y))
    return scene


@pytest.mark.parametrize("pins", [(1, 2), (1,), (2,)])
def test_pins_of_a_double_pendulum_with_and_without_each_other(pins):
    names = [f"{axis}_{pin}" for pin in pins for axis in "XY"]
    model = da.compile_model(double_pendulum(pins), backend="numpy", outputs=names)
    p = {m: 1.3, b: 0.3, l: 0.7, J: 0.05, g: 9.81}
    start = {alpha: 0.3, beta: -0.4, alpha.diff(): 0.5, beta.diff(): -0.2}
    run = model.simulate((0, 0.3), start, p, t_eval=np.linspace(0, 0.3, 4))
    for i, ((a, c), (da_, dc)) in enumerate(zip(run.q, run.qdot, strict=True)):
        spoke, normal = np.array([np.cos(a), np.sin(a)]), np.array([-np.sin(a), np.cos(a)])
        second, across = np.array([np.cos(c), np.sin(c)]), np.array([-np.sin(c), np.cos(c)])
        states = [
            (*(0.3 * spoke), a, *(0.3 * da_ * normal), da_),
            (*(0.7 * spoke + 0.3 * second), c, *(0.7 * da_ * normal + 0.3 * dc * across), dc),
        ]
        ends = [(0, np.array([-0.3, 0]), None, None), (1, np.array([-0.3, 0]), 0, np.array([0.4, 0]))]
        wanted = pin_forces([1.3, 1.3], [0.05, 0.05], states, ends)
        for name in names:
            axis, pin = name.split("_")
            assert run[name][i] == pytest.approx(wanted[int(pin) - 1]["XY".index(axis)], rel=1e-12)


def test_every_pin_of_a_four_bar_that_constraints_close():
    scene, _, start, p = mechanism("four_bar")
    scene = scene.copy()
    C_x, C_y, D_x, D_y, E_x, E_y = da.unknowns("C_x C_y D_x D_y E_x E_y")
    P = scene.bodies[1].masscenter.locatenew("P_again", -l2 / 2 * scene.bodies[1].frame.x)
    D = scene.bodies[2].masscenter.locatenew("D_again", -l3 / 2 * scene.bodies[2].frame.x)
    own = scene.frame
    scene.add_joints(
        da.Joint("crank", body="crank", at=scene.origin, force=C_x * own.x + C_y * own.y),
        da.Joint("coupler", body="coupler", other="crank", at=P, force=D_x * own.x + D_y * own.y),
        da.Joint("rocker", body="rocker", at=D, force=E_x * own.x + E_y * own.y),
    )
    names = ["R_x", "R_y", "C_x", "C_y", "D_x", "D_y", "E_x", "E_y"]
    run = da.compile_model(scene, backend="numpy", outputs=names).simulate((0, 0.3), start, p, rtol=1e-9)
    values = {s.name: v for s, v in VALUES.items()}
    for i in (0, -1):
        angles, rates = run.q[i], run.qdot[i]
        spokes = [values[n] * np.array([np.cos(a), np.sin(a)]) for n, a in zip(("l1", "l2", "l3"), angles, strict=True)]
        moves = [w * np.array([-s[1], s[0]]) for s, w in zip(spokes, rates, strict=True)]
        centres = [(spokes[0] / 2, moves[0] / 2), (spokes[0] + spokes[1] / 2, moves[0] + moves[1] / 2)]
        centres.append((np.array([values["d"], 0]) + spokes[2] / 2, moves[2] / 2))
        states = [(*c, a, *v, w) for (c, v), a, w in zip(centres, angles, rates, strict=True)]
        half = [np.array([values[n] / 2, 0]) for n in ("l1", "l2", "l3")]
        pins = [
            (2, half[2], 1, half[1]),
            (0, -half[0], None, None),
            (1, -half[1], 0, half[0]),
            (2, -half[2], None, None),
        ]
        wanted = pin_forces(*([values[f"{k}{j}"] for j in (1, 2, 3)] for k in "mJ"), states, pins).ravel()
        found = np.array([run[name][i] for name in names])
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())


def slider_crank(joints):
    """A slider whose place, and a rod whose angle, are functions of the angle of the crank."""
    A, B = N.orientnew("A", "Axis", (theta, N.z)), N.orientnew("B", "Axis", (sp.asin(-l * sin(theta) / L), N.z))
    P = O.locatenew("P", l * A.x)
    G_1, G_2 = O.locatenew("G_1", b * A.x), P.locatenew("G_2", L / 2 * B.x)
    Q = O.locatenew("Q", (l * cos(theta) + sqrt(L**2 - l**2 * sin(theta) ** 2)) * N.x)
    scene = scene_of("slider_crank", [theta])
    scene.add_bodies(
        RigidBody("crank", G_1, A, m, (inertia(A, 0, 0, J), G_1)),
        RigidBody("rod", G_2, B, m, (inertia(B, 0, 0, J), G_2)),
        Particle("slider", Q, M),
    )
    forces = da.unknowns("A_x A_y B_x B_y C_x C_y H")
    listed = [
        da.Joint("main", body="crank", at=O, force=forces[0] * N.x + forces[1] * N.y),
        da.Joint("crankpin", body="rod", other="crank", at=P, force=forces[2] * N.x + forces[3] * N.y),
        da.Joint("wrist", body="slider", other="rod", at=Q, force=forces[4] * N.x + forces[5] * N.y),
        da.Joint("guide", body="slider", at=Q, force=forces[6] * N.y),
    ]
    scene.add_joints(*(joint for joint in listed if joint.name in joints))
    return scene


def test_pins_of_a_slider_crank_in_one_coordinate():
    outputs = {name: name for name in ("A_x", "A_y", "B_x", "B_y", "C_x", "C_y", "H")} | {"a": theta.diff(t, 2)}
    model = da.compile_model(slider_crank(["main", "crankpin", "wrist", "guide"]), backend="numpy", outputs=outputs)
    p = {l: 0.3, L: 1.0, b: 0.1, m: 1.3, M: 2.1, J: 0.05, g: 9.81}
    run = model.simulate((0, 0.1), {theta: 0.5, theta.diff(): 2.0}, p, t_eval=[0, 0.1])
    for i in range(2):
        q, w, a = run["theta"][i], run["theta_dot"][i], run["a"][i]
        sine = -0.3 * np.sin(q)
        phi = np.arcsin(sine)
        rate = -0.3 * np.cos(q) * w / np.cos(phi)
        turn = (0.3 * np.sin(q) * w**2 - 0.3 * np.cos(q) * a + np.sin(phi) * rate**2) / np.cos(phi)

        def second(angle, speed, acceleration):
            spoke = np.array([np.cos(angle), np.sin(angle)])
            return spoke, acceleration * np.array([-spoke[1], spoke[0]]) - speed**2 * spoke

        (_, s_1), (e_2, s_2) = second(q, w, a), second(phi, rate, turn)
        up = np.array([0, 9.81])
        slider = 2.1 * (0.3 * s_1 + 1.0 * s_2 + up)
        on_rod, on_crank = 1.3 * (0.3 * s_1 + 0.5 * s_2 + up), 1.3 * (0.1 * s_1 + up)
        # moments about the mass centre of the rod give C_y; forces give the rest, from the slider on
        C_x = slider[0]
        B_x = on_rod[0] + C_x
        lever = 0.5 * e_2
        # J turn = -lever x (B) + lever x (-C), with B_y = on_rod_y + C_y
        C_y = (0.05 * turn + (-lever[1] * B_x + lever[0] * on_rod[1]) - lever[1] * C_x) / (-2 * lever[0])
        B_y = on_rod[1] + C_y
        wanted = [on_crank[0] + B_x, on_crank[1] + B_y, B_x, B_y, C_x, C_y, slider[1] - C_y]
        found = [run[name][i] for name in ("A_x", "A_y", "B_x", "B_y", "C_x", "C_y", "H")]
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())


# -- contacts ----------------------------------------------------------------------------------------------


def test_rod_on_a_block_in_every_mode_of_its_contact():
    """A block that falls, hits, slides and sticks, with a bob on a rod: the tension is that of the bob's balance."""
    S = N.orientnew("S", "Axis", (theta, N.z))
    P = O.locatenew("P", x * N.x + y * N.y)
    Q = P.locatenew("Q", -l * S.y)
    scene = scene_of("block_and_bob", [x, y, theta])
    scene.add_bodies(Particle("block", P, M), Particle("bob", Q, m))
    press = da.unknowns("press")
    scene.add_joints(
        da.Joint("floor", body="block", at=P, force=press * N.y + F * N.x),
        da.Joint("rod", body="bob", other="block", at=Q, force=T * S.y),
    )
    scene.add_contacts(da.UnilateralContact(press, y))
    scene.add_friction(da.CoulombFriction(press, F, mu=mu))
    outputs = ["T", "press", x.diff(t, 2), y.diff(t, 2), theta.diff(t, 2)]
    model = da.compile_model(scene, outputs=outputs)
    start = {x: 0, y: 0.02, theta: 0.5, x.diff(): 0.6, y.diff(): 0, theta.diff(): 0}
    run = model.simulate((0, 1), start, {m: 0.3, M: 2.0, l: 0.4, g: 9.81, mu: 0.4})
    assert run.success, run.message
    c, s = np.cos(run["theta"]), np.sin(run["theta"])
    a_x = run["x_ddot"] + 0.4 * (c * run["theta_ddot"] - s * run["theta_dot"] ** 2)
    a_y = run["y_ddot"] + 0.4 * (s * run["theta_ddot"] + c * run["theta_dot"] ** 2)
    np.testing.assert_allclose(run["T"], 0.3 * (-s * a_x + c * (a_y + 9.81)), rtol=1e-10, atol=1e-11)
    flying = run["y"] > 1e-9
    assert flying.any() and not run["press"][flying].any() and (run["press"][~flying] > 0).sum() > 5


# -- quaternions -----------------------------------------------------------------------------------------------


def upright(quaternion):
    """An upright on two arms with ball joints and a tie rod: the reactions have power on no component of the length."""
    place, arms = dynamicsymbols("x y z"), dynamicsymbols("upper lower")
    turn = dynamicsymbols("e0 e1 e2 e3") if quaternion else dynamicsymbols("e1 e2 e3")
    U, A, B = ReferenceFrame("U"), *(N.orientnew(n, "Axis", (q, N.x)) for n, q in zip("AB", arms, strict=True))
    U.orient_quaternion(N, turn) if quaternion else U.orient_body_fixed(N, turn, "123")
    G_U = O.locatenew("G_U", sum((q * axis for q, axis in zip(place, N, strict=True)), 0 * N.x))
    pivots = O.locatenew("P_A", 0.2 * N.z), O.locatenew("P_B", -0.2 * N.z), O.locatenew("rack", 0.1 * N.x)
    tips = pivots[0].locatenew("tip_A", 0.4 * A.y), pivots[1].locatenew("tip_B", 0.5 * B.y)
    balls = G_U.locatenew("ball_A", 0.18 * U.z), G_U.locatenew("ball_B", -0.2 * U.z)
    tie = G_U.locatenew("tie", 0.1 * U.x + 0.02 * U.z)
    G_A, G_B = pivots[0].locatenew("G_A", 0.2 * A.y), pivots[1].locatenew("G_B", 0.25 * B.y)
    scene = da.Scene("upright", frame=N, origin=O, coordinates=[*place, *turn, *arms])
    scene.add_bodies(
        RigidBody("upright", G_U, U, 5, (inertia(U, 0.02, 0.03, 0.04), G_U)),
        RigidBody("upper", G_A, A, 2, (inertia(A, 0.02, 0.03, 0.04), G_A)),
        RigidBody("lower", G_B, B, 3, (inertia(B, 0.02, 0.03, 0.04), G_B)),
    )
    gaps = [ball.pos_from(O) - tip.pos_from(O) for ball, tip in zip(balls, tips, strict=True)]
    along = tie.pos_from(pivots[2])
    scene.add_holonomic_constraints(*(gap.dot(axis) for gap in gaps for axis in N), along.dot(along) - L**2)
    if quaternion:
        scene.add_holonomic_constraints(sum(c**2 for c in turn) - 1)
    scene.apply_uniform_gravity(-g * N.z)
    scene.add_loads((G_U, 50 * N.y + 300 * N.z))
    forces = da.unknowns("A_x A_y A_z B_x B_y B_z S")
    vectors = (
        sum((f * axis for f, axis in zip(three, N, strict=True)), 0 * N.x) for three in (forces[:3], forces[3:6])
    )
    for name, ball, vector in zip(("upper", "lower"), balls, vectors, strict=True):
        scene.add_joints(da.Joint(f"ball {name}", body="upright", other=name, at=ball, force=vector))
    scene.add_joints(da.Joint("tie rod", body="upright", at=tie, force=forces[6] * along / L))
    guess = {"x": 0, "y": 0.43, "z": 0, "upper": 0.05, "lower": 0.02} | dict.fromkeys(("e1", "e2", "e3"), 0)
    positions = [gap.to_matrix(N) for gap in (*gaps, along)]
    return scene, [str(f) for f in forces], guess | ({"e0": 1} if quaternion else {}), positions


def test_upright_by_quaternion_has_the_forces_that_virtual_work_gives_in_angles():
    """The equations in angles, and Jacobians of the points by SymPy, give the forces by least squares."""
    p, forces, scenes = {L: 0.5, g: 9.81}, [], [upright(quaternion) for quaternion in (True, False)]
    for (scene, names, guess, _), outputs in zip(scenes, (scenes[0][1], []), strict=True):
        model = da.compile_model(scene, backend="numpy", formulation="projected", outputs=outputs)
        start = model.assemble(guess, p, fixed=["upper"])
        run = model.simulate((0, 1e-3), {name: start[name] for name in guess} | {"upper_dot": 0.5}, p, t_eval=[0])
        forces = forces or [run[name][0] for name in names]
    at, numbers = (0.0, run.q[0], run.qdot[0]), {"L": 0.5, "g": 9.81}
    demand = model.mass_matrix(run.q[0], numbers) @ model.accelerations(*at, numbers) - model.forcing(*at, numbers)
    values = dict(zip(scene.coordinates, run.q[0], strict=True)) | {L: 0.5}

    def numeric(matrix):
        return np.array(matrix.subs(values).evalf(), dtype=float)

    positions = scenes[1][3]
    first, second, rod = (numeric(position.jacobian(scene.coordinates)) for position in positions)
    columns = np.vstack([first, second, numeric(positions[2]).T @ rod / 0.5])
    wanted = np.linalg.lstsq(columns.T, demand, rcond=None)[0]
    # the last bit of the start, in which processors differ, moves them by up to 3e-12 of the largest
    np.testing.assert_allclose(forces, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())


# -- what is not determined, and what is missing ---------------------------------------------------------------


def wheel(*joints):
    """A wheel whose mass centre is pinned by its position alone."""
    W = N.orientnew("W", "Axis", (theta, N.z))
    C = O.locatenew("C", -r * N.y)
    scene = scene_of("wheel", [theta])
    scene.add_bodies(RigidBody("wheel", O, W, m, (inertia(W, 0, 0, J), O)))
    listed = {
        "axle": da.Joint("axle", body="wheel", at=O, force=X * N.x + Y * N.y),
        "contact": da.Joint("contact", body="wheel", at=C, force=F * N.y),
    }
    scene.add_joints(*(listed[name] for name in joints))
    return scene


def test_axle_that_only_the_position_declares_may_carry_what_a_contact_does():
    with pytest.raises(ConstraintError, match=r"F would be another .* between 'wheel' and the fixed frame"):
        da.compile_model(wheel("contact"), backend="numpy", outputs=["F"])
    with pytest.raises(ConstraintError, match=r"only a combination of F with Y"):
        da.compile_model(wheel("contact", "axle"), backend="numpy", outputs=["F"])
    run = da.compile_model(wheel("axle"), backend="numpy", outputs=["X", "Y"]).simulate(
        (0, 1), {theta: 0, theta.diff(): 1}, {m: 1.3, J: 1.0, g: 9.81}
    )
    np.testing.assert_allclose(run["Y"], 1.3 * 9.81, rtol=1e-15)
    assert not run["X"].any()


def stack():
    """Two boxes that slide with the same coordinate: nothing says what the upper one rests on."""
    P, Q = O.locatenew("P", x * N.x), O.locatenew("Q", x * N.x + 3 * N.y)
    scene = scene_of("stack", [x])
    frames = [N.orientnew(name, "Axis", (0, N.z)) for name in "AB"]
    scene.add_bodies(
        RigidBody("lower", P, frames[0], m, (inertia(frames[0], 0, 0, J), P)),
        RigidBody("upper", Q, frames[1], M, (inertia(frames[1], 0, 0, J), Q)),
    )
    scene.add_joints(da.Joint("floor", body="lower", at=P, force=F * N.y))
    return scene, Q


def test_body_without_a_joint_may_rest_on_another():
    scene, Q = stack()
    with pytest.raises(ConstraintError, match="between 'upper' and the fixed frame, which no joint declares"):
        da.compile_model(scene, backend="numpy", outputs=["F"])
    scene.add_joints(da.Joint("between", body="upper", other="lower", at=Q, force=T * N.y))
    model = da.compile_model(scene, backend="numpy", outputs=["F", "T"])
    run = model.simulate((0, 1), {x: 0, x.diff(): 1}, {m: 1.0, M: 2.0, J: 0.1, g: 9.81})
    np.testing.assert_allclose(run["F"], 3 * 9.81, rtol=1e-15)
    np.testing.assert_allclose(run["T"], 2 * 9.81, rtol=1e-15)


def test_wheel_on_a_table_that_moves_may_hang_from_the_fixed_frame():
    """Nothing says that the table carries the wheel, as long as both are located from the origin."""
    z, phi = dynamicsymbols("z phi")

    def normal(kind):
        table = O.locatenew("table", z * N.x)
        wheel = (
            table.locatenew("C", (x - z) * N.x + l * N.y)
            if kind == "located from the table"
            else O.locatenew("C", x * N.x + (y if kind == "height" else l) * N.y)
        )
        W = N.orientnew("W", "Axis", (phi, N.z))
        scene = scene_of("track", [z, x, phi, *([y] if kind == "height" else [])])
        scene.add_bodies(
            RigidBody("table", table, N, M, (inertia(N, 0, 0, J), table)),
            RigidBody("wheel", wheel, W, m, (inertia(W, 0, 0, J), wheel)),
        )
        plane = (table, N.y)
        rolls = da.RollingDisc("floor", "wheel", centre=wheel, radius=l, axis=W.z, plane=plane, other="table")
        scene.add_joints(rolls)
        model = da.compile_model(scene, backend="numpy", outputs=["floor.normal"])
        start = {z: 0, x: 0, phi: 0, z.diff(): 0.1, x.diff(): 1} | ({y: 0.5} if kind == "height" else {})
        return model.simulate((0, 0.1), start, {m: 1.0, M: 2.0, J: 0.1, l: 0.5, g: 9.81})["floor.normal"][-1]

    remedy = "If nothing but 'floor' holds 'wheel', locate its points along the axes of 'table' or from .* a coordinate"
    with pytest.raises(ConstraintError, match=remedy):
        normal("located from the origin")
    assert normal("located from the table") == pytest.approx(9.81, rel=1e-14)
    assert normal("height") == pytest.approx(9.81, rel=1e-14)


def test_rope_over_a_pulley():
    y_2 = -y
    P, Q = O.locatenew("P", y * N.y), O.locatenew("Q", y_2 * N.y)
    scene = scene_of("atwood", [y])
    scene.add_bodies(Particle("left", P, m), Particle("right", Q, M))
    scene.add_joints(da.Joint("rope_1", body="left", at=P, force=T * N.y))
    with pytest.raises(ConstraintError, match="a force or torque on 'right' is missing"):
        da.compile_model(scene, backend="numpy", outputs=["T"])
    scene.add_joints(da.Joint("rope_2", body="right", at=Q, force=T * N.y))
    run = da.compile_model(scene, backend="numpy", outputs=["T"]).simulate(
        (0, 1), {y: 0, y.diff(): 0.1}, {m: 1.0, M: 3.0, g: 9.81}
    )
    np.testing.assert_allclose(run["T"], 2 * 3 / 4 * 9.81, rtol=1e-14)


def test_joint_that_is_missing_in_a_slider_crank_is_named():
    with pytest.raises(ConstraintError, match="between 'slider' and the fixed frame, which no joint declares"):
        da.compile_model(slider_crank(["main", "crankpin", "wrist"]), backend="numpy", outputs=["B_x"])


def test_load_at_what_belongs_to_two_bodies():
    """Two bodies share a frame: which of them a torque on it turns decides what passes between them."""
    S = N.orientnew("S", "Axis", (theta, N.z))
    P = O.locatenew("P", l * S.x)
    scene = scene_of("two_on_a_frame", [theta])
    scene.add_bodies(
        RigidBody("hub", O, S, m, (inertia(S, 0, 0, J), O)), RigidBody("rim", P, S, M, (inertia(S, 0, 0, J), P))
    )
    moment = da.unknowns("moment")
    scene.add_joints(da.Joint("weld", body="rim", other="hub", at=P, force=X * S.x + Y * S.y, torque=moment * N.z))
    scene.add_loads((S, 0.3 * N.z))
    with pytest.raises(ConstraintError, match=r"A load acts at what belongs to both"):
        da.compile_model(scene, backend="numpy", outputs=["moment"])
    scene.loads = ()
    model = da.compile_model(scene, backend="numpy", outputs={"moment": "moment", "a": theta.diff(t, 2)})
    run = model.simulate((0, 0.5), {theta: 0.3, theta.diff(): 1}, {m: 1, M: 2, J: 0.1, l: 0.5, g: 9.81})
    np.testing.assert_allclose(run["moment"], 0.1 * run["a"], rtol=1e-12)
