"""Recorded runs in compiled loops: settings, progress, size of steps, recording and sampling.

Compiled loops allocate nothing: a run fills a block of rows and returns where it is full. `run_blocks` calls it again.
"""

from __future__ import annotations

from typing import NamedTuple

from ..arrays import FloatArray
from ..methods.status import RUNNING, Status
from ..stops.stops import StopTable, begin_stops, end_of_steps, is_due, pass_stops, take_stops
from ..subset.arguments import NO_CODE, Address, IntVector, Matrix, Record, Vector
from ..subset.compiled_subset import call_code, compiled_subset, flat, fma, row
from .packed_tableaus import POINT
from .projection import project_row
from .step_control import next_step, smallest_step, status_after


class RunSettings(NamedTuple):
    """The numbers of a problem, of whose components the first ``kept`` are recorded, by polynomials of a ``degree``.

    ``first_step`` is 0 where it is to be chosen; runs with ``stop_if_stiff`` stop where
    stability holds the steps. Accepted steps hold the states ``behind`` stops, or those before.
    """

    t0: float
    rtol: float
    atol: float
    first_step: float
    max_step: float
    max_steps: int
    kept: int
    degree: int
    sampled: bool
    dense: bool
    stop_if_stiff: bool
    behind: bool


class RunCodes(NamedTuple):
    """Kernels of one case with the arguments of a step (`dalembert.transforms.taylor.step.STEP_ARGUMENTS`); 0 for none.

    ``knots`` limits steps at knots of tables. The implicit loop needs ``jacobian``, which writes the derivatives of
    ``rhs`` row by row, or ``tangent``, which writes its derivative along the second half of a state of twice the
    length. ``multipliers`` gives components without rates behind stops.
    """

    rhs: Address
    position: Address = NO_CODE
    velocity: Address = NO_CODE
    knots: Address = NO_CODE
    jacobian: Address = NO_CODE
    tangent: Address = NO_CODE
    multipliers: Address = NO_CODE


class Progress(Record):
    """Progress of a run.

    Time, the end of the run, its direction (1 or -1), where steps must end next, the size of the next step and the
    error of the last; the row of the state in the work; how many steps were taken and rejected, evaluations made and
    times recorded; whether the last step was rejected; the steps before the present block, and those after which it is
    full. What follows is kept by one loop alone: steps in a row at the boundary of stability (`explicit_loop`); for
    `implicit_loop` whether the Jacobian is that of the present state, the size of the last step, its inverse where its
    polynomial can be continued, the rate of convergence of its iteration, what the first correction of the next is
    judged by, and the step that the matrices are factored for, 0 for none.
    The last is the size that was proposed where a knot of a table cuts the step.
    """

    t: float
    t1: float
    direction: float
    end: float
    size: float
    previous: float
    row: int
    steps: int
    rejected: int
    evaluations: int
    recorded: int
    retried: int
    begun: int
    limit: int
    at_boundary: int
    fresh: int
    last_size: float
    ratio: float
    rate: float
    known_rate: float
    factored: float
    unlimited: float


class Run(NamedTuple):
    """Arrays that a loop works on.

    ``work`` (n_rows, width) are vectors in rows: the ends of a step in turn, then those of `packing`. ``rows``
    (k, 1 + n) get the times to record ``t_eval`` with their states or, where there are none, the start and the ends of
    the steps of a block; ``pieces`` (k, 1 + (degree + 1)*n) ends of steps and polynomials, of one step where they are
    not kept. Steps end at ``stops``, where ``constants`` (n_c, 1) change; ``prepare`` is their code. ``knot`` (1, 2)
    gets the limits of a step at knots of tables. Loops over lanes have a column for each where there is one here.
    """

    clock: Matrix
    constants: Matrix
    t_eval: Vector
    work: Matrix
    delta: Matrix
    mark: IntVector
    progress: Progress
    knot: Matrix
    rows: Matrix
    pieces: Matrix
    stops: StopTable
    prepare: Address


