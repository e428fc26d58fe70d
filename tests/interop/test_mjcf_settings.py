"""Settings of MJCF files: included files, flags, masses, defaults of actuators; and attributes that are not read."""

import math

import numpy as np
import pytest

from dalembert.errors import SceneError
from interop.test_mjcf import compiled, scene_of

ARM = """<mujoco>
<compiler angle="radian"{compiler}/>
<option><flag {flags}/></option>
{defaults}<worldbody><body name="arm" pos="0 0 1">
<joint name="turn" axis="0 1 0" damping="0.3" stiffness="2" springref="0.1" frictionloss="0.2" range="-1 1"{joint}/>
<geom type="capsule" size="0.05" fromto="0 0 0 0 0 -0.8" mass="1.5"{geom}/>
{more}</body></worldbody>
<actuator>{actuator}</actuator>
</mujoco>
"""
"""An arm that hangs, with all that its flags turn off."""

CONTACTS = 'contype="0" conaffinity="0" '
MOTOR = '<motor name="m" joint="turn" gear="3"/>'


def arm(flags="", compiler="", joint="", geom="", defaults="", more="", actuator=MOTOR, contacts=CONTACTS):
    geom = f" {contacts}{geom}"
    return ARM.format(
        flags=flags, compiler=compiler, joint=joint, geom=geom, defaults=defaults, more=more, actuator=actuator
    )


def acceleration(model, angle, rate, control=0.0):
    inputs = dict.fromkeys(model.layout.inputs, control)
    return float(model.accelerations(0, [angle], [rate], {}, inputs=inputs)[0])


def inertia():
    """Return the moment of inertia of the arm about its joint: a tube and two half balls."""
    r, half = 0.05, 0.4
    tube, balls = 2 * math.pi * r**2 * half, 4 / 3 * math.pi * r**3
    mass = 1.5 / (tube + balls)
    own = mass * tube * (r**2 / 4 + half**2 / 3) + mass * balls * (0.4 * r**2 + half**2 + 0.75 * half * r)
    return own + 1.5 * half**2


@pytest.mark.parametrize(
    ("flags", "absent"),
    [
        ("", ()),
        ('gravity="disable"', ("weight",)),
        ('spring="disable"', ("spring",)),
        ('damper="disable"', ("damping",)),
        ('passive="disable"', ("spring", "damping")),
        ('frictionloss="disable"', ("friction",)),
        ('constraint="disable"', ("friction",)),
        ('actuation="disable"', ("motor",)),
        ('clampctrl="disable" energy="enable" gravity="enable"', ()),
    ],
)
def test_flags_turn_forces_off(tmp_path, flags, absent):
    model = compiled(tmp_path, arm(flags))
    angle, rate, control = 0.4, 0.7, 1.3
    forces = {
        "weight": -1.5 * 9.81 * 0.4 * math.sin(angle),
        "spring": -2.0 * (angle - 0.1),
        "damping": -0.3 * rate,
        "friction": -0.2,
        "motor": 3.0 * control,
    }
    expected = sum(value for name, value in forces.items() if name not in absent) / inertia()
    assert acceleration(model, angle, rate, control) == pytest.approx(expected, rel=1e-12)
    assert model.layout.inputs == (() if "motor" in absent else ("ctrl_m",))


def test_flags_turn_constraints_off(tmp_path):
    """Limits, equalities and contacts, each alone or together."""
    joint = '<equality><joint joint1="turn" polycoef="0.2"/></equality></mujoco>'
    for flags, held, limited in (
        ("", True, True),
        ('equality="disable"', False, True),
        ('limit="disable"', True, False),
        ('constraint="disable"', False, False),
    ):
        scene = scene_of(tmp_path, arm(flags).replace("</mujoco>", joint))
        assert bool(scene.holonomic_constraints) == held
        assert (scene.robot.joints["turn"].upper == 1.0) == limited
    for flags in ('contact="disable"', 'constraint="disable"'):
        assert scene_of(tmp_path, arm(flags, contacts="")).robot.skipped == ()
    with pytest.raises(SceneError, match="geoms that collide"):
        scene_of(tmp_path, arm(contacts=""))


