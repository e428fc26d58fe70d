"""Animations of trajectories; imported on use, because they need matplotlib."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np
from matplotlib.animation import FuncAnimation, writers
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..arrays import FloatArray
from ..errors import MissingExtraError, OptionError

if TYPE_CHECKING:
    from ..mechanics.skeleton import Skeleton
    from .motion import Motion

__all__ = ["Animation", "animate"]

_MOST_FRAMES = 5_000
_FLAT = 1e-9
_WRITERS = {".gif": "pillow", ".html": "html", ".htm": "html", ".mp4": "ffmpeg", ".mkv": "ffmpeg", ".mov": "ffmpeg"}
_AXIS_COLORS = ("tab:red", "tab:green", "tab:blue")


@final
class Animation(FuncAnimation):
    """matplotlib's animation, which a notebook shows with buttons; ``save("motion.gif")`` writes it."""

    def save(self, filename: Any, writer: Any = None, *settings: Any, **options: Any) -> None:
        """Write the animation to a file: ``.gif`` and ``.html`` by matplotlib alone, ``.mp4`` with ffmpeg.

        Parameters
        ----------
        filename : str or path
        writer : str or matplotlib.animation.AbstractMovieWriter, optional
            By default, "pillow" for a gif, "html" for a page, "ffmpeg" for a film.

        Raises
        ------
        OptionError
            For another ending without a writer.
        MissingExtraError
            When the program that writes the file is not installed.
        """
        ending = Path(str(filename)).suffix.lower()
        if writer is None and ending not in _WRITERS:
            raise OptionError(
                f"animations are written to files that end with {', '.join(_WRITERS)}, not to {str(filename)!r}; give"
                " one of these, or writer="
            )
        chosen = _WRITERS[ending] if writer is None else writer
        if isinstance(chosen, str) and not writers.is_available(chosen):
            raise MissingExtraError(
                f"{str(filename)!r} needs the writer {chosen!r} of matplotlib, which is not available: install ffmpeg,"
                f" or write a .gif or .html file (available: {', '.join(writers.list())})"
            )
        super().save(filename, chosen, *settings, **options)

    def _repr_html_(self) -> str:
        html: str = self.to_jshtml()
        return html


def animate(motion: Motion, drawn: Skeleton, constants: FloatArray, fps: float, speed: float) -> Animation:
    """Return the animation of a motion; see `dalembert.results.motion.Motion.animate`."""
    for name, value in (("fps", fps), ("speed", speed)):
        if not 1e-9 < value < 1e9:
            raise OptionError(f"{name} must be a positive number of moderate size, not {value!r}")
    frames = _frames(motion, fps, speed)
    positions, axes = drawn.at(frames.elapsed, frames.q, constants)
    kept = _plane(positions)
    figure = Figure(figsize=(6.0, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    panel = figure.add_subplot(projection="3d") if len(kept) == 3 else figure.add_subplot()
    low, high = positions.min(axis=(0, 1)), positions.max(axis=(0, 1))
    reach = 0.12 * float(np.max(high - low)) or 0.1
    _frame_panel(panel, kept, low - reach, high + reach)
    step = _draw(panel, drawn, positions[..., kept], axes[..., kept], 0.6 * reach)
    panel.set_title("t = 0 s")
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # the place of everything is found once, and not for each picture
    return Animation(
        figure,
        lambda k: (*step(k), panel.set_title(f"t = {frames.t[k]:.2f} s")),
        frames=len(frames.t),
        interval=1e3 / fps,
        blit=False,
    )


def _frames(motion: Motion, fps: float, speed: float) -> Motion:
    """Return the motion at the times of the pictures; without continuous output, at recorded times near them."""
    if not len(motion.t):
        raise OptionError("the motion has no recorded times, so that there is nothing to draw")
    first, last = float(motion.t[0]), float(motion.t[-1])
    pictures = abs(last - first) / speed * fps
    count = 1 + round(pictures) if pictures < 1e15 else 10**15
    if count > _MOST_FRAMES:
        raise OptionError(
            f"{count:,} pictures are too many (at most {_MOST_FRAMES:,}); give a larger speed, such as"
            f" speed={math.ceil(speed * count / _MOST_FRAMES):g}, or smaller fps"
        )
    times = np.linspace(first, last, count)
    if motion.can_evaluate:
        return motion(times)
    nearest = np.abs(motion.t[:, np.newaxis] - times).argmin(axis=0)
    return motion.rows(nearest)


def _plane(positions: FloatArray) -> list[int]:
    """Return the axes along which anything is apart: two of them for a motion in a plane, else three."""
    extent = np.ptp(positions.reshape(-1, 3), axis=0)
    flat = [i for i in (2, 1, 0) if extent[i] <= _FLAT * max(float(extent.max()), _FLAT)]
    return [i for i in range(3) if i != flat[0]] if flat else [0, 1, 2]


def _frame_panel(panel: Any, kept: list[int], low: FloatArray, high: FloatArray) -> None:
    for place, axis in zip("xyz", kept, strict=False):
        getattr(panel, f"set_{place}lim")(low[axis], high[axis])
        getattr(panel, f"set_{place}label")(f"{'xyz'[axis]} [m]")
    if len(kept) == 3:
        panel.set_box_aspect(high - low)
    else:
        panel.set_aspect("equal")
        panel.grid(alpha=0.3)


def _draw(
    panel: Any, drawn: Skeleton, positions: FloatArray, axes: FloatArray, size: float
) -> Callable[[int], list[Any]]:
    """Draw everything once and return what moves it to picture k: paths, links, points, axes."""
    count = len(drawn.bodies)
    colors = [f"C{i % 10}" for i in range(count)]
    paths = [_line(panel, color=color, linewidth=1.0, alpha=0.6) for color in colors]
    links = [_line(panel, color="0.35", linewidth=2.0) for _ in drawn.links]
    centres = [_line(panel, color=c, marker="o", label=b) for c, b in zip(colors, drawn.bodies, strict=True)]
    others = _line(panel, color="0.35", marker=".", linestyle="none")
    arms = [[_line(panel, color=color, linewidth=1.2) for color in _AXIS_COLORS] for _ in drawn.framed]
    panel.legend(loc="upper right", fontsize="small")

    def step(k: int) -> list[Any]:
        for i, path in enumerate(paths):
            _set(path, positions[: k + 1, i])
            _set(centres[i], positions[k, i : i + 1])
        for link, ends in zip(links, drawn.links, strict=True):
            _set(link, positions[k, list(ends)])
        _set(others, positions[k, count:])
        for three, body, frame in zip(arms, drawn.framed, axes[k], strict=True):
            for arm, axis in zip(three, frame, strict=True):
                _set(arm, positions[k, body] + np.outer((0.0, size), axis))
        return [*paths, *links, *centres, others, *(arm for three in arms for arm in three)]

    return step


def _line(panel: Any, **style: Any) -> Any:
    return panel.plot(*([] for _ in range(3 if hasattr(panel, "get_zlim") else 2)), **style)[0]


def _set(line: Any, points: FloatArray) -> None:
    """Give a line its points (k, 2) or (k, 3)."""
    if points.shape[-1] == 3:
        line.set_data_3d(*points.T)
    else:
        line.set_data(*points.T)
