"""`Node`: a value of the expression graph, and the names of inputs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any, final

if TYPE_CHECKING:
    from . import fingerprint as fp
    from .algebra import Algebra


@final
class UnitName(str):
    """The name of an input that is a component of a unit quaternion.

    Attributes
    ----------
    quaternion : str
        Name of the quaternion, common to its four components.
    place : int
        Which of them it is.
    """

    __slots__ = ("place", "quaternion")
    quaternion: str
    place: int


def deps_of(nodes: Iterable[Node]) -> int:
    """Return the inputs on which any of the nodes depends, as a mask."""
    mask = 0
    for node in nodes:
        mask |= node.deps
    return mask


def sharing(masks: Sequence[int]) -> list[list[int]]:
    """Return the numbers of masks in groups, those together that have bits in common, if be through others."""
    groups: list[tuple[int, list[int]]] = []
    for number, mask in enumerate(masks):
        members, apart = [number], []
        for other, others in groups:
            if other & mask:
                mask, members = mask | other, others + members
            else:
                apart.append((other, others))
        groups = [*apart, (mask, members)]
    return [members for _, members in groups]


def unit_names(names: Sequence[str]) -> list[UnitName]:
    """Return the names of inputs that are the unit quaternion with components called `names`."""
    made = []
    for place, name in enumerate(names):
        unit = UnitName(f"unit {name}")
        unit.quaternion, unit.place = " ".join(names), place
        made.append(unit)
    return made


@final
class Node:
    """A value in a `Graph`; arithmetic operators make new values in the same graph.

    Nodes are compared by identity: within one graph, equal values are the same object.
    """

    __slots__ = ("args", "circle", "cost", "deps", "fingerprint", "graph", "index", "op", "payload")

    def __init__(
        self,
        graph: Algebra,
        index: int,
        op: str,
        args: tuple[Node, ...],
        payload: Fraction | float | str | None,
        value: int,
        cost: float,
        deps: int,
    ) -> None:
        self.graph, self.index, self.op, self.args = graph, index, op, args
        self.payload, self.fingerprint, self.cost, self.deps = payload, value, cost, deps
        self.circle: fp.Circle | None = None

    @property
    def is_zero(self) -> bool:
        """Whether the value is identically zero."""
        return self.fingerprint == 0

    @property
    def is_one(self) -> bool:
        """Whether the value is identically one."""
        return self.fingerprint == 1

    @property
    def number(self) -> Fraction | None:
        """The exact rational number that the node is, if it is one."""
        return self.payload if type(self.payload) is Fraction else None

    def __add__(self, other: Node | int) -> Node:
        return self.graph.add(self, self.graph.node(other))

    def __radd__(self, other: int) -> Node:
        return self.graph.add(self.graph.node(other), self)

    def __sub__(self, other: Node | int) -> Node:
        return self.graph.sub(self, self.graph.node(other))

    def __rsub__(self, other: int) -> Node:
        return self.graph.sub(self.graph.node(other), self)

    def __mul__(self, other: Node | int) -> Node:
        return self.graph.mul(self, self.graph.node(other))

    def __rmul__(self, other: int) -> Node:
        return self.graph.mul(self.graph.node(other), self)

    def __truediv__(self, other: Node | int) -> Node:
        return self.graph.div(self, self.graph.node(other))

    def __rtruediv__(self, other: int) -> Node:
        return self.graph.div(self.graph.node(other), self)

    def __neg__(self) -> Node:
        return self.graph.neg(self)

    def __reduce__(self) -> tuple[Any, ...]:
        return _node_of, (self.graph, self.index)

    def __repr__(self) -> str:
        if self.op in ("const", "input"):
            return f"<{self.payload}>"
        return f"<{self.index}: {self.op}({', '.join(str(a.index) for a in self.args)})>"


def _node_of(graph: Algebra, index: int) -> Node:
    """Return a node of an unpickled graph."""
    return graph.nodes[index]
