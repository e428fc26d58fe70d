"""Step size control, with the constants of `dalembert.methods.step_constants`."""

from __future__ import annotations

from ..methods.status import Status
from ..methods.step_constants import (
    INTEGRAL,
    LARGEST_GROWTH,
    LARGEST_REDUCTION,
    PROPORTIONAL,
    REDUCTION_BLIND,
    SAFETY,
)
from .compiled_subset import compiled_subset, exp, log

__all__ = ["growth", "reduction", "smallest_step"]

_EPSILON = 2.220446049250313e-16
_TOO_SMALL = int(Status.STEP_TOO_SMALL)


@compiled_subset
def growth(error: float, previous: float, retried: bool, exponent: float) -> float:
    """Factor for the step after an accepted one; ``exponent`` is 1/(order of the error estimate + 1).

    ``previous`` is the error norm of the accepted step before; a step that had to be retried must not grow.
    """
    largest = 1.0 if retried else LARGEST_GROWTH
    if error == 0.0:
        return largest
    beta = INTEGRAL * exponent
    alpha = exponent - PROPORTIONAL * beta
    factor = SAFETY * exp(beta * log(previous) - alpha * log(error))
    return min(largest, max(LARGEST_REDUCTION, factor))


@compiled_subset
def reduction(failure: int, error: float, exponent: float) -> float:
    """Factor for another attempt after a failed one; only an error that is too large says how far to go."""
    if failure == _TOO_SMALL:
        return max(LARGEST_REDUCTION, SAFETY * exp(-exponent * log(error)))
    return REDUCTION_BLIND


@compiled_subset
def smallest_step(t: float, span: float) -> float:
    """Step size below which time no longer advances reliably."""
    return 16.0 * _EPSILON * max(abs(t), _EPSILON * span)
