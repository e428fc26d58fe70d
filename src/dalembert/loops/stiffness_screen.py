"""Screen of starts of cases: whether none of them can have modes so fast that explicit steps might be held up."""

from __future__ import annotations

from typing import NamedTuple

from ..lanes.case_loading import fill_by_number
from ..lanes.sweep_arguments import Columns
from ..subset.arguments import Address, IntVector, Matrix
from ..subset.compiled_subset import call_code, call_test, compiled_subset, row

_DIFFERENCE = 6e-6
"""Share of the largest component by which points of differences are apart, as in `dalembert.steps.method_choice`."""


class ScreenKernels(NamedTuple):
    """Addresses of code in lanes: constants, starts, right-hand sides, and the test of what cases are made from."""

    prepare: Address
    start: Address
    rhs: Address
    check: Address


class ScreenArguments(NamedTuple):
    """Arguments of the loop.

    Attributes
    ----------
    cases : (lanes,)
        Numbers of the cases to look at.
    parameters, given, checks : int
        Numbers of parameters, of given values, and of checks of starts.
    largest : float
        Product of the largest sum of a row of the Jacobian and the duration of a case up to which it passes.
    clock, values, constants, begun : (2, lanes), (max(n_p, n_given), lanes), (n_c, lanes), (n_y + checks, lanes)
        Are overwritten, as the following.
    point, above, below, sums, size : (n_y, lanes), ..., (1, lanes)
    """

    kernels: ScreenKernels
    columns: Columns
    cases: IntVector
    parameters: int
    given: int
    checks: int
    largest: float
    clock: Matrix
    values: Matrix
    constants: Matrix
    begun: Matrix
    point: Matrix
    above: Matrix
    below: Matrix
    sums: Matrix
    size: Matrix


@compiled_subset
def LOOP(arguments: ScreenArguments) -> int:
    """Return 1 where all cases can start and are passed, else 0: then more has to be found out."""
    sums, clock = arguments.sums, arguments.clock
    if not _begin(arguments):
        return 0
    for column in range(sums.shape[0]):
        _add_column(arguments, column)
    for lane in range(clock.shape[1]):
        most = arguments.largest / abs(clock[1, lane] - clock[0, lane])  # infinite without duration
        for m in range(sums.shape[0]):
            if not sums[m, lane] < most:
                return 0
    return 1


@compiled_subset
def _begin(arguments: ScreenArguments) -> bool:
    """Make constants and states of the cases, and points of differences; return whether all can start."""
    kernels, columns, cases, check = arguments.kernels, arguments.columns, arguments.cases, arguments.kernels.check
    clock, values, begun, n = arguments.clock, arguments.values, arguments.begun, arguments.point.shape[0]
    constants, every = row(arguments.constants, 0), (1 << clock.shape[1]) - 1
    fill_by_number(columns, 0, clock, 2, cases)
    fill_by_number(columns, 2, values, arguments.parameters, cases)
    fine = call_test(check, row(clock, 0), 2, 0, 0, 0) & call_test(check, row(values, 0), arguments.parameters, 0, 0, 0)
    call_code(kernels.prepare, row(values, 0), 0, 0, 0, constants)
    fill_by_number(columns, 2 + arguments.parameters, values, arguments.given, cases)
    fine &= call_test(check, constants, arguments.constants.shape[0], 0, 0, 0)
    fine &= call_test(check, row(values, 0), arguments.given, 0, 0, 0)
    call_code(kernels.start, row(clock, 0), row(values, 0), constants, 0, row(begun, 0))
    fine &= call_test(check, row(begun, 0), n, arguments.checks, 0, 0)
    for lane in range(clock.shape[1]):
        largest = 1.0
        for m in range(n):
            largest = max(largest, abs(begun[m, lane]))
            arguments.point[m, lane], arguments.sums[m, lane] = begun[m, lane], 0.0
        arguments.size[0, lane] = _DIFFERENCE * largest
    return fine == every


@compiled_subset
def _add_column(arguments: ScreenArguments, column: int) -> None:
    """Add the sizes of a column of the Jacobian to the sums of its rows."""
    kernels, point, begun, size = arguments.kernels, arguments.point, arguments.begun, arguments.size
    above, below, clock = arguments.above, arguments.below, row(arguments.clock, 0)
    constants = row(arguments.constants, 0)
    for lane in range(size.shape[1]):
        point[column, lane] = begun[column, lane] + size[0, lane]
    call_code(kernels.rhs, clock, row(point, 0), constants, 0, row(above, 0))
    for lane in range(size.shape[1]):
        point[column, lane] = begun[column, lane] - size[0, lane]
    call_code(kernels.rhs, clock, row(point, 0), constants, 0, row(below, 0))
    for lane in range(size.shape[1]):
        point[column, lane] = begun[column, lane]
        for m in range(point.shape[0]):
            arguments.sums[m, lane] += abs(above[m, lane] - below[m, lane]) / (2.0 * size[0, lane])
