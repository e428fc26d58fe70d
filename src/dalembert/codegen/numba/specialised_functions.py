"""A function of the subset while it is specialised for one program: statements and expressions, partially evaluated."""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import operator
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ...frozen import frozen
from ...stops.stops import pass_stops, take_stops
from ...subset import compiled_subset as language
from ...subset.arguments import Record

if TYPE_CHECKING:
    from .specialised_loops import SpecialisedLoops

_FOLDED: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.FloorDiv: operator.floordiv,
    ast.Div: operator.truediv,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Not: operator.not_,
    ast.USub: operator.neg,
}
_PURE: tuple[Callable[..., Any], ...] = (min, max, abs, int, float)
_PLAIN = (
    *(language.row, language.flat, language.element, language.fma, language.square),
    *(language.sqrt, language.exp, language.log, language.lowest),
)

_AT_STOPS: dict[Callable[..., Any], float | None] = {pass_stops: 0.0, take_stops: None}
"""Functions that runs without stops never call, and what stands for their results."""


@final
@frozen
class Known:
    """A value that is the same in all runs."""

    value: Any


@final
@frozen
class Part:
    """A part of the arguments of the loop: its dotted name, and an example of it."""

    path: str
    example: Any


def is_docstring(line: ast.stmt) -> bool:
    """Return whether a statement is a constant that stands alone."""
    return isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant)


