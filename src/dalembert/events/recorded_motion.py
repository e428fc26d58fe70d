"""Motions of recorded steps: accepted steps, continuous output and occurrences of events from `step_records`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..frozen import frozen
from ..lanes.step_records import END_AT, ENDED_AT, FIRST_AT, START_AT
from ..methods.status import Status
from ..steps.dense_output import DenseOutput, PiecewisePolynomial
from ..steps.problem import IntegrationProblem, Solution
from ..steps.projection import end_in
from .event_rules import recorded_after

Settle = Callable[[FloatArray, FloatArray], FloatArray]
"""From times (k,) and interpolated states (k, n_y) to states on the constraints."""


@final
@frozen(eq=False)
class Occurrence:
    """One event: its number, time, states (n_y,) before and after, and the sign that its expression changed to."""

    event: int
    t: float
    before: FloatArray
    after: FloatArray
    sign: int


@final
class RecordedCase:
    """A run with events, as its steps were recorded.

    Parameters
    ----------
    rows : ndarray (k, ...)
        Records of the steps (`dalembert.lanes.step_records`).
    occurrences : ndarray (m, OCCURRENCE)
        Rows of ``EventWorkspace.occurrences``, in order, with numbers of the steps.
    last : ndarray (n_y,)
        State where the motion ends.
    status : Status
    counts : (int, int, int)
        Accepted steps, rejected attempts, evaluations.
    in_time : bool
        Whether polynomials are in time, and not in the fraction of the step.
    jumping : sequence of bool
        Whether each event maps the state.
    """

    def __init__(
        self,
        rows: FloatArray,
        occurrences: FloatArray,
        last: FloatArray,
        status: Status,
        counts: tuple[int, int, int],
        *,
        in_time: bool,
        jumping: Sequence[bool],
    ) -> None:
        n = len(last)
        self._status, self._counts = status, counts
        self._rows, self._occurrences, self._in_time = rows, occurrences, in_time
        self._polynomials = _polynomials(rows, n)
        self._ended, self._ends = rows[:, ENDED_AT], rows[:, FIRST_AT + n : FIRST_AT + 2 * n]
        self._moved: NDArray[np.bool_] = self._ended != rows[:, START_AT]
        starts = self._polynomials[:, :, 0]
        self._first = starts[0] if len(rows) else last
        self._after = np.concatenate([starts[1:], last[np.newaxis]]) if len(rows) else starts
        self._at_stop = np.zeros(len(occurrences), np.bool_)
        self._jumped = np.zeros(len(rows), np.bool_)
        stopped = -1
        for i, (event, _, _, stops, step) in enumerate(occurrences.tolist()):
            stopped = int(step) if stops >= 1.0 else stopped
            if int(step) == stopped:  # all that follow in the step happen together
                self._at_stop[i] = True
                self._jumped[stopped] |= jumping[int(event)]
        if status is Status.EVENT_STATE:  # the constraints rejected the map
            self._jumped[-1:] = False

    def solution(self, problem: IntegrationProblem, settle: Settle, *, right: bool) -> Solution:
        """Return the solution; where a state jumps, its accepted steps hold the time twice.

        Of the states on both sides of a stop they hold the first, or where `right` the second.
        """
        n, ends = len(self._first), self._ends
        if right:
            ends = np.where(self._jumped[:, np.newaxis], ends, self._after)
        held = np.column_stack([self._moved, self._jumped]).ravel()
        t = np.append(float(problem.t0), np.repeat(self._ended, 2)[held])
        y = np.concatenate(
            [self._first[np.newaxis], np.stack([ends, self._after], axis=1).reshape(2 * len(ends), n)[held]]
        )
        dense = self._dense(float(problem.t0)) if problem.dense or problem.t_eval is not None else None
        end = float(t[-1])
        if problem.t_eval is not None:
            t, y = recorded_states(settle, problem.t_eval, dense, t, y)
        steps, rejected, evaluations = self._counts
        return Solution(
            status=self._status,
            t=t,
            y=y,
            steps=steps,
            rejected=rejected,
            evaluations=evaluations,
            dense=dense if problem.dense else None,
            end=end,
        )

    def _dense(self, t0: float) -> PiecewisePolynomial | None:
        """Return the continuous output from a time on; None of a motion that took no time."""
        if not np.any(self._moved):
            return None
        rows, n = (self._rows if self._moved.all() else self._rows[self._moved]), len(self._first)
        return PiecewisePolynomial(
            np.append(t0, rows[:, ENDED_AT]), partial(step_polynomials, rows, n, in_time=self._in_time)
        )

    def occurrences(self, settle: Settle) -> list[Occurrence]:
        """Return what occurred, in the order of time."""
        if not len(self._occurrences):
            return []
        step = self._occurrences[:, 4].astype(np.intp)
        times = np.where(self._at_stop, self._ended[step], self._occurrences[:, 1])
        before = self._ends[step].copy()
        inside = np.flatnonzero(times != self._ended[step])
        if len(inside):
            before[inside] = settle(times[inside], self._within(step[inside], times[inside]))
        after = before.copy()
        after[self._jumped[step] & self._at_stop] = self._after[step[self._jumped[step] & self._at_stop]]
        events, signs = self._occurrences[:, [0, 2]].astype(int).T.tolist()
        return [Occurrence(*row) for row in zip(events, times.tolist(), before, after, signs, strict=True)]

    def _within(self, step: NDArray[np.intp], times: FloatArray) -> FloatArray:
        """Return states (k, n_y) at times within steps."""
        known, number = np.unique(step, return_inverse=True)
        rows = self._rows[known]
        edges = rows[:, [START_AT, ENDED_AT]][number]
        theta = (times - edges[:, 0]) / (edges[:, 1] - edges[:, 0])
        coefficients = step_polynomials(rows, len(self._first), in_time=self._in_time)
        return PiecewisePolynomial(np.zeros(len(known) + 1), coefficients).within(number, np.clip(theta, 0.0, 1.0))


def _polynomials(rows: FloatArray, n: int) -> FloatArray:
    """Return the polynomials (k, n, degree + 1) of records."""
    terms = (rows.shape[1] - FIRST_AT - 2 * n) // n if n else 1
    return rows[:, FIRST_AT + 2 * n :].reshape(len(rows), n, terms)


def step_polynomials(rows: FloatArray, n: int, *, in_time: bool) -> FloatArray:
    """Return coefficients (k, degree + 1, n) of recorded steps in the fraction of each, up to where events cut it.

    As where events are searched, polynomials end in the states in which the steps ended.
    """
    polynomials = _polynomials(rows, n)
    whole, powers = (rows[:, END_AT] - rows[:, START_AT])[:, np.newaxis], np.arange(polynomials.shape[2])
    scaled = polynomials * (whole**powers)[:, np.newaxis] if in_time else polynomials
    found = scaled.transpose(0, 2, 1).copy()
    if n:
        end_in(rows[:, FIRST_AT : FIRST_AT + n], found)
    share = (rows[:, ENDED_AT] - rows[:, START_AT])[:, np.newaxis] / whole
    found *= (share**powers)[:, :, np.newaxis]
    return found


def recorded_states(
    settle: Settle, wanted: FloatArray, dense: DenseOutput | None, t: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the times to record that a motion reached, and the states there (k, n_y): after a jump at that time.

    Parameters
    ----------
    settle
    wanted : ndarray (m,)
        Times to record, in the order of the motion.
    dense
        The motion, None where it took no time.
    t, y
        Accepted steps, which hold the time of a jump twice.
    """
    forward = 1.0 if t[-1] >= t[0] else -1.0
    reached = wanted[(wanted - t[-1]) * forward <= 0.0]
    at = reached.copy()
    for jumped in t[1:][t[1:] == t[:-1]]:
        k = int(np.searchsorted(reached * forward, jumped * forward))
        while k > 0 and recorded_after(reached[k - 1], jumped, forward):
            k -= 1
            at[k] = jumped
    found = np.tile(y[0], (len(reached), 1))
    if dense is not None and len(reached):
        found = settle(at, dense(at))
    found[at == t[0]] = y[0]
    found[at == t[-1]] = y[-1]
    return reached, found
