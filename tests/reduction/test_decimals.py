"""Scenes written with decimals: the same motion as with the rationals that are meant, or the same named error."""

import math
import random

import numpy as np
import pytest
from sympy import Rational, cos, pi, sin, sqrt, symbols, sympify
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import (
    ConstraintError,
    ExpressionError,
    InitialStateError,
    SingularMassMatrixError,
    ValueInputError,
)
from dalembert.methods.status import Status
from dalembert.reduction import FORMULATIONS

ALL = ["auto", *FORMULATIONS]


def bead(*constraints, rates=()):
    """A particle in space under gravity; constraints are functions of x, y, z, or of their rates."""
    x, y, z = q = dynamicsymbols("x y z")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("bead", frame=N, origin=O, coordinates=q)
    scene.add_bodies(Particle("bead", O.locatenew("P", x * N.x + y * N.y + z * N.z), 1))
    scene.apply_uniform_gravity(-10 * N.y)
    scene.add_holonomic_constraints(*(c(*q) for c in constraints))
    scene.add_nonholonomic_constraints(*(c(*(v.diff() for v in q)) for c in rates))
    return scene


def cart(*offsets):
    """A cart with wheels at some offsets ahead of its mass centre: all on one axle where the offsets are equal."""
    x, y, theta = q = dynamicsymbols("x y theta")
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (theta, N.z))
    C = O.locatenew("C", x * N.x + y * N.y)
    scene = da.Scene("cart", frame=N, origin=O, coordinates=q)
    scene.add_bodies(RigidBody("cart", C, S, 2, (inertia(S, 0, 0, 1), C)))
    for b in offsets:
        scene.add_nonholonomic_constraints(-x.diff() * sin(theta) + y.diff() * cos(theta) + b * theta.diff())
    return scene


def end(scene, start, parameters=(), formulation="auto", **options):
    model = da.compile_model(scene, backend="numpy", formulation=formulation)
    run = model.simulate((0, 1), start, dict(parameters), rtol=1e-9, atol=1e-10, **options)
    assert run.success, run.message
    return run, model


TURN = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 1, "theta_dot": 1}


@pytest.mark.parametrize("formulation", ALL)
def test_two_wheels_on_one_axle(formulation):
    right, _ = end(cart(Rational(1, 10)), TURN)
    run, model = end(cart(0.1, 0.5 - 0.4), TURN, formulation=formulation)
    np.testing.assert_allclose(run.q[-1], right.q[-1], atol=1e-8)
    assert "left out, because they follow from the other constraints: nonholonomic constraint 2" in model.explain()


@pytest.mark.parametrize("formulation", ["auto", "minimal"])
def test_wheels_a_nanometre_apart_are_two_constraints(formulation):
    run, model = end(cart(0.1, 0.1 + 1e-9), TURN | {"theta_dot": 0}, formulation=formulation)
    assert np.all(np.abs(run["theta"] - 0.2) < 1e-12) and "left out, because" not in model.explain()
    with pytest.raises(ConstraintError, match="double precision"):
        da.compile_model(cart(0.1, 0.1 + 1e-9), backend="numpy", formulation="projected")


@pytest.mark.parametrize("formulation", ALL)
def test_rails(formulation):
    start = {"x": 0, "z": 0, "x_dot": 1, "z_dot": 0}
    run, model = end(bead(lambda x, y, z: y - (0.1 + 0.2), lambda x, y, z: y - 0.3), start, formulation=formulation)
    np.testing.assert_allclose(run.q[-1], [1, 0.3, 0], atol=1e-9)
    assert "left out, because" in model.explain()
    for other in (0.31, 0.3 + 1e-9):
        with pytest.raises(ConstraintError, match=r"holonomic constraint 2.*contradicts"):
            end(bead(lambda x, y, z: y - 0.3, lambda x, y, z, o=other: y - o), start, formulation=formulation)


REPEATS = {
    "product": (lambda x, y, z: 0.1 * x - 0.2 * y, lambda x, y, z: (0.1 * 3) * x - (0.2 * 3) * y),
    "root": (lambda x, y, z: x - 2 * y, lambda x, y, z: sqrt(0.7) * sqrt(0.7) * x - 1.4 * y),
    "pi": (lambda x, y, z: x - 2 * y, lambda x, y, z: 0.7 * pi * x - (2 * 0.7 * math.pi) * y),
    "sine": (lambda x, y, z: sin(z - Rational(3, 10)) + x - 2 * y, lambda x, y, z: sin(z - 0.3) + x - 2 * y),
    "many orders": (lambda x, y, z: 1e-20 * x - 2e-20 * y, lambda x, y, z: 3e15 * x - (2 * 3e15) * y),
    "sum of two": (lambda x, y, z: 0.3 * x - 0.6 * y + 0.7 * z, lambda x, y, z: 0.21 * x - 0.42 * y + (0.7 * 0.7) * z),
}


