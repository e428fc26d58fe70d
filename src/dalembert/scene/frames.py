"""Trees of frames or points, checks of rotations, and matrices of dyadics, of SymPy."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Any, final

import numpy as np
import sympy as sp
from sympy.physics.mechanics import ReferenceFrame
from sympy.physics.vector import Vector

from ..ir.node import Node, deps_of
from ..ir.random_points import random_inputs, values_of

_DRAWS = 4
_OFF = 1e-9
"""Largest difference of the products of the rows of a rotation from those of unit vectors: rounding of decimals."""


@final
class Tree:
    """Frames or points as a tree, searched breadth first along SymPy's neighbour tables.

    Parameters
    ----------
    root : ReferenceFrame or Point
        Where the search starts.
    table : str
        Name of SymPy's table of neighbours: ``"_dcm_dict"`` of frames, ``"_pos_dict"`` of points.
    """

    def __init__(self, root: Any, table: str) -> None:
        self.parent: dict[Any, Any] = {root: None}
        self._numbers: dict[int, int] = {id(root): 0}
        queue = [root]
        for node in queue:
            for neighbour in getattr(node, table):
                if neighbour not in self.parent:
                    self.parent[neighbour] = node
                    queue.append(neighbour)

    def path(self, node: Any) -> list[Any] | None:
        """Return the nodes from below the root to `node`, or None where it is not connected."""
        if node not in self.parent:
            return None
        path = []
        while self.parent[node] is not None:
            path.append(node)
            node = self.parent[node]
        return path[::-1]

    def known(self, node: Any) -> int:
        """Return the number of a node, -1 before its first use."""
        return self._numbers.get(id(node), -1)

    def number(self, node: Any) -> int:
        """Return the number of a node, assigned in order of first use."""
        return self._numbers.setdefault(id(node), len(self._numbers))


# Rotations.


def rotation_fault(name: str, parent: str, rows: Sequence[Sequence[Node]], constrained: int) -> str | None:
    """Return what is wrong with the orientation of a frame, None where it is a rotation.

    Numbers at random points decide. Two kinds of matrices are rotations only on part of their values, which the scene
    keeps: with rows that depend on constrained coordinates, as direction cosines do, and with one length for all rows
    that depends on symbols, as quaternions have it whose own length is not 1.

    Parameters
    ----------
    name, parent : str
        Of the frame, and of the one that it is oriented in.
    rows : sequence of sequence of Node (3, 3)
        The matrix.
    constrained : int
        Dependency bits of the coordinates in holonomic constraints.
    """
    nodes = [x for row in rows for x in row]
    deps = [deps_of(row) for row in rows]
    sizes: list[float] = []
    for draw in range(_DRAWS):
        values = np.array(values_of(nodes, random_inputs(nodes, random.Random(f"rotation {draw}")))).reshape(3, 3)
        if not np.all(np.isfinite(values)):
            continue
        products, sign = values @ values.T, float(np.linalg.det(values))
        size = products[0, 0]
        sizes.append(float(size))
        varies = all(deps) and (len(sizes) == 1 or abs(size - sizes[0]) > _OFF * size)
        if varies and sign > 0.0 and np.allclose(products, size * np.eye(3), rtol=0.0, atol=_OFF * size):
            continue
        free = np.array([[not (a | b) & constrained for b in deps] for a in deps])
        off = np.where(free, np.abs(products - np.eye(3)), 0.0)
        i, j = (int(k) for k in np.unravel_index(np.argmax(off), off.shape))
        where = " at random values of its symbols" if any(deps) else ""
        if off[i, j] > _OFF:
            what = f"row {i + 1} has the length {np.sqrt(products[i, i]):.9g}"
            if i != j:
                what = f"rows {i + 1} and {j + 1} have the product {products[i, j]:.9g}, which is 0 in a rotation"
        elif sign < 0.0 and np.all(free):
            what = "it is a reflection, which turns right-handed axes into left-handed ones"
        else:
            continue
        return (
            f"frame {name!r} is oriented in {parent!r} by the matrix {name}.dcm({parent}), which is no rotation:"
            f" {what}{where} (determinant {sign:.9g}); give rows of length 1 at right angles to each other with the"
            " determinant 1, or an orientation by angles, such as orient_axis"
        )
    return None


# Matrices of dyadics, such as inertias.


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
