"""Tree of frames or points of SymPy."""

from __future__ import annotations

from typing import Any, final

__all__ = ["Tree"]


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
