"""Screens of cases: calls of machine code that find out, for most sweeps, that nothing more has to be looked at.

What they do not pass is looked at with NumPy, which decides; so what is decided does not depend on them.
"""

from __future__ import annotations

import ctypes
from array import array
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, final

import numpy as np

from ...arrays import aligned
from ...ir.kernel import Kernel
from ...lanes.cases import BlockResult, CaseBlock, CaseColumns
from ...lanes.sweep_arguments import no_columns
from ...loops.rank_screen import RankArguments
from ...loops.screened_starts import ScreenedStarts, StartKernels
from ...loops.sign_screen import SignArguments
from ...loops.stiffness_screen import ScreenArguments
from ...steps.method_choice import TIME_SCALES
from ...subset.arguments import OwnedAddress, place_of
from ...subset.packing import pack, words_of
from .loops import loop_named

if TYPE_CHECKING:
    from ...reduction.starting import Start

_SHARE = 0.5
"""Share of the decay rate that counts up to which a case passes: differences are rounded."""

_INDEPENDENT = 1e-5
"""Product of what is new of unit rows from which on they are independent: far above what counts as lost."""


@final
class _Memory:
    """Memory of one thread at a time: packed arguments of a loop, and what they point to; which cases are chosen."""

    def __init__(self, loop: str, arguments: Any) -> None:
        self.made, self.words = arguments, array("q", pack(arguments).tobytes())
        self.chosen: Sequence[int] = ()
        self._call, self._pointer = loop_named(loop).call, ctypes.c_void_p(self.words.buffer_info()[0])

    def passes(self) -> bool:
        """Return what the loop finds."""
        return bool(self._call(self._pointer))


@final
class _Memories:
    """Memory of a screen that threads share: each takes one, made where none is left, and puts it back."""

    def __init__(self, loop: str, arguments: Callable[[], tuple[Any, ...]]) -> None:
        self._loop, self._arguments = loop, arguments
        self._memories: list[_Memory] = []

    def passes(self, fill: Callable[[_Memory], None]) -> bool:
        """Return what the loop finds of arguments that a function fills in."""
        try:
            memory = self._memories.pop()
        except IndexError:
            memory = _Memory(self._loop, self._arguments())
        fill(memory)
        passed = memory.passes()
        self._memories.append(memory)
        return passed


class StartSizes(NamedTuple):
    """Numbers of lanes, of components of the state, of parameters and of constants."""

    lanes: int
    n: int
    parameters: int
    constants: int


def _starts(kernels: StartKernels, start: Start, sizes: StartSizes) -> ScreenedStarts:
    """Return memory for starts of cases."""
    lanes, given, checks = sizes.lanes, len(start.given), 2 * len(start.labels)
    room = (2, max(sizes.parameters, given, 1), sizes.constants, sizes.n + checks)
    about = np.zeros(lanes, np.int64), sizes.parameters, given, sizes.n, checks
    return ScreenedStarts(kernels, no_columns(), *about, *(aligned(rows, lanes) for rows in room))


@final
class StiffnessScreen:
    """Test of whether the method of a sweep need not be fitted to some of its cases; threads may share it.

    Parameters
    ----------
    start : Start
        Of the cases.
    kernels : function
        Returns code in lanes, compiled when it is first needed: of starts, and of right-hand sides.
    sizes : StartSizes
    """

    def __init__(
        self, start: Start, kernels: Callable[[], tuple[StartKernels, OwnedAddress]], sizes: StartSizes
    ) -> None:
        self.start, self._lanes = start, sizes.lanes

        def arguments() -> ScreenArguments:
            codes, rhs = kernels()
            room = [aligned(rows, sizes.lanes) for rows in (*(sizes.n,) * 4, 1)]
            return ScreenArguments(_starts(codes, start, sizes), rhs, _SHARE * TIME_SCALES, *room)

        self._memories = _Memories("stiffness_screen", arguments)

    def __call__(self, cases: CaseColumns, numbers: Sequence[int]) -> bool:
        """Return whether the cases of these numbers start, and no mode can decay fast enough to count."""
        if len(numbers) > self._lanes:
            return False

        def fill(memory: _Memory) -> None:
            memory.words[_COLUMNS : _COLUMNS + 4] = array("q", cases.table.fields)
            if memory.chosen != numbers:
                memory.chosen, made = numbers, memory.made
                made.starts.cases[:] = [*numbers, *[numbers[-1]] * (self._lanes - len(numbers))]

        return self._memories.passes(fill)


