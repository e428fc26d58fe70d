"""Lines of LLVM assembly for expressions of the compiled subset."""

from __future__ import annotations

import ast
import struct
from collections.abc import Callable
from typing import Any, Protocol

from ...subset.compiled_subset import FLAG, INTEGER, NUMBER, Array, Kind
from .built_in import BUILT_IN
from .target import Value, unified
from .translation import UNKNOWN, Translation

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

    lanes: int
    """Cases side by side."""

    def side_by_side(self) -> tuple[int, int]:
        """Return the numbers of the metadata of accesses, and of the loop, that takes its rounds at once."""


def rounded(number: float) -> str:
    """Return an exact literal of a double."""
    return f"0x{struct.unpack('>Q', struct.pack('>d', number))[0]:016X}"


class Expressions(Translation):
    """Translates the expressions of one function, to lines that set a name each."""

    built_in = BUILT_IN
    module: Functions

    def __init__(self, module: Functions, function: Any) -> None:
        super().__init__(module, function)
        self.variables: dict[str, tuple[Kind, list[str]]] = {}
        self.room: list[str] = []
        self.open = True
        self._count = 0

    # -- lines and blocks -------------------------------------------------------------------

    @property
    def reachable(self) -> bool:
        """See `Translation.reachable`."""
        return self.open

    def fresh(self) -> str:
        """Return an unused name."""
        self._count += 1
        return f"v{self._count}"

    def set(self, expression: str) -> str:
        """Give an expression a name."""
        name = f"%{self.fresh()}"
        self.lines.append(f"{name} = {expression}")
        return name

    def slot(self, word: str) -> str:
        """Return the address of memory for one word."""
        name = f"%{self.fresh()}"
        self.room.append(f"{name} = alloca {word}")
        return name

    def begin(self, block: str) -> None:
        """Continue in a block; the lines before fall through into it."""
        self.jump(block)
        self.lines.append(f"{block}:")
        self.open = True

    def jump(self, block: str) -> None:
        """End a block, if it is not ended yet."""
        self.end(f"br label %{block}")

    def branch(self, flag: str, yes: str, no: str) -> None:
        """End a block where a flag decides what follows."""
        self.end(f"br i1 {flag}, label %{yes}, label %{no}")

    def end(self, line: str) -> None:
        """End a block, if it is not ended yet."""
        if self.open:
            self.lines.append(line)
        self.open = False

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
            self.branch(self._truth(self.value(node)), yes, no)

    def keep(self, value: Value, slots: list[str]) -> None:
        """Write the words of a value to memory."""
        for kind, word, slot in zip(value.kind.words, value.words, slots, strict=True):
            self.lines.append(f"store {kind} {word}, ptr {slot}")

    def _truth(self, value: Value) -> str:
        """Return the flag that says whether a number is not zero."""
        (word,) = value.words
        if value.kind == FLAG:
            return word
        return self.set(
            f"icmp ne i64 {word}, 0" if value.kind == INTEGER else f"fcmp une double {word}, {rounded(0.0)}"
        )

    # -- numbers ----------------------------------------------------------------------------

    def double(self, number: float) -> str:
        """See `Target.double`."""
        return rounded(number)

    def variable(self, name: str) -> Value:
        """See `Target.variable`."""
        kind, slots = self.variables[name]
        pairs = zip(kind.words, slots, strict=True)
        return Value(kind, tuple(self.set(f"load {word}, ptr {slot}") for word, slot in pairs))

    def negated(self, value: Value) -> Value:
        """See `Translation.negated`."""
        (word,) = value.words
        minus = f"sub i64 0, {word}" if value.kind == INTEGER else f"fneg double {word}"
        return Value(value.kind, (self.set(minus),))

    def arithmetic(self, op: ast.operator, kind: Kind, a: Value, b: Value) -> Value:
        """See `Translation.arithmetic`."""
        (x,), (y,) = a.words, b.words
        if kind == NUMBER:
            return Value(kind, (self.set(f"{_DOUBLE[type(op)]} double {x}, {y}"),))
        return Value(kind, (self.set(f"{_WHOLE[type(op)]} i64 {x}, {y}"),))

    def divided(self, rest: bool, a: Value, b: Value) -> Value:
        """See `Translation.divided`."""
        (x,), (y,) = a.words, b.words
        y = self.set(f"call i64 @llvm.smax.i64(i64 {y}, i64 1)")
        quotient, left = self.set(f"sdiv i64 {x}, {y}"), self.set(f"srem i64 {x}, {y}")
        under = self.set(f"icmp slt i64 {left}, 0")
        if rest:
            chosen = self.set(f"select i1 {under}, i64 {self.set(f'add i64 {left}, {y}')}, i64 {left}")
            return Value(INTEGER, (chosen,))
        return Value(INTEGER, (self.set(f"sub i64 {quotient}, {self.set(f'zext i1 {under} to i64')}"),))

    def compared(self, op: ast.cmpop, kind: Kind, a: Value, b: Value) -> Value:
        """See `Translation.compared`."""
        whole, double = _TESTS[type(op)]
        test = f"fcmp {double} double" if kind == NUMBER else f"icmp {whole} {kind.words[0]}"
        return Value(FLAG, (self.set(f"{test} {a.words[0]}, {b.words[0]}"),))

    def both(self, a: Value, b: Value) -> Value:
        """See `Translation.both`."""
        return Value(FLAG, (self.set(f"and i1 {a.words[0]}, {b.words[0]}"),))

    def replaced(self, op: ast.cmpop, kind: Kind, a: Value, b: Value) -> Value:
        """See `Translation.replaced`."""
        whole, double = _TESTS[type(op)]
        (x,), (y,) = a.words, b.words
        test = f"fcmp {double} double" if kind == NUMBER else f"icmp {whole} i64"
        flag = self.set(f"{test} {y}, {x}")
        return Value(kind, (self.set(f"select i1 {flag}, {kind.words[0]} {y}, {kind.words[0]} {x}"),))

    def cast(self, value: Value, kind: Kind) -> Value:
        """See `Translation.cast`."""
        (word,) = value.words
        if kind == INTEGER:
            return Value(kind, (self.set(f"zext i1 {word} to i64"),))
        if value.kind == INTEGER and word.lstrip("-").isdigit():
            return self.literal(float(word))
        how = "uitofp i1" if value.kind == FLAG else "sitofp i64"
        return Value(kind, (self.set(f"{how} {word} to double"),))

    def chosen(self, test: ast.expr, yes: Callable[[], Value], no: Callable[[], Value]) -> Value:
        """See `Translation.chosen`."""
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

    # -- memory -----------------------------------------------------------------------------

    def place(self, array: Value, index: list[Value]) -> Value:
        """See `Translation.place`; the place of an element is its address."""
        kind = array.kind
        assert isinstance(kind, Array)
        data, *shape = array.words
        offset = "0"
        for number, length in self.axes(array, index):
            before = offset if offset == "0" else self.set(f"mul i64 {offset}, {length}")
            (word,) = number.words
            offset = word if before == "0" else before if word == "0" else self.set(f"add i64 {before}, {word}")
        data = self.set(f"getelementptr {kind.item.stored}, ptr {data}, i64 {offset}")
        return Value(Array(kind.item, len(shape) - len(index)), (data, *shape[len(index) :]))

    def argument(self, kind: Kind, base: str, first: int) -> Value:
        """See `Target.argument`; its words never change."""
        words = []
        for place, word in enumerate(kind.words, first):
            address = self.set(f"getelementptr i64, ptr {base}, i64 {place}")
            stored = "i64" if word == "i1" else word
            read = self.set(f"load {stored}, ptr {address}, !invariant.load !0")
            words.append(self.set(f"trunc i64 {read} to i1") if word == "i1" else read)
        return Value(kind, tuple(words))

    def member(self, record: Value, number: int) -> str:
        """See `Target.member`."""
        return self.set(f"getelementptr i64, ptr {record.words[0]}, i64 {number}")

    def load(self, place: Value) -> Value:
        """See `Translation.load`."""
        assert isinstance(place.kind, Array)
        item = place.kind.item
        word = self.set(f"load {item.stored}, ptr {place.words[0]}")
        return Value(item, (self.set(f"icmp ne i8 {word}, 0") if item == FLAG else word,))

    def store(self, value: Value, place: Value) -> None:
        """See `Translation.store`."""
        assert isinstance(place.kind, Array)
        item = place.kind.item
        (word,) = self.converted(value, item).words
        word = self.set(f"zext i1 {word} to i8") if item == FLAG else word
        self.lines.append(f"store {item.stored} {word}, ptr {place.words[0]}")

    def called(self, function: Any, given: list[Value]) -> Value:
        """See `Translation.called`."""
        name, kind = self.module.function(function, tuple(value.kind for value in given))
        words = ", ".join(
            f"{k} {w}"
            for v in given
            for k, w in ([("ptr", self._address(v))] if v.base else zip(v.kind.words, v.words, strict=True))
        )
        if not kind.words:
            self.lines.append(f"call void @{name}({words})")
            return Value(kind, ())
        several = f"{{{', '.join(kind.words)}}}"
        result = self.set(f"call {several} @{name}({words})")
        found = [self.set(f"extractvalue {several} {result}, {place}") for place in range(len(kind.words))]
        return Value(kind, tuple(found))

    def _address(self, group: Value) -> str:
        """Return the address of the words of a NamedTuple of arguments."""
        return self.set(f"getelementptr i64, ptr {group.base}, i64 {group.first}") if group.first else group.base
