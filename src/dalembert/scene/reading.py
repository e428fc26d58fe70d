"""Check and reading of scenes: [Scene] -> [SceneModel], or one error with all faults."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, final

import sympy as sp

from ..errors import TOO_DEEP, LoadWarning, SceneError, UnknownNameError, unknown_name, warn_caller
from ..frozen import frozen
from ..ir.node import Node
from ..naming import acceleration_input, acceleration_name, rate_name, unwritable
from .content_reading import ContentReader
from .expressions.kink_checks import contacts_with_kinks, kinks_in_motion, rough_tables
from .geometry import GeometryReader
from .joints.checks import foreign_points, points_off_particles, travelling_points
from .joints.compliances import read_compliances
from .joints.joints import Component, NamedOutput, Place
from .joints.sympy_joints import tree_faults
from .model import Action, BodyModel, ConstraintModel, GivenMotion, Piece, Pieces, SceneModel
from .scene import Scene
from .symbol_table import SymbolTable
from .symbols import RESERVED_OUTPUTS, Requirement
from .velocity_checks import located, read_given, velocity_faults

# Reader of requested outputs onto the graph of a scene.


@final
@frozen
class OutputNodes:
    """Outputs that were read, by name: expressions, points and vectors with the number of an axis.

    `chosen` are names that are not the text of what they are, and must not be those of something else.
    """

    values: Mapping[str, Node]
    places: Mapping[str, tuple[int, int]]
    vectors: Mapping[str, tuple[Pieces, int]]
    chosen: tuple[str, ...]


def read_outputs(reader: GeometryReader, outputs: Sequence[Any]) -> OutputNodes:
    """Return requested outputs on the graph, without plain names.

    Second rates may stand in them, so they are read after all that the motion depends on.
    """
    values: dict[str, Node] = {}
    places: dict[str, tuple[int, int]] = {}
    vectors: dict[str, tuple[Pieces, int]] = {}
    for item in outputs:
        name, where = str(item), f"output {item}"
        value = item.value if isinstance(item, NamedOutput) else item
        if isinstance(value, sp.Basic):
            values[name] = reader.expressions.read(value, where, unknowns=True, accelerations=True)
        elif isinstance(value, Place):
            places[name] = reader._point(value.point, where), value.axis
        elif isinstance(value, Component):
            vectors[name] = _pieces(reader, value.vector, where), value.axis
    chosen = tuple(str(item) for item in outputs if isinstance(item, NamedOutput | Place))
    return OutputNodes(values, places, vectors, chosen)


def _pieces(reader: GeometryReader, vector: Any, where: str) -> Pieces:
    """Return a vector, each piece on the frame that it is written on; angles stay as they are."""
    if not all(getattr(matrix, "shape", None) == (3, 1) for matrix, _ in vector.args):
        reader.faults.append(f"{where}: the vector has components that are not numbers")
        return ()
    found = []
    for matrix, frame in vector.args:
        x, y, z = (reader.expressions.read(e, where, unknowns=True, accelerations=True) for e in matrix)
        found.append(Piece(reader._frame(frame, where), (x, y, z)))
    return tuple(found)


def names_as_nodes(reader: GeometryReader, symbols: SymbolTable, outputs: Sequence[Any]) -> dict[str, Node]:
    """Return outputs that are names of the scene, under the names that the user chose for them.

    Raises
    ------
    UnknownNameError
        For a name that the scene does not have.
    OptionError
        For a name that an acceleration has and something else, too.
    """
    named, graph = reader.named_values(), reader.graph
    values = [item.value for item in outputs if isinstance(item, NamedOutput)]
    symbols.refuse_ambiguous([value for value in values if isinstance(value, str)])
    known = {name: name for name in (*symbols.unknowns, *symbols.variables, *RESERVED_OUTPUTS)}
    known |= {name: name for name in map(rate_name, symbols.states)}
    known |= {acceleration_name(name): acceleration_input(name) for name in symbols.coordinates}
    found: dict[str, Node] = {}
    for item in outputs:
        if isinstance(item, NamedOutput) and isinstance(item.value, str):
            name = symbols.aliases.get(item.value, item.value)
            if name in named:
                found[str(item)] = named[name]
            elif name in known or name in symbols.parameters:
                found[str(item)] = graph.input(known.get(name, name))
            else:
                raise UnknownNameError(f"output {str(item)!r}: {unknown_name('name', item.value, [*known, *named])}")
    return found


_SEVERAL = "bodies", "joints", "loads", "holonomic_constraints", "nonholonomic_constraints", "inputs", "contacts"
"""Lists of a scene; the methods that add to them are called ``add_`` and the name of the list."""


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
    try:
        return _SceneReader(scene).read(outputs)
    except RecursionError:
        raise SceneError(scene.name, [TOO_DEEP]) from None


@final
class _SceneReader(ContentReader):
    """One reading of one scene."""

    def read(self, outputs: Sequence[Any]) -> SceneModel:
        """Read everything, then raise the faults or return the model."""
        scene = self.scene
        lists = [name for name in _SEVERAL if any(isinstance(item, list) for item in getattr(scene, name))]
        self.faults += [f"add_{name} was given a list: unpack it, add_{name}(*items)" for name in lists]
        self.faults += _unwritable_names(scene)
        state_rates = self._state_rates()
        given, lagrangian = self._given()
        placed = lagrangian is None and (given is None or located(scene))
        bodies = self._bodies(placed, lagrangian)
        actions, stored = self._actions(placed)
        gravity, potentials = self._gravity_and_potentials()
        holonomic = [self._holonomic(c, i) for i, c in enumerate(scene.holonomic_constraints)]
        nonholonomic = [self._nonholonomic(c, i) for i, c in enumerate(scene.nonholonomic_constraints)]
        contacts, closing = self._contacts()
        requested = read_outputs(self, outputs)
        compliances = read_compliances(scene, self._scalar, self._moving(), self.faults.append)
        controllers = self._controllers(nonholonomic, contacts)
        requirements = self._smoothness(holonomic, nonholonomic, given, lagrangian, bodies)
        requirements += [Requirement(1, f"the {row.label}", [row.expression]) for row in closing]
        requirements += [Requirement(0, f"the slip velocity of {each.name!r}", each.slip or ()) for each in contacts]
        symbols, kinks = self._symbols(requirements), list[tuple[str, Node]]()
        if not (self.faults or self.expressions.faults):
            names = [q.func.__name__ for q in self.coordinates]
            kinked, kinks = kinks_in_motion(self.graph, names, requirements)
            contacts, unknown = contacts_with_kinks(self.graph, names, contacts)
            self.faults += kinked + unknown
        self._check(bodies, actions, symbols, requirements, placed)
        named = self.named_values()
        chosen = tuple(x for x in requested.chosen if x not in named or requested.values.get(x) is not named[x])
        named = {name: node for name, node in named.items() if name in outputs}
        return SceneModel(
            name=scene.name,
            graph=self.graph,
            symbols=symbols,
            frames=tuple(self.frame_models[i] for i in range(len(self.frame_models))),
            points=tuple(self.point_models[i] for i in range(len(self.point_models))),
            bodies=tuple(bodies),
            actions=tuple(actions),
            gravity=gravity,
            potentials=potentials,
            holonomic=(*holonomic, *closing),
            nonholonomic=tuple(nonholonomic),
            outputs={**requested.values, **named, **names_as_nodes(self, symbols, outputs)},
            contacts=tuple(contacts),
            speeds=self.speeds,
            given=given,
            lagrangian=lagrangian,
            places=requested.places,
            vectors=requested.vectors,
            chosen=chosen,
            conditions=tuple(self.expressions.conditions),
            stored=stored,
            state_rates=state_rates,
            controllers=controllers,
            kinks=tuple(kinks),
            compliances={name: c for name, c in compliances.items() if name in symbols.unknowns},
        )

    def _bodies(self, placed: bool, lagrangian: Node | None) -> list[BodyModel]:
        """Return the bodies; none where the scene has no positions (`placed`)."""
        bodies = [self._body(body) for body in self.scene.bodies] if placed else []
        if not self.scene.bodies and lagrangian is None:
            self.faults.append("the scene has no bodies; add some with add_bodies")
        names = list(self.scene.body_names())
        for name in sorted({name for name in names if names.count(name) > 1}):
            self.faults.append(f"two bodies are called {name!r}; give each its own name")
        return [body for body in bodies if body is not None]

    def _actions(self, placed: bool) -> tuple[list[Action], tuple[Node | None, ...]]:
        """Return the actions of joints, loads and actuators, and candidates for the actuators' potential energies."""
        names = list(self.scene.body_names())
        actions = [action for joint in self.scene.joints for action in self._joint(joint, names)]
        if not placed:
            return actions, ()
        loads = [self._load(load, number) for number, load in enumerate(self.scene.loads)]
        actions += [action for action in loads if action is not None]
        acting, stored = self._actuators()
        return actions + acting, stored

    def _gravity_and_potentials(self) -> tuple[Pieces, tuple[Node, ...]]:
        """Return the acceleration of gravity, and the potential energies that the bodies declare."""
        gravity = () if self.scene.gravity is None else self._vector(self.scene.gravity, "gravity")
        potentials = tuple(
            self._scalar(getattr(body, "potential_energy", 0), f"potential energy of {getattr(body, 'name', body)}")
            for body in self.scene.bodies
        )
        self._without_states([x for piece in gravity for x in piece.components], "gravity")
        self._without_states(potentials, "potential energy of bodies")
        return gravity, potentials

    def _check(
        self,
        bodies: Sequence[BodyModel],
        actions: Sequence[Action],
        symbols: SymbolTable,
        requirements: Sequence[Requirement],
        placed: bool,
    ) -> None:
        """Raise all faults of the scene together; some checks need a scene without faults up to here."""
        if not self.faults:
            self.faults += foreign_points(
                self.graph,
                [self.expressions.leaves[q] for q in self.coordinates],
                self.frame_models,
                self.point_models,
                bodies,
                actions,
                symbols.unknowns,
            )
        if not self.faults and placed:
            self.faults += points_off_particles(self.scene)
            self.faults += velocity_faults(self.scene, self.frames, self.points, self._met)
        self.faults += tree_faults(self.scene, self.frames, self.points) if placed else []
        self.faults += rough_tables(self.graph, requirements)
        faults = self.faults + self.expressions.faults
        if faults:
            raise SceneError(self.scene.name, faults)
        for text in travelling_points(self.frame_models, self.point_models, bodies, actions, self._moving()):
            warn_caller(f"scene {self.scene.name!r}: {text}", LoadWarning)

    def _given(self) -> tuple[GivenMotion | None, Node | None]:
        """Return the velocities and the Lagrangian of a scene that came from SymPy with them."""
        scene = self.scene
        if not scene.velocities and scene.lagrangian is None:
            return None, None
        listed = {"joints": scene.joints, "contacts": scene.contacts, "friction": scene.frictions}
        for what, items in {**listed, "actuators": scene.actuators}.items():
            if items:
                self.faults.append(f"a scene that gives velocities or a Lagrangian, no positions, cannot have {what}")
        given = read_given(scene, self._vector, self.expressions.read, self._rows, self._frame)
        velocities = [item.velocity for item in given.bodies] + [item.spin for item in given.bodies]
        velocities += [load.velocity for load in given.loads]
        moved = [x for pieces in velocities for piece in pieces for x in piece.components]
        self._without_states(moved, "velocities of bodies and points")
        lagrangian = None if scene.lagrangian is None else self._scalar(scene.lagrangian, "Lagrangian")
        self._without_states([] if lagrangian is None else [lagrangian], "Lagrangian")
        return given, lagrangian

    def _smoothness(
        self,
        holonomic: Sequence[ConstraintModel],
        nonholonomic: Sequence[ConstraintModel],
        given: GivenMotion | None,
        lagrangian: Node | None,
        bodies: Sequence[BodyModel],
    ) -> list[Requirement]:
        """Return how smooth constraints and positions must be: velocities may not jump.

        Points and frames that move no mass may have kinks in the state.
        """
        points, frames = self._moving_masses(bodies)
        leaves = self.expressions.leaves
        found = [Requirement(1, f"the {row.label}", [row.expression], 1) for row in holonomic]
        for i, point in self.point_models.items():
            nodes = [x for piece in point.position for x in piece.components]
            found.append(Requirement(1, f"the position of point {point.name!r}", nodes, 1 if i in points else -1))
        for i, frame in self.frame_models.items():
            nodes = [x for row in frame.rotation or () for x in row]
            found.append(Requirement(1, f"the orientation of frame {frame.name!r}", nodes, 1 if i in frames else -1))
        for q, _ in self.scene.imposed:
            found.append(Requirement(1, f"the imposed coordinate {q.func.__name__!r}", [leaves[q]]))
        found += [Requirement(0, f"the {row.label}", [row.expression], 0) for row in nonholonomic]
        for u in self.scene.speeds:
            if u in leaves:
                found.append(Requirement(0, f"the kinematic equation of {u.func.__name__!r}", [leaves[u]], 0))
        for body in () if given is None else given.bodies:
            nodes = [x for piece in (*body.velocity, *body.spin) for x in piece.components]
            found.append(Requirement(0, f"the velocity of body {body.name!r}", nodes, 0))
        if lagrangian is not None:
            found.append(Requirement(1, "the Lagrangian", [lagrangian], 0))
        return found


def _unwritable_names(scene: Scene) -> list[str]:
    """Return a fault for every name that cannot be written to a file."""
    named = [("scene", scene.name), *(("body", name) for name in scene.body_names())]
    named += [("joint", str(getattr(joint, "name", ""))) for joint in (*scene.joints, *scene.connections)]
    named += [("contact", str(getattr(item, "label", ""))) for item in (*scene.contacts, *scene.frictions)]
    return [
        f"the name of {kind} {name!a} has a lone surrogate, half of a character; use another name"
        for kind, name in dict.fromkeys(named)
        if unwritable(name)
    ]
