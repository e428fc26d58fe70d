"""Taylor recurrences of a right-hand side: [Kernel] -> [Recurrences].

Arithmetic has recurrences of its own: a product is a convolution, a quotient and a root each solve
one (Moore; Jorba and Zou, Experimental Mathematics 14, 2005). Every other function f is integrated:
where f' = sum of factor * inner', coefficient k of f is sum of (1/k) sum_j j inner_j factor_(k-j). The
factors are written with arithmetic and with f itself, and are expanded along with the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

from ...frozen import frozen
from ...ir.kernel import Assignment, Kernel, Operand
from .nonsmooth import (
    INVERSE,
    Switch,
    guarded_pivots,
    last_of,
    leading_to,
    left_to_control,
    moving_roots,
    nonanalytic_operations,
    nonsmooth_values,
    reached_from,
    switches_of,
)
from .periodic import turning


@final
@dataclass(frozen=True, slots=True)
class Integrated:
    """``value`` by its operation at order 0; above, the integral of the sum of sign * factor * inner'."""

    value: Assignment
    terms: tuple[tuple[float, Operand, str], ...]


@final
@frozen
class Recurrences:
    """The values of a kernel in the order in which each of their coefficients is computed.

    Attributes
    ----------
    items : tuple of Assignment or Integrated
    varying : frozenset of str
        Values that change along the motion; all others have one coefficient.
    states, rates : tuple
        Names of the components of the state, and the value that is the rate of each.
    events_with_series : int
        How many of the states, the last ones, are integrals of events with series: nothing depends on them,
        and they begin at zero in every step.
    controlled : tuple of int
        Rates of the state that depend on functions which a series may not show: steps check their residual.
    poles : tuple of str
        Inverse powers among that: steps stay within the reach of their series, however small these are.
    step_growth_limited : bool
        Whether steps do not grow at once, so that what happens is not passed over.
    nonsmooth : bool
        Whether there are kinks or jumps in state or time.
    ends_at_kinks : bool
        Whether steps end at all of these, and none is in a root.
    tables : tuple of (str, float)
        Arguments of tables that vary, and the keys of these: a step ends where an argument leaves a piece.
    roots : tuple of str
        Square roots: a step ends where their series vanish, because power series continue to negative values.
    switches : tuple of Switch
        Kinks and jumps at which steps end.
    hidden : tuple of str
        Kinds of the operations that a power series may not show, without the switches.
    pivots : tuple of str
        Guarded pivots of constraints that may lose rank: steps do not end where one nearly vanishes.
    weighted : bool
        Whether each component of the state has an absolute tolerance of its own.
    """

    kernel: Kernel
    items: tuple[Assignment | Integrated, ...]
    varying: frozenset[str]
    states: tuple[str, ...]
    rates: tuple[Operand, ...]
    events_with_series: int = 0
    controlled: tuple[int, ...] = ()
    poles: tuple[str, ...] = ()
    step_growth_limited: bool = False
    nonsmooth: bool = False
    ends_at_kinks: bool = True
    tables: tuple[tuple[str, float], ...] = ()
    roots: tuple[str, ...] = ()
    switches: tuple[Switch, ...] = ()
    hidden: tuple[str, ...] = ()
    pivots: tuple[str, ...] = ()
    weighted: bool = False

    @property
    def watched(self) -> tuple[str, ...]:
        """Values whose series the end of a step reads whole."""
        return (*(argument for argument, _ in self.tables), *self.roots, *self.pivots, *self.switch_arguments)

    @property
    def switch_arguments(self) -> tuple[str, ...]:
        """The arguments of the switches, each once."""
        return tuple(dict.fromkeys(switch.argument for switch in self.switches))

    @property
    def angles(self) -> frozenset[str]:
        """Components of the state that matter modulo a turn: all that the rates use of them are sines and cosines."""
        return turning(self.kernel.body, self.states, self.kernel.outputs)

    def unrolled_lines(self, order: int) -> int:
        """Return about how many lines the series up to `order` need when they are written out."""
        lines = 0
        for item in self.items:
            if isinstance(item, Integrated):
                lines += len(item.terms) * order * order // 2
            elif item.target in self.varying:
                products = item.op in ("mul", "div") and item.args[-1] in self.varying and item.args[0] in self.varying
                lines += order * order // 2 if products or item.op == "sqrt" else order
        return lines


