"""Decay rates of constraint violations, which follow the direction of time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ..arrays import FloatArray

__all__ = ["DECAY_RATE", "FIXED_GAINS", "along_run", "decay_rate_among", "directed_rates"]

DECAY_RATE = "baumgarte_alpha"
"""Parameter of the formulation `baumgarte` whose sign decides whether violations decay or grow."""

FIXED_GAINS = ("fixed baumgarte_alpha", "fixed baumgarte_beta")
"""Parameters of gains that are given with the formulation. Users do not give them; runs set the sign of the first."""


def decay_rate_among(names: Iterable[str]) -> str | None:
    """Return the parameter that is a decay rate of violations, None where there is none."""
    return next((name for name in names if name in (DECAY_RATE, FIXED_GAINS[0])), None)


def directed_rates(rates: Any, backward: Any, xp: Any = np) -> Any:
    """Return decay rates (k,) with which violations decay: -|rate| in runs `backward` (k,) in time.

    `xp` is the namespace of the arrays: numpy, or jax.numpy.
    """
    return xp.where(backward, -xp.abs(rates), rates)


def along_run(names: Sequence[str], p: FloatArray, *, backward: bool) -> FloatArray:
    """Return parameters p (n_p,) with which violations decay in a run backward in time, too."""
    rate = decay_rate_among(names)
    if not backward or rate is None:
        return p
    place, p = names.index(rate), p.copy()
    p[place] = directed_rates(p[place], backward)
    return p
