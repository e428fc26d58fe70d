"""Limits for starts in any unit: what may be left of constraints, and by how much given values may change.

Every residual is compared with the sizes of its own terms and of what the coordinates add to it. The size of an angle,
or of a component of a quaternion, is one at least. That of every other coordinate is the largest of them at the
start; where there are angles, it is at least the radius of gyration sqrt(sum M_ii of angles / sum M_ii of others).
Where all of that is no more than rounding leaves of lengths in ordinary units, it is one.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import final

from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.zero_tests import terms_of
from ..mechanics.equations import EquationsOfMotion
from ..scene.elapsed import START
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

_TINY = 1e-300

_ULPS = 4.0
"""By how many spacings of doubles a user may have rounded a late time."""


def left_by_rounding_of_start(graph: Graph, symbols: SymbolTable, nodes: Sequence[Node]) -> list[Node]:
    """Return what rounding of a late start, from which values are computed, leaves in nodes."""
    slopes = tangents(graph, nodes, {graph.input(symbols.time): graph.one})
    spacing = graph.node(_ULPS * 2.0**-52) * graph.input(START)
    return [graph.call("abs", slope * spacing) for slope in slopes]


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
            masses = graph.substitute(graph.adopt([row[i] for i, row in enumerate(equations.mass_matrix)]), own)
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

    def position(self, residual: Node, row: Sequence[Node]) -> Node:
        """Return the largest residual that is allowed in a holonomic constraint with a row of the Jacobian (n_q)."""
        graph = self.graph
        parts = [part for part in zip(row, self.q, self.sizes, strict=True) if not part[0].is_zero]
        terms = [self._abs(slope) * graph.call("max", self._abs(x), size) for slope, x, size in parts]
        return graph.node(TOLERANCE) * graph.sum([terms_of(graph, residual), *terms])

    def rate(self, row: Sequence[Node], drift: Node) -> Node:
        """Return the largest residual that is allowed in a velocity constraint, row . qdot + drift."""
        graph = self.graph
        parts = [part for part in zip(row, self.qdot, self.sizes, strict=True) if not part[0].is_zero]
        terms = graph.sum([self._abs(drift), *(self._abs(slope * rate) for slope, rate, _ in parts)])
        least = self.slow * graph.sum(self._abs(slope) * size for slope, _, size in parts)
        return graph.node(TOLERANCE) * graph.call("max", terms, least)

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
