"""Cases of a sweep: the input of engines, and the arrays of results that they write."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import AnyColumn, Column, FloatArray, part_of
from ..methods.status import Status
from ..steps.problem import IntegrationProblem
from ..stops.input_records import InputRecords
from ..stops.stops import CaseStops
from .sweep_arguments import CaseRows, ColumnTable

if TYPE_CHECKING:
    from ..events.event_code import EventCode
    from ..reduction.starting import Start
    from .sweep_arguments import PartSamples


@final
@dataclass(eq=False)  # frozen ones take microseconds longer to make, and nothing changes these
class CaseBlock:
    """Cases to be integrated together: states y (k, n_y), constants c (k, n_c), spans (k, 2), and common settings.

    ``watch`` are events and reductions, ``inputs`` those that have knots, or None. ``carried`` (k, 2 n_events) is as in
    `CaseColumns`.
    """

    y: FloatArray
    c: FloatArray
    spans: FloatArray
    t_eval: FloatArray
    rtol: float
    atol: float
    max_step: float
    max_steps: int
    watch: EventCode | None = None
    inputs: InputRecords | None = None
    carried: FloatArray | None = None

    def times(self, number: int) -> slice:
        """Return which times to record lie in the span of a case: some, where it is part of a longer motion."""
        t0, t1 = self.spans[number].tolist()
        forward = 1.0 if t1 >= t0 else -1.0
        first = int(np.sum((self.t_eval - t0) * forward < 0.0))
        return slice(first, first + int(np.sum((self.t_eval[first:] - t1) * forward <= 0.0)))

    def problem(self, number: int, *, t_eval: FloatArray | None = None, dense: bool = False) -> IntegrationProblem:
        """Return a case alone."""
        return IntegrationProblem(
            t0=float(self.spans[number, 0]),
            t1=float(self.spans[number, 1]),
            y0=self.y[number],
            constants=self.c[number],
            rtol=self.rtol,
            atol=self.atol,
            t_eval=t_eval,
            max_step=self.max_step,
            max_steps=self.max_steps,
            dense=dense,
            inputs=None if self.inputs is None else self.inputs.case(number),
        )


@final
@dataclass(eq=False)  # for the same reason
class CaseColumns:
    """Cases as they are given, and common settings: columns of one value for all cases, or one each.

    Attributes
    ----------
    count : int
        Number of cases, k.
    spans, parameters, given : tuple of float, ndarray (1,) or (k,)
        Start and end, as arrays; parameters in the order of the layout; initial values in the order of ``start.given``.
    start : Start
        From given values to states.
    first_step : float or None
        Size of the first step, None where it is chosen; of steps of a Runge-Kutta pair, `SweepKernels.begin` has it.
    recorded : int
        Rows for records of steps, and of occurrences of events, of a case that is alone; 0 records none.
    carried : ndarray (k, 2 n_events) or None
        Signs of events with which cases continue and end, and which were seen (`EventWorkspace.carried`).
    stops : CaseStops or None
        Where runs stop beside knots; then `inputs` are there, be they without records.
    constants_at : function or None
        Constants (k m, n_c) at times (k, m) of each case, where they change along a run.
    rows : CaseRows or None
        States and constants of the cases, in place of parameters and given values, and of `start`.
    part : PartSamples or None
        Samples of cases that are parts of motions, in place of ``t_eval``.
    """

    count: int
    spans: tuple[FloatArray, ...]
    parameters: tuple[Column, ...]
    given: tuple[Column, ...]
    start: Start | None
    t_eval: FloatArray
    rtol: float
    atol: float
    max_step: float
    max_steps: int
    watch: EventCode | None = None
    inputs: InputRecords | None = None
    first_step: float | None = None
    recorded: int = 0
    carried: FloatArray | None = None
    stops: CaseStops | None = None
    constants_at: Callable[[FloatArray], FloatArray] | None = None
    rows: CaseRows | None = None
    part: PartSamples | None = None

    _table: ColumnTable | None = field(default=None, init=False)

    def some(self, numbers: Sequence[int]) -> CaseColumns:
        """Return the cases of these numbers, which are without inputs and stops."""
        assert self.inputs is None and self.stops is None and self.rows is None and self.part is None
        places = [*numbers]

        def of(columns: tuple[AnyColumn, ...]) -> tuple[AnyColumn, ...]:
            return tuple([part_of(column, places) for column in columns])

        return replace(
            self,
            count=len(places),
            spans=of(self.spans),
            parameters=of(self.parameters),
            given=of(self.given),
            carried=None if self.carried is None else self.carried[places],
        )

    @property
    def table(self) -> ColumnTable:
        """Where the columns are, for loops that read them; made before threads need it."""
        if self._table is None:
            self._table = ColumnTable((*self.spans, *self.parameters, *self.given))
        return self._table


_AT_START = {"minimum": np.inf, "maximum": -np.inf, "mean": 0.0}


@final
@dataclass(eq=False)
class BlockResult:
    """Arrays to write to: final states (k, n_y), ends (k, 3) = final time, status, steps, samples (k, n_t, n_y).

    ``happened`` (k, 3 n_events) are the number of each event and the times of its first and last occurrence,
    ``totals`` (k, n_running) minima, maxima and integrals.
    """

    y: FloatArray
    ends: FloatArray
    samples: FloatArray
    happened: FloatArray
    totals: FloatArray

    @classmethod
    def empty(cls, count: int, size: int, n_times: int, events: int = 0, reductions: int = 0) -> BlockResult:
        """Return results of cases that did not run, for a size of states, times to record, events and reductions."""
        samples = np.full((count, n_times, size), np.nan) if n_times else np.empty((count, 0, size))
        happened = totals = np.empty((count, 0))
        if events:
            happened, _ = cls.at_start(count, events, ())
        if reductions:
            totals = np.full((count, reductions), np.nan)
        return cls(np.zeros((count, size)), np.zeros((count, 3)), samples, happened, totals)

    @staticmethod
    def at_start(count: int, events: int, kinds: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Return the records of events, and minima, maxima and integrals, before the motions."""
        happened, totals = np.empty((count, 3 * events)), np.empty((count, len(kinds)))
        if events:
            happened[:] = np.nan
            happened[:, ::3] = 0.0
        if kinds:
            totals[:] = [_AT_START[kind] for kind in kinds]
        return happened, totals

    def __getitem__(self, cases: slice | NDArray[np.bool_]) -> BlockResult:
        """Return the results of some cases: views for a slice, copies for a mask."""
        return BlockResult(*(getattr(self, name)[cases] for name in self.__dataclass_fields__))

    def refuse(self, cases: NDArray[np.bool_], status: Status) -> None:
        """Set the status of some cases, and NaN for all their results."""
        refused = self.empty(int(np.sum(cases)), self.y.shape[1], self.samples.shape[1], self.happened.shape[1] // 3)
        refused.y[...], refused.ends[...] = np.nan, (np.nan, status, 0)
        self[cases] = replace(refused, totals=np.full_like(self.totals[cases], np.nan))

    def __setitem__(self, cases: NDArray[np.bool_], other: BlockResult) -> None:
        for name in self.__dataclass_fields__:
            getattr(self, name)[cases] = getattr(other, name)
