"""Kernels of one program as code that is called: those of the program, further ones, and actions at stops."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, final

import numpy as np

from ..arrays import FloatArray, aligned
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..lanes.cases import BlockResult, CaseBlock
from ..once import BoundedTable, computed_once
from ..options import NamedTolerances
from ..steps.problem import IntegrationProblem
from ..steps.row_loops import KernelRowsArguments
from ..stops.stops import CaseStops, StopAction
from ..subset.arguments import OwnedAddress
from .host_code import landing_code, raise_failure
from .library import MOST_FURTHER, KernelLibrary
from .llvm.loops import loop_named

if TYPE_CHECKING:
    from .llvm.screens import SignScreen


INTERPRETED = 16
"""Sweeps that are looked at with NumPy alone first: a few do not wait until screens are imported and compiled."""


@final
class KernelCode:
    """Kernels of one program, compiled by its library when they are first needed.

    Parameters
    ----------
    program : Program
    library : KernelLibrary

    Attributes
    ----------
    sizes : dict of str to int
        Number of outputs of each kernel of the program.
    """

    def __init__(self, program: Program, library: KernelLibrary) -> None:
        self.sizes = {kernel.name: len(kernel.outputs) for kernel in program}
        self._state = program.layout.state
        self._library = library
        self._looked = 0
        self._screens: BoundedTable[int, SignScreen] = BoundedTable(MOST_FURTHER)
        self._further: BoundedTable[tuple[int, int], tuple[Kernel, OwnedAddress]] = BoundedTable(MOST_FURTHER)

    def of(self, kernel: Kernel, lanes: int) -> OwnedAddress:
        """Return the address of any kernel of (t, y, c) as code for so many lanes."""
        key = id(kernel), lanes  # the kernel is kept, so that no other can have its number
        return computed_once(self._further, key, lambda: (kernel, self._library.extra_kernel(kernel, lanes)))[1]

    def of_action(self, action: StopAction, lanes: int) -> OwnedAddress:
        """Return the code of an action at stops."""
        if action.kernel is not None:
            return self.of(action.kernel, lanes)
        return landing_code(action, self.sizes["rhs"], self.sizes["prepare"], lanes)

    def of_stops(self, stops: CaseStops, lanes: int) -> CaseStops:
        """Return the stops of cases with the code of their actions."""
        return stops.compiled(partial(self.of_action, lanes=lanes))

    def of_problem(self, problem: IntegrationProblem) -> IntegrationProblem:
        """Return a problem of one lane whose inputs have the code of `Program.knot_sides`, stops that of actions.

        Absolute tolerances by name become those of the components of the state.
        """
        inputs, stops = problem.inputs, problem.stops
        if isinstance(problem.atol, NamedTolerances):
            problem = problem.with_components(self._state)
        if inputs is not None and inputs.sides is not None:
            problem = replace(problem, inputs=inputs.compiled(lambda sides: self._library.kernel(sides.name)))
        if stops is None:
            return problem
        code = partial(self.of_action, lanes=1)
        return replace(problem, stops=stops.compiled(code, self._library.prepare(), raise_failure))

    def keeps_signs(self, kernel: Kernel, block: CaseBlock, done: BlockResult) -> bool:
        """See `Engine.keeps_signs`."""
        if self._looked < INTERPRETED:
            self._looked += 1
            return False
        screen = self._screens.get(id(kernel))
        if screen is None or screen.kernel is not kernel:
            from .llvm.screens import SignScreen

            lanes = self._library.lanes
            sizes = block.y.shape[1], block.c.shape[1]
            screen = self._screens[id(kernel)] = SignScreen(kernel, partial(self.of, kernel, lanes), lanes, sizes)
        return screen(block, done)

    def named(self, name: str, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """Return the outputs (k, n_out) of a kernel of the program at times (k,), states (k, n), constants (n_c,)."""
        lanes = self._library.lanes
        constants = np.broadcast_to(c, (len(t), len(c)))
        return _rows(self._library.kernel(name, lanes), lanes, self.sizes[name], t, y, constants)

    def rows(self, kernel: Kernel, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """Return the outputs (k, n_out) of any kernel at times (k,), states (k, n) and constants (k, n_c)."""
        lanes = self._library.lanes
        return _rows(self.of(kernel, lanes), lanes, len(kernel.outputs), t, y, c)


def _rows(code: OwnedAddress, lanes: int, size: int, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
    out = np.empty((len(t), size))
    if len(t):
        room = [aligned(size, lanes) for size in (1, y.shape[1], c.shape[1], out.shape[1])]
        times, states, constants = (np.ascontiguousarray(a, np.float64) for a in (t, y, c))
        loop_named("kernel_rows")(KernelRowsArguments(code, times, states, constants, out, *room))
    return out
