"""Choice of a method: the cheaper explicit one, Taylor series or DOP853, or an implicit one where a run is stiff.

A Taylor step costs about order^2/2 multiply-adds for every product of varying factors, a Runge-Kutta step twelve
evaluations; the one wins where the right-hand side is short or the tolerance tight, the other where it is long.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..arrays import FloatArray
from ..ir.kernel import Kernel
from ..methods.status import Status
from .problem import IntegrationProblem, Solution

_STEPS, _DIGITS = 1.0, 0.13
"""Steps of DOP853 for one Taylor step at rtol 1e-6, and the power of 1/rtol with which they grow."""

_SHORT, _LONG = 1000, 3000
"""Lines up to which a Taylor step is straight-line code, and from which on it outgrows the nearest cache."""

_MARGIN = 0.8
"""Predicted ratio of times up to which the Runge-Kutta pair is taken: near 1 the prediction is a guess."""

_CONTROL = 1.4
"""Lines of a Taylor step that a line of its residual control counts as (measured on one to six pendulums)."""

_CALLS = {"exp": 30, "log": 35, "tan": 50, "atan2": 75, "pow": 90, "cosh": 45} | dict.fromkeys(
    ("asin", "acos", "atan", "sinh", "tanh"), 60
)
"""Lines that a function counts as: its operations in lanes, of which a division counts as several."""

_TIGHTEST = 3e-13
"""Below, rounding matters, which Taylor steps keep smaller."""


def runge_kutta_pays(rhs: Kernel, series_lines: int, control: tuple[int, int], tolerance: float) -> bool:
    """Return whether DOP853 is expected to be clearly faster than Taylor steps.

    Parameters
    ----------
    rhs : Kernel
        The right-hand side.
    series_lines : int
        Lines of the recurrences of a Taylor step, unrolled.
    control : (int, int)
        Evaluations and other lines of its residual control; 0 where there is none.
    tolerance : float
        Relative tolerance.

    Notes
    -----
    Costs are in lines of Taylor steps, fitted to runs and sweeps of the hard cases for tolerances from 1e-4 to 1e-12 at
    equal error: the pair needs some 57 lines a component and 340 in all besides its evaluations, a sine with its cosine
    counts as 12, and lines of a Taylor step count by how long it is. ``benchmarks/choice.py`` measures what it misses.
    """
    if tolerance < _TIGHTEST:
        return False
    pairs = sum(line.op in ("sin", "cos") for line in rhs.body) / 2
    beyond = max(series_lines - _LONG, 0)
    taylor = 280 + 1.1 * min(series_lines, _SHORT) + 0.8 * max(series_lines - beyond - _SHORT, 0) + 1.5 * beyond
    evaluation = len(rhs.body) + 12 * pairs + sum(_CALLS.get(line.op, 0) for line in rhs.body)
    taylor += _CONTROL * (control[0] * evaluation + control[1])
    attempt = 12 * evaluation + 57 * len(rhs.outputs) + 340
    steps = _STEPS * math.exp(-_DIGITS * math.log(1e6 * tolerance))
    return steps * attempt < _MARGIN * taylor


# Stiffness tests: explicit steps held small by modes that have died out, where implicit steps would not be.
#
# Three questions, each asked only where the one before was answered by yes. Does the Jacobian have an eigenvalue that
# is damped rather than oscillating, and whose time scale is far below the span? Are the explicit method's steps of the
# size of that time scale (its limit of stability; Hairer and Wanner, Solving Ordinary Differential Equations II,
# section IV.2)? Do a few steps of the implicit method get so much further that their price is paid?

Rates = Callable[[FloatArray, FloatArray], FloatArray]
"""Right-hand sides (k, n_y) at times (k,) and states (k, n_y)."""

TIME_SCALES = 2000.0
"""Decay times that must be left, so that an explicit method would need some thousand steps."""

_STABLE = 0.3
"""Least product of an explicit step and a decay rate that speaks for stability, not accuracy, setting the step."""

_PILOT_STEPS = 60
_GAIN = 10.0
"""Least number of explicit steps that one implicit step must replace: it costs some five of them in small scenes."""

EXPLICIT_STEPS = 300
"""Explicit steps within which a run that ends is not stiff."""


def _differences(rates: Rates, t: float, y: FloatArray, directions: FloatArray) -> FloatArray:
    """Return derivatives of the right-hand side along unit directions (k, n), by central differences."""
    size = 6e-6 * max(1.0, float(np.max(np.abs(y), initial=0.0)))
    points = np.concatenate([y + size * directions, y - size * directions])
    values = rates(np.full(len(points), t), points)
    return (values[: len(directions)] - values[len(directions) :]) / (2.0 * size)


def damped_rate(rates: Rates, t: float, y: FloatArray, least: float = 0.0) -> float:
    """Return the largest decay rate [1/s] among the modes that decay faster than they oscillate, 0 without one.

    Where all are certainly below a `least` one, return 0, too: no eigenvalue exceeds the largest sum of a row.
    """
    jacobian = _differences(rates, t, y, np.eye(len(y))).T
    if not np.abs(jacobian).sum(axis=1).max() >= least or not np.all(np.isfinite(jacobian)):
        return 0.0
    modes = np.linalg.eigvals(jacobian)
    damped = -modes.real[-modes.real >= np.abs(modes.imag)]
    return float(np.max(damped, initial=0.0))


def still_stiff(rates: Rates, t: float, y: FloatArray, rest: float, step: float) -> float:
    """Return the decay rate that explicit steps of size `step` are held up by, 0 where that is not so."""
    rate = damped_rate(rates, t, y)
    return rate if rate * rest >= TIME_SCALES and rate * step >= _STABLE else 0.0


def radau_pays(
    problem: IntegrationProblem,
    t: float,
    y: FloatArray,
    step: float,
    rate: float,
    radau: Callable[[IntegrationProblem], Solution],
    operations: int,
) -> str:
    """Return why the implicit method should take over from explicit steps of size `step`, or nothing.

    A short run of it from the present state decides: a step of it must get farther than an explicit one by twice the
    ratio of their costs. A right-hand side is that many `operations`.
    """
    n = len(y)
    # in units of one operation, as measured on damped pendulums with up to 56 components
    implicit, explicit = n**3 / 6 + 5 * n * n + 15 * operations, 12 * (operations + 20 * n)
    gain = max(_GAIN, 2.0 * implicit / explicit)
    pilot = radau(replace(problem, t0=t, y0=y, t_eval=None, first_step=None, dense=False, max_steps=_PILOT_STEPS))
    if len(pilot.t) < 2:
        return ""
    tail = max(1, len(pilot.t) // 2)  # the first steps only find their size
    reached = abs(float(pilot.t[-1] - pilot.t[-1 - tail])) / tail
    if reached < gain * step:
        return ""
    return (
        f"stiff: modes decay at {rate:.2g} 1/s and hold explicit steps at {step:.2g} s, where a pilot of radau takes"
        f" {reached:.2g} s"
    )


def fitting(
    problem: IntegrationProblem,
    method: str,
    rates: Rates,
    run: Callable[[IntegrationProblem, str], Solution],
    operations: int,
) -> tuple[str, str]:
    """Return the method for a problem, from its start and a short run: "radau" and why, or `method`."""
    span = abs(problem.t1 - problem.t0)
    least = TIME_SCALES / span if span else math.inf
    if method == "radau" or damped_rate(rates, problem.t0, problem.y0, least) < least:
        return method, ""
    trial = run(replace(problem, t_eval=None, dense=False, max_steps=min(problem.max_steps, EXPLICIT_STEPS)), method)
    if trial.status is not Status.MAX_STEPS or len(trial.t) < 2:
        return method, ""
    tail = max(1, len(trial.t) // 4)
    t, y = float(trial.t[-1]), trial.y[-1]
    step = abs(t - float(trial.t[-1 - tail])) / tail
    rate = still_stiff(rates, t, y, abs(problem.t1 - t), step)
    why = radau_pays(problem, t, y, step, rate, lambda pilot: run(pilot, "radau"), operations) if rate else ""
    return ("radau", why) if why else (method, "")
