"""Screens of cases: calls of machine code that find out, for most sweeps, that nothing more has to be looked at.

What they do not pass is looked at with NumPy, which decides; so what is decided does not depend on them.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, final

import numpy as np

from ...ir.kernel import Kernel
from ...lanes.cases import BlockResult, CaseBlock, CaseColumns
from ...lanes.sweep_arguments import no_columns
from ...lanes.workspace import aligned
from ...loops.sign_screen import SignArguments
from ...loops.stiffness_screen import ScreenArguments, ScreenKernels
from ...steps.method_choice import TIME_SCALES
from ...subset.addresses import OwnedAddress
from ...subset.arguments import address_of, pack, place_of
from .loops import loop_named

if TYPE_CHECKING:
    from ...reduction.starting import Start

_COLUMNS = place_of(ScreenArguments, "columns")

_SHARE = 0.5
"""Share of the decay rate that counts up to which a case passes: differences are rounded."""


@final
class StiffnessScreen:
    """Test of whether the method of a sweep need not be fitted to some of its cases; threads may share it.

    Parameters
    ----------
    start : Start
        Of the cases.
    kernels : function
        Returns the code in lanes, compiled when it is first needed.
    sizes : (int, int, int, int)
        Number of lanes, of components of the state, of parameters and of constants.
    """

    def __init__(self, start: Start, kernels: Callable[[], ScreenKernels], sizes: tuple[int, int, int, int]) -> None:
        self.start, self._kernels, self._sizes = start, kernels, sizes
        self._memories: list[_StiffnessMemory] = []

    def __call__(self, cases: CaseColumns, numbers: Sequence[int]) -> bool:
        """Return whether the cases of these numbers start, and no mode can decay fast enough to count."""
        if len(numbers) > self._sizes[0]:
            return False
        try:
            memory = self._memories.pop()
        except IndexError:
            memory = _StiffnessMemory(self._kernels(), self.start, self._sizes)
        passed = memory.passes(cases, numbers)
        self._memories.append(memory)
        return passed


@final
class _StiffnessMemory:
    """Memory of one thread at a time: packed arguments of the loop, and what they point to."""

    def __init__(self, kernels: ScreenKernels, start: Start, sizes: tuple[int, int, int, int]) -> None:
        lanes, n, n_p, n_c = sizes
        given, checks = len(start.given), 2 * len(start.labels)
        self._numbers = np.zeros(lanes, np.int64)
        room = (2, max(n_p, given, 1), n_c, n + checks, n, n, n, n, 1)
        self._made = ScreenArguments(
            kernels,
            no_columns(),
            self._numbers,
            n_p,
            given,
            checks,
            _SHARE * TIME_SCALES,
            *(aligned(rows, lanes) for rows in room),
        )
        self._words, self._call = pack(self._made), loop_named("stiffness_screen").call
        self._pointer = ctypes.c_void_p(address_of(self._words))

    def passes(self, cases: CaseColumns, numbers: Sequence[int]) -> bool:
        """Return whether the cases of these numbers pass; there are as many lanes, at least."""
        self._words[_COLUMNS : _COLUMNS + 4] = cases.table.fields
        lanes = len(self._numbers)
        self._numbers[:] = [*numbers, *[numbers[-1]] * (lanes - len(numbers))]
        return bool(self._call(self._pointer))


_CERTAIN = 1e-9
"""Product of two values above which their signs are certain, whatever rounds them."""

_ARRAYS = place_of(SignArguments, "spans")


@final
class SignScreen:
    """Test of whether a kernel has the same signs at the starts and the ends of cases; threads may share it.

    Parameters
    ----------
    kernel : Kernel
    code : function
        Returns its code in lanes, compiled when it is first needed.
    lanes : int
    """

    def __init__(self, kernel: Kernel, code: Callable[[], OwnedAddress], lanes: int) -> None:
        self.kernel, self._code, self._lanes = kernel, code, lanes
        self._memories: list[_SignMemory] = []

    def __call__(self, block: CaseBlock, done: BlockResult) -> bool:
        """Return whether all cases succeeded, and all signs are certainly the same."""
        if len(block.c) != len(done.y):
            return False
        try:
            memory = self._memories.pop()
        except IndexError:
            sizes = block.y.shape[1], block.c.shape[1]
            memory = _SignMemory(self._code(), len(self.kernel.outputs), self._lanes, sizes)
        passed = memory.passes(block, done)
        self._memories.append(memory)
        return passed


@final
class _SignMemory:
    """Memory of one thread at a time: packed arguments of the loop, and what they point to."""

    def __init__(self, code: OwnedAddress, outputs: int, lanes: int, sizes: tuple[int, int]) -> None:
        room = [aligned(rows, lanes) for rows in (1, *sizes, outputs, outputs)]
        none = np.empty((0, 0))
        self._made = SignArguments(code, none, none, none, none, none, _CERTAIN, *room)
        self._words, self._call = pack(self._made), loop_named("sign_screen").call
        self._pointer = ctypes.c_void_p(address_of(self._words))

    def passes(self, block: CaseBlock, done: BlockResult) -> bool:
        """Return whether the cases of a block pass."""
        arrays = block.spans, done.ends, block.y, block.c, done.y
        assert all([array.flags.c_contiguous for array in arrays])
        words = [word for array in arrays for word in (address_of(array), *array.shape)]
        self._words[_ARRAYS : _ARRAYS + len(words)] = words
        return bool(self._call(self._pointer))
