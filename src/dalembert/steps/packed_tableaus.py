"""A tableau as the flat arrays that the compiled loop reads."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..methods.step_constants import POLYNOMIAL_ERROR
from ..methods.tableau import Tableau
from ..once import once
from ..subset.arguments import IntVector, Vector

# Rows of the working array: two that hold the ends of a step in turn, two temporary ones, the absolute tolerances of
# the components, and the stages.
POINT, DELTA, ALLOWED, STAGES = 2, 3, 4, 5


class PackedTableau(NamedTuple):
    """All linear combinations of stages that a method needs, as rows that list only their non-zero weights.

    Row i < total is row i of A (row ``end`` is the step itself), rows ``total`` and ``total + 1`` are the
    error estimates (the second is empty for pairs that have one), ``degree`` more are the columns of P, and the last is
    the estimate of the error of the dense output over `POLYNOMIAL_ERROR`, empty where the pair is not ``bounded``.
    Row i has the weights and stages numbered ``starts[i]`` to ``starts[i + 1]``; stages are given as rows of
    the working array, where the first is row ``first``.
    """

    first: int
    total: int
    end: int
    degree: int
    fsal: bool
    bounded: bool
    exponent: float
    nodes: Vector
    starts: IntVector
    stages: IntVector
    weights: Vector


@once
def packed_tableau(tableau: Tableau) -> PackedTableau:
    """Flatten a tableau."""
    error = np.zeros((2, tableau.n_total))
    error[: len(tableau.error)] = tableau.error
    between = tableau.between / POLYNOMIAL_ERROR if tableau.bounded else np.zeros(tableau.n_total)
    rows = np.vstack([tableau.A, error, tableau.P.T, between])
    used = rows != 0.0
    return PackedTableau(
        first=STAGES,
        total=tableau.n_total,
        end=tableau.end,
        degree=tableau.degree,
        fsal=tableau.fsal,
        bounded=tableau.bounded,
        exponent=1.0 / (tableau.error_order + 1),
        nodes=tableau.c.copy(),
        starts=np.concatenate([[0], np.cumsum(used.sum(axis=1))]).astype(np.int64),
        stages=(STAGES + np.nonzero(used)[1]).astype(np.int64),
        weights=rows[used],
    )
