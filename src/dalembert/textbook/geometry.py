"""Positions, orientations and velocities of a scene, as SymPy vectors.

Vectors stay in the pieces in which the scene is written (x_dot N.x + l theta_dot S.y), so that the
results read as they do in the text. This route shares nothing with the expression graph of the
compiled one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import sympy as sp
from sympy.physics.mechanics import Point, ReferenceFrame
from sympy.physics.vector import Vector, dynamicsymbols

from ..errors import SceneError
from ..scene import Scene
from ..scene.frames import Tree
from ..scene.release_impose import released_orientation, released_position, with_imposed

LARGE = 60
"""Operations beyond which an entry is no longer simplified."""


def tidy(expression: Any, limit: int = LARGE) -> Any:
    """Return an expression with sin^2 + cos^2 = 1 used where that makes it shorter, if it is small enough."""
    expression = sp.sympify(expression)
    if not expression.has(sp.sin, sp.cos) or expression.count_ops() > limit:
        return expression
    expanded = sp.expand(expression)
    forms = [expression, expanded, squares(expanded, sp.cos, sp.sin), squares(expanded, sp.sin, sp.cos)]
    return min(forms, key=lambda e: e.count_ops())


def squares(expression: Any, old: Any, new: Any) -> Any:
    """Return an expanded expression with every old(a)^2 replaced by 1 - new(a)^2."""
    powers = [p for p in expression.atoms(sp.Pow) if isinstance(p.base, old) and p.exp.is_Integer and p.exp > 1]
    if not powers:
        return expression
    table = {p: (1 - new(p.base.args[0]) ** 2) ** (p.exp // 2) * p.base ** (p.exp % 2) for p in powers}
    return sp.expand(expression.xreplace(table))


@final
class Geometry:
    """Positions and velocities of a scene, with released and imposed coordinates applied.

    Parameters
    ----------
    scene : Scene
        The scene; it is not changed.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.time = dynamicsymbols._t
        self._frames = Tree(scene.frame, "_dcm_dict")
        self._points = Tree(scene.origin, "_pos_dict")
        self._steps: dict[Any, Any] = {}
        self._rotations: dict[Any, Any] = {}
        self._omegas: dict[Any, Vector] = {scene.frame: Vector(0)}
        self._velocities: dict[Any, Vector] = {scene.origin: Vector(0)}

    # -- vectors --------------------------------------------------------------------------

    def put(self, expression: Any) -> Any:
        """Return an expression of the user's with imposed coordinates in terms of the others."""
        return with_imposed(expression, self.scene.imposed)

    def map(self, vector: Any, function: Callable[[Any], Any]) -> Vector:
        """Return a vector with `function` applied to its components."""
        if vector == 0:
            return Vector(0)
        return Vector([(matrix.applyfunc(function), frame) for matrix, frame in vector.args])

    def vector(self, vector: Any) -> Vector:
        """Return a vector of the user's with imposed coordinates in terms of the others."""
        return self.map(vector, self.put) if self.scene.imposed else self.map(vector, sp.sympify)

    def components(self, vector: Any, frame: ReferenceFrame) -> Any:
        """Return the components of a vector on a frame as a column."""
        total = sp.zeros(3, 1)
        for matrix, own in Vector(0).args if vector == 0 else vector.args:
            total += matrix if own is frame else self.rotation(frame, own) * matrix
        return total

    def express(self, vector: Any, frame: ReferenceFrame) -> Vector:
        """Return a vector on the basis of one frame."""
        return Vector([(self.components(vector, frame), frame)])

    def dot(self, a: Any, b: Any) -> Any:
        """Return a . b, formed piece by piece."""
        total = sp.S.Zero
        if a == 0 or b == 0:
            return total
        for left, frame in a.args:
            for right, other in b.args:
                turn = right if other is frame else self.rotation(frame, other) * right
                total += sum((x * y for x, y in zip(left, turn, strict=True)), sp.S.Zero)
        return total

    def cross(self, a: Any, b: Any) -> Vector:
        """Return a x b, each piece of it on the frame of b."""
        total = Vector(0)
        if a == 0 or b == 0:
            return total
        for right, frame in b.args:
            total = total + Vector([(self.components(a, frame).cross(right), frame)])
        return total

    # -- frames ---------------------------------------------------------------------------

    def _path(self, tree: Tree, node: Any, kind: str) -> list[Any]:
        path = tree.path(node)
        if path is None:
            root = self.scene.frame.name if kind == "frame" else self.scene.origin.name
            raise SceneError(
                self.scene.name,
                [f"{kind} {node.name!r} is not connected to {root!r}; orient or locate it, directly or through others"],
            )
        return path

    def _step(self, frame: ReferenceFrame) -> Any:
        """Return the matrix from components on the parent to components on `frame`."""
        if frame not in self._steps:
            parent = self._frames.parent[frame]
            matrix = released_orientation(self.scene, frame, parent, sp.Matrix(frame._dcm_dict[parent]))
            self._steps[frame] = matrix.applyfunc(self.put) if self.scene.imposed else matrix
        return self._steps[frame]

    def rotation(self, to: ReferenceFrame, frame: ReferenceFrame) -> Any:
        """Return the matrix from components on `frame` to components on `to`."""
        if frame is to:
            return sp.eye(3)
        if (to, frame) not in self._rotations:
            up, down = self._path(self._frames, frame, "frame"), self._path(self._frames, to, "frame")
            while up and down and up[0] is down[0]:
                del up[0], down[0]
            matrix = sp.eye(3)
            for node in reversed(up):
                matrix = self._step(node).T * matrix
            for node in down:
                matrix = self._step(node) * matrix
            matrix = matrix.applyfunc(tidy)
            self._rotations[to, frame], self._rotations[frame, to] = matrix, matrix.T
        return self._rotations[to, frame]

    def angular_velocity(self, frame: ReferenceFrame) -> Vector:
        """Return the angular velocity of a frame relative to the Newtonian one."""
        if frame not in self._omegas:
            total = Vector(0)
            for node in self._path(self._frames, frame, "frame"):
                if node not in self._omegas:
                    self._omegas[node] = total + self._spin(node)
                total = self._omegas[node]
        return self._omegas[frame]

    def _spin(self, frame: ReferenceFrame) -> Vector:
        """Return the angular velocity relative to the parent, from C dC^T/dt = [omega x], on the simpler basis."""
        c = self._step(frame)
        w = c * c.diff(self.time).T
        own = sp.Matrix([(w[2, 1] - w[1, 2]) / 2, (w[0, 2] - w[2, 0]) / 2, (w[1, 0] - w[0, 1]) / 2]).applyfunc(tidy)
        w = c.T * c.diff(self.time)
        parent = sp.Matrix([(w[1, 2] - w[2, 1]) / 2, (w[2, 0] - w[0, 2]) / 2, (w[0, 1] - w[1, 0]) / 2]).applyfunc(tidy)
        if sum(x.count_ops() for x in own) < sum(x.count_ops() for x in parent):
            return Vector([(own, frame)])
        return Vector([(parent, self._frames.parent[frame])])

    # -- points ---------------------------------------------------------------------------

    def _segment(self, point: Point) -> Vector:
        return self.vector(released_position(self.scene, point, point._pos_dict[self._points.parent[point]]))

    def position(self, point: Point, start: Point | None = None) -> Vector:
        """Return the vector from `start` (the origin) to `point`."""
        ahead = self._path(self._points, point, "point")
        behind = [] if start is None else self._path(self._points, start, "point")
        while ahead and behind and ahead[0] is behind[0]:
            del ahead[0], behind[0]
        total = Vector(0)
        for node in ahead:
            total = total + self._segment(node)
        for node in behind:
            total = total - self._segment(node)
        return total

    def velocity(self, point: Point) -> Vector:
        """Return the velocity of a point, the derivative of its position in the Newtonian frame."""
        if point not in self._velocities:
            total = Vector(0)
            for node in self._path(self._points, point, "point"):
                if node not in self._velocities:
                    self._velocities[node] = total + self._rate(self._segment(node))
                total = self._velocities[node]
        return self._velocities[point]

    def _rate(self, vector: Vector) -> Vector:
        total = Vector(0)
        for matrix, frame in vector.args:
            piece = Vector([(matrix, frame)])
            total = total + Vector([(matrix.diff(self.time), frame)]) + self.cross(self.angular_velocity(frame), piece)
        return total
