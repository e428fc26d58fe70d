"""Distance of three orientation angles from gimbal lock.

The angular velocity is rows . rates; the determinant of the rows is sin(theta) or cos(theta) for rotations about axes
of coordinates, and vanishes where two of the angles turn the frame about the same line.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from ..ir.graph import Graph, Node
from ..ir.kernel import Kernel
from ..mechanics.equations import VelocityGroup
from ..transforms.lower_kernels import lower_kernel
from .base import ReducedSystem

__all__ = ["Gimbals", "gimbals"]


@final
@dataclass(frozen=True)
class Gimbals:
    """The angles of a system that may lock.

    Attributes
    ----------
    kernel : Kernel
        Of (t, y, c), y being the state and c beginning with the parameters: one determinant for each group of angles.
    angles : tuple of tuple of str
        The names of the three angles of each group.
    decisive : tuple of str
        The angle that each determinant depends on; empty where it depends on more.
    """

    kernel: Kernel
    angles: tuple[tuple[str, ...], ...]
    decisive: tuple[str, ...]


def gimbals(system: ReducedSystem) -> Gimbals | None:
    """Return the angles of a system that may lock, or None where there are none."""
    equations = system.equations
    symbols = equations.symbols
    graph = Graph()  # a separate graph, so that the kernel depends on the system alone
    q = graph.adopt(equations.q)
    found: list[tuple[Node, tuple[str, ...], str]] = []
    for group in equations.groups:
        if group.angles:
            node = _determinant(graph, group)
            inside = [i for i, x in enumerate(q) if graph.freed_of(node, [x]) is None]
            if inside:
                names = tuple(symbols.coordinates[i] for i in group.coordinates)
                found.append((node, names, symbols.coordinates[inside[0]] if len(inside) == 1 else ""))
    if not found:
        return None
    values = {a: b for a, b in zip(q, graph.adopt(system.coordinates), strict=True) if a is not b}
    nodes = graph.substitute([node for node, _, _ in found], values)
    inputs: dict[Node, tuple[str, int | None]] = {graph.input(symbols.time): ("t", None)}
    inputs |= {graph.input(name): ("c", i) for i, name in enumerate(symbols.parameters)}
    inputs |= {node: ("y", i) for i, node in enumerate(graph.adopt(system.inputs))}
    kernel = lower_kernel(graph, "gimbals", nodes, inputs, arguments=("t", "y", "c"))
    return Gimbals(kernel, tuple(names for _, names, _ in found), tuple(name for _, _, name in found))


def _determinant(graph: Graph, group: VelocityGroup) -> Node:
    a, b, c = (graph.adopt(row) for row in group.choices[0].rows)
    cross = [a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3] for i in range(3)]
    return graph.sum(x * y for x, y in zip(cross, c, strict=True))