@final
class SpecialisedFunction:
    """One function while it is specialised."""

    def __init__(self, loops: SpecialisedLoops, function: Any, tree: ast.FunctionDef, known: dict[str, Any]) -> None:
        self.loops, self.known = loops, known
        variables = inspect.getclosurevars(function)
        self.outside = {**variables.builtins, **variables.globals, **variables.nonlocals}
        stored = [node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)]
        self.assigned = Counter([*stored, *known])
        self.returned: Known | None = None

    # -- statements -------------------------------------------------------------------------

    def block(self, body: list[ast.stmt]) -> list[ast.stmt]:
        """Return specialised statements."""
        found: list[ast.stmt] = []
        for line in body:
            found += self._statement(line)
            if found and isinstance(found[-1], ast.Return):
                break
        return found

    def _statement(self, line: ast.stmt) -> list[ast.stmt]:
        match line:
            case ast.If(test=test, body=body, orelse=orelse):
                node, known = self.value(test)
                if isinstance(known, Known):
                    return self.block(body if known.value else orelse)
                then, other = self.block(body), self.block(orelse)
                if not then and not other:
                    return []
                if not then:
                    return [ast.If(ast.UnaryOp(ast.Not(), node), other, [])]
                return [ast.If(node, then, other)]
            case ast.While(test=test, body=body):
                node, known = self.value(test)
                if isinstance(known, Known) and not known.value:
                    return []
                return [ast.While(node, self.block(body) or [ast.Pass()], [])]
            case ast.For(target=target, iter=ast.Tuple(elts=items), body=body):
                return [made for item in items for made in self._round(target, item, body)]
            case ast.For(target=target, iter=ast.Call(args=limits) as count, body=body):
                made = [self.value(limit) for limit in limits]
                if len(made) == 1 and isinstance(made[0][1], Known) and made[0][1].value <= 0:
                    return []
                inside = self.block(body)
                call = ast.Call(count.func, [node for node, _ in made], [])
                return [ast.For(target, call, inside, [])] if inside else []
            case ast.Return(value=value):
                if value is None:
                    return [ast.Return(None)]
                node, known = self.value(value)
                self.returned = known if isinstance(known, Known) else None
                return [ast.Return(node)]
            case ast.Expr(value=value):
                node, known = self.value(value)
                return [line] if is_docstring(line) else [] if known is not None else [ast.Expr(node)]
            case ast.AugAssign(target=target, op=op, value=value):
                return [ast.AugAssign(self._place(target), op, self.value(value)[0])]
            case ast.Assign(targets=targets, value=value):
                return self._assignment(targets, value)
            case _:
                return [line]

    def _round(self, target: ast.expr, item: ast.expr, body: list[ast.stmt]) -> list[ast.stmt]:
        """Return the statements of a loop over a tuple for one of its elements."""
        names = target.elts if isinstance(target, ast.Tuple) else [target]
        values = item.elts if isinstance(target, ast.Tuple) and isinstance(item, ast.Tuple) else [item]
        found: list[ast.stmt] = []
        for name, value in zip(names, values, strict=True):
            assert isinstance(name, ast.Name)
            self.known.pop(name.id, None)
            node, known = self.value(value)
            if not self._defined(name, known):
                found.append(ast.Assign([name], node))
        return found + self.block(body)

    def _assignment(self, targets: list[ast.expr], value: ast.expr) -> list[ast.stmt]:
        (target, *further) = targets
        if further or not isinstance(target, ast.Tuple) or not isinstance(value, ast.Tuple):
            node, known = self.value(value)
            if not further and self._defined(target, known):
                return []
            return [ast.Assign([self._place(item) for item in targets], node)]
        left, right = list[ast.expr](), list[ast.expr]()
        for item, part in zip(target.elts, value.elts, strict=True):
            node, known = self.value(part)
            if not self._defined(item, known):
                left.append(self._place(item))
                right.append(node)
        if len(left) <= 1:
            return [ast.Assign(left, right[0])] if left else []
        names = {item.id for item in left if isinstance(item, ast.Name)}
        used = {part.id for node in right for part in ast.walk(node) if isinstance(part, ast.Name)}
        if len(names) == len(left) and not names & used:
            return [ast.Assign([item], node) for item, node in zip(left, right, strict=True)]
        return [ast.Assign([ast.Tuple(left, ast.Store())], ast.Tuple(right, ast.Load()))]

    def _defined(self, target: ast.expr, known: Known | Part | None) -> bool:
        """Remember what a variable is, if it is assigned once; return whether no line is needed for that."""
        if not isinstance(target, ast.Name) or self.assigned[target.id] > 1 or known is None:
            return False
        self.known[target.id] = known
        return isinstance(known, Known)

    def _place(self, target: ast.expr) -> Any:
        """Return what is assigned to."""
        match target:
            case ast.Subscript(value=value, slice=index):
                return ast.Subscript(self.value(value)[0], self.value(index)[0], ast.Store())
            case ast.Attribute(value=value, attr=name):
                node, known = self.value(value)
                assert isinstance(known, Part)
                self.loops.touched.add(f"{known.path}.{name}".lstrip("."))
                return ast.Attribute(node, name, ast.Store())
            case ast.Tuple(elts=elements):
                return ast.Tuple([self._place(item) for item in elements], ast.Store())
            case _:
                return target

    # -- expressions ------------------------------------------------------------------------

    def value(self, node: ast.expr) -> tuple[ast.expr, Known | Part | None]:
        """Return an expression, and what is known of its value."""
        found, known = self._value(node)
        if isinstance(known, Known) and not isinstance(found, ast.Name) and not callable(known.value):
            number = known.value
            if isinstance(number, float) and not math.isfinite(number):
                return ast.parse(f"math.{'nan' if math.isnan(number) else 'inf'}", mode="eval").body, None
            return ast.Constant(number), known
        return found, known

    def _value(self, node: ast.expr) -> tuple[ast.expr, Known | Part | None]:
        match node:
            case ast.Constant(value=value):
                return node, Known(value)
            case ast.Name(id=name):
                return self._name(node, name)
            case ast.Attribute(value=value, attr=name):
                return self._attribute(value, name)
            case ast.Subscript(value=value, slice=index):
                (array, known), (place, at) = self.value(value), self.value(index)
                if isinstance(known, Known) and isinstance(at, Known):
                    return node, Known(known.value[at.value])
                return ast.Subscript(array, place, ast.Load()), None
            case ast.Tuple(elts=elements):
                return ast.Tuple([self.value(item)[0] for item in elements], ast.Load()), None
            case ast.BinOp(left=left, op=op, right=right):
                return self._folded(op, [left, right], lambda a, b, op=op: ast.BinOp(a, op, b))
            case ast.UnaryOp(op=op, operand=operand):
                return self._folded(op, [operand], lambda a, op=op: ast.UnaryOp(op, a))
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                return self._folded(op, [left, right], lambda a, b, op=op: ast.Compare(a, [op], [b]))
            case ast.Compare(left=left, ops=ops, comparators=right):
                return ast.Compare(self.value(left)[0], ops, [self.value(item)[0] for item in right]), None
            case ast.BoolOp(op=op, values=values):
                return self._joined(op, values)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                chosen, known = self.value(test)
                if isinstance(known, Known):
                    return self.value(body if known.value else orelse)
                return ast.IfExp(chosen, self.value(body)[0], self.value(orelse)[0]), None
            case ast.Call(func=function, args=arguments):
                return self._call(function, arguments)
        raise TypeError(f"{ast.unparse(node)} is not in the subset of compiled loops")

    def _name(self, node: ast.expr, name: str) -> tuple[ast.expr, Known | Part | None]:
        if name in self.known:
            known = self.known[name]
            if isinstance(known, Known):
                return ast.Constant(known.value), known
            return node, known
        if self.assigned[name] or name not in self.outside:
            return node, None
        value = self.outside[name]
        if isinstance(value, bool) or not isinstance(value, int | float):
            return (ast.Constant(value) if isinstance(value, bool) else node), Known(value)
        return self._constant(name, float(value) if isinstance(value, float) else int(value))

    def _constant(self, name: str, value: int | float) -> tuple[ast.expr, Known]:
        name = name.strip("_")
        if self.loops.constants.setdefault(name, value) != value:
            return ast.Constant(value), Known(value)
        return ast.Name(name, ast.Load()), Known(value)

    def _attribute(self, value: ast.expr, name: str) -> tuple[ast.expr, Known | Part | None]:
        node, known = self.value(value)
        if isinstance(known, Known):
            found = getattr(known.value, name)
            if isinstance(found, int) and isinstance(known.value, type):
                return self._constant(name, int(found))  # a status
            return ast.Attribute(node, name, ast.Load()), Known(found)
        made = ast.Attribute(node, name, ast.Load())
        if not isinstance(known, Part):
            return made, None
        path = f"{known.path}.{name}".lstrip(".")
        if isinstance(known.example, np.ndarray):
            return made, Known(getattr(known.example, name))
        found = getattr(known.example, name)
        if isinstance(known.example, Record) or self.loops.is_given(path):
            self.loops.touched.add(path)
            return made, None
        if isinstance(found, int | float):
            return made, Known(found)
        self.loops.touched.add(path)
        return made, Part(path, found)

    def _folded(self, op: ast.AST, parts: list[ast.expr], make: Callable[..., ast.expr]) -> tuple[ast.expr, Any]:
        made = [self.value(part) for part in parts]
        known = [value.value for _, value in made if isinstance(value, Known)]
        if len(known) == len(made) and type(op) in _FOLDED and not (isinstance(op, ast.Div) and known[1] == 0):
            return make(*(node for node, _ in made)), Known(_FOLDED[type(op)](*known))
        return make(*(node for node, _ in made)), None

    def _joined(self, op: ast.boolop, values: list[ast.expr]) -> tuple[ast.expr, Known | None]:
        ends, left = isinstance(op, ast.Or), list[ast.expr]()
        for item in values:
            node, known = self.value(item)
            if not isinstance(known, Known):
                left.append(node)
            elif bool(known.value) == ends:
                if not any(isinstance(part, ast.Call) for kept in left for part in ast.walk(kept)):
                    return ast.Constant(ends), Known(ends)
                left.append(ast.Constant(ends))
                break
        if not left:
            return ast.Constant(not ends), Known(not ends)
        return (left[0] if len(left) == 1 else ast.BoolOp(op, left)), None

    def _call(self, called: ast.expr, arguments: list[ast.expr]) -> tuple[ast.expr, Known | Part | None]:
        known = self.value(called)[1]
        assert isinstance(known, Known), ast.unparse(called)
        function, made = known.value, [self.value(argument) for argument in arguments]
        if function is language.call_code:
            return self._kernel_call(made)
        nodes = [node for node, _ in made]
        if function in _AT_STOPS:
            return ast.Constant(None), Known(_AT_STOPS[function])
        if getattr(function, "compiled_subset", False):
            one = self.loops.specialised(function, [value for _, value in made])
            if one.result is not None or one.empty:
                return ast.Constant(None), one.result or Known(None)
            return ast.Call(ast.Name(one.name, ast.Load()), [nodes[i] for i in one.kept], []), None
        values = [value.value for _, value in made if isinstance(value, Known)]
        if function in _PURE and len(values) == len(made):
            return ast.Constant(None), Known(function(*values))
        if function in _PLAIN or function is math.isfinite or hasattr(builtins, function.__name__):
            return ast.Call(called, nodes, []), None
        raise TypeError(f"{ast.unparse(called)} has no translation for numba")

    def _kernel_call(self, made: list[tuple[ast.expr, Known | Part | None]]) -> tuple[ast.expr, Known | None]:
        (_, address), *given = made
        assert isinstance(address, Known)
        if address.value == 0:  # what is not there is not called
            return ast.Constant(None), Known(None)
        out = given[-1][0]
        passed = [out if value == Known(0) else node for node, value in given]  # what is not read
        return ast.Call(ast.Name(self.loops.kernel(int(address.value)), ast.Load()), passed, []), None
