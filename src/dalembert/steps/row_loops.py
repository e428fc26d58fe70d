"""Loops over rows: projections of recorded states, and kernels at many instants, in as many lanes as there are."""

from __future__ import annotations

from typing import NamedTuple

from ..subset.arguments import Address, FlagMatrix, IntVector, Matrix, Vector
from ..subset.compiled_subset import call_code, compiled_subset, row
from .projection import NONE, PENDING, correct


class SampleArguments(NamedTuple):
    """Arguments of the loop.

    Attributes
    ----------
    position, velocity : address
        The projections, 0 for none.
    case_constants : (k, n_c) or (k * m, n_c)
        Constants of the cases, or of each sample.
    t_eval : (m,)
        Times [s].
    inside : (k, m)
        Which of the samples are to be corrected.
    samples : (k, m * n_y)
    clock, states, constants, delta : (1, lanes), (n_y, lanes), (n_c, lanes), (n_y, lanes)
        Are overwritten.
    number, mark : (lanes,)
        Are overwritten.
    rtol, atol : float
        Tolerances of the steps.
    """

    position: Address
    velocity: Address
    case_constants: Matrix
    t_eval: Vector
    inside: FlagMatrix
    samples: Matrix
    clock: Matrix
    states: Matrix
    constants: Matrix
    delta: Matrix
    number: IntVector
    mark: IntVector
    rtol: float
    atol: float


@compiled_subset
def LOOP(arguments: SampleArguments) -> None:
    """Correct the samples that are marked as inside a step; where that fails they stay as they are."""
    given, t_eval, inside, samples = arguments.case_constants, arguments.t_eval, arguments.inside, arguments.samples
    clock, states, constants, delta = arguments.clock, arguments.states, arguments.constants, arguments.delta
    position, velocity, number, mark = arguments.position, arguments.velocity, arguments.number, arguments.mark
    lanes, n_times, n = clock.shape[1], t_eval.size, delta.shape[0]
    filled, total = 0, inside.size
    for place in range(total + 1):
        i, j = place // n_times, place % n_times
        if place < total and inside[i, j]:
            for m in range(n):
                states[m, filled] = samples[i, j * n + m]
            for m in range(given.shape[1]):
                constants[m, filled] = given[place if given.shape[0] == total else i, m]
            clock[0, filled], number[filled], mark[filled] = t_eval[j], place, PENDING
            filled += 1
        if filled < lanes and (place < total or filled == 0):
            continue
        for lane in range(filled, lanes):
            mark[lane] = NONE
        correct(position, velocity, clock, states, 0, states, 0, constants, delta, mark, arguments.rtol, arguments.atol)
        for lane in range(filled):
            if mark[lane] == PENDING:
                for m in range(n):
                    samples[number[lane] // n_times, number[lane] % n_times * n + m] = states[m, lane]
        filled = 0


# A kernel at many instants, as many together as there are lanes.


class KernelRowsArguments(NamedTuple):
    """Arguments of the loop.

    Attributes
    ----------
    t, y, c, out : (k,), (k, n_y), (k, n_c), (k, n)
        Times, states and constants; gets the outputs of the kernel.
    clock, states, constants, found : (1, lanes), (n_y, lanes), (n_c, lanes), (n, lanes)
        Are overwritten.
    """

    kernel: Address
    t: Vector
    y: Matrix
    c: Matrix
    out: Matrix
    clock: Matrix
    states: Matrix
    constants: Matrix
    found: Matrix


@compiled_subset
def ROWS_LOOP(arguments: KernelRowsArguments) -> None:
    """Evaluate a kernel at every instant."""
    t, y, c, out = arguments.t, arguments.y, arguments.c, arguments.out
    clock, states, constants, found = arguments.clock, arguments.states, arguments.constants, arguments.found
    lanes, count = clock.shape[1], t.size
    first = 0
    while first < count:
        for lane in range(lanes):
            i = min(first + lane, count - 1)
            clock[0, lane] = t[i]
            for m in range(y.shape[1]):
                states[m, lane] = y[i, m]
            for m in range(c.shape[1]):
                constants[m, lane] = c[i, m]
        call_code(arguments.kernel, row(clock, 0), row(states, 0), row(constants, 0), 0, row(found, 0))
        for lane in range(min(lanes, count - first)):
            for m in range(out.shape[1]):
                out[first + lane, m] = found[m, lane]
        first += lanes
