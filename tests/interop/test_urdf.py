"""Scenes of URDF files: equations against Newton-Euler in NumPy, names, loads, limits, and every fault of a file."""

import numpy as np
import pytest
import sympy as sp

import dalembert as da
from dalembert.errors import FileWarning, OptionError, SceneError, ValueInputError
from interop.robot_oracle import Robot
from interop.robot_texts import ARM, CART, WALKER


def scene_of(tmp_path, text, name="robot.urdf", **options):
    path = tmp_path / name
    path.write_text(text)
    return da.Scene.from_urdf(path, **options)


def faults(tmp_path, text):
    with pytest.raises(SceneError) as caught:
        scene_of(tmp_path, text)
    return caught.value.faults


PLANAR = '<joint name="drive" type="planar"><parent link="floor"/><child link="cart"/>'
CHAIN = (
    '<link name="v1"/><link name="v2"/>'
    '<joint name="drive_x" type="prismatic"><parent link="floor"/><child link="v1"/>'
    '<origin xyz="0.3 0.2 0.1" rpy="0.2 0 0.4"/><axis xyz="{}"/></joint>'
    '<joint name="drive_y" type="prismatic"><parent link="v1"/><child link="v2"/><axis xyz="0 1 0"/></joint>'
    '<joint name="drive_theta" type="continuous"><parent link="v2"/><child link="cart"/><axis xyz="{}"/></joint>'
)


def cart_texts(axis, first):
    """Return the cart with its planar joint about an axis, and with three joints in its place."""
    start, end = CART.index(PLANAR), CART.index("</joint>") + len("</joint>")
    planar = CART.replace('<axis xyz="0 0 1"/></joint>', f'<axis xyz="{axis}"/></joint>', 1)
    return planar, CART[:start] + CHAIN.format(first, axis) + CART[end:]


# -- equations -------------------------------------------------------------------------------------


@pytest.mark.parametrize("parameters", ["numbers", "symbols"])
@pytest.mark.parametrize("text", [ARM, cart_texts("0 0 1", "1 0 0"), cart_texts("1 0 0", "0 0 -1")])
def test_equations_are_those_of_newton_and_euler(tmp_path, text, parameters):
    """Fixed bases: slanted axes, decimal angles, massless links, fixed joints, mimics, planar joints."""
    own, independent = (text, text) if isinstance(text, str) else text
    scene = scene_of(tmp_path, own, parameters=parameters, joint_loads=False)
    model, robot = da.compile_model(scene, backend="numpy", cache=False), Robot(independent)
    names = list(model.layout.coordinates)
    order = [robot.names.index(name) for name in names]
    assert set(names) == set(robot.names) and (parameters == "symbols") == bool(scene.robot.parameters)
    rng = np.random.default_rng(3)
    for _ in range(3):
        q, rates = rng.uniform(-2, 2, (2, len(names)))
        mine, nu = np.empty(len(names)), np.empty(len(names))
        mine[order], nu[order] = q, rates
        matrix, forces = robot.equations(mine, nu)
        p = scene.robot.parameters
        assert model.mass_matrix(q, p) == pytest.approx(matrix[np.ix_(order, order)], rel=1e-12, abs=1e-13)
        exact = np.linalg.solve(matrix, forces)[order]
        assert model.accelerations(0, q, rates, p) == pytest.approx(exact, rel=1e-11, abs=1e-11)


def test_floating_base_by_newton_and_euler(tmp_path):
    """Base velocities are those of the origin of the root link; its quaternion turns it."""
    scene = scene_of(tmp_path, WALKER, floating_base=True, gravity=(0.3, 0, -3))
    model, robot = da.compile_model(scene, backend="numpy", cache=False), Robot(WALKER, True, (0.3, 0, -3))
    base = [f"base_{axis}" for axis in "xyz"] + [f"base_e{i}" for i in range(4)]
    assert list(model.layout.coordinates) == [*base, "hip_l", "hip_r"] and robot.names == ["hip_l", "hip_r"]
    rng = np.random.default_rng(4)
    e = rng.normal(size=4)
    e /= np.linalg.norm(e)
    place, q, nu = rng.normal(size=3), rng.uniform(-1, 1, 2), rng.uniform(-1, 1, 8)
    w = [[-e[1], -e[2], -e[3]], [e[0], e[3], -e[2]], [-e[3], e[0], e[1]], [e[2], -e[1], e[0]]]
    e_dot = 0.5 * np.array(w) @ nu[3:6]  # the angular velocity has components in the fixed frame
    a, b, c, d = e
    turn = np.array(
        [
            [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d],
        ]
    )
    matrix, forces = robot.equations(q, nu, (turn, place))
    exact = np.linalg.solve(matrix, forces)
    second = model.accelerations(0, [*place, *e, *q], [*nu[:3], *e_dot, *nu[6:]], {})
    w_dot = [[-x[0], -x[1], -x[2]] for x in [e_dot[1:]]] + [
        [e_dot[0], e_dot[3], -e_dot[2]],
        [-e_dot[3], e_dot[0], e_dot[1]],
        [e_dot[2], -e_dot[1], e_dot[0]],
    ]
    expected = 0.5 * (np.array(w) @ exact[3:6] + np.array(w_dot) @ nu[3:6])
    assert second[:3] == pytest.approx(exact[:3], rel=1e-11, abs=1e-12)
    assert second[3:7] == pytest.approx(expected, rel=1e-11, abs=1e-12)
    assert second[7:] == pytest.approx(exact[6:], rel=1e-11, abs=1e-12)


