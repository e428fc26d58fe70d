"""Hash-consing of values: constants, inputs and operations, known by their fingerprints.

A node is looked up by its fingerprint (see `dalembert.ir.fingerprint`), so commuted, re-associated
and cancelled forms, and whatever the Pythagorean and addition theorems make equal, are one node
from the start; no simplification and no common-subexpression pass ever has to look for them. When
a cheaper form of a known value turns up, the node adopts it, unless the form loses digits that the
present one has (`dalembert.ir.accuracy`); one without an input that cancels is adopted all the same.
A more expensive form is adopted where a user wrote it and the present one loses digits that it has, and has
none that it loses. Every operand of a node costs less than the node, so the graph stays acyclic.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable
from fractions import Fraction
from typing import Any, Protocol

from . import accuracy
from . import fingerprint as fp
from .node import Node, UnitName
from .ops import GRAPH_OPERATIONS

TOLERANCE = 1e-13
"""Share of its terms below which a value of decimal numbers counts as zero in a decision (`dalembert.ir.zero_tests`).

A decimal is off by 1e-16 of itself, what a user has computed from decimals by several times that, and a difference
that is meant is larger: a nanometre in a metre is 1e-9.
"""

_LONG = 1024
"""Bits of a numerator or denominator beyond which a constant is kept to `_KEPT` bits; its fingerprint stays exact."""
_KEPT = 256
_P = fp.PRIME


def _kept(value: Fraction) -> Fraction:
    """Return a constant with bounded numerator and denominator."""
    top, bottom = value.numerator, value.denominator
    if top.bit_length() <= _LONG and bottom.bit_length() <= _LONG:
        return value
    shift = _KEPT + bottom.bit_length() - top.bit_length()
    if shift >= 0:
        return Fraction((top << shift) // bottom, 1 << shift)
    return Fraction(top // (bottom << -shift) << -shift)


def as_float(value: Fraction) -> float:
    """Return the nearest double, infinity where the value is too large."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


class KernelStore(Protocol):
    """Where kernels are kept as they are lowered, from process to process."""

    def read(self, key: Hashable) -> Any:
        """Return what was kept for a key; None where nothing was."""
        ...

    def keep(self, key: Hashable, lowered: Any) -> None:
        """Keep a kernel with the records of its passes."""
        ...


