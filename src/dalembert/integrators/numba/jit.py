"""How integrator code is compiled, and calls of kernels through their addresses.

A kernel is handed over as an address and not as a numba function value, because numba spends some 60
microseconds on turning one jitted function into a function value, longer than a whole simulation may take.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast
from weakref import WeakKeyDictionary

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from dalembert.integrators.problem import Kernel

F = TypeVar("F", bound=Callable[..., object])

VECTOR = types.Array(types.float64, 1, "C")
MATRIX = types.Array(types.float64, 2, "C")
KERNEL_SIGNATURE = types.void(types.float64, VECTOR, VECTOR, VECTOR)

_addresses: WeakKeyDictionary[Any, int] = WeakKeyDictionary()


def compiled(function: F) -> F:
    """Compile a helper of the integrators: IEEE division, fused multiply-adds allowed, no reassociation."""
    return cast(
        F,
        njit(
            nogil=True,
            error_model="numpy",
            fastmath={"contract"},
            no_cpython_wrapper=True,
            no_cfunc_wrapper=True,
        )(function),
    )


def compiled_and_cached(function: F, argument_types: tuple[Any, ...]) -> F:
    """Compile an entry point for the given argument types now, or load it from numba's disk cache."""
    options = njit(argument_types, nogil=True, error_model="numpy", fastmath={"contract"}, cache=True)
    return cast(F, options(function))


def kernel_address(kernel: Kernel | None) -> int:
    """Address of a jitted kernel's compiled code, 0 for an absent kernel.

    The address is valid as long as the kernel is alive. Kernels are compiled for ``KERNEL_SIGNATURE`` if they
    have not been yet.
    """
    if kernel is None:
        return 0
    address = _addresses.get(kernel)
    if address is None:
        result = cast(Any, kernel).get_compile_result(KERNEL_SIGNATURE)
        address = int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))
        _addresses[kernel] = address
    return address


@intrinsic
def call_kernel(
    typingctx: Any, address: Any, t: Any, work: Any, y_row: Any, constants: Any, out_row: Any, n: Any
) -> Any:
    """Call the kernel at ``address``; the first ``n`` entries of two rows of ``work`` are state and output.

    The rows are passed as arrays that own nothing, which spares the reference counting of slices.
    """
    signature = types.void(types.intp, types.float64, MATRIX, types.intp, VECTOR, types.intp, types.intp)

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        address, t, work, y_row, constants, out_row, n = values
        matrix = context.make_array(MATRIX)(context, builder, work)
        width = cgutils.unpack_tuple(builder, matrix.shape)[1]
        item = context.get_constant(types.intp, 8)

        def row(number: Any) -> Any:
            view = context.make_array(VECTOR)(context, builder)
            context.populate_array(
                view,
                data=builder.gep(matrix.data, [builder.mul(number, width)]),
                shape=[n],
                strides=[item],
                itemsize=item,
                meminfo=None,
            )
            return view._getvalue()

        function_type = context.call_conv.get_function_type(types.void, KERNEL_SIGNATURE.args)
        pointer = builder.inttoptr(address, ir.PointerType(function_type))
        arguments = (t, row(y_row), constants, row(out_row))
        status, _ = context.call_conv.call_function(builder, pointer, types.void, KERNEL_SIGNATURE.args, arguments)
        with cgutils.if_unlikely(builder, status.is_error):
            context.call_conv.return_status_propagate(builder, status)
        return context.get_dummy_value()

    return signature, generate
