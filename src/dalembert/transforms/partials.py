"""Derivatives of kernels: [Kernel] -> [Kernel], on the graph of the lines of the kernel.

Integrators and linearisations need derivatives of what a program computes, long after the graph that it was lowered
from is gone. A kernel is straight-line code, so its graph can be rebuilt; fingerprints identify equal values.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.kernel import Kernel, Operand
from ..ir.node import Node
from .derivatives import APPROXIMATE, GUARDED, RULES, cotangents, jacobian, tangents
from .lower_kernels import lower_kernel


def jacobian_kernel(kernel: Kernel, size: int, array: str = "y", *, exact: bool = True) -> Kernel:
    """Return the kernel of the partial derivatives of all outputs by the entries of an argument.

    Parameters
    ----------
    kernel : Kernel
        Kernel to differentiate.
    size : int
        Length of the argument.
    array : str
        Name of the argument; "t", the time, has size 1.
    exact : bool
        Whether calls of functions whose derivatives are not known are errors; else they have differences.

    Returns
    -------
    Kernel
        With the same arguments; its outputs (n_out, size) lie row by row.
    """
    parsed = _parse(kernel)
    sources = [parsed.source(array, i) for i in range(size)]
    rows = jacobian(parsed.graph, parsed.outputs, sources, RULES if exact else APPROXIMATE)
    return parsed.lower(f"{kernel.name}_by_{array}", [entry for row in rows for entry in row])


def tangent_kernel(
    kernel: Kernel,
    size: int,
    array: str = "y",
    count: int | None = None,
    *,
    exact: bool = True,
    further: Sequence[tuple[str, int]] = (),
) -> Kernel:
    """Return the kernel of one directional derivative of all outputs by the entries of an argument.

    It takes the state (size) and the direction (count, by default size), one behind the other, as ``y``, and costs
    some three evaluations whatever their length, where a Jacobian's length grows with it. For `exact` see
    `jacobian_kernel`. The direction continues with the parts of `further` entries: arguments, and places there.
    """
    parsed = _parse(kernel)
    entries = [*((array, i) for i in range(size if count is None else count)), *further]
    seeds = {parsed.source(*entry): parsed.source("y", size + i) for i, entry in enumerate(entries)}
    return parsed.lower(
        f"{kernel.name}_along", tangents(parsed.graph, parsed.outputs, seeds, RULES if exact else APPROXIMATE)
    )


def cotangent_kernel(kernel: Kernel, size: int, constants: int) -> Kernel:
    """Return the kernel of the derivatives of a weighted sum of all outputs by the state and the constants.

    It takes the state and the weights, one behind the other, as ``y`` (size + n_out), and gives the derivatives by
    the state (size) and by the constants (constants); it costs some three evaluations whatever their number. Where an
    operation has no derivative, that is zero (see `dalembert.transforms.derivatives.GUARDED`).
    """
    parsed = _parse(kernel)
    weights = [parsed.source("y", size + i) for i in range(len(kernel.outputs))]
    sources = [parsed.source(name, i) for name, count in (("y", size), ("c", constants)) for i in range(count)]
    return parsed.lower(f"{kernel.name}_pulled", cotangents(parsed.graph, parsed.outputs, weights, sources, GUARDED))


@final
@frozen
class _Parsed:
    """The graph of a kernel; an input is named by its array and its place there."""

    graph: Graph
    arguments: tuple[str, ...]
    outputs: list[Node]
    inputs: dict[Node, tuple[str, int | None]]

    def source(self, array: str, index: int) -> Node:
        place = None if array == "t" else index
        node = self.graph.input(_name(array, place))
        self.inputs[node] = (array, place)
        return node

    def lower(self, name: str, nodes: Sequence[Node]) -> Kernel:
        return lower_kernel(self.graph, name, nodes, self.inputs, self.arguments)


def _name(array: str, index: int | None) -> str:
    return array if index is None else f"{array}_{index}"


def _parse(kernel: Kernel) -> _Parsed:
    """Return the graph of a kernel."""
    graph = Graph()
    inputs: dict[Node, tuple[str, int | None]] = {}
    values: dict[str, Node] = {}
    for load in kernel.loads:
        values[load.target] = graph.input(_name(load.array, load.index))
        inputs[values[load.target]] = (load.array, load.index)

    def value(operand: Operand) -> Node:
        return values[operand] if isinstance(operand, str) else graph.const(operand)

    for line in kernel.body:
        values[line.target] = graph.call(line.op, *(value(arg) for arg in line.args))
    return _Parsed(graph, kernel.arguments, [value(output) for output in kernel.outputs], inputs)
