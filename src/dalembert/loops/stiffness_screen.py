"""Screen of starts of cases: whether none of them can have modes so fast that explicit steps might be held up."""

from __future__ import annotations

from typing import NamedTuple

from ..subset.arguments import Address, Matrix
from ..subset.compiled_subset import call_code, compiled_subset, row
from .screened_starts import ScreenedStarts, starts_are_made

_DIFFERENCE = 6e-6
"""Share of the largest component by which points of differences are apart, as in `dalembert.steps.method_choice`."""


class ScreenArguments(NamedTuple):
    """Arguments of the loop.

    Attributes
    ----------
    starts : ScreenedStarts
        Of the cases to look at.
    rhs : Address
        Right-hand sides.
    largest : float
        Product of the largest sum of a row of the Jacobian and the duration of a case up to which it passes.
    point, above, below, sums, size : (n_y, lanes), ..., (1, lanes)
        Are overwritten.
    """

    starts: ScreenedStarts
    rhs: Address
    largest: float
    point: Matrix
    above: Matrix
    below: Matrix
    sums: Matrix
    size: Matrix


@compiled_subset
def LOOP(arguments: ScreenArguments) -> int:
    """Return 1 where all cases can start and are passed, else 0: then more has to be found out."""
    sums, clock = arguments.sums, arguments.starts.clock
    if not starts_are_made(arguments.starts):
        return 0
    _begin(arguments)
    for column in range(sums.shape[0]):
        _add_column(arguments, column)
    for lane in range(clock.shape[1]):
        most = arguments.largest / abs(clock[1, lane] - clock[0, lane])  # infinite without duration
        for m in range(sums.shape[0]):
            if not sums[m, lane] < most:
                return 0
    return 1


@compiled_subset
def _begin(arguments: ScreenArguments) -> None:
    """Make the points of differences."""
    begun = arguments.starts.begun
    for lane in range(begun.shape[1]):
        largest = 1.0
        for m in range(arguments.point.shape[0]):
            largest = max(largest, abs(begun[m, lane]))
            arguments.point[m, lane], arguments.sums[m, lane] = begun[m, lane], 0.0
        arguments.size[0, lane] = _DIFFERENCE * largest


@compiled_subset
def _add_column(arguments: ScreenArguments, column: int) -> None:
    """Add the sizes of a column of the Jacobian to the sums of its rows."""
    point, begun, size = arguments.point, arguments.starts.begun, arguments.size
    above, below, clock = arguments.above, arguments.below, row(arguments.starts.clock, 0)
    constants = row(arguments.starts.constants, 0)
    for lane in range(size.shape[1]):
        point[column, lane] = begun[column, lane] + size[0, lane]
    call_code(arguments.rhs, clock, row(point, 0), constants, 0, row(above, 0))
    for lane in range(size.shape[1]):
        point[column, lane] = begun[column, lane] - size[0, lane]
    call_code(arguments.rhs, clock, row(point, 0), constants, 0, row(below, 0))
    for lane in range(size.shape[1]):
        point[column, lane] = begun[column, lane]
        for m in range(point.shape[0]):
            arguments.sums[m, lane] += abs(above[m, lane] - below[m, lane]) / (2.0 * size[0, lane])
