"""Trees of frames or points, and matrices of dyadics, of SymPy."""

from __future__ import annotations

from typing import Any, final

import sympy as sp
from sympy.physics.mechanics import ReferenceFrame
from sympy.physics.vector import Vector


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

    def number(self, node: Any) -> int:
        """Return the number of a node, assigned in order of first use."""
        return self._numbers.setdefault(id(node), len(self._numbers))


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
