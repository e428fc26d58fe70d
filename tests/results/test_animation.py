"""Moving pictures: what they show, in which plane, and what cannot be drawn."""

import builtins
import gc
import shutil
import sys
import warnings

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import (
    LagrangesMethod,
    Particle,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

import dalembert as da
from dalembert.errors import MissingExtraError, OptionError
from dalembert.mechanics.skeleton import skeleton

pytest.importorskip("matplotlib")
pytestmark = pytest.mark.filterwarnings("ignore:Animation was deleted")
PARAMETERS = {"m": 1.0, "b": 0.3, "I_C": 0.5}
START = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}


@pytest.fixture(scope="module")
def sleigh():
    scene = da.scenes.chaplygin_sleigh()
    return da.compile_model(scene, backend="numpy", cache=False).simulate((0, 2), START, PARAMETERS)


def test_positions_of_a_skeleton(sleigh):
    """The mass centre from the contact by hand, and the axes of the sleigh."""
    drawn = skeleton(sleigh._pictured[0], ("I_C", "b", "m"))
    assert drawn.bodies == ("sleigh",) and drawn.points[:2] == ("G", "C") and drawn.links == ((1, 0),)
    positions, axes = drawn.at(sleigh.t, sleigh.q, sleigh._pictured[1])
    theta = sleigh["theta"]
    ahead = np.stack([np.cos(theta), np.sin(theta), 0 * theta], axis=1)
    contact = np.stack([sleigh["x"], sleigh["y"], 0 * theta], axis=1)
    np.testing.assert_allclose(positions[:, 1], contact, atol=1e-15)
    np.testing.assert_allclose(positions[:, 0], contact + 0.3 * ahead, atol=1e-15)
    np.testing.assert_allclose(axes[:, 0, 0], ahead, atol=1e-15)


def test_a_plane_motion_is_drawn_in_its_plane(sleigh, tmp_path):
    moving = sleigh.animate(fps=4, speed=0.5)
    panel = moving._fig.axes[0]
    assert not hasattr(panel, "get_zlim") and panel.get_xlabel() == "x [m]"
    moving._draw_frame(16)
    path = panel.lines[0].get_xydata()
    assert len(moving.drawing.t) == 17  # 4 s of pictures, 4 a second, and the first
    between = sleigh(np.linspace(0, 2, len(path)))  # paths have points between the pictures
    assert len(path) > 500
    np.testing.assert_allclose(path[:, 0], between["x"] + 0.3 * np.cos(between["theta"]), atol=1e-12)
    expected = sleigh(2.0)
    np.testing.assert_allclose(path[-1, 0], expected["x"][0] + 0.3 * np.cos(expected["theta"][0]), atol=1e-12)
    assert panel.get_title() == "t = 2.00 s"
    moving.save(tmp_path / "sleigh.gif", dpi=30)
    assert (tmp_path / "sleigh.gif").read_bytes()[:6] == b"GIF89a"


def test_a_notebook_shows_it(sleigh):
    assert "Plotly.newPlot" in sleigh.animate(fps=1)._repr_html_()


