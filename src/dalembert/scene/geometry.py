"""Reader of the frames, points, vectors and scalars of a scene onto the graph."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import sympy as sp
from sympy.physics.mechanics import Point, ReferenceFrame
from sympy.physics.vector import Vector, dynamicsymbols

from ..ir.node import Node
from ..transforms.linear import rotation_entries
from . import release_impose
from .angles import Angles
from .expressions.reader import short
from .expressions.vector_products import multiplied_out
from .frames import Tree, rotation_fault
from .joints.joints import Unknown
from .model import BodyModel, Components, FrameModel, Piece, Pieces, PointModel
from .scene import Scene
from .speeds import read_rates, refuse_states
from .symbols import SymbolReader


class GeometryReader(SymbolReader):
    """One reading of one scene, as far as its geometry; frames and points are read when they are first met."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self.angles = [Angles(self.expressions, item) for item in scene.orientations if item.angles]
        self._free = {item.frame: item for item in scene.orientations if item.angles}
        self.frames = Tree(scene.frame, "_dcm_dict")
        self.points = Tree(scene.origin, "_pos_dict")
        self.frame_models: dict[int, FrameModel] = {0: FrameModel(scene.frame.name, None, None)}
        self.point_models: dict[int, PointModel] = {0: PointModel(scene.origin.name, None, ())}
        self._met: list[Any] = [scene.origin]

    def _frame(self, frame: ReferenceFrame, place: str) -> int:
        """Return the number of a frame, reading it and its ancestors when first met."""
        if not self._free and (known := self.frames.known(frame)) in self.frame_models:
            return known
        path = self.frames.path(frame)
        if path is None:
            self.faults.append(
                f"{place}: frame {frame.name!r} is not oriented in {self.scene.frame.name!r}, neither directly nor"
                " through others"
            )
            return 0
        number = 0
        for node in self._shortened(path):
            known = self.frames.number(node)
            orientation = self._free.get(node)
            if orientation is not None and known not in self.frame_models:
                matrix = rotation_entries([self.expressions.leaves[e] for e in orientation.quaternion])
                rows = list(zip(*matrix, strict=True))
                self.frame_models[known] = FrameModel(node.name, number, (rows[0], rows[1], rows[2]))
            if known not in self.frame_models:
                parent = self.frames.parent[node]
                matrix = release_impose.released_orientation(self.scene, node, parent, node._dcm_dict[parent])
                where = f"orientation of frame {node.name!r}"
                rows = [self._components(matrix[i, :], where) for i in range(3)]
                self._without_states([x for row in rows for x in row], where)
                names = node.name, parent.name
                if rotation_fault(*names, rows, 0) and (fault := rotation_fault(*names, rows, self._constrained())):
                    self.faults.append(fault)
                self._met.append(node)
                self.frame_models[known] = FrameModel(node.name, number, (rows[0], rows[1], rows[2]))
            number = known
        return number

    def _constrained(self) -> int:
        """Return the dependency bits of the coordinates in holonomic constraints."""
        found = 0
        for q in self.coordinates:
            if any(isinstance(row, sp.Basic) and row.has(q) for row in self.scene.holonomic_constraints):
                found |= self.expressions.leaves[q].deps
        return found

    def _shortened(self, path: list[ReferenceFrame]) -> list[ReferenceFrame]:
        """Return the frames on a way without those that a free orientation makes superfluous."""
        for node in reversed(path):
            if node in self._free:
                skipped = self._free[node].between
                return [frame for frame in path if frame not in skipped]
        return path

    def _point(self, point: Point, place: str) -> int:
        """Return the number of a point, reading it and its ancestors when first met."""
        if (known := self.points.known(point)) in self.point_models:
            return known
        path = self.points.path(point)
        if path is None:
            self.faults.append(
                f"{place}: point {point.name!r} is not located from {self.scene.origin.name!r}, neither directly nor"
                " through others"
            )
            return 0
        number = 0
        for node in path:
            known = self.points.number(node)
            if known not in self.point_models:
                vector = release_impose.released_position(self.scene, node, node._pos_dict[self.points.parent[node]])
                pieces = self._vector(vector, f"position of point {node.name!r}")
                self._without_states([x for piece in pieces for x in piece.components], f"position of {node.name!r}")
                self._met.append(node)
                self.point_models[known] = PointModel(node.name, number, pieces)
            number = known
        return number

    def _moving_masses(self, bodies: Sequence[BodyModel]) -> tuple[set[int], set[int]]:
        """Return the points and the frames that bodies move with: their mass centres, and all that these follow."""
        points, frames = set[int](), {body.frame for body in bodies if body.inertia is not None}
        for body in bodies:
            point: int | None = body.centre
            while point is not None and point in self.point_models and point not in points:
                points.add(point)
                frames |= {piece.frame for piece in self.point_models[point].position}
                point = self.point_models[point].parent
        for frame in tuple(frames):
            parent: int | None = frame
            while parent is not None and parent in self.frame_models:
                frames.add(parent)
                parent = self.frame_models[parent].parent
        return points, frames

    def _components(self, column: Any, place: str, *, unknowns: bool = False) -> Components:
        x, y, z = (self.expressions.read(entry, place, unknowns=unknowns) for entry in column)
        return x, y, z

    def _state_rates(self) -> tuple[Node, ...]:
        """Return the rates of the first-order states; whatever is read later may contain them."""
        found = read_rates(self.scene, self.states, self.expressions, self._scalar)
        derivatives = [sp.Derivative(z, dynamicsymbols._t) for z in self.states]
        for angles in self.angles if self.states else ():
            angles.reader.define({z: self.expressions.leaves[z] for z in derivatives})
        return found

    def _without_states(self, nodes: Sequence[Node], place: str) -> None:
        """Record a fault where nodes depend on first-order states."""
        if self.states:
            refuse_states(self.expressions, self.states, nodes, place)

    def _scalar(self, expression: Any, place: str) -> Node:
        """Return a scalar that the motion depends on, with angles replaced by quaternions."""
        for angles in self.angles:
            if angles.concerns(expression):
                found = angles.scalar(multiplied_out(expression), place)
                if found is None:
                    self.expressions.faults.append(f"{place}: {angles.complaint(short(expression))}")
                return self.graph.zero if found is None else found
        return self.expressions.read(expression, place)

    def _turned(self, vector: Vector, place: str, angles: Angles, *, unknowns: bool) -> Pieces | None:
        """Return a vector that depends on angles in terms of their quaternion; None leaves it as it is."""
        found = angles.vector(vector, place, unknowns=unknowns)
        if found is not None:
            return tuple(Piece(self._frame(frame, place), (x, y, z)) for frame, (x, y, z) in found)
        held = {x for matrix, _ in vector.args for x in matrix.free_symbols if isinstance(x, Unknown)}
        if not unknowns or vector.subs(dict.fromkeys(held, 0)) != 0:
            self.faults.append(f"{place}: {angles.complaint(short(vector))}")
        return None

    def _vector(self, vector: Any, place: str, *, unknowns: bool = False) -> Pieces:
        if isinstance(vector, int | float | sp.Expr | Vector) and vector == 0:
            return ()
        if not isinstance(vector, Vector):
            self.faults.append(f"{place}: {vector!r} is not a vector; write it on a frame, such as -g * N.z")
            return ()
        if not all(getattr(matrix, "shape", None) == (3, 1) for matrix, _ in vector.args):
            self.faults.append(f"{place}: the vector has components that are not numbers")
            return ()
        for angles in self.angles:
            if angles.concerns(vector):
                found = self._turned(vector, place, angles, unknowns=unknowns)
                if found is not None:
                    return found
        return tuple(
            Piece(self._frame(frame, place), self._components(matrix, place, unknowns=unknowns))
            for matrix, frame in vector.args
        )
