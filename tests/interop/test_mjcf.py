"""Scenes of MJCF files: accelerations of MuJoCo, equalities against the same robots without them, and faults."""

import json
from pathlib import Path

import numpy as np
import pytest

import dalembert as da
from dalembert.errors import OptionError, SceneError
from interop.robot_texts import CRANE, PUCK

REFERENCE = json.loads((Path(__file__).parent / "mujoco_references.json").read_text())


def scene_of(tmp_path, text, name="model.xml", **options):
    path = tmp_path / name
    path.write_text(text)
    return da.Scene.from_mjcf(path, **options)


def compiled(tmp_path, text, **options):
    return da.compile_model(scene_of(tmp_path, text, **options), backend="numpy", cache=False)


def spun(e):
    """Return the matrix (4, 3) of e_dot = matrix omega / 2, omega on the body."""
    a, b, c, d = e
    return np.array([[-b, -c, -d], [a, -d, c], [d, a, -b], [-c, b, a]])


def in_coordinates(values, kinds):
    """Return positions, rates and second rates in coordinates from qpos, qvel and qacc; kinds are 1, 3 or 4 numbers."""
    q, v, a = (np.array(each) for each in values)
    rates, second, at, place = [], [], 0, 0
    for size in kinds:
        if size == 4:
            e, w, alpha = q[at : at + 4], v[place : place + 3], a[place : place + 3]
            rate = 0.5 * spun(e) @ w
            rates, second = [*rates, *rate], [*second, *(0.5 * (spun(e) @ alpha + spun(rate) @ w))]
            at, place = at + 4, place + 3
        else:
            rates, second = [*rates, *v[place : place + size]], [*second, *a[place : place + size]]
            at, place = at + size, place + size
    return q, np.array(rates), np.array(second)


def test_accelerations_are_those_of_mujoco(tmp_path):
    """Default classes, anchors, references, springs, damping, armatures, masses of geoms, frames, all actuators."""
    scene = scene_of(tmp_path, CRANE, joint_loads="damping")
    model = da.compile_model(scene, backend="numpy", cache=False)
    assert model.layout.coordinates[:4] == ("slew", "luff", "run", "swing_e0")
    assert model.layout.inputs == ("ctrl_slew_motor", "ctrl_luff_servo", "ctrl_run_drive", "ctrl_run_bias")
    for case in REFERENCE["crane"]:
        values = case["qpos"], case["qvel"], case["qacc"]
        q, rates, second = in_coordinates(values, (1, 1, 1, 4))
        inputs = dict(zip(model.layout.inputs, case["ctrl"], strict=True))
        found = model.accelerations(0, q, rates, {}, inputs=inputs)
        assert found == pytest.approx(second, rel=1e-11, abs=1e-11)
    links = scene.robot.links
    assert links["lamp"].body == links["trolley"].body == "trolley" and scene.robot.joints["run"].upper == 0.3


def test_a_free_body_is_that_of_mujoco(tmp_path):
    """Velocities of its origin in the world, the mass of a cylinder beside it; a joint without a name."""
    model = compiled(tmp_path, PUCK)
    assert model.layout.coordinates == tuple(f"puck_joint_{x}" for x in ("x", "y", "z", "e0", "e1", "e2", "e3"))
    for case in REFERENCE["puck"]:
        q, rates, second = in_coordinates((case["qpos"], case["qvel"], case["qacc"]), (3, 4))
        assert model.accelerations(0, q, rates, {}) == pytest.approx(second, rel=1e-11, abs=1e-11)


def test_symbols_and_chosen_actuators(tmp_path):
    """Parameters of the file give the same accelerations; actuators that are not wanted exert nothing."""
    text = CRANE.replace('<joint name="swing" type="ball" damping="0.3" armature="0" stiffness="0"/>', "")
    options = {"actuated": ["slew_motor"], "joint_loads": False}
    scene, numbers = scene_of(tmp_path, text, parameters="symbols", **options), compiled(tmp_path, text, **options)
    model = da.compile_model(scene, backend="numpy", cache=False)
    assert model.layout.inputs == ("ctrl_slew_motor",) and len(scene.robot.parameters) > 25
    found = [
        each.accelerations(0, [0.3, -0.2, 0.1], [1, -1, 2], p, inputs={"ctrl_slew_motor": 2.0})
        for each, p in ((model, scene.robot.parameters), (numbers, {}))
    ]
    assert found[0] == pytest.approx(found[1], rel=1e-10, abs=1e-11)


# -- equalities ------------------------------------------------------------------------------------

