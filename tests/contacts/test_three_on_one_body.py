"""Three rough contacts of one body that stick: they depend on each other where its quaternion has length one."""

from functools import cache

import pytest

import dalembert as da
from dalembert.errors import ConstraintError

TEXT = """<mujoco model="two links"><compiler angle="radian"/>
<default><geom type="capsule" contype="0" conaffinity="0"/></default>
<worldbody><body name="rod"><freejoint name="base"/>
  <geom fromto="-0.3 0 0 0.3 0 0" size="0.05" mass="4"/>
  <body name="arm"><joint name="hinge" axis="0 0 1"/>
    <geom fromto="0 0 0 0 0.4 0" size="0.05" mass="1"/></body>
</body></worldbody></mujoco>"""


@cache
def links(folder):
    path = folder / "links.xml"
    path.write_text(TEXT)
    scene = da.Scene.from_mjcf(path)
    for name, part, x, y in (
        ("heel", "arm", 0, 0.1),
        ("toe", "arm", 0, 0.4),
        ("side", "arm", 0.1, 0.2),
        ("end", "rod", 0.3, 0),
    ):
        link = scene.robot.links[part]
        centre = link.point.locatenew(name, x * link.frame.x + y * link.frame.y)
        floor = scene.origin, scene.frame.z
        scene.add_contacts(da.SpherePlane(name, body=part, plane=floor, centre=centre, radius=0.05, friction=0.5))
    return da.compile_model(scene)


@pytest.mark.parametrize("end", ["open", "slip"])
def test_the_contacts_are_named_that_hold_each_other(end, tmp_path_factory):
    model = links(tmp_path_factory.getbasetemp())
    with pytest.raises(ConstraintError, match=r"'side' and 'heel', 'toe' hold each other .* friction=0 or a reg"):
        model.mode(heel="stick", toe="stick", side="stick", end=end)
