"""Radau IIA of order 5 in plain NumPy, for systems of index 2: the reference of the compiled loop.

The same method, estimate and tolerances, with nothing done for speed: Newton's systems are solved whole, with a
Jacobian of every step, and the next step follows from the last error alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np

from ...arrays import FloatArray
from ...methods.collocation import ERROR_WEIGHTS, INVERSE_POWERS, METHOD, NODES, REAL
from ...methods.status import Status
from ...methods.step_constants import LARGEST_REDUCTION, SAFETY, STRETCH
from ...steps.dense_output import PiecewisePolynomial
from ...steps.problem import IntegrationProblem, Solution
from ...steps.step_control import smallest_step

Function = Callable[[float, FloatArray], FloatArray]

_INVERSE = np.linalg.inv(METHOD)
_MAX_ITERATIONS = 10


def integrate(rhs: Function, jacobian: Function, problem: IntegrationProblem, multipliers: FloatArray) -> Solution:
    """Integrate E Y' = rhs(t, Y), where Y is the state and then multipliers, which have no rates.

    Parameters
    ----------
    rhs, jacobian : callable
        Give (n,) and (n, n) of time and Y (n,).
    problem : IntegrationProblem
        For the state (n_y,); its constants are those of the functions already.
    multipliers : ndarray (n - n_y,)
        Their initial values.

    Returns
    -------
    Solution
        Of the state alone. Numerical failure is its status.
    """
    with np.errstate(all="ignore"):
        return _ReferenceRun(rhs, jacobian, problem, multipliers).solution()


@final
class _ReferenceRun:
    def __init__(self, rhs: Function, jacobian: Function, problem: IntegrationProblem, multipliers: FloatArray) -> None:
        self.rhs, self.jacobian, self.problem = rhs, jacobian, problem
        self.kept = len(problem.y0)
        self.y = np.concatenate([problem.y0, multipliers])
        self.mass = (np.arange(len(self.y)) < self.kept).astype(float)
        self.t, self.direction = float(problem.t0), 1.0 if problem.t1 >= problem.t0 else -1.0
        self.rejected = self.evaluations = 0
        self.knots, self.states = [self.t], [self.y[: self.kept]]
        self.pieces: list[FloatArray] = []

    def solution(self) -> Solution:
        """Run to the end and return the solution."""
        status = self._run()
        dense = self._dense()
        t, y = np.array(self.knots), np.array(self.states)
        if self.problem.t_eval is not None:
            requested = np.asarray(self.problem.t_eval, dtype=float)
            t = requested[(requested - self.t) * self.direction <= 0.0]
            y = dense(t) if len(t) else np.empty((0, self.kept))
        return Solution(
            status=status,
            t=t,
            y=y,
            steps=len(self.pieces),
            rejected=self.rejected,
            evaluations=self.evaluations,
            dense=dense if self.problem.dense else None,
            end=self.t,
            last=self.y[: self.kept].copy(),
        )

    def _dense(self) -> PiecewisePolynomial:
        if not self.pieces:
            return PiecewisePolynomial(np.full(2, self.knots[0]), self.states[0].reshape(1, 1, -1))
        return PiecewisePolynomial(np.array(self.knots), np.array(self.pieces))

    def _call(self, t: float, y: FloatArray) -> FloatArray:
        self.evaluations += 1
        return self.rhs(t, y)

    def _run(self) -> Status:
        problem, slope = self.problem, self._call(self.t, self.y)
        if not np.all(np.isfinite(slope)):
            return Status.NON_FINITE
        span = abs(problem.t1 - self.t)
        size = problem.first_step or min(1e-4 * span, problem.max_step)
        while self.t != problem.t1:
            if len(self.pieces) + self.rejected >= problem.max_steps:
                return Status.MAX_STEPS
            size = min(size, problem.max_step)
            ends = size * STRETCH >= abs(problem.t1 - self.t)
            h = problem.t1 - self.t if ends else self.direction * size
            matrix = self.jacobian(self.t, self.y)
            z = self._newton(h, matrix) if np.all(np.isfinite(matrix)) else None
            error = np.inf if z is None else self._error(h, matrix, slope, z)
            if z is None or not error <= 1.0:
                self.rejected += 1
                size = abs(h) * (0.25 if not np.isfinite(error) else max(LARGEST_REDUCTION, SAFETY * error**-0.25))
                if size < smallest_step(self.t, abs(problem.t1 - self.t)):
                    return Status.STEP_TOO_SMALL if np.all(np.isfinite(matrix)) else Status.NON_FINITE
                continue
            self._accept(problem.t1 if ends else self.t + h, z)
            slope = self._call(self.t, self.y)
            size = abs(h) * min(5.0, SAFETY * max(error, 1e-8) ** -0.25)
        return Status.SUCCESS

    def _accept(self, t: float, z: FloatArray) -> None:
        coefficients = np.vstack([self.y, INVERSE_POWERS @ z])
        self.pieces.append(coefficients[:, : self.kept])
        self.t, self.y = t, self.y + z[2]
        self.knots.append(t)
        self.states.append(self.y[: self.kept])

    def _scale(self, h: float) -> FloatArray:
        scale = self.problem.absolute_tolerances(len(self.y)) + self.problem.rtol * np.abs(self.y)
        scaled: FloatArray = np.where(self.mass > 0.0, scale, scale / min(1.0, abs(h)))
        return scaled

    def _newton(self, h: float, matrix: FloatArray) -> FloatArray | None:
        """Return the increments (3, n) at the nodes, or None where they are not found."""
        n, scale = len(self.y), self._scale(h)
        tolerance = min(0.03, max(self.problem.rtol, 1e-14) ** 0.5)
        whole = np.kron(_INVERSE, np.diag(self.mass)) / h - np.kron(np.eye(3), matrix)
        z = np.zeros((3, n))
        before = 0.0
        for _ in range(_MAX_ITERATIONS):
            slopes = np.array([self._call(self.t + c * h, self.y + z[i]) for i, c in enumerate(NODES)])
            left = slopes - _INVERSE @ z * self.mass / h
            try:
                change = np.linalg.solve(whole, left.ravel()).reshape(3, n)
            except np.linalg.LinAlgError:
                return None
            z += change
            size = float(np.sqrt(np.mean((change / scale) ** 2)))
            rate = size / before if before > 0.0 else 0.5
            if not rate < 2.0:
                return None
            if size * rate <= 0.1 * tolerance:
                return z
            before = size
        return None

    def _error(self, h: float, matrix: FloatArray, slope: FloatArray, z: FloatArray) -> float:
        shifted = REAL / h * np.diag(self.mass) - matrix
        part = ERROR_WEIGHTS @ z / h * self.mass
        new: FloatArray = self.y + z[2]
        larger = np.maximum(np.abs(self.y), np.abs(new))
        scale = self.problem.absolute_tolerances(len(self.y)) + self.problem.rtol * larger
        try:
            error = np.linalg.solve(shifted, slope + part)
            norm = float(np.sqrt(np.mean((error / scale)[: self.kept] ** 2)))
            if norm > 1.0:  # filtered once more, as stiff components demand
                error = np.linalg.solve(shifted, self._call(self.t, self.y + error) + part)
                norm = float(np.sqrt(np.mean((error / scale)[: self.kept] ** 2)))
        except np.linalg.LinAlgError:
            return np.inf
        return norm
