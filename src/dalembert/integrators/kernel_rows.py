"""A kernel at many instants, as many together as there are lanes."""

from __future__ import annotations

from ..arrays import FloatArray
from .compiled_subset import bare, call_code, row
from .kinds import INTEGER, MATRIX, VECTOR

__all__ = ["KINDS", "LOOP"]

KINDS = (INTEGER, VECTOR, *(MATRIX,) * 3, *(MATRIX,) * 4)


@bare
def LOOP(
    code: int,
    t: FloatArray,
    y: FloatArray,
    c: FloatArray,
    out: FloatArray,
    clock: FloatArray,
    states: FloatArray,
    constants: FloatArray,
    found: FloatArray,
) -> None:
    """Write the outputs (k, n) of a kernel at times (k,), states (k, n_y) and constants (k, n_c).

    The last four are room: (1, lanes), (n_y, lanes), (n_c, lanes) and (n, lanes).
    """
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
        call_code(code, row(clock, 0), row(states, 0), row(constants, 0), 0, row(found, 0))
        for lane in range(min(lanes, count - first)):
            for m in range(out.shape[1]):
                out[first + lane, m] = found[m, lane]
        first += lanes
