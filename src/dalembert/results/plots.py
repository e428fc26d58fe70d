"""Plots of trajectories."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import MissingExtraError, OptionError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .motion import Motion

__all__ = ["plot"]

_POINTS_PER_STEP = 20


def plot(trajectory: Motion, names: Sequence[str], ax: Any = None) -> Figure:
    """Return a figure with one panel a name, drawn smoothly between the recorded times where that is possible."""
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        raise MissingExtraError('matplotlib is needed; install it with: pip install "dalembert[plot]"') from None
    smooth = trajectory
    if trajectory.can_evaluate and len(trajectory.t) > 1:
        count = min(20_000, _POINTS_PER_STEP * len(trajectory.t))
        smooth = trajectory(np.linspace(trajectory.t[0], trajectory.t[-1], count))
    columns = [(smooth[name], trajectory[name]) for name in names]  # unknown names are refused before a figure is made
    panels = list(np.ravel(ax)) if ax is not None else []
    if ax is None:
        figure = plt.figure(figsize=(7.0, 1.2 + 1.4 * len(names)), layout="constrained")
        panels = list(figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0])
    shared = ax is not None and len(panels) == 1
    if shared:
        panels = panels * len(names)
    if not all(hasattr(panel, "plot") for panel in panels):
        raise OptionError(f"ax must be Axes of matplotlib, not {ax!r}")
    if len(panels) != len(names):
        raise OptionError(f"ax must be one Axes, or one for each of the {len(names)} names, not {len(panels)}")
    for panel, name, (between, recorded) in zip(panels, names, columns, strict=True):
        (line,) = panel.plot(smooth.t, between, linewidth=1.4, label=name)
        panel.plot(trajectory.t, recorded, ".", markersize=3, color=line.get_color() if shared else None)
        if not shared:
            panel.set_ylabel(name)
        panel.grid(alpha=0.3)
    if shared and len(names) > 1:
        panels[0].legend()
    elif shared:
        panels[0].set_ylabel(names[0])
    panels[-1].set_xlabel("t [s]")
    drawn: Figure = panels[0].figure
    return drawn