def recurrences(
    kernel: Kernel, events_with_series: int = 0, *, step_growth_limited: bool = False, weighted: bool = False
) -> Recurrences:
    """Return the recurrences of a right-hand side whose output i is the rate of ``y[i]``.

    The last `events_with_series` outputs are not rates of the state, but events with series. Steps with a control of
    their defect are `step_growth_limited`, and others may be. `weighted` is that of `Recurrences`.
    """
    loaded = {load.index: load.target for load in kernel.loads if load.array == "y"}
    states = tuple(loaded.get(i, f"y_{i}_") for i in range(len(kernel.outputs)))
    varying = set(states) | {load.target for load in kernel.loads if load.array == "t"}
    items: list[Assignment | Integrated] = []
    known = {(line.op, line.args): line.target for line in kernel.body}
    done: set[str] = set()
    hidden = nonanalytic_operations(kernel)
    kinks = nonsmooth_values(hidden)
    flat = reached_from(kernel, kinks)
    for line in kernel.body:
        if line.op in ("piece", "entry") or not any(arg in varying for arg in line.args):
            items.append(line)  # steps end at the ends of pieces of tables
            continue
        new = _from_flat(line) if line.args[0] in flat and _root(line) else _expanded(line, known, done)
        items += _without_fixed_terms(line, new, varying)
    own = len(kernel.outputs) - events_with_series
    switches, differences = switches_of(kernel, own, varying, hidden)
    items += differences
    hidden = left_to_control(kernel, varying, hidden, switches)
    looked_at = reached_from(kernel, hidden)
    controlled = tuple(i for i, rate in enumerate(kernel.outputs[:own]) if rate in looked_at)
    needed = leading_to(kernel, [kernel.outputs[i] for i in controlled])
    poles = last_of(kernel, [name for name, what in hidden.items() if what == INVERSE and name in needed])
    return Recurrences(
        kernel,
        tuple(items),
        frozenset(varying | {line.target for line in differences}),
        states,
        kernel.outputs,
        events_with_series,
        controlled,
        poles,
        step_growth_limited or bool(controlled),
        bool(kinks),
        not nonsmooth_values(hidden) and not any(_root(line) and line.args[0] in flat for line in kernel.body),
        tuple(
            (str(line.args[0]), float(line.args[1]))
            for line in kernel.body
            if line.op == "piece" and line.args[0] in varying
        ),
        moving_roots(kernel, varying - flat),
        switches,
        tuple(hidden.values()),
        guarded_pivots(kernel, varying),
        weighted,
    )


Items = list[Assignment | Integrated]


def _without_fixed_terms(line: Assignment, new: Items, varying: set[str]) -> Items:
    """Return the items of a value without terms of fixed operands, and without items that only those terms need.

    The targets of items that vary join `varying`. An operand may be a literal (atan2(y, 2)), which has no series.
    """
    kept: Items = []
    for item in new:
        if isinstance(item, Integrated):
            item = Integrated(item.value, tuple(term for term in item.terms if term[1] in varying))
            varying.add(item.value.target)
        elif any(arg in varying for arg in item.args):
            varying.add(item.target)
        kept.append(item)
    needs = {
        _value(item).target: {f for _, _, f in item.terms} if isinstance(item, Integrated) else set(item.args)
        for item in kept
    }
    needed: set[Operand] = {line.target}
    waiting: list[Operand] = [line.target]
    while waiting:
        new_ones = needs.get(str(waiting.pop()), set()) - needed
        needed |= new_ones
        waiting += new_ones
    return [item for item in kept if _value(item).target in needed]


def _value(item: Assignment | Integrated) -> Assignment:
    return item.value if isinstance(item, Integrated) else item


def _expanded(line: Assignment, known: dict[tuple[str, tuple[Operand, ...]], str], done: set[str]) -> Items:
    if line.target in done:
        return []
    if line.op in _PARTNER:
        other_op, own_sign, other_sign = _PARTNER[line.op]
        other = known.get((other_op, line.args), f"{line.target}_partner")
        done.add(other)
        own = Integrated(line, ((own_sign, line.args[0], other),))
        return [own, Integrated(Assignment(other, other_op, line.args), ((other_sign, line.args[0], line.target),))]
    return _RULES[line.op](line) if line.op in _RULES else [line]


