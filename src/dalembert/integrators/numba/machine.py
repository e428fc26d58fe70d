"""[Python loop] -> [LLVM assembly]: loops that numba compiles once per installation, to be kept as plain machine code.

Only what makes the code imports this module, and with it numba; `dalembert.codegen.numba.loops` keeps the code and
calls it. The loops allocate nothing, so that they need no run-time library.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import types

__all__ = ["ENTRY", "loop_assembly"]

ENTRY = "entry"
"""Name of the function that a module of assembly defines: ``i64 entry(ptr words)``."""


class _Arguments:
    """Prints how arguments are read from words, and how numba passes them: arrays as seven or nine values."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.values: list[str] = []
        self._words = self._names = 0

    def add(self, kind: Any) -> None:
        """Read the next argument, which has a type of numba."""
        if isinstance(kind, types.Array):
            self._array(kind)
        elif isinstance(kind, types.BaseTuple):
            for part in kind:
                self.add(part)
        else:
            self.values.append(f"i64 {self._word()}")

    def _set(self, expression: str) -> str:
        self._names += 1
        self.lines.append(f"%v{self._names} = {expression}")
        return f"%v{self._names}"

    def _word(self) -> str:
        self._words += 1
        return self._set(f"load i64, ptr {self._set(f'getelementptr i64, ptr %words, i64 {self._words - 1}')}")

    def _array(self, kind: Any) -> None:
        """Read a C-contiguous array over borrowed memory."""
        item = kind.dtype.bitwidth // 8 if kind.dtype is not types.boolean else 1
        data = self._set(f"inttoptr i64 {self._word()} to ptr")
        shape = [self._word() for _ in range(kind.ndim)]
        strides = [str(item)]
        for length in reversed(shape[1:]):
            strides.insert(0, self._set(f"mul i64 {strides[0]}, {length}"))
        count = shape[0]
        for length in shape[1:]:
            count = self._set(f"mul i64 {count}, {length}")
        self.values += ["ptr null", "ptr null", f"i64 {count}", f"i64 {item}", f"ptr {data}"]
        self.values += [f"i64 {number}" for number in (*shape, *strides)]


def loop_assembly(loop: Callable[..., Any], kinds: tuple[Any, ...]) -> str:
    """Return a module that defines `ENTRY`, which reads the arguments of `loop` from words and calls it.

    Parameters
    ----------
    loop : callable
        Compiled by numba; it returns an integer or nothing, and writes other results to its arguments.
    kinds : tuple of numba types
        Its arguments: ``intp``, C-contiguous arrays, or tuples, named ones too. An integer is one word; an array is
        its address and its shape.
    """
    compiled: Any = loop
    compiled.compile(tuple(kinds))
    result = compiled.overloads[tuple(kinds)]
    arguments = _Arguments()
    for kind in kinds:
        arguments.add(kind)
    body = "\n".join(f"  {line}" for line in arguments.lines)
    values = ", ".join(["ptr %result", "ptr null", *arguments.values])
    return f"""{result.library.get_llvm_str()}
define i64 @{ENTRY}(ptr %words) nounwind {{
  %result = alloca i64
{body}
  %raised = call i32 @{result.fndesc.llvm_func_name}({values})
  %value = load i64, ptr %result
  ret i64 %value
}}
"""
