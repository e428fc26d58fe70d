"""Constraints classified by the Frobenius condition, against hand results."""

import pytest
import sympy as sp
from sympy import cos, sin
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols
from sympy.vector import CoordSys3D, curl

import dalembert as da
from dalembert.textbook.constraints import classify, frobenius
from textbook.helpers import TIME, same

X, Y, Z, T = q = dynamicsymbols("x y z theta")
R = sp.Symbol("r", positive=True)


@pytest.mark.parametrize(
    ("constraints", "integrable"),
    [
        ([X.diff() - R * T.diff()], [True]),  # rolling on a straight line
        ([Y * X.diff() + X * Y.diff()], [True]),  # d(x y)
        ([Y * X.diff() - X * Y.diff()], [True]),  # with an integrating factor: y / x is constant
        ([Z.diff() - Y * X.diff()], [False]),  # the contact form
        ([-X.diff() * sin(T) + Y.diff() * cos(T)], [False]),  # the blade
        ([-X.diff() * sin(T) + Y.diff() * cos(T), T.diff()], [True, True]),  # the blade, not turning
        ([X.diff() - R * cos(T) * Z.diff(), Y.diff() - R * sin(T) * Z.diff()], [False, False]),  # rolling disk
        ([X.diff() - R * T.diff(), Z.diff() - Y * X.diff()], [True, False]),
        ([X.diff() - cos(TIME)], [True]),
        ([X.diff() - Y], [False]),  # dx - y dt, affine in the rates
    ],
)
def test_verdict(constraints, integrable):
    found = classify([], constraints, q, TIME)
    assert [c.integrable for c in found] == integrable
    assert all((c.obstruction == 0) == c.integrable for c in found)


def test_a_holonomic_constraint_can_make_another_integrable():
    blade = -X.diff() * sin(T) + Y.diff() * cos(T)
    assert not classify([], [blade], q, TIME)[0].integrable
    assert classify([T - R], [blade], q, TIME)[1].integrable


def test_in_three_variables_it_is_a_dot_curl_a():
    C = CoordSys3D("C")
    x, y, z = C.base_scalars()
    a = [y * z, sin(x) * z, x + y**2]
    field = a[0] * C.i + a[1] * C.j + a[2] * C.k
    (value,) = frobenius(a, [x, y, z]).values()
    assert same(value, field.dot(curl(field)))


def test_explicit_time_is_seen():
    scleronomic, rheonomic = classify([], [X.diff() - Y.diff(), X.diff() - TIME * Y.diff()], q, TIME)
    assert not scleronomic.rheonomic
    assert rheonomic.rheonomic


# -- faults of scenes ----------------------------------------------------------------------------


def double_pendulum():
    a, b = dynamicsymbols("a b")
    N, O = ReferenceFrame("N"), Point("O")
    A, B = N.orientnew("A", "Axis", (a, N.z)), N.orientnew("B", "Axis", (b, N.z))
    P = O.locatenew("P", A.x)
    Q = P.locatenew("Q", B.x)
    scene = da.Scene("double", frame=N, origin=O, coordinates=[a, b])
    m = sp.Symbol("m", positive=True)
    scene.add_bodies(Particle("inner", P, m), Particle("outer", Q, m))
    return scene, P, Q


@pytest.mark.parametrize("read", [da.lagrange, lambda scene: da.compile_model(scene, backend="numpy")])
def test_all_faults_at_once(read):
    scene, P, _Q = double_pendulum()
    X1, X2 = da.unknowns("X1 X2")
    N, A = scene.frame, scene.coordinates[0]
    scene.add_joints(
        da.Joint("first", body="middle", at=P, force=X1 * N.x),
        da.Joint("second", body="inner", at=P, force=X2 * N.x),
    )
    scene.add_holonomic_constraints(P.pos_from(scene.origin).dot(P.pos_from(scene.origin)) - 1)
    scene.add_nonholonomic_constraints(A.diff() * (sin(A) ** 2 + cos(A) ** 2 - 1))
    with pytest.raises(da.errors.SceneError) as caught:
        read(scene)
    message = str(caught.value)
    assert "joint 'first' acts on 'middle', which is no body; known: inner, outer" in message
    assert message.count("is already implied by the parametrization") == 2
    assert "declare its reaction as an unknown of a joint" in message
    assert len(caught.value.faults) == 3


@pytest.mark.parametrize("read", [da.lagrange, lambda scene: da.compile_model(scene, backend="numpy")])
def test_action_at_a_point_that_is_not_of_the_body(read):
    scene, _, Q = double_pendulum()
    scene.add_joints(da.Joint("stop", body="inner", at=Q, force=da.unknowns("X1") * scene.frame.x))
    with pytest.raises(
        da.errors.SceneError, match=r"joint 'stop' acts on 'inner' at 'Q'.*changes with b.*Name the body"
    ):
        read(scene)


def test_pair_of_opposite_actions_may_act_between_bodies():
    scene, _, Q = double_pendulum()
    pull = da.unknowns("X1") * scene.frame.x
    scene.add_joints(da.Joint("outer end", "outer", Q, force=pull), da.Joint("inner end", "inner", Q, force=-pull))
    da.lagrange(scene)


def test_contact_that_travels_over_its_body_is_allowed():
    assert da.lagrange(da.scenes.corner_plate()).determined


def test_unknown_that_appears_in_no_equation():
    sphere = da.scenes.rolling_sphere()
    with pytest.raises(da.errors.ConstraintError, match=r"'N' appears in no equation.*scene\.release"):
        da.lagrange(sphere).reactions["N"]
    with pytest.raises(da.errors.UnknownNameError, match="unknown unknown 'F'"):
        da.lagrange(sphere).reactions["F"]


def test_joint_that_cannot_hold_its_constraint():
    scene, P, _Q = double_pendulum()
    a, b = scene.coordinates
    scene.add_holonomic_constraints(a - b)
    scene.apply_uniform_gravity(-sp.Symbol("g", positive=True) * scene.frame.y)
    scene.add_joints(da.Joint("stop", body="inner", at=P, force=da.unknowns("X1") * scene.frame.x))
    with pytest.raises(da.errors.ConstraintError, match="cannot exert the reactions"):
        da.lagrange(scene).reactions  # noqa: B018
    with pytest.raises(da.errors.ConstraintError, match="cannot exert the reactions"):
        da.compile_model(scene, backend="numpy", outputs=["X1"])


def test_wrong_arguments_of_the_view():
    view = da.lagrange(da.scenes.chaplygin_sleigh())
    with pytest.raises(da.errors.SceneError, match="no coordinate of the scene; known: x, y, theta"):
        view.equation("z")
    with pytest.raises(da.errors.SceneError, match="no joint 'hinge'; known: blade"):
        view.action_screw("hinge")
    with pytest.raises(da.errors.SceneError, match="no body 'boat'; known: sleigh"):
        view.kinematic_screw("boat")
    with pytest.raises(da.errors.SceneError, match="takes a Scene"):
        da.lagrange("sleigh")