def test_floating_joints_are_floating_bases(tmp_path):
    """A floating joint at a place of its own: the same accelerations as a floating root, turned."""
    joint = '<joint name="free" type="floating"><parent link="map"/><child link="trunk"/></joint></robot>'
    text = WALKER.replace("</robot>", f'<link name="map"/>{joint}')
    scene, other = scene_of(tmp_path, text), scene_of(tmp_path, WALKER, floating_base=True)
    models = [da.compile_model(each, backend="numpy", cache=False) for each in (scene, other)]
    assert models[0].layout.coordinates[:4] == ("free_x", "free_y", "free_z", "free_e0")
    q = [0.1, 0.2, 0.3, 0.5, 0.5, -0.5, 0.5, 0.3, -0.2]
    rates = [1, 0, 2, 0.2, 0.1, 0.1, -0.2, 0.4, 1.0]
    found = [model.accelerations(0, q, rates, {}) for model in models]
    assert found[0] == pytest.approx(found[1], rel=1e-12)


def test_loads_of_joints(tmp_path):
    """Damping and dry friction act along the joints; each can be left out."""
    robot, q, rates = Robot(ARM), [0.3, 0.1, -0.4], [0.5, -0.2, 0.8]
    for loads in (True, "damping", "friction"):
        text = ARM
        text = text.replace('friction="0.4"', "") if loads == "damping" else text
        text = text.replace('damping="0.7"', "").replace('damping="12"', "") if loads == "friction" else text
        model = da.compile_model(scene_of(tmp_path, ARM, joint_loads=loads), backend="numpy", cache=False)
        matrix, forces = Robot(text).equations(np.array(q), np.array(rates), loads=True)
        assert model.accelerations(0, q, rates, {}) == pytest.approx(np.linalg.solve(matrix, forces), rel=1e-11)
        assert model.contacts == (() if loads == "damping" else ("shoulder.friction",))
    assert robot.names == ["shoulder", "lift", "wrist.roll"]


def test_inputs_of_joints_have_their_power(tmp_path):
    """A torque on a joint is its generalised force; joints that mimic have none."""
    scene = scene_of(tmp_path, ARM, joint_loads=False, actuated=True)
    model = da.compile_model(scene, backend="numpy", cache=False)
    assert model.layout.inputs == ("tau_shoulder", "tau_lift", "tau_wrist.roll")
    q, rates, tau = [0.3, 0.1, -0.4], [0.5, -0.2, 0.8], [3.0, -20.0, 0.4]
    matrix, forces = Robot(ARM).equations(np.array(q), np.array(rates))
    found = model.accelerations(0, q, rates, {}, inputs=dict(zip(model.layout.inputs, tau, strict=True)))
    assert found == pytest.approx(np.linalg.solve(matrix, forces + tau), rel=1e-11)
    some = scene_of(tmp_path, ARM, actuated=["lift"])
    assert [str(u.func.__name__) for u in some.inputs] == ["tau_lift"] and some.robot.joints["shoulder"].input is None


def test_limits_are_stops(tmp_path):
    """A leg that falls onto its limit stays there; its contacts bear the name of the joint."""
    scene = scene_of(tmp_path, WALKER.replace('hip_l" type="revolute"', 'hip_l" type="fixed"'), limits=True)
    model = da.compile_model(scene, outputs=["hip_r.upper"], backend="numpy", cache=False)
    assert set(model.contacts) == {"hip_r.lower", "hip_r.upper"}
    run = model.simulate((0, 0.3), {"hip_r": 0.5, "hip_r_dot": 8.0}, {})
    assert run.success and run["hip_r"].max() == pytest.approx(1.0, abs=1e-9) and run["hip_r"][-1] < 0.9