_PARTNER = {
    "sin": ("cos", 1.0, -1.0),
    "cos": ("sin", -1.0, 1.0),
    "sinh": ("cosh", 1.0, 1.0),
    "cosh": ("sinh", 1.0, 1.0),
}
"""Functions that are each other's slopes: the partner, the sign of the own slope, the sign of the partner's."""


def _exp(line: Assignment) -> Items:
    return [Integrated(line, ((1.0, line.args[0], line.target),))]


def _tangent(line: Assignment) -> Items:
    square, slope = f"{line.target}_square", f"{line.target}_slope"
    return [
        Integrated(line, ((1.0, line.args[0], slope),)),
        Assignment(square, "mul", (line.target, line.target)),
        Assignment(slope, "add" if line.op == "tan" else "sub", (1.0, square)),
    ]


def _inverse_tangent(line: Assignment) -> Items:
    x, name = line.args[0], line.target
    return [
        Assignment(f"{name}_square", "mul", (x, x)),
        Assignment(f"{name}_sum", "add", (1.0, f"{name}_square")),
        Assignment(f"{name}_slope", "div", (1.0, f"{name}_sum")),
        Integrated(line, ((1.0, x, f"{name}_slope"),)),
    ]


def _inverse_sine(line: Assignment) -> Items:
    x, name = line.args[0], line.target
    return [
        Assignment(f"{name}_square", "mul", (x, x)),
        Assignment(f"{name}_rest", "sub", (1.0, f"{name}_square")),
        Assignment(f"{name}_root", "sqrt", (f"{name}_rest",)),
        Assignment(f"{name}_slope", "div", (1.0, f"{name}_root")),
        Integrated(line, ((1.0 if line.op == "asin" else -1.0, x, f"{name}_slope"),)),
    ]


def _two_argument_tangent(line: Assignment) -> Items:
    (y, x), name = line.args, line.target
    return [
        Assignment(f"{name}_yy", "mul", (y, y)),
        Assignment(f"{name}_xx", "mul", (x, x)),
        Assignment(f"{name}_sum", "add", (f"{name}_xx", f"{name}_yy")),
        Assignment(f"{name}_along_y", "div", (x, f"{name}_sum")),
        Assignment(f"{name}_along_x", "div", (y, f"{name}_sum")),
        Integrated(line, ((1.0, y, f"{name}_along_y"), (-1.0, x, f"{name}_along_x"))),
    ]


def _logarithm(line: Assignment) -> Items:
    slope = f"{line.target}_slope"
    return [Assignment(slope, "div", (1.0, line.args[0])), Integrated(line, ((1.0, line.args[0], slope),))]


def _power(line: Assignment) -> Items:
    """a**b has slope b a**b / a along a and a**b log(a) along b."""
    (a, b), name = line.args, line.target
    quotient, along_a = f"{name}_quotient", f"{name}_along_a"
    after: Items = [Assignment(quotient, "div", (name, a)), Assignment(along_a, "mul", (b, quotient))]
    if not isinstance(b, str):
        return [Integrated(line, ((1.0, a, along_a),)), *after]
    logarithm, along_b = f"{name}_log", f"{name}_along_b"
    return [
        *_logarithm(Assignment(logarithm, "log", (a,))),
        Integrated(line, ((1.0, a, along_a), (1.0, b, along_b))),
        *after,
        Assignment(along_b, "mul", (name, logarithm)),
    ]


def _root(line: Assignment) -> bool:
    """Return whether a value is a root or a fixed power."""
    return line.op == "sqrt" or (line.op == "pow" and not isinstance(line.args[1], str))


def _from_flat(line: Assignment) -> Items:
    """Return a root or power of what may be zero all over, as max(0, x) is: where it is zero, it stays zero."""
    a, name = line.args[0], line.target
    exponent, base = 0.5 if line.op == "sqrt" else line.args[1], f"{name}_base"
    return [
        Integrated(line, ((1.0, a, f"{name}_along_a"),)),
        Assignment(base, "select", (a, a, 1.0)),
        Assignment(f"{name}_quotient", "div", (name, base)),
        Assignment(f"{name}_along_a", "mul", (exponent, f"{name}_quotient")),
    ]


_RULES: dict[str, Callable[[Assignment], Items]] = {
    "exp": _exp,
    "tan": _tangent,
    "tanh": _tangent,
    "atan": _inverse_tangent,
    "asin": _inverse_sine,
    "acos": _inverse_sine,
    "atan2": _two_argument_tangent,
    "log": _logarithm,
    "pow": _power,
}
