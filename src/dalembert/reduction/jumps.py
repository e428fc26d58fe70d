"""Jumps and kinks of the rates of a system: knots of tables, and switches such as `sign`, `Abs` and conditions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import final

from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.tables import LOWER, Table
from ..ir.zero_tests import terms_of
from ..methods.step_constants import EPSILON
from ..transforms.linear import SET_ASIDE
from ..transforms.step_limits import table_nodes
from ..transforms.taylor.nonsmooth import JUMPING
from .base import ReducedSystem

_MARGIN = 8.0 * EPSILON
"""Share of the largest knot, or of the terms of a switch, within which an argument counts as at a jump; steps at knots
have the same."""
NEAREST = 1e-30
"""Least such distance, of an argument without terms: of a coordinate at 0."""

_KINKED = ("abs", "min", "max")
_FACTORS = ("input", "const", "mul", "div", "neg")
_LARGEST = 1000
"""Number of operations of the rates up to which switches are treated."""


@final
@frozen
class Jump:
    """A function of the state at whose places rates may jump.

    Attributes
    ----------
    argument : Node
    size : Node
        Size of its terms, which its rounding is a share of.
    table : Table or None
        The table with the knots; None for a switch, whose value at a place may belong to neither side.
    whole : bool
        Whether a switch has its places at all whole numbers, as a floor has; else at 0 alone.
    """

    argument: Node
    size: Node
    table: Table | None = None
    whole: bool = False

    @property
    def margin(self) -> Node:
        """The distance from a place within which the argument counts as there."""
        graph = self.argument.graph
        return graph.call("max", graph.const(_MARGIN) * self.size, graph.const(NEAREST))

    def near(self, graph: Graph, reach: Node) -> Node:
        """Return 1 where the argument is so many margins from a place or less, else 0."""
        within = reach * self.margin
        distance = graph.call("abs", self.argument - self.place(graph, self.argument, within))
        return graph.call("less_equal", distance, within)

    def place(self, graph: Graph, here: Node, within: Node) -> Node:
        """Return the place next to a value of the argument, for a table the highest at most `within` above it."""
        if self.table is not None:
            key = graph.const(self.table.key)
            return graph.call("entry", graph.call("piece", here + within, key), key, graph.const(LOWER))
        return graph.call("floor", here + graph.const(0.5)) if self.whole else graph.zero


def jumps_of(graph: Graph, system: ReducedSystem) -> list[Jump]:
    """Return the jumps of the rates of a system that depend on its state, with nodes of a graph."""
    knots = []
    for x, table in _knots(system):
        (argument,) = graph.adopt([x])
        largest = graph.const(max(abs(table.first), abs(table.last), table.spacing))
        knots.append(Jump(argument, largest, table))
    switches: dict[Node, Jump] = {}
    for operands, whole in _switches(system):
        terms = graph.adopt(operands)
        argument = terms[0] - terms[1] if len(terms) > 1 else terms[0]
        if argument not in switches and -argument not in switches:
            size = graph.sum(terms_of(graph, term) for term in terms)
            switches[argument] = Jump(argument, size, None, whole)
    return [*knots, *switches.values()]


def has_jumps(system: ReducedSystem, *, switches: bool = True) -> bool:
    """Return whether the rates of a system jump at knots of tables or, where these count, at switches of its state."""
    found = iter(_knots(system)) if not switches else chain(_knots(system), _switches(system))
    return any(True for _ in found)


def _knots(system: ReducedSystem) -> Iterator[tuple[Node, Table]]:
    """Yield the arguments of tables at whose knots the rates jump, each with its table."""
    graph, state = system.equations.graph, _state(system)
    found = {
        (x, table.edges.tobytes()): (x, table)  # one table for all with the same knots
        for x, table, order in table_nodes(graph, system.rhs)
        if table.smoothness < order and x.deps & state
    }
    yield from found.values()


def _switches(system: ReducedSystem) -> Iterator[tuple[tuple[Node, ...], bool]]:
    """Yield the operands of switches, of one or of two that are compared, and whether it is a floor.

    Kinks at zeros of a product are left out, at which rounding is fine enough; so are scenes with contacts, whose
    modes decide by switches of their own, and systems with too many operations.
    """
    graph, state = system.equations.graph, _state(system)
    nodes = list(graph.topological(system.rhs, _decided_by))
    if len(nodes) > _LARGEST or system.equations.contacts:
        return
    for node in nodes:
        if node.op in JUMPING or (node.op in _KINKED and not _at_zero(graph, node.args)):
            if node.deps & state:
                yield node.args, node.op == "floor"


def _decided_by(node: Node) -> tuple[Node, ...]:
    """Return the operands of a node, without the condition of one that guards a pivot of dependent constraints."""
    return node.args[1:] if node.op == "select" and node.args[2].number == SET_ASIDE else node.args


def _at_zero(graph: Graph, operands: Sequence[Node]) -> bool:
    """Return whether the operand of a kink, or two that are compared, are equal where a product vanishes."""
    terms = [operand for operand in operands if not operand.is_zero]
    return len(terms) == 1 and all(node.op in _FACTORS for node in graph.topological(terms))


def _state(system: ReducedSystem) -> int:
    """Return the dependency bits of the state."""
    return system.equations.graph.mask(str(node.payload) for node in system.inputs)
