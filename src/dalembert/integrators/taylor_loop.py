"""One trajectory, step by step, with a compiled step kernel.

The kernel decides the size of each step and never rejects one; the loop keeps the time, looks for
numbers that are not finite, and projects. It is the same for every model and every order.

Time and state are summed with compensation (Kahan; N. J. Higham, Accuracy and Stability of Numerical
Algorithms, section 4.3): what rounding takes from a sum is kept and added to the next increment, so that
the phase of a long run, and angles that wind up, keep the digits of the steps.
"""

from __future__ import annotations

from typing import NamedTuple

from ..arrays import FloatArray
from ..methods.status import RUNNING, Status
from .arguments import Address, IntVector, Matrix, Record, Vector
from .compiled_subset import call_code, compiled_subset, row
from .input_steps import InputTable, begin_inputs, pass_knots, take_sides
from .projection import project_row
from .step_control import ACCEPTED, attempt_test

__all__ = ["LOOP", "TaylorArguments", "TaylorProgress"]


class TaylorProgress(Record):
    """Time [s], which moves along, the number of steps taken, whether inputs have begun, and where their piece ends."""

    t: float
    steps: int
    begun: int
    end: float


class TaylorArguments(NamedTuple):
    """Arguments of the loop.

    Attributes
    ----------
    step, position, velocity : address
        The step, and the projections, 0 for none.
    limit : int
        The number of steps.
    t1, largest : float
        End of the run and largest step [s].
    settings : (1, 3)
        Handed to the step (see `dalembert.transforms.taylor`).
    y : (1, n_y + 1)
        The state, and the size of the step before, 0 where there was none.
    constants : (n_c, 1)
    rows : (m, ...)
        Gets the outputs of step k in row k modulo m.
    times : (...,)
        Gets the end of step k where it has room.
    low : (n_y + 1,)
        Rounding errors of the state and of the time so far.
    clock, delta, mark : (1, 1), (n_y, 1), (1,)
        Are overwritten.
    inputs : InputTable
        Records at whose knots steps end.
    """

    step: Address
    position: Address
    velocity: Address
    limit: int
    t1: float
    largest: float
    settings: Matrix
    y: Matrix
    constants: Matrix
    rows: Matrix
    times: Vector
    low: Vector
    clock: Matrix
    delta: Matrix
    mark: IntVector
    progress: TaylorProgress
    inputs: InputTable


@compiled_subset
def _sum(a: float, b: float) -> tuple[float, float]:
    """Return a + b as rounded, and the rounding error (Knuth's two-sum)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@compiled_subset
def _advance(old: FloatArray, before: int, rows: FloatArray, here: int, h: float, low: FloatArray) -> None:
    """Write to ``rows[here, :n]`` the state ``old[before, :n]`` moved by the series in that row, with compensation."""
    n = low.size - 1
    width = (rows.shape[1] - n - 2) // n
    for i in range(n):
        first = n + 2 + i * width
        move = 0.0
        for k in range(width - 1, 0, -1):
            move = (move + rows[here, first + k]) * h
        rows[here, i], low[i] = _sum(old[before, i], move + low[i])


@compiled_subset
def _take_steps(arguments: TaylorArguments) -> tuple[int, int]:
    step, position, velocity, progress = arguments.step, arguments.position, arguments.velocity, arguments.progress
    settings, y, constants, rows = arguments.settings, arguments.y, arguments.constants, arguments.rows
    times, low, clock, limit = arguments.times, arguments.low, arguments.clock, arguments.limit
    n = low.size - 1
    t, t1, largest = progress.t, arguments.t1, arguments.largest
    end = _begin_inputs(arguments)
    state = row(y, 0)
    for k in range(limit):
        here = k % rows.shape[0]
        rest = abs(end - t - low[n])
        if rest == 0.0:
            return Status.SUCCESS, k
        settings[0, 0] = min(rest, largest)
        clock[0, 0] = t
        call_code(step, row(clock, 0), state, row(constants, 0), row(settings, 0), row(rows, here))
        size = rows[here, n]
        outcome = attempt_test(size, rows[here, n + 1] != 0.0, 0.0, False, t, rest)
        if outcome != ACCEPTED:
            return outcome, k
        if k == 0:
            _advance(y, 0, rows, here, settings[0, 1] * size, low)
        else:
            _advance(rows, (k - 1) % rows.shape[0], rows, here, settings[0, 1] * size, low)
        state = row(rows, here)
        if size == rest:
            t, low[n] = end, 0.0
        else:
            t, low[n] = _sum(t, settings[0, 1] * size + low[n])
        if not project_row(position, velocity, t, clock, rows, here, constants, arguments.delta, arguments.mark):
            return Status.PROJECTION_FAILED, k
        progress.t = t
        if k < times.size:
            times[k] = t
        if t == t1:
            return Status.SUCCESS, k + 1
        if t == end:
            end = pass_knots(arguments.inputs, constants, 0, 0, t, settings[0, 1] > 0.0)
            progress.end = end
            clock[0, 0] = t
            take_sides(arguments.inputs, clock, rows, here, constants, n, settings[0, 1] > 0.0)
    return RUNNING, limit


@compiled_subset
def _begin_inputs(arguments: TaylorArguments) -> float:
    """Return the time at which the next steps must end: the end of the run, or of the piece of an input."""
    inputs, progress = arguments.inputs, arguments.progress
    if inputs.knots.size == 0:
        return arguments.t1
    if progress.begun == 0:
        forward = arguments.settings[0, 1] > 0.0
        progress.begun = 1
        progress.end = begin_inputs(inputs, arguments.constants, 0, 0, progress.t, arguments.t1, forward)
    return progress.end


@compiled_subset
def LOOP(arguments: TaylorArguments) -> int:
    """Take steps from the state given, at most so many; return the status.

    It is `RUNNING` where the number of steps was reached before the end.
    """
    status, arguments.progress.steps = _take_steps(arguments)
    return status
