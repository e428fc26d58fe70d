"""Screen of cases for values that may have changed their sign between the start and the end of a run."""

from __future__ import annotations

from typing import NamedTuple

from ..methods.status import Status
from ..subset.arguments import Address, Matrix
from ..subset.compiled_subset import call_code, compiled_subset, row


class SignArguments(NamedTuple):
    """Arguments of the loop.

    Attributes
    ----------
    kernel : Address
        Values at a time and a state, with constants.
    spans, ends : (k, 2), (k, 3)
        Starts; final times and statuses.
    begins, constants, finals : (k, n_y), (k, n_c), (k, n_y)
        First states, constants, and final states.
    least : float
        Size of values whose sign is not taken for certain.
    clock, states, values, first, last : (1, lanes), (n_y, lanes), (n_c, lanes), (n, lanes), (n, lanes)
        Are overwritten.
    """

    kernel: Address
    spans: Matrix
    ends: Matrix
    begins: Matrix
    constants: Matrix
    finals: Matrix
    least: float
    clock: Matrix
    states: Matrix
    values: Matrix
    first: Matrix
    last: Matrix


@compiled_subset
def LOOP(arguments: SignArguments) -> int:
    """Return 1 where every case succeeded and no value has another sign at its end, else 0."""
    spans, ends, constants, values = arguments.spans, arguments.ends, arguments.constants, arguments.values
    first, last, lanes, count = arguments.first, arguments.last, arguments.clock.shape[1], arguments.ends.shape[0]
    begin = 0
    while begin < count:
        for lane in range(lanes):
            i = min(begin + lane, count - 1)
            if ends[i, 1] != Status.SUCCESS:
                return 0
            for m in range(constants.shape[1]):
                values[m, lane] = constants[i, m]
        _evaluate(arguments, spans, arguments.begins, begin, first)
        _evaluate(arguments, ends, arguments.finals, begin, last)
        for m in range(first.shape[0]):
            for lane in range(lanes):
                if not first[m, lane] * last[m, lane] > arguments.least:
                    return 0
        begin += lanes
    return 1


@compiled_subset
def _evaluate(arguments: SignArguments, times: Matrix, states: Matrix, begin: int, found: Matrix) -> None:
    """Evaluate the kernel for the cases from a number on, as many as there are lanes."""
    clock, rows = arguments.clock, arguments.states
    for lane in range(clock.shape[1]):
        i = min(begin + lane, arguments.ends.shape[0] - 1)
        clock[0, lane] = times[i, 0]
        for m in range(rows.shape[0]):
            rows[m, lane] = states[i, m]
    call_code(arguments.kernel, row(clock, 0), row(rows, 0), row(arguments.values, 0), 0, row(found, 0))
