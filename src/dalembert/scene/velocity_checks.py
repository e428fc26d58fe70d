"""Velocities set in a scene: prescribed ones on the graph, and the consistency of all with the positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, final

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.physics.mechanics import Particle, Point, ReferenceFrame

from ..errors import SceneError
from ..ir.node import Node
from ..ir.random_points import alike
from ..ir.zero_tests import agree
from ..transforms.derivatives import tangents
from ..transforms.linear import Matrix, matmul, matvec, transpose
from .frames import Tree, matrix_of
from .model import Components, GivenBody, GivenLoad, GivenMotion, Pieces
from .symbols import reader_of

if TYPE_CHECKING:
    from .frames import Tree
    from .scene import Scene

_REMEDY = (
    "A scene derives velocities from positions and orientations: write those so that they move (with a coordinate, or"
    " with time), or do not set velocities. SymPy's KanesMethod and System keep the velocities that were set"
)


def velocity_faults(scene: Scene, frames: Tree, points: Tree, used: Sequence[Any]) -> list[str]:
    """Return a fault for every ``set_ang_vel`` and ``set_vel`` that contradicts orientations and positions.

    Velocities are compared as functions, up to rounding, because SymPy has rounded products of decimals, and writes
    derivatives of roots and switches in its own way. Velocities in symbols that the scene does not have are accepted
    where something moves at all. Those of points are compared where no constraint relates the coordinates.

    Parameters
    ----------
    scene : Scene
        With valid coordinates.
    frames, points : Tree
        Below the frame and the origin of the scene.
    used : sequence of ReferenceFrame and Point
        Those that the contents of the scene depend on.
    """
    if scene.velocities or scene.speeds or scene.orientations or scene.releases or scene.imposed:
        return []
    check = _Check(scene, frames, points)
    faults = []
    for target in used:
        angular = target in frames.parent
        if not angular and (scene.holonomic_constraints or scene.nonholonomic_constraints):
            continue
        faults += check.frame(target) if angular else check.point(target)
    return faults


def _of_real_numbers(e: Any) -> Any:
    """Return an expression without the parts re and im that SymPy writes into derivatives of Abs and sign."""
    if not e.has(sp.re, sp.im):
        return e
    return e.replace(sp.re, lambda x: x).replace(sp.im, lambda x: sp.S.Zero).doit()


@final
class _Check:
    """Velocities by differentiation of positions, on a graph of their own: that of the scene stays as it is."""

    def __init__(self, scene: Scene, frames: Tree, points: Tree) -> None:
        self.scene, self.frames, self.points = scene, frames, points
        self.reader = reader_of(scene)
        self.graph, self.flow = self.reader.graph, self.reader.flow()
        self._from_root: dict[Any, Matrix | None] = {scene.frame: self._identity()}
        self._from_parent: dict[Any, Matrix] = {}

    def _read(self, e: Any) -> Node:
        return self.reader.read(e, "", accelerations=True)  # of inputs whose rates are angles

    def _identity(self) -> Matrix:
        return [[self.graph.const(int(i == j)) for j in range(3)] for i in range(3)]

    def from_root(self, frame: Any) -> Matrix | None:
        """Return the matrix from components on the scene's frame to `frame`; None unless a rotation for every q."""
        if frame not in self._from_root:
            parent = self.frames.parent[frame]
            entries = frame._dcm_dict[parent]
            step = [[self._read(entries[i, j]) for j in range(3)] for i in range(3)]
            square = matmul(self.graph, step, transpose(step))
            rotation = agree([x for row in square for x in row], [x for row in self._identity() for x in row])
            above = self.from_root(parent)
            known = rotation and above is not None
            self._from_parent[frame] = step
            self._from_root[frame] = matmul(self.graph, step, above) if known and above is not None else None
        return self._from_root[frame]

    def on_root(self, vector: Any) -> list[Node] | None:
        """Return the components of a vector on the scene's frame; None where it has symbols that are not known."""
        total = [self.graph.zero] * 3
        for matrix, frame in getattr(vector, "args", ()):
            turn = self.from_root(frame) if frame in self.frames.parent else None
            if turn is None or any(f not in self.reader.leaves for f in matrix.atoms(AppliedUndef)):
                return None
            part = matvec(self.graph, transpose(turn), [self._read(_of_real_numbers(x)) for x in matrix])
            total = [a + b for a, b in zip(total, part, strict=True)]
        return total

    def spin(self, frame: Any) -> list[Node] | None:
        """Return the angular velocity of a frame, on the scene's: the axial vector of dR^T/dt R."""
        turn = self.from_root(frame)
        return None if turn is None else self._axial(turn)

    def _axial(self, turn: Matrix) -> list[Node]:
        """Return the axial vector of dR^T/dt R."""
        rates = [tangents(self.graph, row, self.flow) for row in transpose(turn)]
        skew = matmul(self.graph, rates, turn)
        return [skew[2][1], skew[0][2], skew[1][0]]

    def in_parent(self, frame: Any, given: Any) -> tuple[list[Node], list[Node]] | None:
        """Return the angular velocity of a frame in its parent, and a vector, on the parent.

        None where the vector is written on other frames or has symbols that are not known, and unless frames are known
        to turn. Along chains the way to the frame of the scene is long.
        """
        parent = self.frames.parent[frame]
        if self.from_root(frame) is None:
            return None
        turn, total = self._from_parent[frame], [self.graph.zero] * 3
        for matrix, on in getattr(given, "args", ()):
            if on not in (frame, parent) or any(f not in self.reader.leaves for f in matrix.atoms(AppliedUndef)):
                return None
            part = [self._read(_of_real_numbers(x)) for x in matrix]
            part = matvec(self.graph, transpose(turn), part) if on is frame else part
            total = [a + b for a, b in zip(total, part, strict=True)]
        return self._axial(turn), total

    def frame(self, frame: Any) -> list[str]:
        """Return the faults of the angular velocities that were set for a frame."""
        faults = []
        for other, given in frame._ang_vel_dict.items():
            if other is not self.frames.parent[frame] and other is not self.scene.frame:
                continue
            local = self.in_parent(frame, given) if other is self.frames.parent[frame] else None
            if local is not None and self.same(*local):
                continue
            own, base = self.spin(frame), self.spin(other)
            if own is None or base is None or self.equal(own, base, given):
                continue
            faults.append(
                f"the angular velocity of frame {frame.name!r} in {other.name!r} was set to {given}, but its"
                f" orientation {'is constant' if agree(own, base) else 'gives another one'}. {_REMEDY}"
            )
        return faults

    def point(self, point: Any) -> list[str]:
        """Return the faults of the velocity that was set for a point."""
        given = point._vel_dict.get(self.scene.frame)
        if given is None:
            return []
        places = [self.on_root(node._pos_dict[self.points.parent[node]]) for node in self.points.path(point) or ()]
        total = [self.graph.zero] * 3
        for place in places:
            if place is None:
                return []
            total = [a + b for a, b in zip(total, place, strict=True)]
        found = tangents(self.graph, total, self.flow)
        rest = [self.graph.zero] * 3
        if self.equal(found, rest, given):
            return []
        how = "is constant" if agree(found, rest) else "gives another one"
        return [f"the velocity of point {point.name!r} was set to {given}, but its position {how}. {_REMEDY}"]

    def equal(self, found: Sequence[Node], base: Sequence[Node], given: Any) -> bool:
        """Whether a velocity is that of its base plus the one that was set.

        One in symbols that are not known is accepted unless nothing moves.
        """
        relative = self.on_root(given)
        if relative is None:
            return not (agree(found, base) and given != 0)
        return self.same(found, [a + b for a, b in zip(base, relative, strict=True)])

    def same(self, first: Sequence[Node], second: Sequence[Node]) -> bool:
        """Whether two vectors are one function: as they are written, or at many points."""
        return agree(first, second) or alike(first, second, self.reader.parameters)


