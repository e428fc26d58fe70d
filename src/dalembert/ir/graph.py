"""The hash-consed expression graph.

A `Graph` holds each *value* once (see `dalembert.ir.algebra`). This module adds traversals: topological order,
substitution of inputs, and forms without inputs that cancel.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import count
from typing import Any, final

from .algebra import Algebra
from .interning import KernelStore
from .node import Node, UnitName, deps_of

_RATIONAL = ("add", "sub", "mul", "div", "neg", "sin", "cos", "tan")
"""Operations whose values are related to those of others; the rest are functions of which nothing is known."""


@final
class Graph(Algebra):
    """An arena of values with traversals: topological order, substitution, adoption of nodes of other graphs."""

    def copy(self) -> Graph:
        """Return a graph that has the same values in the same forms, with the same numbers, and is independent."""
        made = Graph.__new__(Graph)
        made.decimals, made.written, made.store = dict(self.decimals), self.written, self.store
        made.samples = {index: dict(values) for index, values in self.samples.items()}
        made._errors = dict(self._errors)
        made.nodes = [
            Node(made, node.index, node.op, (), node.payload, node.fingerprint, node.cost, node.deps)
            for node in self.nodes
        ]
        for node, twin in zip(self.nodes, made.nodes, strict=True):
            twin.args, twin.circle = tuple(made.nodes[arg.index] for arg in node.args), node.circle
        made._by_value = {value: made.nodes[node.index] for value, node in self._by_value.items()}
        made._inputs = {name: made.nodes[node.index] for name, node in self._inputs.items()}
        made.zero, made.one = made.nodes[self.zero.index], made.nodes[self.one.index]
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the graph as rows of numbers: nodes refer to each other to any depth."""
        rows = [
            (n.op, [arg.index for arg in n.args], n.payload, n.fingerprint, n.cost, n.deps, n.circle)
            for n in self.nodes
        ]
        places = [
            {key: node.index for key, node in self._by_value.items()},
            {name: node.index for name, node in self._inputs.items()},
        ]
        return _graph_of, (rows, places, self.decimals, self.written, self.samples, self._errors, self.store)

    @staticmethod
    def topological(outputs: Sequence[Node], args: Callable[[Node], tuple[Node, ...]] | None = None) -> Iterator[Node]:
        """Yield every node that `outputs` depend on, operands first, in an order fixed by the outputs."""
        seen: set[int] = set()
        for output in outputs:
            if output.index in seen:
                continue
            seen.add(output.index)
            stack = [(output, iter(output.args if args is None else args(output)))]
            while stack:
                node, waiting = stack[-1]
                for arg in waiting:
                    if arg.index not in seen:
                        seen.add(arg.index)
                        below = arg.args if args is None else args(arg)
                        if below:
                            stack.append((arg, iter(below)))
                            break
                        yield arg
                else:
                    stack.pop()
                    yield node

    @staticmethod
    def visit(outputs: Sequence[Node], done: dict[int, Node], action: Callable[[Node], Node], within: int = -1) -> None:
        """Set ``done[node.index] = action(node)`` for `outputs` and all they depend on, operands first.

        Nodes in `done` are taken as they are, and operands that depend on no input of the mask `within` are left out.
        The action may make nodes, and so give known nodes cheaper forms.
        """
        stack = list(outputs)
        while stack:
            node = stack[-1]
            if node.index in done:
                stack.pop()
                continue
            pending = [arg for arg in node.args if arg.index not in done and (within < 0 or arg.deps & within)]
            if pending:
                stack.extend(reversed(pending))
            else:
                done[node.index] = action(node)
                stack.pop()

    def substitute(
        self, outputs: Sequence[Node], values: Mapping[Node, Node], generic: Iterator[int] | None = None
    ) -> list[Node]:
        """Return `outputs` with inputs replaced; everything that depends on them is rebuilt and so re-identified.

        The numbers `generic` take the place of changed functions of which nothing but their identity is known.
        """
        changed, allowed = deps_of(values), deps_of(values.values())
        forbidden = changed & ~allowed if allowed else 0
        new: dict[int, Node] = {source.index: target for source, target in values.items()}

        def rebuild(node: Node) -> Node:
            if not node.deps & changed:
                return node
            made = self.call(node.op, *(new.get(arg.index, arg) for arg in node.args))
            if generic is not None and made is not node and node.op not in _RATIONAL:
                return self.const(next(generic))
            if made.deps & forbidden:  # the value does not depend on the input, but its cheapest form contained it
                self.freed_of(made, list(values))
            return made

        self.visit(outputs, new, rebuild, changed)
        return [new[output.index] for output in outputs]

    def adopt(self, nodes: Sequence[Node]) -> list[Node]:
        """Return nodes of another graph, rebuilt in this one."""
        self.store = self.store or next((node.graph.store for node in nodes[:1]), None)
        new: dict[int, Node] = {}
        self.visit(nodes, new, lambda node: self.adopt_one(node, new))
        return [new[node.index] for node in nodes]

    def adopt_one(self, node: Node, new: Mapping[int, Node]) -> Node:
        """Return a node of another graph, rebuilt in this one from its operands in `new`, by their indices there."""
        if node.op == "input":
            assert isinstance(node.payload, str)
            return self.input(node.payload)
        if node.op == "const":
            return self.zero if node.is_zero else self._copy_constant(node)
        return self.call(node.op, *(new[arg.index] for arg in node.args))

    def _copy_constant(self, node: Node) -> Node:
        if node.number is not None:
            return self._number(node.number, node.fingerprint, node.graph.decimals.get(node.index, 0.0))
        known = self._by_value.get(node.fingerprint)
        if known is not None:
            return known
        return self._make("const", (), node.payload, node.fingerprint, 0.0, 0)

    def heal(self, nodes: Sequence[Node], allowed: Collection[Node]) -> None:
        """Give `nodes` forms in the `allowed` inputs only, where their values depend on no others.

        The cheapest form of a value may name an input that cancels in it.
        """
        strangers = self._strangers(nodes, allowed)
        if strangers:
            self.free(nodes, strangers)
            strangers = self._strangers(nodes, allowed)
        if not strangers:
            return
        outside = {node.index for node in strangers}
        for node in list(self.topological(nodes)):
            if any(arg.index in outside for arg in node.args) and self.freed_of(node, strangers) is None:
                outside.add(node.index)

    def _strangers(self, nodes: Sequence[Node], allowed: Collection[Node]) -> list[Node]:
        """Return the inputs named in the forms of nodes that are not allowed there."""
        found = (node for node in self.topological(nodes) if node.op == "input" and node not in allowed)
        return sorted(found, key=lambda node: node.index)

    def free(self, nodes: Sequence[Node], inputs: Sequence[Node]) -> None:
        """Give those `nodes` whose values do not depend on `inputs`, all of them together, forms without them."""
        mask = sum(source.deps for source in inputs)
        named = [node for node in nodes if node.args and node.deps & mask]
        if self._at_numbers(named, inputs) is None:  # one of them divides by zero there
            for node in named:
                self.freed_of(node, inputs)

    def _at_numbers(self, nodes: Sequence[Node], inputs: Sequence[Node]) -> list[Node] | None:
        """Return nodes with numbers in the place of inputs, or None where that divides by zero.

        Functions of the inputs that cancel become numbers other than 0: with f(t) = 0 before t = 1, the form of
        (2 f)/(3 f) is 2/3, not 0/0.
        """
        for trial, value in enumerate((self.zero, self.one)):
            values = dict.fromkeys(inputs, value)
            for source in inputs:
                if isinstance(source.payload, UnitName):  # a point of the sphere, as the identities of its values need
                    values[source] = self.one if source.payload.place == trial else self.zero
            try:
                return self.substitute(nodes, values, count(2))
            except ZeroDivisionError:
                continue
        return None

    def freed_of(self, node: Node, inputs: Sequence[Node]) -> Node | None:
        """Return `node` in a form without `inputs`, or None where its value does depend on them."""
        mask = deps_of(inputs)
        if not node.deps & mask:
            return node
        fixed = self._at_numbers([node], inputs)
        return node if fixed is not None and fixed[0] is node and not node.deps & mask else None


def _graph_of(
    rows: Sequence[tuple[Any, ...]],
    places: tuple[Mapping[int, int], Mapping[str, int]],
    decimals: dict[int, float],
    written: bool,
    samples: dict[int, dict[int, tuple[float, float, bool]]],
    errors: dict[int, Any],
    store: KernelStore | None,
) -> Graph:
    """Return an unpickled graph, with the same values in the same forms, and the same numbers."""
    made = Graph.__new__(Graph)
    made.decimals, made.written, made.samples, made._errors, made.store = decimals, written, samples, errors, store
    made.nodes = [
        Node(made, index, op, (), payload, value, cost, deps)
        for index, (op, _, payload, value, cost, deps, _) in enumerate(rows)
    ]
    for node, (_, args, _, _, _, _, circle) in zip(made.nodes, rows, strict=True):
        node.args, node.circle = tuple(made.nodes[index] for index in args), circle
    made._by_value = {value: made.nodes[index] for value, index in places[0].items()}
    made._inputs = {name: made.nodes[index] for name, index in places[1].items()}
    made.zero, made.one = made._by_value[0], made._by_value[1]
    return made