def test_enormous_limits_are_none(tmp_path):
    """Only one of the limits of a file is below a million radians."""
    text = WALKER.replace('lower="-1" upper="1"', 'lower="-1" upper="1e16"', 1).replace('lower="-1" upper="1"', "")
    assert [contact.label for contact in scene_of(tmp_path, text, limits=True).contacts] == ["hip_l.lower"]


def test_motors_of_a_floating_robot(tmp_path):
    """Two torques round trip on a base that they cannot lift, which is an error that names it."""
    scene = scene_of(tmp_path, WALKER, floating_base=True, actuated=True)
    model = da.compile_model(scene, backend="numpy", cache=False)
    q, rates = [0.1, 0.2, 0.3, 0.5, 0.5, -0.5, 0.5, 0.3, -0.2], [1, 0, 2, 0.2, 0.1, 0.1, -0.2, 0.4, 1.0]
    second = model.accelerations(0, q, rates, {}, inputs={"tau_hip_l": 2.0, "tau_hip_r": -3.0})
    assert model.inverse_dynamics(0, q, rates, second, {}) == pytest.approx([2, -3], rel=1e-10)
    with pytest.raises(ValueInputError, match=r"the inputs tau_hip_l, tau_hip_r cannot produce .* base_z \("):
        model.inverse_dynamics(0, q, rates, second + np.eye(9)[2], {})


def test_links_of_the_file_are_points_and_frames(tmp_path):
    """The tool's place by the oracle; links that fixed joints connect belong to one body."""
    scene = scene_of(tmp_path, ARM, joint_loads=False)
    links = scene.robot.links
    assert links["tool0"].body == links["wrist"].body == "wrist" and links["base"].body is None
    tool = links["tool0"]
    model = da.compile_model(
        scene, backend="numpy", outputs={"place": tool.point, "x": tool.frame.x, "y": tool.frame.y}, cache=False
    )
    q = np.array([0.3, 0.1, -0.4])
    run = model.simulate((0, 1), dict(zip(model.layout.state, [*q, 0, 0, 0], strict=True)), {}, t_eval=[0.0])
    turn, place, *_ = Robot(ARM)._motion("tool0", (np.eye(3), np.zeros(3)), q, np.zeros(3))
    assert [run[f"place_{axis}"][0] for axis in "xyz"] == pytest.approx(place, rel=1e-12)
    for number, axis in enumerate("xy"):
        assert [run[f"{axis}_{k}"][0] for k in "xyz"] == pytest.approx(turn[:, number], rel=1e-12, abs=1e-14)


def test_a_joint_that_mimics_has_no_coordinate(tmp_path):
    joint = scene_of(tmp_path, ARM).robot.joints["grip"]
    roll = sp.Function("wrist.roll")(sp.Symbol("t"))
    assert joint.coordinates == () and sp.expand(joint.value - (sp.Float(0.01) - sp.Float(0.02) * roll)) == 0


def test_symbols_have_the_values_of_the_file(tmp_path):
    """All ten parameters of a body, places of joints, coefficients of loads and g; a heavier hand is one number."""
    scene = scene_of(tmp_path, WALKER, parameters="symbols")
    values = {str(symbol): value for symbol, value in scene.robot.parameters.items()}
    assert values["m_right"] == 1.1 and values["c_right_z"] == -0.2 and values["g"] == 9.81
    assert values["m_left"] == pytest.approx(1.2) and values["p_hip_r_y"] == -0.1
    assert {"I_left_xx", "I_left_xy", "I_left_zz"} <= values.keys() and "m_foot" not in values
    model = da.compile_model(scene, backend="numpy", cache=False)
    heavier = WALKER.replace('<mass value="1.1"/>', '<mass value="2.2"/>')
    matrix, _ = Robot(heavier).equations(np.zeros(2), np.zeros(2))
    assert model.mass_matrix([0, 0], {**values, "m_right": 2.2}) == pytest.approx(matrix, rel=1e-12)


# -- faults ----------------------------------------------------------------------------------------


