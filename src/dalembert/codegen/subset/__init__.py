"""[Python function] -> [module of LLVM assembly]: loops of integrators, translated without numba's front end.

numba takes seconds for what this does in hundredths of one, because the loops need little of Python: functions of
whole numbers, doubles, flags, C-contiguous arrays and tuples of these. They are marked as `bare`
(`dalembert.integrators.compiled_subset`). The rules, beside those of Python:

- A variable has one kind, that of its first value in the text; whole numbers become doubles where these are kept.
- Functions say what they return. They are translated for the kinds of their arguments.
- What a function finds outside it (numbers, arrays) is constant, and tests of it are decided when it is translated.
- Loops are ``while``, ``for`` over a ``range`` with a constant step, and ``for`` over a tuple that is written out.
- Indices are never negative, and divisors of whole numbers are positive.
- Products and sums may be fused, nothing is reassociated, and a division by zero gives what IEEE 754 says.
"""

from __future__ import annotations

from typing import Any, final

import numpy as np

from ...integrators.kinds import FLAG, INTEGER, NUMBER, Array, Group, Kind
from .statements import translated
from .values import Value, rounded

__all__ = ["ENTRY", "loop_assembly"]

ENTRY = "entry"
"""Name of the function that a module defines: ``i64 entry(ptr words)``."""

_DECLARED = """declare double @llvm.fabs.f64(double)
declare double @llvm.sqrt.f64(double)
declare double @exp(double)
declare double @log(double)
declare i64 @llvm.abs.i64(i64, i1)
declare i64 @llvm.smax.i64(i64, i64)
declare i64 @llvm.cttz.i64(i64, i1)
declare void @llvm.prefetch.p0(ptr, i32, i32, i32)"""


def loop_assembly(loop: Any, kinds: tuple[Kind, ...]) -> str:
    """Return a module that defines `ENTRY`, which reads the arguments of `loop` from words and calls it.

    Parameters
    ----------
    loop : function
        It returns a whole number or nothing, and writes other results to its arguments.
    kinds : tuple of Kind
        Of its arguments. Whole numbers are one word each, arrays their address and their shape.

    Raises
    ------
    TypeError
        For what has no translation; the message names the line.
    """
    module = _Module()
    name, result = module.function(loop, kinds)
    lines, words = [], []
    for place, word in enumerate(Group(kinds).words):
        lines.append(f"%a{place} = getelementptr i64, ptr %words, i64 {place}")
        lines.append(f"%w{place} = load {word}, ptr %a{place}")
        words.append(f"{word} %w{place}")
    if result == INTEGER:
        lines += [f"%r = call {{i64}} @{name}({', '.join(words)})", "%status = extractvalue {i64} %r, 0"]
        lines.append("ret i64 %status")
    else:
        lines += [f"call void @{name}({', '.join(words)})", "ret i64 0"]
    body = "\n".join(["entry:", *lines])
    entry = f"define i64 @{ENTRY}(ptr %words) nounwind {{\n{body}\n}}"
    return "\n\n".join([_DECLARED, *module.constants, *module.texts, entry, ""])


@final
class _Module:
    """The functions and constants of one module."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.constants: list[str] = []
        self._functions: dict[tuple[Any, tuple[Kind, ...]], tuple[str, Kind]] = {}
        self._arrays: dict[int, Value] = {}
        self._count = 0

    def function(self, function: Any, kinds: tuple[Kind, ...]) -> tuple[str, Kind]:
        """See `Functions.function`."""
        key = function, kinds
        if key not in self._functions:
            self._count += 1
            name = f"{function.__name__}_{self._count}"
            lines, result = translated(self, function, name, kinds)
            self.texts.append("\n".join(lines))
            self._functions[key] = name, result
        return self._functions[key]

    def array(self, array: Any) -> Value:
        """See `Functions.array`."""
        if id(array) not in self._arrays:
            item = {"f": NUMBER, "i": INTEGER, "b": FLAG}[array.dtype.kind]
            values = [rounded(x) if item == NUMBER else str(int(x)) for x in np.ravel(array)]
            held = ", ".join(f"{item.stored} {value}" for value in values)
            name = f"@constant{len(self._arrays)}"
            self.constants.append(f"{name} = private constant [{len(values)} x {item.stored}] [{held}]")
            self._arrays[id(array)] = Value(Array(item, array.ndim), (name, *map(str, array.shape)))
        return self._arrays[id(array)]
