"""Pipelines: lists of passes as data, run with the verifier before and after each."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Generic, Protocol, TypeVar, final

from ..frozen import frozen
from ..ir.kernel import Kernel, verify
from ..ir.program import Program
from .passes import EliminateDeadCode, FuseProducts, GroupProducts, HoistParameters, ShareEqual, ShareReciprocals

Code = TypeVar("Code", Kernel, Program)


class Pass(Protocol[Code]):
    """A pass from kernel to kernel, or from program to program: a frozen dataclass with a name and options."""

    @property
    def name(self) -> str:
        """Name of the pass in `explain`."""
        ...

    def __call__(self, code: Code, /) -> Code:
        """Return the code after the pass."""
        ...


@final
@frozen
class PassRecord:
    """Effect of a pass.

    Attributes
    ----------
    name : str
        Name of the pass.
    seconds : float
        Time that it took, without that of the verifier.
    before, after : mapping of str to int
        Operations of each kernel, by its name.
    """

    name: str
    seconds: float
    before: Mapping[str, int]
    after: Mapping[str, int]


@final
@frozen
class Pipeline(Generic[Code]):
    """Passes that run one after another.

    Attributes
    ----------
    passes : tuple of Pass
        All on kernels, or all on programs.
    """

    passes: tuple[Pass[Code], ...]

    def __call__(self, code: Code, records: list[PassRecord] | None = None) -> Code:
        """Return a kernel or program after all passes, verified before the first and after each.

        Parameters
        ----------
        code : Kernel or Program
            Argument of the passes.
        records : list of PassRecord, optional
            Gets a record of each pass.

        Raises
        ------
        MalformedKernel
            When the code given, or what a pass makes of it, is not well formed.
        """
        _verify(code)
        for step in self.passes:
            start = time.perf_counter()
            after = step(code)
            if records is not None:
                seconds = time.perf_counter() - start
                records.append(PassRecord(step.name, seconds, operation_counts(code), operation_counts(after)))
            if after is not code:
                _verify(after)
            code = after
        return code


def _kernels(code: Kernel | Program) -> tuple[Kernel, ...]:
    return (code,) if isinstance(code, Kernel) else code.kernels


def _verify(code: Kernel | Program) -> None:
    for kernel in _kernels(code):
        verify(kernel)


def operation_counts(code: Kernel | Program) -> dict[str, int]:
    """Return the number of operations of each kernel, by its name."""
    return {kernel.name: len(kernel.body) for kernel in _kernels(code)}


KERNEL_PASSES: Pipeline[Kernel] = Pipeline((GroupProducts(), ShareReciprocals(), ShareEqual(), EliminateDeadCode()))
"""Passes on every kernel that is made of a graph."""

PROGRAM_PASSES: Pipeline[Program] = Pipeline((HoistParameters(),))
"""Passes on the program that such kernels make up."""

STEP_PASSES: Pipeline[Kernel] = Pipeline((EliminateDeadCode(),))
"""Passes on kernels that are written line by line, such as the steps of integrators."""

PRODUCT_FUSION: Pipeline[Kernel] = Pipeline((FuseProducts(),))
"""Passes on right-hand sides before they are written into Runge-Kutta attempts."""