def test_masses_by_groups_and_in_all(tmp_path):
    """Geoms of other groups have no mass; a total mass scales masses and moments of inertia alike."""
    ball = f'<geom type="sphere" size="0.2" pos="0 0 -1" mass="4" group="3" {CONTACTS}/>'
    (alone,), (grouped,), (both,), (scaled,) = (
        compiled(tmp_path, arm(more=more, compiler=compiler)).mass_matrix([0.3], {}, inputs={"ctrl_m": 0})[0]
        for more, compiler in (("", ""), (ball, ' inertiagrouprange="0 2"'), (ball, ""), (ball, ' settotalmass="11"'))
    )
    assert grouped == pytest.approx(alone, rel=1e-14)
    assert scaled == pytest.approx(2.0 * both, rel=1e-14)
    assert both == pytest.approx(alone + 4.0 * (1.0 + 0.4 * 0.2**2), rel=1e-12)


def test_defaults_of_actuators_are_those_of_all_kinds(tmp_path):
    """As in MuJoCo, where motors, servos and general actuators have one set of defaults."""
    defaults = '<default><general gear="5" ctrlrange="-1 1"/></default>\n'
    model = compiled(tmp_path, arm(defaults=defaults, actuator='<motor name="m" joint="turn"/>'))
    pushed, free = acceleration(model, 0.1, 0.5, 1.0), acceleration(model, 0.1, 0.5)
    assert pushed - free == pytest.approx(5.0 / inertia(), rel=1e-12)
    defaults = '<default><motor gear="2"/><general gear="6"/></default>\n'
    last = compiled(tmp_path, arm(defaults=defaults, actuator='<motor name="m" joint="turn"/>'))
    assert acceleration(last, 0.1, 0.5, 1.0) - free == pytest.approx(6.0 / inertia(), rel=1e-12)
    defaults = '<default><position kp="7"/></default>\n'
    motor = compiled(tmp_path, arm(defaults=defaults))
    assert acceleration(motor, 0.1, 0.5, 1.0) - free == pytest.approx(3.0 / inertia(), rel=1e-12)
    with pytest.raises(SceneError, match="<velocity> 'v' has gains of the defaults of <position>, which is not"):
        scene_of(tmp_path, arm(defaults=defaults, actuator='<velocity name="v" joint="turn"/>'))


def test_attributes_that_are_not_read_are_faults(tmp_path):
    faults = {
        "springdamper= of <joint> 'turn' is not supported: leave it out": arm(joint=' springdamper="0.1 1"'),
        "damping='0.3 0.1' of <joint> must be a finite number": arm().replace('damping="0.3"', 'damping="0.3 0.1"'),
        "a geom with shellinertia=; give the body an <inertial>": arm(geom='shellinertia="true" '),
        "skew= of <compiler> '' is not supported": arm(compiler=' skew="1"'),
        "coordinate= of <compiler> must be 'local'": arm(compiler=' coordinate="global"'),
        "haste= of <flag> '' is not supported": arm('haste="enable"'),
        "actuatorgroupdisable= of <option> is not supported": arm().replace(
            "<option>", '<option actuatorgroupdisable="0">'
        ),
        "actuators that are no forces of joints are not supported: <motor> 'm'": arm(
            actuator=MOTOR.replace("gear", 'armature="0.1" gear')
        ),
        "boundmass= of <compiler>; leave them out with skip=['sizes']": arm(compiler=' boundmass="0.1"'),
    }
    for fault, text in faults.items():
        with pytest.raises(SceneError) as caught:
            scene_of(tmp_path, text)
        assert len(caught.value.faults) == 1 and fault in caught.value.faults[0], caught.value.faults
    skipped = scene_of(tmp_path, arm(actuator=MOTOR.replace("gear", 'delay="0.1" gear')), skip=["actuators"])
    assert skipped.inputs == ()


