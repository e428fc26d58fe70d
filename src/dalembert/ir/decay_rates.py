"""Decay rates of constraint violations, which follow the direction of time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import FloatArray

__all__ = ["DECAY_RATE", "along_run", "directed_rates"]

DECAY_RATE = "baumgarte_alpha"
"""Parameter of the formulation `baumgarte` whose sign decides whether violations decay or grow."""


def directed_rates(rates: Any, backward: Any, xp: Any = np) -> Any:
    """Return decay rates (k,) with which violations decay: -|rate| in runs `backward` (k,) in time.

    `xp` is the namespace of the arrays: numpy, or jax.numpy.
    """
    return xp.where(backward, -xp.abs(rates), rates)


def along_run(names: Sequence[str], p: FloatArray, *, backward: bool) -> FloatArray:
    """Return parameters p (n_p,) with which violations decay in a run backward in time, too."""
    if not backward or DECAY_RATE not in names:
        return p
    place, p = names.index(DECAY_RATE), p.copy()
    p[place] = directed_rates(p[place], backward)
    return p
