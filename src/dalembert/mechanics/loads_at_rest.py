"""Reader of given loads at zero rates onto the graph of the search for potentials."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..scene.model import Action, Components, Pieces
from . import screws as vec
from .kinematics import Kinematics, Pose


@final
@frozen
class LoadAtRest:
    """A load at zero rates.

    Attributes
    ----------
    name : str
    powers : tuple of Node, length n_q
        Power coefficients.
    rates : bool
        Whether the load depends on rates.
    force, position : Components or None
        A force and the position of its point on the root frame; None for torques and loads without values at rest.
    """

    name: str
    powers: tuple[Node, ...]
    rates: bool
    force: Components | None = None
    position: Components | None = None


class LoadReader:
    """Loads of one scene, read onto another graph."""

    def __init__(self, kinematics: Kinematics, graph: Graph) -> None:
        self.kinematics, self.graph = kinematics, graph
        symbols = kinematics.model.symbols
        self.q = [graph.input(name) for name in symbols.coordinates]
        self.rates = [graph.input(name) for name in symbols.rates]
        self._known: dict[int, Node] = {}

    def adopt(self, nodes: Sequence[Node]) -> tuple[Node, ...]:
        """Return nodes of the scene's graph on that of the search."""
        self.graph.visit(nodes, self._known, lambda node: self.graph.adopt_one(node, self._known))
        return tuple(self._known[node.index] for node in nodes)

    def _vector(self, a: Components) -> Components:
        x, y, z = self.adopt(a)
        return x, y, z

    def at_rest(self, nodes: Sequence[Node]) -> tuple[Node, ...]:
        """Return nodes with all rates zero; ``ZeroDivisionError`` where they have no value there."""
        return tuple(self.graph.substitute(list(nodes), dict.fromkeys(self.rates, self.graph.zero)))

    def load(self, action: Action) -> LoadAtRest:
        """Return a force or a torque with its power coefficients."""
        kinematics, zero = self.kinematics, vec.zero(self.graph)
        if action.kind == "body force":
            return self._on_body(action)
        if action.kind == "force":
            assert action.at is not None
            pose = kinematics.pose(kinematics.carrier(action.at), action.at)
        else:
            assert action.target is not None
            pose = next((p for p in kinematics.poses if p.frame == action.target), None) or kinematics.pose(
                action.target, 0
            )
        given = kinematics.resolve(action.force or action.torque, pose.frame)
        vector = self._vector(given)
        rest = self._without_rates(vector)
        if rest is None:
            return LoadAtRest(action.name, (self.graph.zero,) * len(self.q), True)
        still: Components = (rest[0], rest[1], rest[2])
        rates = any(a is not b for a, b in zip(vector, still, strict=True))
        screw = (still, zero) if action.kind == "force" else (zero, still)
        if action.at is None:
            return LoadAtRest(action.name, self._powers(pose, screw), rates)
        force = self._without_rates(self._on_root(action.force))
        place = None if force is None else self._place(action.at)
        on_root = None if force is None else (force[0], force[1], force[2])
        return LoadAtRest(action.name, self._powers(pose, screw), rates, on_root, place)

    def _on_body(self, action: Action) -> LoadAtRest:
        """Return a force on a body, at a point that need not be fixed on it."""
        kinematics = self.kinematics
        assert action.target is not None and action.at is not None
        body = kinematics.model.bodies[action.target]
        pose = kinematics.body_pose(body)
        given = self._vector(kinematics.resolve(action.force, pose.frame))
        arm = vec.zero(self.graph)
        if body.inertia is not None:
            arm = self._vector(kinematics.between(body.centre, action.at, pose.frame))
        rest = self._without_rates(given)
        if rest is None:
            return LoadAtRest(action.name, (self.graph.zero,) * len(self.q), True)
        still: Components = (rest[0], rest[1], rest[2])
        rates = any(a is not b for a, b in zip(given, still, strict=True))
        return LoadAtRest(action.name, self._powers(pose, (still, vec.cross(arm, still))), rates)

    def named(self, name: str, powers: Sequence[Node]) -> LoadAtRest:
        """Return a load of which only the power coefficients are known."""
        whole = self.adopt(powers)
        still = self._without_rates(whole)
        zero = (self.graph.zero,) * len(self.q)
        return LoadAtRest(
            name, still or zero, still is None or any(a is not b for a, b in zip(whole, still, strict=True))
        )

    def _without_rates(self, nodes: Sequence[Node]) -> tuple[Node, ...] | None:
        mask = sum(rate.deps for rate in self.rates)
        if not any(node.deps & mask for node in nodes):
            return tuple(nodes)
        try:
            return self.at_rest(nodes)
        except ZeroDivisionError:
            return None

    def _powers(self, pose: Pose | None, screw: tuple[Components, Components]) -> tuple[Node, ...]:
        """Return the power coefficients of a screw, carried from its pose to the origin."""
        total = [self.graph.zero] * len(self.q)
        resultant, moment = screw
        while pose is not None:
            if vec.is_zero(resultant) and vec.is_zero(moment):
                break
            for motion in pose.motions:
                direction = self._vector(motion.direction)
                power = vec.dot(direction, moment if motion.angular else resultant)
                total[motion.coordinate] = total[motion.coordinate] + power
            if pose.offset is not None:
                moment = vec.add(moment, vec.cross(self._vector(pose.offset), resultant))
            elif pose.rotation is not None:
                rotation = [self._vector(row) for row in pose.rotation]
                resultant, moment = vec.rotate_back(rotation, resultant), vec.rotate_back(rotation, moment)
            pose = pose.parent
        return tuple(total)

    def _on_root(self, pieces: Pieces) -> Components:
        """Return a vector on the root frame, each piece straight from the frame that it is written on.

        The way over the frame of a body would be another one off the unit sphere of a quaternion.
        """
        total = vec.zero(self.graph)
        for piece in pieces:
            part, model = self._vector(piece.components), self.kinematics.model.frames[piece.frame]
            while model.parent is not None and model.rotation is not None:
                part = vec.rotate_back([self._vector(row) for row in model.rotation], part)
                model = self.kinematics.model.frames[model.parent]
            total = vec.add(total, part)
        return total

    def _place(self, point: int) -> Components:
        """Return the position of a point on the root frame."""
        total = vec.zero(self.graph)
        for pieces in self.kinematics.point_pieces(point):
            total = vec.add(total, self._on_root(pieces))
        return total
