"""Robots that move: conserved quantities of a free flight, and a gripper that holds a block, against closed forms."""

from pathlib import Path

import numpy as np
import pytest

import dalembert as da
from interop.robot_texts import WALKER

DOCS = Path(__file__).parents[2] / "docs" / "_static"


def test_a_free_flight_conserves_energy_and_momenta(tmp_path):
    """100 s of a floating robot without gravity: its base turns, its legs swing; momenta by the mass matrix."""
    path = tmp_path / "robot.urdf"
    path.write_text(WALKER)
    scene = da.Scene.from_urdf(path, floating_base=True, joint_loads=False, gravity=(0, 0, 0))
    model = da.compile_model(scene, outputs=["energy"], cache=False)
    names = model.layout.coordinates
    q, rates = [0, 0, 0, 0.5, 0.5, -0.5, 0.5, 0.3, -0.2], [0.1, 0.2, -0.1, 0.1, 0.2, 0.2, -0.1, 0.4, -0.5]
    start = dict(zip(names, q, strict=True)) | {f"{name}_dot": x for name, x in zip(names, rates, strict=True)}
    span, times = (0, 100), np.linspace(0, 100, 101)
    run = model.simulate(span, start, {}, method="taylor", rtol=1e-15, atol=1e-15, t_eval=times)
    assert run.success and np.abs(np.sum(run.q[:, 3:7] ** 2, axis=1) - 1).max() < 1e-14
    kinetic = np.einsum("ki,kij,kj->k", run.qdot, model.mass_matrix(run.q, {}), run.qdot) / 2
    assert np.ptp(kinetic) < 1e-12 * kinetic[0]
    powers = np.einsum("kij,kj->ki", model.mass_matrix(run.q, {}), run.qdot)
    linear, turned = powers[:, :3], []
    for (a, b, c, d), power in zip(run.q[:, 3:7], powers[:, 3:7], strict=True):
        turned.append(0.5 * np.array([[-b, a, -d, c], [-c, d, a, -b], [-d, -c, b, a]]) @ power)
    carried = np.cross(run.q[:, :3], linear)
    angular = np.array(turned) + carried
    assert np.abs(linear - linear[0]).max() < 1e-12 * np.abs(linear[0]).max()
    size = max(np.abs(turned).max(), np.abs(carried).max())
    assert np.abs(angular - angular[0]).max() < 1e-12 * size


def gripper(force):
    """Return the first phase of a block of 0.5 kg between two fingers, and its motion over a second."""
    scene = da.Scene.from_urdf(DOCS / "gripper.urdf", actuated=True)
    block = scene.robot.links["block"]
    for side, sense in (("left", -1), ("right", 1)):
        finger, normal = scene.robot.links[side], sense * block.frame.x
        wall = block.point.locatenew(f"{side} wall", 0.03 * normal)
        scene.add_contacts(
            da.PointPlane(
                side,
                body=finger.body,
                point=finger.point,
                plane=(wall, normal),
                other="block",
                friction=0.5,
                restitution=0,
            )
        )
    forces = [f"{side}.{what}" for side in ("left", "right") for what in ("normal", "friction_1")]
    model = da.compile_model(scene, backend="numpy", outputs=forces, cache=False)
    start = {"close": 0.02, "held_x": 0, "held_y": 0, "held_theta": 0}
    start |= {f"{name}_dot": 0 for name in start}
    return forces, model.simulate((0, 1), start, {}, inputs={"tau_close": force}, t_eval=np.linspace(0, 1, 5))


