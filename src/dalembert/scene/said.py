"""Velocities that were set beside positions and orientations, which alone a scene goes by: they must not differ."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, final

from sympy.core.function import AppliedUndef
from sympy.physics.vector import dynamicsymbols

from ..ir.derivatives import tangents
from ..ir.graph import Graph, Node
from ..ir.linear import Matrix, matmul, matvec, transpose
from ..naming import rate_name
from .expressions import ExpressionReader

if TYPE_CHECKING:
    from .scene import Scene
    from .tree import Tree

__all__ = ["contradictions"]

_REMEDY = (
    "A scene takes velocities from positions and orientations: write them so that they move (with a coordinate, or with"
    " time), or leave out what was set. SymPy's KanesMethod and System are taken with their velocities"
)


def contradictions(scene: Scene, frames: Tree, points: Tree, met: Sequence[Any]) -> list[str]:
    """Return a fault for every ``set_ang_vel`` and ``set_vel`` that contradicts orientations and positions.

    Velocities in symbols that the scene does not know are let pass where something moves at all. Those of points are
    looked at where no constraint relates the coordinates.

    Parameters
    ----------
    scene : Scene
        Its coordinates are sound.
    frames, points : Tree
        Below the frame and the origin of the scene.
    met : sequence of ReferenceFrame and Point
        Those that its contents depend on.
    """
    if scene.velocities or scene.speeds or scene.orientations or scene.releases or scene.imposed:
        return []
    check = _Check(scene, frames, points)
    faults = []
    for target in met:
        angular = target in frames.parent
        if not angular and (scene.holonomic_constraints or scene.nonholonomic_constraints):
            continue
        faults += check.frame(target) if angular else check.point(target)
    return faults


@final
class _Check:
    """Velocities by differentiation, on a graph of their own, so that the scene's stays as it is."""

    def __init__(self, scene: Scene, frames: Tree, points: Tree) -> None:
        self.scene, self.frames, self.points = scene, frames, points
        self.graph = g = Graph()
        time = dynamicsymbols._t
        q = [g.input(c.func.__name__) for c in scene.coordinates]
        rates = [g.input(rate_name(c.func.__name__)) for c in scene.coordinates]
        leaves = {time: g.input("t"), **dict(zip(scene.coordinates, q, strict=True))}
        leaves |= {c.diff(time): rate for c, rate in zip(scene.coordinates, rates, strict=True)}
        self.flow = {g.input("t"): g.one, **dict(zip(q, rates, strict=True))}
        self.reader = ExpressionReader(g, leaves)
        one = [[g.one if i == j else g.zero for j in range(3)] for i in range(3)]
        self._from_root: dict[Any, Matrix | None] = {scene.frame: one}

    def from_root(self, frame: Any) -> Matrix | None:
        """Return what takes components on the scene's frame to `frame`; None where it is no rotation whatever q."""
        if frame not in self._from_root:
            parent = self.frames.parent[frame]
            entries = frame._dcm_dict[parent]
            step = [[self.reader.read(entries[i, j], "") for j in range(3)] for i in range(3)]
            square = matmul(self.graph, step, transpose(step))
            sound = all((x - (1 if i == j else 0)).is_zero for i, row in enumerate(square) for j, x in enumerate(row))
            above = self.from_root(parent)
            self._from_root[frame] = matmul(self.graph, step, above) if sound and above is not None else None
        return self._from_root[frame]

    def on_root(self, vector: Any) -> list[Node] | None:
        """Return the components of a vector on the scene's frame, None for what cannot be read."""
        total = [self.graph.zero] * 3
        for matrix, frame in getattr(vector, "args", ()):
            turn = self.from_root(frame) if frame in self.frames.parent else None
            if turn is None or any(f not in self.reader.leaves for f in matrix.atoms(AppliedUndef)):
                return None
            part = matvec(self.graph, transpose(turn), [self.reader.read(x, "") for x in matrix])
            total = [a + b for a, b in zip(total, part, strict=True)]
        return total

    def spin(self, frame: Any) -> list[Node] | None:
        """Return the angular velocity of a frame, on the scene's: the axial vector of dR^T/dt R."""
        turn = self.from_root(frame)
        if turn is None:
            return None
        back = transpose(turn)
        rates = [tangents(self.graph, row, self.flow) for row in back]
        skew = matmul(self.graph, rates, turn)
        return [skew[2][1], skew[0][2], skew[1][0]]

    def frame(self, frame: Any) -> list[str]:
        """Return the faults of what was set for a frame."""
        faults = []
        for other, said in frame._ang_vel_dict.items():
            if other is not self.frames.parent[frame] and other is not self.scene.frame:
                continue
            own, base = self.spin(frame), self.spin(other)
            if own is None or base is None:
                continue
            found = [a - b for a, b in zip(own, base, strict=True)]
            if self.differ(found, said):
                faults.append(
                    f"frame {frame.name!r} was set to turn in {other.name!r} with {said}, and its orientation says"
                    f" {'that it does not turn' if all(x.is_zero for x in found) else 'otherwise'}. {_REMEDY}"
                )
        return faults

    def point(self, point: Any) -> list[str]:
        """Return the faults of what was set for a point."""
        said = point._vel_dict.get(self.scene.frame)
        if said is None:
            return []
        places = [self.on_root(node._pos_dict[self.points.parent[node]]) for node in self.points.path(point) or ()]
        total = [self.graph.zero] * 3
        for place in places:
            if place is None:
                return []
            total = [a + b for a, b in zip(total, place, strict=True)]
        found = tangents(self.graph, total, self.flow)
        if not self.differ(found, said):
            return []
        how = "that it rests" if all(x.is_zero for x in found) else "otherwise"
        return [f"point {point.name!r} was set to move with {said}, and its position says {how}. {_REMEDY}"]

    def differ(self, found: Sequence[Node], said: Any) -> bool:
        """Whether a velocity that was set is another than the one found; what cannot be read is not rest."""
        told = self.on_root(said)
        if told is None:
            return all(x.is_zero for x in found) and said != 0
        return any(not (a - b).is_zero for a, b in zip(found, told, strict=True))