_COLUMNS = place_of(ScreenArguments, "starts.columns")


class RankKernels(NamedTuple):
    """Code in lanes of coordinates and rates, the constraint Jacobian, and the mass matrix or the momenta."""

    starts: StartKernels
    expand: OwnedAddress
    jacobian: OwnedAddress
    masses: OwnedAddress
    by_rates: bool


@final
class RankScreen:
    """Test of whether constraints are independent, by far, at the starts of cases; threads may share it.

    Parameters
    ----------
    start : Start
        Of the cases.
    kernels : function
        Returns the code in lanes, compiled when it is first needed.
    sizes : StartSizes
    n_x, n_rows : int
        Numbers of coordinates, rates and first-order states, and of all constraints.
    angles : sequence of bool (n_q,)
        Which coordinates have no unit.
    rows : sequence of int
        The constraints to look at.
    """

    def __init__(
        self,
        start: Start,
        kernels: Callable[[], RankKernels],
        sizes: StartSizes,
        n_x: int,
        n_rows: int,
        angles: Sequence[bool],
        rows: Sequence[int],
    ) -> None:
        self.start, n, mixed = start, len(angles), any(angles) and not all(angles)

        def arguments() -> RankArguments:
            codes = kernels()
            masses = n if codes.by_rates else n * n
            x, whole, mass, unit = (aligned(size, sizes.lanes) for size in (n_x, n_rows * n, masses, len(rows) * n))
            return RankArguments(
                _starts(codes.starts, start, sizes),
                codes.expand,
                codes.jacobian,
                codes.masses,
                int(codes.by_rates),
                0,
                np.array(rows, np.int64),
                np.array(angles if mixed else [], np.int64),
                _INDEPENDENT,
                x,
                whole,
                mass,
                unit,
                np.ones((n, 1)),
            )

        self._memories = _Memories("rank_screen", arguments)

    def __call__(self, cases: CaseColumns) -> bool:
        """Return whether all cases start, and have independent constraints."""

        def fill(memory: _Memory) -> None:
            memory.words[_RANK_COLUMNS : _RANK_COLUMNS + 4] = array("q", cases.table.fields)
            memory.words[_COUNT] = cases.count

        return self._memories.passes(fill)


_RANK_COLUMNS, _COUNT = (place_of(RankArguments, name) for name in ("starts.columns", "n_cases"))


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
    sizes : (int, int)
        Numbers of components of the state, and of constants.
    """

    def __init__(self, kernel: Kernel, code: Callable[[], OwnedAddress], lanes: int, sizes: tuple[int, int]) -> None:
        self.kernel, outputs = kernel, len(kernel.outputs)

        def arguments() -> SignArguments:
            none = np.empty((0, 0))
            room = [aligned(rows, lanes) for rows in (1, *sizes, outputs, outputs)]
            return SignArguments(code(), none, none, none, none, none, _CERTAIN, *room)

        self._memories = _Memories("sign_screen", arguments)

    def __call__(self, block: CaseBlock, done: BlockResult) -> bool:
        """Return whether all cases succeeded, and all signs are certainly the same."""
        if len(block.c) != len(done.y):
            return False
        words = array("q", words_of((block.spans, done.ends, block.y, block.c, done.y)))

        def fill(memory: _Memory) -> None:
            memory.words[_ARRAYS : _ARRAYS + len(words)] = words

        return self._memories.passes(fill)
