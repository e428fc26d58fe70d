"""Joints of SymPy in a scene: their motion, what they bring, and what contradicts them."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import PinJoint, Point, ReferenceFrame, RigidBody, WeldJoint, dynamicsymbols, inertia
from sympy.physics.mechanics.joint import Joint as AnyJoint

import dalembert as da
from dalembert.errors import SceneError, UnknownNameError
from interop.sympy_systems import Case, sympy_rates
from scene.sympy_trees import KINDS, PARAMETERS, m, tree

N, O = ReferenceFrame("N"), Point("O")


@pytest.mark.parametrize("kind", KINDS)
def test_accelerations_are_those_of_sympy(kind):
    """Against mass_matrix_full and forcing_full of a System of the same joints."""
    model = da.compile_model(tree(kind).scene(), backend="numpy", cache=False)
    other = tree(kind)
    state = other.state()
    expected = sympy_rates(Case(other.system(), PARAMETERS, state), 0, state)
    motion = model.simulate((0, 1e-3), state, PARAMETERS)
    found = model.accelerations(0, motion.q[0], motion.qdot[0], PARAMETERS)
    pairs = [pair for joint in other.joints for pair in zip(joint.coordinates, joint.speeds, strict=True)]
    speeds = {q.func.__name__: u.func.__name__ for q, u in pairs}
    assert len(found) == len(speeds) == len(model.layout.coordinates)
    for name, value in zip(model.layout.coordinates, found, strict=True):
        assert value == pytest.approx(expected[speeds[name]], rel=1e-12, abs=1e-12), name


def arm(scene=None, **options):
    """Return an arm of two rods by two pins, and its parts."""
    N, O = ReferenceFrame("N"), Point("O")
    q1, q2 = dynamicsymbols("q1 q2")
    ground = RigidBody("ground", masscenter=O, frame=N)
    upper, lower = RigidBody("upper", mass=m), RigidBody("lower", mass=m)
    upper.central_inertia, lower.central_inertia = (inertia(b.frame, 0, 0, m / 12) for b in (upper, lower))
    scene = da.Scene("arm", frame=N, origin=O, **options)
    shoulder = PinJoint("shoulder", ground, upper, q1, child_point=-upper.x / 2, joint_axis=N.z)
    elbow = PinJoint("elbow", upper, lower, q2, None, upper.x / 2, -lower.x / 2, joint_axis=upper.z)
    return scene, shoulder, elbow


def test_what_joints_bring():
    scene, shoulder, elbow = arm()
    scene.add_joints(elbow, shoulder)
    assert [body.name for body in scene.bodies] == ["upper", "lower"]
    assert [q.func.__name__ for q in scene.coordinates] == ["q2", "q1"]
    assert [u.func.__name__ for u in scene.speeds] == ["u_elbow", "u_shoulder"]
    model = da.compile_model(scene, backend="numpy", cache=False)
    assert model.layout.parameters == ("m",) and not model.layout.unknowns
    assert "the reactions of 'elbow', 'shoulder', such as 'elbow.force_x'" in model.explain()
    motion = model.simulate((0, 0.1), {"q1": 0.1, "q2": 0.2, "u_shoulder": 0.3, "q2_dot": 0.4}, {m: 1})
    assert motion["u_elbow"][0] == 0.4 and motion["q1_dot"][0] == 0.3


def test_bodies_and_coordinates_may_be_named_again():
    q1, q2 = dynamicsymbols("q1 q2")
    scene, shoulder, elbow = arm(coordinates=[q1, q2])
    scene.add_bodies(shoulder.child)
    scene.add_joints(shoulder, elbow)
    scene.add_bodies(elbow.child)
    assert [body.name for body in scene.bodies] == ["upper", "lower"] and scene.coordinates == (q1, q2)
    plain, *joints = arm()
    plain.add_joints(*joints)
    texts = [str(da.compile_model(s, backend="numpy", cache=False).stages.program) for s in (scene, plain)]
    assert texts[0] == texts[1]


def test_a_reversed_joint():
    """The ground as the child: the bodies hang on it all the same."""
    N, O, q = ReferenceFrame("N"), Point("O"), dynamicsymbols("q")
    ground, rod = RigidBody("ground", masscenter=O, frame=N), RigidBody("rod", mass=m)
    rod.central_inertia = inertia(rod.frame, 0, 0, m / 12)
    scene = da.Scene("reversed", frame=N, origin=O)
    scene.add_joints(PinJoint("pivot", rod, ground, q, parent_point=-rod.x / 2, joint_axis=rod.z))
    scene.apply_uniform_gravity(-10 * N.y)
    assert [body.name for body in scene.bodies] == ["rod"]
    found = da.compile_model(scene, backend="numpy", cache=False).accelerations(0, [0.4], [0.0], {m: 1})
    assert found == pytest.approx(10 / 2 / (1 / 3) * np.cos(0.4), rel=1e-14)


def test_welds_in_a_row_are_bodies_at_rest():
    """Both are in the scene, and each weld carries what stands on it."""
    N, O = ReferenceFrame("N"), Point("O")
    ground, *blocks = RigidBody("ground", masscenter=O, frame=N), *(RigidBody(name, mass=m) for name in ("low", "high"))
    rotor = RigidBody("rotor", mass=m)
    for body in (*blocks, rotor):
        body.central_inertia = inertia(body.frame, 1, 1, 1)
    scene = da.Scene("column", frame=N, origin=O)
    scene.add_joints(WeldJoint("foot", ground, blocks[0]), WeldJoint("top", blocks[0], blocks[1], -blocks[0].x))
    scene.add_joints(PinJoint("axle", blocks[1], rotor, joint_axis=N.z))
    scene.apply_uniform_gravity(-10 * N.y)
    assert [body.name for body in scene.bodies] == ["low", "high", "rotor"]
    model = da.compile_model(
        scene, outputs=["foot.force_y", "top.force_y", "foot.torque_z"], backend="numpy", cache=False
    )
    run = model.simulate((0, 0.1), {"q_axle": 0, "u_axle": 1}, {m: 2})
    assert [run[name][-1] for name in ("foot.force_y", "top.force_y", "foot.torque_z")] == pytest.approx([60, 40, -40])


# -- faults -------------------------------------------------------------------------------------------


def refused(scene, *joints):
    with pytest.raises(SceneError) as caught:
        scene.add_joints(*joints)
    return str(caught.value)


def test_two_joints_of_one_name():
    scene, shoulder, elbow = arm()
    scene.add_joints(shoulder)
    elbow._name = "shoulder"
    assert "two joints are called 'shoulder'; give each its own name" in refused(scene, elbow)
    pin = da.Joint("shoulder", body="upper", at=scene.origin, force=da.unknowns("F") * scene.frame.x)
    assert "two joints are called 'shoulder'" in refused(scene, pin)


@pytest.mark.filterwarnings("ignore:Loops are defined")
def test_a_joint_that_closes_a_loop():
    scene, shoulder, elbow = arm()
    scene.add_joints(shoulder, elbow)
    closing = WeldJoint("closing", shoulder.parent, elbow.child)
    assert "'closing' closes a loop: other joints connect 'ground' and 'lower'" in refused(scene, closing)


def test_a_coordinate_with_two_speeds():
    scene, shoulder, elbow = arm()
    scene.add_joints(shoulder)
    again = PinJoint("elbow", elbow.parent, elbow.child, shoulder.coordinates[0], joint_axis=elbow.parent.z)
    text = refused(scene, again)
    assert "gives the coordinate 'q1' the speed u_elbow(t), and another joint gives it u_shoulder(t)" in text


@pytest.mark.filterwarnings("ignore:Loops are defined")
def test_a_class_of_its_own():
    class Screw(PinJoint):
        pass

    scene, shoulder, elbow = arm()
    screw = Screw("screw", shoulder.parent, elbow.child)
    assert "is a Screw; known: PinJoint, PrismaticJoint" in refused(scene, screw)
    assert isinstance(screw, AnyJoint)


def test_a_ground_that_is_not_that_of_the_scene():
    ground, rod = RigidBody("ground"), RigidBody("rod", mass=m)
    scene = da.Scene("lost", frame=N, origin=O)
    scene.add_joints(PinJoint("pivot", ground, rod))
    with pytest.raises(SceneError, match=r"'pivot' hangs on 'ground', which nothing connects .* frame=ground.frame"):
        da.compile_model(scene)


def test_a_body_that_is_located_already():
    scene, shoulder, elbow = arm()
    scene.add_joints(shoulder, elbow)
    elbow.child.masscenter.set_pos(scene.origin, sp.Symbol("d") * scene.frame.x)
    with pytest.raises(SceneError, match="joint 'elbow' contradicts how 'lower' is located already"):
        da.compile_model(scene)


def test_a_component_that_no_joint_has():
    scene, shoulder, _ = arm()
    scene.add_joints(shoulder)
    with pytest.raises(UnknownNameError, match=r"'shoulder.force_w'. .*Known: shoulder.force_x, shoulder.force_y"):
        da.compile_model(scene, outputs=["shoulder.force_w"])
    with pytest.raises(UnknownNameError, match=r"unknown joint 'knee'. Known: shoulder"):
        scene.reaction("knee")


def test_the_reaction_of_a_plain_joint():
    scene, shoulder, elbow = arm()
    scene.add_joints(shoulder, elbow)
    T, F = da.unknowns("T F")
    tip = elbow.child.masscenter
    scene.add_joints(da.Joint("floor", body="lower", at=tip, force=T * N.x + F * N.y, torque=2 * T * N.z))
    scene.add_joints(da.Joint("spring", body="lower", at=tip, force=3 * N.x))
    with pytest.raises(UnknownNameError, match=r"'floor' is a plain da\.Joint.*\(scene, outputs=\['F', 'T'\]\)\. "):
        scene.reaction("floor")
    with pytest.raises(UnknownNameError, match=r"'spring' is a plain da\.Joint.* and it has none"):
        scene.reaction("spring")


def test_no_coordinates_at_all():
    scene = da.Scene("empty", frame=N, origin=O)
    with pytest.raises(SceneError, match=r"no coordinates; give them as coordinates=.*, or add joints of SymPy"):
        da.compile_model(scene)
