"""Step size control of all loops: limits, acceptance, growth, retries, and the status after a step.

Generated Runge-Kutta attempts compute acceptance and growth themselves (`dalembert.transforms.runge_kutta`), and
`dalembert.jax.runs` mirrors what it needs; both take the constants of `dalembert.methods.step_constants`.
"""

from __future__ import annotations

import math

from ..methods.status import RUNNING, Status
from ..methods.step_constants import (
    INTEGRAL,
    LARGEST_GROWTH,
    LARGEST_REDUCTION,
    PROPORTIONAL,
    REDUCTION_BLIND,
    SAFETY,
    SMALLEST_OF_REST,
    SMALLEST_OF_TIME,
    STRETCH,
)
from ..subset.compiled_subset import compiled_subset, exp, log

ACCEPTED, REJECTED = int(Status.SUCCESS), -2
"""Outcomes of a step; any other is the status of a run that cannot continue."""


@compiled_subset
def smallest_step(t: float, rest: float) -> float:
    """Return the size below which a step does not advance the time; ``rest`` is the time that is left."""
    return SMALLEST_OF_TIME * abs(t) + SMALLEST_OF_REST * rest


@compiled_subset
def largest_step(t: float, t1: float, max_step: float) -> float:
    """Return the largest size of a step from a time: to the end, or as large as allowed."""
    return min(max_step, abs(t1 - t))


@compiled_subset
def next_step(proposed: float, t: float, t1: float, max_step: float) -> tuple[float, float]:
    """Return the size of the next step within its limits, and the size that stays proposed.

    A step that nearly reaches the end is stretched to it, and one that goes beyond is cut. As in generated attempts,
    the least size is the share of the time alone: a run from time 0 may begin with any size.
    """
    rest = abs(t1 - t)
    size = min(max(proposed, SMALLEST_OF_TIME * abs(t)), max_step)
    return rest if size * STRETCH >= rest else size, size


@compiled_subset
def end_of_step(t: float, t1: float, direction: float, size: float, rest: float) -> float:
    """Return the time at which a step ends: exactly the end where it takes all that is left."""
    return t1 if size == rest else t + direction * size


@compiled_subset
def error_scale(rtol: float, atol: float, size: float) -> float:
    """Return the error that is allowed in a component of some size."""
    return atol + rtol * size


@compiled_subset
def error_test(error: float) -> int:
    """Return the outcome of a step from its error norm over the tolerances: accepted, or why it must be repeated."""
    if not math.isfinite(error):
        return Status.NON_FINITE
    return ACCEPTED if error <= 1.0 else Status.STEP_TOO_SMALL


@compiled_subset
def attempt_test(size: float, broken: bool, proposed: float, retries: bool, t: float, rest: float) -> int:
    """Return the outcome of a step of a generated kernel: accepted, rejected, or the status of a failed run.

    Parameters
    ----------
    size : float
        Size of the step; an attempt that rejected itself made one of size 0.
    broken : bool
        Whether the step left the finite numbers.
    proposed : float
        Size of the next attempt.
    retries : bool
        Whether steps are attempts, which may be rejected; a Taylor step chooses its size and is final.
    t, rest : float
        Time at the beginning of the step, and what was left of the span.
    """
    smallest = smallest_step(t, rest)
    if retries:
        if size != 0.0:
            return ACCEPTED
        if proposed >= smallest:
            return REJECTED
    elif not broken and not (size < rest and size < smallest):
        return ACCEPTED
    return Status.NON_FINITE if broken else Status.STEP_TOO_SMALL


@compiled_subset
def blind_retry(size: float, t: float, rest: float) -> float:
    """Return the size of another attempt after a failed projection, 0 where none is possible."""
    smaller = REDUCTION_BLIND * size
    return smaller if smaller >= smallest_step(t, rest) else 0.0


@compiled_subset
def status_after(ended: bool, attempts: float, most: float) -> int:
    """Return the status after an attempt: the run has reached its end, used up its attempts, or continues."""
    if ended:
        return Status.SUCCESS
    return Status.MAX_STEPS if attempts >= most else RUNNING


@compiled_subset
def growth_limit(retried: bool) -> float:
    """Return the largest factor to the next step: a step that had to be repeated must not grow."""
    return 1.0 if retried else LARGEST_GROWTH


@compiled_subset
def growth(error: float, previous: float, retried: bool, exponent: float) -> float:
    """Return the factor for the step after an accepted one; ``exponent`` is 1/(order of the error estimate + 1).

    ``previous`` is the error norm of the accepted step before.
    """
    largest = growth_limit(retried)
    if error == 0.0:
        return largest
    beta = INTEGRAL * exponent
    alpha = exponent - PROPORTIONAL * beta
    factor = SAFETY * exp(beta * log(previous) - alpha * log(error))
    return min(largest, max(LARGEST_REDUCTION, factor))


@compiled_subset
def reduction(failure: int, error: float, exponent: float) -> float:
    """Return the factor for another attempt after a failure; only an error that is too large gives one."""
    if failure == Status.STEP_TOO_SMALL:
        return max(LARGEST_REDUCTION, SAFETY * exp(-exponent * log(error)))
    return REDUCTION_BLIND
