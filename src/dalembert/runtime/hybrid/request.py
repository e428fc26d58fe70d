"""Requests of a motion with contacts, and of a sweep of such motions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...integrators.event_code import Event
from ...ir.program import Layout
from ...options import SimulateOptions, SweepOptions
from .event_jumps import EventJumps
from .reductions import PhaseReductions

__all__ = ["MotionRequest", "SweepRequest"]


@final
@dataclass(frozen=True, eq=False)
class MotionRequest:
    """Request of one motion.

    Attributes
    ----------
    t0, t1 : float
        Span [s].
    x : ndarray (2 n_q,)
        Consistent coordinates and rates to start from.
    parameters : dict of str to float
        Of the scene.
    c : ndarray (n_p,)
        The same in the order of the scene.
    options : SimulateOptions
        As `simulate` was given them.
    events : tuple of Event
    jumps : EventJumps
        Of the events that map the state.
    layout : Layout
        Of the scene, with the requested outputs.
    """

    t0: float
    t1: float
    x: FloatArray
    parameters: dict[str, float]
    c: FloatArray
    options: SimulateOptions
    events: tuple[Event, ...]
    jumps: EventJumps
    layout: Layout


@final
@dataclass(frozen=True, eq=False)
class SweepRequest:
    """Request of a sweep.

    Attributes
    ----------
    t, t1 : ndarray (k,)
        Spans [s].
    x : ndarray (k, 2 n_q)
        Consistent coordinates and rates to start from.
    p : ndarray (k, n_p)
        Parameters in the order of the scene.
    status : ndarray (k,) of int
        Of cases that cannot start; -1 for the others.
    t_eval : ndarray or None
    reductions : PhaseReductions
        With the events that users watch.
    jumps : EventJumps or None
        Of the events that map the state; None where there are none.
    options : SweepOptions
        Method, tolerances, limits and progress.
    threads : int
    layout : Layout
        Of the scene.
    varied, axes
        What was varied, for the results.
    """

    t: FloatArray
    t1: FloatArray
    x: FloatArray
    p: FloatArray
    status: NDArray[np.int64]
    t_eval: FloatArray | None
    reductions: PhaseReductions
    jumps: EventJumps | None
    options: SweepOptions
    threads: int
    layout: Layout
    varied: tuple[dict[str, FloatArray], dict[str, FloatArray]]
    axes: Mapping[str, FloatArray]
