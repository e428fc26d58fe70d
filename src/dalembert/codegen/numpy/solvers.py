"""Integration by stepping SciPy's solvers, for kernels that are Python functions.

Stepping, instead of one call of ``solve_ivp``, gives statuses instead of exceptions, and the projection of
every accepted step.
"""

from __future__ import annotations

import pkgutil
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np

from ...arrays import FloatArray
from ...errors import OptionError
from ...methods.status import Status
from ...steps.problem import IntegrationProblem, Kernels, Solution
from ...steps.projection import end_differences
from ...threads import check
from .kernel_calls import KernelCalls, NonFiniteError, StepInterpolants
from .methods import METHODS, PROJECTABLE


def integrate(kernels: Kernels, method: str, problem: IntegrationProblem) -> Solution:
    """Integrate a problem with one of SciPy's solvers.

    Parameters
    ----------
    kernels
        Python functions ``(t, y, constants, out)``. Where they raise an ``ArithmeticError``, or a
        ``ValueError`` after the first call (the math module does, outside a function's domain), the result
        counts as NaN.
    method
        One of ``METHODS``; with projection one of ``PROJECTABLE``, since the others continue from past steps.
    problem
        The problem; ``max_steps`` counts accepted steps here.

    Returns
    -------
    Solution
        ``rejected`` is counted for the explicit methods and 0 for the others.

    Raises
    ------
    OptionError
        If the method is unknown or cannot be projected.
    """
    _check(kernels, method)
    with np.errstate(all="ignore"):
        return _SteppedRun(kernels, method, problem).solution()


def step_blocks(kernels: Kernels, method: str, problem: IntegrationProblem) -> Iterator[Solution]:
    """Integrate a problem step by step; each yields what it added, the last the status of the whole."""
    _check(kernels, method)
    run = _SteppedRun(kernels, method, problem)
    y0 = np.array(problem.y0, dtype=np.float64)
    run.begin(y0)
    statuses = run.statuses(y0)
    while True:
        with np.errstate(all="ignore"):
            status = next(statuses, None)
        if status is None:
            return
        yield run.taken(status, y0)


def _check(kernels: Kernels, method: str) -> None:
    if method not in METHODS:
        raise OptionError(f"unknown method {method!r}; SciPy's are {', '.join(METHODS)}")
    if kernels.projected and method not in PROJECTABLE:
        raise OptionError(
            f"{method} continues from past steps, which projection invalidates; use one of {', '.join(PROJECTABLE)}"
        )
    if kernels.tables and method not in PROJECTABLE:
        raise OptionError(
            f"{method} continues from past steps, which end at the knots of the tables of this scene; use one of"
            f" {', '.join(PROJECTABLE)}"
        )


