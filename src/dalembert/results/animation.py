"""Animations of trajectories; imported on use, because they need matplotlib."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np
from matplotlib.animation import FuncAnimation, writers
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from ..arrays import FloatArray
from ..errors import MissingExtraError, OptionError
from ..mechanics.skeleton import skeleton
from ..stops.segments import Constants, constants_at
from ..values import listed, option
from .drawing import drawing_of, shape_points
from .drawn_parts import Drawing, Frames, Line, Surface

if TYPE_CHECKING:
    from ..scene import Scene
    from .trajectory import Trajectory

_MOST_FRAMES = 5_000
_PATH_POINTS = 500
"""Least number of parts of a path where the motion is known between recorded times."""
_WRITERS = {".gif": "pillow", ".html": "html", ".htm": "html", ".mp4": "ffmpeg", ".mkv": "ffmpeg", ".mov": "ffmpeg"}
_PAGES = (".html", ".htm")


@final
class Animation(FuncAnimation):
    """matplotlib's animation; ``save("motion.html")``, ``.gif`` or ``.mp4`` writes it, a notebook shows it.

    Attributes
    ----------
    drawing : Drawing
        The drawing.
    """

    def __init__(self, figure: Figure, update: _Update, fps: float, at: Callable[[float], Drawing]) -> None:
        self.drawing, self._figure, self._update, self._fps, self._at = update.drawing, figure, update, fps, at
        drawing = self.drawing
        super().__init__(figure, update, frames=len(drawing.t), interval=1e3 / fps, blit=False)
        self._draw_was_started = True  # or matplotlib tells who does not show it to call plt.show, which cannot show it

    def picture(self, t: float) -> Figure:
        """Return a figure of matplotlib of the motion at a time, to save it: ``picture(1.5).savefig("pose.pdf")``.

        Parameters
        ----------
        t : float
            Time [s] of the motion. It is met exactly; a motion without continuous output is drawn at the recorded time
            nearest to it, which the title says.

        Raises
        ------
        OptionError
            For a time before the motion or after it.
        """
        time = option("t", t)
        first, last = sorted((float(self.drawing.t[0]), float(self.drawing.t[-1])))
        if not first <= time <= last:
            raise OptionError(f"t = {time:g} is not a time of the motion, which goes from {first:g} to {last:g} s")
        figure, update = _figure(self._at(time))
        update(int(np.argmin(np.abs(update.drawing.t - time))))
        return figure

    def save(self, filename: Any, writer: Any = None, *settings: Any, **options: Any) -> None:
        """Write the animation to a file: a page ``.html``, ``.gif``, or ``.mp4`` with ffmpeg.

        A page holds everything that it needs. It has controls to play, to choose a time and, in space, to turn.

        Parameters
        ----------
        filename : str or path
        writer : str or matplotlib.animation.AbstractMovieWriter, optional
            A writer of matplotlib; by default, plotly for a page, Pillow for a gif, "ffmpeg" for a film.

        Raises
        ------
        OptionError
            For another ending without a writer.
        MissingExtraError
            When the package or program that writes the file is not installed.
        """
        ending = Path(str(filename)).suffix.lower()
        if writer is None and ending not in _WRITERS:
            raise OptionError(
                f"animations are written to files that end with {', '.join(_WRITERS)}, not to {str(filename)!r}; give"
                " one of these, or writer="
            )
        if writer is None and ending in _PAGES and not settings and not options:
            from .html_animation import page

            Path(filename).write_text(page(self.drawing, self._fps), encoding="utf-8")
            return
        if writer is None and ending == ".gif" and not settings and options.keys() <= {"dpi"}:
            self._save_gif(filename, **options)
            return
        chosen = _WRITERS[ending] if writer is None else writer
        if isinstance(chosen, str) and not writers.is_available(chosen):
            raise MissingExtraError(
                f"{str(filename)!r} needs the writer {chosen!r} of matplotlib, which is not available: install ffmpeg,"
                f" or write a .gif or .html file (available: {', '.join(writers.list())})"
            )
        super().save(filename, chosen, *settings, **options)

    def _save_gif(self, filename: Any, dpi: float = 100.0) -> None:
        """Write a gif; surfaces and lines that do not move are drawn once."""
        from PIL import Image

        first, *others = (
            Image.fromarray(picture).quantize(128, method=Image.Quantize.FASTOCTREE) for picture in self._pictures(dpi)
        )
        first.save(filename, save_all=True, append_images=others, duration=max(20, round(1e3 / self._fps)), loop=0)

    def _pictures(self, dpi: float) -> Iterator[Any]:
        """Yield pictures (height, width, 3) of bytes."""
        figure, update = self._figure, self._update
        figure.set_dpi(dpi)
        canvas: Any = figure.canvas
        for artist in update.artists:
            artist.set_animated(True)
        canvas.draw()
        background = canvas.copy_from_bbox(figure.bbox)
        for k in range(len(self.drawing.t)):
            update(k)
            canvas.restore_region(background)
            for artist in update.artists:
                if hasattr(artist, "do_3d_projection"):
                    artist.do_3d_projection()
                update.panel.draw_artist(artist)
            yield np.asarray(canvas.buffer_rgba())[..., :3].copy()
        for artist in update.artists:
            artist.set_animated(False)

    def _repr_html_(self) -> str:
        try:
            from .html_animation import page
        except MissingExtraError:
            html: str = self.to_jshtml()
            return html
        return page(self.drawing, self._fps, whole=False)


def animated(
    motion: Trajectory,
    scene: Scene,
    constants: Constants,
    points: Sequence[Any],
    fps: float,
    speed: float,
    reactions: bool,
) -> Animation:
    """Return the animation of a motion; see `animate`."""
    for name, value in (("fps", fps), ("speed", speed)):
        if not 1e-9 < value < 1e9:
            raise OptionError(f"{name} must be a positive number of moderate size, not {value!r}")
    layout = motion._layout
    wanted = listed("points", points, "names of points")
    drawn = skeleton(scene, layout.parameters, [*wanted, *shape_points(scene)])
    times = _times(motion, fps, speed)
    c = constants_at(constants, motion.elapsed[:1])
    values = dict(zip(layout.parameters, np.ravel(c)[: len(layout.parameters)].tolist(), strict=False))
    values |= {symbol: values[name] for symbol, name in layout.aliases.items() if name in values}

    def drawing(wanted: FloatArray) -> Drawing:
        return drawing_of(_frames(motion, wanted), scene, drawn, constants, values, reactions)

    def at(t: float) -> Drawing:
        whole = np.union1d(times, [t])
        return drawing(whole if times[-1] >= times[0] else whole[::-1])

    return Animation(*_figure(drawing(times)), fps, at)


def _figure(drawing: Drawing) -> tuple[Figure, _Update]:
    figure = Figure(figsize=(6.0, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    panel = figure.add_subplot(projection="3d") if len(drawing.plane) == 3 else figure.add_subplot()
    _frame_panel(panel, drawing)
    update = _Update(panel, drawing)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # the place of everything is found once, and not for each picture
    return figure, update


def _times(motion: Trajectory, fps: float, speed: float) -> FloatArray:
    """Return the times of the pictures."""
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
    return np.linspace(first, last, count)


def _frames(motion: Trajectory, times: FloatArray) -> Frames:
    """Return the motion at times and along paths; without continuous output, at recorded times near them."""
    if motion.can_evaluate:
        count = len(times) - 1
        parts = -(-_PATH_POINTS // max(count, 1))
        fine = np.interp(np.arange(count * parts + 1) / parts, np.arange(count + 1), times)
        return Frames(motion(times), motion(fine), 1 + parts * np.arange(count + 1))
    nearest = np.abs(motion.t[:, np.newaxis] - times).argmin(axis=0)
    kept = np.union1d(nearest, np.linspace(0, len(motion.t) - 1, min(len(motion.t), _MOST_FRAMES)).astype(int))
    return Frames(motion.rows(nearest), motion.rows(kept), 1 + np.searchsorted(kept, nearest))


def _frame_panel(panel: Any, drawing: Drawing) -> None:
    for place, axis in zip("xyz", drawing.plane, strict=False):
        getattr(panel, f"set_{place}lim")(drawing.low[axis], drawing.high[axis])
        getattr(panel, f"set_{place}label")(f"{'xyz'[axis]} [m]")
    if len(drawing.plane) == 3:
        panel.set_box_aspect(drawing.high - drawing.low)
    else:
        panel.set_aspect("equal")
        panel.grid(alpha=0.3)


class _Update:
    """Draws everything once, and moves it to picture k when called."""

    def __init__(self, panel: Any, drawing: Drawing) -> None:
        self.panel, self.drawing = panel, drawing
        self._plane = list(drawing.plane)
        self._movers: list[Callable[[int], None]] = []
        self.artists: list[Any] = []
        for surface in drawing.surfaces:
            self._add_surface(surface)
        for line in drawing.lines:
            self._add_line(line)
        if any(line.name for line in drawing.lines):
            panel.legend(loc="upper right", fontsize="small")
        self._title = panel.set_title("t = 0 s")
        self.artists.append(self._title)

    def __call__(self, k: int) -> list[Any]:
        for move in self._movers:
            move(k)
        self._title.set_text(f"t = {self.drawing.t[k]:.2f} s")
        return self.artists

    def _add_line(self, line: Line) -> None:
        style: dict[str, Any] = {"color": line.color, "label": line.name or None}
        if line.width > 0.0:
            style |= {"linewidth": line.width, "alpha": 0.6 if line.is_path else 1.0}
        else:
            style |= {"marker": "o" if line.name else ".", "linestyle": "none"}
        artist = self.panel.plot(*([] for _ in self._plane), **style)[0]
        points = line.points[..., self._plane]

        def move(k: int) -> None:
            now = points[: self.drawing.reached[k]] if line.is_path else points[k]
            if len(self._plane) == 3:
                artist.set_data_3d(*now.T)
            else:
                artist.set_data(*now.T)

        self._movers.append(move)
        self.artists.append(artist)

    def _add_surface(self, surface: Surface) -> None:
        triangles = surface.vertices[..., self._plane][:, surface.faces]  # (n_t, m, 3, 2 or 3)
        style: dict[str, Any] = {"facecolor": surface.color, "edgecolor": "none", "alpha": 0.5 * surface.opacity}
        if len(self._plane) == 3:
            from mpl_toolkits.mplot3d.art3d import Poly3DCollection

            artist = Poly3DCollection(triangles[0], **style)
            self.panel.add_collection3d(artist)
        else:
            artist = PolyCollection(triangles[0], **style)
            self.panel.add_collection(artist)
        if surface.at_rest:
            return
        self._movers.append(lambda k: artist.set_verts(triangles[k]))
        self.artists.append(artist)
