"""Gains of the formulation `baumgarte` that nobody gave: from the steps that a run would take without them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..codegen.base import FloatArray
from ..integrators.problem import IntegrationProblem, Solution

__all__ = ["gain_for"]

_PILOT_STEPS = 24
_SHARE = 0.5
"""Product of gain and step: violations decay by two thirds over two steps, far within the stability of any method."""


def gain_for(problem: IntegrationProblem, start: FloatArray, run: Callable[[IntegrationProblem], Solution]) -> float:
    """Return the gain [1/s] for both positions and velocities, or 0 where there is no step to go by.

    Parameters
    ----------
    problem : IntegrationProblem
        The run, whose constants are taken to be `start` (n_c,), those without any gain.
    run : callable
        Integrates a problem.
    """
    pilot = run(replace(problem, constants=start, t_eval=None, dense=False, max_steps=_PILOT_STEPS))
    sizes = np.abs(np.diff(pilot.t))
    return _SHARE / float(np.max(sizes)) if len(sizes) else 0.0
