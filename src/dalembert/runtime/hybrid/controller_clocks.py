"""Clocks of the controllers of cases with contacts, and what controllers do between phases."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...integrators.problem import SamplingClock
from ...ir.interpret import interpret_rows
from ...methods.step_constants import SMALLEST_OF_TIME
from ..sampling import NoInstants, Sampling

__all__ = ["ControllerClocks"]


@final
class ControllerClocks:
    """The controllers of some cases, which run phase by phase.

    Within a phase the engine of its mode lets controllers act; where a phase ends, they act before the decision.

    Parameters
    ----------
    sampling : Sampling
        On coordinates, rates and first-order states.
    t0, t1 : ndarray (k,)
        Spans of the cases [s].
    p : ndarray (k, n_p)
        Parameters of the scene.
    wanted : ndarray (n_t,) or None
        Times to record [s].

    Attributes
    ----------
    clocks : list of SamplingClock
        One a case.
    """

    def __init__(
        self, sampling: Sampling, t0: FloatArray, t1: FloatArray, p: FloatArray, wanted: FloatArray | None
    ) -> None:
        self._sampling, self._schedules, self._t1 = sampling, sampling.schedules(p), t1.tolist()
        self.clocks = [SamplingClock(t, wanted=wanted) for t in t0.tolist()]
        self._senseless = np.zeros(len(self.clocks), np.bool_)

    def senseless(self) -> NDArray[np.bool_]:
        """Return of which cases (k,) the periods or offsets make no sense; nothing acts in these."""
        for i, clock in enumerate(self.clocks):
            try:
                self._due(i, clock.origin)
            except NoInstants:
                self._senseless[i] = True
        return self._senseless

    def _due(self, i: int, t: float) -> int:
        """Return which controllers of a case are to act at a time."""
        clock, t1 = self.clocks[i], self._t1[i]
        if t == t1 != clock.origin or self._senseless[i] or not np.isfinite(t + t1):
            return 0
        times, acts = self._sampling.instants(self._schedules[i], t, t1, clock, clock.wanted)
        near = SMALLEST_OF_TIME * max(abs(t), abs(t1))
        return int(acts[0]) if len(times) and times[0] <= t + near else 0

    def acted(self, some: NDArray[np.intp], t: FloatArray, x: FloatArray, p: FloatArray) -> FloatArray:
        """Return the variables (m, 2 n_q + n_z) of some cases after what controllers are to do at times t (m,)."""
        numbers = np.array([self._due(i, now) for i, now in zip(some.tolist(), t.tolist(), strict=True)], np.int64)
        return self._sampling.act_rows(numbers, t, x, p, interpret_rows)

    def act(self, some: NDArray[np.intp], t: FloatArray, x: FloatArray, p: FloatArray) -> FloatArray:
        """Return the same, and take down that controllers have acted."""
        after = self.acted(some, t, x, p)
        for i, now in zip(some.tolist(), t.tolist(), strict=True):
            self.clocks[i].last = max(self.clocks[i].last, now)
        return after

    def reached(self, some: NDArray[np.intp], t: FloatArray) -> None:
        """Take down that cases have run up to times (m,), at which controllers have yet to act."""
        for i, now in zip(some.tolist(), t.tolist(), strict=True):
            clock = self.clocks[i]
            near = SMALLEST_OF_TIME * max(abs(now), abs(self._t1[i]))
            clock.last = max(clock.last, now - 2.0 * near)
