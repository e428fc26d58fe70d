"""Request of a sweep of motions with contacts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...ir.program import Layout
from ...options import SweepOptions
from .event_jumps import EventJumps
from .reductions import PhaseReductions

__all__ = ["SweepRequest"]


@final
@dataclass(frozen=True, eq=False)
class SweepRequest:
    """What a sweep is asked for.

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
