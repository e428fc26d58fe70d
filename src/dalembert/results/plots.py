"""Methods of trajectories and sweeps that draw them: `plot` and `animate`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import MissingExtraError, OptionError, list_names, nesting_named
from ..values import flag, option

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .animation import Animation
    from .sweep import Sweep
    from .trajectory import Trajectory

_POINTS_PER_STEP = 20
_MOST_CURVES, _MOST_LABELS = 20, 10


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
    plt = _pyplot()
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
    panels, shared = _panels(plt, ax, names, timed)
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


def _pyplot() -> Any:
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        raise MissingExtraError('matplotlib is needed; install it with: pip install "dalembert[plot]"') from None
    return plt


def _panels(plt: Any, ax: Any, names: Sequence[str], sharex: bool) -> tuple[list[Any], bool]:
    """Return one Axes for each name, of a new figure where none are given, and whether they are one given Axes."""
    panels = list(np.ravel(ax)) if ax is not None else []
    if ax is None:
        figure = plt.figure(figsize=(7.0, 1.2 + 1.4 * len(names)), layout="constrained")
        panels = list(figure.subplots(len(names), 1, sharex=sharex, squeeze=False)[:, 0])
    shared = ax is not None and len(panels) == 1
    if shared:
        panels = panels * len(names)
    if not all(hasattr(panel, "plot") for panel in panels):
        raise OptionError(f"ax must be Axes of matplotlib, not {ax!r}")
    if len(panels) != len(names):
        raise OptionError(f"ax must be one Axes, or one for each of the {len(names)} names, not {len(panels)}")
    return panels, shared


def _pair(given: Any) -> tuple[str, str]:
    """Return the names on the two axes of a panel, nothing for the time."""
    if not isinstance(given, tuple | list):
        return "", str(given)
    if len(given) != 2:
        raise OptionError(f'plot draws names, and pairs of them such as ("x", "x_dot"), not {given!r}')
    return str(given[0]), str(given[1])


@nesting_named
def plot_cases(self: Sweep, *given: Any, over: Any = None, cases: Any = None, ax: Any = None) -> Figure:
    """Draw results of the cases, a panel for each name; return the figure, which is one of pyplot.

    Where the sweep has ``t_eval``, each case is a curve over time. Otherwise final values and reductions are drawn over
    the parameter or initial value that varies: over an axis of a product grid as one curve for each combination of the
    other axes, as points where others vary beside it. Cases that failed have no final values. Of more than 20 curves,
    20 are drawn, evenly spaced from the first to the last.

    Parameters
    ----------
    *given : str or symbol
        Coordinates, rates, states, outputs and, unless over time, reductions. By default all reductions, or coordinates
        where there are none or where curves are over time.
    over : str or symbol, optional
        Parameter or initial value that varies. Needed where several do, and for final values in spite of ``t_eval``.
    cases : slice, or sequence of int or bool, optional
        Which cases to draw, such as ``[0, 5]`` or ``sweep.success``, and then all curves of them.
    ax : matplotlib.axes.Axes or sequence of Axes, optional
        Where to draw: all names on one, or each on its own.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    UnknownNameError
        For names that the sweep does not have.
    OptionError
        For cases that it does not have, for `over` that does not vary or is missing, and for a wrong number of axes.
    """
    plt, timed = _pyplot(), over is None and self.t_eval is not None
    aliases = self._layout.aliases
    names = [aliases.get(str(name), str(name)) for name in given]
    names = names or list((not timed and self.reduced) or self._layout.coordinates)
    columns = {name: v for name, v in {**self.initial, **self.parameters}.items() if np.shape(v) == (len(self),)}
    varied = {name: v for name, v in columns.items() if np.any(v != v[0])}
    along = "" if timed else _swept(self, varied, over)
    # unknown names are rejected before a figure is made
    values = [self[name] if timed else _case_values(self, name) for name in names]
    curves = _curves(self, along, varied, cases)
    panels, shared = _panels(plt, ax, names, True)
    many, gridded = len(curves) > 1, along in self.axes
    others = [other for other in varied if other != along] if timed or gridded else []
    style = "-" if timed else ".-" if gridded or len(varied) == 1 else "."
    for panel, name, found in zip(panels, names, values, strict=True):
        for i, some in enumerate(curves):
            case = ", ".join(f"{other} = {varied[other][some[0]]:.4g}" for other in others) or f"case {some[0]}"
            label = ", ".join([name] * shared + [case] * many)
            hidden = len(curves) > _MOST_LABELS and 0 < i < len(curves) - 1
            colour = plt.get_cmap("viridis")(i / len(curves)) if many and not shared else None
            x, y = (self.t_eval, found[some[0]]) if timed else (varied[along][some], found[some])
            panel.plot(x, y, style, linewidth=1.2, markersize=3, color=colour, label=f"_{label}" if hidden else label)
        panel.set_ylabel("" if shared and len(names) > 1 else name)
        panel.grid(alpha=0.3)
    if many or (shared and len(names) > 1):
        panels[0].legend(fontsize="small")
    panels[-1].set_xlabel(along or "t [s]")
    drawn: Figure = panels[0].figure
    return drawn


def _swept(sweep: Sweep, varied: Mapping[str, FloatArray], over: Any) -> str:
    """Return the name of the parameter or initial value to draw final values over."""
    if over is None and len(varied) == 1:
        return next(iter(varied))
    name = sweep._layout.aliases.get(str(over), str(over))
    if name in varied:
        return name
    fault = "choose one by over=" if over is None else f"{name!r} does not vary"
    raise OptionError(
        f"final values are drawn over a parameter or initial value that varies; {fault}. Known: {list_names(varied)}"
    )


def _case_values(sweep: Sweep, name: str) -> FloatArray:
    """Return a reduction or final values (n_case,), NaN of cases that failed."""
    return sweep.reduced[name] if name in sweep.reduced else np.where(sweep.success, sweep._final(name), np.nan)


def _curves(sweep: Sweep, along: str, varied: Mapping[str, FloatArray], cases: Any) -> list[NDArray[np.intp]]:
    """Return the numbers of the cases of each curve, in the order in which they are drawn."""
    numbers = np.arange(len(sweep))
    kept = np.ones(len(numbers), bool)
    if cases is not None:
        try:
            kept = np.isin(numbers, numbers[cases if isinstance(cases, slice) else np.asarray(cases)])
        except IndexError:
            raise OptionError(
                f"cases must be a slice, numbers up to {len(numbers) - 1}, or {len(numbers)} booleans, not {cases!r}"
            ) from None
    if not along:
        curves = numbers[:, np.newaxis]
    elif along in sweep.axes:
        shape = tuple(map(len, sweep.axes.values()))
        curves = np.moveaxis(numbers.reshape(shape), list(sweep.axes).index(along), -1).reshape(
            -1, len(sweep.axes[along])
        )
    else:
        curves = np.argsort(varied[along], kind="stable")[np.newaxis]
    found = [some for some in (curve[kept[curve]] for curve in curves) if some.size]
    if cases is None and len(found) > _MOST_CURVES:
        return [found[i] for i in np.linspace(0, len(found) - 1, _MOST_CURVES).astype(int)]
    return found


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
