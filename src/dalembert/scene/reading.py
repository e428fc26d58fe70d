"""[Scene] -> [SceneModel]: checks a scene, reports all its faults at once, and reads it onto the graph."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody
from sympy.physics.vector import Vector, dynamicsymbols

from ..errors import SceneError, list_names
from ..ir.derivatives import tangents
from ..ir.graph import Graph, Node
from ..ir.quaternions import rotation_entries
from ..naming import rate_name
from . import changes
from .angles import Angles
from .belonging import foreign_points
from .contacts import read_contacts
from .entries import entries_of
from .expressions import ExpressionReader
from .given import located, read_given
from .model import (
    Action,
    BodyModel,
    Components,
    ConstraintModel,
    ContactModel,
    FrameModel,
    GivenMotion,
    Piece,
    Pieces,
    PointModel,
    SceneModel,
    SymbolTable,
)
from .said import contradictions
from .scene import Joint, Place, Scene, Unknown
from .speeds import read_speeds
from .tree import Tree

__all__ = ["read", "reader_of"]

TIME = "t"
_IMPLIED = (
    "is already implied by the parametrization: it vanishes whatever the coordinates. Remove it; for the reaction that"
    " it would hold, give a coordinate back with scene.release(coordinate, point or frame, direction)"
)
RESERVED_OUTPUTS = ("energy", "kinetic_energy", "potential_energy")


def read(scene: Scene, outputs: Sequence[Any] = ()) -> SceneModel:
    """Return `scene` on the expression graph.

    Parameters
    ----------
    scene : Scene
        The scene; it is not changed.
    outputs : sequence of expressions and places
        Further expressions in the scene's symbols, and places of points, read beside it and kept under their text.

    Raises
    ------
    SceneError
        With every fault found.
    """
    return _SceneReader(scene).read(outputs)


def reader_of(scene: Scene) -> ExpressionReader:
    """Return a reader of further expressions in the symbols of a scene that was read before, on a graph of its own."""
    return _SceneReader(scene).expressions


@final
class _SceneReader:
    """One reading of one scene."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.graph = Graph()
        self.faults: list[str] = []
        self.coordinates = self._coordinates()
        self.expressions = ExpressionReader(self.graph, self._leaves())
        self._impose()
        self.speeds, self._starts, self._names = read_speeds(
            self.expressions, self.coordinates, scene.speeds, scene.kinematic_equations, self.faults.append
        )
        self.angles = [Angles(self.expressions, item) for item in scene.orientations if item.angles]
        self._free = {item.frame: item for item in scene.orientations if item.angles}
        self.frames = Tree(scene.frame, "_dcm_dict")
        self.points = Tree(scene.origin, "_pos_dict")
        self.frame_models: dict[int, FrameModel] = {0: FrameModel(scene.frame.name, None, None)}
        self.point_models: dict[int, PointModel] = {0: PointModel(scene.origin.name, None, ())}
        self._met: list[Any] = [scene.origin]

    def read(self, outputs: Sequence[Any]) -> SceneModel:
        """Read everything, then raise the faults or return the model."""
        scene = self.scene
        given, lagrangian = self._given()
        placed = lagrangian is None and (given is None or located(scene))
        bodies = [self._body(body) for body in scene.bodies] if placed else []
        if not scene.bodies and lagrangian is None:
            self.faults.append("the scene has no bodies; add some with add_bodies")
        names = list(scene.body_names())
        for name in sorted({name for name in names if names.count(name) > 1}):
            self.faults.append(f"two bodies are called {name!r}; give each its own name")
        actions = [self._joint(joint, names) for joint in scene.joints]
        actions += [self._load(load, place) for place, load in enumerate(scene.loads)] if placed else []
        gravity = () if scene.gravity is None else self._vector(scene.gravity, "gravity")
        potential = self.graph.sum(
            self._scalar(getattr(body, "potential_energy", 0), f"potential energy of {getattr(body, 'name', body)}")
            for body in scene.bodies
        )
        holonomic = [self._holonomic(c, i) for i, c in enumerate(scene.holonomic_constraints)]
        nonholonomic = [self._nonholonomic(c, i) for i, c in enumerate(scene.nonholonomic_constraints)]
        extra = {
            str(item): self.expressions.read(item, f"output {item}", unknowns=True)
            for item in outputs
            if isinstance(item, sp.Basic)
        }
        places = {
            str(item): (self._point(item.point, f"output {item}"), item.axis)
            for item in outputs
            if isinstance(item, Place)
        }
        contacts, closing = self._contacts()
        extra |= self._named_outputs(outputs)
        symbols = self._symbols()
        if not self.faults:
            self.faults += foreign_points(
                self.graph,
                [self.expressions.leaves[q] for q in self.coordinates],
                self.frame_models,
                self.point_models,
                [body for body in bodies if body is not None],
                [action for action in actions if action is not None],
                symbols.unknowns,
            )
        if not self.faults and placed:
            self.faults += contradictions(scene, self.frames, self.points, self._met)
        faults = self.faults + self.expressions.faults
        if faults:
            raise SceneError(scene.name, faults)
        return SceneModel(
            name=scene.name,
            graph=self.graph,
            symbols=symbols,
            frames=tuple(self.frame_models[i] for i in range(len(self.frame_models))),
            points=tuple(self.point_models[i] for i in range(len(self.point_models))),
            bodies=tuple(body for body in bodies if body is not None),
            actions=tuple(action for action in actions if action is not None),
            gravity=gravity,
            potential=potential,
            holonomic=(*holonomic, *closing),
            nonholonomic=tuple(nonholonomic),
            outputs=extra,
            contacts=tuple(contacts),
            speeds=self.speeds,
            given=given,
            lagrangian=lagrangian,
            places=places,
        )

    # -- symbols --------------------------------------------------------------------------

    def _coordinates(self) -> tuple[Any, ...]:
        good: list[Any] = []
        time = dynamicsymbols._t
        for q in self.scene.coordinates:
            if not (isinstance(q, AppliedUndef) and q.args == (time,)):
                self.faults.append(f"coordinate {q!r} is not a function of time; make it with dynamicsymbols")
            elif q.func.__name__ in {g.func.__name__ for g in good}:
                self.faults.append(f"coordinate {q.func.__name__!r} is given twice")
            else:
                good.append(q)
        if not self.scene.coordinates:
            self.faults.append("the scene has no coordinates; give them as coordinates=[...]")
        return tuple(good)

    def _named_outputs(self, outputs: Sequence[Any]) -> dict[str, Node]:
        """Return angles that quaternions stand for, their rates, and speeds, by name, where they are asked for."""
        time, leaves = dynamicsymbols._t, self.expressions.leaves
        found: dict[str, Node] = {u.func.__name__: leaves[u] for u in self.scene.speeds}
        for angle in (angle for item in self.scene.orientations for angle in item.angles):
            name = angle.func.__name__
            found |= {name: leaves[angle], rate_name(name): leaves[sp.Derivative(angle, time)]}
        return {name: node for name, node in found.items() if name in outputs}

    def _leaves(self) -> dict[Any, Node]:
        time = dynamicsymbols._t
        leaves: dict[Any, Node] = {time: self.graph.input(TIME)}
        for q in self.coordinates:
            leaves[q] = self.graph.input(q.func.__name__)
        for q in self.coordinates:
            leaves[sp.Derivative(q, time)] = self.graph.input(rate_name(q.func.__name__))
        return leaves

    def _impose(self) -> None:
        """Let imposed coordinates and their rates be read as what they equal."""
        time, leaves = dynamicsymbols._t, self.expressions.leaves
        flow = {leaves[q]: leaves[sp.Derivative(q, time)] for q in self.coordinates} | {leaves[time]: self.graph.one}
        values = [(q, self.expressions.read(e, f"imposed coordinate {q}")) for q, e in self.scene.imposed]
        for q, node in values:
            leaves[q] = node
            leaves[sp.Derivative(q, time)] = tangents(self.graph, [node], flow)[0]

    def _symbols(self) -> SymbolTable:
        coordinates = tuple(q.func.__name__ for q in self.coordinates)
        rates = tuple(rate_name(name) for name in coordinates)
        parameters = tuple(sorted(self.expressions.parameters))
        unknowns = tuple(self.expressions.unknowns)
        taken = {TIME: "time", **dict.fromkeys(coordinates, "a coordinate"), **dict.fromkeys(rates, "a rate")}
        taken.update(dict.fromkeys(RESERVED_OUTPUTS, "an output of every model"))
        speeds = [u.func.__name__ for u in self.scene.speeds]
        taken.update(dict.fromkeys(speeds, "a speed"))
        kinds = (("parameter", parameters), ("unknown", unknowns), ("coordinate", coordinates), ("speed", speeds))
        for kind, names in kinds:
            for name in names:
                if name in taken and taken[name] != f"a {kind}":
                    meant = " (where time is meant, use dynamicsymbols._t itself)" if name == TIME else ""
                    self.faults.append(f"the {kind} {name!r} has the name of {taken[name]}; rename it{meant}")
        time = dynamicsymbols._t
        aliases = {name: name for name in (*coordinates, *rates, *parameters, *unknowns, TIME)}
        for q, name, rate in zip(self.coordinates, coordinates, rates, strict=True):
            aliases[str(q)] = name
            aliases[str(sp.Derivative(q, time))] = rate
        for angle in (angle for item in self.scene.orientations for angle in item.angles):
            name = angle.func.__name__
            aliases |= {str(angle): name, str(sp.Derivative(angle, time)): rate_name(name)}
            aliases |= {name: name, rate_name(name): rate_name(name)}
        for u in self.scene.speeds:
            name = u.func.__name__
            aliases |= {str(u): self._names.get(name, name), name: self._names.get(name, name)}
        entries = (*entries_of(self.graph, self.scene.orientations), *self._starts)
        return SymbolTable(TIME, coordinates, rates, parameters, unknowns, aliases, entries)

    # -- geometry -------------------------------------------------------------------------

    def _frame(self, frame: ReferenceFrame, place: str) -> int:
        """Return the number of a frame, reading it and its ancestors when first met."""
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
                matrix = changes.turned(self.scene, node, parent, node._dcm_dict[parent])
                where = f"orientation of frame {node.name!r}"
                rows = [self._components(matrix[i, :], where) for i in range(3)]
                self._met.append(node)
                self.frame_models[known] = FrameModel(node.name, number, (rows[0], rows[1], rows[2]))
            number = known
        return number

    def _shortened(self, path: list[ReferenceFrame]) -> list[ReferenceFrame]:
        """Return the frames on a way without those that a free orientation makes superfluous."""
        for node in reversed(path):
            if node in self._free:
                skipped = self._free[node].between
                return [frame for frame in path if frame not in skipped]
        return path

    def _point(self, point: Point, place: str) -> int:
        """Return the number of a point, reading it and its ancestors when first met."""
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
                vector = changes.moved(self.scene, node, node._pos_dict[self.points.parent[node]])
                pieces = self._vector(vector, f"position of point {node.name!r}")
                self._met.append(node)
                self.point_models[known] = PointModel(node.name, number, pieces)
            number = known
        return number

    def _components(self, column: Any, place: str, *, unknowns: bool = False) -> Components:
        x, y, z = (self.expressions.read(entry, place, unknowns=unknowns) for entry in column)
        return x, y, z

    def _scalar(self, expression: Any, place: str) -> Node:
        """Return a scalar that the motion depends on, in which angles have given way to quaternions."""
        for angles in self.angles:
            if angles.concerns(expression):
                found = angles.scalar(expression, place)
                if found is None:
                    self.faults.append(f"{place}: {angles.complaint(_short(expression))}")
                return self.graph.zero if found is None else found
        return self.expressions.read(expression, place)

    def _turned(self, vector: Vector, place: str, angles: Angles, *, unknowns: bool) -> Pieces | None:
        """Return a vector that depends on angles in terms of their quaternion; None leaves it as it is."""
        found = angles.vector(vector, place, unknowns=unknowns)
        if found is not None:
            return tuple(Piece(self._frame(frame, place), (x, y, z)) for frame, (x, y, z) in found)
        held = {x for matrix, _ in vector.args for x in matrix.free_symbols if isinstance(x, Unknown)}
        if not unknowns or vector.subs(dict.fromkeys(held, 0)) != 0:
            self.faults.append(f"{place}: {angles.complaint(_short(vector))}")
        return None

    def _vector(self, vector: Any, place: str, *, unknowns: bool = False) -> Pieces:
        if vector == 0:
            return ()
        if not isinstance(vector, Vector):
            self.faults.append(f"{place}: {vector!r} is not a vector")
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

    # -- contents -------------------------------------------------------------------------

    def _given(self) -> tuple[GivenMotion | None, Node | None]:
        """Return the velocities and the Lagrangian of a scene that came from SymPy with them."""
        scene = self.scene
        if not scene.velocities and scene.lagrangian is None:
            return None, None
        for what, items in (("joints", scene.joints), ("contacts", scene.contacts), ("friction", scene.frictions)):
            if items:
                self.faults.append(f"a scene that gives velocities or a Lagrangian, no positions, cannot have {what}")
        given = read_given(scene, self._vector, self.expressions.read, self._rows, self._frame)
        lagrangian = scene.lagrangian
        return given, None if lagrangian is None else self._scalar(lagrangian, "Lagrangian")

    def _rows(self, matrix: Any, place: str) -> tuple[Components, Components, Components]:
        rows = [self._components(matrix[i, :], place) for i in range(3)]
        if any(rows[i][j] is not rows[j][i] for i in range(3) for j in range(i)):
            self.faults.append(f"{place}: the matrix is not symmetric")
        return rows[0], rows[1], rows[2]

    def _body(self, body: Any) -> BodyModel | None:
        if not isinstance(body, RigidBody | Particle):
            self.faults.append(f"{body!r} is not a RigidBody or Particle")
            return None
        place = f"body {body.name!r}"
        if isinstance(body, Particle):
            mass = self._mass(body, place)
            return BodyModel(body.name, 0, self._point(body.point, place), mass, None)
        frame = self._frame(body.frame, place)
        inertia = self._rows(body.central_inertia.to_matrix(body.frame), f"inertia of {place}")
        moving = self._mask("coordinates") | self._mask("rates") | self.graph.mask([TIME])
        if any(entry.deps & moving for row in inertia for entry in row):
            self.faults.append(
                f"the inertia of {place} changes along the motion on the frame {body.frame.name!r} of the body, where"
                " it must be constant: write it on that frame, or give the body the frame that it is written on"
            )
        mass = self._mass(body, place)
        return BodyModel(body.name, frame, self._point(body.masscenter, place), mass, inertia)

    def _mass(self, body: Any, place: str) -> Node:
        mass = self.expressions.read(body.mass, f"mass of {place}")
        if mass.deps & (self._mask("coordinates") | self._mask("rates") | self.graph.mask([TIME])):
            self.faults.append(
                f"the mass of {place} changes along the motion; it must be constant, because equations of a mass that"
                " is lost or gained depend on the velocity with which it leaves or comes"
            )
        return mass

    def _joint(self, joint: Any, bodies: Sequence[str]) -> Action | None:
        if not isinstance(joint, Joint):
            self.faults.append(f"{joint!r} is not a Joint")
            return None
        place = f"joint {joint.name!r}"
        if joint.body not in bodies:
            self.faults.append(f"{place} acts on {joint.body!r}, which is no body; known: {list_names(bodies)}")
            return None
        return Action(
            joint.name,
            "screw",
            list(bodies).index(joint.body),
            self._point(joint.at, place),
            self._vector(joint.force, f"force of {place}", unknowns=True),
            self._vector(joint.torque, f"torque of {place}", unknowns=True),
        )

    def _load(self, load: Any, number: int) -> Action | None:
        place = f"load {number + 1}"
        pair = tuple(load) if isinstance(load, Sequence) and len(load) == 2 else (None, None)
        if isinstance(pair[0], Point):
            where = f"force at {pair[0].name!r}"
            return Action(where, "force", None, self._point(pair[0], where), self._vector(pair[1], where), ())
        if isinstance(pair[0], ReferenceFrame):
            where = f"torque on {pair[0].name!r}"
            return Action(where, "torque", self._frame(pair[0], where), None, (), self._vector(pair[1], where))
        self.faults.append(f"{place}: {load!r} is neither (point, force) nor (frame, torque)")
        return None

    def _holonomic(self, constraint: Any, number: int) -> ConstraintModel:
        label = f"holonomic constraint {number + 1}"
        before = len(self.expressions.faults)
        node = self._scalar(constraint, f"{label} ({_short(constraint)})")
        if node.deps & self._mask("rates"):
            self.faults.append(f"{label} ({_short(constraint)}) contains rates; add it as a nonholonomic constraint")
        elif node.is_zero and len(self.expressions.faults) == before:
            self.faults.append(f"{label} ({_short(constraint)}) {_IMPLIED}")
        elif not node.deps & self._mask("coordinates") and len(self.expressions.faults) == before:
            self.faults.append(f"{label} ({_short(constraint)}) contains no coordinate, so it constrains nothing")
        return ConstraintModel(f"{label}, {_short(constraint)} = 0", node)

    def _nonholonomic(self, constraint: Any, number: int) -> ConstraintModel:
        label = f"nonholonomic constraint {number + 1}"
        before = len(self.expressions.faults)
        node = self._scalar(constraint, f"{label} ({_short(constraint)})")
        rates = self._mask("rates")
        if node.is_zero and len(self.expressions.faults) == before:
            self.faults.append(f"{label} ({_short(constraint)}) {_IMPLIED}")
        elif not node.deps & rates and len(self.expressions.faults) == before:
            self.faults.append(
                f"{label} ({_short(constraint)}) contains no rate; add a constraint on positions with"
                " add_holonomic_constraints"
            )
        for q in self.coordinates:
            rate = self.graph.input(rate_name(q.func.__name__))
            slope = tangents(self.graph, [node], {rate: self.graph.one})[0]
            if self.graph.freed_of(slope, self._rates()) is None:
                self.faults.append(
                    f"{label} ({_short(constraint)}) is not affine in the rate of {q.func.__name__};"
                    " only constraints of the form sum a_i(q, t) q_dot_i + b(q, t) = 0 can be compiled"
                )
                break
        return ConstraintModel(f"{label}, {_short(constraint)} = 0", node)

    def _contacts(self) -> tuple[list[ContactModel], list[ConstraintModel]]:
        if not (self.scene.contacts or self.scene.frictions):
            return [], []
        forces = list(self.expressions.unknowns)
        return read_contacts(
            self.scene, self.expressions, self._rates(), self._mask("coordinates"), forces, self.faults.append
        )

    def _rates(self) -> list[Node]:
        return [self.graph.input(rate_name(q.func.__name__)) for q in self.coordinates]

    def _mask(self, kind: str) -> int:
        names = [q.func.__name__ for q in self.coordinates]
        return self.graph.mask(names if kind == "coordinates" else [rate_name(name) for name in names])


def _short(expression: Any, width: int = 80) -> str:
    """Return an expression as one short line."""
    text = str(expression).replace("(t)", "")
    return text if len(text) <= width else text[: width - 3] + "..."