@compiled_subset
def evaluate(code: int, t: float, run: Run, y: int, out: int) -> None:
    """Call a kernel on one row of the work; another gets its outputs."""
    run.clock[0, 0] = t
    call_code(code, row(run.clock, 0), row(run.work, y), row(run.constants, 0), 0, row(run.work, out))


@compiled_subset
def project(position: int, velocity: int, settings: RunSettings, t: float, run: Run, y: int) -> bool:
    """Project a row of the work onto the constraints, if there are any; return whether that succeeded."""
    work, before, rtol, atol = run.work, run.progress.row, settings.rtol, settings.atol
    return project_row(
        position, velocity, t, run.clock, work, y, work, before, run.constants, run.delta, run.mark, rtol, atol
    )


@compiled_subset
def all_finite(work: FloatArray, first: int, second: int) -> bool:
    """Whether every entry of two rows is finite."""
    total = 0.0
    for m in range(work.shape[1]):
        total += 0.0 * work[first, m] + 0.0 * work[second, m]
    return total == 0.0


@compiled_subset
def begin_status(settings: RunSettings, progress: Progress, finite: bool) -> int:
    """Return the status of a run before its first step."""
    return status_after(settings.t0 == progress.t1, 0.0, settings.max_steps) if finite else Status.NON_FINITE


@compiled_subset
def status_of(settings: RunSettings, progress: Progress) -> int:
    """Return the status of a run after an attempt."""
    return status_after(progress.t == progress.t1, progress.steps + progress.rejected, settings.max_steps)


@compiled_subset
def block_is_full(progress: Progress) -> bool:
    """Return whether the present block has no row for another step."""
    return progress.steps == progress.limit


@compiled_subset
def planned_step(settings: RunSettings, run: Run, limited: bool, lane: int) -> tuple[float, float]:
    """Return the next step of a lane, with its sign, and where it ends; it may be `limited` (`find_limits`).

    Where a knot cuts the step, ``progress.unlimited`` keeps the proposed size; it is 0 where none does.
    """
    progress, t, end = run.progress, run.progress.t, run.progress.end
    size, progress.size = next_step(progress.size, t, end, settings.max_step)
    if limited:
        limit = _limit_at_knots(run, lane)
        progress.unlimited = progress.size if limit < size else 0.0
        size = min(size, limit)
    if size == abs(end - t):
        return end - t, end
    h = progress.direction * size
    return h, t + h


@compiled_subset
def pass_first_stops(settings: RunSettings, run: Run) -> None:
    """Take the stops at the start, record the state behind them, and set where the first steps must end."""
    t0, t1, stops = settings.t0, run.progress.t1, run.stops
    run.progress.end = t1
    if stops.inputs.ends.shape[0] > 0:
        forward = run.progress.direction > 0.0
        run.progress.end = begin_stops(stops, run.constants, 0, 0, t0, t1, forward)
        if is_due(stops, 0, t0, forward):
            run.clock[0, 0] = t0
            take_stops(stops, run.prepare, run.clock, flat(run.work), 0, run.constants, settings.kept, forward)
        run.progress.end = end_of_steps(stops, 0, run.progress.end, forward)
    _record_at(run, t0, run.progress.row)
    if not settings.sampled:
        _store(run, 0, t0, run.progress.row)


@compiled_subset
def passes_stop(settings: RunSettings, run: Run, status: int) -> bool:
    """Return whether the step just accepted ends at a stop, be it a knot of an input; it is passed then.

    Of a run that has used up its steps only knots are passed: another run may continue it.
    """
    progress, stops = run.progress, run.stops
    if progress.t != progress.end or progress.t == progress.t1 or (status != RUNNING and stops.first.size > 0):
        return False
    run.clock[0, 0], place, forward = progress.t, progress.row * run.work.shape[1], progress.direction > 0.0
    progress.end = pass_stops(
        stops, run.prepare, run.clock, flat(run.work), place, run.constants, settings.kept, forward
    )
    return True


