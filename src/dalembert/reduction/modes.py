"""[EquationsOfMotion] -> [EquationsOfMotion]: a scene with contacts, in one of its modes.

In a mode every contact is open or closed, and slips or sticks. What is open has neither constraint nor reactions; what
sticks has its slip velocity as a further constraint, which the friction force holds; where a contact slips, friction is
a given force, -kappa N, and the normal reactions N follow from the equations with all of them: without friction they
would be N_0, each unit of N_s adds B_rs to N_r, and (I - B) N = N_0. That matrix loses its regularity where the law of
friction has no or several solutions (Painleve's paradox). What is left is a scene without contacts, so that every
formulation, backend and method serves it.

Which mode holds is decided by `dalembert.runtime.contacts`, from numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import final

from ..errors import ConstraintError
from ..ir.graph import Graph, Node
from ..ir.linear import Matrix, determinant_and_solution, factorize, matmul, matvec, transpose
from ..mechanics.equations import ConstraintRow, ContactRow, EquationsOfMotion
from .reactions import independent_columns
from .saddle import SaddlePoint

__all__ = [
    "CLOSED",
    "OPEN",
    "SLIP",
    "SMOOTH",
    "STICK",
    "Mode",
    "Watchpoint",
    "added_parameters",
    "always",
    "direction_names",
    "in_mode",
    "side_name",
    "watchpoints",
]

OPEN, CLOSED, SLIP, STICK, SMOOTH = "open", "closed", "slip", "stick", "smooth"

Mode = tuple[str, ...]
"""One word a contact."""

_TINY = 1e-150


@final
@dataclass(frozen=True)
class Watchpoint:
    """An output whose fall through zero ends a mode.

    Attributes
    ----------
    output : str
        Its name.
    contact : int
        Number of the contact; -1 for all of them.
    kind : str
        "stop" (the slip velocity vanishes), "break" (friction cannot hold, towards `sign`), "lift" (the normal
        reaction vanishes), "turn" (it changes its side, at a constraint that never opens), "meet" (the gap closes) or
        "paradox" (the normal reactions are no longer determined).
    sign : int
        Direction of the slip that begins where friction breaks along one direction.
    """

    output: str
    contact: int
    kind: str
    sign: int = 0


def direction_names(contact: ContactRow) -> tuple[str, ...]:
    """Return the parameters that hold the direction of slip; one holds a sign, two a unit vector."""
    if len(contact.tangential) < 2:
        return tuple(f"slip direction of {contact.name}" for _ in contact.tangential)
    return tuple(f"slip direction {i + 1} of {contact.name}" for i in range(2))


def side_name(contact: ContactRow) -> str | None:
    """Return the parameter that holds the sign of the normal reaction, where the constraint can push and pull."""
    return f"side of {contact.name}" if contact.constraint is None and contact.tangential else None


def added_parameters(contact: ContactRow, state: str) -> dict[str, float]:
    """Return the parameters that a contact in a state adds to those of the scene, with values to start from."""
    added: dict[str, float] = {}
    if state == SLIP:
        added |= dict(zip(direction_names(contact), (1.0, 0.0), strict=False))
    side = side_name(contact)
    if side is not None and state in (SLIP, STICK):
        added[side] = 1.0
    return added


def always(contacts: Sequence[ContactRow]) -> Mode | None:
    """Return the only mode of contacts whose laws are smooth and that never open; None where there are others."""
    smooth = all(c.constraint is None and c.regularization is not None for c in contacts)
    return (SMOOTH,) * len(contacts) if smooth else None


def watchpoints(equations: EquationsOfMotion, mode: Mode) -> list[Watchpoint]:
    """Return what ends a mode."""
    points = []
    for i, (contact, state) in enumerate(zip(equations.contacts, mode, strict=True)):
        name = contact.name
        if state == OPEN:
            points.append(Watchpoint(f"gap of {name}", i, "meet"))
            continue
        if contact.constraint is not None:
            points.append(Watchpoint(f"press of {name}", i, "lift"))
        elif state in (SLIP, STICK):
            points.append(Watchpoint(f"press of {name}", i, "turn"))
        if state == SLIP:
            points.append(Watchpoint(f"slip speed of {name}", i, "stop"))
        elif state == STICK and len(contact.tangential) == 1:
            points += [Watchpoint(f"hold of {name} against {s:+d}", i, "break", s) for s in (1, -1)]
        elif state == STICK:
            points.append(Watchpoint(f"hold of {name}", i, "break"))
    if any(state == SLIP for state in mode):
        points.append(Watchpoint("uniqueness of reactions", -1, "paradox"))
    return points


def in_mode(equations: EquationsOfMotion, mode: Mode) -> EquationsOfMotion:
    """Return the equations of a scene in a mode, with the outputs of its watchpoints.

    Raises
    ------
    ConstraintError
        When the equations do not determine the normal reaction of a contact that rubs.
    """
    return _InMode(equations, mode).equations()


@final
class _InMode:
    """The making of one mode."""

    def __init__(self, equations: EquationsOfMotion, mode: Mode) -> None:
        self.whole, self.mode = equations, mode
        self.graph: Graph = equations.graph
        self.contacts = list(zip(equations.contacts, mode, strict=True))
        self.rubbing = [(c, state) for c, state in self.contacts if state in (SLIP, SMOOTH) and c.tangential]
        opened = {c.constraint for c, state in self.contacts if state == OPEN}
        rows: list[ConstraintRow] = [row for i, row in enumerate(equations.constraints) if i not in opened]
        rows += [row for c, state in self.contacts if state == STICK for row in c.slips]
        self.rows = tuple(rows)
        gone = {i for c, state in self.contacts if state == OPEN for i in (c.normal, *c.tangential)}
        gone |= {i for c, _ in self.rubbing for i in c.tangential}
        self.kept = [i for i in range(len(equations.symbols.unknowns)) if i not in gone]

    def equations(self) -> EquationsOfMotion:
        """Return the equations in this mode."""
        whole, graph = self.whole, self.graph
        names = whole.symbols.unknowns
        reactions = [[row[i] for i in self.kept] for row in whole.reactions]
        bare = replace(whole, constraints=self.rows, reactions=reactions)
        forcing, forces, determinant = self._rub(bare)
        known = {graph.input(names[i]): node for i, node in forces.items()}
        for contact, state in self.contacts:
            if state == OPEN:
                known |= {graph.input(names[i]): graph.zero for i in (contact.normal, *contact.tangential)}
        outputs = dict(zip(whole.outputs, graph.substitute(list(whole.outputs.values()), known), strict=True))
        outputs |= {str(node.payload): value for node, value in known.items()}
        outputs |= self._watched(determinant)
        added = {name: value for c, state in self.contacts for name, value in added_parameters(c, state).items()}
        symbols = replace(
            whole.symbols,
            unknowns=tuple(names[i] for i in self.kept),
            parameters=(*whole.symbols.parameters, *added),
        )
        return replace(bare, symbols=symbols, forcing=tuple(forcing), outputs=outputs, defaults=added)

    # -- sliding friction ------------------------------------------------------------------

    def _factors(self, contact: ContactRow, state: str, free: Node) -> list[Node]:
        """Return kappa: friction is -kappa N. `free` is N without friction, whose sign the smooth law takes."""
        graph = self.graph
        assert contact.mu is not None
        slips = [self._speed(row) for row in contact.slips]
        if state == SMOOTH:
            assert contact.regularization is not None
            size = graph.call("sqrt", graph.sum(w * w for w in (*slips, contact.regularization)))
            side = graph.one
            if contact.constraint is None:
                side = graph.call("select", graph.call("less", graph.zero, free), graph.one, graph.const(-1))
            return [contact.mu * side * w / size for w in slips]
        side_of = side_name(contact)
        mu = contact.mu if side_of is None else contact.mu * graph.input(side_of)
        held = [graph.input(name) for name in direction_names(contact)]
        if len(held) == 1:
            return [mu * held[0]]
        tiny = graph.node(_TINY)
        forward = graph.sum(w * d for w, d in zip(slips, held, strict=True))
        sign = graph.call("select", graph.call("less", forward, graph.zero), graph.const(-1), graph.one)
        along = [sign * w + tiny * d for w, d in zip(slips, held, strict=True)]
        size = graph.call("sqrt", graph.sum(a * a for a in along))
        return [mu * a / size for a in along]

    def _speed(self, row: ConstraintRow) -> Node:
        terms = (a * b for a, b in zip(row.jacobian, self.whole.qdot, strict=True))
        return self.graph.sum(terms) + row.drift

    def _rub(self, bare: EquationsOfMotion) -> tuple[list[Node], dict[int, Node], Node]:
        """Return the forcing with friction, the friction forces by unknown, and the determinant of I - B."""
        graph = self.graph
        if not self.rubbing:
            return list(bare.forcing), {}, graph.one
        saddle = SaddlePoint.of(bare, guarded=False)
        columns = self._normals(bare)
        free = saddle.accelerations([row.bias for row in self.rows], bare.name)
        n0 = columns(self._residual(bare, free, bare.forcing))
        directions, factors = [], []
        for (contact, state), normal in zip(self.rubbing, n0, strict=True):
            kappa = self._factors(contact, state, normal)
            factors.append(kappa)
            columns_of = [[row[i] for row in self.whole.reactions] for i in contact.tangential]
            rows = zip(*columns_of, strict=True)
            directions.append([-graph.sum(k * c for k, c in zip(kappa, row, strict=True)) for row in rows])
        nothing = [graph.zero for _ in self.rows]
        added = []
        for direction in directions:
            pushed = replace(saddle, forcing=tuple(direction)).accelerations(nothing, bare.name)
            added.append(columns(self._residual(bare, pushed, direction)))
        size = range(len(n0))
        matrix: Matrix = [[(graph.one if i == j else graph.zero) - added[j][i] for j in size] for i in size]
        determinant, pressing = determinant_and_solution(graph, matrix, n0)
        forcing = list(bare.forcing)
        for direction, normal in zip(directions, pressing, strict=True):
            forcing = [f + d * normal for f, d in zip(forcing, direction, strict=True)]
        names = self.whole.symbols.unknowns
        forces = {
            i: -k * graph.input(names[contact.normal])
            for (contact, _), kappa in zip(self.rubbing, factors, strict=True)
            for i, k in zip(contact.tangential, kappa, strict=True)
        }
        return forcing, forces, determinant

    def _residual(self, bare: EquationsOfMotion, a: Sequence[Node], forcing: Sequence[Node]) -> list[Node]:
        return [x - f for x, f in zip(matvec(self.graph, bare.mass_matrix, a), forcing, strict=True)]

    def _normals(self, bare: EquationsOfMotion) -> Callable[[Sequence[Node]], list[Node]]:
        """Return the function from what reactions have to supply to the normal reactions of what rubs."""
        graph = self.graph
        independent, undetermined = independent_columns(graph, bare.reactions)
        places = []
        for contact, _ in self.rubbing:
            place = self.kept.index(contact.normal)
            if place in undetermined:
                name = self.whole.symbols.unknowns[contact.normal]
                raise ConstraintError(
                    f"scene {bare.name!r}: friction {contact.name!r} needs {name}, which the equations of motion do not"
                    " determine: only a combination of it with other reactions appears in them, or none. Give back the"
                    " coordinate that hides it, with scene.release(coordinate, point, direction)"
                )
            places.append(independent.index(place))
        columns = transpose([[row[i] for i in independent] for row in bare.reactions])
        normal = factorize(graph, matmul(graph, columns, transpose(columns)))

        def normals(residual: Sequence[Node]) -> list[Node]:
            found = normal.solve(matvec(graph, columns, residual))
            return [found[place] for place in places]

        return normals

    # -- what ends the mode ----------------------------------------------------------------

    def _watched(self, determinant: Node) -> dict[str, Node]:
        """Return the outputs of the watchpoints; reactions in them are inputs."""
        graph, names = self.graph, self.whole.symbols.unknowns
        found: dict[str, Node] = {}
        for point in watchpoints(self.whole, self.mode):
            if point.kind == "paradox":
                found[point.output] = determinant
                continue
            contact = self.whole.contacts[point.contact]
            side_of = side_name(contact)
            press = graph.input(names[contact.normal])
            press = press if side_of is None else press * graph.input(side_of)
            if point.kind == "meet":
                assert contact.gap is not None
                found[point.output] = contact.gap
            elif point.kind in ("lift", "turn"):
                found[point.output] = press
            elif point.kind == "stop":
                held = [graph.input(name) for name in direction_names(contact)]
                found[point.output] = graph.sum(
                    self._speed(row) * d for row, d in zip(contact.slips, held, strict=True)
                )
            else:
                assert contact.mu_static is not None
                most = contact.mu_static * press
                forces = [graph.input(names[i]) for i in contact.tangential]
                if point.sign:
                    found[point.output] = most + point.sign * forces[0]
                else:
                    found[point.output] = most * most - graph.sum(f * f for f in forces)
        return found
