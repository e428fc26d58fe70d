"""Methods of trajectories that draw them: `plot` and `animate`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import MissingExtraError, OptionError, nesting_named
from ..values import flag, option

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .animation import Animation
    from .trajectory import Trajectory

_POINTS_PER_STEP = 20


@nesting_named
def plot(self: Trajectory, *given: Any, ax: Any = None) -> Figure:
    """Draw names over time, the coordinates by default, and pairs over each other, a panel each; return the figure.

    The figure is one of pyplot, which ``plt.show()`` shows.

    Parameters
    ----------
    *given : str or symbol, or pair of them
        ``plot("x", ("x", "x_dot"))`` draws x over time, and x_dot over x.
    ax : matplotlib.axes.Axes or sequence of Axes, optional
        Where to draw: all names on one, with a legend, or each on its own.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    OptionError
        For another number of axes than of names, and groups of names that are no pairs.
    """
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        raise MissingExtraError('matplotlib is needed; install it with: pip install "dalembert[plot]"') from None
    wanted = [_pair(name) for name in given] or [("", name) for name in self.coordinates]
    names = [f"{over}, {name}" if over else name for over, name in wanted]
    smooth = self
    if self.can_evaluate and len(self.t) > 1:
        count = min(20_000, _POINTS_PER_STEP * len(self.t))
        smooth = self(np.linspace(self.t[0], self.t[-1], count))
    # unknown names are rejected before a figure is made
    columns = [[run[over] if over else run.t for run in (smooth, self)] for over, _ in wanted]
    values = [[run[name] for run in (smooth, self)] for _, name in wanted]
    timed = not any(over for over, _ in wanted)
    panels = list(np.ravel(ax)) if ax is not None else []
    if ax is None:
        figure = plt.figure(figsize=(7.0, 1.2 + 1.4 * len(names)), layout="constrained")
        panels = list(figure.subplots(len(names), 1, sharex=timed, squeeze=False)[:, 0])
    shared = ax is not None and len(panels) == 1
    if shared:
        panels = panels * len(names)
    if not all(hasattr(panel, "plot") for panel in panels):
        raise OptionError(f"ax must be Axes of matplotlib, not {ax!r}")
    if len(panels) != len(names):
        raise OptionError(f"ax must be one Axes, or one for each of the {len(names)} names, not {len(panels)}")
    for panel, label, (over, name), x, y in zip(panels, names, wanted, columns, values, strict=True):
        (line,) = panel.plot(x[0], y[0], linewidth=1.4, label=label)
        panel.plot(x[1], y[1], ".", markersize=3, color=line.get_color() if shared else None)
        if not shared:
            panel.set_ylabel(name)
        if over:
            panel.set_xlabel(over)
        panel.grid(alpha=0.3)
    if shared and len(names) > 1:
        panels[0].legend()
    elif shared:
        panels[0].set_ylabel(wanted[0][1])
    if not wanted[-1][0]:
        panels[-1].set_xlabel("t [s]")
    drawn: Figure = panels[0].figure
    return drawn


def _pair(given: Any) -> tuple[str, str]:
    """Return the names on the two axes of a panel, nothing for the time."""
    if not isinstance(given, tuple | list):
        return "", str(given)
    if len(given) != 2:
        raise OptionError(f'plot draws names, and pairs of them such as ("x", "x_dot"), not {given!r}')
    return str(given[0]), str(given[1])


@nesting_named
def animate(
    self: Trajectory, *, fps: float = 25.0, speed: float = 1.0, points: Sequence[Any] = (), reactions: bool = False
) -> Animation:
    """Return a moving picture of the bodies: their shapes (`Scene.add_shapes`), paths, links and points.

    Bodies without a shape are drawn by their mass centre, their axes, and lines to the points of joints. A motion
    in a plane is drawn in it, any other in space. A notebook shows the animation. Its ``save`` writes it to a file:
    ``save("motion.html")`` makes one page that opens without a network, with controls to play, to choose a time and
    to turn.

    Parameters
    ----------
    fps : float
        Pictures a second.
    speed : float
        Seconds of the motion that pass in one second of the picture.
    points : sequence of Point or str
        Further points to draw.
    reactions : bool
        Whether to draw the forces of joints as lines from their points, the largest a third of the picture long.
        Their components must be among the outputs of the model.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    OptionError
        For points that are not known, options that are not positive, shapes of bodies that do not exist, reactions
        that are no outputs, and scenes that have no positions.
    """
    try:
        from .animation import animated
    except ImportError:
        raise MissingExtraError('matplotlib is needed; install it with: pip install "dalembert[plot]"') from None
    if self._pictured is None:
        raise OptionError("this motion has no scene; use one that simulate returned")
    scene, constants = self._pictured
    return animated(
        self, scene, constants, points, option("fps", fps), option("speed", speed), flag("reactions", reactions)
    )