ARM = """<mujoco><compiler angle="radian"/><worldbody>
  <body name="arm" pos="0 0 1"><joint name="a" axis="0 1 0"/>
    <inertial pos="0.2 0 0" mass="2" diaginertia="0.01 0.1 0.1"/>
    <body name="tip" pos="0.4 0.1 0"><joint name="b" axis="1 0 0"/>
      <inertial pos="0 0 -0.1" mass="1" diaginertia="0.02 0.02 0.01"/>{inside}</body></body>{beside}
</worldbody>{equality}</mujoco>"""
PAYLOAD = (
    '<body name="payload" pos="{}" quat="0.8 0 0.6 0">{}'
    '<inertial pos="0.05 0 0.1" mass="0.7" diaginertia="0.01 0.02 0.03"/></body>'
)
BESIDE = PAYLOAD.format("0.4 0.1 0.7", '<freejoint name="p"/>')  # 0.3 below the tip in the posture of the file
SITES = '<site name="s" pos="0 0 -0.3" quat="0.8 0 0.6 0"/>'


ENDS = '<site name="s" type="capsule" size="0.01" fromto="0.096 0 -0.272 -0.096 0 -0.328"{}/>'
"""The same place by two ends: z points from the second to the first."""


@pytest.mark.parametrize(
    ("equality", "sites"),
    [
        ('<weld body1="tip" body2="payload"/>', SITES),
        ('<weld body1="tip" body2="payload" relpose="0 0 -0.3 0.8 0 0.6 0"/>', SITES),
        ('<weld site1="s" site2="t"/>', SITES),
        ('<weld site1="s" site2="t"/>', ENDS.format(' pos="0 0 0" euler="90 0 0"')),
    ],
)
def test_a_weld_is_one_body(tmp_path, equality, sites):
    beside = BESIDE.replace("</body>", '<site name="t"/></body>')
    text = ARM.format(inside=sites, beside=beside, equality=f"<equality>{equality}</equality>")
    whole = compiled(tmp_path, ARM.format(inside=PAYLOAD.format("0 0 -0.3", ""), beside="", equality=""))
    welded = compiled(tmp_path, text)
    exact = whole.accelerations(0, [0, 0], [0, 0], {})
    place = [0.4, 0.1, 0.7, 0.8, 0, 0.6, 0]
    found = welded.accelerations(0, [0, 0, *place], np.zeros(9), {})
    assert welded.layout.constraints and found[:2] == pytest.approx(exact, rel=1e-10)


def test_a_connection_is_a_ball_joint(tmp_path):
    """The anchor is on the first body; the point of the second is where that is in the posture of the file."""
    equality = '<equality><connect body1="tip" body2="payload" anchor="0 0 -0.3"/></equality>'
    hung = PAYLOAD.format("0 0 -0.3", '<joint name="ball" type="ball"/>')
    exact = compiled(tmp_path, ARM.format(inside=hung, beside="", equality=""))
    model = compiled(tmp_path, ARM.format(inside="", beside=BESIDE, equality=equality))
    found = model.accelerations(0, [0, 0, 0.4, 0.1, 0.7, 0.8, 0, 0.6, 0], np.zeros(9), {})
    assert found[:2] == pytest.approx(exact.accelerations(0, [0, 0, 1, 0, 0, 0], np.zeros(6), {})[:2], rel=1e-10)
    fixed = '<equality><connect body1="payload" anchor="0 0 0"/></equality>'
    held = compiled(tmp_path, ARM.format(inside="", beside=BESIDE, equality=fixed))
    still = held.accelerations(0, [0, 0, 0.4, 0.1, 0.7, 0.8, 0, 0.6, 0], np.zeros(9), {})
    assert still[2:5] == pytest.approx([0, 0, 0], abs=1e-12) and abs(still[5:]).max() > 1


def test_coupled_joints_follow_polynomials(tmp_path):
    """b = 0.1 + 0.5 a + 0.3 a^2 by virtual power: with b' = k a', (m11 + 2 k m12 + k^2 m22) a'' + ... = f1 + k f2."""
    equality = '<equality><joint joint1="b" joint2="a" polycoef="0.1 0.5 0.3 0 0"/></equality>'
    model, free = (compiled(tmp_path, ARM.format(inside="", beside="", equality=e)) for e in (equality, ""))
    a, rate = 0.4, 1.3
    q, k = np.array([a, 0.1 + 0.5 * a + 0.3 * a * a]), np.array([1, 0.5 + 0.6 * a])
    bias = np.array([0, 0.6 * rate**2])
    matrix, forces = free.mass_matrix(q, {}), free.forcing(0, q, k * rate, {})
    exact = k * (k @ (forces - matrix @ bias)) / (k @ matrix @ k) + bias
    assert model.accelerations(0, q, k * rate, {}) == pytest.approx(exact, rel=1e-12)
    fixed = '<equality><joint joint1="b" polycoef="0.2"/></equality>'
    held = compiled(tmp_path, ARM.format(inside="", beside="", equality=fixed))
    assert held.accelerations(0, [0, 0.2], [1, 0], {})[1] == pytest.approx(0, abs=1e-12)


