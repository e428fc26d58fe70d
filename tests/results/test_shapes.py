"""Shapes of bodies in pictures: where they are, that they turn with their bodies, and what is refused."""

import re

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import OptionError
from dalembert.mechanics.skeleton import skeleton
from dalembert.results.drawing import shape_points
from dalembert.results.drawn_parts import undrawn
from dalembert.scene import shape_meshes

pytest.importorskip("matplotlib")
pytest.importorskip("plotly")
pytestmark = pytest.mark.filterwarnings("ignore:Animation was deleted")

x, phi = dynamicsymbols("x phi")
m, r, k, g = sp.symbols("m r k g", positive=True)
N, O = ReferenceFrame("N"), Point("O")
W = N.orientnew("W", "Axis", (phi, N.z))
C = O.locatenew("C", x * N.x + r * N.y)
WALL = O.locatenew("wall", r * N.y)


def wheel_scene():
    scene = da.Scene("wheel", frame=N, origin=O, coordinates=[x, phi])
    scene.add_bodies(RigidBody("wheel", C, W, m, (inertia(W, 0, 0, m * r**2 / 2), C)))
    scene.add_nonholonomic_constraints(x.diff() + r * phi.diff())
    scene.add_loads((C, -k * x * N.x))
    R_x, R_y = da.unknowns("R_x R_y")
    scene.add_joints(da.Joint("floor", body="wheel", at=C.locatenew("contact", -r * N.y), force=R_x * N.x + R_y * N.y))
    return scene


def motion_of(scene, outputs=()):
    model = da.compile_model(scene, backend="numpy", cache=False, outputs=outputs)
    return model.simulate((0, 1), {x: 0.4, phi: 0.0, x.diff(): 0.0}, {m: 2.0, r: 0.25, k: 5.0})


def line_of(drawing, size):
    return [line for line in drawing.lines if line.points.shape[1:] == (size, 3)]


def test_shapes_of_bodies_move_and_turn_with_them():
    scene = wheel_scene()
    scene.add_shapes({"wheel": [da.Disk(radius=r, axis=W.z), da.Box(x=r, y=2 * r, z=0.1)]})
    motion = motion_of(scene)
    drawing = motion.animate(fps=10).drawing
    at = motion(drawing.t)
    disk, box = drawing.surfaces
    np.testing.assert_allclose(disk.vertices[:, 0], np.stack([at["x"], 0 * at.t + 0.25, 0 * at.t], axis=1), atol=1e-12)
    distance = np.linalg.norm(disk.vertices[:, 1:] - disk.vertices[:, :1], axis=2)
    np.testing.assert_allclose(distance, 0.25, atol=1e-12)
    arm = disk.vertices[:, 1] - disk.vertices[:, 0]
    turned = np.unwrap(np.arctan2(arm[:, 1], arm[:, 0]))
    np.testing.assert_allclose(turned - turned[0], at["phi"], atol=1e-12)
    edges = np.ptp(box.vertices[0], axis=0)
    np.testing.assert_allclose(edges, [0.25, 0.5, 0.1], atol=1e-12)


def test_a_spring_a_rod_a_path_and_the_ground():
    scene = wheel_scene()
    shapes = {"spring": da.Spring(WALL, C, coils=5), "rod": da.Rod(O, C), "way": da.Path(C), "floor": da.Ground(N.y)}
    scene.add_shapes(shapes)
    motion = motion_of(scene)
    drawing = motion.animate(fps=10).drawing
    centre = np.stack([motion(drawing.t)["x"], 0 * drawing.t + 0.25, 0 * drawing.t], axis=1)
    (spring,) = line_of(drawing, 16 * 5 + 3)
    np.testing.assert_allclose(spring.points[:, 0], np.broadcast_to([0, 0.25, 0], centre.shape), atol=1e-12)
    np.testing.assert_allclose(spring.points[:, -1], centre, atol=1e-12)
    rod = next(line for line in drawing.lines if line.width == 5.0)
    np.testing.assert_allclose(rod.points[:, 1], centre, atol=1e-12)
    paths = [line.points[drawing.reached - 1] for line in drawing.lines if line.is_path]
    assert any(np.allclose(points, centre) for points in paths)
    assert len(paths) == 1  # that of `way`, and none of the mass centre
    (ground,) = drawing.surfaces
    assert ground.at_rest and np.ptp(ground.vertices[..., 1]) < 1e-12
    assert abs(ground.vertices[0, 0, 1]) < 1e-12


