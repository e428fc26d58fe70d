"""Runs of the JAX backend as one compiled function each: prepared runs, and sweeps of all cases of a block."""

from __future__ import annotations

from collections.abc import Callable
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
from ..steps.problem import IntegrationProblem
from ..transforms.recurrences import Recurrences
from ..transforms.taylor import order_at, scale_floor, step_kernel
from .pieces import constants_of_segments, pieces_of
from .runs.kernels import ArrayKernels
from .runs.precision import LARGEST_FUSED, compiled, double_precision
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
        self._runners: dict[tuple[str, int, bool], Callable[..., Any]] = {}

    def integrate(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        """Integrate the cases of a block without events; see `Engine.integrate_block`.

        Cases that pad their number to a power of two end where they begin.
        """
        order, count = order_at(block.rtol, block.atol) if method == "taylor" else 0, len(block.y)
        key = method, order, bool(len(block.t_eval))
        t, states = padded(block.spans), padded(block.y)
        t[count:, 1] = t[count:, 0]
        if len(block.t_eval):  # whose span is that of all cases
            t = np.concatenate([t[0, :1], block.t_eval, t[0, 1:]])
            states[count:] = np.nan
        least, floor = max(block.atol, SMALLEST_SCALE), scale_floor(block.rtol, block.atol)
        limits = np.array([block.rtol, least, floor, block.max_step, block.max_steps], dtype=np.float64)
        with double_precision():
            runner = computed_once(self._runners, key, lambda: self._runner(*key))
            reached, record = jax.device_get(runner(t, states, padded(block.c), limits))
        result.samples[:] = reached.y[:count, 1:-1]
        result.y[:] = record.end[:count]
        result.ends[:] = np.stack([record.reached, record.status, record.steps], axis=1)[:count]

    def _runner(self, method: str, order: int, timed: bool) -> Callable[..., Any]:
        """Return the function (times, states, constants, limits) -> how the cases went, compiled once for all limits.

        Times are rows, or where they are `timed` those of all cases.
        """
        pieces = pieces_of(self._program, self._kernels, method, order, constants_of_segments(self._program))

        def cases(t: Any, y: Any, c: Any, limits: Any) -> Any:
            runs = Runs(pieces, Limits(*limits))
            each: Any = jax.vmap(lambda t, y, c: runs.run(0, t, y, c, jnp.zeros(0))[:2], (None if timed else 0, 0, 0))
            return each(t, y, c)

        operations = LARGEST_FUSED + 1  # Runge-Kutta attempts are faster unfused, whatever their length
        if method == "taylor":
            operations = len(step_kernel(self._recurrences(), order, dense=False).body)
        return compiled(cases, operations + self._kernels.correction_operations)


Final = Callable[[Any, Any], Any]
_STATUSES = {int(status): status for status in Status}


def final_function(pieces: RunPieces, kernels: ArrayKernels, operations: int) -> Final:
    """Return the compiled function (state and p, numbers of the problem) -> the final state and the status.

    Each is one array: every other costs a run a microsecond or more. `operations` is the length of the code of a step.
    """
    n = len(kernels.program.layout.state)

    def run(given: Any, numbers: Any) -> Any:
        y, c = given[:n], kernels.constants(given[n:])
        record = Runs(pieces, Limits(*numbers[2:])).one(0, numbers[:2], y, c, jnp.zeros(0))
        return jnp.append(record.end, record.status)

    function: Final = compiled(run, operations)
    return function


def prepared_run(function: Final, problem: IntegrationProblem, admission: Admission | None) -> Prepared:
    """Return a prepared run of a function that `final_function` made; `admission` tests what it is given."""
    floor = scale_floor(problem.rtol, problem.atol)
    scale = max(problem.atol, SMALLEST_SCALE)
    settings = (problem.t0, problem.t1, problem.rtol, scale, floor, problem.max_step, float(problem.max_steps))
    with double_precision():
        numbers = jax.device_put(np.array(settings, dtype=np.float64))

    def run(state: FloatArray, p: FloatArray) -> tuple[FloatArray, Status]:
        with double_precision():
            out = np.array(function(np.concatenate((state, p)), numbers))
        return out[:-1], _STATUSES[int(out[-1])]

    return PreparedStates(run, admission)
