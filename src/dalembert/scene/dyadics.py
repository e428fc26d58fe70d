"""Matrices of dyadics, such as inertias."""

from __future__ import annotations

from typing import Any

import sympy as sp
from sympy.physics.mechanics import ReferenceFrame
from sympy.physics.vector import Vector

__all__ = ["matrix_of"]


def matrix_of(dyadic: Any, frame: ReferenceFrame) -> Any:
    """Return the components (3, 3) of a dyadic on a frame.

    They are those of ``dyadic.to_matrix(frame)``, which multiplies rotation matrices out for every entry and so takes
    most of the time of reading a body.
    """
    total = [[sp.S.Zero] * 3 for _ in range(3)]
    for factor, left, right in dyadic.args:
        columns = _components(right, frame)
        for i, u in enumerate(_components(left, frame)):
            for j, w in enumerate(columns):
                if u != 0 and w != 0:
                    total[i][j] += factor * u * w
    return sp.ImmutableMatrix(total)


def _components(vector: Vector, frame: ReferenceFrame) -> list[Any]:
    if any(own is not frame for _, own in vector.args):
        return list(vector.to_matrix(frame))
    return [sum((matrix[i] for matrix, _ in vector.args), sp.S.Zero) for i in range(3)]