@compiled_subset
def find_limits(run: Run, knots: int) -> bool:
    """Compute the limits of steps at knots of tables, at the times of ``clock``; return whether there are tables."""
    if knots == 0:
        return False
    state, out = row(run.work, run.progress.row), row(run.knot, 0)
    call_code(knots, row(run.clock, 0), state, row(run.constants, 0), 0, out)
    return True


@compiled_subset
def _limit_at_knots(run: Run, lane: int) -> float:
    """Return the largest size of a step from the present state of a lane that knots of tables allow."""
    t = run.progress.t
    limit = run.knot[0, lane] if run.progress.direction > 0.0 else run.knot[0, run.knot.shape[1] // 2 + lane]
    return max(limit, 4.0 * smallest_step(t, abs(run.progress.t1 - t)))


@compiled_subset
def proposed_after(run: Run, size: float) -> float:
    """Return the size of the next step where `size` is that which the error of the last allows.

    After a step that a knot has cut, it is what was proposed before, if that is more.
    """
    return max(size, run.progress.unlimited)


@compiled_subset
def retry(settings: RunSettings, run: Run, size: float, failure: int) -> int:
    """Reject a step, to try another of some size; return the status, which is the failure where that is too small."""
    progress = run.progress
    progress.rejected += 1
    progress.retried = 1
    progress.size = size
    if size < smallest_step(progress.t, abs(progress.t1 - progress.t)):
        return failure
    return status_of(settings, progress)


@compiled_subset
def pending(run: Run, t_new: float) -> bool:
    """Whether a time to record lies inside a step up to a time."""
    k = run.progress.recorded
    return k < run.t_eval.size and (run.t_eval[k] - t_new) * (t_new - run.progress.t) < 0.0


@compiled_subset
def record(position: int, velocity: int, settings: RunSettings, run: Run, piece: int, y_new: int, t_new: float) -> int:
    """Accept a step and record its requested states, by its polynomial where one is `pending`; return the status."""
    progress, t, projected = run.progress, run.progress.t, True
    while pending(run, t_new):
        at = run.t_eval[progress.recorded]
        evaluate_polynomial(run, piece, settings.degree, (at - t) / (t_new - t), settings.kept)
        projected = project(position, velocity, settings, at, run, POINT)
        if not projected:
            break
        _store(run, progress.recorded, at, POINT)
        progress.recorded += 1
    if not settings.sampled:
        _store(run, 1 + progress.steps - progress.begun, t_new, y_new)
    progress.steps += 1
    progress.row, run.progress.t = y_new, t_new
    return status_of(settings, progress) if projected else Status.PROJECTION_FAILED


@compiled_subset
def record_behind(settings: RunSettings, run: Run) -> None:
    """Record the state at the end of a step where that is a requested time, and behind a stop where steps hold it."""
    progress = run.progress
    _record_at(run, progress.t, progress.row)
    if settings.behind and not settings.sampled:
        _store(run, progress.steps - progress.begun, progress.t, progress.row)


@compiled_subset
def _record_at(run: Run, t: float, y: int) -> None:
    """Record a row of the work at the times to record that are this one."""
    progress = run.progress
    while progress.recorded < run.t_eval.size and run.t_eval[progress.recorded] == t:
        _store(run, progress.recorded, t, y)
        progress.recorded += 1


@compiled_subset
def evaluate_polynomial(run: Run, piece: int, degree: int, theta: float, n: int) -> None:
    """Evaluate a polynomial, lowest power first, by Horner's scheme, into ``work[POINT]``."""
    for m in range(n):
        value = run.pieces[piece, 1 + degree * n + m]
        for power in range(degree - 1, -1, -1):
            value = fma(value, theta, run.pieces[piece, 1 + power * n + m])
        run.work[POINT, m] = value


@compiled_subset
def _store(run: Run, number: int, t: float, source: int) -> None:
    run.rows[number, 0] = t
    for m in range(run.rows.shape[1] - 1):
        run.rows[number, 1 + m] = run.work[source, m]
