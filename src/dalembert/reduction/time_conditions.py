"""Conditions on time and parameters as kernels."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..ir.conditions import CONDITION_TIME, Conditions
from ..ir.graph import Node
from ..ir.kernel import Kernel
from ..transforms.lower_kernels import lower_kernel

if TYPE_CHECKING:
    from ..mechanics.equations import EquationsOfMotion

__all__ = ["decided"]


def decided(equations: EquationsOfMotion) -> Conditions | None:
    """Return the conditions of equations as kernels, None where there are none."""
    if not equations.conditions:
        return None
    graph, parameters = equations.graph, equations.symbols.parameters
    inputs: dict[Node, tuple[str, int | None]] = {equations.time: ("t", None)}
    inputs |= {graph.input(name): ("p", i) for i, name in enumerate(parameters)}
    functions = [condition.function for condition in equations.conditions]
    within = graph.input(CONDITION_TIME).deps

    def lowered(node: Node) -> Kernel:
        return lower_kernel(graph, "condition", [node], inputs, arguments=("t", "p"))

    return Conditions(
        place=parameters.index(CONDITION_TIME) if CONDITION_TIME in parameters else None,
        functions=tuple(map(lowered, functions)),
        kinds=tuple(condition.kind for condition in equations.conditions),
        nested=tuple(bool(node.deps & within) for node in functions),
        sharpness=tuple(None if c.sharpness is None else lowered(c.sharpness) for c in equations.conditions),
    )
