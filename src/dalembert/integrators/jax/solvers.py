"""Integration by diffrax in legs of a fixed number of steps.

JAX needs the size of every buffer when it compiles. A leg has room for a fixed number of steps, and a run is as many
legs as it takes: memory grows with the steps that were taken, not with those that were allowed, and nothing is
compiled anew for a longer span, other tolerances or other times to evaluate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, NamedTuple, final

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from ..problem import FloatArray, IntegrationProblem, Solution
from ..status import Status
from .control import Control, Controller
from .precision import double_precision
from .record import Record

__all__ = ["METHODS", "Integrator", "Method"]

LEG = 256
_FIRST = 3
"""Evaluations before the first leg; each leg evaluates its first slope anew."""


@final
@dataclass(frozen=True)
class Method:
    """A solver of diffrax whose last stage is the first of the next step.

    Attributes
    ----------
    solver : diffrax.AbstractERK
        The solver.
    degree : int
        Degree of the polynomial that interpolates inside a step.
    """

    solver: Any
    degree: int

    @property
    def evaluations(self) -> int:
        """Calls of the right-hand side that an attempted step takes."""
        return int(self.solver.tableau.num_stages) - 1


METHODS: Mapping[str, Method] = {
    "dopri8": Method(diffrax.Dopri8(), degree=6),
    "tsit5": Method(diffrax.Tsit5(), degree=4),
}
"""diffrax's solvers by the names that they have here."""


@final
class Settings(NamedTuple):
    """The numbers of an integration problem, all traced. Time is negated where the problem goes backward."""

    direction: Any
    t0: Any
    t1: Any
    constants: Any
    rtol: Any
    atol: Any
    first_step: Any
    max_step: Any


@final
class Point(NamedTuple):
    """Where a leg starts or ends."""

    t: Any
    y: Any
    control: Control


@final
class Leg(NamedTuple):
    """What one leg returns.

    The first ``steps`` of ``t`` (LEG,), ``y`` (LEG, n_y) and ``stages`` (LEG, n_stages, n_y) are the ends of its steps
    and the slopes of their stages times the step size.
    """

    end: Point
    hopeless: Any
    steps: Any
    rejected: Any
    t: Any
    y: Any
    stages: Any


def _problem(rhs: Callable[..., Any], settings: Settings) -> tuple[Any, Controller]:
    """Return the differential equation forward in time, and its step size control."""

    def slope(t: Any, y: Any, settings: Settings) -> Any:
        return settings.direction * rhs(settings.direction * t, y, settings.constants)

    span = settings.t1 - settings.t0
    return diffrax.ODETerm(slope), Controller(settings.rtol, settings.atol, settings.max_step, span)


def _begin(rhs: Callable[..., Any], solver: Any, settings: Settings, y: Any, max_steps: Any) -> tuple[Point, Any]:
    """Return the start, with the size of the first step, and whether its slope is finite."""
    term, controller = _problem(rhs, settings)
    t0, t1 = settings.t0, settings.t1
    finite = jnp.all(jnp.isfinite(y)) & jnp.all(jnp.isfinite(term.vf(t0, y, settings)))
    order = solver.error_order(term)
    _, control = controller.init(term, t0, t1, y, settings.first_step, settings, solver.func, order)
    return Point(t0, y, control._replace(attempts=max_steps)), finite


def _advance(rhs: Callable[..., Any], solver: Any, settings: Settings, start: Point) -> Leg:
    """Take at most LEG attempts from `start` towards the end of the span."""
    term, controller = _problem(rhs, settings)
    solution = diffrax.diffeqsolve(
        term,
        solver,
        start.t,
        settings.t1,
        start.control.size,
        start.y,
        settings,
        saveat=diffrax.SaveAt(dense=True, controller_state=True),
        stepsize_controller=controller,
        adjoint=diffrax.ForwardMode(),
        max_steps=LEG,
        throw=False,
        controller_state=start.control,
    )
    steps = solution.stats["num_accepted_steps"]
    ends, infos = solution.interpolation.ts[1:], solution.interpolation.infos
    t = jnp.where(steps > 0, ends[steps - 1], start.t)
    y = jnp.where(steps > 0, infos["y1"][steps - 1], start.y)
    return Leg(
        end=Point(t, y, solution.controller_state),
        hopeless=solution.result == diffrax.RESULTS.dt_min_reached,
        steps=steps,
        rejected=solution.stats["num_rejected_steps"],
        t=ends,
        y=infos["y1"],
        stages=infos["k"],
    )


