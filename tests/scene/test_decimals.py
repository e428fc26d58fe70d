"""Scenes written with decimal numbers are read like those with symbols: products that SymPy has rounded still agree."""

import random
import warnings

import numpy as np
import pytest
import sympy as sp
from scipy.spatial.transform import Rotation
from sympy import cos, sin
from sympy.physics.mechanics import (
    Particle,
    Point,
    ReferenceFrame,
    RigidBody,
    System,
    dynamicsymbols,
    inertia,
)

import dalembert as da
from dalembert.errors import ConstraintError, SceneError
from dalembert.ir.graph import Graph
from dalembert.ir.zero_tests import agree
from dalembert.scene.expressions.identity import equal, vanishes
from dalembert.scene.reading import read

t = dynamicsymbols._t
x, y, theta = dynamicsymbols("x y theta")


def turntable(angle, change=0):
    """Return a bead on a line that turns as prescribed; SymPy sets the angular velocity."""
    N, O = ReferenceFrame("N"), Point("O")
    F = N.orientnew("F", "Axis", (angle, N.z))
    if change:
        F.set_ang_vel(N, F.ang_vel_in(N) + change * N.z)
    scene = da.Scene("turntable", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("bead", O.locatenew("P", x * F.x), 1.0))
    return scene


def test_prescribed_turns_with_decimals():
    draw = random.Random(3)
    for _ in range(40):
        a, w = round(draw.uniform(0.1, 9), 2), round(draw.uniform(0.1, 9), 2)
        read(turntable(a * sin(w * t)))
        with pytest.raises(SceneError, match="angular velocity of frame 'F' in 'N' was set to"):
            read(turntable(a * sin(w * t), change=1e-9))


def robot(seed, wrong=0.0):
    """Return two links with rotation matrices of decimals between them, and velocities that are set."""
    rng = np.random.default_rng(seed)
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("robot", frame=N, origin=O, coordinates=[x, y])
    F, P = N, O
    for i, angle in enumerate((x, y)):
        turn = Rotation.random(random_state=rng).as_matrix()
        A, B = ReferenceFrame(f"A{i}"), ReferenceFrame(f"B{i}")
        A.orient_dcm(F, sp.Matrix([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]]) * sp.Matrix(turn))
        B.orient_axis(A, A.z, angle)
        G = P.locatenew(f"G{i}", 0.3 * B.x - 0.7 * B.y)
        G.set_vel(N, G.pos_from(O).dt(N) + wrong * angle.diff() * B.x)
        scene.add_bodies(RigidBody(f"link{i}", G, B, 1.3, (inertia(B, 1.1, 2, 2.5), G)))
        F, P = B, G
    return scene


@pytest.mark.parametrize("seed", range(4))
def test_rotation_matrices_of_decimals(seed):
    read(robot(seed))
    with pytest.raises(SceneError, match="velocity of point 'G0' was set to"):
        read(robot(seed, wrong=1e-6))


def test_rotation_matrix_whose_rounding_happens_to_be_exact():
    N, O = ReferenceFrame("N"), Point("O")
    A = N.orientnew("A", "DCM", sp.Matrix([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]]).T)
    B = A.orientnew("B", "Axis", (x, 0.48 * A.x + 0.64 * A.y + 0.6 * A.z))
    scene = da.Scene("joint", frame=N, origin=O, coordinates=[x])
    G = O.locatenew("G", 0.1 * B.x)
    scene.add_bodies(RigidBody("link", G, B, 1.3, (inertia(B, 1.1, 2, 2.5), G)))
    read(scene)


def test_velocities_of_a_system_with_decimals_follow_from_its_positions():
    N, O = ReferenceFrame("N"), Point("O")
    O.set_vel(N, 0)
    F = N.orientnew("F", "Axis", (0.7 * sin(0.3 * t), N.z))
    P = O.locatenew("P", x * F.x)
    P.set_vel(N, x.diff() * F.x + 0.7 * 0.3 * cos(0.3 * t) * x * F.y)
    system = System(N, O)
    system.add_coordinates(x)
    system.add_speeds(dynamicsymbols("u"))
    system.add_kdes(dynamicsymbols("u") - x.diff())
    system.add_bodies(Particle("bead", P, 1.0))
    assert not da.Scene.from_sympy(system).velocities


