"""Masses of meshes in MJCF files: MuJoCo's numbers for its four laws, boxes in closed form, and faults."""

from itertools import product

import numpy as np
import pytest

import dalembert as da
from dalembert.errors import SceneError
from dalembert.interop.mjcf import MjcfReader
from dalembert.interop.mjcf_meshes import hull_of
from dalembert.interop.robot_files import FileReader

FILE = """<mujoco>{settings}<asset><mesh name="m" {mesh}/></asset>
<worldbody><body name="b"><freejoint/><geom type="{kind}" mesh="m" contype="0" conaffinity="0" {geom}/></body>
</worldbody></mujoco>"""


def write(folder, mesh, geom="", kind="mesh", settings=""):
    path = folder / "model.xml"
    path.write_text(FILE.format(mesh=mesh, geom=geom, kind=kind, settings=settings))
    return path


def inertia_of(path):
    """Return mass, mass centre and inertia of the body, as the reader has them."""
    reader = MjcfReader(FileReader(path, "mujoco"), ())
    link = reader.description().links["b"]
    reader.raise_faults()
    return link.mass, link.centre, link.matrix


def box(low, high):
    """Return the corners of a box, and its triangles, turned outwards."""
    corners = np.array(list(product(*zip(low, high, strict=True))))
    return corners, hull_of(corners)


def words(values):
    return " ".join(map(repr, np.ravel(values).tolist()))


def inline(corners, faces):
    return f'vertex="{words(corners)}" face="{words(faces)}"'


# by MuJoCo 4.0: mass, mass centre, inertia (xx, xy, xz, yy, yz, zz) of two boxes that are one mesh, scaled and turned
REFERENCES = {
    "legacy": (
        1.3150932758086908,
        (0.4923902723572756, -0.08048940397243945, -0.20769816639956715),
        (0.383909275279, 0.082965164019, 0.041499741428, 0.092417786201, -0.066046982195, 0.411722454264),
    ),
    "exact": (
        1.0312000825166725,
        (0.48490360214578054, -0.07827159807539089, -0.20209042218281123),
        (0.353192133437, 0.075879124192, 0.035483721947, 0.079058885279, -0.059905660834, 0.377040908457),
    ),
    "convex": (
        1.946800105447821,
        (0.5267247874091584, -0.028946240013202278, -0.23025705073637057),
        (0.461363034888, 0.087509151752, 0.058794037964, 0.133110544811, -0.071058040184, 0.501285635274),
    ),
    "shell": (
        25.513051608766336,
        (0.48966642149401274, -0.10041518538420222, -0.2056702658897269),
        (9.353237336067, 1.902030830727, 0.998221147796, 2.306771556361, -1.604824369922, 10.008283609172),
    ),
}
APART = [box((0, 0, 0), (1, 0.3, 0.2)), box((0.02, 0.5, 0.03), (0.3, 1.2, 0.25))]
CORNERS = np.concatenate([corners for corners, _ in APART])
FACES = np.concatenate([APART[0][1], APART[1][1] + 8])


@pytest.mark.parametrize("law", REFERENCES)
def test_two_boxes_have_the_inertia_that_mujoco_gives_them(law, tmp_path):
    """Masses and centres to rounding; MuJoCo keeps principal axes, whose search stops at some 1e-10 of the inertia."""
    mesh = f'inertia="{law}" scale="1 2 0.5" refpos="0.1 0.2 0.3" refquat="1 0.5 0 0.2"'
    path = write(tmp_path, f"{mesh} {inline(CORNERS, FACES)}", 'density="10" pos="0.3 0 0.1" euler="20 30 0"')
    mass, centre, matrix = inertia_of(path)
    expected = REFERENCES[law]
    np.testing.assert_allclose(mass, expected[0], rtol=1e-14)
    np.testing.assert_allclose(centre, expected[1], rtol=0, atol=1e-14)
    np.testing.assert_allclose(matrix[np.triu_indices(3)], expected[2], rtol=0, atol=1e-10 * expected[0])


@pytest.mark.parametrize("law", ["legacy", "exact", "convex"])
def test_a_box_from_a_file_is_the_primitive(law, tmp_path):
    """The mass of the geom takes the place of the density; corners are binary fractions."""
    corners, faces = box((-0.25, -0.5, -0.125), (0.25, 0.5, 0.125))
    lines = [f"v {words(corner)}" for corner in corners] + [f"f {words(face + 1)}" for face in faces]
    (tmp_path / "box.obj").write_text("\n".join(lines))
    mass, centre, matrix = inertia_of(write(tmp_path, f'file="box.obj" inertia="{law}"', 'mass="3" pos="1 0 2"'))
    edges = np.array([0.5, 1.0, 0.25]) ** 2
    np.testing.assert_allclose(mass, 3, rtol=1e-15)
    np.testing.assert_allclose(centre, (1, 0, 2), rtol=0, atol=1e-15)
    np.testing.assert_allclose(matrix, np.diag(np.sum(edges) - edges) / 4, rtol=0, atol=1e-15)


@pytest.mark.parametrize("heights", [(0, 0.25, 1, 0.25), (0.25, 0, 0.25, 1)])
def test_faces_of_four_corners_are_parted_along_the_shorter_diagonal(heights, tmp_path):
    """A block below a face that is no plane: its volume is that below the two triangles, as in MuJoCo."""
    sides = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    corners = [(*side, z) for z in (heights, (-0.5,) * 4) for side, z in zip(sides, z, strict=True)]
    faces = ["1 2 3 4", "8 7 6 5", "1 5 6", "1 6 2", "2 6 7", "2 7 3", "3 7 8", "3 8 4", "4 8 5", "4 5 1"]
    lines = [f"v {words(corner)}" for corner in corners] + [f"f {face}" for face in faces]
    (tmp_path / "block.obj").write_text("\n".join(lines))
    mass, _, _ = inertia_of(write(tmp_path, 'file="block.obj" inertia="exact"', 'density="1"'))
    np.testing.assert_allclose(mass, 0.5 + (1 + 4 * 0.25) / 6, rtol=1e-14)


def test_points_alone_are_their_hull(tmp_path):
    corners, faces = box((0, 0, 0), (0.5, 0.25, 1))
    for found, expected in zip(
        inertia_of(write(tmp_path, f'vertex="{words(corners)}"')),
        inertia_of(write(tmp_path, inline(corners, faces))),
        strict=True,
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize(
    ("mesh", "geom", "kind", "message"),
    [
        ('file="none.stl"', "", "mesh", "line 2: the mass of a body follows from a mesh: .*'none.stl' cannot be read"),
        (f'inertia="round" {inline(CORNERS, FACES)}', "", "mesh", "line 1: inertia='round' of mesh 'm': known are leg"),
        (f'inertia="exact" {inline(CORNERS, FACES[:, ::-1])}', "", "mesh", "the volume of mesh 'm' is -0.1.*outwards"),
        (inline(CORNERS, FACES), 'size="1 1 1"', "box", "a geom of type 'box' that is fitted to a mesh; give the body"),
        ('builtin="sphere"', "", "mesh", "line 1: builtin= of <mesh> 'm' is not supported"),
    ],
)
def test_faults(mesh, geom, kind, message, tmp_path):
    with pytest.raises(SceneError, match=message):
        da.Scene.from_mjcf(write(tmp_path, mesh, geom, kind))
