"""The verifier of kernels, run after every pass."""

from __future__ import annotations

import math
from typing import NoReturn

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
    known: set[str | float] = set()
    arguments = kernel.arguments
    for load in kernel.loads:
        if load.array not in arguments:
            _fail(kernel, f"{load.target} is loaded from {load.array}, which is no argument")
        if load.target in known or not load.target.isidentifier() or load.target in arguments:
            _fail_to_define(kernel, load.target, known)
        known.add(load.target)
    for line in kernel.body:
        operation, target = ALL_OPERATIONS.get(line.op), line.target
        if operation is None:
            _fail(kernel, f"{target} uses the unknown operation {line.op}")
        if operation.arity != len(line.args):
            _fail(kernel, f"{target}: {line.op} takes {operation.arity} operands, not {len(line.args)}")
        for operand in line.args:
            if operand not in known:
                _check_literal(kernel, operand, target)
        if target in known or not target.isidentifier() or target in arguments:
            _fail_to_define(kernel, target, known)
        known.add(target)
    for operand in kernel.outputs:
        if operand not in known:
            _check_literal(kernel, operand, "an output")
    return kernel


def _fail(kernel: Kernel, text: str) -> NoReturn:
    raise MalformedKernel(f"kernel {kernel.name!r}: {text}")


def _fail_to_define(kernel: Kernel, target: str, known: set[str | float]) -> NoReturn:
    _fail(kernel, f"{target} is assigned twice" if target in known else f"{target!r} cannot name a value")


def _check_literal(kernel: Kernel, operand: str | float, where: str) -> None:
    """Require that an operand is a known value or a finite number."""
    if isinstance(operand, str):
        _fail(kernel, f"{where} uses {operand} before its assignment")
    if not math.isfinite(operand):
        _fail(kernel, f"{where} uses the literal {operand}")
