"""Conditions that depend on time and parameters alone, which hold or not all along a segment of a run.

Between the times at which such a condition changes, the breaks, it is decided once, at one time within, which is a
further parameter of the scene. So what is computed along a segment is smooth in time, whichever side of a break it is
asked for, and steps end at breaks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, final

from .graph import Graph, Node

if TYPE_CHECKING:
    from .program import Kernel

__all__ = ["CONDITION_TIME", "WHOLE", "ZERO", "Condition", "Conditions", "condition_on"]

CONDITION_TIME = "time of conditions"
"""The parameter [s] at whose value conditions on time are decided; runs set it for each of their segments."""

ZERO, WHOLE = "zero", "whole"
"""Where a condition changes: where its function vanishes, or where it passes through a whole number."""


@final
@dataclass(frozen=True)
class Condition:
    """What makes a break: where `function`, of time and parameters, is zero or whole."""

    function: Node
    kind: str


@final
@dataclass(frozen=True)
class Conditions:
    """The conditions of a program.

    Attributes
    ----------
    place : int
        Number of `CONDITION_TIME` among the parameters.
    functions : tuple of Kernel
        Of (t, p), with one output each. What is decided within a function comes before it.
    kinds : tuple of str
        `ZERO` or `WHOLE`, one a function.
    nested : tuple of bool
        Whether a function contains others that are decided, so that it jumps where they do.
    """

    place: int
    functions: tuple[Kernel, ...]
    kinds: tuple[str, ...]
    nested: tuple[bool, ...]


def condition_on(graph: Graph, function: Node, kind: str) -> Condition:
    """Return a condition on a function; the zeros of a sine or cosine are found from its argument."""
    node = min(function, -function, key=lambda value: value.fingerprint)
    node = node.args[0] if node.op == "neg" else node
    if kind == ZERO and node.op in ("sin", "cos"):
        half_turns = node.args[0] / graph.named_constant("pi", math.pi)
        return Condition(half_turns if node.op == "sin" else half_turns + graph.node(0.5), WHOLE)
    return Condition(node, kind)