LIFTED = """<mujoco model="lifted"><compiler angle="radian"/><worldbody>
<body name="a" gravcomp="0.4"><joint name="j" axis="0 1 0"/>
 <inertial pos="0.1 0.02 0.3" mass="2" diaginertia="0.02 0.03 0.01"/>
 <body name="fixed" pos="0.2 0 0.1" euler="0.3 0 0.2" gravcomp="1">
  <inertial pos="0.1 0 0.05" mass="0.7" diaginertia="0.002 0.003 0.001"/></body>
 <body name="b" pos="0 0 0.5" gravcomp="1.5"><joint name="k" axis="1 0 0"/><joint name="s" type="slide" axis="0 0 1"/>
  <inertial pos="0 0.1 0.2" mass="1" diaginertia="0.01 0.02 0.01"/></body>
</body></worldbody></mujoco>"""


def test_weights_are_held_up_as_in_mujoco(tmp_path):
    """gravcomp= of bodies, one of them fixed to another; qacc of MuJoCo 4.0."""
    model = da.compile_model(scene_of(tmp_path, LIFTED), backend="numpy")
    found = model.accelerations(0, [0.4, -0.7, 0.1], [0.5, -0.3, 0.2], {})
    np.testing.assert_allclose(found, [1.4849859262419531, 9.39798468898427, 2.6697696781228126], rtol=1e-13)
    still = da.compile_model(scene_of(tmp_path, LIFTED, gravity=(0, 0, 0)), backend="numpy")
    np.testing.assert_allclose(still.accelerations(0, [0.4, -0.7, 0.1], [0, 0, 0], {}), 0, atol=1e-13)
    with pytest.raises(SceneError, match="gravcomp= of 'a', 'fixed', 'b' holds up masses that are numbers"):
        scene_of(tmp_path, LIFTED, parameters="symbols")


# -- faults ----------------------------------------------------------------------------------------


def test_all_faults_at_once_with_their_lines(tmp_path):
    text = """<mujoco>
<option density="1.2"/>
<worldbody>
<body name="a"><joint name="j" type="screw"/><geom type="mesh" mesh="m"/></body>
<body name="a" quat="1 0 0 0" euler="0 0 0"><joint name="k" axis="0 0 0" class="no"/>
<inertial mass="-1" diaginertia="1 1"/></body>
<composite type="cloth"/>
</worldbody>
<tendon><spatial name="rope"/></tendon>
<actuator><motor name="u" joint="q"/><muscle joint="k"/></actuator>
<equality><tendon tendon1="rope"/><connect body1="c" anchor="0 0 0"/></equality>
<sensors/>
</mujoco>"""
    with pytest.raises(SceneError) as caught:
        scene_of(tmp_path, text)
    expected = [
        "line 2: forces of a fluid are not supported: density= or viscosity= of <option>; leave them out with skip=",
        "line 4: type='screw' of <joint>: known are hinge, slide, ball, free",
        "line 4: mesh='m' of <geom> '' is no <mesh> of <asset>",
        "line 4: geoms that collide are not supported",
        "line 5: a second <body> is called 'a'",
        "line 5: <body> 'a' has quat and euler; give one of them",
        "line 5: the axis of joint 'k' has no direction",
        "line 5: class='no' of <joint> is no default class of the file",
        "line 6: the mass of body 'a' is -1 kg",
        "line 6: diaginertia='1 1' of <inertial> must be 3 finite numbers",
        "line 7: <composite> is not supported",
        "line 9: tendons are not supported: tendon 'rope'; leave them out with skip=['tendons']",
        "line 10: <motor> 'u' acts on 'q', which is no hinge or slide; known: k",
        "line 10: actuators that are no forces of joints are not supported: <muscle>",
        "line 11: equality 'connect_2': 'c' is no body",
        "line 11: equalities other than connect, weld and joint are not supported: <tendon>",
        "line 12: unknown element <sensors> in <mujoco>; did you mean <sensor>?",
    ]
    found = caught.value.faults
    for line in expected:
        assert any(fault.startswith(line) for fault in found), (line, found)
    assert len(found) == len(expected)


def test_what_is_skipped_is_said(tmp_path):
    text = CRANE.replace('contype="0" conaffinity="0" ', "").replace(
        "<actuator>", '<actuator><muscle name="m" joint="run"/>'
    )
    with pytest.raises(SceneError, match=r"geoms that collide .*and 3 more; leave them out with skip=\['contacts'\]"):
        scene_of(tmp_path, text)
    scene = scene_of(tmp_path, text, skip=["contacts", "actuators"])
    assert scene.robot.skipped == ("geoms that collide", "actuators that are no forces of joints")
    with pytest.raises(OptionError, match=r"skip: 'gravity' cannot be left out; known: contacts, tendons"):
        scene_of(tmp_path, text, skip=["gravity"])
    with pytest.raises(SceneError, match="actuated: unknown actuator 'crab'"):
        scene_of(tmp_path, CRANE, actuated=["crab"])
    with pytest.raises(SceneError, match="outermost element is <robot>; expected <mujoco>"):
        scene_of(tmp_path, '<robot name="r"/>')
