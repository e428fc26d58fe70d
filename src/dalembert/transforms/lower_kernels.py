"""Lowering of graph nodes to straight-line kernels.

A kernel of equal values is lowered once in a process, and a long one is kept on disk for others: a scene is often
compiled again.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial

from ..errors import ExpressionError
from ..ir.calls import CALLS, call
from ..ir.graph import Graph
from ..ir.interning import KernelStore
from ..ir.kernel import Assignment, Kernel, Load, Operand
from ..ir.node import Node
from ..ir.ops import GRAPH_OPERATIONS
from ..ir.surfaces import surface_value
from ..ir.tables import value as table_value
from ..naming import Namer
from ..once import BoundedTable
from .forms import Forms
from .kernel_keys import values_key
from .pipelines import KERNEL_PASSES, PassRecord
from .rewriting import rewritten
from .table_lines import PieceLines

ARGUMENTS = ("t", "y", "p")

Lowered = tuple[Kernel, list[PassRecord]]
"""A kernel, and a record of each pass."""


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
    record of each pass. A kernel of equal values that is remembered is that one, and its passes took no time.

    Raises
    ------
    ExpressionError
        When a node depends on an input that is not given, or a constant is not finite.
    """
    graph.heal(nodes, inputs.keys())
    key = name, arguments, values_key(graph, nodes, inputs, fixed)
    known: Lowered | None = LOWERED.get(key)
    if known is None:
        lower = partial(_lowered, graph, name, nodes, inputs, arguments, fixed)
        long = len(key[2].rows) >= _KEPT[fixed is None]
        known = _read_or_lowered(graph.store, key, lower) if graph.store is not None and long else lower()
        LOWERED[key] = _remembered(known)
    if records is not None:
        records += known[1]
    return known[0]


def _remembered(lowered: Lowered) -> Lowered:
    """Return a kernel with the records that it has when it is next asked for: its passes take no time then."""
    return lowered[0], [replace(record, seconds=0.0) for record in lowered[1]]


LOWERED: BoundedTable[Hashable, Lowered] = BoundedTable(256)
"""Kernels with the records of their passes; those of usual scenes take 50 kB each."""


_KEPT = 15, 300
"""Values from which on a kernel is kept on disk, with products rewritten and without: lowering takes some 3 ms then."""


def _read_or_lowered(store: KernelStore, key: Hashable, lower: Callable[[], Lowered]) -> Lowered:
    """Return a kernel, and a record of each pass: as a process has kept them, or as `lower` makes them."""
    found: Lowered | None = store.read(key)
    if found is None:
        found = lower()
        store.keep(key, _remembered(found))
    return found


def _lowered(
    graph: Graph,
    name: str,
    nodes: Sequence[Node],
    inputs: Mapping[Node, tuple[str, int | None]],
    arguments: tuple[str, ...],
    fixed: Sequence[Node] | None,
) -> Lowered:
    """Return a kernel, and a record of each pass."""
    forms, records = Forms(graph), list[PassRecord]()
    if fixed is None:
        return KERNEL_PASSES(_kernel(graph, forms, name, nodes, inputs, arguments), records), records
    before = sum(node.op != "input" and node.deps != 0 for node in graph.topological(nodes))
    start = time.perf_counter()
    forms, nodes = rewritten(graph, nodes, [str(node.payload) for node in fixed])
    seconds = time.perf_counter() - start
    kernel = _kernel(graph, forms, name, nodes, inputs, arguments)
    records.append(PassRecord("rewrite products", seconds, {name: before}, {name: len(kernel.body)}))
    return KERNEL_PASSES(kernel, records), records


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
    pieces = PieceLines(namer, body)
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
            if op in ("table", "surface"):
                operands[node.index] = (pieces.table if op == "table" else pieces.surface)(*args)
                continue
            target = namer(_wish(op, args))
            body.append(Assignment(target, op, args))
            operands[node.index] = target
    loads.sort(key=lambda load: (load.array, load.index or 0))
    outputs = tuple(operands[node.index] for node in nodes)
    return Kernel(name, arguments, tuple(loads), tuple(body), outputs)


_EXACT: dict[str, Callable[..., float]] = {
    "table": table_value,
    "surface": surface_value,
    **dict.fromkeys(CALLS, call),
}


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
    evaluate = _EXACT.get(node.op, GRAPH_OPERATIONS[node.op].evaluate)
    value = float(evaluate(*map(float, args)))
    if not math.isfinite(value):
        raise ExpressionError(f"the constant {node.op}({', '.join(map(str, args))}) is not finite")
    return value


def _wish(op: str, args: tuple[Operand, ...]) -> str:
    """Return a readable name for a value."""
    if len(args) == 1 and isinstance(args[0], str) and op != "neg":
        return f"{op}_{args[0]}"
    return "z"
