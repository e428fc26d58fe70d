"""A tableau as the flat arrays that the compiled loop reads."""

from functools import cache
from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from dalembert.integrators.numba.jit import VECTOR
from dalembert.integrators.tableau import FloatArray, Tableau

# Rows of the working array: two that hold the ends of a step in turn, two for scratch, and the stages.
POINT, DELTA, STAGES = 2, 3, 4


class PackedTableau(NamedTuple):
    """All linear combinations of stages that a method needs, as rows that list only their non-zero weights.

    Row i < total is row i of A (row ``end`` is the step itself), rows ``total`` and ``total + 1`` are the
    error estimates (the second is empty for pairs that have one), and ``degree`` more are the columns of P.
    Row i has the weights and stages numbered ``starts[i]`` to ``starts[i + 1]``; stages are given as rows of
    the working array, where the first is row ``first``.
    """

    first: int
    total: int
    end: int
    degree: int
    fsal: bool
    exponent: float
    nodes: FloatArray
    starts: NDArray[np.uintp]
    stages: NDArray[np.uintp]
    weights: FloatArray


_INDICES = types.Array(types.uintp, 1, "C")
PACKED_TABLEAU = types.NamedTuple(
    (
        types.intp,
        types.intp,
        types.intp,
        types.intp,
        types.boolean,
        types.float64,
        VECTOR,
        _INDICES,
        _INDICES,
        VECTOR,
    ),
    PackedTableau,
)


@cache
def pack(tableau: Tableau) -> PackedTableau:
    """Flatten a tableau."""
    error = np.zeros((2, tableau.n_total))
    error[: len(tableau.error)] = tableau.error
    rows = np.vstack([tableau.A, error, tableau.P.T])
    used = rows != 0.0
    return PackedTableau(
        first=STAGES,
        total=tableau.n_total,
        end=tableau.end,
        degree=tableau.degree,
        fsal=tableau.fsal,
        exponent=1.0 / (tableau.error_order + 1),
        nodes=tableau.c.copy(),
        starts=np.concatenate([[0], np.cumsum(used.sum(axis=1))]).astype(np.uintp),
        stages=(STAGES + np.nonzero(used)[1]).astype(np.uintp),
        weights=rows[used],
    )
