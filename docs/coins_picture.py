"""The picture of the first page: coins that roll, lit from above; `generate_pictures.py` writes it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from live_pages import scene_of_gallery
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

import dalembert as da

__all__ = ["draw_coins"]

Array = NDArray[np.float64]

END, FRAMES, FPS = 6.0, 120, 20
FINE = 10  # points of a track between two pictures
RADIUS, THICKNESS, SECTORS = 0.2, 0.035, 48
STARTS = (
    # x, y [m], heading, lean [rad], rates of heading, lean and spin [rad/s]
    (-1.0, -0.5, 0.0, 0.30, 0.8, 0.0, 4.0),
    (0.9, -0.9, 1.9, -0.20, -0.6, 0.0, 4.5),
    (0.3, 0.6, 0.4, 0.75, 2.4, 0.0, 2.0),
    (-0.9, 0.9, -0.6, 0.10, 0.15, 0.0, 5.0),
    (1.3, 0.5, 2.6, 0.45, 1.4, 0.0, 3.0),
)
COLORS = np.array([[31, 95, 168], [224, 123, 26], [58, 143, 92], [192, 50, 60], [122, 92, 168]]) / 255
EYE, TARGET = np.array([2.4, -5.2, 3.1]), np.array([0.1, 0.0, 0.05])
LIGHT = np.array([-0.45, -0.35, 0.82]) / np.linalg.norm([-0.45, -0.35, 0.82])


def camera() -> Array:
    """Return the axes of the camera (3, 3): right, up, towards the eye."""
    back = (EYE - TARGET) / np.linalg.norm(EYE - TARGET)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back])


def seen(points: Array) -> tuple[Array, Array]:
    """Return places on the picture (..., 2) and distances from the eye (...)."""
    local = (points - EYE) @ camera().T
    return local[..., :2] / -local[..., 2:], -local[..., 2]


def coin(heading: float, lean: float, spin: float, contact: Array) -> tuple[Array, Array]:
    """Return the faces of a coin (n, 4, 3) and how bright their paint is (n,)."""
    c, s = np.cos(heading), np.sin(heading)
    H = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
    up = np.cos(lean) * H[2] - np.sin(lean) * H[1]
    axis = np.cos(lean) * H[1] + np.sin(lean) * H[2]
    angles = np.linspace(0, 2 * np.pi, SECTORS + 1)
    forward = np.cross(axis, up)
    centre = contact + RADIUS * up
    rim = centre + RADIUS * (np.outer(np.cos(angles - spin), forward) + np.outer(np.sin(angles - spin), up))
    half = 0.5 * THICKNESS * axis
    hub = np.broadcast_to(centre, rim[1:].shape)
    sides = [np.stack([rim[:-1] + h, rim[1:] + h, hub + h, hub + h], axis=1) for h in (half, -half)]
    edge = np.stack([rim[:-1] + half, rim[1:] + half, rim[1:] - half, rim[:-1] - half], axis=1)
    paint = np.where((np.arange(SECTORS) // (SECTORS // 8)) % 2, 1.0, 0.72)
    return np.concatenate([*sides, edge]), np.concatenate([paint, paint, np.full(SECTORS, 0.85)])


def shaded(faces: Array, paint: Array, color: Array) -> Array:
    """Return the colours of faces (n, 3) under the light; both sides of a face are lit alike."""
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    middles = faces.mean(axis=1)
    normals *= np.sign(np.einsum("ij,ij->i", normals, EYE - middles))[:, np.newaxis]
    diffuse = np.clip(normals @ LIGHT, 0.0, 1.0)
    halfway = (EYE - middles) / np.linalg.norm(EYE - middles, axis=1, keepdims=True) + LIGHT
    halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
    shine = np.clip(np.einsum("ij,ij->i", normals, halfway), 0.0, 1.0) ** 30
    base = color * paint[:, np.newaxis]
    lit: Array = np.clip(base * (0.7 + 0.45 * diffuse[:, np.newaxis]) + 0.35 * shine[:, np.newaxis], 0.0, 1.0)
    return lit


def draw_coins(path: Path) -> None:
    """Simulate the coins of the gallery, and write the animation to a gif."""
    model = da.compile_model(scene_of_gallery("a04_rolling_coin"))
    names = ("x", "y", "heading", "lean", "heading_dot", "lean_dot", "spin_dot")
    runs = [
        model.simulate(
            (0, END), {**dict(zip(names, start, strict=True)), "spin": 0}, {"m": 0.1, "r": RADIUS, "g": 9.81}
        )(np.linspace(0, END, FINE * FRAMES))
        for start in STARTS
    ]
    contacts = [np.stack([run["x"], run["y"], 0 * run.t], axis=1) for run in runs]
    figure = Figure(figsize=(6.4, 3.6), dpi=90)
    canvas = FigureCanvasAgg(figure)
    panel = figure.add_axes((0, 0, 1, 1))
    panel.set(xlim=(-0.31, 0.31), ylim=(-0.174, 0.174))
    panel.set_axis_off()
    figure.set_facecolor("#f4f6f9")
    grid = np.arange(-4, 4.01, 0.5)
    lines = [np.array([[a, -4, 0], [a, 4, 0]]) for a in grid] + [np.array([[-4, a, 0], [4, a, 0]]) for a in grid]
    panel.add_collection(LineCollection([seen(line)[0] for line in lines], colors="#dfe5ec", linewidths=0.8, zorder=0))
    for at, color in zip(
        contacts, COLORS, strict=True
    ):  # the whole track, faint: the first picture shows the motion, too
        panel.plot(*seen(at)[0].T, color=color, lw=1.6, alpha=0.2, zorder=2)
    tracks = [panel.plot([], [], color=color, lw=1.6, alpha=0.8, zorder=2)[0] for color in COLORS]
    shadows = panel.add_collection(
        PolyCollection([], facecolors="#c9d1da", edgecolors="#c9d1da", linewidths=0.3, zorder=1)
    )
    solids = panel.add_collection(PolyCollection([], linewidths=0.4, zorder=3))

    def draw(picture: int) -> None:
        k = FINE * picture
        faces, colors = list[Array](), list[Array]()
        for run, at, track, color in zip(runs, contacts, tracks, COLORS, strict=True):
            own, paint = coin(run["heading"][k], run["lean"][k], run["spin"][k], at[k])
            faces.append(own)
            colors.append(shaded(own, paint, color))
            track.set_data(*seen(at[: k + 1])[0].T)
        every, painted = np.concatenate(faces), np.concatenate(colors)
        places, depths = seen(every)
        order = np.argsort(-depths.mean(axis=1))
        solids.set(verts=places[order], facecolor=painted[order], edgecolor=painted[order])
        shadows.set(verts=seen(every - every[..., 2:] / LIGHT[2] * LIGHT)[0])

    pictures = []
    for picture in range(FRAMES):
        draw(picture)
        canvas.draw()
        pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy()))
    some = Image.fromarray(np.concatenate([np.asarray(each) for each in pictures[::10]]))
    # one palette for all, without dithering: what is at rest costs nothing; rare colours are those of the coins
    palette = some.quantize(250, method=Image.Quantize.MAXCOVERAGE)
    first, *others = (each.quantize(palette=palette, dither=Image.Dither.NONE) for each in pictures)
    first.save(path, save_all=True, append_images=others, duration=1000 // FPS, loop=0)
