"""Integration by diffrax in blocks of a fixed number of steps.

JAX needs the size of every buffer when it compiles. A block has room for a fixed number of steps, and a run is as many
blocks as it takes: memory grows with the steps that were taken, not with those that were allowed, and nothing is
compiled anew for a longer span, other tolerances or other times to evaluate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, final

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix

from ...arrays import FloatArray
from ...frozen import frozen
from ...ir.interpret import interpret_rows
from ...methods.status import Status
from ...methods.step_constants import ANY_START
from ...once import once
from ...options import component_tolerances
from ...steps.problem import IntegrationProblem, Solution
from .control import Control, StepController, projecting
from .precision import compiled, double_precision
from .run_data import BlockRecord
from .step_rules import limit_at_knots, smallest_of

if TYPE_CHECKING:
    from .run_constants import ArrayKernels

BLOCK_STEPS = 256
"""Attempts in a block: the most that one call of the compiled function takes and returns."""
_FIRST = 3
"""Evaluations before the first block; each block evaluates its first slope anew."""


@final
@frozen
class Method:
    """A Runge-Kutta solver of diffrax whose last stage is the first of the next step.

    Attributes
    ----------
    solver : diffrax.AbstractRungeKutta
        The solver.
    degree : int
        Degree of the polynomial that interpolates inside a step.
    implicit : bool
        Whether its stages are implicit.
    """

    solver: Any
    degree: int
    implicit: bool = False

    @property
    def evaluations(self) -> int:
        """Calls of the right-hand side that an attempted step takes, iterations of implicit stages not counted."""
        return int(self.solver.tableau.num_stages) - 1


_STAGES = diffrax.with_stepsize_controller_tols(optimistix.Chord)()
"""Solves the stages of implicit steps. diffrax's VeryChord has one Jacobian for all stages of a step: on a double
pendulum in Cartesian coordinates it failed at every other step, and steps were a tenth of what their errors allowed."""

METHODS: Mapping[str, Method] = {
    "dopri8": Method(diffrax.Dopri8(), degree=6),
    "tsit5": Method(diffrax.Tsit5(), degree=4),
    "kvaerno5": Method(diffrax.Kvaerno5(root_finder=_STAGES), degree=3, implicit=True),
}
"""diffrax's solvers by the names that they have here."""


@final
class SolverSettings(NamedTuple):
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
    """Start or end of a block of steps."""

    t: Any
    y: Any
    control: Control


@final
class Block(NamedTuple):
    """Result of one block of steps.

    The first ``steps`` rows of ``t`` (k,), ``y`` (k, n_y) and ``stages`` (k, n_stages, n_y) are the ends of its steps,
    the states there and the slopes of the stages times the step size; k is `BLOCK_STEPS`.
    """

    end: Point
    hopeless: Any
    steps: Any
    rejected: Any
    t: Any
    y: Any
    stages: Any


def solver_for(kernels: ArrayKernels, method: str) -> Any:
    """Return the solver of a method, projecting where the program does; its ``args`` are `SolverSettings`."""
    solver = METHODS[method].solver
    if not kernels.projected:
        return solver

    def project(t: Any, y: Any, before: Any, settings: SolverSettings) -> Any:
        tolerances = ANY_START, smallest_of(settings.atol)
        return kernels.project(settings.direction * t, y, settings.constants, before, tolerances)

    return projecting(solver, project)


IMPLICIT_SHARE = 0.1
"""Share of the tolerances to which implicit steps are controlled. With the tolerances themselves the error of a forced
oscillator is 30 times them (that of explicit methods once or twice), though its stages are solved exactly: the estimate
of Kvaerno's pair is that much too small."""


def equation(kernels: ArrayKernels, settings: SolverSettings, solver: Any) -> tuple[Any, StepController]:
    """Return the differential equation forward in time, and the step size control of a solver."""
    rhs = kernels["rhs"]

    def slope(t: Any, y: Any, settings: SolverSettings) -> Any:
        return settings.direction * rhs(settings.direction * t, y, settings.constants)

    span = settings.t1 - settings.t0
    share = IMPLICIT_SHARE if isinstance(solver, diffrax.AbstractImplicitSolver) else 1.0

    def limit(t: Any, y: Any, settings: SolverSettings) -> Any:
        time = settings.direction * t
        return limit_at_knots(kernels["knots"](time, y, settings.constants), time, settings.direction)

    tolerances = share * settings.rtol, share * settings.atol
    controller = StepController(*tolerances, settings.max_step, span, limit if "knots" in kernels else None)
    return diffrax.ODETerm(slope), controller


