"""Kernels as functions of C, ``void name(t, y, c, s, out)``, one array of doubles an argument; sources around them."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Sequence
from typing import Any, final

from ...ir.kernel import Assignment, Kernel, Operand, describe_counts
from ...ir.tables import numbers_of, table_of
from ...naming import Namer
from ..elementary import ELEMENTARY, formula_of
from ..llvm.vector_functions import LIBRARY, ROUNDING, shared_constants
from ..printers import C
from ..rendering import render
from .printing import FUNCTIONS, RESERVED, double, rows_of

ARGUMENTS = ("t", "y", "c", "s")


def kernel_variables(name: str, kernel: Kernel, meaning: str, *, exact: bool = False, lanes: int = 1) -> dict[str, Any]:
    """Return the variables of the template ``c/kernels.c.j2``.

    Parameters
    ----------
    name : str
        Name of the function.
    kernel : Kernel
        Of arguments that are arrays, the scalar time among them.
    meaning : str
        What it computes, for the comment above it.
    exact : bool
        Whether elementary functions are those of the C library, as in kernels that run once.
    lanes : int
        Points that it is computed at, one after the other; their numbers lie side by side.
    """
    arguments = kernel.arguments + ARGUMENTS[len(kernel.arguments) :]
    renamed = Names((*arguments, "out", "lane"))

    def at(place: int) -> str:
        return str(place) if lanes == 1 else f"{lanes * place} + lane"

    lines = [f"const double {renamed(load.target)} = {load.array}[{at(load.index or 0)}];" for load in kernel.loads]
    lines += body_lines(kernel.body, renamed, exact=exact)
    outputs = [f"out[{at(i)}] = {renamed.operand(value)};" for i, value in enumerate(kernel.outputs)]
    read = {load.array for load in kernel.loads}
    return {
        "name": name,
        "doc": f"{meaning}: {len(kernel.outputs)} values, {describe_counts(kernel)}.",
        "arguments": arguments,
        "unused": [*(name for name in arguments if name not in read), *([] if outputs else ["out"])],
        "lines": [*lines, *outputs],
        "lanes": lanes,
    }


@final
class Names:
    """The names of values of a function in C; some are taken."""

    def __init__(self, taken: Sequence[str]) -> None:
        self._namer, self._names = Namer({*RESERVED, *FUNCTIONS, *taken}), dict[str, str]()

    def __call__(self, name: str) -> str:
        """Return the name of a value."""
        if name not in self._names:
            self._names[name] = self._namer(name)
        return self._names[name]

    def operand(self, operand: Operand) -> str:
        """Return a name or an exact literal."""
        return self(operand) if isinstance(operand, str) else C.operand(operand)


def body_lines(lines: Sequence[Assignment], renamed: Names, *, exact: bool = False) -> Iterator[str]:
    """Return the line of each operation; sine and cosine of one argument are computed together, but where `exact`."""
    angles: dict[Operand, str] = {}
    for line in lines:
        args = [renamed.operand(arg) for arg in line.args]
        before = ""
        if line.op in ("sin", "cos") and not exact:
            if line.args[0] not in angles:
                angles[line.args[0]] = renamed(f"angle {line.target}")
                before = f"const struct angle {angles[line.args[0]]} = angle_of({args[0]}); "
            value = f"{angles[line.args[0]]}.{'sine' if line.op == 'sin' else 'cosine'}"
        elif line.op in _NAMES and not exact:
            value = f"{_NAMES[line.op]}({', '.join(args)})"
        else:
            value = C.expression(line.op, *args)
        yield f"{before}const double {renamed(line.target)} = {value};"


_SEARCH, _ARRAY = re.compile(r"\bpiece_(\d+)\("), re.compile(r"\btable_(\d+)_(\d+)\[")


def table_variables(text: str) -> list[dict[str, Any]]:
    """Return the variables of the tables that printed kernels read, for ``c/tables.c.j2``."""
    found: list[dict[str, Any]] = []
    for key, row in dict.fromkeys(_ARRAY.findall(text)):
        numbers = [double(float(x)) for x in numbers_of(int(key)).row(int(row))]
        found.append(_table(f"table_{key}_{row}", numbers, ""))
    for key in dict.fromkeys(_SEARCH.findall(text)):
        numbers = [double(float(x)) for x in table_of(int(key)).edges]
        found.append(_table(f"table_{key}_edges", numbers, f"piece_{key}"))
    return found


def _table(name: str, numbers: list[str], search: str) -> dict[str, Any]:
    return {"name": name, "size": len(numbers), "rows": rows_of(numbers), "search": search}


# Elementary functions, as the default backend computes them.

_NAMES = {name: f"{name}_of" for name in ELEMENTARY}
"""Names of the functions in C."""

_ELEMENTARY = re.compile(rf"\b({'|'.join(ELEMENTARY)})_of\(")
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
    called = sorted(set(_ELEMENTARY.findall(text)))
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
        "name": _NAMES[name],
        "library": name,
        "arguments": arguments,
        "parameters": ", ".join(f"double {x}" for x in given),
        "lines": lines,
        "value": value if made.usual is None else f"{_operand(made.usual)} ? {value} : {name}({arguments})",
    }


def _operand(operand: Operand) -> str:
    return "NAN" if not isinstance(operand, str) and math.isnan(operand) else C.operand(operand)


def _numbers(value: Any) -> Any:
    """Return numbers as literals, in tuples and mappings."""
    if isinstance(value, dict):
        return {key: _numbers(item) for key, item in value.items()}
    return [_numbers(item) for item in value] if isinstance(value, tuple) else double(value)


def source_of(
    banner: Sequence[str],
    headers: Sequence[str],
    printed: str,
    loops: str = "",
    used: Collection[str] = (),
    run: str = "",
) -> str:
    """Return a source without its public functions: what is called, tables, printed kernels, and loops.

    `used` are the functions of the prelude that the loops call, and `run` is the type of what loops in tables take.
    """
    tables, elementary = table_variables(printed), elementary_variables(printed)
    printed = (render("c/elementary.c.j2", elementary) if elementary else "") + printed
    prelude = {
        "banner": list(banner),
        "headers": list(headers),
        "used": _used(printed + loops, used),
        "runs": [run] if "loop_function" in loops else [],
        "constants": {key: _numbers(value) for key, value in shared_constants().items()},
    }
    text = render("c/prelude.c.j2", prelude)
    return text + (render("c/tables.c.j2", {"tables": tables}) if tables else "") + printed + loops


_PRELUDE = re.compile(r"\b(fused|angle_of|rough_log2|rough_exp2|kernel_function|loop_function|inputs_fit)\b")


def _used(text: str, loops: Collection[str]) -> list[str]:
    """Return the functions of the prelude that a text calls."""
    used = {*loops, *_PRELUDE.findall(text)}
    if used & {"angle_of", "rough_log2", "rough_exp2"}:
        used.add("fused")
    return sorted(used)
