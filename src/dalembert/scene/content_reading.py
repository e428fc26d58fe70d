"""Reader of the contents of a scene onto the graph: bodies, loads, joints, constraints, contacts, controllers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody
from sympy.physics.vector import dynamicsymbols

from ..errors import list_names
from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.zero_tests import agree
from ..naming import rate_name
from ..transforms.derivatives import tangents
from .actuators import read_actuators
from .contacts.law_reading import read_contacts
from .controllers import controller_symbols, read_controllers
from .expressions.reader import short
from .frames import matrix_of
from .geometry import GeometryReader
from .joints.checks import torques_on_particles
from .joints.joints import Joint
from .model import Action, BodyModel, Components, ConstraintModel, ContactModel, ControllerModel

_IMPLIED = (
    "is already implied by the parametrization: it vanishes for all coordinates. Remove it; declare its reaction as an"
    " unknown of a joint, which may be an output without it"
)


class ContentReader(GeometryReader):
    """One reading of the contents of one scene; each method returns what it read and records faults."""

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
        inertia = self._rows(self._inertia(body, f"inertia of {place}"), f"inertia of {place}")
        if any(entry.deps & self._moving() for row in inertia for entry in row):
            inertia = self._at_rest(inertia)
        if any(entry.deps & self._moving() for row in inertia for entry in row):
            self.faults.append(
                f"the inertia of {place} changes along the motion on the frame {body.frame.name!r} of the body, where"
                " it must be constant: write it on that frame, or give the body the frame that it is written on"
            )
        mass = self._mass(body, place)
        return BodyModel(body.name, frame, self._point(body.masscenter, place), mass, inertia)

    def _inertia(self, body: RigidBody, place: str) -> Any:
        """Return the matrix of an inertia on the frame of its body; zeros where no orientation relates the two."""
        vectors = [vector for _, *pair in body.central_inertia.args for vector in pair]
        written = dict.fromkeys(own for vector in vectors for _, own in vector.args if own is not body.frame)
        lost = [own for own in (*written, body.frame) if self.frames.path(own) is None] if written else []
        for own in lost:
            if own is not body.frame:
                self._frame(own, place)
        return sp.zeros(3, 3) if lost else matrix_of(body.central_inertia, body.frame)

    def _mass(self, body: Any, place: str) -> Node:
        mass = self.expressions.read(body.mass, f"mass of {place}")
        if mass.deps & self._moving():
            self.faults.append(
                f"the mass of {place} changes along the motion; it must be constant, because equations of a mass that"
                " is lost or gained depend on the velocity with which it leaves or comes. For a single particle, take"
                " the mass 1 and divide its loads, thrust among them, by the mass"
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
        if isinstance(load, Sequence) and len(load) == 3:
            return self._load_on_body(load, place)
        pair = tuple(load) if isinstance(load, Sequence) and len(load) == 2 else (None, None)
        if isinstance(pair[0], Point):
            where = f"{name and f'{name}: '}force at {pair[0].name!r}"
            return Action(where, "force", None, self._point(pair[0], where), self._vector(pair[1], where), ())
        if isinstance(pair[0], ReferenceFrame):
            where = f"{name and f'{name}: '}torque on {pair[0].name!r}"
            return Action(where, "torque", self._frame(pair[0], where), None, (), self._vector(pair[1], where))
        self.faults.append(f"{place}: {load!r} is neither (point, force), (frame, torque) nor (body, point, force)")
        return None

    def _load_on_body(self, load: Sequence[Any], place: str) -> Action | None:
        """Return a force on a body at a point; one that is fixed on the body is an ordinary force there."""
        names = list(self.scene.body_names())
        given, point, force = load
        name = given if isinstance(given, str) else str(getattr(given, "name", given))
        if name not in names:
            self.faults.append(f"{place} acts on {name!r}, which is no body; known: {list_names(names)}")
            return None
        if not isinstance(point, Point):
            self.faults.append(f"{place}: the second of (body, point, force) must be a Point, and is {point!r}")
            return None
        where = f"force on {name!r} at {point.name!r}"
        at, vector = self._point(point, where), self._vector(force, where)
        return Action(where, "body force", names.index(name), at, vector, ())

    def _label(self, kind: str, constraint: Any, number: int) -> str:
        """Return what messages call a constraint: by its joint, or by its number."""
        owners = [name for row, name in self.scene.constraint_names if row is constraint]
        return f"{kind} constraint of {owners[0]!r}" if owners else f"{kind} constraint {number + 1}"

    def _holonomic(self, constraint: Any, number: int) -> ConstraintModel:
        label, text = self._label("holonomic", constraint, number), short(constraint)
        before = len(self.expressions.faults)
        node = self._scalar(constraint, f"{label} ({text})")
        self._without_states([node], f"{label} ({text})")
        if node.deps & self._mask("rates"):
            self.faults.append(f"{label} ({text}) contains rates; add it as a nonholonomic constraint")
        elif node.is_zero and len(self.expressions.faults) == before:
            self.faults.append(f"{label} ({text}) {_IMPLIED}")
        elif not node.deps & self._mask("coordinates") and len(self.expressions.faults) == before:
            self.faults.append(f"{label} ({text}) contains no coordinate, so it constrains nothing")
        return ConstraintModel(f"{label}, {text} = 0", node)

    def _nonholonomic(self, constraint: Any, number: int) -> ConstraintModel:
        label, text = self._label("nonholonomic", constraint, number), short(constraint)
        before = len(self.expressions.faults)
        node = self._scalar(constraint, f"{label} ({text})")
        rates = self._mask("rates")
        if node.is_zero and len(self.expressions.faults) == before:
            self.faults.append(f"{label} ({text}) {_IMPLIED}")
        elif not node.deps & rates and len(self.expressions.faults) == before:
            self.faults.append(
                f"{label} ({text}) contains no rate; add a constraint on positions with add_holonomic_constraints"
            )
        for q in self.coordinates:
            rate = self.graph.input(rate_name(q.func.__name__))
            slope = tangents(self.graph, [node], {rate: self.graph.one})[0]
            if self.graph.freed_of(slope, self._rates()) is None:
                self.faults.append(
                    f"{label} ({text}) is not affine in the rate of {q.func.__name__};"
                    " only constraints of the form sum a_i(q, t) q_dot_i + b(q, t) = 0 can be compiled"
                )
                break
        return ConstraintModel(f"{label}, {text} = 0", node)

    def _controllers(
        self, nonholonomic: Sequence[ConstraintModel], contacts: Sequence[ContactModel]
    ) -> tuple[ControllerModel, ...]:
        """Return the sampled controllers."""
        if not self.scene.controllers:
            return ()
        found = read_controllers(
            self.scene, self.graph, self._scalar, lambda: self.graph.mask(self.expressions.parameters), self.faults
        )
        sampled, time = controller_symbols(self.scene), dynamicsymbols._t
        names = [z.func.__name__ for z in sampled]
        held = [(constraint.label, constraint.expression) for constraint in nonholonomic]
        for contact in contacts:
            slips = () if contact.slip is None or contact.regularization is not None else contact.slip
            held += [(f"slip velocity of {contact.name!r}", slip) for slip in slips]
        for label, expression in held:
            used = [name for name in names if expression.deps & self.graph.input(name).deps]
            if used:
                self.faults.append(
                    f"{label}: it depends on {list_names(used)}, which jump at sampling instants, as velocities would."
                    " Let a first-order state follow them, with add_states, and write it in that"
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
