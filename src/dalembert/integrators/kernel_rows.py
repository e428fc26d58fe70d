"""A kernel at many instants, as many together as there are lanes."""

from __future__ import annotations

from typing import NamedTuple

from .arguments import Address, Matrix, Vector
from .compiled_subset import call_code, compiled_subset, row

__all__ = ["LOOP", "KernelRowsArguments"]


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
def LOOP(arguments: KernelRowsArguments) -> None:
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
