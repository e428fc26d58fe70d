"""Definitions for modules of LLVM assembly: elementary functions, tables, and declarations of compiled functions."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from ...ir.calls import SYMBOL, function_of
from ...ir.kernel import Assignment
from ...ir.tables import numbers_of, table_of
from ..elementary import ELEMENTARY, formula_of
from ..rendering import render
from .lane_printer import LanePrinter, gathered
from .target import bits, constant, integer, is_fused, suffix, vector
from .vector_functions import LIBRARY, ROUNDING, lanewise

_SEARCH, _ARRAY = re.compile(r"@table_piece(\d+)\("), re.compile(r"@table\.(\d+)\.(\d+|edges)\b")
_CALLED = re.compile(rf"@{SYMBOL}(\d+)\(")


def with_definitions(text: str) -> str:
    """Return a module of assembly with the elementary functions and tables that it uses, and compiled ones declared."""
    names = list(dict.fromkeys(_ARRAY.findall(text)))
    text += _elementary_functions(text) + "".join(f"\n{declaration}\n" for declaration in _declarations(text))
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
        "load": gathered(lanes, "edge", "%at"),
    }


# Elementary functions.

_OF_LANES = re.compile(rf"@({'|'.join(ELEMENTARY)})\.of(\d+)\(")
_EXPONENT, _EXPONENT_OF_ONE, _FRACTION = 52, 0x3FF0000000000000, 0x000FFFFFFFFFFFFF
_ROOT_OF_HALF = 0x3FE6A09E667F3BCD
_OF_INTEGER = 0x4330000000000000
"""Bits of 2^52, whose low bits hold a whole number that is added to it."""
_SIGN = -(2**63)


def _elementary_functions(text: str) -> str:
    """Return the definitions of the elementary functions that a module of assembly calls."""
    called = sorted(set(_OF_LANES.findall(text)))
    if not called:
        return ""
    return render("llvm/elementary.ll.j2", {"functions": [_function(name, int(lanes)) for name, lanes in called]})


def _function(name: str, lanes: int) -> dict[str, Any]:
    """Return the variables of a function for the template."""
    v, arguments, printer = vector(lanes), ("x", "y")[: LIBRARY[name]], _Printer(lanes)
    body, made = formula_of(name, arguments, fused=is_fused())
    for line in body:
        printer.line(line)
    library = [] if made.usual is None else lanewise(name, lanes, "of_library", [f"%{x}" for x in arguments])
    return {
        "name": f"{name}.of{lanes}",
        "vector": v,
        "flags": vector(lanes, "i1"),
        "bits": bits(lanes),
        "arguments": ", ".join(f"{v} %{x}" for x in arguments),
        "lines": printer.lines,
        "value": printer.operand(made.value),
        "usual": "" if made.usual is None else printer.operand(made.usual),
        "library": library,
    }


class _Printer:
    """Prints operations on lanes: those on the bits of numbers, too, and comparisons as flags."""

    def __init__(self, lanes: int) -> None:
        self._printer, self._lanes = LanePrinter(lanes), lanes
        self._v, self._i, self._flags = vector(lanes), vector(lanes, "i64"), vector(lanes, "i1")
        self.lines, self.operand = self._printer.lines, self._printer.operand
        self._on_bits: dict[str, Callable[..., None]] = {
            "round": self._round,
            "scale": self._scale,
            "exponent": self._exponent,
            "significand": self._significand,
            "copysign": self._copysign,
            "less": self._less,
            "less_equal": self._less_equal,
            "both": self._both,
            "select": self._select,
        }

    def line(self, line: Assignment) -> None:
        """Print one operation."""
        if line.op in self._on_bits:
            self._on_bits[line.op](line.target, *map(self.operand, line.args))
        else:
            self._printer.line(line)

    def _set(self, target: str, operation: str, *operands: str) -> str:
        """Print an instruction on numbers, or on their bits where its name is one of those; return its value."""
        kind = self._v if operation.startswith("f") else self._i
        self.lines.append(f"%{target} = {operation} {kind} {', '.join(operands)}")
        return f"%{target}"

    def _bits(self, target: str, x: str) -> str:
        self.lines.append(f"%{target} = bitcast {self._v} {x} to {self._i}")
        return f"%{target}"

    def _number(self, target: str, x: str) -> str:
        self.lines.append(f"%{target} = bitcast {self._i} {x} to {self._v}")
        return f"%{target}"

    def _round(self, target: str, x: str) -> None:
        """Print the nearest whole number; below 2^51."""
        far = constant(ROUNDING, self._lanes)
        self._set(target, "fsub", self._set(f"{target}.far", "fadd", x, far), far)

    def _scale(self, target: str, x: str, k: str) -> None:
        """Print x 2^k for a whole number within 1022."""
        far = self._bits(f"{target}.bits", self._set(f"{target}.far", "fadd", k, constant(ROUNDING, self._lanes)))
        exponent = self._set(f"{target}.exponent", "shl", far, integer(_EXPONENT, self._lanes))
        power = self._set(f"{target}.bits_of_power", "add", exponent, integer(_EXPONENT_OF_ONE, self._lanes))
        self._set(target, "fmul", x, self._number(f"{target}.power", power))

    def _above_root(self, target: str, x: str) -> str:
        """Return the bits of a number, shifted so that the exponent grows at the root of 1/2."""
        shift = integer(_EXPONENT_OF_ONE - _ROOT_OF_HALF, self._lanes)
        return self._set(f"{target}.shifted", "add", self._bits(f"{target}.bits", x), shift)

    def _exponent(self, target: str, x: str) -> None:
        """Print the k with which x / 2^k is between the roots of 1/2 and 2."""
        high = self._set(f"{target}.high", "lshr", self._above_root(target, x), integer(_EXPONENT, self._lanes))
        whole = self._set(f"{target}.whole", "or", high, integer(_OF_INTEGER, self._lanes))
        self._set(target, "fsub", self._number(f"{target}.far", whole), constant(2.0**52 + 1023.0, self._lanes))

    def _significand(self, target: str, x: str) -> None:
        """Print x / 2^k with that k."""
        low = self._set(f"{target}.low", "and", self._above_root(target, x), integer(_FRACTION, self._lanes))
        self._number(target, self._set(f"{target}.near", "add", low, integer(_ROOT_OF_HALF, self._lanes)))

    def _copysign(self, target: str, x: str, y: str) -> None:
        """Print the size of x with the sign of y."""
        size = self._set(f"{target}.size", "and", self._bits(f"{target}.x", x), integer(~_SIGN, self._lanes))
        sign = self._set(f"{target}.sign", "and", self._bits(f"{target}.y", y), integer(_SIGN, self._lanes))
        self._number(target, self._set(f"{target}.both", "or", size, sign))

    def _less(self, target: str, x: str, y: str) -> None:
        self.lines.append(f"%{target} = fcmp olt {self._v} {x}, {y}")

    def _less_equal(self, target: str, x: str, y: str) -> None:
        self.lines.append(f"%{target} = fcmp ole {self._v} {x}, {y}")

    def _both(self, target: str, x: str, y: str) -> None:
        self.lines.append(f"%{target} = and {self._flags} {x}, {y}")

    def _select(self, target: str, flag: str, x: str, y: str) -> None:
        self.lines.append(f"%{target} = select {self._flags} {flag}, {self._v} {x}, {self._v} {y}")
