"""Vectors and kinematic screws on the graph, propagated along the tree of poses in local components.

A *pose* is a frame together with a reference point. The way from the origin to a pose is a
chain of steps, each of which either rotates the frame or moves the point within the frame, so
the kinematic screw of a pose follows from that of its parent in a few operations on local
components. Bodies that share the beginning of their chains share poses, which makes a tree;
the partial kinematic screw of a coordinate is held once, at the step where it enters.

Accelerations are those with all second rates of the coordinates zero: the bias terms of the
principle of virtual power.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..scene.model import BodyModel, Components, Pieces, SceneModel
from ..transforms.derivatives import tangents
from .screws import add, cross, dot, is_zero, rotate, rotate_back, scale, subtract, zero


@final
@frozen
class Motion:
    """The part of a partial kinematic screw that one coordinate has at one step: angular or linear."""

    coordinate: int
    direction: Components
    angular: bool


@final
class Pose:
    """A frame and a point of the tree, with its screw (omega, v) and bias (alpha, a) in its own components.

    Attributes
    ----------
    parent : Pose or None
        Where the step starts; None for the origin.
    rotation : rows or None
        Components here = rotation * components of the parent, for a rotating step.
    offset : Components or None
        Position from the parent's point, for a moving step.
    motions : tuple of Motion
        Partial kinematic screws that enter at this step.
    """

    __slots__ = ("a", "alpha", "children", "frame", "motions", "offset", "omega", "parent", "rotation", "v")

    def __init__(self, frame: int, parent: Pose | None, omega: Components, v: Components) -> None:
        self.frame, self.parent, self.omega, self.v = frame, parent, omega, v
        self.rotation: tuple[Components, Components, Components] | None = None
        self.offset: Components | None = None
        self.motions: tuple[Motion, ...] = ()
        self.alpha: Components = omega
        self.a: Components = v
        self.children: dict[tuple[int, ...], Pose] = {}


@final
class Kinematics:
    """The tree of poses of one scene; poses are made on first use, parents before children."""

    def __init__(self, model: SceneModel) -> None:
        self.model = model
        self.graph: Graph = model.graph
        symbols = model.symbols
        self.q = [self.graph.input(name) for name in symbols.coordinates]
        self.qdot = [self.graph.input(name) for name in symbols.rates]
        self.flow = dict(zip(self.q, self.qdot, strict=True))
        self.flow[self.graph.input(symbols.time)] = self.graph.one
        self.flow |= dict(zip(map(self.graph.input, symbols.states), model.state_rates, strict=True))
        root = Pose(0, None, zero(self.graph), zero(self.graph))
        # a field of gravity is an acceleration of the referential the other way
        root.a = scale(self.graph.const(-1), self.resolve(model.gravity, 0))
        self.poses: list[Pose] = [root]
        self._known: dict[tuple[int, int], Pose] = {}
        self._depths: dict[int, int] = {}
        self._reaches: dict[int, int] = {}

    # -- frames ---------------------------------------------------------------------------

    def ancestry(self, frame: int) -> list[int]:
        """Return the frames from the root to `frame`, both included."""
        chain = [frame]
        while (parent := self.model.frames[chain[-1]].parent) is not None:
            chain.append(parent)
        return chain[::-1]

    def to_frame(self, a: Components, source: int, target: int) -> Components:
        """Return the components of a vector on `target` from those on `source`."""
        down = self.ancestry(target)
        while source not in down:
            frame = self.model.frames[source]
            assert frame.rotation is not None and frame.parent is not None
            a, source = rotate_back(frame.rotation, a), frame.parent
        for number in down[down.index(source) + 1 :]:
            rotation = self.model.frames[number].rotation
            assert rotation is not None
            a = rotate(rotation, a)
        return a

    def resolve(self, pieces: Pieces, target: int) -> Components:
        """Return the components on `target` of a vector given in pieces."""
        total = zero(self.graph)
        for piece in pieces:
            total = add(total, self.to_frame(piece.components, piece.frame, target))
        return total

    # -- points ---------------------------------------------------------------------------

    def point_pieces(self, point: int) -> list[Pieces]:
        """Return the position of a point as segments from the origin on."""
        segments: list[Pieces] = []
        current: int | None = point
        while current is not None:
            segments.append(self.model.points[current].position)
            current = self.model.points[current].parent
        return segments[::-1]

    def between(self, start: int, end: int, frame: int) -> Components:
        """Return the vector from point `start` to point `end` on `frame`."""
        from_start, to_end = self.point_pieces(start), self.point_pieces(end)
        while from_start and to_end and from_start[0] is to_end[0]:
            del from_start[0], to_end[0]
        total = zero(self.graph)
        for pieces in to_end:
            total = add(total, self.resolve(pieces, frame))
        for pieces in from_start:
            total = subtract(total, self.resolve(pieces, frame))
        return total

    def carrier(self, point: int) -> int:
        """Return the frame that carries a point: the deepest one that its position is written on."""
        frames = [piece.frame for pieces in self.point_pieces(point) for piece in pieces]
        return max(frames, key=self._depth, default=0)

    def _depth(self, frame: int) -> int:
        """Return how many frames there are from the root to `frame`."""
        if frame not in self._depths:
            self._depths[frame] = len(self.ancestry(frame))
        return self._depths[frame]

    def _reach(self, point: int) -> int:
        """Return the depth of the deepest frame that the position of a point is written on."""
        way: list[int] = []
        current: int | None = point
        while current is not None and current not in self._reaches:
            way.append(current)
            current = self.model.points[current].parent
        deepest = 0 if current is None else self._reaches[current]
        for each in reversed(way):
            deepest = max([deepest, *(self._depth(piece.frame) for piece in self.model.points[each].position)])
            self._reaches[each] = deepest
        return deepest

    # -- poses ----------------------------------------------------------------------------

    def body_pose(self, body: BodyModel) -> Pose:
        """Return the pose of a body at its mass centre; that of a particle is on the frame that carries its point."""
        return self.pose(self.carrier(body.centre) if body.inertia is None else body.frame, body.centre)

    def pose(self, frame: int, point: int) -> Pose:
        """Return the pose of `frame` at `point`."""
        last, before = [], self._before(frame, point)
        while (frame, point) not in self._known and before is not None:
            last.append((frame, point))
            frame, point = before
            before = self._before(frame, point)
        if (frame, point) not in self._known:
            self._known[frame, point] = self._from_root(frame, point)
        pose = self._known[frame, point]
        for there, at in reversed(last):
            if there != frame:
                pose = self._child(pose, (there,), there, None)
            else:
                pose = self._moves(pose, there, [piece.components for piece in self.model.points[at].position])
            frame, self._known[there, at] = there, pose
        return pose

    def _before(self, frame: int, point: int) -> tuple[int, int] | None:
        """Return the frame and point that a pose hangs from, None where it is not so simple.

        That is the point before, where all of its last segment is written on the frame, or the frame before, where
        nothing is written on this one or on frames behind it.
        """
        above, before = self.model.frames[frame].parent, self.model.points[point]
        if above is not None and self._reach(point) < self._depth(frame):
            return above, point
        if before.parent is not None and all(piece.frame == frame for piece in before.position):
            return frame, before.parent
        return None

    def _from_root(self, frame: int, point: int) -> Pose:
        """Return the pose of `frame` at `point`, by all steps from the root on."""
        chain = self.ancestry(frame)
        steps: dict[int, list[Components]] = {number: [] for number in chain}
        for pieces in self.point_pieces(point):
            for piece in pieces:
                level, components = piece.frame, piece.components
                while level not in steps:  # written on a frame beside the chain: take it to where they part
                    model = self.model.frames[level]
                    assert model.rotation is not None and model.parent is not None
                    level, components = model.parent, rotate_back(model.rotation, components)
                steps[level].append(components)
        pose = self.poses[0]
        for number in chain:
            if number != 0:
                pose = self._child(pose, (number,), number, None)
            pose = self._moves(pose, number, steps[number])
        return pose

    def _moves(self, pose: Pose, frame: int, offsets: Sequence[Components]) -> Pose:
        """Return the pose moved by offsets within its frame."""
        for offset in offsets:
            if not is_zero(offset):
                pose = self._child(pose, tuple(x.index for x in offset), frame, offset)
        return pose

    def _child(self, parent: Pose, key: tuple[int, ...], frame: int, offset: Components | None) -> Pose:
        known = parent.children.get(key)
        if known is None:
            known = self._rotated(parent, frame) if offset is None else self._moved(parent, offset)
            parent.children[key] = known
            self.poses.append(known)
        return known

    def _moved(self, parent: Pose, r: Components) -> Pose:
        rate = self._flow(r)
        twist = add(cross(parent.omega, r), rate)
        pose = Pose(parent.frame, parent, parent.omega, add(parent.v, twist))
        pose.offset = r
        pose.alpha = parent.alpha
        a = add(parent.a, cross(parent.alpha, r))
        a = add(a, cross(parent.omega, add(twist, rate)))
        pose.a = add(a, self._flow(rate))
        pose.motions = self._motions(lambda seeds: self._tangent(r, seeds), r, angular=False)
        return pose

    def _rotated(self, parent: Pose, frame: int) -> Pose:
        rotation = self.model.frames[frame].rotation
        assert rotation is not None
        spin = self._spin(rotation, self.flow)
        omega = rotate(rotation, parent.omega)
        pose = Pose(frame, parent, add(omega, spin), rotate(rotation, parent.v))
        pose.rotation = rotation
        alpha = add(rotate(rotation, parent.alpha), cross(omega, spin))
        pose.alpha = add(alpha, self._flow(spin))
        pose.a = rotate(rotation, parent.a)
        entries = (*rotation[0], *rotation[1], *rotation[2])
        pose.motions = self._motions(lambda seeds: self._spin(rotation, seeds), entries, angular=True)
        return pose

    def _motions(self, partial, of: tuple[Node, ...], *, angular: bool) -> tuple[Motion, ...]:  # type: ignore[no-untyped-def]
        deps = 0
        for node in of:
            deps |= node.deps
        found = []
        for number, q in enumerate(self.q):
            if q.deps & deps:
                direction = partial({q: self.graph.one})
                if not is_zero(direction):
                    found.append(Motion(number, direction, angular))
        return tuple(found)

    def _tangent(self, a: Components, seeds: dict[Node, Node]) -> Components:
        x, y, z = tangents(self.graph, a, seeds)
        return x, y, z

    def _flow(self, a: Components) -> Components:
        """Return the rate of components along the motion, second rates of the coordinates being zero."""
        return self._tangent(a, self.flow)

    def _spin(self, c: tuple[Components, Components, Components], seeds: dict[Node, Node]) -> Components:
        """Return the angular velocity relative to the parent, from C dC^T = [omega x], on the rotated frame."""
        rate = [self._tangent(row, seeds) for row in c]
        w = [[dot(c[i], rate[j]) for j in range(3)] for i in range(3)]
        pairs = ((2, 1), (0, 2), (1, 0))
        x, y, z = (w[i][j] if w[i][j] is -w[j][i] else (w[i][j] - w[j][i]) * self.graph.node(0.5) for i, j in pairs)
        return x, y, z

    def position(self, pose: Pose) -> Components:
        """Return the position of a pose's point from the origin, on the root frame."""
        total = zero(self.graph)
        current: Pose | None = pose
        while current is not None:
            if current.offset is not None:
                total = add(total, current.offset)
            if current.rotation is not None:
                total = rotate_back(current.rotation, total)
            current = current.parent
        return total
