"""Elementary functions in C, as the default backend computes them, for the sources that call them."""

from __future__ import annotations

import math
import re
from typing import Any

from ...ir.kernel import Operand
from ..elementary import ELEMENTARY, formula_of
from ..llvm.vector_functions import LIBRARY, ROUNDING
from ..printers import C
from .printing import double

NAMES = {name: f"{name}_of" for name in ELEMENTARY}
"""Names of the functions in C."""

_CALLED = re.compile(rf"\b({'|'.join(ELEMENTARY)})_of\(")
_FLAGS = {"less": "{} < {}", "less_equal": "{} <= {}", "both": "{} && {}"}
_VALUES = {
    "select": "{} ? {} : {}",
    "round": f"({{}} + {ROUNDING!r}) - {ROUNDING!r}",
    "scale": "scaled({}, {})",
    "exponent": "exponent_of({})",
    "significand": "significand_of({})",
    "copysign": "copysign({}, {})",
}
_HELPERS = ("scaled", "exponent_of", "significand_of")


def elementary_variables(text: str) -> dict[str, Any] | None:
    """Return the variables of ``c/elementary.c.j2`` for a text of kernels; None where it calls no such function."""
    called = sorted(set(_CALLED.findall(text)))
    if not called:
        return None
    functions = [_function(name) for name in called]
    lines = "\n".join(line for function in functions for line in function["lines"])
    return {
        "functions": functions,
        "used": [name for name in _HELPERS if f"{name}(" in lines],
        "rounding": double(ROUNDING),
        "far": double(2.0**52 + 1023.0),
    }


def _function(name: str) -> dict[str, Any]:
    """Return the variables of a function."""
    given = ("x", "y")[: LIBRARY[name]]
    body, made = formula_of(name, given, fused=True)
    lines = []
    for line in body:
        args = [_operand(arg) for arg in line.args]
        if line.op in _FLAGS:
            lines.append(f"const bool {line.target} = {_FLAGS[line.op].format(*args)};")
        else:
            value = _VALUES[line.op].format(*args) if line.op in _VALUES else C.expression(line.op, *args)
            lines.append(f"const double {line.target} = {value};")
    value, arguments = _operand(made.value), ", ".join(given)
    return {
        "name": NAMES[name],
        "library": name,
        "arguments": arguments,
        "parameters": ", ".join(f"double {x}" for x in given),
        "lines": lines,
        "value": value if made.usual is None else f"{_operand(made.usual)} ? {value} : {name}({arguments})",
    }


def _operand(operand: Operand) -> str:
    return "NAN" if not isinstance(operand, str) and math.isnan(operand) else C.operand(operand)