def located(scene: Scene) -> bool:
    """Whether every point and frame with a prescribed velocity also has a position or an orientation."""
    points, frames = Tree(scene.origin, "_pos_dict"), Tree(scene.frame, "_dcm_dict")
    return all(
        (points if isinstance(target, Point) else frames).path(target) is not None for target, _ in scene.velocities
    )


def read_given(
    scene: Scene,
    vector: Callable[[Any, str], Pieces],
    scalar: Callable[[Any, str], Any],
    matrix: Callable[[Any, str], tuple[Components, Components, Components]],
    number: Callable[[ReferenceFrame, str], int],
) -> GivenMotion:
    """Return the bodies and loads of a scene with their prescribed velocities.

    Parameters
    ----------
    scene : Scene
        Its `velocities` hold every mass centre, body frame and target of a load.
    vector, scalar, matrix, number : callable
        Read vectors, scalars, symmetric matrices, and frames, met at a place.
    """
    given = {id(target): velocity for target, velocity in scene.velocities}
    bodies = []
    for body in scene.bodies:
        place = f"body {body.name!r}"
        mass = scalar(body.mass, f"mass of {place}")
        velocity = vector(given[id(body.masscenter)], f"velocity of {place}")
        if isinstance(body, Particle):
            bodies.append(GivenBody(body.name, mass, velocity, (), 0, None))
            continue
        spin = vector(given[id(body.frame)], f"angular velocity of {place}")
        dyadic = body.central_inertia
        frame = _frame_of(dyadic, body.frame)
        rows = matrix(matrix_of(dyadic, frame), f"inertia of {place}")
        bodies.append(GivenBody(body.name, mass, velocity, spin, number(frame, place), rows))
    loads = []
    for target, load in _pairs(scene):
        kind = "force at" if isinstance(target, Point) else "torque on"
        where = f"{kind} {target.name!r}"
        loads.append(GivenLoad(where, vector(load, where), vector(given[id(target)], f"velocity under the {where}")))
    return GivenMotion(tuple(bodies), tuple(loads))


def _pairs(scene: Scene) -> list[tuple[Any, Any]]:
    """Return the loads of a scene, all pairs of a point or frame and a vector."""
    faults = [
        f"load {number + 1} is (body, point, force), and the scene prescribes velocities: give the point, and its"
        " velocity as part of the body, in place of the body"
        for number, load in enumerate(scene.loads)
        if len(load) != 2
    ]
    if faults:
        raise SceneError(scene.name, faults)
    return [(target, vector) for target, vector in scene.loads]


def _frame_of(dyadic: Any, frame: ReferenceFrame) -> ReferenceFrame:
    """Return the frame that an inertia is written on, which need not be that of its body."""
    for _, first, _ in dyadic.args:
        for _, on in first.args:
            written: ReferenceFrame = on
            return written
    return frame
