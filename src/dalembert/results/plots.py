"""Plots of trajectories."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..errors import MissingExtraError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .motion import Motion

__all__ = ["plot"]

_POINTS_PER_STEP = 20


def plot(trajectory: Motion, names: Sequence[str]) -> Figure:
    """Return a figure with one panel a name, drawn smoothly between the recorded times where that is possible."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError('matplotlib is needed; install it with: pip install "dalembert[plot]"') from None
    smooth = trajectory
    if trajectory.can_evaluate and len(trajectory.t) > 1:
        count = min(20_000, _POINTS_PER_STEP * len(trajectory.t))
        smooth = trajectory(np.linspace(trajectory.t[0], trajectory.t[-1], count))
    figure = Figure(figsize=(7.0, 1.2 + 1.4 * len(names)), layout="constrained")
    panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for panel, name in zip(panels, names, strict=True):
        panel.plot(smooth.t, smooth[name], linewidth=1.4)
        panel.plot(trajectory.t, trajectory[name], ".", markersize=3)
        panel.set_ylabel(name)
        panel.grid(alpha=0.3)
    panels[-1].set_xlabel("t [s]")
    return figure
