"""Conditions that depend on time and parameters alone, which hold or not all along a segment of a run.

Between the times at which such a condition changes, the breaks, it is decided once, at one time within, which is a
further parameter of the scene. So what is computed along a segment is smooth in time, whichever side of a break it is
asked for, and steps end at breaks.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from .derivatives import tangents
from .graph import Graph, Node

if TYPE_CHECKING:
    from .program import Kernel

__all__ = ["CONDITION_TIME", "NARROW", "WHOLE", "ZERO", "Condition", "Conditions", "condition_on", "decide"]
__all__ += ["narrow_conditions"]

CONDITION_TIME = "time of conditions"
"""The parameter [s] at whose value conditions on time are decided; runs set it for each of their segments."""

ZERO, WHOLE, NARROW = "zero", "whole", "narrow"
"""Where a condition changes: where its function vanishes, or where it passes through a whole number. A narrow one
decides nothing: where its function vanishes, something smooth may happen within a short time."""


@final
@dataclass(frozen=True)
class Condition:
    """What makes a break: where `function`, of time and parameters, is zero or whole.

    Of a narrow one, `sharpness` is the inverse square of the time [1/s^2] within which it happens, if that is positive.
    """

    function: Node
    kind: str
    sharpness: Node | None = None


@final
@dataclass(frozen=True)
class Conditions:
    """The conditions of a program.

    Attributes
    ----------
    place : int
        Number of `CONDITION_TIME` among the parameters; None where nothing is decided, and it is none of them.
    functions : tuple of Kernel
        Of (t, p), with one output each. What is decided within a function comes before it.
    kinds : tuple of str
        `ZERO` or `WHOLE`, one a function.
    nested : tuple of bool
        Whether a function contains others that are decided, so that it jumps where they do.
    sharpness : tuple of Kernel or None
        Of (t, p), of those that are narrow.
    """

    place: int | None
    functions: tuple[Kernel, ...]
    kinds: tuple[str, ...]
    nested: tuple[bool, ...]
    sharpness: tuple[Kernel | None, ...]

    @property
    def decides(self) -> bool:
        """Whether anything is decided, rather than only narrow."""
        return self.place is not None

    def decide_at(self, p: NDArray[np.float64], times: Any) -> None:
        """Let conditions of parameters p (n_p,) or (k, n_p) be decided at times () or (k,)."""
        if self.place is not None:
            p[..., self.place] = times

    def deciding(self) -> Conditions | None:
        """Return those that decide something, None where there are none."""
        if not self.decides:
            return None
        kept = [i for i, kind in enumerate(self.kinds) if kind != NARROW]
        columns = (self.functions, self.kinds, self.nested, self.sharpness)
        return Conditions(self.place, *(tuple(column[i] for i in kept) for column in columns))  # type: ignore[arg-type]

    @property
    def parameters(self) -> frozenset[int]:
        """Numbers of the parameters that the times of breaks depend on."""
        kernels = [*self.functions, *(kernel for kernel in self.sharpness if kernel is not None)]
        return frozenset(load.index or 0 for kernel in kernels for load in kernel.loads if load.array == "p")


def decide(conditions: Iterable[Condition]) -> bool:
    """Return whether any of some conditions decides something."""
    return any(condition.kind != NARROW for condition in conditions)


def condition_on(graph: Graph, function: Node, kind: str) -> Condition:
    """Return a condition on a function; the zeros of a sine or cosine are found from its argument."""
    node = min(function, -function, key=lambda value: value.fingerprint)
    node = node.args[0] if node.op == "neg" else node
    if kind == ZERO and node.op in ("sin", "cos"):
        half_turns = node.args[0] / graph.named_constant("pi", math.pi)
        return Condition(half_turns if node.op == "sin" else half_turns + graph.node(0.5), WHOLE)
    return Condition(node, kind)


def narrow_conditions(graph: Graph, op: str, node: Node, time: Node, exponent: float = -1.0) -> list[Condition]:
    """Return where an operation on a function of time and parameters may have a pulse or a smooth step, and how short.

    Pulses are where the logarithm of the result has a maximum, and as wide as its second derivative says; steps are
    where an exponential or hyperbolic function passes through its argument 0.

    Parameters
    ----------
    op : str
        ``exp``, ``tanh``, ``atan``, ``sinh``, ``cosh``, or ``pow`` for a power with a fixed `exponent` other than 0.
    """
    (rate,) = tangents(graph, [node], {time: graph.one})
    if rate.is_zero:
        return []
    (bend,) = tangents(graph, [rate], {time: graph.one})
    found: list[Condition] = []
    if op == "pow":
        sharpness = -graph.node(exponent) * bend / node
    elif op == "exp":
        sharpness = -bend
    else:
        sharpness = graph.call("abs", bend) / (1 + node * node)
    if rate.deps & time.deps and not sharpness.is_zero:
        found.append(Condition(rate, NARROW, sharpness))
    if op != "pow":
        found.append(Condition(node, NARROW, rate * rate))
    return found
