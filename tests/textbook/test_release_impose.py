"""Coordinates given back and taken away; constraints and coordinates that depend on time."""

import numpy as np
import pytest
import sympy as sp
from sympy import cos, sin
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.reduction import FORMULATIONS
from textbook.helpers import TIME, agreement, point, same, symbols_of

W, M = sp.symbols("w m", positive=True)


def driven_rod():
    """A bead slides on a smooth rod whose angle is a given function of time; F is the force that enforces it."""
    r, theta = dynamicsymbols("r theta")
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (theta, N.z))
    P = O.locatenew("P", r * S.x)
    scene = da.Scene("driven rod", frame=N, origin=O, coordinates=[r, theta])
    scene.add_bodies(Particle("bead", P, M))
    scene.add_joints(da.Joint("rod", body="bead", at=P, force=da.unknowns("F") * S.y))
    scene.add_holonomic_constraints(theta - W * TIME)
    return scene


def pinned_rod():
    theta = dynamicsymbols("theta")
    m, l, g = sp.symbols("m l g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (theta, N.z))
    A = O.locatenew("A", 0 * N.x)
    G = A.locatenew("G", l * S.x)
    scene = da.Scene("pinned rod", frame=N, origin=O, coordinates=[theta])
    scene.add_bodies(RigidBody("rod", G, S, m, (inertia(S, 0, 0, m * l**2 / 3), G)))
    scene.apply_uniform_gravity(-g * N.y)
    X, Y = da.unknowns("X Y")
    scene.add_joints(da.Joint("pin", body="rod", at=A, force=X * N.x + Y * N.y))
    return scene


# -- given functions of time ---------------------------------------------------------------------


def test_force_that_enforces_a_given_function_of_time():
    scene = driven_rod()
    view = da.lagrange(scene)
    r, _ = scene.coordinates
    (constraint,) = view.constraints
    assert constraint.rheonomic
    assert same(view.equations_of_motion[r.diff(TIME, 2)].subs(scene.coordinates[1].diff(), W), r * W**2)
    assert same(view.reactions["F"].subs(scene.coordinates[1].diff(), W), 2 * M * r.diff() * W)


@pytest.mark.parametrize("formulation", ["auto", *FORMULATIONS])
def test_force_that_enforces_it_is_an_output(formulation):
    model = da.compile_model(driven_rod(), backend="numpy", formulation=formulation, outputs=["F"])
    run = model.simulate((0, 1), {"r": 1, "r_dot": 0, "theta": 0}, {"m": 2.0, "w": 1.5}, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(run["F"], 2 * 2.0 * run["r_dot"] * 1.5, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(run["r"], np.cosh(1.5 * run.t), rtol=1e-6)


def test_given_function_imposed_loses_the_equation_and_the_force():
    scene = driven_rod()
    r, theta = scene.coordinates
    imposed = scene.impose(theta)
    view = da.lagrange(imposed)
    assert view.coordinates == (r,)
    assert same(view.equations_of_motion[r.diff(TIME, 2)], r * W**2)
    assert [str(x) for x in view.undetermined] == ["F"]
    model = da.compile_model(imposed, backend="numpy", outputs=["F"])  # released in the program of reactions alone
    run = model.simulate((0, 1), {"r": 1, "r_dot": 0}, {"m": 2.0, "w": 1.5}, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(run["F"], 2 * 2.0 * run["r_dot"] * 1.5, rtol=1e-10, atol=1e-12)
    assert max(agreement(imposed, view=view)) < 1e-10


def test_rheonomic_nonholonomic_constraint():
    """A sleigh whose blade is steered: the constraint holds time, textbook and compiled agree."""
    scene = da.scenes.chaplygin_sleigh()
    steered = da.Scene("steered", frame=scene.frame, origin=scene.origin, coordinates=scene.coordinates)
    steered.add_bodies(*scene.bodies)
    x, y, theta = scene.coordinates
    angle = theta + sin(W * TIME) / 2
    steered.add_nonholonomic_constraints(-x.diff() * sin(angle) + y.diff() * cos(angle) - W * cos(TIME))
    view = da.lagrange(steered)
    assert view.constraints[0].rheonomic
    assert not view.constraints[0].integrable
    assert max(agreement(steered, view=view)) < 1e-10


# -- release ------------------------------------------------------------------------------------


def test_release_leaves_the_scene_and_sympy_s_points_alone():
    scene = pinned_rod()
    A, x = point(scene, "A"), dynamicsymbols("x")
    before = (scene.coordinates, scene.holonomic_constraints, A.pos_from(scene.origin))
    wider = scene.release(x, A, scene.frame.x)
    assert (scene.coordinates, scene.holonomic_constraints, A.pos_from(scene.origin)) == before
    assert wider.coordinates == (*scene.coordinates, x)
    assert wider.holonomic_constraints == (x,)


def test_two_releases_give_both_forces_of_a_pin():
    scene = pinned_rod()
    A, (theta,) = point(scene, "A"), scene.coordinates
    x, y = dynamicsymbols("x y")
    wider = scene.release(x, A, scene.frame.x).release(y, A, scene.frame.y)
    view = da.lagrange(wider)
    m, l, g = symbols_of(scene, "m l g")
    motion = view.equations_of_motion
    assert same(motion[theta.diff(TIME, 2)], -sp.Rational(3, 4) * g / l * cos(theta))
    G = (l * cos(theta)).diff(TIME, 2).subs(motion), (l * sin(theta)).diff(TIME, 2).subs(motion)
    assert same(view.reactions["X"], m * G[0])
    assert same(view.reactions["Y"], m * G[1] + m * g)
    assert max(agreement(wider, view=view)) < 1e-10


def test_released_rotation_gives_the_moment_that_holds_it():
    """A rod turned by hand about N.z at a given angle: the frame's angle released, and the moment found."""
    m, l, J = sp.symbols("m l J", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (W * TIME**2 / 2, N.z))
    G = O.locatenew("G", l * S.x)
    scene = da.Scene("crank", frame=N, origin=O, coordinates=[dynamicsymbols("s")])
    scene.add_bodies(RigidBody("crank", G, S, m, (inertia(S, 0, 0, J), G)))
    scene.add_bodies(Particle("bead", O.locatenew("P", scene.coordinates[0] * N.z), m))
    scene.add_joints(da.Joint("shaft", body="crank", at=O, torque=da.unknowns("T") * N.z))
    wider = scene.release(dynamicsymbols("phi"), S, N.z)
    view = da.lagrange(wider)
    assert same(view.reactions["T"], (J + m * l**2) * W)
    assert max(agreement(wider, view=view)) < 1e-10


def test_release_faults_are_named():
    scene = pinned_rod()
    A, N, x = point(scene, "A"), scene.frame, dynamicsymbols("x")
    cases = [
        ((scene.coordinates[0], A, N.x), "is a coordinate of the scene already"),
        ((sp.Symbol("x"), A, N.x), "must be made with dynamicsymbols"),
        ((x, scene.origin, N.x), r"because it is the origin.*O\.locatenew\('pin', 0\)"),
        ((x, Point("stray"), N.x), "cannot be released"),
        ((x, "A", N.x), "takes a Point to move or a ReferenceFrame to turn"),
        ((x, A, 2 * N.x), "the length of 2.N.x is not 1"),
        ((x, A, 1), "must be a unit vector"),
    ]
    for arguments, message in cases:
        with pytest.raises(da.errors.SceneError, match=message):
            scene.release(*arguments)
    with pytest.raises(da.errors.SceneError, match="2 faults"):
        scene.release(x, "A", 2 * N.x)


def test_a_pin_at_the_origin_is_released_as_a_point_of_its_own():
    """The reaction of the pin at the origin, against Newton's law for the mass centre."""
    theta, x = dynamicsymbols("theta x")
    m, l, g = sp.symbols("m l g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    S = N.orientnew("S", "Axis", (theta, N.z))
    pin = O.locatenew("pin", 0)
    G = pin.locatenew("G", l * S.x)
    scene = da.Scene("rod", frame=N, origin=O, coordinates=[theta])
    scene.add_bodies(RigidBody("rod", G, S, m, (inertia(S, 0, 0, m * l**2 / 3), G)))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_joints(da.Joint("pin", body="rod", at=pin, force=da.unknowns("X") * N.x))
    dropped = scene.release(x, pin, N.x)
    for each in (dropped, scene):
        model = da.compile_model(each, backend="numpy", outputs={"X": "X", "acc": G.pos_from(O).dt(N).dt(N)})
        run = model.simulate((0, 2), {theta: 0.3, theta.diff(): 1.0}, {m: 2.0, l: 0.5, g: 9.81}, rtol=1e-10)
        np.testing.assert_allclose(run["X"], 2.0 * run["acc_x"], atol=1e-9)


# -- impose -------------------------------------------------------------------------------------


def test_impose_with_an_expression_of_one_s_own():
    scene = da.scenes.corner_plate()
    x, theta = scene.coordinates
    (h,) = symbols_of(scene, "h")
    by_solving, by_hand = scene.impose(x), scene.impose(theta, sp.acot(-x / h))
    assert by_solving.holonomic_constraints == by_hand.holonomic_constraints == ()
    assert by_solving.coordinates == (theta,)
    full = da.lagrange(scene).equations_of_motion[theta.diff(TIME, 2)]
    view = da.lagrange(by_solving)
    assert same(view.equations_of_motion[theta.diff(TIME, 2)], full)
    assert max(agreement(by_solving, view=view)) < 1e-10


def test_impose_after_release_gives_the_scene_back():
    scene = da.scenes.corner_plate()
    y = dynamicsymbols("y")
    again = scene.release(y, point(scene, "A"), scene.frame.y).impose(y)
    assert again.coordinates == scene.coordinates
    first, second = da.lagrange(scene), da.lagrange(again)
    for q in scene.coordinates:
        assert same(first.equation(q).lhs - first.equation(q).rhs, second.equation(q).lhs - second.equation(q).rhs)


def test_impose_faults_are_named():
    scene = da.scenes.edge_plate()
    x, _y, z, _psi, theta = scene.coordinates
    with pytest.raises(da.errors.SceneError, match="gives theta in closed form"):
        scene.impose(theta)
    with pytest.raises(da.errors.SceneError, match="no holonomic constraint contains x"):
        scene.impose(x)
    with pytest.raises(da.errors.SceneError, match="no coordinate of the scene"):
        scene.impose(dynamicsymbols("w"))
    with pytest.raises(da.errors.SceneError, match="which contains it"):
        scene.impose(z, z**2)
    with pytest.raises(da.errors.SceneError, match="which contains rates"):
        scene.impose(z, theta.diff())
    with pytest.raises(da.errors.SceneError, match="is no coordinate of the scene"):
        scene.impose(z, dynamicsymbols("w"))
    sleigh = da.scenes.chaplygin_sleigh()
    with pytest.raises(da.errors.SceneError, match="nonholonomic constraint cannot be used to eliminate"):
        sleigh.impose(sleigh.coordinates[0])
    crank = da.Scene("crank", frame=scene.frame, origin=scene.origin, coordinates=[x])
    crank.add_holonomic_constraints(x - 1)
    with pytest.raises(da.errors.SceneError, match="contradicts the constraint"):
        crank.impose(x, 2)
