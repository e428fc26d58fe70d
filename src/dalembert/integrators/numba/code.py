"""Calls of compiled kernels that take plain pointers, as `dalembert.codegen.numba.llvm` makes them."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ["call_code", "call_test", "element", "row", "take"]


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


@intrinsic
def call_test(typingctx: Any, address: Any, t: Any, y: Any, c: Any, s: Any, out: Any) -> Any:
    """Call the code at ``address`` with five addresses of doubles; return the whole number that it returns."""
    signature = types.intp(*(types.intp,) * 6)

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        integer = ir.IntType(64)
        function = ir.FunctionType(integer, [integer] * 5)
        return builder.call(builder.inttoptr(values[0], function.as_pointer()), list(values[1:]))

    return signature, generate


@intrinsic
def element(typingctx: Any, address: Any, index: Any) -> Any:
    """Return the double at an index from an address."""
    signature = types.float64(types.intp, types.intp)

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        pointer = builder.inttoptr(values[0], ir.DoubleType().as_pointer())
        return builder.load(builder.gep(pointer, [values[1]]))

    return signature, generate


@intrinsic
def take(typingctx: Any, array: Any, amount: Any) -> Any:
    """Add to the first element of an array of whole numbers, which threads share; return what it was."""
    signature = types.intp(array, types.intp)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, values[0]).data
        return builder.atomic_rmw("add", data, values[1], "monotonic")

    return signature, generate