@pytest.mark.parametrize("formulation", ["auto", "projected"])
@pytest.mark.parametrize("name", REPEATS)
def test_a_constraint_that_repeats_another_up_to_rounding_is_left_out(name, formulation):
    first, second = REPEATS[name]
    start = {"x": 0, "z": 0.3 if name == "sine" else 0, "x_dot": 0, "z_dot": 0}
    one, _ = end(bead(first), start)
    run, model = end(bead(first, second), start, formulation=formulation)
    np.testing.assert_allclose(run.q[-1], one.q[-1], atol=1e-8)
    assert "left out, because" in model.explain()


@pytest.mark.parametrize("formulation", ["auto", "projected"])
def test_repeated_constraints_that_differ_by_parameters_are_decided_at_the_start(formulation):
    """What is left of the second is rounding times x, and b - 3 a."""
    a, b = symbols("a b")
    first = lambda x, y, z: 0.7 * sin(z) - x - a  # noqa: E731
    scene = bead(first, lambda x, y, z: (0.7 * 3) * sin(z) - 3 * x - b)
    start = {"z": 0.4, "z_dot": 0, "y": 0, "y_dot": 0}
    run, model = end(scene, start, {a: 0.1, b: 0.1 * 3}, formulation)
    assert "left out, because" in model.explain()
    np.testing.assert_allclose(run.q[-1], [0.7 * math.sin(0.4) - 0.1, -5, 0.4], atol=1e-8)
    with pytest.raises(InitialStateError, match="holonomic constraint 2"):
        model.simulate((0, 1), start, {a: 0.1, b: 0.3 + 1e-6})
    for rest in (0.2, 1e-9):
        with pytest.raises(ConstraintError, match=r"holonomic constraint 2.*contradicts"):
            last = lambda x, y, z, c=rest: (0.7 * 3) * sin(z) - 3 * x - 3.0 * a - c  # noqa: E731
            da.compile_model(bead(first, last), backend="numpy", formulation=formulation)


@pytest.mark.parametrize("formulation", ALL)
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("kind", ["positions", "rates"])
def test_random_constraints_of_which_the_last_is_a_combination(seed, kind, formulation):
    draw = random.Random(f"{kind} {seed}")
    digits = draw.choice([1, 2, 16])
    rows = [[round(draw.uniform(-5, 5), digits) for _ in range(3)] for _ in range(2)]
    a, b = (round(draw.uniform(-5, 5), digits) for _ in range(2))
    rows.append([a * u + b * v for u, v in zip(*rows, strict=True)])

    def functions(some):
        return [lambda x, y, z, r=r: r[0] * x + r[1] * y + r[2] * z for r in some]

    some, all_ = functions(rows[:2]), functions(rows)
    start = dict.fromkeys(["x", "y", "z", "x_dot", "y_dot", "z_dot"], 0.0)
    scenes = (bead(*some), bead(*all_)) if kind == "positions" else (bead(rates=some), bead(rates=all_))
    direction = np.cross(rows[0], rows[1])
    right = -5 * direction[1] * direction / (direction @ direction)
    for scene in scenes:
        run, _ = end(scene, start, formulation=formulation)
        np.testing.assert_allclose(run.q[-1], right, atol=1e-7)


def three_coordinates(length, angle, constrained=True):
    """A particle with two degrees of freedom and three coordinates."""
    x, y, theta = q = dynamicsymbols("x y theta")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("three", frame=N, origin=O, coordinates=q)
    P = O.locatenew("P", (x + length * cos(theta)) * N.x + (y + length * sin(theta)) * N.y)
    scene.add_bodies(Particle("p", P, 1))
    scene.apply_uniform_gravity(-10 * N.y)
    if constrained:
        scene.add_holonomic_constraints(x - sin(theta - angle))
    return scene


@pytest.mark.parametrize("formulation", ALL)
@pytest.mark.parametrize("length", [Rational(7, 10), 0.7, 0.1 * 7])
def test_more_coordinates_than_degrees_of_freedom(length, formulation):
    for angle in (Rational(3, 10), 0.3):
        start = {"y": 0, "theta": 0.4, "x": math.sin(0.1), "y_dot": 0, "theta_dot": 0}
        run, _ = end(three_coordinates(length, angle), start, formulation=formulation)
        place = run.q[:, :2] + 0.7 * np.column_stack([np.cos(run.q[:, 2]), np.sin(run.q[:, 2])])
        np.testing.assert_allclose(place[-1] - place[0], [0, -5], atol=1e-7)
    with pytest.raises(SingularMassMatrixError):
        da.compile_model(three_coordinates(length, 0, constrained=False), backend="numpy", formulation=formulation)