def test_two_ends_that_place_no_geom_are_faults(tmp_path):
    """As in MuJoCo: a position beside fromto= must be zero, and an orientation is replaced."""
    plain = acceleration(compiled(tmp_path, arm()), 0.4, 0.7)
    assert acceleration(compiled(tmp_path, arm(geom='pos="0 0 0" quat="1 1 0 0" ')), 0.4, 0.7) == plain
    beside = "is given with a position that is not zero: remove fromto= or pos="
    faults = {
        f"line 6: fromto= of <geom> '' {beside}": arm(geom='pos="0 0 -0.1" '),
        f"line 7: fromto= of <geom> '' {beside}": arm(defaults='<default><geom pos="0 1 0"/></default>\n'),
        f"line 7: fromto= of <site> 's' {beside}": arm(
            more='<site name="s" type="capsule" size="0.1" fromto="0 0 0 0 0 1" pos="1 0 0"/>'
        ),
        "line 6: fromto= of <geom> '' has no length": arm().replace("0 0 0 0 0 -0.8", "0 0 1 0 0 1"),
        "line 6: fromto= of <geom> '' is for the types capsule,": arm().replace("capsule", "sphere"),
    }
    for fault, text in faults.items():
        with pytest.raises(SceneError) as caught:
            scene_of(tmp_path, text)
        assert len(caught.value.faults) == 1 and caught.value.faults[0].startswith(fault), caught.value.faults


# -- included files --------------------------------------------------------------------------------


def test_included_files_stand_where_they_are_included(tmp_path):
    """Also within a body, from files that included ones include, beside the first file or beside the second."""
    whole = arm(defaults='<default><geom rgba="1 0 0 1"/></default>\n')
    (tmp_path / "parts").mkdir()
    head, _, tail = whole.partition("<worldbody>")
    body, _, actuators = tail.partition("</worldbody>")
    (tmp_path / "parts" / "arm.xml").write_text(f"<mujocoinclude>{body}</mujocoinclude>")
    (tmp_path / "parts" / "motors.xml").write_text(f"<mujoco>{actuators.replace('</mujoco>', '')}</mujoco>")
    (tmp_path / "both.xml").write_text('<mujocoinclude><include file="parts/more.xml"/></mujocoinclude>')
    (tmp_path / "parts" / "more.xml").write_text('<mujocoinclude><include file="motors.xml"/></mujocoinclude>')
    text = f'{head}<worldbody><include file="parts/arm.xml"/></worldbody><include file="both.xml"/></mujoco>'
    included, model = compiled(tmp_path, text, name="scene.xml"), compiled(tmp_path, whole)
    assert included.layout.inputs == ("ctrl_m",)
    values = [acceleration(each, 0.4, 0.7, 1.3) for each in (included, model)]
    assert values[0] == values[1] and np.isfinite(values[0])


def test_faults_of_included_files_have_their_names_and_lines(tmp_path):
    (tmp_path / "body.xml").write_text('<mujocoinclude>\n<body name="b"><joint axis="0 0 0"/></body>\n</mujocoinclude>')
    (tmp_path / "torn.xml").write_text("<mujocoinclude>\n<body>\n</mujocoinclude>")
    names = '<include file="body.xml"/>\n<include file="none.xml"/>\n<include file="body.xml"/>\n<include/>'
    with pytest.raises(SceneError) as caught:
        scene_of(tmp_path, f"<mujoco>\n<worldbody>\n{names}\n</worldbody></mujoco>")
    assert list(caught.value.faults) == [
        "line 2 of 'body.xml': the axis of joint 'b_joint' has no direction: 0 0 0",
        "line 4: <include> of 'none.xml': there is no such file beside 'model.xml'",
        "line 5: <include> of 'body.xml': a file is included once, and may not include itself",
        "line 6: <include> has no attribute file=",
    ]
    with pytest.raises(SceneError, match=r"line 3 of 'torn.xml': the file is no well-formed XML"):
        scene_of(tmp_path, '<mujoco>\n<include file="torn.xml"/>\n</mujoco>')
