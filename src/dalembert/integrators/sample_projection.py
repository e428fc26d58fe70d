"""Projection of recorded states onto the constraints, as many together as there are lanes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from .compiled_subset import bare
from .kinds import ARRAY_OF_FLAGS, INTEGER, INTEGER_MATRIX, MATRIX, VECTOR, Group
from .projection import NONE, WANTED, correct

__all__ = ["KINDS", "LOOP"]

KINDS = (
    Group((INTEGER,) * 2),
    *(MATRIX, VECTOR, ARRAY_OF_FLAGS, MATRIX),
    *(MATRIX,) * 4,
    INTEGER_MATRIX,
)


@bare
def LOOP(
    codes: tuple[int, int],
    c: FloatArray,
    t_eval: FloatArray,
    inside: NDArray[np.bool_],
    samples: FloatArray,
    clock: FloatArray,
    states: FloatArray,
    constants: FloatArray,
    delta: FloatArray,
    whole: NDArray[np.int64],
) -> None:
    """Correct those of ``samples`` (k, m * n_y) that are marked in ``inside`` (k, m); what fails stays as it is.

    Parameters
    ----------
    codes : addresses
        The projections of positions and velocities, 0 for none.
    c : (k, n_c)
        Constants of the cases.
    t_eval : (m,)
        Times [s].
    clock, states, constants, delta, whole : (1, lanes), (n_y, lanes), (n_c, lanes), (n_y, lanes), (2, lanes)
        Room.
    """
    lanes, wanted, n = clock.shape[1], t_eval.size, delta.shape[0]
    filled, total = 0, inside.size
    for place in range(total + 1):
        i, j = place // wanted, place % wanted
        if place < total and inside[i, j]:
            for m in range(n):
                states[m, filled] = samples[i, j * n + m]
            for m in range(c.shape[1]):
                constants[m, filled] = c[i, m]
            clock[0, filled], whole[0, filled], whole[1, filled] = t_eval[j], place, WANTED
            filled += 1
        if filled < lanes and (place < total or filled == 0):
            continue
        for lane in range(filled, lanes):
            whole[1, lane] = NONE
        correct(codes[0], codes[1], clock, states, 0, constants, delta, whole, 1)
        for lane in range(filled):
            if whole[1, lane] == WANTED:
                for m in range(n):
                    samples[whole[0, lane] // wanted, whole[0, lane] % wanted * n + m] = states[m, lane]
        filled = 0