@pytest.mark.parametrize(
    "mesh",
    [
        shape_meshes.sphere(0.3),
        shape_meshes.box(np.array([1.0, 2.0, 3.0])),
        shape_meshes.cylinder(0.5, 2.0, np.array([0.0, 1.0, 0.0])),
    ],
    ids=["sphere", "box", "cylinder"],
)
def test_surfaces_are_closed(mesh):
    """Every edge belongs to two triangles, or to one of no area."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    solid = mesh.faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-12]
    keys = {tuple(np.round(v, 9)): i for i, v in enumerate(mesh.vertices)}
    same = np.array([keys[tuple(np.round(v, 9))] for v in mesh.vertices])
    edges = np.sort(same[np.concatenate([solid[:, [0, 1]], solid[:, [1, 2]], solid[:, [2, 0]]])], axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert set(counts) == {2}


def test_forces_of_joints():
    """The normal force points up, the friction force is that of the rolling wheel: -k x / 3 and its reaction."""
    scene = wheel_scene()
    motion = motion_of(scene, ["R_x"])
    with pytest.raises(OptionError, match=r"no 'R_y': request it with compile_model\(scene, outputs=\['R_y'"):
        motion.animate(fps=5, reactions=True)
    alone = da.Scene("wheel", frame=N, origin=O, coordinates=[x, phi])
    alone.__dict__.update(scene.__dict__)
    R_x = da.unknowns("R_x")
    alone.joints = (da.Joint("floor", body="wheel", at=scene.joints[0].at, force=R_x * N.x),)
    drawing = motion_of(alone, ["R_x"]).animate(fps=5, reactions=True).drawing
    arrow = next(line for line in drawing.lines if line.name == "force of floor")
    force = arrow.points[:, 1] - arrow.points[:, 0]
    position = motion(drawing.t)["x"]
    np.testing.assert_allclose(force[:, 0] / force[0, 0], position / position[0], atol=1e-6)
    with pytest.raises(OptionError, match="this scene has none"):
        da_scene = da.Scene("free", frame=N, origin=O, coordinates=[x])
        da_scene.add_bodies(Particle("p", O.locatenew("P", x * N.x), m))
        free = da.compile_model(da_scene, backend="numpy", cache=False).simulate((0, 1), {x: 0, "x_dot": 1}, {m: 1})
        free.animate(fps=5, reactions=True)


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        ({"wheel": "round"}, "is none of Sphere, Disk"),
        ([da.Sphere(1.0)], "takes a mapping from names to shapes"),
        ({"wheel": da.Sphere("big")}, "radius must be a length"),
        ({"wheel": da.Disk(radius=1.0, axis=3)}, "axis must be a Vector"),
        ({"wheel": da.Rod(O, "P")}, "end must be a Point"),
        ({"wheel": da.Sphere(1.0, color=3)}, "color must be the name of a colour"),
        ({"s": da.Spring(O, C, coils=0)}, "coils must be a positive whole number"),
    ],
)
def test_what_is_no_shape(shapes, message):
    with pytest.raises(OptionError, match=message):
        wheel_scene().add_shapes(shapes)


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        ({"hub": da.Sphere(r)}, "no body is called so; the bodies are wheel"),
        ({"wheel": da.Sphere(sp.Symbol("R"))}, "R is no positive length; it may contain the parameters of the scene"),
        ({"wheel": da.Disk(radius=r, axis=N.x)}, "is not fixed in the frame W"),
    ],
)
def test_shapes_that_do_not_fit_the_scene(shapes, message):
    scene = wheel_scene()
    scene.add_shapes(shapes)
    with pytest.raises(OptionError, match=message):
        motion_of(scene).animate(fps=5)


def test_a_page_needs_no_network(tmp_path):
    scene = wheel_scene()
    scene.add_shapes({"wheel": da.Disk(radius=r, axis=W.z)})
    moving = motion_of(scene).animate(fps=5)
    moving.save(tmp_path / "wheel.html")
    text = (tmp_path / "wheel.html").read_text()
    assert not re.findall(r"<(?:script|link)[^>]*(?:src|href)=", text)
    assert text.count('"name":"5"') == 1 and "Play" in text
    assert "<html>" not in moving._repr_html_()


def test_positions_that_jump_in_time_are_drawn_where_they_are():
    """A point that a condition on time moves is drawn with the condition of each picture."""
    t = dynamicsymbols._t
    moved = O.locatenew("moved", x * N.x + sp.Piecewise((0, t < 0.5), ((t - 0.5) ** 3, True)) * N.y)
    scene = da.Scene("carried", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("p", moved, m))
    motion = da.compile_model(scene, backend="numpy", cache=False).simulate((0, 1), {x: 0, "x_dot": 1}, {m: 1})
    drawing = motion.animate(fps=10).drawing
    path = next(line for line in drawing.lines if line.is_path)
    np.testing.assert_allclose(path.points[drawing.reached - 1, 1], np.maximum(drawing.t - 0.5, 0.0) ** 3, atol=1e-12)


@pytest.mark.parametrize(
    ("shapes", "paths", "axes", "links"),
    [
        ({}, (0,), (0,), True),
        ({"rim": da.Path(C)}, (), (0,), True),
        ({"wheel": da.Disk(radius=r, axis=W.z)}, (0,), (), True),
        ({"wheel": da.Rod(O, C)}, (0,), (), False),
        ({"coil": da.Spring(WALL, C)}, (0,), (0,), False),
    ],
)
def test_shapes_replace_what_is_drawn_without_them(shapes, paths, axes, links):
    scene = wheel_scene()
    scene.add_shapes(shapes)
    drawn = skeleton(scene, ["m", "r", "k"], shape_points(scene))
    found = undrawn(scene, drawn)
    assert (found.paths, found.axes, bool(found.links)) == (paths, axes, links) and drawn.links
    lines = motion_of(scene).animate(fps=10).drawing.lines
    assert sum(line.width == 2.0 for line in lines) == len(found.links)
    triads = sum(line.color in ("#d62728", "#2ca02c") and line.width == 1.2 for line in lines)
    assert triads == 2 * len(axes)
    assert sum(line.is_path for line in lines) == len(paths) + ("rim" in shapes)