class Interning:
    """An arena of values by their fingerprints. `dalembert.ir.algebra.Algebra` adds arithmetic."""

    def __init__(self) -> None:
        self.decimals: dict[int, float] = {}
        """Size of the decimal numbers that a constant was computed from, by its index; see `TOLERANCE`."""
        self.samples: dict[int, dict[int, tuple[float, float, bool]]] = {}
        """Values at random points, kept by `dalembert.ir.zero_tests`."""
        self._by_value: dict[int, Node] = {}
        self._inputs: dict[str, Node] = {}
        self.written = False
        """Whether nodes are made of expressions that a user wrote."""
        self.store: KernelStore | None = None
        """Where kernels of nodes are kept."""
        self._errors: dict[int, accuracy.Probed] = {}
        self.nodes: list[Node] = []
        for small in (0, 1, -1, 2, -2):
            self.const(small)
        self.const(Fraction(1, 2))
        self.zero, self.one = self.const(0), self.const(1)

    # -- leaves ---------------------------------------------------------------------------

    def input(self, name: str) -> Node:
        """Return the input called `name`; the first call makes it."""
        if name not in self._inputs:
            if isinstance(name, UnitName):
                value = fp.sphere_point(name.quaternion)[name.place]
            else:
                value = fp.hashed("input", name)
            deps = 1 << len(self._inputs)
            self._inputs[name] = self._make("input", (), name, value, 0.1, deps)
        return self._inputs[name]

    def const(self, value: int | float | Fraction) -> Node:
        """Return a constant, exactly; it is rounded only where code is printed."""
        exact = Fraction(value)
        return self._number(exact, fp.of_fraction(exact), 0.0)

    def decimal(self, value: int | float | Fraction) -> Node:
        """Return a constant that a user wrote, or computed, as a decimal number: exact here, rounded before."""
        exact = Fraction(value)
        return self._number(exact, fp.of_fraction(exact), abs(as_float(exact)))

    def named_constant(self, name: str, value: float) -> Node:
        """Return an irrational constant such as pi, which is equal to no rational number."""
        key = fp.hashed("constant", name)
        known = self._by_value.get(key)
        return known if known is not None else self._make("const", (), float(value), key, 0.0, 0)

    def node(self, value: Node | int | float | Fraction) -> Node:
        """Return `value` as a node of this graph."""
        return value if isinstance(value, Node) else self.const(value)

    def mask(self, names: Iterable[str]) -> int:
        """Return the dependency bits of the inputs called `names`."""
        return sum(self.input(name).deps for name in names)

    def known_mask(self, name: str) -> int:
        """Return the dependency bit of the input called `name`, 0 if there is none."""
        return self._inputs[name].deps if name in self._inputs else 0

    def find(self, value: int) -> Node | None:
        """Return the node whose fingerprint is `value`, if there is one."""
        return self._by_value.get(value)

    # -- nodes by fingerprint ---------------------------------------------------------------

    def _size(self, a: Node) -> float:
        """Return the size of the decimals that a constant was computed from, 0 for one that is exact."""
        return self.decimals.get(a.index, 0.0) if self.decimals else 0.0

    def _size_of_quotient(self, a: Node, b: Node) -> float:
        """Return the size of the decimals that a quotient of constants comes from; infinite for one by noise."""
        if not self.decimals or a.number is None or b.number is None:
            return 0.0
        below, size = abs(as_float(b.number)), self._size(b)
        if below <= TOLERANCE * size:
            return math.inf
        return (self._size(a) + abs(as_float(a.number / b.number)) * size) / below if below else 0.0

    def _number(self, value: Fraction, key: int, size: float) -> Node:
        """Return the constant with a fingerprint, computed from decimals of a size; the least one counts."""
        known = self._by_value.get(key)
        if known is None:
            known = self._make("const", (), _kept(value), key, 0.0, 0)
            if size:
                self.decimals[known.index] = size
            return known
        if known.op != "const":  # the value is known to be a number since
            known.op, known.args, known.payload, known.cost, known.deps = "const", (), _kept(value), 0.0, 0
            if size:
                self.decimals[known.index] = size
            return known
        before = self.decimals.get(known.index, 0.0)
        if size < before:
            self.decimals[known.index] = size
            if size < 1e-3 * before:
                self.samples.clear()
            if not size:
                del self.decimals[known.index]
        return known

    def _make(
        self,
        op: str,
        args: tuple[Node, ...],
        payload: Fraction | float | str | None,
        value: int,
        cost: float,
        deps: int,
    ) -> Node:
        node = Node(self, len(self.nodes), op, args, payload, value, cost, deps)  # type: ignore[arg-type]  # an Algebra
        self.nodes.append(node)
        self._by_value[value] = node
        return node

    def _intern(self, op: str, args: tuple[Node, ...], value: int) -> Node:
        """Return the node with this value, which adopts the new form if that is cheaper."""
        cost = GRAPH_OPERATIONS[op].cost
        for arg in args:
            cost += arg.cost
        known = self._by_value.get(value)
        if known is None and op != "neg":
            opposite = self._by_value.get(-value % _P)
            if opposite is not None and opposite.cost + 0.5 < cost and not self._loses_to(opposite, op, args):
                op, args, cost = "neg", (opposite,), opposite.cost + 0.5
        deps = 0
        for arg in args:
            deps |= arg.deps
        if known is None:
            return self._make(op, args, None, value, cost, deps)
        if cost < known.cost:
            needed = 0
            for arg in known.args:
                needed |= arg.deps
            if needed & ~deps or self._is_as_accurate(known, op, args):
                known.op, known.args, known.cost, known.deps = op, args, cost, deps
                self._errors.pop(known.index, None)
        elif self.written and (op, args) != (known.op, known.args) and known.args:
            self._raise(known, op, args, cost, deps)
        return known

    def _raise(self, known: Node, op: str, args: tuple[Node, ...], cost: float, deps: int) -> None:
        """Let a node adopt a more expensive form if its own loses digits; raise the costs of its users accordingly."""
        if deps & ~known.deps or not (self._loses_to(known, op, args) and self._is_as_accurate(known, op, args)):
            return
        stack, below = list(args), set[int]()
        while stack:
            node = stack.pop()
            if node is known:
                return
            if node.index not in below:
                below.add(node.index)
                stack += node.args
        known.op, known.args, known.cost, known.deps = op, args, cost, deps
        users: dict[int, list[Node]] = {}
        for node in self.nodes:
            for arg in node.args:
                users.setdefault(arg.index, []).append(node)
        risen = [known]
        while risen:
            node = risen.pop()
            self._errors.pop(node.index, None)
            for user in users.get(node.index, ()):
                least = GRAPH_OPERATIONS[user.op].cost + sum(arg.cost for arg in user.args)
                if user.cost < least:
                    user.cost = least
                    risen.append(user)

    def _loses_to(self, node: Node, op: str, args: tuple[Node, ...]) -> bool:
        """Return whether the form of a node loses digits that another form of its value, or of its opposite, has."""
        new = self._probed_form(op, args)
        return accuracy.loses(accuracy.probed(node, self._errors), new)

    def _is_as_accurate(self, node: Node, op: str, args: tuple[Node, ...]) -> bool:
        """Return whether a form of the value of a node loses no digit that its own has."""
        return not accuracy.loses(self._probed_form(op, args), accuracy.probed(node, self._errors))

    def _probed_form(self, op: str, args: tuple[Node, ...]) -> accuracy.Probed:
        for arg in args:
            accuracy.probed(arg, self._errors)
        return accuracy.probed_form(op, args, self._errors)
