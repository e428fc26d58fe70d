"""Starts of cases in lanes, made for screens of cases from the columns that are given."""

from __future__ import annotations

from typing import NamedTuple

from ..lanes.case_loading import fill_by_number
from ..lanes.sweep_arguments import Columns
from ..subset.arguments import Address, IntVector, Matrix
from ..subset.compiled_subset import call_code, call_test, compiled_subset, row


class StartKernels(NamedTuple):
    """Addresses of code in lanes: constants, starts, and the test of what cases are made from."""

    prepare: Address
    start: Address
    check: Address


class ScreenedStarts(NamedTuple):
    """Starts of one case a lane.

    Attributes
    ----------
    cases : (lanes,)
        Numbers of the cases.
    parameters, given, n, checks : int
        Numbers of parameters, of given values, of components of the state, and of checks of starts.
    clock, values, constants, begun : (2, lanes), (max(n_p, n_given), lanes), (n_c, lanes), (n_y + checks, lanes)
        Are overwritten: start and end, values, constants, and states with their checks.
    """

    kernels: StartKernels
    columns: Columns
    cases: IntVector
    parameters: int
    given: int
    n: int
    checks: int
    clock: Matrix
    values: Matrix
    constants: Matrix
    begun: Matrix


@compiled_subset
def starts_are_made(starts: ScreenedStarts) -> bool:
    """Make constants and states of the cases; return whether all of them can start."""
    kernels, columns, cases, check = starts.kernels, starts.columns, starts.cases, starts.kernels.check
    clock, values, begun = starts.clock, starts.values, starts.begun
    constants, every = row(starts.constants, 0), (1 << clock.shape[1]) - 1
    fill_by_number(columns, 0, clock, 2, cases)
    fill_by_number(columns, 2, values, starts.parameters, cases)
    fine = call_test(check, row(clock, 0), 2, 0, 0, 0) & call_test(check, row(values, 0), starts.parameters, 0, 0, 0)
    call_code(kernels.prepare, row(values, 0), 0, 0, 0, constants)
    fill_by_number(columns, 2 + starts.parameters, values, starts.given, cases)
    fine &= call_test(check, constants, starts.constants.shape[0], 0, 0, 0)
    fine &= call_test(check, row(values, 0), starts.given, 0, 0, 0)
    call_code(kernels.start, row(clock, 0), row(values, 0), constants, 0, row(begun, 0))
    fine &= call_test(check, row(begun, 0), starts.n, starts.checks, 0, 0)
    return fine == every