@final
@dataclass
class _SteppedRun:
    """One integration in progress."""

    kernels: Kernels
    method: str
    problem: IntegrationProblem
    t: list[float] = field(default_factory=list)
    y: list[FloatArray] = field(default_factory=list)
    knots: list[float] = field(default_factory=list)
    interpolants: list[Callable[[FloatArray], FloatArray]] = field(default_factory=list)
    corrections: list[FloatArray] = field(default_factory=list)
    steps: int = 0
    rejected: int = 0
    evaluations: int = 0
    counted: tuple[int, int, int] = (0, 0, 0)
    end: float = 0.0
    last: FloatArray | None = None

    def __post_init__(self) -> None:
        self._calls = KernelCalls(self.kernels, self.problem.constants, (self.problem.rtol, self.problem.atol))

    def solution(self) -> Solution:
        """Run to the end and collect what was recorded."""
        y0 = np.array(self.problem.y0, dtype=np.float64)
        self.begin(y0)
        (status,) = deque(self.statuses(y0), maxlen=1)
        return self._collected(status, y0)

    def begin(self, y0: FloatArray) -> None:
        """Record the initial state."""
        self.end = float(self.problem.t0)
        self._record_accepted(self.end, y0)
        self.knots.append(float(self.problem.t0))

    def taken(self, status: Status, y0: FloatArray) -> Solution:
        """Return the recorded solution, and keep only its end, from which the run continues."""
        solution = self._collected(status, y0)
        self.t, self.y, self.knots = self.t[-1:], self.y[-1:], self.knots[-1:]
        self.interpolants, self.corrections = [], []
        self.counted = self.steps, self.rejected, self.evaluations
        return solution

    def _collected(self, status: Status, y0: FloatArray) -> Solution:
        n = len(y0)
        steps, rejected, evaluations = self.counted
        return Solution(
            status=status,
            t=np.array(self.t, dtype=np.float64),
            y=np.array(self.y, dtype=np.float64).reshape(-1, n),
            steps=self.steps - steps,
            rejected=self.rejected - rejected,
            evaluations=self.evaluations - evaluations,
            dense=self._dense_output(y0) if self.problem.dense else None,
            end=self.end,
            last=y0.copy() if self.last is None else self.last,
        )

    def statuses(self, y0: FloatArray) -> Iterator[Status]:
        """Yield a status after every step, and the status of the whole last."""
        try:
            slope = self._calls.call(self.kernels.rhs, self.problem.t0, y0)
        except ArithmeticError:
            yield Status.NON_FINITE
            return
        self.evaluations = 1
        if not (np.all(np.isfinite(y0)) and np.all(np.isfinite(slope))):
            yield Status.NON_FINITE
        elif self.problem.t0 == self.problem.t1:
            yield Status.SUCCESS
        else:
            try:
                yield from self._step_to_the_end(self._solver(y0))
            except NonFiniteError:
                yield Status.NON_FINITE

    def _step_to_the_end(self, solver: Any) -> Iterator[Status]:
        per_attempt = METHODS[self.method].attempt
        while solver.status == "running":
            if self.steps >= self.problem.max_steps:
                yield Status.MAX_STEPS
                return
            check(float(solver.t))
            before, proposed = solver.nfev, self._limit_at_knots(solver)
            solver.step()
            shortened = proposed > 0.0 and proposed > solver.h_abs
            if shortened:
                solver.h_abs = proposed
            self.evaluations += solver.nfev - before
            if solver.status == "failed":
                in_last_attempt = self._calls.since_non_finite < max(per_attempt, 1)
                yield Status.NON_FINITE if in_last_attempt else Status.STEP_TOO_SMALL
                return
            if per_attempt:
                self.rejected += (solver.nfev - before) // per_attempt - 1
            status = self._finish_step(solver)
            if shortened and self.method == "radau":
                solver.sol = None  # no polynomial of so short a step foretells a longer one
            yield status
            if status is not Status.SUCCESS:
                return

    def _limit_at_knots(self, solver: Any) -> float:
        """Limit the next step to end at a knot of a table; return the proposed size where that shortens it, else 0."""
        if self.kernels.knots is None or self.method not in PROJECTABLE:
            return 0.0
        limits = np.zeros(2)
        self.kernels.knots(solver.t, solver.y, self.problem.constants, limits)
        limit = max(float(limits[0 if solver.direction > 0.0 else 1]), 32.0 * np.spacing(abs(solver.t)))
        solver.max_step = min(self.problem.max_step, limit)
        return float(solver.h_abs) if solver.h_abs > solver.max_step == limit else 0.0

    def _finish_step(self, solver: Any) -> Status:
        """Project and record an accepted step; the interpolant is built before the state is moved."""
        before = solver.nfev
        interpolant = solver.dense_output() if self.problem.dense or self._times_before(solver.t) else None
        self.evaluations += solver.nfev - before
        correction = np.zeros_like(solver.y)
        earlier = self.problem.y0 if self.last is None else self.last
        if self.kernels.projected:
            projected = self._calls.project(solver.t, solver.y, earlier)
            if projected is None:
                return Status.PROJECTION_FAILED
            correction = end_differences(projected - solver.y, np.abs(projected))
            solver.y = projected
            solver.f = self._calls.rhs(solver.t, projected)
            self.evaluations += 1
        self.steps += 1
        self.knots.append(solver.t)
        if interpolant is not None:
            if self.problem.dense:
                self.interpolants.append(interpolant)
                self.corrections.append(correction)
            ramped = StepInterpolants(np.array(self.knots[-2:]), [interpolant], correction[np.newaxis])
            for t in self._times_before(solver.t):
                state: FloatArray | None = ramped(np.array([t]))[0]
                if self.kernels.projected and state is not None:
                    state = self._calls.project(t, state, earlier)
                if state is None:
                    return Status.PROJECTION_FAILED
                self.t.append(t)
                self.y.append(state)
        self._record_accepted(solver.t, solver.y.copy())
        self.end, self.last = float(solver.t), solver.y.copy()
        return Status.SUCCESS

    def _times_before(self, t_new: float) -> list[float]:
        """List the times to evaluate that are not recorded yet and come before the end of the step."""
        if self.problem.t_eval is None:
            return []
        rest = np.asarray(self.problem.t_eval, dtype=np.float64)[len(self.t) :]
        before = rest < t_new if self.problem.t1 > self.problem.t0 else rest > t_new
        return [float(t) for t in rest[before]]

    def _record_accepted(self, t: float, y: FloatArray) -> None:
        """Record the end of a step: once, or as often as it is among the times to evaluate."""
        if self.problem.t_eval is None:
            self.t.append(t)
            self.y.append(y)
            return
        while len(self.t) < len(self.problem.t_eval) and self.problem.t_eval[len(self.t)] == t:
            self.t.append(t)
            self.y.append(y)

    def _dense_output(self, y0: FloatArray) -> StepInterpolants:
        if not self.interpolants:
            still = [lambda t: np.repeat(y0[:, np.newaxis], len(t), axis=1)]
            return StepInterpolants(np.full(2, self.knots[0]), still, np.zeros((1, len(y0))))
        return StepInterpolants(np.array(self.knots), self.interpolants, np.array(self.corrections))

    def _solver(self, y0: FloatArray) -> Any:
        problem = self.problem
        span = abs(problem.t1 - problem.t0)
        method = METHODS[self.method]
        explicit, atol = method.attempt > 0, problem.absolute_tolerances(len(y0))
        known = {} if explicit or self.kernels.jacobian is None else {"jac": self._calls.jacobian}
        solver = pkgutil.resolve_name(method.place)(
            self._calls.rhs if explicit or self.kernels.tables else self._calls.finite_rhs,
            problem.t0,
            y0,
            problem.t1,
            rtol=problem.rtol,
            atol=float(atol[0]) if problem.allowed is None else atol,
            max_step=problem.max_step,
            first_step=None if problem.first_step is None else min(problem.first_step, span),
            **known,
        )
        self.evaluations += solver.nfev
        return solver
