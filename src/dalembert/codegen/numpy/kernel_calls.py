"""SciPy's solvers beside their steps: calls of kernels, projection, the error norm, and continuous output."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from ...arrays import FloatArray
from ...methods.step_constants import LINEAR_CORRECTIONS, MOST_CORRECTIONS
from ...steps.dense_output import DenseOutput
from ...steps.problem import Kernel, Kernels
from ...steps.projection import FAILED, PENDING, add_correction, correction_test


class NonFiniteError(Exception):
    """The right-hand side gave NaN or infinity to a solver that cannot take it."""


@final
class KernelCalls:
    """The kernels of one run at its constants.

    Parameters
    ----------
    kernels : Kernels
    constants : ndarray (n_c,)
    tolerances : (float, float)
        Of the steps: rtol, atol.
    """

    def __init__(self, kernels: Kernels, constants: FloatArray, tolerances: tuple[float, float]) -> None:
        self._kernels, self._constants, self._tolerances = kernels, constants, tolerances
        self._count, self._last_non_finite = 0, -100

    @property
    def since_non_finite(self) -> int:
        """Number of calls of the right-hand side since the last one that was not finite."""
        return self._count - self._last_non_finite

    def project(self, t: float, y: FloatArray, before: FloatArray) -> FloatArray | None:
        """Project a state as the compiled integrators do, `before` at the start of the step; None if that fails."""
        projected, kernels, (rtol, atol) = y.copy(), self._kernels, self._tolerances
        for kernel, tries in (
            (kernels.project_position, MOST_CORRECTIONS),
            (kernels.project_velocity, LINEAR_CORRECTIONS),
        ):
            if kernel is None:
                continue
            for attempt in range(tries):
                delta = self.call(kernel, t, projected)
                columns = projected.reshape(-1, 1), 0, before.reshape(-1, 1), 0, delta.reshape(-1, 1), 0
                outcome = correction_test(attempt, tries, *add_correction(*columns, atol), rtol, atol)
                if outcome == FAILED:
                    return None
                if outcome != PENDING:
                    break
        return projected

    def call(self, kernel: Kernel, t: float, y: FloatArray) -> FloatArray:
        """Return the outputs (n,) of a kernel."""
        out = np.zeros(len(y))
        kernel(t, y, self._constants, out)
        return out

    def rhs(self, t: float, y: FloatArray) -> FloatArray:
        """Return the right-hand side, NaN where Python raises an arithmetic error."""
        self._count += 1
        try:
            slope = self.call(self._kernels.rhs, t, y)
        except (ArithmeticError, ValueError):
            slope = np.full(len(y), np.nan)
        if not np.all(np.isfinite(slope)):
            self._last_non_finite = self._count
        return slope

    def finite_rhs(self, t: float, y: FloatArray) -> FloatArray:
        """Return the right-hand side; `NonFiniteError` where it is not finite."""
        slope = self.rhs(t, y)
        if self._last_non_finite == self._count:
            raise NonFiniteError
        return slope

    def jacobian(self, t: float, y: FloatArray) -> FloatArray:
        """Return the Jacobian (n, n) of the right-hand side; `NonFiniteError` where it is not finite."""
        out = np.zeros(len(y) ** 2)
        assert self._kernels.jacobian is not None
        try:
            self._kernels.jacobian(t, y, self._constants, out)
        except (ArithmeticError, ValueError):
            raise NonFiniteError from None
        if not np.all(np.isfinite(out)):
            raise NonFiniteError
        return out.reshape(len(y), len(y))


# SciPy's DOP853 with an error norm for estimates whose squares underflow.

_NO_SQUARE = 1e-150
"""Size of numbers whose squares underflow, and vanish beside any tolerance."""


@final
class GuardedDOP853(DOP853):
    """SciPy's DOP853; an estimate whose square underflows is no error, where SciPy may divide 0 by 0 and give up."""

    def _estimate_error_norm(self, K: FloatArray, h: float, scale: FloatArray) -> Any:
        if np.max(np.abs(np.dot(K.T, self.E5) / scale), initial=0.0) < _NO_SQUARE:
            return 0.0
        return super()._estimate_error_norm(K, h, scale)  # type: ignore[misc]  # the stubs leave it out


# Continuous output of a run that SciPy stepped.


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
