"""The initial value problem that every integrator takes and the solution it returns."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias, final

import numpy as np

from ..arrays import FloatArray
from ..errors import OptionError
from ..frozen import frozen
from ..methods.status import Status
from ..methods.step_constants import SMALLEST_SCALE
from ..options import DEFAULT_TOLERANCES, MAX_STEPS, component_tolerances
from ..stops.input_records import InputRecords
from ..stops.stops import CaseStops
from .dense_output import DenseOutput, PiecewisePolynomial

Kernel: TypeAlias = Callable[[float, FloatArray, FloatArray, FloatArray], None]


@final
@frozen(eq=False)
class Kernels:
    """The generated functions an integrator calls, all with the signature ``(t, y, constants, out)``.

    Attributes
    ----------
    rhs
        Writes dy/dt (n_y,) into ``out``.
    project_position, project_velocity
        Write one mass-orthogonal Newton correction (n_y,) into ``out``; absent where nothing is projected.
    jacobian
        Writes the derivatives of dy/dt by y, row by row (n_y * n_y,), into ``out``; implicit methods form differences
        where it is absent.
    knots
        Writes the largest sizes (2,) of the next step that knots of tables and zeros of lengths allow, forward and
        backward in time.
    tables
        Whether steps end at knots of tables, beyond which rates may be NaN.
    """

    rhs: Kernel
    project_position: Kernel | None = None
    project_velocity: Kernel | None = None
    jacobian: Kernel | None = None
    knots: Kernel | None = None
    tables: bool = False

    @property
    def projected(self) -> bool:
        """Whether accepted steps are projected back onto constraints."""
        return self.project_position is not None or self.project_velocity is not None


@final
@dataclass
class SamplingClock:
    """The start of a run, from which instants of controllers count, and the last one at which they acted.

    `requested` are the times to record of the whole run.
    """

    origin: float
    last: float = -np.inf
    requested: FloatArray | None = None


@final
@frozen(eq=False, kw_only=True)
class IntegrationProblem:
    """An initial value problem with its tolerances and what is to be recorded.

    Attributes
    ----------
    t0, t1
        Start and end of the time span; ``t1 < t0`` integrates backward, ``t1 == t0`` is allowed.
    y0
        Initial state (n_y,).
    constants
        Hoisted constants (n_c,), handed to the kernels unchanged.
    rtol, atol
        A step is accepted when its error, in the RMS norm over ``atol + rtol*max(|y|, |y_new|)``, is at most
        1.
    t_eval
        Times to record (n_t,), monotone from ``t0`` towards ``t1``; None records the accepted steps.
    first_step
        Size of the first step tried, or None to choose it.
    max_step
        Largest step size.
    max_steps
        Largest number of attempted steps, rejected ones included.
    dense
        Whether the solution keeps a continuous output.
    bounded
        Whether the error of the polynomials of steps decides about these, too, where a method knows it: events are
        located on them.
    inputs
        Records at whose knots steps end, where the constants change; those of the problem are for its start.
    stops
        Where else steps end; then there are `inputs`, be they without records.
    sampled
        Of a run with controllers that may be cut elsewhere, what is known of their instants; None for other runs.
    allowed
        Absolute tolerances (n_y,) of the components of the state, which engines set where `atol` has them by name.

    Raises
    ------
    OptionError
        If any of these is out of range; the message lists every fault.
    """

    t0: float
    t1: float
    y0: FloatArray
    constants: FloatArray
    rtol: float = DEFAULT_TOLERANCES[0]
    atol: float = DEFAULT_TOLERANCES[1]
    t_eval: FloatArray | None = None
    first_step: float | None = None
    max_step: float = np.inf
    max_steps: int = MAX_STEPS
    dense: bool = False
    bounded: bool = False
    inputs: InputRecords | None = None
    stops: CaseStops | None = None
    sampled: SamplingClock | None = None
    allowed: FloatArray | None = None

    def __post_init__(self) -> None:
        validate(self)

    def with_components(self, names: Sequence[str]) -> "IntegrationProblem":
        """Return the problem with `allowed` for a state of these names; itself where `atol` is one number."""
        own = component_tolerances(self.atol, names)
        return self if own is None else replace(self, allowed=own)

    def absolute_tolerances(self, width: int) -> FloatArray:
        """Return the absolute tolerance (width,) of each component, not below `SMALLEST_SCALE`.

        Components behind the state, which have no rates, have the smallest.
        """
        found = np.full(width, max(float(self.atol), SMALLEST_SCALE))
        if self.allowed is not None:
            found[: len(self.allowed)] = np.maximum(self.allowed, SMALLEST_SCALE)
        return found

    def up_to_stop(self, t: float) -> "IntegrationProblem":
        """Return the problem from a time to the next of its stops, with the constants there and nothing to record."""
        assert self.stops is not None
        sign, times = 1.0 if self.t1 >= self.t0 else -1.0, self.stops.lists.times
        ahead = times[sign * times > sign * t]
        end = float(ahead[0]) if len(ahead) else self.t1
        along = self.stops.along
        c = self.constants if along is None else along.at(np.array([t]))[0]
        return replace(self, t0=t, t1=end, constants=c, t_eval=None, stops=None)


@final
@frozen(eq=False, kw_only=True)
class Solution:
    """Result of an integration.

    Attributes
    ----------
    status
        How it ended; after a failure the records end where the run did.
    t, y
        Recorded times (n_t,) and states (n_t, n_y).
    steps, rejected, evaluations
        Accepted steps, rejected attempts, and calls of the right-hand side.
    dense
        Continuous output over the accepted steps, where the problem has `dense`.
    wrapped
        The states (n_t, n_y) with angles less some turns, which have more digits, where they were kept so.
    end
        Time that the run reached; None where it is the last of the recorded times, or of the continuous output.
    last
        The state (n_y,) then, where it is known.
    """

    status: Status
    t: FloatArray
    y: FloatArray
    steps: int
    rejected: int
    evaluations: int
    dense: "DenseOutput | None" = None
    wrapped: FloatArray | None = None
    end: float | None = None
    last: FloatArray | None = None

    @property
    def success(self) -> bool:
        """Whether the end of the time span, or a terminal event, was reached."""
        return self.status.success


def prescribed(problem: IntegrationProblem) -> Solution:
    """Return the solution of a problem without a state: a motion that its constraints prescribe."""
    times = np.array([problem.t0, problem.t1]) if problem.t_eval is None else problem.t_eval
    knots = np.array([problem.t0, problem.t1])
    dense = PiecewisePolynomial(knots, np.empty((1, 1, 0))) if problem.dense else None
    y = np.empty((len(times), 0))
    return Solution(
        status=Status.SUCCESS, t=times, y=y, steps=0, rejected=0, evaluations=0, dense=dense, end=problem.t1
    )


def prescribed_blocks(problem: IntegrationProblem) -> Iterator[Solution]:
    """Yield the solution of a problem without a state as one block (`dalembert.codegen.engine.Engine.step_blocks`)."""
    yield prescribed(problem)


def validate(problem: IntegrationProblem) -> None:
    """Check a problem.

    Raises
    ------
    OptionError
        Listing every fault.
    """
    if _plain(problem):
        if problem.t_eval is not None:
            times_wanted(problem.t0, problem.t1, problem.t_eval)
        return
    faults = [*_tolerance_faults(problem), *_step_faults(problem), *_time_faults(problem)]
    for name in ("y0", "constants"):
        if np.ndim(getattr(problem, name)) != 1:
            faults.append(f"{name} must be one-dimensional, not of shape {np.shape(getattr(problem, name))}")
    if faults:
        raise OptionError("; ".join(faults))


def _plain(problem: IntegrationProblem) -> bool:
    """Return whether a problem has no fault but in its times to record, by a quick test."""
    return (
        0.0 < problem.rtol < math.inf
        and 0.0 <= problem.atol < math.inf
        and (problem.first_step is None or 0.0 < problem.first_step < math.inf)
        and problem.max_step > 0.0
        and problem.max_steps >= 1
        and math.isfinite(problem.t0)
        and math.isfinite(problem.t1)
        and problem.y0.ndim == 1
        and problem.constants.ndim == 1
    )


def times_wanted(t0: float, t1: float, t_eval: FloatArray) -> None:
    """Check times to record on a span.

    Raises
    ------
    OptionError
        Listing every fault.
    """
    faults = _wanted_faults(t0, t1, t_eval)
    if faults:
        raise OptionError("; ".join(faults))


def _tolerance_faults(problem: IntegrationProblem) -> list[str]:
    faults = [
        f"{name} must be finite and not negative, not {value!r}"
        for name, value in (("rtol", problem.rtol), ("atol", problem.atol))
        if not 0.0 <= value < np.inf
    ]
    if problem.rtol == 0.0 == problem.atol:
        faults.append("rtol and atol must not both be 0: set one of them above 0")
    return faults


def _step_faults(problem: IntegrationProblem) -> list[str]:
    faults = []
    if problem.first_step is not None and not 0.0 < problem.first_step < np.inf:
        faults.append(f"first_step must be positive and finite (also backward in time), not {problem.first_step!r}")
    if not problem.max_step > 0.0:
        faults.append(f"max_step must be positive, not {problem.max_step!r}")
    if problem.max_steps < 1:
        faults.append(f"max_steps must be at least 1, not {problem.max_steps!r}")
    return faults


def _time_faults(problem: IntegrationProblem) -> list[str]:
    t0, t1, t_eval = problem.t0, problem.t1, problem.t_eval
    if not (np.isfinite(t0) and np.isfinite(t1)):
        return [f"t0 and t1 must be finite, not {t0!r} and {t1!r}"]
    return [] if t_eval is None else _wanted_faults(t0, t1, t_eval)


def _wanted_faults(t0: float, t1: float, t_eval: FloatArray) -> list[str]:
    if np.ndim(t_eval) != 1:
        return [f"t_eval must be one-dimensional, not of shape {np.shape(t_eval)}"]
    faults = []
    early, late = (t_eval[:-1], t_eval[1:]) if t1 >= t0 else (t_eval[1:], t_eval[:-1])
    in_order = bool((early <= late).all())
    ends = t_eval[[0, -1]] if in_order and len(t_eval) else t_eval
    if not np.all((ends >= min(t0, t1)) & (ends <= max(t0, t1))):
        faults.append(f"t_eval must lie between t0 = {t0!r} and t1 = {t1!r}")
    if not in_order:
        faults.append(f"t_eval must be sorted from t0 = {t0!r} towards t1 = {t1!r}")
    return faults