def test_a_notebook_without_plotly_shows_pictures(sleigh, monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly.graph_objects", None)
    monkeypatch.delitem(sys.modules, "dalembert.results.html_animation", raising=False)
    assert "<img" in sleigh.animate(fps=1)._repr_html_()


def test_a_page_without_plotly_is_refused_by_name(sleigh, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly.graph_objects", None)
    monkeypatch.delitem(sys.modules, "dalembert.results.html_animation", raising=False)
    with pytest.raises(MissingExtraError, match="plotly is needed"):
        sleigh.animate(fps=1).save(tmp_path / "sleigh.html")


def test_a_film_without_ffmpeg_is_refused_by_name(sleigh, tmp_path, monkeypatch):
    """And nothing else is said: matplotlib warns of animations that were not drawn."""
    monkeypatch.setattr("dalembert.results.animation.writers.is_available", lambda name: False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        moving = sleigh.animate(fps=1)
        with pytest.raises(MissingExtraError, match=r"ffmpeg.*\.gif or \.html"):
            moving.save(tmp_path / "sleigh.mp4")
        del moving
        gc.collect()
    assert not (tmp_path / "sleigh.mp4").exists()


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not installed")
def test_a_film(sleigh, tmp_path):
    sleigh.animate(fps=5).save(tmp_path / "sleigh.mp4")
    assert b"ftyp" in (tmp_path / "sleigh.mp4").read_bytes()[:16]


def test_a_picture_of_one_instant(sleigh):
    moving = sleigh.animate(fps=10)
    early, late = (np.asarray(moving.picture(t).axes[0].lines[0].get_xydata()).copy() for t in (0.0, 0.9))
    assert moving.picture(0.9).axes[0].get_title() == "t = 0.90 s"
    assert np.all(np.isfinite(early)) and not np.allclose(early, late)
    with pytest.raises(OptionError, match="t must be a number"):
        moving.picture("end")


def test_a_picture_between_the_frames_is_exact(sleigh):
    """Also with few frames, whose number does not matter; and without continuous output a recorded time is drawn."""
    t = 0.3137
    for fps in (1, 10):
        moving = sleigh.animate(fps=fps)
        path = np.asarray(moving.picture(t).axes[0].lines[0].get_xydata())
        exact = sleigh(t)
        np.testing.assert_allclose(path[-1, 0], exact["x"][0] + 0.3 * np.cos(exact["theta"][0]), atol=1e-12)
        assert len(path) > 50 and moving.drawing.t[0] == 0.0 and t not in moving.drawing.t
    backward = da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy", cache=False)
    moving = backward.simulate((2, 0), START, PARAMETERS).animate(fps=2)
    assert moving.picture(t).axes[0].get_title() == "t = 0.31 s"
    for outside in (-0.1, 2.1):
        with pytest.raises(OptionError, match="is not a time of the motion, which goes from 0 to 2 s"):
            moving.picture(outside)
    kept = backward.simulate((0, 2), START, PARAMETERS, dense=False)
    assert not kept.can_evaluate
    recorded = float(kept.t[np.abs(kept.t - t).argmin()])
    figure = kept.animate(fps=2).picture(t)
    assert figure.axes[0].get_title() == f"t = {recorded:.2f} s"
    assert len(figure.axes[0].lines[0].get_xydata()) == 1 + np.abs(kept.t - t).argmin()


def test_a_sphere_in_a_plane_is_a_circle():
    """A sphere that turns about another axis than that of the plane is drawn in space."""
    x, phi, (m, r) = *dynamicsymbols("x phi"), sp.symbols("m r")
    N, O = ReferenceFrame("N"), Point("O")
    for axis, plane in ((N.z, (0, 1)), (N.y, (0, 2)), (N.x, (0, 1, 2))):
        B = N.orientnew("B", "Axis", (phi, axis))
        G = O.locatenew("G", x * N.x)
        scene = da.Scene("ball", frame=N, origin=O, coordinates=[x, phi])
        scene.add_bodies(RigidBody("ball", G, B, m, (inertia(B, r, r, r), G)))
        scene.add_shapes({"ball": da.Sphere(radius=r)})
        model = da.compile_model(scene, backend="numpy", cache=False)
        motion = model.simulate((0, 1), {x: 0, x.diff(): 1, phi: 0, phi.diff(): 2}, {m: 1, r: 0.25})
        drawing = motion.animate(fps=4).drawing
        assert drawing.plane == plane
        (ball,) = drawing.surfaces
        distance = np.linalg.norm(ball.vertices - motion(drawing.t)["x"][:, None, None] * [1, 0, 0], axis=-1)
        np.testing.assert_allclose(np.max(distance, axis=1), 0.25, atol=1e-12)
        if len(plane) == 2:
            assert np.ptp(ball.vertices[..., 3 - sum(plane)]) < 1e-12


def test_a_page_of_a_motion_fills_its_picture(sleigh):
    """Without perspective, plotly's aspect ratio alone decides how large a motion is."""
    pytest.importorskip("plotly")
    from dalembert.results.html_animation import figure

    drawing = sleigh.animate(fps=4).drawing
    scene = figure(drawing, 4).layout.scene
    sides, span = np.array([scene.aspectratio[name] for name in "xyz"]), drawing.high - drawing.low
    np.testing.assert_allclose(sides / sides[0], span / span[0])
    assert scene.aspectmode == "manual" and max(sides[0] / 1.75, sides[1] / 1.5) == pytest.approx(1.0)
    assert scene.zaxis.title.text == "" and scene.zaxis.showticklabels is False


def test_a_motion_in_space():
    scene = da.scenes.rolling_sphere()
    start = {"x": 0, "y": 0, "psi": 0, "theta": 1.0, "phi": 0, "psi_dot": 0.3, "theta_dot": 0.2, "phi_dot": 1.0}
    model = da.compile_model(scene, backend="numpy", cache=False)
    motion = model.simulate((0, 1), start, {"m": 1, "r": 0.3, "g": 9.81}, t_eval=[0, 0.5, 1], dense=False)
    moving = motion.animate(fps=2)
    moving._draw_frame(2)
    assert hasattr(moving._fig.axes[0], "get_zlim")
    pytest.importorskip("plotly")
    from dalembert.results.html_animation import figure

    ratio, span = figure(moving.drawing, 2).layout.scene.aspectratio, moving.drawing.high - moving.drawing.low
    np.testing.assert_allclose([ratio.x, ratio.y, ratio.z], 1.7 * span / np.linalg.norm(span))


def test_contacts():
    """A ball that bounces twice."""
    height, (m, g), push = dynamicsymbols("height"), sp.symbols("m g"), da.unknowns("push")
    N, O = ReferenceFrame("N"), Point("O")
    B = O.locatenew("B", height * N.y)
    scene = da.Scene("ball", frame=N, origin=O, coordinates=[height])
    scene.add_bodies(Particle("ball", B, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_joints(da.Joint("floor", body="ball", at=B, force=push * N.y))
    scene.add_contacts(da.UnilateralContact(normal=push, gap=height, name="floor", restitution=0.8))
    model = da.compile_model(scene, backend="numpy", cache=False, outputs=[B])
    start, parameters, end = {height: 1.0, height.diff(): 0.0}, {m: 1.0, g: 9.81}, 1.5
    motion = model.simulate((0, end), start, parameters)
    assert len(motion.phases) > 2
    np.testing.assert_array_equal(motion["B_y"], motion["height"])
    moving = motion.animate(fps=10)
    moving._draw_frame(3)
    path = moving._fig.axes[0].lines[0].get_xydata()[:, -1]
    np.testing.assert_allclose(path, motion(np.linspace(0, 0.3, len(path)))["height"], atol=1e-12)
    kept = model.simulate((0, end), start, parameters, dense=False)
    kept.animate(fps=10)._draw_frame(2)
    some = kept.rows(np.array([3, 0, 2]))
    np.testing.assert_array_equal(some.t, kept.t[[3, 0, 2]])
    np.testing.assert_array_equal(some.q, kept.q[[3, 0, 2]])


def test_further_points(sleigh):
    scene, _ = sleigh._pictured
    tip = Point("tip")
    tip.set_pos(scene.origin, sp.Symbol("b", positive=True) * scene.frame.x)
    drawn = skeleton(scene, ("I_C", "b", "m"), [tip])
    place = drawn.points.index("tip")
    positions, _ = drawn.at(sleigh.t[:1], sleigh.q[:1], sleigh._pictured[1])
    assert list(positions[0, place]) == [0.3, 0.0, 0.0]
    far = scene.origin.locatenew("far", sp.Symbol("d") * scene.frame.x)
    with pytest.raises(OptionError, match="points have parameters that the motion does not: d"):
        sleigh.animate(points=[far])
    with pytest.raises(OptionError, match=r"unknown points nose; known: .*G"):
        sleigh.animate(points=["nose"])


@pytest.mark.parametrize("options", [{"fps": 0}, {"speed": -1.0}, {"fps": float("nan")}])
def test_options_are_positive(sleigh, options):
    with pytest.raises(OptionError, match="must be a positive number"):
        sleigh.animate(**options)


def test_too_many_pictures(sleigh):
    with pytest.raises(OptionError, match=r"pictures are too many .*; give a larger speed"):
        sleigh.animate(speed=1e-5)


def test_scenes_without_positions():
    q = dynamicsymbols("q")
    motion = da.compile_model(LagrangesMethod(q.diff() ** 2, [q]), backend="numpy", cache=False).simulate(
        (0, 1), {"q": 0, "q_dot": 1}, {}
    )
    with pytest.raises(OptionError, match="without positions"):
        motion.animate()


def test_without_matplotlib(sleigh, monkeypatch):
    real = builtins.__import__

    def refuse(name, *args, **kwargs):
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.delitem(sys.modules, "dalembert.results.animation", raising=False)
    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(MissingExtraError, match=r'pip install "dalembert\[plot\]"'):
        sleigh.animate()


def test_points_are_outputs():
    """Their positions from the origin, on the frame of the scene, also of points of no body."""
    x, a = dynamicsymbols("x a")
    L, m = sp.symbols("L m")
    N, O = ReferenceFrame("N"), Point("O")
    A = N.orientnew("A", "Axis", (a, N.z))
    C = O.locatenew("C", x * N.x)
    P = C.locatenew("P", L * A.x)
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x, a])
    scene.add_bodies(Particle("cart", C, m), Particle("bob", P, m))
    model = da.compile_model(scene, outputs=[P, "energy", "x"], backend="numpy", cache=False)
    motion = model.simulate((0, 1), {x: 0, a: 0.3, "x_dot": 1, "a_dot": 2}, {L: 0.5, m: 1})
    np.testing.assert_allclose(motion["P_x"], motion["x"] + 0.5 * np.cos(motion["a"]), atol=1e-14)
    np.testing.assert_allclose(motion["P_y"], 0.5 * np.sin(motion["a"]), atol=1e-14)
    assert not motion["P_z"].any() and np.ptp(motion["energy"]) < 1e-8
