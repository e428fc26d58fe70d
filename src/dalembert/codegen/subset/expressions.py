"""Translation of Python expressions to lines of LLVM assembly."""

from __future__ import annotations

import ast
import builtins
import inspect
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from ...subset.compiled_subset import FLAG, INTEGER, NUMBER, Array, Fields, Group, Kind
from .built_in import BUILT_IN
from .values import Lines, Value, literal, unified

UNKNOWN: Any = object()
"""Placeholder of a value that is not known before the loop runs."""

_WHOLE = {
    ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.LShift: "shl", ast.RShift: "ashr", ast.BitAnd: "and"
}  # fmt: skip
_DOUBLE = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul", ast.Div: "fdiv"}
_TESTS = {
    ast.Eq: ("eq", "oeq"), ast.NotEq: ("ne", "une"), ast.Lt: ("slt", "olt"),
    ast.LtE: ("sle", "ole"), ast.Gt: ("sgt", "ogt"), ast.GtE: ("sge", "oge"),
}  # fmt: skip


class Functions(Protocol):
    """The other functions and the constants of a module of assembly."""

    def function(self, function: Any, kinds: tuple[Kind, ...]) -> tuple[str, Kind]:
        """Return the name of a function for arguments of some kinds, and the kind of its result."""

    def array(self, array: Any) -> Value:
        """Return a constant array."""

    fused: str
    """Name of LLVM's function for a product and a sum that are rounded once."""


