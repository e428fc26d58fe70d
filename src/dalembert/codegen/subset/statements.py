"""Translation of Python functions to functions of LLVM assembly."""

from __future__ import annotations

import ast
from typing import Any, final

from ...subset.compiled_subset import INTEGER, NESTED, Group, Kind
from .assembly import Expressions, Functions
from .definitions import definition_of, result_of
from .target import Value, by_reference
from .translation import UNKNOWN

_SHORT, _LONG = 85, 100
"""A function of fewer lines is copied to where it is called, and one of more lines never is. LLVM takes far longer for
one function than for its parts: this compiles loops in half of the time, and they are as fast."""


def translated(module: Functions, function: Any, name: str, kinds: tuple[Kind, ...]) -> tuple[list[str], Kind]:
    """Return the lines of a function for arguments of some kinds, and the kind of its result.

    Raises
    ------
    TypeError
        For statements that have no translation; the message names the line.
    """
    return _Statements(module, function).function(definition_of(function), name, kinds)


@final
class _Statements(Expressions):
    """Translates the statements of one function."""

    def __init__(self, module: Functions, function: Any) -> None:
        super().__init__(module, function)
        self._result: Kind = Group(())
        self._loops: list[tuple[str, str]] = []
        self._deepest = 0

    def function(self, tree: ast.FunctionDef, name: str, kinds: tuple[Kind, ...]) -> tuple[list[str], Kind]:
        """See `translated`."""
        self._result = result_of(tree.returns)
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
                self.assign_name(argument.arg, Value(kind, words))
            else:
                self.fixed[argument.arg] = Value(kind, words)
        self.body(tree.body)
        self.end("ret void" if not self._result.words else "unreachable")
        result = f"{{{', '.join(self._result.words)}}}" if self._result.words else "void"
        count = len(self.lines)
        copied = "alwaysinline " if count < _SHORT else "noinline " if count > _LONG else ""
        nested = f'"{NESTED}" ' if self._deepest > 1 else ""
        head = f"define internal {result} @{name}({', '.join(arguments)}) nounwind {copied}{nested}{{"
        return [head, *self.room, *self.lines, "}"], self._result

    def assign_name(self, name: str, value: Value) -> None:
        """See `Translation.assign_name`."""
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

    def branch_if(self, test: ast.expr, body: list[ast.stmt], other: list[ast.stmt]) -> None:
        """See `Translation.branch_if`."""
        held = self.known(test)
        if held is not UNKNOWN:
            self.body(body if held else other)
            return
        yes, no, end = self.fresh(), self.fresh(), self.fresh()
        self.condition(test, yes, no)
        for block, statements in ((yes, body), (no, other)):
            self._block(block)
            self.body(statements)
            self.jump(end)
        self._block(end)

    def _block(self, name: str) -> None:
        """Begin a block that is reached by jumps alone."""
        self.lines.append(f"{name}:")
        self.open = True

    def loop_while(self, test: ast.expr, body: list[ast.stmt]) -> None:
        """See `Translation.loop_while`."""
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
        self._deepest = max(self._deepest, len(self._loops))
        self.body(body)
        self._loops.pop()

    def loop_range(self, name: str, given: list[Value], body: list[ast.stmt]) -> None:
        """See `Translation.loop_range`."""
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
        self.assign_name(name, Value(INTEGER, (now,)))
        self._loop(self._fall(), body, following, end)
        self.begin(following)
        self.lines.append(f"store i64 {self.set(f'add i64 {now}, {step}')}, ptr {count}")
        self.jump(again)
        self._block(end)

    def loop_lanes(self, name: str, body: list[ast.stmt]) -> None:
        """See `Translation.loop_lanes`; of several lanes, LLVM makes vectors."""
        if self.module.lanes == 1:
            super().loop_lanes(name, body)
            return
        group, loop = self.module.side_by_side()
        with self.aside() as lines:
            self.loop_range(name, [self.literal(self.module.lanes)], body)
        last = max(place for place, line in enumerate(lines) if line.startswith("br label"))
        for place, line in enumerate(lines):
            if " load " in line or line.startswith("store ") or "call " in line:
                lines[place] = f"{line}, !llvm.access.group !{group}"
        lines[last] += f", !llvm.loop !{loop}"
        self.lines += lines

    def _fall(self) -> str:
        """End a block, and return the name of the one that follows it."""
        following = self.fresh()
        self.jump(following)
        return following

    def loop_each(self, target: ast.expr, elements: list[ast.expr], body: list[ast.stmt]) -> None:
        """See `Translation.loop_each`."""
        end = self.fresh()
        for element in elements:
            following = self.fresh()
            self.assign(target, self.value(element))
            self._loop(self._fall(), body, following, end)
            self.begin(following)
        self.begin(end)

    def leave(self, loop: bool) -> None:
        """See `Translation.leave`."""
        self.jump(self._loops[-1][loop])

    def give(self, value: Value | None) -> None:
        """See `Translation.give`."""
        if value is None:
            self.end("ret void")
            return
        value = self.converted(value, self._result)
        result, kind = "undef", f"{{{', '.join(value.kind.words)}}}"
        for place, (word, name) in enumerate(zip(value.kind.words, value.words, strict=True)):
            result = self.set(f"insertvalue {kind} {result}, {word} {name}, {place}")
        self.end(f"ret {kind} {result}")
