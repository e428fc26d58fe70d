"""Translation of the compiled subset of Python, whatever its target: what code means, and the kinds of its values.

A target is a class that prints what is found here: `dalembert.codegen.subset.statements` as LLVM assembly,
`dalembert.codegen.c.subset` as C.
"""

from __future__ import annotations

import ast
import builtins
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ClassVar, final

import numpy as np

from ...subset.compiled_subset import INTEGER, NUMBER, Array, Fields, Group, Kind, lanes
from .definitions import definition_of, scalars_of
from .target import Arrays, Target, Value, parts, unified

UNKNOWN: Any = object()
"""Placeholder of a value that is not known before the loop runs."""


@final
class Untranslatable(TypeError):
    """A fault whose message names the line already."""


class Translation(Target):
    """Translates one function of a module to `lines`; `fixed` are arguments that are never assigned."""

    built_in: ClassVar[Mapping[Any, Callable[..., Value]]]
    """Translation of each function that is not translated itself, by the function that Python code calls."""

    def __init__(self, module: Arrays, function: Any) -> None:
        self.module = module
        self.fixed: dict[str, Value] = {}
        self.variables: dict[str, Any] = {}
        self.lines: list[str] = []
        code = function.__code__
        self._local = {*code.co_varnames, *code.co_cellvars}
        cells = zip(code.co_freevars, function.__closure__ or (), strict=True)
        nonlocals = {name: cell.cell_contents for name, cell in cells}
        self._outside = nonlocals, function.__globals__, vars(builtins)
        self._source = code.co_filename

    @contextmanager
    def aside(self) -> Iterator[list[str]]:
        """Collect lines for later."""
        held, self.lines = self.lines, []
        try:
            yield self.lines
        finally:
            self.lines = held

    # -- expressions ------------------------------------------------------------------------

    def known(self, node: ast.expr) -> Any:
        """Return the value of a constant expression, or `UNKNOWN`."""
        match node:
            case ast.Constant(value=value):
                return value
            case ast.Name(id=name):
                return UNKNOWN if name in self._local else self._meaning(name)
            case ast.Attribute(value=base, attr=name):
                held = self.known(base)
                return UNKNOWN if held is UNKNOWN else getattr(held, name)
            case ast.UnaryOp(op=ast.Not() | ast.USub() as op, operand=operand):
                held = self.known(operand)
                return UNKNOWN if held is UNKNOWN else not held if isinstance(op, ast.Not) else -held
            case ast.BoolOp(op=op, values=values):
                held = [self.known(value) for value in values]
                deciding = isinstance(op, ast.Or)
                if any(value is not UNKNOWN and bool(value) is deciding for value in held):
                    return deciding
                return UNKNOWN if any(value is UNKNOWN for value in held) else not deciding
        return UNKNOWN

    def _meaning(self, name: str) -> Any:
        """Return what a name is outside the function, or `UNKNOWN`."""
        return next((names[name] for names in self._outside if name in names), UNKNOWN)

    def value(self, node: ast.expr) -> Value:
        """Return the value of an expression."""
        held = self.known(node)
        if held is not UNKNOWN:
            return self._constant(held)
        match node:
            case ast.Name(id=name):
                return self._read(name)
            case ast.Tuple(elts=elements):
                return self._group([self.value(element) for element in elements])
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self.negated(self.value(operand))
            case ast.UnaryOp(op=ast.Not()) | ast.BoolOp():
                return self.chosen(node, lambda: self.literal(True), lambda: self.literal(False))
            case ast.IfExp(test=test, body=body, orelse=other):
                return self.chosen(test, lambda: self.value(body), lambda: self.value(other))
            case ast.BinOp(left=left, op=op, right=right):
                return self.combined(op, self.value(left), self.value(right))
            case ast.Compare():
                return self._comparison(node)
            case ast.Attribute(value=base, attr=name):
                return self._attribute(self.value(base), name)
            case ast.Subscript(value=base, slice=index):
                return self._element(self.value(base), index)
            case ast.Call(func=func, args=arguments) if not node.keywords:
                return self._call(self.known(func), [self.value(argument) for argument in arguments])
        raise TypeError("this expression has no translation")

    def index(self, node: ast.expr) -> list[Value]:
        """Return the numbers of an index."""
        return [self.value(part) for part in (node.elts if isinstance(node, ast.Tuple) else [node])]

    def combined(self, op: ast.operator, a: Value, b: Value) -> Value:
        """Return a sum, product or another combination of two numbers, with Python's meaning."""
        if isinstance(op, ast.Pow):
            raise TypeError("there are no powers, and `square` for squares: Python rounds x ** 2 in another way")
        kind = NUMBER if isinstance(op, ast.Div) else unified(unified(a.kind, b.kind), INTEGER)
        a, b = self.converted(a, kind), self.converted(b, kind)
        if kind == INTEGER and isinstance(op, ast.FloorDiv | ast.Mod):
            (divisor,) = b.words
            if divisor.lstrip("-").isdigit() and int(divisor) <= 0:
                raise TypeError("whole numbers are divided by positive ones")
            return self.divided(isinstance(op, ast.Mod), a, b)
        neutral = {ast.Mult: "1", ast.Add: "0"}.get(type(op))
        if kind == INTEGER and neutral in b.words:  # of one lane, whose number is 0
            return a
        return self.arithmetic(op, kind, a, b)

    def converted(self, value: Value, kind: Kind) -> Value:
        """Return a value as one of a kind that holds it; `TypeError` where it does not."""
        if value.kind == kind:
            return value
        if isinstance(kind, Group) and isinstance(value.kind, Group) and len(kind.parts) == len(value.kind.parts):
            pairs = zip(parts(value), kind.parts, strict=True)
            return Value(kind, tuple(word for part, wanted in pairs for word in self.converted(part, wanted).words))
        if unified(value.kind, kind) != kind:
            raise TypeError(f"{value.kind} does not fit into {kind}")
        return self.cast(value, kind)

    def as_annotated(self, function: Any, given: list[Value]) -> list[Value]:
        """Return arguments of a function as its annotations have them."""
        wanted = scalars_of(definition_of(function))
        return [
            value if kind is None else self.converted(value, kind) for value, kind in zip(given, wanted, strict=True)
        ]

    def _read(self, name: str) -> Value:
        if name in self.fixed:
            return self.fixed[name]
        if name not in self.variables:
            raise TypeError(f"{name} has no value yet")
        return self.variable(name)

    @staticmethod
    def axes(array: Value, index: list[Value]) -> list[tuple[Value, str]]:
        """Return the numbers of an index, zeros behind the last, each with the length of its axis."""
        shape = array.words[1:]
        if len(index) > len(shape):
            raise TypeError(f"{len(index)} numbers are too many for {array.kind}")
        for number in index:
            if number.kind != INTEGER or number.words[0].startswith("-"):
                raise TypeError("an index is a whole number, and never a negative one")
        zeros = [Value(INTEGER, ("0",))] * (len(shape) - len(index))
        return list(zip([*index, *zeros], shape, strict=True))

    def part(self, group: Value, number: int) -> Value:
        """Return a part of a tuple."""
        assert isinstance(group.kind, Group)
        if not group.base:
            return parts(group)[number]
        kind, first = group.kind.parts[number], group.first + group.kind.places[number]
        return Value(kind, (), group.base, first) if isinstance(kind, Group) else self.argument(kind, group.base, first)

    def field(self, record: Value, name: str) -> Value:
        """Return the place of a field of a record."""
        if not isinstance(record.kind, Fields) or name not in record.kind.names:
            raise TypeError(f"there is no {name} that could be read or changed")
        number = record.kind.names.index(name)
        return Value(Array(record.kind.items[number], 0), (self.member(record, number),))

    @staticmethod
    def _group(values: list[Value]) -> Value:
        return Value(Group(tuple(v.kind for v in values)), tuple(word for v in values for word in v.words))

    def _constant(self, held: Any) -> Value:
        if isinstance(held, np.ndarray):
            return self.module.array(held)
        if isinstance(held, tuple):
            return self._group([self._constant(part) for part in held])
        if not isinstance(held, bool | int | float):
            raise TypeError(f"{held!r} is not a number")
        return self.literal(held)

    def _comparison(self, node: ast.Compare) -> Value:
        values = [self.value(part) for part in (node.left, *node.comparators)]
        result: Value | None = None
        for op, a, b in zip(node.ops, values, values[1:], strict=False):
            kind = unified(a.kind, b.kind)
            flag = self.compared(op, kind, self.converted(a, kind), self.converted(b, kind))
            result = flag if result is None else self.both(result, flag)
        assert result is not None
        return result

    def _attribute(self, value: Value, name: str) -> Value:
        if isinstance(value.kind, Fields):
            return self.load(self.field(value, name))
        if isinstance(value.kind, Group) and name in value.kind.names:
            return self.part(value, value.kind.names.index(name))
        if isinstance(value.kind, Array) and name == "shape":
            return Value(Group((INTEGER,) * value.kind.dimensions), value.words[1:])
        if isinstance(value.kind, Array) and name == "size":
            size = self.literal(1)
            for length in value.words[1:]:
                size = self.combined(ast.Mult(), size, Value(INTEGER, (length,)))
            return size
        raise TypeError(f"there is no {name}")

    def _element(self, base: Value, index: ast.expr) -> Value:
        if isinstance(base.kind, Group):
            return self.part(base, int(self.known(index)))
        place = self.place(base, self.index(index))
        assert isinstance(place.kind, Array)
        return place if place.kind.dimensions else self.load(place)

    def _call(self, function: Any, given: list[Value]) -> Value:
        if function is min or function is max:
            result = given[0]
            for other in given[1:]:  # as in Python, the first where one is not a number
                kind = unified(result.kind, other.kind)
                op = ast.Lt() if function is min else ast.Gt()
                result = self.replaced(op, kind, self.converted(result, kind), self.converted(other, kind))
            return result
        if function in self.built_in:
            return self.built_in[function](self, *given)
        if not getattr(function, "compiled_subset", False):
            raise TypeError(f"{function} has no translation")
        return self.called(function, self.as_annotated(function, given))

    # -- statements -------------------------------------------------------------------------

    def body(self, statements: list[ast.stmt]) -> None:
        """Translate statements, up to one behind which nothing is reached.

        Raises
        ------
        TypeError
            For statements that have no translation; the message names the line.
        """
        for statement in statements:
            if not self.reachable:
                return
            try:
                self.statement(statement)
            except Untranslatable:
                raise
            except (TypeError, KeyError) as fault:
                raise Untranslatable(f"{self._source}, line {statement.lineno}: {fault}") from fault

    def statement(self, node: ast.stmt) -> None:
        """Translate a statement."""
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=targets)], value=ast.Tuple(elts=values)):
                for target, found in zip(targets, self.together(values, targets), strict=True):
                    self.assign(target, found)
            case ast.Assign(targets=targets, value=value):
                found = self.value(value)
                for target in targets:
                    self.assign(target, found)
            case ast.AugAssign(target=target, op=op, value=value):
                self._change(target, op, value)
            case ast.If(test=test, body=body, orelse=other):
                self.branch_if(test, body, other)
            case ast.While(test=test, body=body, orelse=[]):
                self.loop_while(test, body)
            case ast.For(target=ast.Name(id=name), iter=ast.Call(func=ast.Name(id="range"), args=args), orelse=[]):
                self.loop_range(name, [self.value(argument) for argument in args], node.body)
            case ast.For(target=ast.Name(id=name), iter=ast.Call(func=func, args=[]), orelse=[]):
                if self.known(func) is not lanes:
                    raise TypeError("a for runs over a range, lanes or a tuple that is written out")
                self.loop_lanes(name, node.body)
            case ast.For(target=target, iter=ast.Tuple(elts=elements), orelse=[]):
                self.loop_each(target, elements, node.body)
            case ast.Break() | ast.Continue():
                self.leave(isinstance(node, ast.Break))
            case ast.Return(value=value):
                self.give(None if value is None else self.value(value))
            case ast.Expr(value=ast.Constant()):
                pass
            case ast.Expr(value=ast.Call() as call):
                self.value(call)
            case _:
                raise TypeError(f"{type(node).__name__} has no translation")

    def loop_lanes(self, name: str, body: list[ast.stmt]) -> None:
        """Translate a loop over the cases side by side, of which there is one."""
        self.fixed[name] = self.literal(0)
        self.body(body)
        del self.fixed[name]

    def together(self, nodes: list[ast.expr], targets: list[ast.expr]) -> list[Value]:
        """Return values that are all computed before one of them is assigned to its target."""
        return [self.value(node) for node in nodes]

    def assign(self, target: ast.expr, value: Value) -> None:
        """Assign a value to a variable, an element, a field, or a tuple of these."""
        match target:
            case ast.Name(id=name):
                self.assign_name(name, value)
            case ast.Tuple(elts=targets):
                count = len(value.kind.parts) if isinstance(value.kind, Group) else 0
                for part, found in zip(targets, [self.part(value, i) for i in range(count)], strict=True):
                    self.assign(part, found)
            case ast.Subscript(value=base, slice=index):
                self.store(value, self.place(self.value(base), self.index(index)))
            case ast.Attribute(value=base, attr=name):
                self.store(value, self.field(self.value(base), name))
            case _:
                raise TypeError("nothing can be assigned to this")

    def _change(self, target: ast.expr, op: ast.operator, value: ast.expr) -> None:
        if not isinstance(target, ast.Subscript):
            self.assign(target, self.combined(op, self.value(target), self.value(value)))
            return
        place = self.place(self.value(target.value), self.index(target.slice))
        self.store(self.combined(op, self.load(place), self.value(value)), place)
