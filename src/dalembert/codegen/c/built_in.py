"""Functions of the compiled subset that are expressions or calls of C."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ...subset import compiled_subset as code
from ...subset.compiled_subset import FLAG, INTEGER, MATRIX, NUMBER, Array, Group
from ..subset.target import Value
from .printing import Loop, bare, element_of

if TYPE_CHECKING:
    from .expressions import Expressions


def _abs(lines: Expressions, value: Value) -> Value:
    if value.kind == NUMBER:
        return Value(NUMBER, (f"fabs({value.words[0]})",))
    lines.module.used.add("size_of_integer")
    return Value(INTEGER, (f"size_of_integer({value.words[0]})",))


def _of_double(text: str, kind: Any = NUMBER) -> Callable[..., Value]:
    """Return the translation of a function of one double."""

    def call(lines: Expressions, value: Value) -> Value:
        (word,) = lines.converted(value, NUMBER).words
        return Value(kind, (text.format(bare(word)),))

    return call


def _fma(lines: Expressions, a: Value, b: Value, c: Value) -> Value:
    words = ", ".join(lines.converted(value, NUMBER).words[0] for value in (a, b, c))
    return Value(NUMBER, (f"{lines.module.fused}({words})",))


def _square(lines: Expressions, value: Value) -> Value:
    (word,) = value.words
    held = Value(value.kind, (lines.computed(word, "double" if value.kind == NUMBER else "int64_t"),))
    return lines.combined(ast.Mult(), held, held)


def _flat(lines: Expressions, matrix: Value) -> Value:
    if matrix.kind != MATRIX:
        raise TypeError("only matrices of doubles can be made a column")
    data, rows, columns = matrix.words
    size = lines.combined(ast.Mult(), Value(INTEGER, (rows,)), Value(INTEGER, (columns,)))
    return Value(MATRIX, (data, size.words[0], "1"))


def _row(lines: Expressions, matrix: Value, number: Value) -> Value:
    if not isinstance(matrix.kind, Array) or matrix.kind.dimensions != 2 or matrix.kind.item == FLAG:
        raise TypeError("rows are those of matrices of doubles or integers")
    return Value(INTEGER, (lines.place(matrix, [number]).words[0],))


def _call_code(lines: Expressions, function: Value, *given: Value) -> Value:
    addresses = ", ".join("NULL" if value.words[0] == "0" else value.words[0] for value in given)
    if function.words[0] != "0":  # what is not there is never called
        lines.lines.append(f"{function.words[0]}({addresses});")
    return Value(Group(()), ())


def _call_test(lines: Expressions, function: Value, *given: Value) -> Value:
    (word,) = function.words
    if word == "0":
        return lines.literal(0)
    # loops take the arguments that they were made for, tests an address and two numbers
    numbers = "run" if isinstance(word, Loop) else ", ".join(bare(value.words[0]) for value in given[:3])
    return Value(INTEGER, (lines.computed(f"{word}({numbers})", "int64_t"),))


def _take(lines: Expressions, array: Value, amount: Value) -> Value:
    (word,) = lines.place(array, [lines.literal(0)]).words
    before = lines.computed(word, "int64_t")
    lines.lines.append(f"{word} = {before} + {bare(amount.words[0])};")
    return Value(INTEGER, (before,))


def _element(lines: Expressions, address: Value, index: Value) -> Value:
    word = element_of(address.words[0], index.words[0])
    return Value(NUMBER, (lines.computed(word, "double") if lines.fragile else word,))


def _nothing(lines: Expressions, *given: Value) -> Value:
    return Value(Group(()), ())


def _lowest(lines: Expressions, bits: Value) -> Value:
    lines.module.used.add("lowest_bit")
    return Value(INTEGER, (f"lowest_bit({bits.words[0]})",))


BUILT_IN: dict[Any, Callable[..., Value]] = {
    abs: _abs,
    int: _of_double("(int64_t)({})", INTEGER),
    float: lambda lines, value: lines.converted(value, NUMBER),
    math.isfinite: _of_double("isfinite({})", FLAG),
    math.isnan: _of_double("isnan({})", FLAG),
    code.sqrt: _of_double("sqrt({})"),
    code.exp: _of_double("exp({})"),
    code.log: _of_double("log({})"),
    code.square: _square,
    code.row: _row,
    code.call_code: _call_code,
    code.call_test: _call_test,
    code.take: _take,
    code.prefetch: _nothing,
    code.element: _element,
    code.flat: _flat,
    code.fma: _fma,
    code.lane_count: lambda lines: lines.literal(1),
    code.lowest: _lowest,
}
"""Translation of each function, by the function that Python code calls."""

PURE = frozenset({*BUILT_IN, min, max, range}) - {code.call_code, code.call_test, code.take}
"""Functions that change no memory."""