@pytest.mark.parametrize("formulation", ALL)
def test_two_coordinates_of_one_motion_up_to_rounding_are_singular(formulation):
    u, v = q = dynamicsymbols("u v")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("one", frame=N, origin=O, coordinates=q)
    P = O.locatenew("P", (0.1 * u + 0.2 * v) * N.x + ((0.1 * 3) * u + (0.2 * 3) * v) * N.y)
    scene.add_bodies(Particle("p", P, 1.3))
    with pytest.raises(SingularMassMatrixError):
        da.compile_model(scene, backend="numpy", formulation=formulation)


@pytest.mark.parametrize("formulation", ALL)
def test_two_coordinates_of_one_motion_by_parameters_are_singular(formulation):
    a, b, c, d = symbols("a b c d")
    u, v = q = dynamicsymbols("u v")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("one", frame=N, origin=O, coordinates=q)
    scene.add_bodies(Particle("p", O.locatenew("P", (a * u + b * v) * N.x + (c * u + d * v) * N.y), 1.3))
    scene.apply_uniform_gravity(-10 * N.y)
    model = da.compile_model(scene, backend="numpy", formulation=formulation)
    start = {"u": 0, "v": 0, "u_dot": 0, "v_dot": 0}
    draw = random.Random(0)
    for _ in range(5):
        x, y, k = (draw.uniform(0.1, 3) for _ in range(3))
        with pytest.raises((SingularMassMatrixError, ValueInputError)):
            model.simulate((0, 1), start, {a: x, b: y, c: x * k, d: y * k})
        assert model.simulate((0, 1), start, {a: x, b: y, c: x * k, d: y * k * (1 + 1e-5)}).success
    sweep = model.sweep((0, 1), start, {"a": 1.1, "b": 0.7, "c": 1.1 * 2.31, "d": [0.7 * 2.31, 3.0]})
    assert list(sweep.status) in ([Status.INITIAL_STATE, Status.SUCCESS], [Status.NON_FINITE, Status.SUCCESS])


def test_masses_of_many_orders_are_regular():
    """A light bead on a heavy block: the pivots are small, and not what is left of larger terms."""
    u, v = q = dynamicsymbols("u v")
    k = symbols("k")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("two", frame=N, origin=O, coordinates=q)
    P = O.locatenew("P", u * N.x)
    B = P.locatenew("B", v * N.x)
    scene.add_bodies(Particle("block", P, 1.7e3), Particle("bead", B, 3e-17))
    scene.add_loads((B, 3e-17 * k * N.x))
    run, _ = end(scene, {"u": 0, "v": 0, "u_dot": 0, "v_dot": 0}, {k: 2})
    np.testing.assert_allclose(run.q[-1], [0, 1], atol=1e-9)


# -- the same numbers as parameters of a run ------------------------------------------------


@pytest.mark.parametrize("formulation", ALL)
def test_two_wheels_on_one_axle_by_parameters(formulation):
    right, _ = end(cart(Rational(1, 10)), TURN)
    b = symbols("b1 b2")
    for second in (0.1, 0.5 - 0.4):
        run, model = end(cart(*b), TURN, {b[0]: 0.1, b[1]: second}, formulation)
        np.testing.assert_allclose(run.q[-1], right.q[-1], atol=1e-8)
        assert "not enforced, because it follows from the others around the start: nonholonomic" in run.message
    sweep = model.sweep((0, 1), TURN, {"b1": [0.1, 0.2], "b2": [0.5 - 0.4, 0.2]}, rtol=1e-9)
    assert sweep.success.all() and abs(sweep["theta"][0] - right["theta"][-1]) < 1e-8


@pytest.mark.parametrize("formulation", ALL)
def test_wheels_a_nanometre_apart_by_parameters_are_not_one(formulation):
    b1, b2 = b = symbols("b1 b2")
    model = da.compile_model(cart(*b), backend="numpy", formulation=formulation)
    values = {b1: 0.1, b2: 0.1 + 1e-9}
    if model.formulation == "minimal":
        with pytest.raises(InitialStateError, match=r"theta_dot: 1 was given, .* 0 .*\n.*nonholonomic constraint"):
            model.simulate((0, 1), TURN, values)
        sweep = model.sweep((0, 1), TURN, {"b1": 0.1, "b2": [0.1 + 1e-9, 0.3]})
        assert list(sweep.status) == [Status.INITIAL_STATE, Status.INITIAL_STATE]
        run = model.simulate((0, 1), TURN | {"theta_dot": 0}, values)
        assert run.success and np.all(np.abs(run["theta"] - 0.2) < 1e-12)
    else:
        run = model.simulate((0, 1), TURN, values)
        assert run.status is Status.SINGULAR_CONFIGURATION and "double precision" in run.message