def test_inertia_of_a_round_body_on_another_frame():
    """0.1 + 0.2 and 0.3 are one moment of inertia; the rounding of one of them turns with the body."""
    N, O = ReferenceFrame("N"), Point("O")
    B = N.orientnew("B", "Axis", (theta, N.z))
    scene = da.Scene("wheel", frame=N, origin=O, coordinates=[theta])
    scene.add_bodies(RigidBody("wheel", O, B, 1.0, (inertia(N, 0.1 + 0.2, 0.3, 0.5), O)))
    body = read(scene).bodies[0]
    assert all(not entry.deps for row in body.inertia for entry in row)
    scene.bodies = (RigidBody("wheel", O, B, 1.0, (inertia(N, 0.1 + 0.2, 0.300001, 0.5), O)),)
    with pytest.raises(SceneError, match="inertia of body 'wheel' changes along the motion"):
        read(scene)


def test_direction_of_a_release_is_a_unit_vector_up_to_rounding():
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("bead", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("bead", P, 1.0))
    v = np.array([0.3, 0.7, -0.2]) / np.linalg.norm([0.3, 0.7, -0.2])
    assert len(scene.release(y, P, v[0] * N.x + v[1] * N.y + v[2] * N.z).coordinates) == 2
    with pytest.raises(SceneError, match="unit vector"):
        scene.release(y, P, v[0] * N.x + v[1] * N.y + (v[2] + 1e-9) * N.z)


