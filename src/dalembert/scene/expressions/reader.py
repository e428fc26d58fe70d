"""Reader of SymPy expressions onto the graph."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import reduce
from itertools import islice
from typing import Any, final

import sympy as sp
from sympy.core.function import AppliedUndef
from sympy.physics.vector import dynamicsymbols

from ...errors import TOO_DEEP, list_names
from ...ir.graph import Graph
from ...ir.node import Node
from ...naming import unwritable
from ...transforms.conditions import Condition
from ...transforms.derivatives import tangents
from ..joints.joints import Unknown
from .compiled_functions import CompiledCall
from .elapsed import ElapsedTime
from .table_functions import TableFunction, outside
from .time_conditions import FUNCTIONS, JUMPING, RECIPROCALS, TimeConditions, supported
from .vector_products import VectorProduct

_EXPONENT = 1_000_000
_LONG = 10_000
"""Parts of an expression from which on messages do not print it."""

_ONCE = "(for SymPy, symbols with other assumptions are other symbols); create it once and use that one everywhere"


def short(expression: Any, width: int = 80) -> str:
    """Return an expression as one short line, coordinates without their time."""
    try:
        if isinstance(expression, sp.Basic) and len(list(islice(sp.preorder_traversal(expression), _LONG))) == _LONG:
            return f"an expression of more than {_LONG} parts"  # SymPy takes seconds to print it
        text = str(expression)
    except RecursionError:
        return "an expression that is nested deeply"
    except ValueError:  # Python does not print integers of more than 4,300 digits
        return "an expression with numbers of thousands of digits"
    text = re.sub(r"(\w+)\(t\)", lambda found: found[0] if found[1] in supported() else found[1], text)
    return text if len(text) <= width else text[: width - 3] + "..."


@final
class ExpressionReader:
    """Reads SymPy expressions onto a graph, each distinct subexpression once.

    Faults are collected in `faults`, with the place where they were met, and read as zero, so
    that one reading finds them all. `met` holds the coordinates, rates and inputs that were read.

    Parameters
    ----------
    graph : Graph
        Where the nodes go.
    leaves : mapping of SymPy object to Node
        Time, coordinates and rates.
    clock : ElapsedTime, optional
        Rewrites what is read, where time is counted from the start of the run.
    time : Node, optional
        The input that is time. With it, conditions that depend on time and parameters alone are decided at
        `CONDITION_TIME`, and recorded in `conditions`.
    """

    def __init__(
        self,
        graph: Graph,
        leaves: Mapping[Any, Node],
        clock: ElapsedTime | None = None,
        time: Node | None = None,
    ) -> None:
        self.graph, self.clock = graph, clock
        self.timed = False
        self.leaves = dict(leaves)
        self.parameters: dict[str, sp.Symbol] = {}
        self._operations = TimeConditions(graph, time, self.parameters)
        self.unknowns: dict[str, sp.Symbol] = {}
        self.faults: list[str] = []
        self.met: set[Any] = set()
        self._known: dict[Any, Node] = {}
        self._place = ""
        self._allow_unknowns = False
        self._allow_accelerations = False
        self.flow: Callable[[], Mapping[Node, Node]] = dict

    def read(self, expression: Any, place: str, *, unknowns: bool = False, accelerations: bool = False) -> Node:
        """Return the node of `expression`, met at `place`.

        `unknowns` says whether reactions may occur in it, `accelerations` whether second rates may, which `flow`
        gives with the rates of coordinates, rates and time. Expressions that are read after it must allow them too.
        """
        self._place, self._allow_unknowns, self._allow_accelerations = place, unknowns, accelerations
        try:
            # SymPy would run a text as code
            e = None if isinstance(expression, str | bytes) else sp.sympify(expression)
        except (sp.SympifyError, TypeError, ValueError, AttributeError, RecursionError):
            e = None
        if not isinstance(e, sp.Basic):
            written = "; a Python function is not called: write it in the symbols of the scene"
            return self.fault(f"{expression!r} is not a SymPy expression{written if callable(expression) else ''}")
        if self.clock is not None:
            e = self._elapsed(e, self.clock)
        self.graph.written = True
        try:
            return self._read(e)
        except RecursionError:
            return self.fault(TOO_DEEP)
        finally:
            self.graph.written = False

    @property
    def conditions(self) -> dict[Condition, None]:
        """The conditions on time and parameters alone that were read, in order."""
        return self._operations.found

    def ignore_conditions(self) -> None:
        """Read operations with kinks or jumps in time alone like all others from now on."""
        self._operations = TimeConditions(self.graph, None, self.parameters)

    def watch(self, e: Any) -> None:
        """Add the parameters that an expression, read by another reader, needs in elapsed time."""
        if self.clock is not None:
            self._elapsed(e, self.clock)

    def _elapsed(self, e: Any, clock: ElapsedTime) -> Any:
        """Return an expression in the elapsed time; constants that depend on the start become parameters."""
        found = clock(e)
        for offset in clock.offsets.values():
            for symbol in (offset.symbol, *offset.symbols):
                self._read(symbol)
        return found

    def define(self, leaves: Mapping[Any, Node]) -> None:
        """Read SymPy objects as these nodes from now on."""
        self.leaves.update(leaves)
        self._known.clear()

    def fault(self, text: str) -> Node:
        """Record a fault at the present place and return zero."""
        line = f"{self._place}: {text}"
        if line not in self.faults:
            self.faults.append(line)
        return self.graph.zero

    def _read(self, e: Any) -> Node:
        known = self._known.get(e)
        if known is not None:
            return known
        node = self._new(e)
        if not (isinstance(e, sp.Symbol) and e.name in self.unknowns):
            self._known[e] = node
        return node

    def _new(self, e: Any) -> Node:
        g = self.graph
        if e in self.leaves:
            self.met.add(e)
            self.timed |= e == dynamicsymbols._t
            return self.leaves[e]
        if e.is_Rational:
            return g.const(Fraction(int(e.p), int(e.q)))
        if e.is_Float:
            return self._decimal(e)
        if e.is_NumberSymbol:
            return g.named_constant(str(e), float(e))
        if e.is_Symbol:
            return self._symbol(e)
        if e.is_Add:
            return g.sum(self._read(arg) for arg in e.args)
        if e.is_Mul:
            return self._product(e)
        if e.is_Pow:
            return self._power(e)
        if isinstance(e, sp.Derivative):
            return self._derivative(e)
        if isinstance(e, TableFunction):
            return self._table(e)
        if isinstance(e, VectorProduct):
            return e.value(self._read)
        if isinstance(e, CompiledCall):
            return g.call(e.function.op, *map(self._read, e.values), g.const(e.function.key))
        if isinstance(e, sp.Subs) and isinstance(e.expr, sp.Derivative) and isinstance(e.expr.expr, AppliedUndef):
            return self.fault(self._undefined(e.expr.expr.subs(dict(zip(e.variables, e.point, strict=True)))))
        if isinstance(e, AppliedUndef):
            other = str(e) in map(str, self.leaves)
            return self.fault(f"{e} is not the coordinate of that name {_ONCE}" if other else self._undefined(e))
        return self._function(e)

    def _undefined(self, e: Any) -> str:
        """Return what is wrong with an undefined function, and what is supported in its place."""
        time, name = dynamicsymbols._t, e.func.__name__
        if e.args == (time,):
            return (
                f"{e} is a function of time that is no coordinate; add it to the coordinates of the scene, declare it"
                " as a given function of time with add_inputs, or give its rate with add_states"
                f" (known: {list_names(str(q) for q in self.leaves if isinstance(q, AppliedUndef))})"
            )
        known = len(e.args) == 1 and e.func(time) in self.leaves
        if known and not e.args[0].has(time):
            return f"{e} is {name!r} at a fixed time: declare a parameter for it, and give its value to runs"
        if known:
            return (
                f"{e} is {name!r} at another time, and delays are not supported: approximate it by a chain of"
                f" first-order states (add_states), n of them, z1' = n ({name} - z1) / tau, z2' = n (z1 - z2) / tau,"
                " ..., or sample it: a da.Controller whose states are past values, {d1: "
                f"{name}, d2: d1}}, has them of one period and two before. A given function of time is an input"
                " (add_inputs), whose samples are given shifted"
            )
        expression = f"{e} is an undefined function: write the expression that it stands for in its place"
        if len(e.args) == 1:
            return f"{expression}, or a curve of data dalembert.table({e.args[0]}, knots, values, kind)"
        if len(e.args) == 2:
            return f"{expression}, or a surface of data dalembert.table({e.args}, knots, values, kind)"
        return f"{expression}; a table of data has one argument or two"

    def _table(self, e: TableFunction) -> Node:
        curve, values = e.curve, [self._read(x) for x in e.values]
        for x, axis in zip(values, curve.axes, strict=True):
            if x.number is not None and outside(float(x.number), axis):
                return self.fault(
                    f"{e} is outside of the knots of the table {axis.name!r}, which go from {axis.first:g} to"
                    f' {axis.last:g}; give it extrapolate="hold" or "linear", or more knots'
                )
        numbers = map(self.graph.const, (curve.table.key, *curve.orders))
        return self.graph.call("table" if len(values) == 1 else "surface", *values, *numbers)

    def _decimal(self, e: Any) -> Node:
        """Return a decimal number: the binary fraction that SymPy holds, all its digits."""
        if not e.is_finite:
            return self.fault(f"{e} is not a finite number")
        exact = sp.Rational(e)
        return self.graph.decimal(Fraction(int(exact.p), int(exact.q)))

    def _symbol(self, e: Any) -> Node:
        table, other = (self.unknowns, self.parameters) if isinstance(e, Unknown) else (self.parameters, self.unknowns)
        if isinstance(e, Unknown) and not self._allow_unknowns:
            return self.fault(f"the unknown {e.name} may only be used in the force or torque of a joint")
        if unwritable(e.name):
            return self.fault(f"the name {e.name!a} has a lone surrogate, half of a character; use another name")
        held = table.setdefault(e.name, e)
        if held != e or e.name in other:
            return self.fault(f"two different symbols are both called {e.name!r} {_ONCE}")
        return self.graph.input(e.name)

    def _product(self, e: Any) -> Node:
        top: list[Node] = []
        bottom: list[Node] = []
        for arg in e.args:
            if arg.is_Pow and arg.exp.is_Rational and arg.exp.is_negative:
                bottom.append(self._read(sp.Pow(arg.base, -arg.exp)))
            else:
                top.append(self._read(arg))
        product = reduce(self.graph.mul, top, self.graph.one)
        return self._divide(product, reduce(self.graph.mul, bottom), e) if bottom else product

    def _divide(self, top: Node, bottom: Node, e: Any) -> Node:
        if bottom.is_zero:
            return self.fault(f"{e} divides by zero")
        self._operations.record_pulse("pow", bottom)
        return self.graph.div(top, bottom)

    def _power(self, e: Any) -> Node:
        base = self._read(e.base)
        halves = e.exp.is_Float and float(2 * e.exp).is_integer()  # x**2.0 is x**2, also where x is zero
        if e.exp.is_Rational and abs(e.exp) > _EXPONENT:
            return self.fault(f"{short(e)} has an exponent beyond {_EXPONENT:,}; write it with exp and log")
        if e.exp.is_Rational or halves:
            exponent = Fraction(float(e.exp)) if halves else Fraction(int(e.exp.p), int(e.exp.q))
            if exponent < 0:
                return self._divide(self.graph.one, self.graph.power(base, -exponent), e)
            if exponent > 2:
                self._operations.record_pulse("pow", base, float(exponent))
            return self.graph.power(base, exponent)
        return self.graph.call("pow", base, self._read(e.exp))

    def _derivative(self, e: Any) -> Node:
        done = e.doit()
        if done != e:
            return self._read(done)
        inner, time = e.expr, dynamicsymbols._t
        count = e.derivative_count if set(e.variables) == {time} else 0
        before = inner if count == 1 else sp.Derivative(inner, (time, count - 1)) if count else None
        if before in self.leaves and self._allow_accelerations:
            return tangents(self.graph, [self.leaves[before]], self.flow())[0]
        if inner in self.leaves and count > 1:
            if self._allow_accelerations:
                return self.fault(f"{e} is beyond what outputs contain: second rates of coordinates, rates of states")
            return self.fault(
                f"{e} is an acceleration, which may stand in outputs, events and reductions; here only coordinates and"
                " their first rates may be used"
            )
        if isinstance(inner, AppliedUndef) and inner.args != (time,):
            return self.fault(self._undefined(inner))
        return self.fault(f"{e} is the rate of something that is no coordinate of the scene")

    def _function(self, e: Any) -> Node:
        g, kind = self.graph, e.func
        if kind in FUNCTIONS:
            return self._operations.call(FUNCTIONS[kind], *(self._read(arg) for arg in e.args))
        if kind in RECIPROCALS:
            top, bottom = RECIPROCALS[kind]
            argument = self._read(e.args[0])
            return self._divide(g.call(top, argument) if top else g.one, g.call(bottom, argument), e)
        if kind in (sp.Min, sp.Max):
            name = "min" if kind is sp.Min else "max"
            nodes = [self._read(arg) for arg in sorted(e.args, key=sp.default_sort_key)]
            return reduce(lambda a, b: self._operations.call(name, a, b), nodes)
        if kind in JUMPING:
            return JUMPING[kind](self._operations, *(self._read(arg) for arg in e.args))
        if kind is sp.Mod:
            number, period = (self._read(arg) for arg in e.args)
            return number - period * self._operations.call("floor", self._divide(number, period, e))
        if kind is sp.Piecewise:
            return self._operations.piecewise(e, self._read, self.fault)
        if e in (sp.true, sp.false) or isinstance(e, sp.core.relational.Relational):
            what = (
                "what Python makes of a comparison with =="
                if e.is_Boolean and e in (sp.true, sp.false)
                else "a relation"
            )
            return self.fault(f"{e} is {what}; write an expression, such as left side minus right side that vanishes")
        done = e.doit() if kind in (sp.Sum, sp.Product, sp.Integral) else e
        if done != e:
            return self._read(done)
        return self.fault(f"{kind.__name__} cannot be compiled; functions known: {list_names(supported())}")