@pytest.mark.parametrize(("force", "mode"), [(20.0, "stick"), (6.0, "slip")])
def test_a_gripper_holds_a_block_by_friction(force, mode):
    """The mimicking fingers press with half of the force each; friction carries the weight m g / 2 each, or slips."""
    forces, run = gripper(force)
    (phase,) = run.phases
    carried = 0.5 * 9.81 / 2 if mode == "stick" else 0.5 * force / 2
    fall = 0.0 if mode == "stick" else 9.81 - 2 * carried / 0.5
    assert run.success and phase.modes == {"left": mode, "right": mode}
    for name in forces:
        exact = force / 2 if name.endswith("normal") else -carried
        assert run[name] == pytest.approx(np.full(5, exact), rel=1e-5)  # the block that falls turns by rounding alone
    assert np.abs(run["held_y"]) == pytest.approx(fall * run.t**2 / 2, abs=1e-10)  # y of the joint points down
    assert np.abs([run["held_x"], run["held_theta"]]).max() < 1e-10 and run["close"] == pytest.approx(np.full(5, 0.02))


FOOT = """<robot name="stilt"><link name="trunk"><inertial><mass value="6"/>
<inertia ixx="0.035" ixy="0" ixz="0" iyy="0.095" iyz="0" izz="0.11"/></inertial></link>
<link name="leg"><inertial><origin xyz="0 0 -0.1"/><mass value="0.3"/>
<inertia ixx="0.003" ixy="0" ixz="0" iyy="0.003" iyz="0" izz="0.001"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="trunk"/><child link="leg"/><origin xyz="0.2 0.1 0"/>
<axis xyz="0 0 1"/></joint></robot>"""


def test_a_level_floating_base_lands_on_a_foot(tmp_path):
    """The scalar component of its quaternion moves no inertia: the impact leaves it at rest, and the length one."""
    path = tmp_path / "robot.urdf"
    path.write_text(FOOT)
    scene = da.Scene.from_urdf(path, floating_base=True)
    leg = scene.robot.links["leg"]
    foot = leg.point.locatenew("foot", -0.3 * leg.frame.z)
    floor = (scene.origin, scene.frame.z)
    scene.add_contacts(da.PointPlane("foot", body="leg", point=foot, plane=floor, restitution=0, friction=0.7))
    model = da.compile_model(scene, outputs=["foot.gap"], backend="numpy", cache=False)
    start = dict.fromkeys(model.layout.coordinates, 0.0) | {"base_z": 0.35, "base_e0": 1.0}
    start |= {f"{name}_dot": 0.0 for name in start}
    run = model.simulate((0, 0.12), start, {})
    assert run.success and [phase.modes["foot"] for phase in run.phases] == ["open", "stick"]
    assert run.phases[1].t0 == pytest.approx((2 * 0.05 / 9.81) ** 0.5, rel=1e-12)
    assert np.abs(run["foot.gap"][run.t > run.phases[1].t0]).max() < 1e-12
    assert np.abs(np.sum(run.q[:, 3:7] ** 2, axis=1) - 1).max() < 1e-12


@pytest.mark.parametrize("knee", [0.5, 0])
def test_two_contacts_of_one_link_that_stick_while_another_slides(tmp_path, knee):
    """The sum of their friction forces along the line through both is determined, and not what each has of it."""
    path = tmp_path / "robot.urdf"
    path.write_text(WALKER)
    scene = da.Scene.from_urdf(path, floating_base=True)
    floor = (scene.origin, scene.frame.z)
    for name, link, height, mu in (
        ("heel", "left", -0.4, 0.5),
        ("knee", "left", 0, knee),
        ("other", "right", -0.4, 0.5),
    ):
        at = scene.robot.links[link].point.locatenew(name, height * scene.robot.links[link].frame.z)
        scene.add_contacts(da.SpherePlane(name, body=link, centre=at, radius=0.05, plane=floor, friction=mu))
    model = da.compile_model(scene, backend="numpy", cache=False)
    mode = model.mode(heel="stick", knee="stick" if knee else "closed", other="slip")
    assert {"heel.normal", "knee.normal", "other.normal"} <= {*mode.layout.unknowns}
    assert ("friction across heel and knee" in mode.layout.unknowns) == bool(knee)