@pytest.mark.parametrize("formulation", ALL)
@pytest.mark.parametrize("kind", ["positions", "rates"])
def test_random_multiples_by_parameters(kind, formulation):
    a, b, c, d = symbols("a b c d")
    first, second = (lambda x, y, z: a * x - b * y), (lambda x, y, z: c * x - d * y)
    scene = bead(first, second) if kind == "positions" else bead(rates=(first, second))
    model = da.compile_model(scene, backend="numpy", formulation=formulation)
    draw = random.Random(kind)
    for _ in range(4):
        u, v, k = (round(draw.uniform(-5, 5), draw.choice([2, 16])) for _ in range(3))
        start = {"x": v, "y": u, "z": 0, "x_dot": 0, "y_dot": 0, "z_dot": 0}
        run = model.simulate((0, 1), start, {a: u, b: v, c: u * k, d: v * k}, rtol=1e-9)
        fall = -5 * u / (u * u + v * v)
        assert run.success
        np.testing.assert_allclose(run.q[-1], [v + fall * v, u + fall * u, 0], atol=1e-6)
        with pytest.raises(InitialStateError, match="constraint 2"):
            model.simulate((0, 1), start | {"x_dot": v, "y_dot": u}, {a: u, b: v, c: u * k, d: v * k + 1}, rtol=1e-9)


def test_compiled_sweeps_refuse_what_the_state_does_not_reproduce():
    model = da.compile_model(cart(0.1, symbols("b")), formulation="minimal")
    start = TURN | {"y_dot": math.tan(0.2) - 0.1 / math.cos(0.2), "theta_dot": [1.0, 0.0], "x_dot": [1.0, 0.98]}
    start["y_dot"] = [(math.sin(0.2) - 0.1) / math.cos(0.2), 0.98 * math.tan(0.2)]
    sweep = model.sweep((0, 1), start, {"b": 0.1 + 1e-9})
    assert list(sweep.status) == [Status.INITIAL_STATE, Status.SUCCESS]


# -- closed loops, and numbers beyond double precision ----------------------------------------


def four_bar(*combinations):
    """Three cranks that close on a base; each combination of the two closure equations, less an offset, is one more."""
    q = dynamicsymbols("a b c")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("four_bar", frame=N, origin=O, coordinates=q)
    P, F = O, N
    for i, (angle, length) in enumerate(zip(q, (0.3, 0.7, 0.55), strict=True)):
        F = F.orientnew(f"F{i}", "Axis", (angle, F.z))
        G = P.locatenew(f"G{i}", length / 2 * F.x)
        scene.add_bodies(RigidBody(f"bar{i}", G, F, 1.3, (inertia(F, 0, 0, 0.07), G)))
        P = P.locatenew(f"P{i}", length * F.x)
    scene.apply_uniform_gravity(-9.81 * N.y)
    along, across = (P.pos_from(O).dot(axis) - offset for axis, offset in ((N.x, 0.8), (N.y, 0)))
    scene.add_holonomic_constraints(along, across, *(u * along + v * across - w for u, v, w in combinations))
    return scene


def test_loops_that_are_closed_twice():
    plain = da.compile_model(four_bar(), backend="numpy")
    start = plain.assemble({"a": 1.2, "b": -1.0, "c": -1.2, "a_dot": 0.5}, {})
    right = plain.simulate((0, 0.1), start, {}, rtol=1e-7)
    c, s = math.cos(0.7), math.sin(0.7)
    model = da.compile_model(four_bar((0.37, 1.7, 0), (c, s, 0), (-s, c, 0)), backend="numpy")
    run = model.simulate((0, 0.1), start, {}, rtol=1e-7)
    assert run.success and "left out, because" in model.explain()
    np.testing.assert_allclose(run.q[-1], right.q[-1], atol=1e-6)
    with pytest.raises(ConstraintError, match="contradicts"):
        da.compile_model(four_bar((0.37, 1.7, 1e-9)), backend="numpy")


@pytest.mark.parametrize("number", ["10**400", "1e400", "1e200*10**200", "-10**400"])
def test_numbers_beyond_double_precision_are_named(number):
    x = dynamicsymbols("x")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("stiff", frame=N, origin=O, coordinates=[x])
    P = O.locatenew("P", x * N.x)
    scene.add_bodies(Particle("p", P, 1))
    scene.add_loads((P, -sympify(number) * x * N.x))
    with pytest.raises(ExpressionError, match=r"1\.8e308"):
        da.compile_model(scene, backend="numpy")