def test_gap_that_is_a_constraint_up_to_rounding():
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("bead", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bead", P, 1.0))
    R = da.unknowns("R")
    scene.add_joints(da.Joint("floor", body="bead", at=P, force=R * N.y))
    scene.add_holonomic_constraints(y - 0.3)
    scene.add_contacts(da.UnilateralContact(R, gap=y - (0.1 + 0.2)))
    assert len(read(scene).holonomic) == 1


def test_equality_of_expressions():
    a, b = sp.symbols("a b")
    assert vanishes(0.7 * 0.3 * a - 0.21 * a + b - b * cos(a) ** 2 - b * sin(a) ** 2)
    assert not vanishes(0.7 * 0.3 * a - 0.2100000001 * a)
    assert not vanishes(a * sp.Rational(1, 10**16) + b - b) and equal(sp.sqrt(2) * a, 2 * a / sp.sqrt(2))
    assert equal(0.36 + 0.64, 1) and not equal(0.36 + 0.64, 1 + 1e-9)


def test_agreement_on_the_graph_is_exact_without_decimals():
    graph = Graph()
    a, b = graph.input("a"), graph.input("b")
    tiny = a / 10**15
    assert agree([(a + b) * (a - b)], [a * a - b * b]) and not agree([b + tiny], [b])
    rounded = graph.decimal(0.1) + graph.decimal(0.2)
    assert agree([rounded * a], [graph.decimal(0.3) * a]) and not agree([rounded * a], [graph.decimal(0.3 + 1e-13) * a])
    assert not agree([graph.call("log", -a) * graph.decimal(0.1)], [b])  # no real value anywhere


def plate(slip):
    """Return a plate on a corner that stands still: what slips is the point of the plate that is there."""
    m, l, h, g = sp.symbols("m l h g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (theta, N.z))
    A = O.locatenew("A", x * N.x + y * N.y)
    G, Q = A.locatenew("G", l * S.x), O.locatenew("Q", h * N.y)
    scene = da.Scene("plate", frame=N, origin=O, coordinates=[x, y, theta])
    scene.add_bodies(RigidBody("plate", G, S, m, (inertia(S, 0, 0, sp.Rational(1, 3) * m * l**2), G)))
    scene.apply_uniform_gravity(-g * N.y)
    N_A, N_Q, F_Q = da.unknowns("N_A N_Q F_Q")
    scene.add_joints(
        da.Joint("ground", body="plate", at=A, force=N_A * N.y),
        da.Joint("corner", body="plate", at=Q, force=N_Q * S.y + F_Q * S.x),
    )
    scene.add_contacts(
        da.UnilateralContact(N_A, gap=y, name="ground"),
        da.UnilateralContact(N_Q, gap=-x * sin(theta) + (y - h) * cos(theta), name="corner"),
    )
    scene.add_friction(da.CoulombFriction(N_Q, F_Q, slip=slip, mu=0.1, name="corner"))
    return scene


def test_slip_velocity_is_compared_where_the_constraints_hold():
    along = x.diff() * cos(theta) + y.diff() * sin(theta)
    start = {"x": -0.8 / np.tan(0.7), "y": 0, "theta": 0.7, "x_dot": 0, "y_dot": 0, "theta_dot": 0}
    parameters, ends = {"m": 1, "l": 1, "h": 0.8, "g": 9.81}, []
    for slip in (None, along):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            model = da.compile_model(plate(slip), backend="numpy")
        ends.append(model.simulate((0, 0.2), start, parameters, rtol=1e-10).q[-1])
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)
    assert abs(ends[0][2] - 0.7) > 1e-3
    for wrong in (-along, 2 * along, x.diff() * cos(theta), along + 1e-5 * theta.diff()):
        with pytest.raises(SceneError, match="not the one that F_Q has power on"):
            da.compile_model(plate(wrong), backend="numpy")


@pytest.mark.parametrize("factor", [1.48, 0.7, 3.3])
def test_multiples_of_a_linear_constraint_in_decimals_are_repetitions(factor):
    """What is left of the constants is their rounding, 1e-17."""
    a, b = dynamicsymbols("a b")
    N, O = ReferenceFrame("N"), Point("O")
    place = O.locatenew("P", a * N.x + b * N.y)
    scene = da.Scene("guided", frame=N, origin=O, coordinates=[a, b])
    scene.add_bodies(Particle("bead", place, 1))
    scene.add_holonomic_constraints(a - sp.Float(0.5) * b - sp.Float(0.13))
    scene.add_holonomic_constraints(sp.Float(factor) * a - sp.Float(0.5 * factor) * b - sp.Float(0.13 * factor))
    model = da.compile_model(scene, backend="numpy")
    assert model.simulate((0, 0.1), {"b": 0.2, "b_dot": 1.0}, {}).success
    with pytest.raises(ConstraintError, match="contradicts"):
        other = sp.Float(factor) * (a - sp.Float(0.5) * b - sp.Float(0.1301))
        scene.add_holonomic_constraints(other)
        da.compile_model(scene, backend="numpy")


def test_constraints_that_agree_on_one_side_of_a_branch_are_two():
    z = dynamicsymbols("z")
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y + z * N.z)
    scene = da.Scene("guided", frame=N, origin=O, coordinates=[x, y, z])
    scene.add_bodies(Particle("bead", P, 1.0))
    scene.add_nonholonomic_constraints(x.diff() - 0.5 * sp.Max(0.2, y) * z.diff(), x.diff() - 0.5 * y * z.diff())
    scene.add_loads((P, N.x - 0.5 * N.y))
    start = {x: 0, y: 0.8, z: 0, y.diff(): 0, z.diff(): 0.7}
    run = da.compile_model(scene).simulate((0, 3), start, {})
    assert run.status.name == "SINGULAR_CONFIGURATION"  # below y = 0.2 they stop the bead, which is an impact
    assert abs(run["y"][-1] - 0.2) < 1e-6 and abs(run.constraint_violation).max() < 1e-9


def test_identities_are_tried_on_both_sides_of_branches():
    """Of functions that are the same for positive arguments of moderate size, and differ elsewhere."""
    x, k = sp.Symbol("x"), sp.Symbol("k", positive=True)
    for other in (
        sp.Max(sp.Rational(1, 5), x),
        sp.Abs(x),
        sp.Max(-5, sp.Min(5, x)),
        sp.Piecewise((x, x < 20), (20, True)),
    ):
        assert not equal(other, x)
        assert not vanishes(other - x)
        assert not equal(sp.Float("0.5") * other, x / 2)
    assert equal(sp.sqrt(x**2), sp.Abs(x))
    assert equal(sp.Abs(k * x), k * sp.Abs(x))
    assert equal(sp.Float("0.25") * sp.Max(x, -x), sp.Abs(x) / 4)
    assert vanishes(sp.Abs(x) ** 2 - x**2)
