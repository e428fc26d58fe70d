"""Friction of a contact that sticks and that constraints leave one direction of slip, as a puck on a table at a wall.

The slip velocities of such a contact are s_b = a s_a, whatever else moves. Across that line, friction and the reactions
of the constraints share a load that the equations of motion do not determine. The motion does not depend on the shares,
and friction needs least where it has none of it: its force is along the line, F_b = a F_a. Where a wall would have to
pull for that, it opens, and friction has all of the load.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import final

from ..ir.graph import Graph
from ..ir.node import Node
from ..mechanics.equations import ContactRow, EquationsOfMotion


@final
@dataclass(frozen=True)
class SlipLine:
    """A contact, the number of the slip velocity that decides the other one, and what that one is of it."""

    contact: ContactRow
    own: int
    share: Node

    @property
    def force_of_own(self) -> int:
        """Number of the friction force along the slip that decides."""
        return self.contact.tangential[self.own]

    @property
    def other(self) -> int:
        """Number of the friction force that is no unknown any more."""
        return self.contact.tangential[1 - self.own]

    def parts(self, graph: Graph, names: Sequence[str]) -> tuple[Node, Node]:
        """Return both friction forces in terms of the one that decides."""
        force = graph.input(names[self.force_of_own])
        return force, self.share * force

    def force(self, graph: Graph, names: Sequence[str]) -> dict[Node, Node]:
        """Return the other friction force by its input."""
        return {graph.input(names[self.other]): self.parts(graph, names)[1]}

    def entries(self, one: Node) -> tuple[tuple[int, Node], tuple[int, Node]]:
        """Return both friction forces as numbers of unknowns and factors."""
        return (self.force_of_own, one), (self.force_of_own, self.share)


def along_lines(equations: EquationsOfMotion, lines: Iterable[SlipLine]) -> EquationsOfMotion:
    """Return equations in which the friction forces that decide have the power of both."""
    reactions = [list(row) for row in equations.reactions]
    for line in lines:
        for row in reactions:
            row[line.force_of_own] = row[line.force_of_own] + line.share * row[line.other]
    return replace(equations, reactions=reactions)