def test_all_faults_of_a_file_at_once_with_their_lines(tmp_path):
    text = """<robot name="bad">
<link name="a"><inertial><mass value="-1"/><inertia ixx="1" ixy="0" ixz="0" iyy="x" iyz="0"/></inertial></link>
<link name="a"/>
<link name="b"/>
<joint name="j" type="hinge"><parent link="a"/><child link="b"/><origin xyz="0 0"/></joint>
<joint name="k" type="revolute"><parent link="a"/><child link="c"/><axis xyz="0 0 0"/><mimic joint="none"/>
 <limits lower="0"/><limit lower="2" upper="1"/></joint>
<joint name="m" type="fixed"><parent link="a"/></joint>
</robot>"""
    found = faults(tmp_path, text)
    expected = [
        "line 2: the mass of link 'a' is -1 kg",
        "line 2: iyy='x' of <inertia> must be a finite number",
        "line 2: <inertia> has no attribute izz=",
        "line 3: a second <link> is called 'a'; the first is in line 2",
        "line 5: type='hinge' of <joint>: known are revolute, continuous, prismatic, fixed, planar, floating",
        "line 5: xyz='0 0' of <origin> must be 3 finite numbers",
        "line 6: the axis of joint 'k' has no direction",
        "line 6: the child of joint 'k' is 'c', which is no link",
        "line 6: joint 'k' mimics 'none', which is no joint of the robot",
        "line 7: unknown element <limits> in <joint>; did you mean <limit>?",
        "line 7: the lower limit 2 of joint 'k' lies above the upper, 1",
        "line 8: <joint> 'm' has no <child>",
    ]
    for text in expected:
        assert any(fault.startswith(text) for fault in found), (text, found)
    assert len(found) == len(expected)


LINK, JOINT = '<link name="{}"/>', '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/>{}</joint>'


@pytest.mark.parametrize(
    ("inside", "fault"),
    [
        ("<link", "line 2: the file is no well-formed XML"),
        ("", "line 1: the robot has no links"),
        ("<xacro:arm/>" + LINK.format("a"), "expand the file with xacro first"),
        (LINK.format("a") + LINK.format("b"), "link 'b' hangs on no joint, and neither does the root 'a'"),
        (
            "".join(map(LINK.format, "abc")) + "".join(JOINT.format(n, n, "c", "") for n in "ab"),
            "both lead to link 'c': URDF describes trees; close the loop with da.Closure",
        ),
        (
            "".join(map(LINK.format, "abc")) + JOINT.format("j", "b", "c", "") + JOINT.format("k", "c", "b", ""),
            "link 'b' hangs on itself through its joints, not on 'a'",
        ),
        (
            "".join(map(LINK.format, "abc"))
            + JOINT.format("j", "a", "b", '<mimic joint="k"/>')
            + JOINT.format("k", "b", "c", '<mimic joint="j"/>'),
            "joint 'j' mimics itself: j -> k -> j",
        ),
    ],
)
def test_faults_of_the_tree(tmp_path, inside, fault):
    head = '<robot name="r" xmlns:xacro="http://wiki.ros.org/xacro">\n'
    assert any(fault in each for each in faults(tmp_path, f"{head}{inside}</robot>"))


def test_other_faults_say_what_to_do(tmp_path):
    with pytest.raises(SceneError, match="nothing moves: give floating_base=True"):
        scene_of(tmp_path, '<robot name="r"><link name="a"/></robot>')
    with pytest.raises(SceneError, match="outermost element is <mujoco>; expected <robot>"):
        scene_of(tmp_path, "<mujoco/>")
    with pytest.raises(SceneError, match=r"unknown joint 'elbow'.*Joints that mimic others"):
        scene_of(tmp_path, ARM, actuated=["elbow"])
    with pytest.raises(SceneError, match="two coordinates or inputs would be called 'drive_x'"):
        scene_of(tmp_path, CART.replace('"tilt"', '"drive_x"'))
    with pytest.raises(SceneError, match="a joint and a parameter would both be called 'm_left'"):
        scene_of(tmp_path, WALKER.replace('"hip_l"', '"m_left"'), parameters="symbols")
    for option in (
        {"parameters": 1},
        {"joint_loads": "all"},
        {"actuated": "lift"},
        {"gravity": 9.81},
        {"limits": "yes"},
    ):
        with pytest.raises(OptionError, match=next(iter(option))):
            scene_of(tmp_path, ARM, **option)
    with pytest.raises(OptionError, match=r"'none\.urdf' cannot be read"):
        da.Scene.from_urdf(tmp_path / "none.urdf")


def test_an_inertia_that_no_body_has_is_warned_of(tmp_path):
    text = WALKER.replace('izz="0.15"', 'izz="-0.15"')
    with pytest.warns(FileWarning, match="'trunk'.*negative principal moment"):
        scene_of(tmp_path, text, floating_base=True)
