"""Translation of Python functions to functions of LLVM assembly."""

from __future__ import annotations

import ast
import inspect
import textwrap
from typing import Any, final

from ...subset.compiled_subset import FLAG, INTEGER, NUMBER, Group, Kind
from .expressions import UNKNOWN, Expressions, Functions
from .values import Value, by_reference

_SCALARS: dict[str, Kind] = {"int": INTEGER, "float": NUMBER, "bool": FLAG}


def translated(module: Functions, function: Any, name: str, kinds: tuple[Kind, ...]) -> tuple[list[str], Kind]:
    """Return the lines of a function for arguments of some kinds, and the kind of its result.

    Raises
    ------
    TypeError
        For statements that have no translation; the message names the line.
    """
    tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    assert isinstance(tree, ast.FunctionDef)
    return _Statements(module, function).function(tree, name, kinds)


@final
class _Untranslatable(TypeError):
    """A fault whose message names the line already."""


@final
class _Statements(Expressions):
    """Translates the statements of one function."""

    def __init__(self, module: Functions, function: Any) -> None:
        super().__init__(module, function)
        code = function.__code__
        self._source, self._first = code.co_filename, code.co_firstlineno
        self._result: Kind = Group(())
        self._loops: list[tuple[str, str]] = []

    def function(self, tree: ast.FunctionDef, name: str, kinds: tuple[Kind, ...]) -> tuple[list[str], Kind]:
        """See `translated`."""
        self._result = _result(tree.returns)
        stored = (node for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store))
        changed, arguments = {node.id for node in stored}, []
        for argument, kind in zip(tree.args.args, kinds, strict=True):
            if by_reference(kind):
                base = f"%{self.fresh()}"
                arguments.append(f"ptr noalias {base}")
                self.fixed[argument.arg] = Value(kind, (), base)
                continue
            words = tuple(f"%{self.fresh()}" for _ in kind.words)
            arguments += [f"{word} {name}" for word, name in zip(kind.words, words, strict=True)]
            if argument.arg in changed:
                self._assign_name(argument.arg, Value(kind, words))
            else:
                self.fixed[argument.arg] = Value(kind, words)
        self._body(tree.body)
        self.end("ret void" if not self._result.words else "unreachable")
        result = f"{{{', '.join(self._result.words)}}}" if self._result.words else "void"
        head = f"define internal {result} @{name}({', '.join(arguments)}) nounwind {{"
        return [head, *self.room, *self.lines, "}"], self._result

    def _body(self, statements: list[ast.stmt]) -> None:
        """Translate statements, up to one that ends the block."""
        for statement in statements:
            if not self.open:
                return
            try:
                self._statement(statement)
            except _Untranslatable:
                raise
            except (TypeError, KeyError) as fault:
                line = self._first + statement.lineno - 1
                raise _Untranslatable(f"{self._source}, line {line}: {fault}") from fault

    def _statement(self, node: ast.stmt) -> None:
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=targets)], value=ast.Tuple(elts=values)):
                for target, found in zip(targets, [self.value(value) for value in values], strict=True):
                    self._assign(target, found)
            case ast.Assign(targets=targets, value=value):
                found = self.value(value)
                for target in targets:
                    self._assign(target, found)
            case ast.AugAssign(target=target, op=op, value=value):
                self._change(target, op, value)
            case ast.If(test=test, body=body, orelse=other):
                self._if(test, body, other)
            case ast.While(test=test, body=body, orelse=[]):
                self._while(test, body)
            case ast.For(target=ast.Name(id=name), iter=ast.Call(func=ast.Name(id="range"), args=args), orelse=[]):
                self._range(name, [self.value(argument) for argument in args], node.body)
            case ast.For(target=target, iter=ast.Tuple(elts=elements), orelse=[]):
                self._each(target, elements, node.body)
            case ast.Break() | ast.Continue():
                self.jump(self._loops[-1][isinstance(node, ast.Break)])
            case ast.Return(value=None):
                self.end("ret void")
            case ast.Return(value=value) if value is not None:
                self._return(self.value(value))
            case ast.Expr(value=ast.Constant()):
                pass
            case ast.Expr(value=ast.Call() as call):
                self.value(call)
            case _:
                raise TypeError(f"{type(node).__name__} has no translation")

    def _assign(self, target: ast.expr, value: Value) -> None:
        match target:
            case ast.Name(id=name):
                self._assign_name(name, value)
            case ast.Tuple(elts=targets):
                count = len(value.kind.parts) if isinstance(value.kind, Group) else 0
                for part, found in zip(targets, [self.part(value, i) for i in range(count)], strict=True):
                    self._assign(part, found)
            case ast.Subscript(value=base, slice=index):
                self.store(value, self.place(self.value(base), self.index(index)))
            case ast.Attribute(value=base, attr=name):
                self.store(value, self.field(self.value(base), name))
            case _:
                raise TypeError("nothing can be assigned to this")

    def _assign_name(self, name: str, value: Value) -> None:
        """Keep a value in a variable, whose kind is that of the first value in the text; `_` keeps none."""
        if name == "_":
            return
        if value.base:
            if name in self.variables or self.fixed.get(name, value) != value:
                raise TypeError(f"{name} is another NamedTuple of arguments already")
            self.fixed[name] = value
            return
        if name not in self.variables:
            self.variables[name] = value.kind, [self.slot(word) for word in value.kind.words]
        kind, slots = self.variables[name]
        try:
            self.keep(self.converted(value, kind), slots)
        except TypeError as fault:
            raise TypeError(f"{name}: {fault}") from fault

    def _change(self, target: ast.expr, op: ast.operator, value: ast.expr) -> None:
        if not isinstance(target, ast.Subscript):
            self._assign(target, self.combined(op, self.value(target), self.value(value)))
            return
        place = self.place(self.value(target.value), self.index(target.slice))
        self.store(self.combined(op, self.load(place), self.value(value)), place)

    def _if(self, test: ast.expr, body: list[ast.stmt], other: list[ast.stmt]) -> None:
        held = self.known(test)
        if held is not UNKNOWN:
            self._body(body if held else other)
            return
        yes, no, end = self.fresh(), self.fresh(), self.fresh()
        self.condition(test, yes, no)
        for block, statements in ((yes, body), (no, other)):
            self._block(block)
            self._body(statements)
            self.jump(end)
        self._block(end)

    def _block(self, name: str) -> None:
        """Begin a block that is reached by jumps alone."""
        self.lines.append(f"{name}:")
        self.open = True

    def _while(self, test: ast.expr, body: list[ast.stmt]) -> None:
        again, inside, end = self.fresh(), self.fresh(), self.fresh()
        self.begin(again)
        self.condition(test, inside, end)
        self._loop(inside, body, again, end)
        self.jump(again)
        self._block(end)

    def _loop(self, block: str, body: list[ast.stmt], again: str, end: str) -> None:
        """Translate the body of a loop."""
        self._block(block)
        self._loops.append((again, end))
        self._body(body)
        self._loops.pop()

    def _range(self, name: str, given: list[Value], body: list[ast.stmt]) -> None:
        """Count as `range` does; what happens to the variable inside does not change the count."""
        first = given[0] if len(given) > 1 else Value(INTEGER, ("0",))
        last = given[min(1, len(given) - 1)]
        step = given[2].words[0] if len(given) > 2 else "1"
        if not step.lstrip("-").isdigit():
            raise TypeError("the step of a range is a constant")
        count = self.slot("i64")
        self.keep(first, [count])
        again, inside, following, end = (self.fresh() for _ in range(4))
        self.begin(again)
        now = self.set(f"load i64, ptr {count}")
        test = self.set(f"icmp {'sgt' if step.startswith('-') else 'slt'} i64 {now}, {last.words[0]}")
        self.branch(test, inside, end)
        self._block(inside)
        self._assign_name(name, Value(INTEGER, (now,)))
        self._loop(self._fall(), body, following, end)
        self.begin(following)
        self.lines.append(f"store i64 {self.set(f'add i64 {now}, {step}')}, ptr {count}")
        self.jump(again)
        self._block(end)

    def _fall(self) -> str:
        """End a block, and return the name of the one that follows it."""
        following = self.fresh()
        self.jump(following)
        return following

    def _each(self, target: ast.expr, elements: list[ast.expr], body: list[ast.stmt]) -> None:
        """Write the body of a loop over a tuple once for each element."""
        end = self.fresh()
        for element in elements:
            following = self.fresh()
            self._assign(target, self.value(element))
            self._loop(self._fall(), body, following, end)
            self.begin(following)
        self.begin(end)

    def _return(self, value: Value) -> None:
        value = self.converted(value, self._result)
        result, kind = "undef", f"{{{', '.join(value.kind.words)}}}"
        for place, (word, name) in enumerate(zip(value.kind.words, value.words, strict=True)):
            result = self.set(f"insertvalue {kind} {result}, {word} {name}, {place}")
        self.end(f"ret {kind} {result}")


def _result(annotation: ast.expr | None) -> Kind:
    """Return the annotated kind of the result of a function."""
    match annotation:
        case ast.Name(id=name) if name in _SCALARS:
            return _SCALARS[name]
        case ast.Constant(value=None):
            return Group(())
        case ast.Subscript(value=ast.Name(id="tuple"), slice=ast.Tuple(elts=elements)):
            return Group(tuple(_result(element) for element in elements))
    raise TypeError("a function returns nothing, a number, or a tuple of numbers, and says so")
