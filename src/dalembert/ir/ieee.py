"""Functions of ``math`` with results of IEEE 754: NaN or infinity where Python raises.

Generated Python that is not compiled imports this module under the name ``math``, so that a branch not
taken, such as log(a) beside a < 0, does no harm. What it reads of tables stands here too.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from .calls import call as call
from .tables import entry as entry
from .tables import piece as piece

Function = Callable[[float], float]


def _guarded(function: Function, overflow: float = math.nan) -> Function:
    def guarded(a: float) -> float:
        try:
            return function(a)
        except ValueError:
            return math.nan
        except OverflowError:
            return math.copysign(overflow, a) if function is math.sinh else overflow

    guarded.__name__ = function.__name__
    return guarded


sqrt = _guarded(math.sqrt)
sin, cos, tan = _guarded(math.sin), _guarded(math.cos), _guarded(math.tan)
asin, acos, atan = _guarded(math.asin), _guarded(math.acos), _guarded(math.atan)
exp, sinh, cosh = (_guarded(f, math.inf) for f in (math.exp, math.sinh, math.cosh))
tanh = _guarded(math.tanh)
atan2 = math.atan2


def log(a: float) -> float:
    """Return the natural logarithm; minus infinity at zero, NaN below."""
    return math.log(a) if a > 0.0 else -math.inf if a == 0.0 else math.nan


def floor(a: float) -> float:
    """Return the largest whole number not above a."""
    return float(math.floor(a)) if math.isfinite(a) else a


def divide(a: float, b: float) -> float:
    """Return a / b; infinity or NaN where b is zero."""
    if b != 0.0:
        return a / b
    return math.nan if a == 0.0 or a != a else math.copysign(math.inf, a) * math.copysign(1.0, b)


def pow(a: float, b: float) -> float:
    """Return a to the power b; NaN for a fractional power of a negative number, infinity on overflow."""
    try:
        return math.pow(a, b)
    except ValueError:
        return math.inf if a == 0.0 else math.nan
    except OverflowError:
        return math.inf
