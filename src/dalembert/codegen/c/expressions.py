"""Expressions of the compiled subset as expressions of C.

A value is printed where it is used, and computed ahead of its statement where that could make a difference: in
statements that call something, reads of memory come first. What is known when the code is printed (lengths of arrays,
kernels that there are not) decides tests then, so that code for it is not printed.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from functools import lru_cache
from typing import Any, Protocol

from ...subset.compiled_subset import FLAG, INTEGER, NUMBER, Array, Fields, Group, Kind
from ..subset.definitions import called_in
from ..subset.target import Value, unified
from ..subset.translation import UNKNOWN, Translation
from .built_in import BUILT_IN, PURE
from .printing import Code, Constant, Fixed, Kernel, Pointer, bare, double, element_of

_OPERATORS = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.LShift: "<<", ast.RShift: ">>", ast.BitAnd: "&"
}  # fmt: skip
_TESTS = {ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
_WHOLE: dict[Any, Callable[[int, int], int]] = {
    ast.Add: lambda a, b: a + b, ast.Sub: lambda a, b: a - b, ast.Mult: lambda a, b: a * b,
    ast.LShift: lambda a, b: a << b, ast.RShift: lambda a, b: a >> b, ast.BitAnd: lambda a, b: a & b,
}  # fmt: skip
_DECIDED: dict[Any, Callable[[Any, Any], bool]] = {
    ast.Eq: lambda a, b: a == b, ast.NotEq: lambda a, b: a != b, ast.Lt: lambda a, b: a < b,
    ast.LtE: lambda a, b: a <= b, ast.Gt: lambda a, b: a > b, ast.GtE: lambda a, b: a >= b,
}  # fmt: skip
_LITERAL = re.compile(r"-?\d+(\.\d*)?(e[+-]?\d+)?")
_ATOM = re.compile(r"-?\w+(\.\w+|->\w+)*")

TYPES = {INTEGER: "int64_t", NUMBER: "double", FLAG: "bool"}
"""C types of numbers."""


class Nothing(str):
    """The place of an element of an array that has none: code that reads or writes it never runs."""


class Arguments(Protocol):
    """Where the arguments of the loop are."""

    def leaf(self, place: int) -> tuple[str, ...]:
        """Return the words of the argument whose first word has this place among all."""

    def address(self, table: str, word: str) -> str:
        """Return an address in a table of addresses, from the element there."""


class Functions(Protocol):
    """The other functions and the constants of a C source."""

    used: set[str]
    """Names of the functions of the prelude that the source calls."""
    functions: set[str]
    """Names of the functions so far."""
    fused: str
    """Name of what rounds a product and a sum once where the target can."""

    @property
    def arguments(self) -> Arguments:
        """Where the arguments of the loop are."""

    def array(self, array: Any) -> Value:
        """Return a constant array."""

    def call(self, function: Any, given: list[Value]) -> tuple[str, Kind, Value | None]:
        """Return the text of a call, the kind of its result, and the result where it is constant."""


@lru_cache(maxsize=1 << 12)
def literal_of(word: str) -> Any:
    """Return the number of a literal, `UNKNOWN` for other words."""
    if word in ("true", "false"):
        return word == "true"
    number = word.removeprefix("(").removesuffix(")")
    if number in ("INFINITY", "-INFINITY", "NAN"):
        return float(number)
    if _LITERAL.fullmatch(number) is None:
        return UNKNOWN
    return int(number) if number.lstrip("-").isdigit() else float(number)


def is_atom(word: str) -> bool:
    """Return whether a word is a name, a member or a literal."""
    return _ATOM.fullmatch(word) is not None or literal_of(word) is not UNKNOWN


class Expressions(Translation):
    """Translates the expressions of one function."""

    built_in = BUILT_IN
    module: Functions

    def __init__(self, module: Functions, function: Any) -> None:
        super().__init__(module, function)
        self.variables: dict[str, Value] = {}
        self.types: dict[str, str] = {}
        self.fragile = False
        self._count = 0

    # -- lines ------------------------------------------------------------------------------

    def fresh(self, kind: str) -> str:
        """Return the name of a new variable of a C type."""
        self._count += 1
        name = f"part_{self._count}"
        self.types[name] = kind
        return name

    def computed(self, word: str, kind: str) -> str:
        """Return the name of a value that is computed now."""
        if literal_of(word) is not UNKNOWN:
            return word
        name = self.fresh(kind)
        self.lines.append(f"{name} = {bare(word)};")
        return name

    def calls(self, node: ast.AST) -> bool:
        """Return whether code calls functions that may change memory."""
        return any(self.known(function) not in PURE for function in called_in(node))

    def truth(self, node: ast.expr) -> Value:
        """Return the flag of a test."""
        held = self.known(node)
        if held is not UNKNOWN:
            return self.literal(bool(held))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return self._not(self.truth(node.operand))
        if isinstance(node, ast.BoolOp):
            return self._joined(node)
        value = self.value(node)
        return value if value.kind == FLAG else self.compared(ast.NotEq(), value.kind, value, self._zero(value.kind))

    def _zero(self, kind: Kind) -> Value:
        return self.literal(0.0 if kind == NUMBER else 0)

    def _not(self, flag: Value) -> Value:
        held = literal_of(flag.words[0])
        return self.literal(not held) if held is not UNKNOWN else Value(FLAG, (f"!{flag.words[0]}",))

    def _joined(self, node: ast.BoolOp) -> Value:
        """Return the flag of tests of which the later ones may not be computed."""
        every = isinstance(node.op, ast.And)
        found: list[str] = []
        for number, operand in enumerate(node.values):
            with self.aside() as lines:
                value = self.truth(operand)
            (word,) = value.words
            if lines and number:
                name = self.fresh("bool")
                before = (" && " if every else " || ").join(found) or ("true" if every else "false")
                self.lines += [f"{name} = {before};", f"if ({'' if every else '!'}{name}) {{", *lines]
                self.lines += [f"{name} = {bare(word)};", "}"]
                found = [name]
                continue
            self.lines += lines
            held = literal_of(word)
            if held is UNKNOWN:
                found.append(word)
            elif held is not every:
                return self.literal(held)
        if not found:
            return self.literal(every)
        return Value(FLAG, (found[0] if len(found) == 1 else f"({(' && ' if every else ' || ').join(found)})",))

    # -- numbers ----------------------------------------------------------------------------

    def double(self, number: float) -> str:
        """See `Target.double`."""
        return double(number)

    def variable(self, name: str) -> Value:
        """See `Target.variable`."""
        return self.variables[name]

    def negated(self, value: Value) -> Value:
        """See `Translation.negated`."""
        held = literal_of(value.words[0])
        return self.literal(-held) if held is not UNKNOWN else Value(value.kind, (f"(-{value.words[0]})",))

    def arithmetic(self, op: ast.operator, kind: Kind, a: Value, b: Value) -> Value:
        """See `Translation.arithmetic`; of whole numbers, what is known is computed."""
        (x,), (y,) = a.words, b.words
        if kind == INTEGER:
            left, right = literal_of(x), literal_of(y)
            if left is not UNKNOWN and right is not UNKNOWN:
                return self.literal(_WHOLE[type(op)](left, right))
            if isinstance(op, ast.Mult) and 0 in (left, right):
                return self.literal(0)
            if (isinstance(op, ast.Add | ast.Sub) and right == 0) or (isinstance(op, ast.Mult) and right == 1):
                return a
            if (isinstance(op, ast.Add) and left == 0) or (isinstance(op, ast.Mult) and left == 1):
                return b
        return Value(kind, (f"({x} {_OPERATORS[type(op)]} {y})",))

    def divided(self, rest: bool, a: Value, b: Value) -> Value:
        """See `Translation.divided`."""
        left, right = (literal_of(value.words[0]) for value in (a, b))
        if left is not UNKNOWN and right is not UNKNOWN:
            return self.literal(left % right if rest else left // right)
        name = "rest_of" if rest else "quotient_of"
        self.module.used.add(name)
        return Value(INTEGER, (f"{name}({a.words[0]}, {b.words[0]})",))

    def compared(self, op: ast.cmpop, kind: Kind, a: Value, b: Value) -> Value:
        """See `Translation.compared`; what is known is decided."""
        (x,), (y,) = a.words, b.words
        left, right = (
            1 if isinstance(word, Pointer) and not isinstance(word, Code) else literal_of(word) for word in (x, y)
        )
        if left is not UNKNOWN and right is not UNKNOWN:
            return self.literal(_DECIDED[type(op)](left, right))
        return Value(FLAG, (f"({x} {_TESTS[type(op)]} {y})",))

    def both(self, a: Value, b: Value) -> Value:
        """See `Translation.both`."""
        return Value(FLAG, (f"({a.words[0]} && {b.words[0]})",))

    def replaced(self, op: ast.cmpop, kind: Kind, a: Value, b: Value) -> Value:
        """See `Translation.replaced`."""
        (x,), (y,) = a.words, b.words
        left, right = literal_of(x), literal_of(y)
        if left is not UNKNOWN and right is not UNKNOWN:
            return b if _DECIDED[type(op)](right, left) else a
        name = f"{'least' if isinstance(op, ast.Lt) else 'greatest'}{'' if kind == NUMBER else '_integer'}"
        self.module.used.add(name)
        return Value(kind, (f"{name}({bare(x)}, {bare(y)})",))

    def cast(self, value: Value, kind: Kind) -> Value:
        """See `Translation.cast`."""
        (word,) = value.words
        held = literal_of(word)
        if held is not UNKNOWN:
            return self.literal(float(held) if kind == NUMBER else int(held))
        return Value(kind, (f"({TYPES[kind]}){word}",))  # type: ignore[index]

    def chosen(self, test: ast.expr, yes: Callable[[], Value], no: Callable[[], Value]) -> Value:
        """See `Translation.chosen`."""
        flag = self.truth(test)
        held = literal_of(flag.words[0])
        if held is not UNKNOWN:
            return yes() if held else no()
        sides = []
        for make in (yes, no):
            with self.aside() as lines:
                sides.append((make(), lines))
        kind = unified(sides[0][0].kind, sides[1][0].kind)
        values = [self.converted(value, kind) for value, _ in sides]
        if [value.words for value in values] == [("true",), ("false",)]:
            return flag
        if not sides[0][1] and not sides[1][1] and len(kind.words) == 1:
            words = [value.words[0] for value in values]
            word = f"({flag.words[0]} ? {words[0]} : {words[1]})"
            return Value(kind, (Code(word) if any(isinstance(each, Code | Kernel) for each in words) else word,))
        kinds = kind.parts if isinstance(kind, Group) else (kind,)
        names = tuple(self.fresh(TYPES[one]) for one in kinds)  # type: ignore[index]
        self.lines.append(f"if ({bare(flag.words[0])}) {{")
        for value, (_, lines), following in zip(values, sides, ("} else {", "}"), strict=True):
            self.lines += lines
            self.lines += [f"{name} = {bare(word)};" for name, word in zip(names, value.words, strict=True)]
            self.lines.append(following)
        return Value(kind, names)

    # -- memory -----------------------------------------------------------------------------

    def place(self, array: Value, index: list[Value]) -> Value:
        """See `Translation.place`; the place of an element is its C expression."""
        kind = array.kind
        assert isinstance(kind, Array)
        data, *shape = array.words
        zero = offset = self.literal(0)
        for number, length in self.axes(array, index):
            if offset != zero:
                offset = self.arithmetic(ast.Mult(), INTEGER, offset, Value(INTEGER, (length,)))
            offset = number if offset == zero else self.arithmetic(ast.Add(), INTEGER, offset, number)
        left = len(shape) - len(index)
        if not left and "0" in shape:
            return Value(Array(kind.item, 0), (Nothing(),))
        word = element_of(data, offset.words[0])
        if left:
            word = (Fixed if isinstance(data, Constant | Fixed) else Pointer)(f"&{word}")
        return Value(Array(kind.item, left), (word, *shape[len(index) :]))

    def argument(self, kind: Kind, base: str, first: int) -> Value:
        """See `Target.argument`."""
        return Value(kind, self.module.arguments.leaf(first))

    def member(self, record: Value, number: int) -> str:
        """See `Target.member`."""
        assert isinstance(record.kind, Fields)
        return f"{record.words[0]}.{record.kind.names[number]}"

    def load(self, place: Value) -> Value:
        """See `Translation.load`."""
        assert isinstance(place.kind, Array)
        item, (word,) = place.kind.item, place.words
        if isinstance(word, Nothing):
            return self.literal(False) if item == FLAG else self._zero(item)
        if item.owned:
            return Value(item, (self.module.arguments.address(word.partition("[")[0], word),))
        return Value(item, (self.computed(word, TYPES[item]) if self.fragile else word,))

    def store(self, value: Value, place: Value) -> None:
        """See `Translation.store`."""
        assert isinstance(place.kind, Array)
        (word,) = self.converted(value, place.kind.item).words
        if not isinstance(place.words[0], Nothing):
            self.lines.append(f"{place.words[0]} = {bare(word)};")

    def called(self, function: Any, given: list[Value]) -> Value:
        """See `Translation.called`."""
        text, kind, constant = self.module.call(function, given)
        if constant is not None:
            return constant
        if not kind.words:
            if text:
                self.lines.append(f"{text};")
            return Value(kind, ())
        if isinstance(kind, Group):
            name = self.fresh(f"struct {text.split('(')[0]}_result")
            self.lines.append(f"{name} = {text};")
            return Value(kind, tuple(f"{name}.part_{number}" for number in range(len(kind.parts))))
        return Value(kind, (self.computed(text, TYPES[kind]),))  # type: ignore[index]
