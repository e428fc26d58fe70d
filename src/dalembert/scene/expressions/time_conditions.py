"""Functions that can be compiled, and conditions on time: decided at one time within a segment, and recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from typing import Any, final

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.logic.boolalg import And, BooleanFalse, BooleanTrue, Not, Or

from ...ir.conditions import CONDITION_TIME, WHOLE, ZERO
from ...ir.graph import Graph
from ...ir.node import Node, deps_of
from ...transforms.conditions import Condition, condition_on, decide, narrow_conditions

# Functions of SymPy that can be compiled.

FUNCTIONS: dict[Any, str] = {
    sp.sin: "sin",
    sp.cos: "cos",
    sp.tan: "tan",
    sp.asin: "asin",
    sp.acos: "acos",
    sp.atan: "atan",
    sp.atan2: "atan2",
    sp.exp: "exp",
    sp.log: "log",
    sp.sinh: "sinh",
    sp.cosh: "cosh",
    sp.tanh: "tanh",
    sp.Abs: "abs",
    sp.sign: "sign",
    sp.floor: "floor",
}
PULSE_OPERATIONS = ("exp", "tanh", "atan", "sinh", "cosh")
"""Smooth operations that may change within a short time."""
DECIDED = ("abs", "sign", "floor", "min", "max", "less", "less_equal")
"""Operations with kinks or jumps."""
_FURTHER = ["Max", "Min", "Mod", "Piecewise", "cot", "csc", "sec", "sqrt"]
RECIPROCALS: dict[Any, tuple[str, str]] = {sp.cot: ("cos", "sin"), sp.sec: ("", "cos"), sp.csc: ("", "sin")}
"""Functions that are a quotient of two others: numerator, where it is not one, and denominator."""


def _is_exhaustive(conditions: Sequence[Any]) -> bool:
    """Return whether one of some conditions holds for all real values of what occurs in them."""
    whole = sp.Or(*conditions)
    moving = sorted(whole.atoms(AppliedUndef, sp.Derivative), key=sp.default_sort_key, reverse=True)
    for e in (*moving, *sorted(whole.free_symbols, key=sp.default_sort_key)):
        whole = whole.xreplace({e: sp.Dummy(real=True)})
    if len(whole.free_symbols) != 1:
        return sp.simplify(whole) == sp.true
    try:
        return whole.as_set() == sp.S.Reals
    except NotImplementedError:
        return False


@final
class TimeConditions:
    """Operations on a graph, of which those with kinks, jumps or pulses in time alone become conditions.

    Attributes
    ----------
    found : dict
        The conditions, as keys, in the order in which they were met.

    Parameters
    ----------
    graph : Graph
    time : Node or None
        The input that is time; None for operations that make no conditions.
    parameters : mapping
        Parameters by name, to which the owner may add.
    """

    def __init__(self, graph: Graph, time: Node | None, parameters: Mapping[str, Any]) -> None:
        self.graph = graph
        self._time, self._parameters = time, parameters
        self.found: dict[Condition, None] = {}

    def call(self, op: str, *args: Node) -> Node:
        """Return an operation; one with kinks or jumps in time alone becomes a condition."""
        graph = self.graph
        whole = graph.call(op, *args)
        if op in PULSE_OPERATIONS:
            self.record_pulse(op, args[0])
        if op not in DECIDED or self._time is None or not self._prescribed(args):
            return whole
        held = graph.substitute(args, {self._time: graph.input(CONDITION_TIME)})
        kind = WHOLE if op == "floor" else ZERO
        self.found[condition_on(graph, args[0] - args[1] if len(args) > 1 else args[0], kind)] = None
        if op == "abs":
            return graph.call("select", graph.call("less", held[0], graph.zero), -args[0], args[0])
        if op in ("min", "max"):
            low, high = args if op == "min" else args[::-1]
            return graph.call("select", graph.call("less", *held), low, high)
        return graph.call(op, *held)

    def record_pulse(self, op: str, node: Node, exponent: float = -1.0) -> None:
        """Record a narrow pulse of an operation on time alone, so that no step passes over it."""
        if self._time is not None and self._prescribed([node]):
            found = narrow_conditions(self.graph, op, node, self._time, exponent)
            self.found |= dict.fromkeys(found)

    def piecewise(self, e: Any, read: Callable[[Any], Node], fault: Callable[[str], Node]) -> Node:
        """Return a `Piecewise`, with what reads expressions, and what records a fault and returns zero."""
        *some, (last, _) = e.args
        if not _is_exhaustive([condition for _, condition in e.args]):
            return fault(f"{e} has no value where none of its conditions holds; end it with (value, True)")
        result = read(last)
        for value, condition in reversed(some):
            result = self.graph.call("select", self._condition(condition, read, fault), read(value), result)
        return result

    def _condition(self, e: Any, read: Callable[[Any], Node], fault: Callable[[str], Node]) -> Node:
        g = self.graph
        if isinstance(e, BooleanTrue):
            return g.one
        if isinstance(e, BooleanFalse):
            return g.zero
        if isinstance(e, And | Or | Not):
            parts = [self._condition(arg, read, fault) for arg in sorted(e.args, key=sp.default_sort_key)]
            if isinstance(e, Not):
                return g.one - parts[0]
            return reduce(g.mul if isinstance(e, And) else lambda a, b: g.call("max", a, b), parts)
        if isinstance(e, sp.Equality | sp.Unequality):
            a, b = read(e.lhs), read(e.rhs)
            same = g.mul(self.call("less_equal", a, b), self.call("less_equal", b, a))
            return same if isinstance(e, sp.Equality) else g.one - same
        if isinstance(e, sp.StrictLessThan | sp.LessThan | sp.StrictGreaterThan | sp.GreaterThan):
            low, high = read(e.lts), read(e.gts)
            strict = isinstance(e, sp.StrictLessThan | sp.StrictGreaterThan)
            return self.call("less" if strict else "less_equal", low, high)
        return fault(f"the condition {e} cannot be compiled; use <, <=, >, >=, Eq, Ne, And, Or, Not")

    def _prescribed(self, nodes: Sequence[Node]) -> bool:
        """Whether nodes depend on time, and on nothing else but parameters."""
        assert self._time is not None
        deps = deps_of(nodes)
        if not deps & self._time.deps:
            return False
        known = [*self._parameters, *([CONDITION_TIME] if decide(self.found) else [])]
        return not deps & ~(self._time.deps | self.graph.mask(known))


# Functions with jumps, made of these operations.


def _heaviside(operations: TimeConditions, x: Node, there: Node) -> Node:
    graph = operations.graph
    below, above = operations.call("less", x, graph.zero), operations.call("less", graph.zero, x)
    return graph.call("select", above, graph.one, graph.call("select", below, graph.zero, there))


JUMPING: dict[Any, Callable[..., Node]] = {
    sp.ceiling: lambda operations, x: -operations.call("floor", -x),
    sp.Heaviside: _heaviside,
}
"""Functions of SymPy from operations and arguments; where they jump in time alone, runs stop."""


def supported() -> tuple[str, ...]:
    """Return the names of the functions that can be compiled, in order."""
    return tuple(sorted([*(f.__name__ for f in (*FUNCTIONS, *JUMPING)), *_FURTHER]))
