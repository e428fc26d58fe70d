"""Lowering of graph nodes to straight-line kernels."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from fractions import Fraction

from ..errors import ExpressionError
from ..ir.graph import Graph
from ..ir.kernel import Assignment, Kernel, Load, Operand
from ..ir.node import Node
from ..ir.ops import GRAPH_OPERATIONS
from ..ir.tables import ORIGIN, coefficient_row, table_of
from ..ir.tables import value as table_value
from ..naming import Namer
from .forms import Forms
from .pipelines import KERNEL_PASSES, PassRecord
from .rewriting import rewritten

ARGUMENTS = ("t", "y", "p")


def lower_kernel(
    graph: Graph,
    name: str,
    nodes: Sequence[Node],
    inputs: Mapping[Node, tuple[str, int | None]],
    arguments: tuple[str, ...] = ARGUMENTS,
    *,
    fixed: Sequence[Node] | None = None,
    records: list[PassRecord] | None = None,
) -> Kernel:
    """Return the kernel that computes `nodes` from `inputs` (node -> array and index), after all passes.

    With `fixed`, the inputs that stay the same along a motion, it has few products of the others. `records` gets a
    record of each pass.

    Raises
    ------
    ExpressionError
        When a node depends on an input that is not given, or a constant is not finite.
    """
    graph.heal(nodes, inputs.keys())
    forms = Forms(graph)
    if fixed is None:
        return KERNEL_PASSES(_kernel(graph, forms, name, nodes, inputs, arguments), records)
    before = 0 if records is None else _count(graph, nodes)
    start = time.perf_counter()
    forms, nodes = rewritten(graph, nodes, [str(node.payload) for node in fixed])
    seconds = time.perf_counter() - start
    kernel = _kernel(graph, forms, name, nodes, inputs, arguments)
    if records is not None:
        records.append(PassRecord("rewrite products", seconds, {name: before}, {name: len(kernel.body)}))
    return KERNEL_PASSES(kernel, records)


def _count(graph: Graph, nodes: Sequence[Node]) -> int:
    """Return the number of operations of nodes in their present forms."""
    return sum(node.op != "input" and node.deps != 0 for node in graph.topological(nodes))


def _kernel(
    graph: Graph,
    forms: Forms,
    name: str,
    nodes: Sequence[Node],
    inputs: Mapping[Node, tuple[str, int | None]],
    arguments: tuple[str, ...],
) -> Kernel:
    """Return the kernel that computes nodes in the forms given, before any pass."""
    places = {str(node.payload): place for node, place in inputs.items()}
    namer = Namer()
    operands: dict[int, Operand] = {}
    loads: list[Load] = []
    body: list[Assignment] = []
    pieces: dict[tuple[Operand, bytes], str] = {}
    for node in graph.topological(nodes, forms.args):
        op, values = forms.of(node)
        if op == "input":
            if node.payload not in places:
                raise ExpressionError(f"kernel {name!r} depends on {node.payload!r}, which it is not given")
            array, index = places[str(node.payload)]
            target = namer(str(node.payload).removeprefix("speed ").removeprefix("unit "))
            loads.append(Load(target, array, index))
            operands[node.index] = target
        elif node.deps == 0:
            operands[node.index] = _literal(node, [operands[arg.index] for arg in node.args])
        else:
            args = tuple(operands[arg.index] for arg in values)
            if op == "table":
                operands[node.index] = _table(namer, body, pieces, *args)
                continue
            target = namer(_wish(op, args))
            body.append(Assignment(target, op, args))
            operands[node.index] = target
    loads.sort(key=lambda load: (load.array, load.index or 0))
    outputs = tuple(operands[node.index] for node in nodes)
    return Kernel(name, arguments, tuple(loads), tuple(body), outputs)


def _table(
    namer: Namer,
    body: list[Assignment],
    pieces: dict[tuple[Operand, bytes], str],
    x: Operand,
    key: Operand,
    order: Operand,
) -> Operand:
    """Write a table, or a derivative of it, as the polynomial of the piece that x lies in; return its value.

    `pieces` are those that have been found, by argument and edges: tables with the same edges share them.
    """

    def write(name: str, op: str, *args: Operand) -> str:
        target = namer(name)
        body.append(Assignment(target, op, args))
        return target

    assert not isinstance(key, str) and not isinstance(order, str)
    same = x, table_of(key).edges.tobytes()
    place = pieces.get(same) or pieces.setdefault(same, write("piece", "piece", x, key))
    rows = [coefficient_row(int(order), power) for power in range(table_of(key).degree - int(order) + 1)]
    value = write("number", "entry", place, key, float(rows[-1]))
    if len(rows) == 1:
        return value
    s = write("z", "sub", x, write("origin", "entry", place, key, float(ORIGIN)))
    for row in rows[-2::-1]:
        value = write("z", "add", write("z", "mul", value, s), write("number", "entry", place, key, float(row)))
    return value


def _literal(node: Node, args: list[Operand]) -> float:
    """Return the value of a node without inputs."""
    if node.op == "const":
        assert isinstance(node.payload, Fraction | float)
        try:
            return float(node.payload)
        except OverflowError:
            raise ExpressionError(
                "a constant is beyond the range of double precision (1.8e308), in which models are computed; choose"
                " units in which the numbers of the scene are smaller"
            ) from None
    evaluate = table_value if node.op == "table" else GRAPH_OPERATIONS[node.op].evaluate
    value = float(evaluate(*map(float, args)))
    if not math.isfinite(value):
        raise ExpressionError(f"the constant {node.op}({', '.join(map(str, args))}) is not finite")
    return value


def _wish(op: str, args: tuple[Operand, ...]) -> str:
    """Return a readable name for a value."""
    if len(args) == 1 and isinstance(args[0], str) and op != "neg":
        return f"{op}_{args[0]}"
    return "z"
