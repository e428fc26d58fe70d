"""Shapes of robot files in pictures: places by the oracle, meshes of four formats, colours, and what is left out."""

import struct

import numpy as np
import pytest

import dalembert as da
from dalembert.errors import FileWarning, OptionError
from dalembert.interop.mesh_files import read_mesh
from dalembert.interop.robot_visuals import primitive
from interop.robot_oracle import Robot

pytest.importorskip("matplotlib")
pytestmark = pytest.mark.filterwarnings("ignore:Animation was deleted")

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])

ROBOT = """<robot name="seen">
  <material name="steel"><color rgba="0.2 0.4 0.6 1"/></material>
  <link name="base">
    <visual><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.1" length="0.2"/></geometry></visual>
  </link>
  <link name="arm">
    <visual><origin xyz="0.1 0.2 0.3" rpy="0.3 -0.2 0.5"/><geometry><box size="0.4 0.2 0.1"/></geometry>
      <material name="steel"/></visual>
    <visual><geometry><mesh filename="package://meshes/tip.stl" scale="2 1 1"/></geometry></visual>
    <inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  </link>
  <link name="hand">
    <visual><geometry><sphere radius="0.05"/></geometry><material><color rgba="1 1 1 1"/></material></visual>
    <visual><geometry><mesh filename="none.stl"/></geometry></visual>
  </link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="1 2 2"/>
    <origin xyz="0 0 0.2" rpy="0.1 0 0"/></joint>
  <joint name="mount" type="fixed"><parent link="arm"/><child link="hand"/><origin xyz="0.5 0 0" rpy="0 0.4 0"/></joint>
</robot>"""


def binary_stl():
    facets = [struct.pack("<12fH", 0, 0, 0, *CORNERS[face].ravel(), 0) for face in FACES]
    return bytes(80) + struct.pack("<I", len(FACES)) + b"".join(facets)


def text_stl():
    facets = [
        "facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in CORNERS[f]) for f in FACES
    ]
    return ("solid tip\n" + "endloop\nendfacet\n".join([*facets, ""]) + "endsolid").encode()


def obj():
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS] + ["f 1/1 3/2 2/3", "f 1 2 4", "f 2 3 4", "f -4 -1 -2"]
    return "\n".join(lines).encode()


DAE = """<COLLADA><asset><unit meter="0.5"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="a" count="12">{}</float_array></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<polylist count="4"><input semantic="VERTEX" source="#v" offset="0"/><input semantic="NORMAL" source="#n" offset="1"/>
<vcount>3 3 3 3</vcount><p>{}</p></polylist></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node><scale>2 2 2</scale><rotate>0 0 1 90</rotate>
<node><matrix>0 1 0 0 -1 0 0 0 0 0 1 0 0 0 0 1</matrix><instance_geometry url="#g"/></node></node></visual_scene>
</library_visual_scenes></COLLADA>"""


def dae():
    numbers = " ".join(f"{x}" for x in CORNERS.ravel())
    return DAE.format(numbers, " ".join(f"{place} 0" for place in FACES.ravel())).encode()


def msh():
    counts = struct.pack("<4i", 4, 1, 2, 4)
    return counts + np.float32([*CORNERS.ravel(), 0, 0, 1, 0, 0, 1, 1]).tobytes() + np.int32(FACES).tobytes()


@pytest.mark.parametrize("write", [binary_stl, text_stl, obj, dae, msh])
def test_meshes_of_four_formats(tmp_path, write):
    """A tetrahedron: its volume has its size and its sense."""
    path = tmp_path / f"tip.{'stl' if 'stl' in write.__name__ else write.__name__}"
    path.write_bytes(write())
    mesh = read_mesh(path)
    assert len(mesh.vertices) == 4 and len(mesh.faces) == 4
    assert sorted(map(tuple, mesh.vertices.round(12) + 0.0)) == sorted(map(tuple, CORNERS))
    assert np.sum(np.linalg.det(mesh.vertices[mesh.faces])) / 6 == pytest.approx(1 / 6)


