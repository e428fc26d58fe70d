"""Limits for starts in any unit: what may be left of constraints, and by how much given values may change.

Every residual is compared with the sizes of its own terms: with their values, with what the coordinates add to them,
and with what an angle, or a component of a quaternion, adds where it changes by one. A distant body in the same scene
does not excuse the residual of a small mechanism: the size of the whole scene enters by what rounding leaves of it,
and by a small share where a constraint has no length besides its coordinates, which may all be zero. Only a constraint
of a single coordinate that must vanish, and the gap of a contact, which is closed by its share of all lengths, are
compared with that size itself.

The size of the whole scene, for lengths, is the largest coordinate at the start that is one; where there are angles, it
is at least the radius of gyration sqrt(sum M_ii of angles / sum M_ii of others). Where all of that is no more than
rounding leaves of lengths in ordinary units, it is one.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import final

from ..ir.graph import Graph
from ..ir.node import Node
from ..mechanics.equations import EquationsOfMotion
from ..scene.expressions.elapsed import START
from ..scene.symbol_table import SymbolTable
from ..transforms.derivatives import tangents
from ..transforms.linear import Matrix

TOLERANCE = 1e-8
"""Relative residual up to which an initial state counts as consistent."""

_REPRODUCED = 1e-6
"""Relative change of a given value up to which the state counts as that value."""

LEAST_SHARE = 1e-18
"""Square of the share in a constraint that a value must have to be solved for, times that of what is new in it."""

_SLOW = 1e-4
"""Share of the speed of the whole motion that counts as a rate where less moves."""

_AT_REST = 1e-8
"""Shares of the sizes of coordinates in a unit of time, up to which all rates may be what rounding left of rest."""

_ROUNDED = 1e-12
"""Length up to which the largest of all lengths may be what rounding left of zero."""

_HOMOGENEOUS, _ROUNDING = 1e-4, 1e-7
"""Share of the size of the scene that a length counts as, at least, in a constraint: where that has no length besides
several coordinates, and where it has. What `TOLERANCE` takes of the second is some spacings of doubles at that size."""

_TINY = 1e-300

_ULPS = 4.0
"""By how many spacings of doubles a user may have rounded a late time."""


def left_by_rounding_of_start(graph: Graph, symbols: SymbolTable, nodes: Sequence[Node]) -> list[Node]:
    """Return what rounding of a late start, from which values are computed, leaves in nodes."""
    slopes = tangents(graph, nodes, {graph.input(symbols.time): graph.one})
    spacing = graph.node(_ULPS * 2.0**-52) * graph.input(START)
    return [graph.call("abs", slope * spacing) for slope in slopes]


def magnitude_of(graph: Graph, node: Node) -> Node:
    """Return the size of the terms of a value, to first order in what the terms of its factors leave.

    The size of a sum is that of its terms together. That of a product is the size of one factor times the value of
    the other, so that a factor whose terms cancel takes the size of the other with it. That of a sine is one.
    """
    done: dict[int, Node] = {}

    def size(node: Node) -> Node:
        a = [done[arg.index] for arg in node.args]
        if node.op in ("add", "sub"):
            return a[0] + a[1]
        if node.op in ("mul", "div"):
            one, other = (graph.call("abs", arg) for arg in node.args)
            if node.op == "mul":
                return graph.call("max", one * a[1], a[0] * other)
            return graph.call("max", a[0], one * a[1] / other) / other
        if node.op in ("sin", "cos"):
            return graph.one
        return a[0] if node.op == "neg" else graph.call("abs", node)

    graph.visit([node], done, size)
    return done[node.index]


@final
class StartLimits:
    """Limits for a start.

    Parameters
    ----------
    graph : Graph
        Takes the nodes.
    equations : EquationsOfMotion
        With the mass matrix, on a graph of its own, and the names of the angles.
    q, qdot : sequence of Node, length n_q
        Coordinates and rates at the start.
    """

    def __init__(self, graph: Graph, equations: EquationsOfMotion, q: Sequence[Node], qdot: Sequence[Node]) -> None:
        self.graph, self.q, self.qdot = graph, q, qdot
        self.angles = [name in equations.angles for name in equations.symbols.coordinates]
        inputs = zip(graph.adopt(equations.q), self.angles, strict=True)
        self.lengths = [x.deps for x, angle in inputs if not angle]
        self.opens = [row.opens for row in equations.constraints]
        self.sizes = [graph.one] * len(q)
        if equations.constraints and not all(self.angles):
            length = self._length(equations)
            self.sizes = [graph.one if angle else length for angle in self.angles]
        self.speed = graph.sum(self._abs(rate) / size for rate, size in zip(qdot, self.sizes, strict=True))
        moves = graph.call("less", graph.node(_AT_REST), self.speed)
        self.slow = graph.node(_SLOW) * graph.call("select", moves, self.speed, graph.one)

    def _abs(self, node: Node) -> Node:
        return self.graph.call("abs", node)

    def _largest(self, nodes: Sequence[Node]) -> Node:
        return reduce(lambda a, b: self.graph.call("max", a, b), nodes)

    def _length(self, equations: EquationsOfMotion) -> Node:
        """Return the size of the coordinates that have a unit."""
        graph = self.graph
        lengths = [self._abs(x) for x, angle in zip(self.q, self.angles, strict=True) if not angle]
        if any(self.angles):
            own = dict(zip(graph.adopt(equations.q), self.q, strict=True))
            masses = graph.substitute(graph.adopt(equations.diagonal), own)
            lengths += self._gyration(masses)
        largest = self._largest(lengths)
        return graph.call("select", graph.call("less", graph.node(_ROUNDED), largest), largest, graph.one)

    def _gyration(self, masses: Sequence[Node]) -> list[Node]:
        """Return the radius of gyration, zero without a mass; nothing where one is zero whatever the parameters."""
        graph = self.graph
        inertia = graph.sum(mass for mass, angle in zip(masses, self.angles, strict=True) if angle)
        mass = graph.sum(mass for mass, angle in zip(masses, self.angles, strict=True) if not angle)
        if inertia.is_zero or mass.is_zero:
            return []
        heavy = graph.call("less", graph.zero, mass)
        square = graph.call("max", inertia, graph.zero) / graph.call("select", heavy, mass, graph.one)
        return [graph.call("select", heavy, graph.call("sqrt", square), graph.zero)]

    def of_constraints(
        self, constraints: Sequence[Node], residuals: Sequence[Node], jacobian: Matrix, drift: Sequence[Node]
    ) -> list[Node]:
        """Return the largest residuals that are allowed, of holonomic constraints and then of all velocity constraints.

        Parameters
        ----------
        constraints : sequence of Node, length n_h
            Holonomic constraints, of the coordinates.
        residuals : sequence of Node, length n_h or more
            They at the start.
        jacobian : Matrix (n_c, n_q)
            Of all velocity constraints at the start, of which those of the holonomic ones are the first.
        drift : sequence of Node, length n_c
            What velocity constraints are beside jacobian . qdot at the start.
        """
        rows = zip(residuals, jacobian, map(self._share, constraints, self.opens), strict=False)
        limits = [self.graph.node(TOLERANCE) * self._terms(*row) for row in rows]
        own = [self._share(*row) == _ROUNDING for row in zip(constraints, self.opens, strict=False)]
        from_position = [limit if has else None for limit, has in zip(limits, own, strict=True)]
        from_position += [None] * (len(jacobian) - len(limits))
        return limits + [self._rate(*row) for row in zip(jacobian, drift, from_position, strict=True)]

    def _share(self, constraint: Node, opens: bool) -> float:
        """Return the share of the size of the scene that a length counts as, at least, in a constraint."""
        if not opens and self._has_length(constraint):
            return _ROUNDING
        alone = sum(bool(x & constraint.deps) for x in self.lengths) == 1
        return 1.0 if opens or alone else _HOMOGENEOUS

    def _terms(self, residual: Node, row: Sequence[Node], share: float) -> Node:
        """Return the size of the terms of a holonomic constraint."""
        graph = self.graph
        terms = [magnitude_of(graph, residual)]
        for slope, x, size, angle in zip(row, self.q, self.sizes, self.angles, strict=True):
            if not slope.is_zero:
                least = size if angle else graph.node(share) * size
                terms.append(self._abs(slope) * graph.call("max", self._abs(x), least))
        return graph.sum(terms)

    def _has_length(self, constraint: Node) -> bool:
        """Return whether a constraint has terms that do not vanish with the coordinates that are lengths."""
        graph = self.graph
        lengths = reduce(lambda a, b: a | b, self.lengths, 0)
        done: dict[int, Node] = {}

        def has(node: Node) -> Node:
            if not node.deps & lengths:
                return graph.zero if node.is_zero else graph.one
            parts = [done[arg.index] is graph.one for arg in node.args]
            found = all(parts) if node.op == "mul" else parts[0] if node.op == "div" else any(parts)
            return graph.one if found else graph.zero

        graph.visit([constraint], done, has)
        return done[constraint.index] is graph.one

    def _rate(self, row: Sequence[Node], drift: Node, limit: Node | None) -> Node:
        """Return the largest residual that is allowed in a velocity constraint, row . qdot + drift.

        That of the holonomic constraint with a length from which it follows is `limit`: it may leave a share of it in a
        unit of time. Others are compared with a share of the speed of the whole scene: their terms may all be zero.
        """
        graph = self.graph
        parts = [part for part in zip(row, self.qdot, self.sizes, strict=True) if not part[0].is_zero]
        terms = graph.node(TOLERANCE) * graph.sum([self._abs(drift), *(self._abs(a * rate) for a, rate, _ in parts)])
        if limit is None:
            limit = graph.node(TOLERANCE) * graph.sum(self._abs(slope) * size for slope, _, size in parts)
        return graph.call("max", terms, self.slow * limit)

    def share(self, pivot: Node, rows: Matrix, place: int) -> Node:
        """Return the share of a value that was solved for, from its pivot; it is compared with `LEAST_SHARE`."""
        graph, shares = self.graph, []
        for row in rows:
            sizes = [*self.sizes, *[graph.one] * (len(row) - len(self.sizes))]  # angular velocities stand behind rates
            squares = [(slope * size) * (slope * size) for slope, size in zip(row, sizes, strict=True)]
            shares.append(self._over(squares[place], graph.sum(squares)))
        return self._over(pivot, graph.sum(row[place] * row[place] for row in rows)) * self._largest(shares)

    def _over(self, value: Node, by: Node) -> Node:
        return value / self.graph.call("max", by, self.graph.node(_TINY))

    def coordinate_change(self, place: int, given: Node) -> Node:
        """Return by how much a given coordinate may change."""
        return self.graph.node(_REPRODUCED) * (self.sizes[place] + self._abs(given))

    def rate_change(self, place: int) -> Node:
        """Return by how much a given rate may change."""
        graph = self.graph
        return graph.node(_REPRODUCED) * graph.call("max", self.speed, self.slow) * self.sizes[place]
