"""Balances of bodies: equations of motion of groups of bodies that a virtual velocity moves as one rigid body.

The coordinates of a scene leave directions out, in which bodies cannot move. The power of inertia, loads and reactions
on such a direction gives an equation that the coordinates do not have: that of Newton and Euler for the group, along a
direction or about a point. Accelerations are with second rates of the coordinates, which are inputs here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import final

from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..naming import acceleration_input
from ..scene.model import Action, Piece, Pieces, SceneModel
from ..transforms.derivatives import tangents
from . import screws as vec
from .equations import moved_to
from .kinematics import Kinematics
from .screws import Screw
from .virtual_power import inertia_screw


@final
@frozen
class Movement:
    """A virtual velocity of a group of bodies: along a direction or, with a point, about it.

    Attributes
    ----------
    bodies : tuple of int
        Numbers of the bodies that move as one.
    direction : Pieces
    about : int or None
        Number of the point that rests.
    """

    bodies: tuple[int, ...]
    direction: Pieces
    about: int | None = None


@final
class BodyBalances:
    """Screws of inertia less loads and reactions, body by body, on a graph of their own.

    Attributes
    ----------
    model : SceneModel
        The scene on that graph.
    poses : list of Pose
        Of the bodies, at their mass centres.
    screws : list of Screw
        About the mass centres, on the frames of the poses.
    ties : list of (int, int)
        Bodies between which a load could not be shared out: it acts at what belongs to both.
    floating : list of str
        Loads that act on no body.
    """

    def __init__(self, model: SceneModel) -> None:
        graph = model.graph.copy()
        self.model = replace(moved_to(model, model.graph, graph), graph=graph)
        self.kinematics = Kinematics(self.model)
        names = map(acceleration_input, self.model.symbols.coordinates)
        self.kinematics.flow |= dict(zip(self.kinematics.qdot, map(graph.input, names), strict=True))
        self.poses = [self.kinematics.body_pose(body) for body in self.model.bodies]
        self.screws: list[Screw] = [
            inertia_screw(graph, body, pose) for body, pose in zip(self.model.bodies, self.poses, strict=True)
        ]
        self.ties: list[tuple[int, int]] = []
        self.floating: list[str] = []
        self.moving = graph.mask((self.model.symbols.time, *self.model.symbols.coordinates))
        for action in self.model.actions:
            self._subtract(action)

    @property
    def graph(self) -> Graph:
        """The graph of the balances."""
        return self.model.graph

    # -- actions ----------------------------------------------------------------------------

    def _subtract(self, action: Action) -> None:
        """Subtract an action from the screw of the body that it acts on."""
        body = action.target if action.on_body else self._acted_on(action)
        if body is None:
            return
        model, pose = self.model.bodies[body], self.poses[body]
        arm = vec.zero(self.graph)
        if model.inertia is not None and action.at is not None:
            arm = self.kinematics.between(model.centre, action.at, pose.frame)
        force = self.kinematics.resolve(action.force, pose.frame)
        torque = vec.add(self.kinematics.resolve(action.torque, pose.frame), vec.cross(arm, force))
        own = self.screws[body]
        self.screws[body] = (vec.subtract(own[0], force), vec.subtract(own[1], torque))

    def _acted_on(self, action: Action) -> int | None:
        """Return the body that a load (point, force) or (frame, torque) acts on; None where it acts on none."""
        if not any(not x.is_zero for piece in (*action.force, *action.torque) for x in piece.components):
            return None
        if action.kind == "torque":
            assert action.target is not None
            found = [i for i, body in enumerate(self.model.bodies) if body.inertia and body.frame == action.target]
            fixed = not self._turning(action.target)
        else:
            assert action.at is not None
            found = [i for i in range(len(self.poses)) if self.carries(i, action.at)]
            fixed = not self._travelling(action.at)
        if not found:
            self.floating += [] if fixed else [action.name]
            return None
        if action.at is not None:
            found = self._nearest(found, action.at)
        self.ties += [(found[0], other) for other in found[1:]]
        return found[0]

    def _nearest(self, bodies: list[int], point: int) -> list[int]:
        """Return those of some bodies that a point is most likely of: at the centre, located from it, on its frame."""
        path, carrier = self._points(point), self.kinematics.carrier(point)
        centres = [self.model.bodies[i].centre for i in bodies]
        last = max((path.index(c) for c in centres if c in path[1:]), default=None)
        if last is not None:
            return [i for i, c in zip(bodies, centres, strict=True) if c == path[last]]
        own = [
            i for i in bodies if carrier != 0 and self.model.bodies[i].inertia and self.model.bodies[i].frame == carrier
        ]
        return own or bodies

    def carries(self, body: int, point: int) -> bool:
        """Whether a point is fixed on a body."""
        model = self.model.bodies[body]
        arm = self.kinematics.between(model.centre, point, self.poses[body].frame)
        if model.inertia is None:
            return vec.is_zero(arm)
        return not any(x.deps & self.moving for x in arm)

    def _points(self, point: int) -> list[int]:
        """Return a point and those that it is located from, up to the origin."""
        found, current = [], self.model.points[point].parent
        found.append(point)
        while current is not None:
            found.append(current)
            current = self.model.points[current].parent
        return found[::-1]

    def _turning(self, frame: int) -> bool:
        rows = [row for number in self.kinematics.ancestry(frame) for row in self.model.frames[number].rotation or ()]
        return any(x.deps & self.moving for row in rows for x in row)

    def _travelling(self, point: int) -> bool:
        pieces = [piece for pieces in self.kinematics.point_pieces(point) for piece in pieces]
        return any(self._turning(p.frame) or any(x.deps & self.moving for x in p.components) for p in pieces)

    # -- what bodies are located from ----------------------------------------------------------

    def parents(self, body: int) -> tuple[list[int], list[int], list[int | None]]:
        """Return the bodies with which one shares its centre, those from which it is oriented, and located from.

        None is the fixed frame.
        """
        own = self.model.bodies[body]
        beside = [i for i, other in enumerate(self.model.bodies) if i != body and other.centre == own.centre]
        turned = [] if own.inertia is None else self._on_frames(self.kinematics.ancestry(own.frame)[:-1], body)
        return beside, turned, self._located_from(body)

    def _located_from(self, body: int) -> list[int | None]:
        """Return the bodies with the last of the points that a body is located from which is a point of some body.

        The centre about which a wheel turns is a point of the wheel and of what carries it, so of several.
        """
        own = self.model.bodies[body]
        outer = self.kinematics.ancestry(own.frame) if own.inertia is not None else []
        found: list[int | None] = []
        common: int | None = None
        for number in reversed(self._points(own.centre)):
            centred = [i for i, other in enumerate(self.model.bodies) if other.centre == number]
            if common is None and centred and number != own.centre:
                found, common = [*centred], number
            for piece in self.model.points[number].position:
                inner = [f for f in self.kinematics.ancestry(piece.frame) if f not in outer]
                more = [i for i in self._on_frames(inner, body) if common is None or self.carries(i, common)]
                if more:
                    return [*found, *more]
        if common is None or not self._travelling(common):
            found.append(None)
        return found

    def _on_frames(self, frames: Sequence[int], body: int) -> list[int]:
        """Return the bodies on the last of the frames that has some."""
        rigid: dict[int, list[int]] = {}
        for i, other in enumerate(self.model.bodies):
            if i != body and other.inertia and other.frame != 0:
                rigid.setdefault(other.frame, []).append(i)
        return next((rigid[frame] for frame in reversed(frames) if frame in rigid), [])

    # -- balances -----------------------------------------------------------------------------

    def power(self, movement: Movement) -> Node:
        """Return the power of inertia less loads and reactions on a movement, which vanishes along every motion."""
        total = self.graph.zero
        for body in movement.bodies:
            pose, (resultant, moment) = self.poses[body], self.screws[body]
            turn = self.kinematics.resolve(movement.direction, pose.frame)
            if movement.about is None:
                total = total + vec.dot(turn, resultant)
                continue
            arm = self.kinematics.between(movement.about, self.model.bodies[body].centre, pose.frame)
            total = total + vec.dot(vec.cross(turn, arm), resultant)
            if self.model.bodies[body].inertia is not None:
                total = total + vec.dot(turn, moment)
        return total

    def along(self, pieces: Pieces, unknown: Node) -> Pieces:
        """Return the direction of an unknown component in a vector."""
        found = []
        for piece in pieces:
            x, y, z = tangents(self.graph, piece.components, {unknown: self.graph.one})
            if not vec.is_zero((x, y, z)):
                found.append(Piece(piece.frame, (x, y, z)))
        return tuple(found)
