"""Check and reading of scenes: [Scene] -> [SceneModel], or one error with all faults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, final

from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody
from sympy.physics.vector import dynamicsymbols

from ..errors import RELEASE, TOO_DEEP, SceneError, list_names
from ..ir.graph import Graph, Node
from ..ir.zero_tests import agree
from ..naming import rate_name, unwritable
from ..transforms.derivatives import tangents
from .actuators import read_actuators
from .contacts import read_contacts
from .controllers import controller_symbols, read_controllers
from .dyadics import matrix_of
from .expressions import short
from .geometry import GeometryReader
from .joint_checks import foreign_points, points_off_particles, torques_on_particles
from .joints import Joint
from .model import (
    Action,
    BodyModel,
    Components,
    ConstraintModel,
    ContactModel,
    ControllerModel,
    GivenMotion,
    SceneModel,
)
from .output_reading import names_as_nodes, read_outputs
from .prescribed_velocities import located, read_given
from .scene import Scene
from .symbols import Requirement
from .table_checks import rough_tables
from .velocity_checks import velocity_faults

__all__ = ["read"]

_IMPLIED = (
    "is already implied by the parametrization: it vanishes for all coordinates. Remove it; for its reaction, release a"
    f" coordinate: {RELEASE}"
)


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
class _SceneReader(GeometryReader):
    """One reading of one scene."""

    def read(self, outputs: Sequence[Any]) -> SceneModel:
        """Read everything, then raise the faults or return the model."""
        scene = self.scene
        self.faults += _unwritable_names(scene)
        state_rates = self._state_rates()
        given, lagrangian = self._given()
        placed = lagrangian is None and (given is None or located(scene))
        bodies = [self._body(body) for body in scene.bodies] if placed else []
        if not scene.bodies and lagrangian is None:
            self.faults.append("the scene has no bodies; add some with add_bodies")
        names = list(scene.body_names())
        for name in sorted({name for name in names if names.count(name) > 1}):
            self.faults.append(f"two bodies are called {name!r}; give each its own name")
        actions = [action for joint in scene.joints for action in self._joint(joint, names)]
        loads = [self._load(load, place) for place, load in enumerate(scene.loads)] if placed else []
        actions += [action for action in loads if action is not None]
        acting, stored = self._actuators() if placed else ([], ())
        actions += acting
        gravity = () if scene.gravity is None else self._vector(scene.gravity, "gravity")
        potentials = tuple(
            self._scalar(getattr(body, "potential_energy", 0), f"potential energy of {getattr(body, 'name', body)}")
            for body in scene.bodies
        )
        self._without_states([x for piece in gravity for x in piece.components], "gravity")
        self._without_states(potentials, "potential energy of bodies")
        holonomic = [self._holonomic(c, i) for i, c in enumerate(scene.holonomic_constraints)]
        nonholonomic = [self._nonholonomic(c, i) for i, c in enumerate(scene.nonholonomic_constraints)]
        contacts, closing = self._contacts()
        wanted = read_outputs(self, outputs)
        controllers = self._controllers(nonholonomic)
        requirements = self._smoothness([*holonomic, *closing], nonholonomic, given, lagrangian)
        requirements += [(0, f"the slip velocity of {contact.name!r}", contact.slip or ()) for contact in contacts]
        symbols = self._symbols(requirements)
        if not self.faults:
            self.faults += foreign_points(
                self.graph,
                [self.expressions.leaves[q] for q in self.coordinates],
                self.frame_models,
                self.point_models,
                [body for body in bodies if body is not None],
                actions,
                symbols.unknowns,
            )
        if not self.faults and placed:
            self.faults += points_off_particles(scene)
            self.faults += velocity_faults(scene, self.frames, self.points, self._met)
        self.faults += rough_tables(self.graph, requirements)
        faults = self.faults + self.expressions.faults
        if faults:
            raise SceneError(scene.name, faults)
        named = self._named_values()
        chosen = tuple(x for x in wanted.chosen if x not in named or wanted.values.get(x) is not named[x])
        named = {name: node for name, node in named.items() if name in outputs}
        return SceneModel(
            name=scene.name,
            graph=self.graph,
            symbols=symbols,
            frames=tuple(self.frame_models[i] for i in range(len(self.frame_models))),
            points=tuple(self.point_models[i] for i in range(len(self.point_models))),
            bodies=tuple(body for body in bodies if body is not None),
            actions=tuple(actions),
            gravity=gravity,
            potentials=potentials,
            holonomic=(*holonomic, *closing),
            nonholonomic=tuple(nonholonomic),
            outputs={**wanted.values, **named, **names_as_nodes(self, symbols, outputs)},
            contacts=tuple(contacts),
            speeds=self.speeds,
            given=given,
            lagrangian=lagrangian,
            places=wanted.places,
            vectors=wanted.vectors,
            chosen=chosen,
            conditions=tuple(self.expressions.conditions),
            stored=stored,
            state_rates=state_rates,
            controllers=controllers,
        )

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
    ) -> list[Requirement]:
        """Return how often inputs and tables must have a continuous derivative: velocities may not jump."""
        found: list[Requirement] = []
        found += [(1, f"the {row.label}", [row.expression]) for row in holonomic]
        found += [
            (1, f"the position of point {point.name!r}", [x for piece in point.position for x in piece.components])
            for point in self.point_models.values()
        ]
        found += [
            (1, f"the orientation of frame {frame.name!r}", [x for row in frame.rotation or () for x in row])
            for frame in self.frame_models.values()
        ]
        leaves = self.expressions.leaves
        found += [(1, f"the imposed coordinate {q.func.__name__!r}", [leaves[q]]) for q, _ in self.scene.imposed]
        found += [(0, f"the {row.label}", [row.expression]) for row in nonholonomic]
        found += [
            (0, f"the kinematic equation of {u.func.__name__!r}", [leaves[u]]) for u in self.scene.speeds if u in leaves
        ]
        for body in () if given is None else given.bodies:
            pieces = (*body.velocity, *body.spin)
            found.append((0, f"the velocity of body {body.name!r}", [x for p in pieces for x in p.components]))
        if lagrangian is not None:
            found.append((1, "the Lagrangian", [lagrangian]))
        return found

    def _rows(self, matrix: Any, place: str) -> tuple[Components, Components, Components]:
        rows = [self._components(matrix[i, :], place) for i in range(3)]
        if any(rows[i][j] is not rows[j][i] for i in range(3) for j in range(i)):
            if not agree([x for row in rows for x in row], [x for row in zip(*rows, strict=True) for x in row]):
                self.faults.append(f"{place}: the matrix is not symmetric")
            (a, _, _), (d, b, _), (e, f, c) = rows
            return (a, d, e), (d, b, f), (e, f, c)
        return rows[0], rows[1], rows[2]

    def _at_rest(self, rows: tuple[Components, Components, Components]) -> tuple[Components, Components, Components]:
        """Return an inertia without what moves, where only the rounding of decimals depends on that."""
        entries = [x for row in rows for x in row]
        moving = [node for node in Graph.topological(entries) if node.op == "input" and node.deps & self._moving()]
        try:
            a = self.graph.substitute(entries, dict.fromkeys(moving, self.graph.zero))
        except ZeroDivisionError:
            return rows
        return ((a[0], a[1], a[2]), (a[3], a[4], a[5]), (a[6], a[7], a[8])) if agree(entries, a) else rows

    def _body(self, body: Any) -> BodyModel | None:
        if not isinstance(body, RigidBody | Particle):
            self.faults.append(f"{body!r} is not a RigidBody or Particle")
            return None
        place = f"body {body.name!r}"
        if isinstance(body, Particle):
            mass = self._mass(body, place)
            return BodyModel(body.name, 0, self._point(body.point, place), mass, None)
        frame = self._frame(body.frame, place)
        inertia = self._rows(matrix_of(body.central_inertia, body.frame), f"inertia of {place}")
        if any(entry.deps & self._moving() for row in inertia for entry in row):
            inertia = self._at_rest(inertia)
        if any(entry.deps & self._moving() for row in inertia for entry in row):
            self.faults.append(
                f"the inertia of {place} changes along the motion on the frame {body.frame.name!r} of the body, where"
                " it must be constant: write it on that frame, or give the body the frame that it is written on"
            )
        mass = self._mass(body, place)
        return BodyModel(body.name, frame, self._point(body.masscenter, place), mass, inertia)

    def _mass(self, body: Any, place: str) -> Node:
        mass = self.expressions.read(body.mass, f"mass of {place}")
        if mass.deps & self._moving():
            self.faults.append(
                f"the mass of {place} changes along the motion; it must be constant, because equations of a mass that"
                " is lost or gained depend on the velocity with which it leaves or comes"
            )
        return mass

    def _joint(self, joint: Any, bodies: Sequence[str]) -> list[Action]:
        """Return the screw of a joint on its body, and the opposite one on the other body."""
        if not isinstance(joint, Joint):
            self.faults.append(f"{joint!r} is not a Joint")
            return []
        place = f"joint {joint.name!r}"
        before = len(self.faults)
        named: list[Any] = [joint.body] if joint.other is None else [joint.body, joint.other]
        for verb, body in zip(("acts on", "reacts on"), named, strict=False):
            if not isinstance(body, str) or body not in bodies:
                self.faults.append(f"{place} {verb} {body!r}, which is no body; known: {list_names(bodies)}")
        if joint.other is not None and joint.body == joint.other:
            self.faults.append(
                f"{place} acts between {joint.body!r} and itself; other= is another body that has the opposite"
                f" action (known: {list_names(name for name in bodies if name != joint.body)}), or is left out where"
                " the fixed frame has it"
            )
        self.faults += torques_on_particles(self.scene, joint)
        if len(self.faults) > before:
            return []
        at = self._point(joint.at, place)
        force = self._vector(joint.force, f"force of {place}", unknowns=True)
        torque = self._vector(joint.torque, f"torque of {place}", unknowns=True)
        targets = [list(bodies).index(body) for body in named]
        screw = Action(joint.name, "screw", targets[0], at, force, torque, *targets[1:])
        return [screw, screw.opposite()] if joint.other is not None else [screw]

    def _actuators(self) -> tuple[list[Action], tuple[Node | None, ...]]:
        """Return the loads of the actuators, and candidates for their potential energies."""
        found, faults = read_actuators(self.scene)
        self.faults += faults
        actions: list[Action] = []
        for number, item in enumerate(found):
            loads = [self._load(load, 0, item.name) for load in item.loads]
            for load in (load for load in loads if load is not None):
                actions.append(replace(load, name=item.name, actuator=number))
        stored = [item.potential for item in found]
        return actions, tuple(
            None if energy is None else self._scalar(energy, f"energy of {item.name}")
            for energy, item in zip(stored, found, strict=True)
        )

    def _load(self, load: Any, number: int, name: str = "") -> Action | None:
        place = f"load {number + 1}"
        pair = tuple(load) if isinstance(load, Sequence) and len(load) == 2 else (None, None)
        if isinstance(pair[0], Point):
            where = f"{name and f'{name}: '}force at {pair[0].name!r}"
            return Action(where, "force", None, self._point(pair[0], where), self._vector(pair[1], where), ())
        if isinstance(pair[0], ReferenceFrame):
            where = f"{name and f'{name}: '}torque on {pair[0].name!r}"
            return Action(where, "torque", self._frame(pair[0], where), None, (), self._vector(pair[1], where))
        self.faults.append(f"{place}: {load!r} is neither (point, force) nor (frame, torque)")
        return None

    def _holonomic(self, constraint: Any, number: int) -> ConstraintModel:
        label = f"holonomic constraint {number + 1}"
        before = len(self.expressions.faults)
        node = self._scalar(constraint, f"{label} ({short(constraint)})")
        self._without_states([node], f"{label} ({short(constraint)})")
        if node.deps & self._mask("rates"):
            self.faults.append(f"{label} ({short(constraint)}) contains rates; add it as a nonholonomic constraint")
        elif node.is_zero and len(self.expressions.faults) == before:
            self.faults.append(f"{label} ({short(constraint)}) {_IMPLIED}")
        elif not node.deps & self._mask("coordinates") and len(self.expressions.faults) == before:
            self.faults.append(f"{label} ({short(constraint)}) contains no coordinate, so it constrains nothing")
        return ConstraintModel(f"{label}, {short(constraint)} = 0", node)

    def _nonholonomic(self, constraint: Any, number: int) -> ConstraintModel:
        label = f"nonholonomic constraint {number + 1}"
        before = len(self.expressions.faults)
        node = self._scalar(constraint, f"{label} ({short(constraint)})")
        rates = self._mask("rates")
        if node.is_zero and len(self.expressions.faults) == before:
            self.faults.append(f"{label} ({short(constraint)}) {_IMPLIED}")
        elif not node.deps & rates and len(self.expressions.faults) == before:
            self.faults.append(
                f"{label} ({short(constraint)}) contains no rate; add a constraint on positions with"
                " add_holonomic_constraints"
            )
        for q in self.coordinates:
            rate = self.graph.input(rate_name(q.func.__name__))
            slope = tangents(self.graph, [node], {rate: self.graph.one})[0]
            if self.graph.freed_of(slope, self._rates()) is None:
                self.faults.append(
                    f"{label} ({short(constraint)}) is not affine in the rate of {q.func.__name__};"
                    " only constraints of the form sum a_i(q, t) q_dot_i + b(q, t) = 0 can be compiled"
                )
                break
        return ConstraintModel(f"{label}, {short(constraint)} = 0", node)

    def _controllers(self, nonholonomic: Sequence[ConstraintModel]) -> tuple[ControllerModel, ...]:
        """Return the sampled controllers."""
        if not self.scene.controllers:
            return ()
        found = read_controllers(
            self.scene, self.graph, self._scalar, lambda: self.graph.mask(self.expressions.parameters), self.faults
        )
        sampled, time = controller_symbols(self.scene), dynamicsymbols._t
        names = [z.func.__name__ for z in sampled]
        for constraint in nonholonomic:
            used = [name for name in names if constraint.expression.deps & self.graph.input(name).deps]
            if used:
                self.faults.append(
                    f"{constraint.label}: it depends on {list_names(used)}, which jump at sampling instants, as"
                    " velocities would. Let a first-order state follow them, with add_states, and write the constraint"
                    " in that"
                )
        self.faults += [
            f"{z.func.__name__!r} is set at sampling instants and held in between, so that it has no rate; let a"
            " first-order state follow it, with add_states"
            for z in sampled
            if z.diff(time) in self.expressions.met
        ]
        self.expressions.timed |= any(item.function is not None for item in found)
        return found

    def _contacts(self) -> tuple[list[ContactModel], list[ConstraintModel]]:
        if not (self.scene.contacts or self.scene.frictions):
            return [], []
        forces = list(self.expressions.unknowns)
        contacts, closing = read_contacts(
            self.scene,
            (self.expressions, self._scalar),
            self._rates(),
            self._mask("coordinates"),
            forces,
            self.faults.append,
        )
        for contact in contacts:
            self._without_states([] if contact.gap is None else [contact.gap], f"gap of contact {contact.name!r}")
        return contacts, closing


def _unwritable_names(scene: Scene) -> list[str]:
    """Return a fault for every name that cannot be written to a file."""
    named = [("scene", scene.name), *(("body", name) for name in scene.body_names())]
    named += [("joint", str(getattr(joint, "name", ""))) for joint in scene.joints]
    named += [("contact", str(getattr(item, "label", ""))) for item in (*scene.contacts, *scene.frictions)]
    return [
        f"the name of {kind} {name!a} has a lone surrogate, half of a character; use another name"
        for kind, name in dict.fromkeys(named)
        if unwritable(name)
    ]
