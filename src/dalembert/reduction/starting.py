"""Consistent initial states: kernels from given initial values to the state of a formulation.

What the constraints fix may be left out: missing coordinates solve the holonomic constraints,
which they must enter linearly, and missing rates the velocity constraints, both by least squares
written out on the graph. What is given is checked against the constraints, each relative to the
size of its terms, and what the tolerance lets pass is projected away. Where that changes a value
by more than a millionth, as a constraint with a small coefficient can, the start is rejected too.
The limits are those of `start_limits`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

from ..errors import InitialStateError, list_names
from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.interning import TOLERANCE as ROUNDING
from ..ir.kernel import Kernel
from ..ir.node import Node
from ..ir.program import DIRECTION
from ..ir.zero_tests import terms_of
from ..once import deriving
from ..scene.symbol_table import Entry, chosen_entries
from ..transforms.derivatives import GUARDED, tangents
from ..transforms.linear import Matrix, SingularMatrix, factorize, matmul, matvec, transpose
from ..transforms.lower_kernels import lower_kernel
from .base import ReducedSystem
from .jumps import has_jumps
from .knot_starts import KnotStarts
from .reaction_columns import independent_columns
from .start_limits import LEAST_SHARE, StartLimits, left_by_rounding_of_start
from .variational import seeds_of, with_weights


@final
@frozen
class Start:
    """A kernel from given values to a state.

    Attributes
    ----------
    kernel : Kernel
        Arguments (t, y, c), y holding the given values in the order of `given` and c beginning with the parameters.
        Outputs: the state (n_y), then for each of `labels` what the constraint leaves and what it may leave.
    given : tuple of str
        Names of coordinates and rates, and `DIRECTION` where a start was asked for that depends on it.
    labels : tuple of (str, str)
        "positions" or "rates", and the label of the constraint; or "coordinates left out" or "rates left out", and
        the name of what the constraints must fix, which they do where the first number is at most the second; or
        "pivots" and the label of a constraint, which the formulation can hold under the same condition; or
        "inertia" and the name of a coordinate or speed, whose inertia is regular under the same condition; or
        "coordinates changed" or "rates changed" and the name of a given value, what the state changes it by, and how
        much it may; or "sliding" and the name of a table, at a knot of which the motion can leave to neither side if
        the first number is 1.
    """

    kernel: Kernel
    given: tuple[str, ...]
    labels: tuple[tuple[str, str], ...]


@deriving
def starting(system: ReducedSystem, given: Sequence[str]) -> Start:
    """Return the start of a system from values with the names `given`.

    Raises
    ------
    InitialStateError
        When something is neither given nor fixed by a constraint.
    """
    return _Starting(system, given).build()


def start_tangents(system: ReducedSystem, given: Sequence[str], wrt: Sequence[str]) -> Kernel:
    """Return the derivatives of the start of a system, a kernel of the same arguments as `Start.kernel`.

    Its outputs are the derivatives of the state (n_y) with respect to each of `wrt` in turn, which are names of
    parameters and of given values; what the constraints fix, and what a projection moves, varies with them.
    """
    return _Starting(system, given).tangents(wrt)


@final
class _Starting:
    def __init__(self, system: ReducedSystem, given: Sequence[str]) -> None:
        equations = system.equations
        self.system, self.symbols = system, equations.symbols
        self.graph = Graph()  # a graph of its own, so that the kernel depends on the system alone
        known = list(self.symbols.variables)
        known += [name for entry in self.symbols.entries for name in entry.names]
        known += [DIRECTION] if has_jumps(system) else []
        self.given = tuple(name for name in known if name in given)
        self.rows = equations.constraints
        self.q = self.graph.adopt(equations.q)
        self.qdot = self.graph.adopt(equations.qdot)
        self.values: dict[Node, Node] = {}
        self.fixed: list[tuple[Node, Matrix, int]] = []
        self.fixed_labels: list[tuple[str, str]] = []
        self.entered: set[str] = set()
        self.loose: list[str] = []  # in terms of which rates are entered, and which the constraints fix
        for item in equations.controllers:  # what is set at the start anyway
            if item.offset.is_zero:
                self.values |= {self.graph.input(u): self.graph.zero for u in item.inputs if u not in given}
        ready = {str(node.payload) for node in self.values}
        missing = [name for name in self.symbols.states if name not in (*given, *ready)]
        if missing:
            self._refuse("states", missing, "nothing fixes them")
        for entry, out in chosen_entries(self.symbols.entries, self.given, self.symbols.rates):
            self._enter(entry)
            self.loose += out

    def _enter(self, entry: Entry) -> None:
        """Take coordinates or rates from other values that are given in their place."""
        values = self._at(self.graph.adopt(entry.values))
        self.values |= {self.graph.input(name): node for name, node in zip(entry.targets, values, strict=True)}
        self.entered |= set(entry.targets)

    def build(self) -> Start:
        positions = [row for row in self.rows if row.position is not None]
        jacobian = [self.graph.adopt(row.jacobian) for row in self.rows]
        residual = self.graph.adopt([row.position for row in positions if row.position is not None])
        self._solve_positions(residual, jacobian[: len(positions)])
        labels = [("positions", row.label) for row in positions]
        left = self._at(residual)
        drift = self.graph.adopt([row.drift for row in self.rows])
        velocity = [v + d for v, d in zip(matvec(self.graph, jacobian, self.qdot), drift, strict=True)]
        self._solve_velocities(velocity, jacobian)
        left += self._at(velocity)
        labels += [("rates", row.label) for row in self.rows]
        direction = self.graph.input(DIRECTION) if DIRECTION in self.given else None
        started = KnotStarts(self.graph, self.system, self._state(), direction)
        state = started.state
        may = StartLimits(self.graph, self.system.equations, self._at(self.q), self._at(self.qdot))
        jacobian = [self._at(row) for row in jacobian]
        limits = may.of_constraints(residual, left, jacobian, self._at(drift))
        if self.symbols.offsets:
            limits = [a + b for a, b in zip(limits, self._late([*residual, *velocity]), strict=True)]
        checks = [node for pair in zip(left, limits, strict=True) for node in pair]
        for pivot, rows, place in self.fixed:
            rows = [self._at(row) for row in rows]
            checks += [self.graph.node(LEAST_SHARE), may.share(self._at([pivot])[0], rows, place)]
        labels += self.fixed_labels
        for label, pivot in self.system.pivots:
            (row,) = (self.graph.adopt(row.jacobian) for row in self.rows if row.label == label)
            (slope,) = self.graph.adopt([pivot])
            size = self.graph.sum(self.graph.call("abs", entry) for entry in self._at(row))
            size = self.graph.call("max", size, terms_of(self.graph, slope))
            checks += [self.graph.node(ROUNDING) * size, self.graph.call("abs", slope)]
            labels.append(("pivots", label))
        for name, node in self.system.inertia:
            (pivot,) = self.graph.adopt([node])
            checks += [self.graph.node(ROUNDING) * terms_of(self.graph, pivot), self.graph.call("abs", pivot)]
            labels.append(("inertia", name))
        for kind, name, change, limit in self._changed(state, may):
            checks += [change, limit]
            labels.append((kind, name))
        for name, slides in started.sliding:
            checks += [slides, self.graph.zero]
            labels.append(("sliding", name))
        kernel = lower_kernel(self.graph, "start", [*state, *checks], self._inputs(), arguments=("t", "y", "c"))
        return Start(kernel, self.given, tuple(labels))

    def tangents(self, wrt: Sequence[str]) -> Kernel:
        """Return the kernel of `start_tangents`."""
        jacobian = [self.graph.adopt(row.jacobian) for row in self.rows]
        residual = self.graph.adopt([row.position for row in self.rows if row.position is not None])
        self._solve_positions(residual, jacobian[: len(residual)])
        drift = self.graph.adopt([row.drift for row in self.rows])
        velocity = [v + d for v, d in zip(matvec(self.graph, jacobian, self.qdot), drift, strict=True)]
        self._solve_velocities(velocity, jacobian)
        state = self._state()
        flat = []
        for w in wrt:
            seeds = {self.graph.input(w): self.graph.one} if w in self.given else seeds_of(self.graph, w, self.symbols)
            flat += tangents(self.graph, state, seeds, GUARDED)
        inputs = self._inputs(wrt)
        return lower_kernel(self.graph, "start_tangents", flat, inputs, arguments=("t", "y", "c"))

    def _inputs(self, wrt: Sequence[str] = ()) -> dict[Node, tuple[str, int | None]]:
        inputs: dict[Node, tuple[str, int | None]] = {self.graph.input(self.symbols.time): ("t", None)}
        inputs |= {self.graph.input(name): ("c", i) for i, name in enumerate(with_weights(wrt, self.symbols))}
        inputs |= {self.graph.input(name): ("y", i) for i, name in enumerate(self.given)}
        return inputs

    def _at(self, nodes: Sequence[Node]) -> list[Node]:
        """Return nodes with the missing values that have been solved for so far."""
        return self.graph.substitute(nodes, self.values) if self.values else list(nodes)

    def _missing(self, nodes: Sequence[Node], names: Sequence[str]) -> tuple[list[int], list[Node], list[str]]:
        places = [i for i, name in enumerate(names) if name not in self.given and name not in self.entered]
        return places, [nodes[i] for i in places], [names[i] for i in places]

    def _solve_positions(self, residual: list[Node], jacobian: Matrix) -> None:
        places, missing, names = self._missing(self.q, self.symbols.coordinates)
        if not missing:
            return
        columns = [self._at([row[i] for i in places]) for row in jacobian]
        whole = [self._at(row) for row in jacobian]
        why = "no holonomic constraint gives them uniquely (model.assemble solves for them from a guess)"
        linear = all(self.graph.freed_of(entry, missing) is not None for row in columns for entry in row)
        if not linear:
            self._refuse("coordinates", names, why)
        self._solve(self._at(residual), columns, whole, missing, (places, names), ("coordinates", why))

    def _solve_velocities(self, residual: list[Node], jacobian: Matrix) -> None:
        places, missing, names = self._missing(self.qdot, self.symbols.rates)
        loose = [self.graph.input(name) for name in self.loose]
        if not missing and not loose:
            return
        whole = [self._at(row) for row in jacobian]
        qdot = self._at(self.qdot)
        for node in loose:  # rates are linear in it
            slopes = tangents(self.graph, qdot, {node: self.graph.one})
            across = matvec(self.graph, [row[: len(qdot)] for row in whole], slopes)
            whole = [[*row, slope] for row, slope in zip(whole, across, strict=True)]
        places += range(len(qdot), len(qdot) + len(loose))
        columns = [[row[i] for i in places] for row in whole]
        why = "the constraints do not fix them"
        found = places, [*names, *self.loose]
        self._solve(self._at(residual), columns, whole, [*missing, *loose], found, ("rates", why))
        if loose:
            entered = self.graph.substitute(list(self.values.values()), {node: self.values[node] for node in loose})
            self.values = dict(zip(self.values, entered, strict=True))

    def _solve(
        self,
        residual: list[Node],
        columns: Matrix,
        whole: Matrix,
        missing: list[Node],
        which: tuple[list[int], list[str]],
        complaint: tuple[str, str],
    ) -> None:
        """Take the missing values to be the least-squares solution of constraints that are linear in them."""
        places, names = which
        if not columns:
            self._refuse(complaint[0], names, complaint[1])
        _, free = independent_columns(columns)
        if free:
            self._refuse(complaint[0], [names[i] for i in sorted(free)], complaint[1])
        rest = self.graph.substitute(residual, dict.fromkeys(missing, self.graph.zero))
        across = transpose(columns)
        try:
            normal = factorize(self.graph, matmul(self.graph, across, columns))
        except SingularMatrix:
            self._refuse(complaint[0], names, complaint[1])
            raise
        for number, pivot in zip(normal.order, normal.pivots, strict=True):
            self.fixed.append((pivot, whole, places[number]))
            self.fixed_labels.append((f"{complaint[0]} left out", names[number]))
        found = normal.solve([-value for value in matvec(self.graph, across, rest)])
        self.values |= dict(zip(missing, found, strict=True))

    def _refuse(self, what: str, names: Sequence[str], why: str) -> None:
        entries = self.symbols.entries
        others = [list_names(entry.names) for entry in entries if set(entry.targets) & set(names)]
        others += [list_names(entry.targets) for entry in entries if set(entry.names) & set(names)]
        instead = f". In their place, {' or '.join(others)} may be given" if others else ""
        raise InitialStateError(
            f"initial values are missing for the {what} {list_names(names)}: {why}, and nothing defaults to zero"
            f"{instead}"
        )

    def _changed(self, state: Sequence[Node], may: StartLimits) -> list[tuple[str, str, Node, Node]]:
        """Return the kind and the name of the given values that the state may change, by what, and by how much."""
        graph, system, symbols = self.graph, self.system, self.symbols
        if not self.rows:
            return []
        at_state = dict(zip(graph.adopt(system.inputs), state, strict=True))
        found = []
        for kind, names, nodes in (
            ("coordinates changed", symbols.coordinates, system.coordinates),
            ("rates changed", symbols.rates, system.rates),
        ):
            values = graph.substitute(graph.adopt(nodes), at_state)
            for place, (name, value) in enumerate(zip(names, values, strict=True)):
                given = graph.input(name)
                change = value - given
                if name in self.given and not change.is_zero:
                    most = (
                        may.coordinate_change(place, given) if names is symbols.coordinates else may.rate_change(place)
                    )
                    if symbols.offsets:
                        most = most + self._late([change])[0]
                    found.append((kind, name, change, most))
        return found

    def _late(self, residual: Sequence[Node]) -> list[Node]:
        """Return the residual of constraints left by rounding of a late start."""
        return self._at(left_by_rounding_of_start(self.graph, self.symbols, residual))

    def _state(self) -> list[Node]:
        """Return the state of the formulation, projected onto the constraints where the formulation can."""
        graph, system = self.graph, self.system
        state = self._at(graph.adopt(system.initial))
        projection = system.start_projection or system.projection
        if projection is None:
            return state
        inputs, places = graph.adopt(list(system.places)), list(system.places.values())
        for correction in (projection.position, projection.velocity):
            places_of = {node: state[i] for node, i in zip(inputs, places, strict=True)}
            values = {node: value for node, value in places_of.items() if node is not value}
            moved = graph.substitute(graph.adopt(correction), values) if values else graph.adopt(correction)
            state = [a + b for a, b in zip(state, moved, strict=True)]
        return state