def _begin(kernels: ArrayKernels, solver: Any, settings: SolverSettings, y: Any, max_steps: Any) -> tuple[Point, Any]:
    """Return the start, with the size of the first step, and whether its slope is finite."""
    term, controller = equation(kernels, settings, solver)
    t0, t1 = settings.t0, settings.t1
    finite = jnp.all(jnp.isfinite(y)) & jnp.all(jnp.isfinite(term.vf(t0, y, settings)))
    order = solver.error_order(term)
    _, control = controller.init(term, t0, t1, y, settings.first_step, settings, solver.func, order)
    return Point(t0, y, control._replace(attempts=max_steps)), finite


def _advance(kernels: ArrayKernels, solver: Any, settings: SolverSettings, start: Point) -> Block:
    """Take at most BLOCK_STEPS attempts from `start` towards the end of the span."""
    term, controller = equation(kernels, settings, solver)
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
        max_steps=BLOCK_STEPS,
        throw=False,
        controller_state=start.control,
    )
    steps = solution.stats["num_accepted_steps"]
    ends, infos = solution.interpolation.ts[1:], solution.interpolation.infos
    t = jnp.where(steps > 0, ends[steps - 1], start.t)
    y = jnp.where(steps > 0, infos["y1"][steps - 1], start.y)
    return Block(
        end=Point(t, y, solution.controller_state),
        hopeless=solution.result == diffrax.RESULTS.dt_min_reached,
        steps=steps,
        rejected=solution.stats["num_rejected_steps"],
        t=ends,
        y=infos["y1"],
        stages=infos["k"],
    )


@once
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


def _settings(problem: IntegrationProblem, direction: float, names: Sequence[str]) -> SolverSettings:
    own = component_tolerances(problem.atol, names)
    return SolverSettings(
        direction=np.float64(direction),
        t0=np.float64(direction * problem.t0),
        t1=np.float64(direction * problem.t1),
        constants=np.array(problem.constants, dtype=np.float64),
        rtol=np.float64(problem.rtol),
        atol=np.float64(problem.atol) if own is None else own,
        first_step=np.float64(problem.first_step or 0.0),
        max_step=np.float64(problem.max_step),
    )


def _status_at_start(finite: bool, problem: IntegrationProblem) -> Status | None:
    if not finite:
        return Status.NON_FINITE
    return Status.SUCCESS if problem.t0 == problem.t1 else None


def _status(block: Block, t1: float) -> Status | None:
    """Return the status of a run that has ended, None where it continues."""
    if block.end.t == t1:
        return Status.SUCCESS
    if block.hopeless:
        return Status.STEP_TOO_SMALL if block.end.control.finite else Status.NON_FINITE
    return Status.MAX_STEPS if block.end.control.attempts <= 0 else None


@final
class Integrator:
    """One method for one program; what it compiles is kept and serves every problem.

    Parameters
    ----------
    kernels : Kernels
        The kernels of the program.
    method : str
        A name in `METHODS`.
    """

    def __init__(self, kernels: ArrayKernels, method: str) -> None:
        solver = solver_for(kernels, method)
        self._kernels, self._method = kernels, method
        operations = len(kernels.program.kernel("rhs").body)
        self._begin = compiled(partial(_begin, kernels, solver), operations)
        self._advance = compiled(partial(_advance, kernels, solver), operations)

    def __call__(self, problem: IntegrationProblem) -> Solution:
        """Integrate a problem; numerical failure is the solution's status, never an exception."""
        projected = self._kernels.projected
        record = BlockRecord(problem, _weights(self._method), self._kernels.program)
        settings = _settings(problem, record.direction, self._kernels.program.layout.state)
        with double_precision():
            start = self._begin(settings, np.array(problem.y0, dtype=np.float64), np.int64(problem.max_steps))
            point, finite = jax.device_get(start)
            status = _status_at_start(bool(finite), problem)
            while status is None:
                block: Block = jax.device_get(self._advance(settings, point))
                steps = slice(int(block.steps))
                record.add(block.t[steps], block.y[steps], block.stages[steps], int(block.rejected))
                point, status = block.end, _status(block, settings.t1)
            if status is Status.NON_FINITE and projected and self._regular(settings, point):
                status = Status.PROJECTION_FAILED
        attempts = record.steps + record.rejected
        evaluations = _FIRST + record.blocks + METHODS[self._method].evaluations * attempts
        return record.solution(status, evaluations)

    def _regular(self, settings: SolverSettings, point: Point) -> bool:
        """Whether the right-hand side is finite where the run ended, so that the projection is what failed."""
        t, y, c = (np.asarray(value) for value in (settings.direction * point.t, point.y, settings.constants))
        slopes = interpret_rows(self._kernels.program.kernel("rhs"), t.reshape(1), y.reshape(1, -1), c)
        return bool(np.all(np.isfinite(slopes)))
