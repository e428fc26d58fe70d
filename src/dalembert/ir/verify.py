"""The verifier: what every kernel must satisfy, checked after every pass."""

from __future__ import annotations

import math

from .kernel import Kernel
from .ops import ALL_OPERATIONS

__all__ = ["MalformedKernel", "verify"]


class MalformedKernel(AssertionError):
    """A pass produced a kernel that is not in SSA form; a fault of the compiler, never of a scene."""


def verify(kernel: Kernel) -> Kernel:
    """Return `kernel` if it is well formed.

    Raises
    ------
    MalformedKernel
        When a value is assigned twice or used before its assignment, an operation is unknown or has the wrong
        number of operands, a load names no argument, or a literal is not finite.
    """
    known: set[str] = set()

    def fail(text: str) -> None:
        raise MalformedKernel(f"kernel {kernel.name!r}: {text}")

    def define(target: str) -> None:
        if target in known:
            fail(f"{target} is assigned twice")
        if not target.isidentifier() or target in kernel.arguments:
            fail(f"{target!r} cannot name a value")
        known.add(target)

    def use(operand: str | float, where: str) -> None:
        if isinstance(operand, str):
            if operand not in known:
                fail(f"{where} uses {operand} before its assignment")
        elif not math.isfinite(operand):
            fail(f"{where} uses the literal {operand}")

    for load in kernel.loads:
        if load.array not in kernel.arguments:
            fail(f"{load.target} is loaded from {load.array}, which is no argument")
        define(load.target)
    for line in kernel.body:
        operation = ALL_OPERATIONS.get(line.op)
        if operation is None:
            fail(f"{line.target} uses the unknown operation {line.op}")
        elif operation.arity != len(line.args):
            fail(f"{line.target}: {line.op} takes {operation.arity} operands, not {len(line.args)}")
        for operand in line.args:
            use(operand, line.target)
        define(line.target)
    for operand in kernel.outputs:
        use(operand, "an output")
    return kernel
