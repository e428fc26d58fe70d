"""SciPy's DOP853 with an error norm for estimates whose squares underflow."""

from typing import Any, final

import numpy as np
from scipy.integrate import DOP853

from ...arrays import FloatArray

__all__ = ["GuardedDOP853"]

_NO_SQUARE = 1e-150
"""Size of numbers whose squares underflow, and vanish beside any tolerance."""


@final
class GuardedDOP853(DOP853):
    """SciPy's DOP853; an estimate whose square underflows is no error, where SciPy may divide 0 by 0 and give up."""

    def _estimate_error_norm(self, K: FloatArray, h: float, scale: FloatArray) -> Any:
        if np.max(np.abs(np.dot(K.T, self.E5) / scale), initial=0.0) < _NO_SQUARE:
            return 0.0
        return super()._estimate_error_norm(K, h, scale)  # type: ignore[misc]  # the stubs leave it out
