"""[Python loop] -> [LLVM assembly]: loops that numba compiles once per installation, to be kept as plain machine code.

Only what makes the code imports this module, and with it numba; `dalembert.codegen.numba.loops` keeps the code and
calls it. The loops allocate nothing, so that they need no run-time library.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ["ENTRY", "loop_assembly"]

ENTRY = "entry"
"""Name of the function that a module of assembly defines: ``void entry(ptr words)``."""


def _unpacker(kinds: tuple[Any, ...]) -> Any:
    """Return an intrinsic that reads arguments of some types from words; arrays stay the property of the caller."""

    @intrinsic
    def unpack(typingctx: Any, pointer: Any) -> Any:
        signature = types.Tuple(kinds)(pointer)

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            integer = ir.IntType(64)
            base = builder.bitcast(values[0], integer.as_pointer())
            place = 0

            def word() -> Any:
                nonlocal place
                place += 1
                return builder.load(builder.gep(base, [ir.Constant(integer, place - 1)]))

            def argument(kind: Any) -> Any:
                if isinstance(kind, types.Array):
                    return _array(context, builder, kind, word(), [word() for _ in range(kind.ndim)])
                if isinstance(kind, types.UniTuple):
                    return cgutils.pack_array(builder, [word() for _ in range(kind.count)])
                if isinstance(kind, types.BaseTuple):
                    return context.make_tuple(builder, kind, [argument(part) for part in kind.types])
                return word()

            return context.make_tuple(builder, signature.return_type, [argument(kind) for kind in kinds])

        return signature, generate

    return unpack


def _array(context: Any, builder: Any, kind: Any, address: Any, shape: list[Any]) -> Any:
    """Return a C-contiguous array over borrowed memory."""
    item = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    strides = [ir.Constant(ir.IntType(64), item)]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length))
    array = context.make_array(kind)(context, builder)
    data = builder.inttoptr(address, context.get_data_type(kind.dtype).as_pointer())
    size = context.get_constant(types.intp, item)
    context.populate_array(array, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None)
    return array._getvalue()


def loop_assembly(loop: Callable[..., Any], kinds: tuple[Any, ...]) -> str:
    """Return a module that defines `ENTRY`, which reads the arguments of `loop` from words and calls it.

    Parameters
    ----------
    loop : callable
        Compiled by numba; it returns nothing and writes its results to its arguments.
    kinds : tuple of numba types
        Its arguments: ``intp``, C-contiguous arrays, or tuples, named ones too. An integer is one word; an array is
        its address and its shape.
    """
    unpack = _unpacker(kinds)

    def entry(pointer: Any) -> None:
        loop(*unpack(pointer))

    compiled = numba.cfunc(types.void(types.voidptr), error_model="numpy", fastmath={"contract"}, _nrt=False)(entry)
    text = compiled.inspect_llvm()
    wrapper = compiled.native_name
    inner = re.search(r"define [^@\n]*i32 @([^(\n]+)\(", text)
    assert inner is not None, "numba compiled no function"
    # numba's own entry point reports exceptions to Python; nothing is raised here, so it is left out.
    text = re.sub(rf"define [^\n]*@{re.escape(wrapper)}\(.*?\n}}\n", "", text, flags=re.DOTALL)
    return f"""{text}
define void @{ENTRY}(ptr %words) nounwind {{
  %result = alloca ptr
  %status = call i32 @{inner.group(1)}(ptr %result, ptr null, ptr %words)
  ret void
}}
"""
