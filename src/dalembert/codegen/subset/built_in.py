"""Functions of the compiled subset that are lines of assembly themselves."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ...subset import compiled_subset as code
from ...subset.compiled_subset import FLAG, INT_VECTOR, INTEGER, MATRIX, NUMBER, VECTOR, Array, Group, Kind
from .target import Value

if TYPE_CHECKING:
    from .assembly import Expressions


def _word(value: Value, kind: Kind) -> str:
    if value.kind != kind:
        raise TypeError(f"{value.kind} is not {kind}")
    return value.words[0]


def _abs(lines: Expressions, value: Value) -> Value:
    if value.kind == INTEGER:
        return Value(INTEGER, (lines.set(f"call i64 @llvm.abs.i64(i64 {value.words[0]}, i1 false)"),))
    return Value(NUMBER, (lines.set(f"call double @llvm.fabs.f64(double {_word(value, NUMBER)})"),))


def _int(lines: Expressions, value: Value) -> Value:
    return Value(INTEGER, (lines.set(f"fptosi double {_word(value, NUMBER)} to i64"),))


def _is_finite(lines: Expressions, value: Value) -> Value:
    (size,) = _abs(lines, value).words
    return Value(FLAG, (lines.set(f"fcmp olt double {size}, {lines.literal(math.inf).words[0]}"),))


def _is_nan(lines: Expressions, value: Value) -> Value:
    word = _word(value, NUMBER)
    return Value(FLAG, (lines.set(f"fcmp uno double {word}, {word}"),))


def _library(name: str) -> Callable[..., Value]:
    """Return the translation of a function of doubles that LLVM or the C library has."""

    def call(lines: Expressions, value: Value) -> Value:
        (word,) = lines.converted(value, NUMBER).words
        return Value(NUMBER, (lines.set(f"call double @{name}(double {word})"),))

    return call


def _fma(lines: Expressions, a: Value, b: Value, c: Value) -> Value:
    words = ", ".join(f"double {lines.converted(value, NUMBER).words[0]}" for value in (a, b, c))
    return Value(NUMBER, (lines.set(f"call double @{lines.module.fused}({words})"),))


def _flat(lines: Expressions, matrix: Value) -> Value:
    if matrix.kind != MATRIX:
        raise TypeError("only matrices of doubles can be made a column")
    data, rows, columns = matrix.words
    count, size = lines.module.lanes, lines.set(f"mul i64 {rows}, {columns}")
    return Value(MATRIX, (data, size if count == 1 else lines.set(f"udiv i64 {size}, {count}"), str(count)))


def _row(lines: Expressions, matrix: Value, number: Value) -> Value:
    if not isinstance(matrix.kind, Array) or matrix.kind.dimensions != 2 or matrix.kind.item == FLAG:
        raise TypeError("rows are those of matrices of doubles or integers")
    place = lines.place(matrix, [number])
    return Value(INTEGER, (lines.set(f"ptrtoint ptr {place.words[0]} to i64"),))


def _call_code(lines: Expressions, *given: Value) -> Value:
    function, *addresses = (_word(value, INTEGER) for value in given)
    pointer = lines.set(f"inttoptr i64 {function} to ptr")
    lines.lines.append(f"call void {pointer}({', '.join(f'i64 {word}' for word in addresses)})")
    return Value(Group(()), ())


def _call_test(lines: Expressions, *given: Value) -> Value:
    function, *addresses = (_word(value, INTEGER) for value in given)
    pointer = lines.set(f"inttoptr i64 {function} to ptr")
    return Value(INTEGER, (lines.set(f"call i64 {pointer}({', '.join(f'i64 {word}' for word in addresses)})"),))


def _call_c(lines: Expressions, address: Value, argument: Value) -> Value:
    pointer = lines.set(f"inttoptr i64 {_word(address, INTEGER)} to ptr")
    return Value(INTEGER, (lines.set(f"call i64 {pointer}(i64 {_word(argument, INTEGER)})"),))


def _load(lines: Expressions, address: Value, index: Value) -> Value:
    pointer = lines.set(f"inttoptr i64 {_word(address, INTEGER)} to ptr")
    return lines.load(lines.place(Value(VECTOR, (pointer, "0")), [index]))


def _prefetch(lines: Expressions, address: Value, index: Value) -> Value:
    pointer = lines.set(f"inttoptr i64 {_word(address, INTEGER)} to ptr")
    place = lines.set(f"getelementptr double, ptr {pointer}, i64 {_word(index, INTEGER)}")
    lines.lines.append(f"call void @llvm.prefetch.p0(ptr {place}, i32 0, i32 3, i32 1)")
    return Value(Group(()), ())


def _lowest(lines: Expressions, bits: Value) -> Value:
    return Value(INTEGER, (lines.set(f"call i64 @llvm.cttz.i64(i64 {_word(bits, INTEGER)}, i1 true)"),))


def _take(lines: Expressions, array: Value, amount: Value) -> Value:
    added = f"atomicrmw add ptr {_word(array, INT_VECTOR)}, i64 {_word(amount, INTEGER)} acq_rel"
    return Value(INTEGER, (lines.set(added),))


BUILT_IN: dict[Any, Callable[..., Value]] = {
    abs: _abs,
    int: _int,
    float: lambda lines, value: lines.converted(value, NUMBER),
    math.isfinite: _is_finite,
    math.isnan: _is_nan,
    code.sqrt: _library("llvm.sqrt.f64"),
    code.exp: _library("exp"),
    code.log: _library("log"),
    code.square: lambda lines, value: lines.combined(ast.Mult(), value, value),
    code.row: _row,
    code.call_c: _call_c,
    code.call_code: _call_code,
    code.call_test: _call_test,
    code.prefetch: _prefetch,
    code.element: _load,
    code.flat: _flat,
    code.fma: _fma,
    code.lane_count: lambda lines: lines.literal(lines.module.lanes),
    code.lowest: _lowest,
    code.take: _take,
}
"""Translation of each function, by the function that Python code calls."""
