"""Thumbnails of the gallery: a picture of the motion that a script shows."""

from __future__ import annotations

from typing import Any

from dalembert.results.animation import Animation

__all__ = ["save_frame"]


def save_frame(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Save the middle picture of an animation that a block ends with; the page itself shows the animation."""
    shown = block_vars["example_globals"].get("___")
    if isinstance(shown, Animation):
        times = shown.drawing.t
        figure = shown.picture(times[len(times) * 2 // 3])
        (panel,) = figure.axes
        panel.set_axis_off()
        panel.set_title("")
        if panel.get_legend():
            panel.get_legend().remove()
        figure.savefig(next(block_vars["image_path_iterator"]), dpi=100, bbox_inches="tight")
    return ""
