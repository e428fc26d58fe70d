"""Functions that give the values of many expressions, each common part computed once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import sympy as sp

from ..scene.expressions.compiled_functions import CompiledCall
from ..scene.expressions.table_functions import TABLE_CALLS, TableFunction

_CALLS = {
    sp.sin: "sin",
    sp.cos: "cos",
    sp.tan: "tan",
    sp.asin: "arcsin",
    sp.acos: "arccos",
    sp.atan: "arctan",
    sp.atan2: "arctan2",
    sp.exp: "exp",
    sp.log: "log",
    sp.sinh: "sinh",
    sp.cosh: "cosh",
    sp.tanh: "tanh",
    sp.Abs: "abs",
    sp.sign: "sign",
}
_NAMES = {name: getattr(np, name) for name in (*_CALLS.values(), "sqrt")}


def function_of(arguments: Sequence[Any], expressions: Sequence[Any]) -> Callable[..., list[Any]]:
    """Return a function of `arguments`, symbols or tuples of symbols, that gives a list of values.

    It is what ``sympy.lambdify`` makes, which writes out every expression in full and so takes far longer for large
    ones that share most of their parts. Expressions with functions that are not in the table are left to it.
    """
    heads = [f"a{i}" for i in range(len(arguments))]
    names: dict[Any, str] = {}
    for head, argument in zip(heads, arguments, strict=True):
        if isinstance(argument, sp.Symbol):
            names[argument] = head
        else:
            names |= {symbol: f"{head}[{i}]" for i, symbol in enumerate(argument)}
    lines: list[str] = []
    try:
        results = [_written(sp.sympify(e), names, lines) for e in expressions]
    except (KeyError, TypeError):
        return sp.lambdify(arguments, list(expressions), modules=[TABLE_CALLS, "numpy"], cse=False)
    body = "".join(f"    {line}\n" for line in lines)
    space: dict[str, Any] = {**_NAMES, **TABLE_CALLS}
    exec(f"def f({', '.join(heads)}):\n{body}    return [{', '.join(results)}]\n", space)
    return space["f"]


def _written(expression: Any, names: dict[Any, str], lines: list[str]) -> str:
    """Write the lines that compute an expression, and return its name; ``KeyError`` for an unknown function."""
    stack = [expression]
    while stack:
        e = stack[-1]
        if e in names:
            stack.pop()
            continue
        parts = e.values if isinstance(e, TableFunction | CompiledCall) else e.args
        pending = [part for part in parts if part not in names] if not e.is_number else []
        if pending:
            stack.extend(pending)
            continue
        stack.pop()
        if e.is_number:
            names[e] = str(e) if e.is_Integer and e >= 0 else _number(e)
            continue
        text = _line(e, [names[part] for part in parts])
        names[e] = f"x{len(lines)}"
        lines.append(f"{names[e]} = {text}")
    return names[expression]


def _number(e: Any) -> str:
    value = float(e)
    if not np.isfinite(value):
        raise KeyError(e)
    return f"({value!r})"


def _line(e: Any, parts: list[str]) -> str:
    if isinstance(e, TableFunction | CompiledCall):
        return e.call(*parts)
    if e.is_Add:
        return " + ".join(parts)
    if e.is_Mul:
        return " * ".join(parts)
    if e.is_Pow:
        base, exponent = parts[0], e.exp
        if exponent == 2:
            return f"{base} * {base}"
        if exponent == -1:
            return f"1 / {base}"
        if exponent in (sp.S.Half, -sp.S.Half):
            return f"sqrt({base})" if exponent > 0 else f"1 / sqrt({base})"
        return f"{base} ** {parts[1]}"
    return f"{_CALLS[e.func]}({', '.join(parts)})"
