"""Translation of integrator loops in a Python subset to LLVM assembly, without numba's front end.

numba takes seconds for what this does in hundredths of one, because the loops need little of Python: functions of
integers, doubles, flags, C-contiguous arrays, records and tuples of these. They are marked as `compiled_subset`
(`dalembert.subset.compiled_subset`). The rules, beside those of Python:

- A variable has one kind, that of its first value in the text; integers become doubles where these are kept.
- Functions say what they return. They are translated for the kinds of their arguments.
- What a function finds outside it (numbers, arrays) is constant, and tests of it are decided when it is translated.
- Loops are ``while``, ``for`` over a ``range`` with a constant step, and ``for`` over a tuple that is written out.
- Indices are never negative, and divisors of integers are positive.
- A product and a sum are rounded once where `fma` is written, and nowhere else; nothing is reassociated. A division by
  zero gives what IEEE 754 says.
"""

from __future__ import annotations

from typing import Any, final

import numpy as np

from ...subset.arguments import arguments_of, kind_of
from ...subset.compiled_subset import FLAG, INTEGER, NUMBER, Array, Kind
from .assembly import rounded
from .statements import translated
from .target import Value

__all__ = ["ENTRY", "loop_assembly"]

ENTRY = "entry"
"""Name of the function that a module defines: ``i64 entry(ptr packed_args)``."""

_DECLARED = """declare double @llvm.fabs.f64(double)
declare double @llvm.sqrt.f64(double)
declare double @exp(double)
declare double @log(double)
declare i64 @llvm.abs.i64(i64, i1)
declare i64 @llvm.smax.i64(i64, i64)
declare i64 @llvm.cttz.i64(i64, i1)
declare void @llvm.prefetch.p0(ptr, i32, i32, i32)"""


def loop_assembly(loop: Any, *, fused: bool = True, lanes: int = 1) -> str:
    """Return a module that defines `ENTRY`, which reads the arguments of `loop` from packed words and calls it.

    Parameters
    ----------
    loop : function
        Of one NamedTuple (`dalembert.subset.arguments`). It returns an integer or nothing, and writes other
        results to arrays and records of its arguments.
    fused : bool
        Whether the target has instructions for `fma`; elsewhere it is a product and a sum, each rounded.
    lanes : int
        Cases side by side (`dalembert.subset.compiled_subset.lanes`).

    Raises
    ------
    TypeError
        For statements that have no translation; the message names the line.
    """
    module, kind = _Module(fused, lanes), kind_of(arguments_of(loop))
    name, result = module.function(loop, (kind,))
    lines = [f"%r = call {{i64}} @{name}(ptr %packed_args)", "%status = extractvalue {i64} %r, 0", "ret i64 %status"]
    if result != INTEGER:
        lines = [f"call void @{name}(ptr %packed_args)", "ret i64 0"]
    body = "\n".join(["entry:", *lines])
    entry = f"define i64 @{ENTRY}(ptr %packed_args) nounwind {{\n{body}\n}}"
    declared = f"{_DECLARED}\ndeclare double @{module.fused}(double, double, double)"
    return "\n\n".join([declared, *module.constants, *module.texts, entry, *module.metadata, ""])


@final
class _Module:
    """The functions and constants of one module."""

    def __init__(self, fused: bool, lanes: int) -> None:
        self.lanes = lanes
        self.metadata = ["!0 = !{}"]
        self.fused = f"llvm.{'fma' if fused else 'fmuladd'}.f64"
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

    def side_by_side(self) -> tuple[int, int]:
        """See `Functions.side_by_side`."""
        group = len(self.metadata)
        parallel, enable, width, once, loop = range(group + 1, group + 6)
        self.metadata += [
            f"!{group} = distinct !{{}}",
            f'!{parallel} = !{{!"llvm.loop.parallel_accesses", !{group}}}',
            f'!{enable} = !{{!"llvm.loop.vectorize.enable", i1 true}}',
            f'!{width} = !{{!"llvm.loop.vectorize.width", i32 {self.lanes}}}',
            f'!{once} = !{{!"llvm.loop.unroll.disable"}}',
            f"!{loop} = distinct !{{!{loop}, !{parallel}, !{enable}, !{width}, !{once}}}",
        ]
        return group, loop

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
