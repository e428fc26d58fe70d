"""Arguments of the loop over lanes."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from typing import NamedTuple, final

import numpy as np

from ..arrays import Column
from ..once import once
from ..stops.stops import StopTable
from ..subset.arguments import NO_CODE, Address, AddressTable, AddressVector, FlagMatrix, IntVector, Matrix, Vector
from ..subset.packing import address_of, constant_group
from .row_steps import RowSteps
from .workspace import EventKernels, EventWorkspace, LaneState


class SweepKernels(NamedTuple):
    """Addresses of what the loop over lanes calls, 0 for what there is not.

    The step, what fills in its memory before the first step, the projections, constants from parameters, states from
    given values, the function that accepts steps of all lanes at once (`dalembert.codegen.lane_runs`), and the
    test of what cases are made from (`dalembert.codegen.lane_runs`).
    """

    step: Address
    begin: Address
    position: Address
    velocity: Address
    prepare: Address
    start: Address
    advance: Address
    check: Address


class CaseShape(NamedTuple):
    """Sizes of cases and of the outputs of a step.

    A step writes the state, of ``n`` components, then integrals of the ``events_with_series``, its size, its check,
    ``memory`` outputs that the next step reads, and polynomials of a ``degree``: in the fraction of the step where it
    has a memory, else in time. A case has so many ``parameters``, ``given`` values and ``checks`` of these; there are
    so many ``cases``, of which a thread takes a ``share`` at a time.
    """

    n: int
    events_with_series: int
    degree: int
    memory: int
    parameters: int
    given: int
    checks: int
    cases: int
    share: int


class Columns(NamedTuple):
    """Addresses of the values of start, end, parameters and given values, and the stride from case to case: 0 or 1."""

    address: AddressVector
    stride: IntVector


@once
def no_columns() -> Columns:
    """Return an empty table."""
    return constant_group(Columns(AddressTable(), np.zeros(0, np.int64)))


@final
class ColumnTable:
    """The words of `Columns` for some columns, and copies of those of one value.

    Attributes
    ----------
    fields : tuple of int
        What takes the place of `Columns` in packed arguments; the table must live as long as it is used.
    """

    def __init__(self, columns: Sequence[Column]) -> None:
        count, self._columns = len(columns), columns
        numbers, varied = [], []
        for i, column in enumerate(columns):
            if isinstance(column, float):
                numbers.append(column)
            elif column.size == 1:
                numbers.append(column.item())
            else:
                numbers.append(0.0)
                varied.append((i, column))
        self._values = array("d", numbers)  # made in a third of the time of NumPy's
        first, _ = self._values.buffer_info()
        words = [*range(first, first + 8 * count, 8), *[0] * count]
        for i, values in varied:
            assert values.dtype == np.float64 and values.flags.c_contiguous
            words[i], words[count + i] = address_of(values), 1
        self._words = array("q", words)
        place, _ = self._words.buffer_info()
        self.fields = place, count, place + 8 * count, count


class CaseRows(NamedTuple):
    """Cases as rows, where no kernel makes their constants, and records of their steps; with no rows where not so.

    Attributes
    ----------
    times, states, constants : (k, n_t), (k, n_y), (k, n_c), or one row each for all cases
        Times from start to end, in order; first states and constants.
    record : (k * room, 2 + n_y) or (k * n_t, 1 + n_y)
        Gets for each case the steps, where each began, its size and the state there, or the time and the state where
        those began that pass over the times; behind the last step of a case that began, steps of size 0 at its end.
    """

    times: Matrix
    states: Matrix
    constants: Matrix
    record: Matrix


@once
def no_rows() -> CaseRows:
    """Return empty rows, for cases that are given as columns."""
    return constant_group(CaseRows(*(np.empty((0, 0)),) * len(CaseRows._fields)))


class PartSamples(NamedTuple):
    """Samples of cases whose runs are parts of longer motions: taken inside steps, as variables; none without times.

    A run records what lies before its end; what lies there shows the motion that follows, and is left to the caller.

    Attributes
    ----------
    times : (m,)
        Times to record.
    motion, next : (k,), (k,)
        The motion of each case, and its next sample.
    x : (n m, n_x)
        Gets coordinates, rates and first-order states, motion by motion.
    expand : Address
        Code of these.
    clock, states, posed : (1, lanes), (n_y, lanes), (n_x, lanes)
        Are overwritten.
    """

    times: Vector
    motion: IntVector
    next: IntVector
    x: Matrix
    expand: Address
    clock: Matrix
    states: Matrix
    posed: Matrix


@once
def no_part_samples() -> PartSamples:
    """Return empty fields, for cases that are whole motions."""
    none, nothing = np.zeros(0, np.int64), np.empty((0, 0))
    return constant_group(PartSamples(np.empty(0), none, none, nothing, NO_CODE, *(nothing,) * 3))


class KeptStarts(NamedTuple):
    """Starts of cases that a run keeps: (k, ...), or (0, 0) for none.

    Attributes
    ----------
    constants, states : (k, n_c), (k, n_y)
        Get constants and first states, also of cases that cannot begin.
    """

    constants: Matrix
    states: Matrix

    @staticmethod
    def nothing() -> KeptStarts:
        """Return empty arrays."""
        return _NO_STARTS


_NO_STARTS = KeptStarts(np.empty((0, 0)), np.empty((0, 0)))


class SweepArguments(NamedTuple):
    """Arguments of the loop over lanes.

    Attributes
    ----------
    limits : (1, ...)
        The largest step, the number of attempts, and what else the settings have behind step and direction: what the
        step reads, and last the tolerances.
    turn : (1,)
        The next case, shared by threads.
    t_eval : (m,)
        Times to record.
    out, ends, samples : (k, n_y), (k, 3) or (k, 5), (k, m * n_y)
        Get final states; final time, status and steps, and where there is room attempts and rows of a record; states at
        the times to record.
    inside : (k, m) or (0, 0)
        Gets the samples that were interpolated.
    kept : KeptStarts
        Gets constants and first states.
    happened : (k, 3 n_events)
        Gets numbers of the events, and the times of the first and the last.
    totals : (k, n_running)
        Minima, maxima and integrals are continued in it. With events or any of these, a step writes its polynomials.
    stops : StopTable
        Times at which steps end, knots of inputs among them.
    steps : (m, ...) or (0, 0)
        Gets the steps of a case that is alone (`dalembert.lanes.step_records`).
    rows : CaseRows
        Cases that are given so, in place of columns.
    part : PartSamples
        Samples of cases that are parts of motions, in place of ``t_eval``.
    implicit : RowSteps
        Memory of steps of the implicit method.
    """

    kernels: SweepKernels
    shape: CaseShape
    limits: Matrix
    columns: Columns
    turn: IntVector
    t_eval: Vector
    out: Matrix
    ends: Matrix
    samples: Matrix
    inside: FlagMatrix
    kept: KeptStarts
    state: LaneState
    events: EventKernels
    workspace: EventWorkspace
    happened: Matrix
    totals: Matrix
    stops: StopTable
    steps: Matrix
    rows: CaseRows
    part: PartSamples
    implicit: RowSteps