class Expressions(Lines):
    """Translates the expressions of one function."""

    def __init__(self, module: Functions, function: Any) -> None:
        super().__init__()
        self.module = module
        self.variables: dict[str, tuple[Kind, list[str]]] = {}
        self.fixed: dict[str, Value] = {}
        self._local = {*function.__code__.co_varnames, *function.__code__.co_cellvars}
        outside = inspect.getclosurevars(function)
        self._outside = {**vars(builtins), **function.__globals__, **outside.nonlocals}

    def known(self, node: ast.expr) -> Any:
        """Return the value of a constant expression, or `UNKNOWN`."""
        match node:
            case ast.Constant(value=value):
                return value
            case ast.Name(id=name) if name not in self._local:
                return self._outside.get(name, UNKNOWN)
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

    def condition(self, node: ast.expr, yes: str, no: str) -> None:
        """End a block where an expression decides what follows."""
        held = self.known(node)
        if held is not UNKNOWN:
            self.jump(yes if held else no)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            self.condition(node.operand, no, yes)
        elif isinstance(node, ast.BoolOp):
            for value in node.values[:-1]:
                following = self.fresh()
                if isinstance(node.op, ast.And):
                    self.condition(value, following, no)
                else:
                    self.condition(value, yes, following)
                self.begin(following)
            self.condition(node.values[-1], yes, no)
        else:
            self.branch(self.truth(self.value(node)), yes, no)

    def value(self, node: ast.expr) -> Value:
        """Return the value of an expression."""
        held = self.known(node)
        if held is not UNKNOWN:
            return self._constant(held)
        match node:
            case ast.Name(id=name):
                return self._variable(name)
            case ast.Tuple(elts=elements):
                values = [self.value(element) for element in elements]
                return Value(Group(tuple(v.kind for v in values)), tuple(word for v in values for word in v.words))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                value = self.value(operand)
                (word,) = value.words
                minus = f"sub i64 0, {word}" if value.kind == INTEGER else f"fneg double {word}"
                return Value(value.kind, (self.set(minus),))
            case ast.UnaryOp(op=ast.Not()) | ast.BoolOp():
                return self._chosen(node, lambda: literal(True), lambda: literal(False))
            case ast.IfExp(test=test, body=body, orelse=other):
                return self._chosen(test, lambda: self.value(body), lambda: self.value(other))
            case ast.BinOp(left=left, op=op, right=right):
                return self.combined(op, self.value(left), self.value(right))
            case ast.Compare():
                return self._compared(node)
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
        (x,), (y,) = self.converted(a, kind).words, self.converted(b, kind).words
        if kind == NUMBER:
            return Value(kind, (self.set(f"{_DOUBLE[type(op)]} double {x}, {y}"),))
        if isinstance(op, ast.FloorDiv | ast.Mod):
            if y.lstrip("-").isdigit() and int(y) <= 0:
                raise TypeError("whole numbers are divided by positive ones")
            return Value(kind, (self._divided(isinstance(op, ast.Mod), x, y),))
        return Value(kind, (self.set(f"{_WHOLE[type(op)]} i64 {x}, {y}"),))

    def _divided(self, rest: bool, x: str, y: str) -> str:
        """Return quotient or rest of a whole number and a positive one, rounded down; 0 divides as 1 does."""
        y = self.set(f"call i64 @llvm.smax.i64(i64 {y}, i64 1)")
        quotient, left = self.set(f"sdiv i64 {x}, {y}"), self.set(f"srem i64 {x}, {y}")
        under = self.set(f"icmp slt i64 {left}, 0")
        if rest:
            return self.set(f"select i1 {under}, i64 {self.set(f'add i64 {left}, {y}')}, i64 {left}")
        return self.set(f"sub i64 {quotient}, {self.set(f'zext i1 {under} to i64')}")

    def _constant(self, held: Any) -> Value:
        if isinstance(held, np.ndarray):
            return self.module.array(held)
        if isinstance(held, tuple):
            values = [self._constant(part) for part in held]
            return Value(Group(tuple(v.kind for v in values)), tuple(word for v in values for word in v.words))
        if not isinstance(held, bool | int | float):
            raise TypeError(f"{held!r} is not a number")
        return literal(held)

    def _variable(self, name: str) -> Value:
        if name in self.fixed:
            return self.fixed[name]
        if name not in self.variables:
            raise TypeError(f"{name} has no value yet")
        kind, slots = self.variables[name]
        pairs = zip(kind.words, slots, strict=True)
        return Value(kind, tuple(self.set(f"load {word}, ptr {slot}") for word, slot in pairs))

    def _chosen(self, test: ast.expr, yes: Callable[[], Value], no: Callable[[], Value]) -> Value:
        """Return one of two values; only the one that the test selects is computed."""
        held = self.known(test)
        if held is not UNKNOWN:
            return yes() if held else no()
        blocks, end = (self.fresh(), self.fresh()), self.fresh()
        self.condition(test, *blocks)
        sides = []
        for make in (yes, no):
            self.open = True
            with self.aside() as lines:
                sides.append((make(), lines))
        kind = unified(sides[0][0].kind, sides[1][0].kind)
        slots = [self.slot(word) for word in kind.words]
        for block, (value, lines) in zip(blocks, sides, strict=True):
            self.lines.append(f"{block}:")
            self.open = True
            self.lines += lines
            self.keep(self.converted(value, kind), slots)
            self.jump(end)
        self.lines.append(f"{end}:")
        self.open = True
        pairs = zip(kind.words, slots, strict=True)
        return Value(kind, tuple(self.set(f"load {word}, ptr {slot}") for word, slot in pairs))

    def keep(self, value: Value, slots: list[str]) -> None:
        """Write the words of a value to memory."""
        for kind, word, slot in zip(value.kind.words, value.words, slots, strict=True):
            self.lines.append(f"store {kind} {word}, ptr {slot}")

    def _compared(self, node: ast.Compare) -> Value:
        values = [self.value(part) for part in (node.left, *node.comparators)]
        result = ""
        for op, a, b in zip(node.ops, values, values[1:], strict=False):
            kind = unified(a.kind, b.kind)
            (x,), (y,) = self.converted(a, kind).words, self.converted(b, kind).words
            whole, double = _TESTS[type(op)]
            test = f"fcmp {double} double" if kind == NUMBER else f"icmp {whole} {kind.words[0]}"
            flag = self.set(f"{test} {x}, {y}")
            result = self.set(f"and i1 {result}, {flag}") if result else flag
        return Value(FLAG, (result,))

    def _attribute(self, value: Value, name: str) -> Value:
        if isinstance(value.kind, Fields):
            return self.load(self.field(value, name))
        if isinstance(value.kind, Group) and name in value.kind.names:
            return self.part(value, value.kind.names.index(name))
        if isinstance(value.kind, Array) and name == "shape":
            return Value(Group((INTEGER,) * value.kind.dimensions), value.words[1:])
        if isinstance(value.kind, Array) and name == "size":
            size = literal(1)
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
            return self._extreme(_TESTS[ast.Lt if function is min else ast.Gt], given)
        if function in BUILT_IN:
            return BUILT_IN[function](self, *given)
        if not getattr(function, "compiled_subset", False):
            raise TypeError(f"{function} has no translation")
        name, kind, given = self.called(function, given)
        words = ", ".join(
            f"{k} {w}"
            for v in given
            for k, w in ([("ptr", self.address(v))] if v.base else zip(v.kind.words, v.words, strict=True))
        )
        if not kind.words:
            self.lines.append(f"call void @{name}({words})")
            return Value(kind, ())
        several = f"{{{', '.join(kind.words)}}}"
        result = self.set(f"call {several} @{name}({words})")
        found = [self.set(f"extractvalue {several} {result}, {place}") for place in range(len(kind.words))]
        return Value(kind, tuple(found))

    def _extreme(self, tests: tuple[str, str], given: list[Value]) -> Value:
        """Return the least or largest of some numbers: as in Python, the first where one is not a number."""
        result = given[0]
        for other in given[1:]:
            kind = unified(result.kind, other.kind)
            (x,), (y,) = self.converted(result, kind).words, self.converted(other, kind).words
            test = f"fcmp {tests[1]} double" if kind == NUMBER else f"icmp {tests[0]} i64"
            flag = self.set(f"{test} {y}, {x}")
            result = Value(kind, (self.set(f"select i1 {flag}, {kind.words[0]} {y}, {kind.words[0]} {x}"),))
        return result

    def called(self, function: Any, given: list[Value]) -> tuple[str, Kind, list[Value]]:
        """Return the name of a function, the kind of its result, and its arguments converted to its kinds."""
        wanted = [function.__annotations__.get(name, "") for name in inspect.signature(function).parameters]
        scalars = {"float": NUMBER, "int": INTEGER, "bool": FLAG}
        given = [
            self.converted(value, scalars[kind]) if kind in scalars else value
            for value, kind in zip(given, wanted, strict=True)
        ]
        return *self.module.function(function, tuple(value.kind for value in given)), given
