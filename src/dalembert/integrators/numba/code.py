"""Calls of compiled kernels that take plain pointers, as `dalembert.codegen.numba.llvm` makes them."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ["call_code", "row"]


@intrinsic
def row(typingctx: Any, matrix: Any, number: Any) -> Any:
    """Return the address of a row of a C-contiguous matrix of doubles; the matrix must stay alive."""
    signature = types.intp(matrix, types.intp)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, values[0])
        width = cgutils.unpack_tuple(builder, array.shape)[1]
        pointer = builder.gep(array.data, [builder.mul(values[1], width)])
        return builder.ptrtoint(pointer, ir.IntType(64))

    return signature, generate


@intrinsic
def call_code(typingctx: Any, address: Any, t: Any, y: Any, c: Any, s: Any, out: Any) -> Any:
    """Call the code at ``address`` with five addresses of doubles."""
    signature = types.void(*(types.intp,) * 6)

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        integer = ir.IntType(64)
        function = ir.FunctionType(ir.VoidType(), [integer] * 5)
        builder.call(builder.inttoptr(values[0], function.as_pointer()), list(values[1:]))
        return context.get_dummy_value()

    return signature, generate
