"""Projection of recorded states onto the constraints, as many together as there are lanes."""

from __future__ import annotations

from typing import NamedTuple

from .arguments import Address, FlagMatrix, IntVector, Matrix, Vector
from .compiled_subset import compiled_subset
from .projection import NONE, PENDING, correct

__all__ = ["LOOP", "SampleArguments"]


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
