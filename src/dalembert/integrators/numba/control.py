"""Step size control.

Source: K. Gustafsson, ACM Transactions on Mathematical Software 17 (1991) 533-554; Hairer and Wanner, Solving
Ordinary Differential Equations II, section IV.2, for the exponents.
"""

import math

from dalembert.integrators.numba.jit import compiled
from dalembert.integrators.status import Status

SAFETY = 0.9
LARGEST_REDUCTION = 0.2
LARGEST_GROWTH = 8.0
REDUCTION_BLIND = 0.1
SMALLEST_PREVIOUS = 1e-4
_INTEGRAL = 0.2
_PROPORTIONAL = 0.75
_EPSILON = 2.220446049250313e-16
_TOO_SMALL = int(Status.STEP_TOO_SMALL)


@compiled
def growth(error: float, previous: float, retried: bool, exponent: float) -> float:
    """Factor for the step after an accepted one; ``exponent`` is 1/(order of the error estimate + 1).

    ``previous`` is the error norm of the accepted step before; a step that had to be retried must not grow.
    """
    largest = 1.0 if retried else LARGEST_GROWTH
    if error == 0.0:
        return largest
    beta = _INTEGRAL * exponent
    alpha = exponent - _PROPORTIONAL * beta
    factor = SAFETY * math.exp(beta * math.log(previous) - alpha * math.log(error))
    return min(largest, max(LARGEST_REDUCTION, factor))


@compiled
def reduction(failure: int, error: float, exponent: float) -> float:
    """Factor for another attempt after a failed one; only an error that is too large says how far to go."""
    if failure == _TOO_SMALL:
        return max(LARGEST_REDUCTION, SAFETY * error**-exponent)
    return REDUCTION_BLIND


@compiled
def smallest_step(t: float, span: float) -> float:
    """Step size below which time no longer advances reliably."""
    return 16.0 * _EPSILON * max(abs(t), _EPSILON * span)
