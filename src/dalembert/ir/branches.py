"""What is not smooth: operations that kernels compute only for branches, and those with a kink or a jump."""

from __future__ import annotations

from collections.abc import Sequence

from .graph import Graph, Node
from .program import Kernel

__all__ = ["kinks", "only_in_branches", "steep"]

_CHOOSING = ("select", "min", "max")
_JUMPING = ("less", "less_equal", "sign", "floor")
_KINKED = {*_CHOOSING, *_JUMPING, "abs"}
_STEEP = {"exp", "sinh", "cosh", "tanh"}


def kinks(graph: Graph, nodes: Sequence[Node], moving: Sequence[Node]) -> tuple[str, ...]:
    """Return the names of the operations with a kink or a jump that `nodes` make on what is `moving`."""
    return _found(graph, nodes, moving, _KINKED)


def steep(graph: Graph, nodes: Sequence[Node], moving: Sequence[Node]) -> tuple[str, ...]:
    """Return the names of the operations on what is `moving` that may be nothing here and everything close by.

    They are smooth. But what is below rounding where a power series begins is not in it, however large it gets within
    the step: tanh(100) is 1 with all its derivatives 0.
    """
    return _found(graph, nodes, moving, _STEEP)


def _found(graph: Graph, nodes: Sequence[Node], moving: Sequence[Node], wanted: set[str]) -> tuple[str, ...]:
    mask = 0
    for node in moving:
        mask |= node.deps
    return tuple(sorted({node.op for node in graph.topological(nodes) if node.op in wanted and node.deps & mask}))


def only_in_branches(kernel: Kernel) -> frozenset[str]:
    """Return the targets that reach an output only through a selection, which may choose otherwise.

    Where it does, what they compute may be singular, and their derivatives count for nothing. What is merely compared
    has no derivative either.
    """
    always = {output for output in kernel.outputs if isinstance(output, str)}
    for line in reversed(kernel.body):
        if line.target in always and line.op not in (*_CHOOSING, *_JUMPING):
            always.update(arg for arg in line.args if isinstance(arg, str))
    return frozenset(line.target for line in kernel.body if line.target not in always)
