"""Runs of the JAX backend as one compiled function each: prepared runs, and sweeps of all cases of a block."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, final

import jax
import jax.numpy as jnp
import numpy as np

from ..arrays import FloatArray
from ..codegen.runs import Prepared, PreparedStates
from ..ir.program import Program
from ..lanes.cases import BlockResult, CaseBlock
from ..methods.status import Status
from ..methods.step_constants import SMALLEST_SCALE
from ..once import computed_once
from ..options import component_tolerances
from ..steps.problem import IntegrationProblem
from ..transforms.taylor.recurrences import Recurrences
from ..transforms.taylor.step import order_at, scale_floor, step_kernel
from .pieces import constants_of_segments, pieces_of
from .runs.precision import LARGEST_FUSED, compiled, double_precision
from .runs.run_constants import ArrayKernels
from .runs.run_data import Limits, RunPieces
from .runs.runs import Runs

if TYPE_CHECKING:
    from ..codegen.llvm.prepared import Admission


_SMALLEST_BATCH = 16


def padded(rows: FloatArray) -> FloatArray:
    """Return `rows` with the last one repeated until their number is a power of two."""
    size = max(_SMALLEST_BATCH, 1 << (len(rows) - 1).bit_length())
    return np.concatenate([rows, np.repeat(rows[-1:], size - len(rows), axis=0)])


@final
class BlockSweeps:
    """Runs of blocks of cases of one program, padded to a power of two, so that few sizes are ever compiled.

    Parameters
    ----------
    program : Program
    kernels : Kernels
        Its kernels.
    series : function
        Returns the recurrences of Taylor steps.
    """

    def __init__(self, program: Program, kernels: ArrayKernels, series: Callable[[], Recurrences]) -> None:
        self._program, self._kernels, self._recurrences = program, kernels, series
        self._runners: dict[tuple[str, int, bool, bool], Callable[..., Any]] = {}

    def integrate(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        """Integrate the cases of a block without events; see `Engine.integrate_block`.

        Cases that pad their number to a power of two end where they begin.
        """
        order, count = order_at(block.rtol, block.atol) if method == "taylor" else 0, len(block.y)
        limits = _limits(self._program, block)
        key = method, order, bool(len(block.t_eval)), len(limits) > _COMMON
        t, states = padded(block.spans), padded(block.y)
        t[count:, 1] = t[count:, 0]
        if len(block.t_eval):  # whose span is that of all cases
            t = np.concatenate([t[0, :1], block.t_eval, t[0, 1:]])
            states[count:] = np.nan
        with double_precision():
            runner = computed_once(self._runners, key, lambda: self._runner(*key))
            y, record = jax.device_get(runner(t, states, padded(block.c), limits))
        result.samples[:] = y[:count, 1:-1]
        result.y[:] = record.end[:count]
        result.ends[:] = np.stack([record.reached, record.status, record.steps], axis=1)[:count]

    def _runner(self, method: str, order: int, timed: bool, weighted: bool) -> Callable[..., Any]:
        """Return the function (times, states, constants, limits) -> how the cases went, compiled once for all limits.

        Times are rows, or where they are `timed` those of all cases.
        """
        constants = constants_of_segments(self._program)
        pieces = pieces_of(self._program, self._kernels, method, order, constants, weighted)

        def cases(t: Any, y: Any, c: Any, limits: Any) -> Any:
            runs = Runs(pieces, _read_limits(limits))
            each: Any = jax.vmap(lambda t, y, c: runs.run(0, t, y, c, jnp.zeros(0))[:2], (None if timed else 0, 0, 0))
            return each(t, y, c)

        operations = LARGEST_FUSED + 1  # Runge-Kutta attempts are faster unfused, whatever their length
        if method == "taylor":
            known = replace(self._recurrences(), weighted=weighted)
            operations = len(step_kernel(known, order, dense=False).body)
        return compiled(cases, operations + self._kernels.correction_operations)


_COMMON = 5
"""Numbers of limits where one absolute tolerance serves all components of the state; then there is one each, too."""


def _limits(program: Program, given: CaseBlock | IntegrationProblem) -> FloatArray:
    """Return the limits of runs as an array, for `_read_limits`."""
    own = component_tolerances(given.atol, program.layout.state)
    floor = scale_floor(given.rtol, given.atol)
    limits = [given.rtol, max(given.atol, SMALLEST_SCALE), floor, given.max_step, given.max_steps]
    return np.array([*limits, *([] if own is None else np.maximum(own, SMALLEST_SCALE))], dtype=np.float64)


def _read_limits(numbers: Any) -> Limits:
    """Return the limits of runs from an array of `_limits`."""
    rtol, atol, *others = numbers[:_COMMON]
    return Limits(rtol, numbers[_COMMON:] if len(numbers) > _COMMON else atol, *others)


Final = Callable[[Any, Any], Any]
_STATUSES = {int(status): status for status in Status}


def final_function(pieces: RunPieces, kernels: ArrayKernels, operations: int) -> Final:
    """Return the compiled function (state and p, numbers of the problem) -> the final state and the status.

    Each is one array: every other costs a run a microsecond or more. `operations` is the length of the code of a step.
    """
    n = len(kernels.program.layout.state)

    def run(given: Any, numbers: Any) -> Any:
        y, c = given[:n], kernels.constants(given[n:])
        record = Runs(pieces, _read_limits(numbers[2:])).one(0, numbers[:2], y, c, jnp.zeros(0))
        return jnp.append(record.end, record.status)

    function: Final = compiled(run, operations)
    return function


def prepared_run(
    program: Program, function: Final, problem: IntegrationProblem, admission: Admission | None
) -> Prepared:
    """Return a prepared run of a function that `final_function` made; `admission` tests what it is given."""
    settings = (problem.t0, problem.t1, *_limits(program, problem))
    with double_precision():
        numbers = jax.device_put(np.array(settings, dtype=np.float64))

    def run(state: FloatArray, p: FloatArray) -> tuple[FloatArray, Status]:
        with double_precision():
            out = np.array(function(np.concatenate((state, p)), numbers))
        return out[:-1], _STATUSES[int(out[-1])]

    return PreparedStates(run, admission)