@cache
def _weights(method: str) -> FloatArray:
    """Return W (n_stages, degree) such that a step's interpolant is y + sum_j theta**(j + 1) (W^T k)_j."""
    solver, degree = METHODS[method].solver, METHODS[method].degree
    n = solver.tableau.num_stages
    theta = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, degree + 1) / degree)

    @jax.jit
    @jax.vmap
    def sample(fraction: Any) -> Any:
        zero = jnp.zeros(n)
        return solver.interpolation_cls(t0=0.0, t1=1.0, y0=zero, y1=zero, k=jnp.eye(n)).evaluate(fraction)

    with double_precision():
        samples = np.asarray(sample(theta))
    powers = np.vander(theta, degree, increasing=True)
    return np.asarray(np.linalg.solve(powers, samples / theta[:, np.newaxis]).T, dtype=np.float64)


def _settings(problem: IntegrationProblem, direction: float) -> Settings:
    return Settings(
        direction=np.float64(direction),
        t0=np.float64(direction * problem.t0),
        t1=np.float64(direction * problem.t1),
        constants=np.array(problem.constants, dtype=np.float64),
        rtol=np.float64(problem.rtol),
        atol=np.float64(problem.atol),
        first_step=np.float64(problem.first_step or 0.0),
        max_step=np.float64(problem.max_step),
    )


def _status_at_start(finite: bool, problem: IntegrationProblem) -> Status | None:
    if not finite:
        return Status.NON_FINITE
    return Status.SUCCESS if problem.t0 == problem.t1 else None


def _status(leg: Leg, t1: float) -> Status | None:
    """Return how the run ended, or None where it goes on."""
    if leg.end.t == t1:
        return Status.SUCCESS
    if leg.hopeless:
        return Status.STEP_TOO_SMALL if leg.end.control.finite else Status.NON_FINITE
    return Status.MAX_STEPS if leg.end.control.attempts <= 0 else None


@final
class Integrator:
    """One method for one right-hand side; what it compiles is kept and serves every problem.

    Parameters
    ----------
    rhs : callable
        Traceable ``(t, y, constants) -> dy/dt``, on arrays.
    method : str
        A name in `METHODS`.
    """

    def __init__(self, rhs: Callable[..., Any], method: str) -> None:
        solver = METHODS[method].solver
        self._method = method
        self._begin = jax.jit(partial(_begin, rhs, solver))
        self._advance = jax.jit(partial(_advance, rhs, solver))

    def __call__(self, problem: IntegrationProblem) -> Solution:
        """Integrate a problem; numerical failure is the solution's status, never an exception."""
        record = Record(problem, _weights(self._method))
        settings = _settings(problem, record.direction)
        with double_precision():
            start = self._begin(settings, np.array(problem.y0, dtype=np.float64), np.int64(problem.max_steps))
            point, finite = jax.device_get(start)
            status = _status_at_start(bool(finite), problem)
            while status is None:
                leg: Leg = jax.device_get(self._advance(settings, point))
                steps = slice(int(leg.steps))
                record.add(leg.t[steps], leg.y[steps], leg.stages[steps], int(leg.rejected))
                point, status = leg.end, _status(leg, settings.t1)
        attempts = record.steps + record.rejected
        evaluations = _FIRST + record.legs + METHODS[self._method].evaluations * attempts
        return record.solution(status, evaluations)
