"""Instructions of a kernel as lines of LLVM assembly, for a number of lanes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, final

from ...ir.calls import CALLS, SYMBOL, function_of
from ...ir.kernel import Assignment, Operand
from ...ir.tables import numbers_of, table_of
from ..rendering import render
from .target import constant, fma_name, integer, suffix, vector
from .vector_functions import lanewise

# Tables in assembly: the search for a piece, numbers of pieces in every lane, and the arrays of both.

_SEARCH, _ARRAY = re.compile(r"@table_piece(\d+)\("), re.compile(r"@table\.(\d+)\.(\d+|edges)\b")


def piece_lines(lanes: int, target: str, args: Sequence[str], key: float) -> list[str]:
    """Return lines that set ``%target`` to the number of the piece that an operand lies in."""
    edges = f"ptr @table.{int(key)}.edges, i64 {len(table_of(key).edges)}"
    return [f"%{target} = call {vector(lanes)} @table_piece{lanes}({vector(lanes)} {args[0]}, {edges})"]


def entry_lines(lanes: int, target: str, args: Sequence[str], key: float, row: float) -> list[str]:
    """Return lines that set ``%target`` to a number of a piece."""
    v, integers = vector(lanes), vector(lanes, "i64")
    lines = [
        f"%{target}.place = fptosi {v} {args[0]} to {integers}",
        f"%{target}.at = getelementptr double, ptr @table.{int(key)}.{int(row)}, {integers} %{target}.place",
    ]
    return [*lines, *_gathered(lanes, target, f"%{target}.at")]


def _gathered(lanes: int, target: str, at: str) -> list[str]:
    """Return lines that load a number in every lane, from addresses."""
    if lanes == 1:
        return [f"%{target} = load double, ptr {at}, align 8"]
    every = f"<{', '.join(['i1 true'] * lanes)}>"
    given = f"{vector(lanes, 'ptr')} {at}, i32 8, {vector(lanes, 'i1')} {every}, {vector(lanes)} undef"
    return [f"%{target} = call {vector(lanes)} @llvm.masked.gather.{suffix(lanes)}.v{lanes}p0({given})"]


def with_tables(text: str) -> str:
    """Return a module of assembly with what it uses of tables, and declarations of the functions that it calls."""
    names = list(dict.fromkeys(_ARRAY.findall(text)))
    text += "".join(f"\n{declaration}\n" for declaration in _declarations(text))
    if not names:
        return text
    searches = sorted({int(lanes) for lanes in _SEARCH.findall(text)})
    gathers = sorted({*searches, *map(int, re.findall(r"@llvm\.masked\.gather\.v\d+f64\.v(\d+)p0\(", text))} - {1})
    variables: dict[str, Any] = {
        "arrays": [_array(key, row) for key, row in names],
        "searches": [_search(lanes) for lanes in searches],
        "gathers": [{**_types(lanes), "lanes": lanes} for lanes in gathers],
    }
    return text + render("llvm/tables.ll.j2", variables)


def _declarations(text: str) -> list[str]:
    counts = {key: function_of(key).count for key in dict.fromkeys(_CALLED.findall(text))}
    return [f"declare double @{SYMBOL}{key}({', '.join(['double'] * count)})" for key, count in counts.items()]


def _array(key: str, row: str) -> dict[str, Any]:
    values = table_of(int(key)).edges if row == "edges" else numbers_of(int(key)).row(int(row))
    numbers = [constant(float(value), 1) for value in values]
    return {"name": f"table.{key}.{row}", "size": len(numbers), "numbers": numbers}


def _types(lanes: int) -> dict[str, str]:
    return {
        "vector": vector(lanes),
        "integers": vector(lanes, "i64"),
        "pointers": vector(lanes, "ptr"),
        "flags": vector(lanes, "i1"),
        "suffix": suffix(lanes),
    }


def _search(lanes: int) -> dict[str, Any]:
    return {
        **_types(lanes),
        "lanes": lanes,
        "zero": integer(0, lanes),
        "one": integer(1, lanes),
        "load": _gathered(lanes, "edge", "%at"),
    }


_CALLED = re.compile(rf"@{SYMBOL}(\d+)\(")

_ARITHMETIC = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}


@final
class LanePrinter:
    """Prints the body of one kernel for one number of lanes.

    Sines and cosines are polynomials, or, where `exact`, those of the C library, as in Python.
    """

    def __init__(self, lanes: int, *, exact: bool = False) -> None:
        self.lanes, self.exact = lanes, exact
        self.v = vector(lanes)
        self.suffix = suffix(lanes)
        self.flag = vector(lanes, "i1")
        self.fma = fma_name(lanes)
        self.lines: list[str] = []
        self._pairs: dict[Operand, tuple[str, str, int]] = {}
        self._ahead: list[Assignment] = []

    def operand(self, operand: Operand) -> str:
        """Return a value or an exact literal."""
        return f"%{operand}" if isinstance(operand, str) else constant(operand, self.lanes)

    def load(self, target: str, array: str, index: int) -> None:
        """Load element `index` of an argument."""
        offset = index * self.lanes
        self.lines.append(f"%{target}.at = getelementptr double, ptr %{array}, i64 {offset}")
        self.lines.append(f"%{target} = load {self.v}, ptr %{target}.at, align 8")

    def store(self, operand: Operand, index: int) -> None:
        """Store output `index`."""
        self.lines.append(f"%out.{index} = getelementptr double, ptr %out, i64 {index * self.lanes}")
        self.lines.append(f"store {self.v} {self.operand(operand)}, ptr %out.{index}, align 8")

    def line(self, line: Assignment) -> None:
        """Print one operation."""
        v, target, args = self.v, line.target, [self.operand(arg) for arg in line.args]
        typed = ", ".join(f"{v} {arg}" for arg in args)
        match line.op:
            case "add" | "sub" | "mul" | "div":
                self._set(target, f"{_ARITHMETIC[line.op]} {v} {args[0]}, {args[1]}")
            case "neg":
                self._set(target, f"fneg {v} {args[0]}")
            case "fma":
                self._set(target, f"call {v} @{self.fma}({typed})")
            case "sqrt" | "floor":
                self._set(target, f"call {v} @llvm.{line.op}.{self.suffix}({typed})")
            case "abs":
                self._set(target, f"call {v} @llvm.fabs.{self.suffix}({typed})")
            case "rough_log2" | "rough_exp2":
                self._set(target, f"call {v} @{line.op}({typed})")
            case "sin" | "cos" if not self.exact:
                self._sincos(line)
            case "min" | "max":
                self._choose(target, "olt" if line.op == "min" else "ogt", args[0], args[1], args[0], args[1])
            case "less" | "less_equal":
                one, none = (constant(x, self.lanes) for x in (1.0, 0.0))
                self._choose(target, "olt" if line.op == "less" else "ole", args[0], args[1], one, none)
            case "select":
                self._choose(target, "une", args[0], constant(0.0, self.lanes), args[1], args[2])
            case "sign":
                zero, one, minus = (constant(x, self.lanes) for x in (0.0, 1.0, -1.0))
                self._choose(f"{target}.up", "ogt", args[0], zero, one, zero)
                self._choose(target, "olt", args[0], zero, minus, f"%{target}.up")
            case "piece":
                self.lines += piece_lines(self.lanes, target, args, float(line.args[1]))
            case "entry":
                self.lines += entry_lines(self.lanes, target, args, float(line.args[1]), float(line.args[2]))
            case op if op in CALLS:
                self.lines += lanewise(f"{SYMBOL}{int(float(line.args[-1]))}", self.lanes, target, args[:-1])
            case _ if self.exact and self.lanes > 1 and len(args) == 1:
                self._set(target, f"call {v} @{line.op}_repeating({typed})")
            case _:
                self.lines += lanewise(line.op, self.lanes, target, args)

    def _set(self, target: str, expression: str) -> None:
        self.lines.append(f"%{target} = {expression}")

    def _choose(self, target: str, test: str, a: str, b: str, yes: str, no: str) -> None:
        self._set(f"{target}.test", f"fcmp {test} {self.v} {a}, {b}")
        self._set(target, f"select {self.flag} %{target}.test, {self.v} {yes}, {self.v} {no}")

    def body(self, lines: Sequence[Assignment]) -> None:
        """Print operations in their order."""
        self._ahead = list(reversed(lines))
        while self._ahead:
            self.line(self._ahead.pop())

    def _sincos(self, line: Assignment) -> None:
        """Compute sine and cosine of an argument together; on one lane also of others that are known by now."""
        if line.args[0] not in self._pairs:
            self._angles(line)
        pair, kind, slot = self._pairs[line.args[0]]
        half = f"extractvalue {{{kind}, {kind}}} %{pair}, {0 if line.op == 'sin' else 1}"
        if self.lanes > 1:
            self._set(line.target, half)
            return
        self._set(f"{line.target}.pack", half)
        self._set(line.target, f"extractelement {kind} %{line.target}.pack, i32 {slot}")

    def _angles(self, line: Assignment) -> None:
        """Call the function of sine and cosine for the argument of a line.

        On one lane it is that of a pack: beside others an argument costs nothing, and a pack chooses between sine and
        cosine without a branch.
        """
        pair = f"{line.target}.pair"
        if self.lanes > 1:
            self._pairs[line.args[0]] = pair, self.v, 0
            self._set(pair, f"call {{{self.v}, {self.v}}} @sincos{self.lanes}({self.v} {self.operand(line.args[0])})")
            return
        later = {other.target for other in self._ahead} | {line.target}
        wanted = [other.args[0] for other in reversed(self._ahead) if other.op in ("sin", "cos")]
        angles = list(dict.fromkeys(a for a in (line.args[0], *wanted) if a not in later and a not in self._pairs))[:4]
        lanes = 2 if len(angles) <= 2 else 4
        kind, pack = vector(lanes), "undef"
        for slot in range(lanes):
            angle = angles[min(slot, len(angles) - 1)]
            self._pairs.setdefault(angle, (pair, kind, slot))
            self._set(f"{pair}.{slot}", f"insertelement {kind} {pack}, double {self.operand(angle)}, i32 {slot}")
            pack = f"%{pair}.{slot}"
        self._set(pair, f"call {{{kind}, {kind}}} @sincos{lanes}({kind} {pack})")