def test_shapes_of_a_urdf_file_move_with_its_links(tmp_path):
    """Vertices by the places of the links that the oracle has: turned shapes, fixed links, and the base at rest."""
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "tip.stl").write_bytes(binary_stl())
    folder = tmp_path / "urdf"
    folder.mkdir()
    (folder / "robot.urdf").write_text(ROBOT)
    scene = da.Scene.from_urdf(folder / "robot.urdf")
    assert scene.robot.undrawn == ("mesh of 'hand': 'none.stl' is not there",)
    run = da.compile_model(scene, backend="numpy", cache=False).simulate((0, 1), {"turn": 0.4, "turn_dot": 1.0}, {})
    with pytest.warns(
        FileWarning, match=r"scene 'seen': pictures are without mesh of 'hand': 'none\.stl' is not there"
    ):
        drawing = run.animate(fps=4).drawing
    base, box, tip, ball = drawing.surfaces
    assert base.at_rest and base.vertices[0, :, 2].min() == 0.0 and base.vertices[0, :, 2].max() == pytest.approx(0.2)
    assert (box.color, ball.color) == ("#336699", tip.color) and box.name == ball.name == "arm"
    robot, at = Robot(ROBOT), run(drawing.t)
    for k, q in enumerate(at.q):
        turn, place, *_ = robot._motion("arm", (np.eye(3), np.zeros(3)), q, np.zeros(1))
        assert sorted(map(tuple, tip.vertices[k].round(9))) == sorted(
            map(tuple, (place + CORNERS * [2, 1, 1] @ turn.T).round(9))
        )
        corners = (box.vertices[k] - place) @ turn
        assert corners.mean(axis=0) == pytest.approx([0.1, 0.2, 0.3]) and np.ptp(corners, axis=0).max() > 0.4
        edges = [np.linalg.norm(corners[i] - corners[0]) for i in (1, 2, 4)]
        assert edges == pytest.approx([0.1, 0.2, 0.4])
        turn, place, *_ = robot._motion("hand", (np.eye(3), np.zeros(3)), q, np.zeros(1))
        assert np.linalg.norm(ball.vertices[k] - place, axis=1) == pytest.approx(np.full(len(ball.vertices[k]), 0.05))


MODEL = """<mujoco model="seen"><compiler meshdir="meshes"/>
<asset><mesh file="tip.obj" scale="1 2 1"/></asset>
<worldbody><geom type="plane" size="1 2 .1" contype="0" conaffinity="0"/>
<body name="leg" pos="0 0 1"><joint name="hip" axis="0 1 0"/><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>
 <frame pos="0 0 0.5"><geom type="capsule" size=".1" fromto="0 0 0 .6 0 0" rgba="1 0 0 1"
  contype="0" conaffinity="0"/></frame>
 <geom type="ellipsoid" size=".1 .2 .3" contype="0" conaffinity="0"/>
 <geom type="box" size=".1 .2 .3" group="3" contype="0" conaffinity="0"/>
 <geom type="mesh" mesh="tip" contype="0" conaffinity="0"/>
</body></worldbody></mujoco>"""


def test_shapes_of_a_model_of_mujoco(tmp_path):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "tip.obj").write_bytes(obj())
    (tmp_path / "model.xml").write_text(MODEL)
    scene = da.Scene.from_mjcf(tmp_path / "model.xml")
    run = da.compile_model(scene, backend="numpy", cache=False).simulate((0, 0.5), {"hip": 0.0, "hip_dot": 0.0}, {})
    floor, capsule, ellipsoid, tip = run.animate(fps=4).drawing.surfaces
    assert floor.at_rest and np.ptp(floor.vertices[0], axis=0)[:2] == pytest.approx([2, 4])
    assert capsule.color == "#ff0000" and np.ptp(capsule.vertices[0], axis=0) == pytest.approx(
        [0.8, 0.2, 0.2], rel=0.06
    )
    assert capsule.vertices[0].mean(axis=0) == pytest.approx([0.3, 0, 1.5], abs=1e-9)
    assert np.ptp(ellipsoid.vertices[0], axis=0)[2] == pytest.approx(0.6)
    assert tip.vertices[0].max(axis=0) == pytest.approx([1, 2, 2])


def test_large_meshes_are_thinned():
    """A sphere of many triangles keeps its size."""
    ball = primitive("sphere", np.array([1.0]))
    fine = type(ball)(*(lambda mesh: (mesh.vertices, mesh.faces))(_sphere(60, 120)))
    thin = fine.thinned(400)
    assert len(fine.vertices) > 5000 and 100 < len(thin.vertices) <= 400 and thin.faces.max() < len(thin.vertices)
    assert np.linalg.norm(thin.vertices, axis=1) == pytest.approx(np.ones(len(thin.vertices)), abs=0.05)
    assert ball.thinned(400).vertices is ball.vertices


def _sphere(rings, count):
    from dalembert.scene.shape_meshes import sphere

    return sphere(1.0, rings, count)


def test_meshes_of_users(tmp_path):
    """Triangles and files as shapes of any scene; what is no mesh is an error."""
    scene = da.scenes.chaplygin_sleigh()
    (bob,) = scene.bodies
    scene.add_shapes({bob.name: da.Mesh((CORNERS, FACES), scale=0.1, rotation=np.eye(3)[[1, 2, 0]], offset=[0, 0, 1])})
    path = tmp_path / "broken.stl"
    path.write_text("solid")
    for source, options in (((CORNERS,), {}), (3, {}), ((CORNERS, FACES), {"scale": [1, 2]}), ("a.stl", {"offset": 1})):
        with pytest.raises(OptionError, match="a mesh is the path of a file, or vertices"):
            scene.add_shapes({bob.name: da.Mesh(source, **options)})
    for name, text in (
        ("none.stl", "cannot be read"),
        (path, "has no triangles"),
        ("a.ply", "has none of the formats"),
    ):
        with pytest.raises(OptionError, match=text):
            read_mesh(name)
