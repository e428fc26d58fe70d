"""Pictures of the gallery: their style, and thumbnails of the motions that scripts show."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from dalembert.results.animation import Animation
from dalembert.results.drawn_parts import Drawing

__all__ = ["save_frame", "use_style"]

STYLE = Path(__file__).with_name("figures.mplstyle")


def use_style(gallery_conf: dict[str, Any], name: str) -> None:
    """Give the next script the style of the gallery, whatever the one before it has set."""
    mpl.rcdefaults()
    plt.style.use(STYLE)


def save_frame(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Save a picture of an animation that a block ends with; the page itself shows the animation."""
    shown = block_vars["example_globals"].get("___")
    if isinstance(shown, Animation):
        times = shown.drawing.t
        figure = shown.picture(times[len(times) * 2 // 3])
        _show_bodies(figure, shown.drawing, len(times) * 2 // 3)
        figure.savefig(next(block_vars["image_path_iterator"]))
    return ""


def _show_bodies(figure: Any, drawing: Drawing, k: int) -> None:
    """Fill a figure of the shape of a thumbnail with the bodies at picture k, without axes."""
    (panel,) = figure.axes
    drawn = [line for line in drawing.lines if not line.is_path]
    moving = [line.points[k] for line in [line for line in drawn if line.width > 0] or drawn]
    moving += [surface.vertices[k] for surface in drawing.surfaces if not surface.at_rest]
    points = np.concatenate(moving)
    low, high = points.min(axis=0), points.max(axis=0)
    middle, reach = (low + high) / 2, 0.65 * np.ptp(points, axis=0).max()
    width, height = mpl.rcParams["figure.figsize"]
    figure.set_size_inches(width, height)
    panel.set_position([0, 0, 1, 1])
    sizes = [reach * width / height, reach]
    if len(drawing.plane) == 3:  # a square that is as wide as the figure, so that the floor fills it
        panel.set_position([0, 0.5 - 0.5 * width / height, 1, width / height])
        panel.set_box_aspect((1, 1, 1), zoom=1.2)
        sizes = [reach, reach, reach]
    for axis, size, name in zip(drawing.plane, sizes, "xyz", strict=False):
        getattr(panel, f"set_{name}lim")(middle[axis] - size, middle[axis] + size)
    panel.set_axis_off()
    panel.set_title("")
    if panel.get_legend():
        panel.get_legend().remove()
