"""Continuous output of a run that SciPy stepped."""

from collections.abc import Callable, Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from dalembert.integrators.dense_output import DenseOutput

from ...arrays import FloatArray


@final
class StepInterpolants(DenseOutput):
    """SciPy's interpolant of every step, plus what a projection moved the end of the step by.

    Parameters
    ----------
    knots
        Ends of the steps (n_steps + 1,).
    interpolants
        One function of times (k,) per step, giving (n_y, k).
    corrections
        Corrections of the end of each step (n_steps, n_y); each enters as ``3*theta**2 - 2*theta**3`` times
        it.
    """

    def __init__(
        self,
        knots: FloatArray,
        interpolants: Sequence[Callable[[FloatArray], FloatArray]],
        corrections: FloatArray,
    ) -> None:
        super().__init__(knots)
        self.interpolants = tuple(interpolants)
        self.corrections = corrections

    def _evaluate(self, step: NDArray[np.intp], theta: FloatArray) -> FloatArray:
        ramp = (theta**2 * (3.0 - 2.0 * theta))[:, np.newaxis]
        values = ramp * self.corrections[step]
        times = self.knots[step] + theta * (self.knots[step + 1] - self.knots[step])
        for number in np.unique(step):
            chosen = step == number
            values[chosen] += self.interpolants[number](times[chosen]).T
        return values
