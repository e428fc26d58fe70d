"""Animations as pages for a browser; imported on use, because they need plotly."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import MissingExtraError
from .drawn_parts import Drawing, Line, Surface

try:
    import plotly.graph_objects as go
except ImportError:
    raise MissingExtraError('plotly is needed; install it with: pip install "dalembert[plot]"') from None


_FOLLOW_WIDTH = (
    "const div = document.getElementById('{plot_id}'); new ResizeObserver(() => Plotly.Plots.resize(div)).observe(div);"
)
"""Pages around a picture may find its width after it was drawn."""
_WIDEST, _TALLEST, _DIAGONAL = 1.75, 1.5, 1.7
"""Sides of a motion in a plane, and the diagonal of one in space, with which they fill a picture, in plotly's units."""


def page(drawing: Drawing, fps: float, *, whole: bool = True) -> str:
    """Return a page of HTML that needs no network, or only what a notebook puts on its own page.

    Parameters
    ----------
    drawing : Drawing
    fps : float
        Pictures a second.
    whole : bool
        Whether to return a whole page.
    """
    text: str = figure(drawing, fps).to_html(
        include_plotlyjs=True,
        full_html=whole,
        auto_play=False,
        default_height="96vh" if whole else "600px",
        config={"displaylogo": False},
        post_script=_FOLLOW_WIDTH,
    )
    return text


def figure(drawing: Drawing, fps: float) -> Any:
    """Return plotly's figure of a drawing, with a frame for each picture."""
    items: list[Surface | Line] = [*drawing.surfaces, *drawing.lines]
    data = [_surface(item, 0) if isinstance(item, Surface) else _line(item, 0) for item in items]
    moving = [i for i, item in enumerate(items) if not item.at_rest]
    frames = [
        go.Frame(
            data=[_moved(items[i], k) for i in moving],
            traces=moving,
            name=str(k),
            layout={"title": {"text": f"t = {drawing.t[k]:.2f} s"}},
        )
        for k in range(len(drawing.t))
    ]
    return go.Figure(data=data, frames=frames, layout=_layout(drawing, fps))


def _line(line: Line, k: int) -> Any:
    points = line.points if line.is_path else line.points[k]
    x, y, z = points.T
    style: dict[str, Any] = {"name": line.name, "showlegend": bool(line.name), "hoverinfo": "skip"}
    if line.width > 0.0:
        style |= {"mode": "lines", "line": {"color": line.color, "width": 2.0 * line.width}}
        style["opacity"] = 0.4 if line.is_path else 1.0
    else:
        style |= {"mode": "markers", "marker": {"color": line.color, "size": 5 if line.name else 3}}
    return go.Scatter3d(x=x, y=y, z=z, **style)


def _surface(surface: Surface, k: int) -> Any:
    x, y, z = surface.vertices[k].T
    i, j, m = surface.faces.T
    return go.Mesh3d(
        x=x,
        y=y,
        z=z,
        i=i,
        j=j,
        k=m,
        color=surface.color,
        opacity=surface.opacity,
        name=surface.name,
        hoverinfo="skip",
        flatshading=True,
    )


def _moved(item: Surface | Line, k: int) -> Any:
    """Return the part of a surface or a line that changes from picture to picture."""
    points = item.vertices[k] if isinstance(item, Surface) else item.points[k]
    x, y, z = np.asarray(points, dtype=np.float32).T  # a picture needs no more digits
    return (go.Mesh3d if isinstance(item, Surface) else go.Scatter3d)(x=x, y=y, z=z)


def _layout(drawing: Drawing, fps: float) -> dict[str, Any]:
    now = {"frame": {"duration": 0, "redraw": True}, "mode": "immediate", "transition": {"duration": 0}}
    play = {"frame": {"duration": 1e3 / fps, "redraw": True}, "fromcurrent": True, "transition": {"duration": 0}}
    buttons = [
        {"label": "Play", "method": "animate", "args": [None, play]},
        {"label": "Pause", "method": "animate", "args": [[None], now]},
    ]
    steps = [
        {"label": f"{t:.2f}", "method": "animate", "args": [[str(k)], now]} for k, t in enumerate(drawing.t.tolist())
    ]
    return {
        "title": {"text": f"t = {drawing.t[0]:.2f} s"},
        "margin": {"l": 0, "r": 0, "t": 40, "b": 0},
        "scene": _space(drawing),
        "updatemenus": [{"type": "buttons", "direction": "left", "x": 0.05, "y": 0.02, "buttons": buttons}],
        "sliders": [
            {"steps": steps, "x": 0.2, "len": 0.75, "y": 0.05, "currentvalue": {"prefix": "t = ", "suffix": " s"}}
        ],
    }


def _space(drawing: Drawing) -> dict[str, Any]:
    """Return axes and camera; a motion in a plane is seen along its normal, without perspective."""
    low, high = drawing.low.copy(), drawing.high.copy()
    sides = high - low
    scale = _DIAGONAL / float(np.linalg.norm(sides))
    scene: dict[str, Any] = {"aspectmode": "manual", "domain": {"y": [0.14, 1.0]}}
    for name, a, b in zip("xyz", low.tolist(), high.tolist(), strict=True):
        scene[f"{name}axis"] = {"range": [a, b], "title": {"text": f"{name} [m]"}}
    if len(drawing.plane) == 2:
        (normal,) = {0, 1, 2} - set(drawing.plane)
        eye = {name: 0.0 for name in "xyz"} | {"xyz"[normal]: -2.0 if normal == 1 else 2.0}
        up = {name: 0.0 for name in "xyz"} | {"xyz"[drawing.plane[1]]: 1.0}
        scene["camera"] = {"eye": eye, "up": up, "projection": {"type": "orthographic"}}
        scene[f"{'xyz'[normal]}axis"] |= {"title": {"text": ""}, "showticklabels": False}
        # without perspective, the picture is as large as the aspect ratio says, wherever the eye is
        wide, tall = (float(sides[axis]) for axis in drawing.plane)
        scale = min(_WIDEST / wide, _TALLEST / tall)
    scene["aspectratio"] = dict(zip("xyz", (scale * sides).tolist(), strict=True))
    return scene
