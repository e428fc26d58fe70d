"""Prepared runs: one compiled function from a state and parameters to the final state."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from ..arrays import FloatArray
from ..codegen.runs import Prepared, PreparedStates
from ..methods.status import Status
from ..methods.step_constants import SMALLEST_SCALE
from ..steps.problem import IntegrationProblem
from ..transforms.taylor import scale_floor
from .runs.compiling import compiled
from .runs.precision import double_precision
from .runs.run_data import Limits, RunPieces
from .runs.runs import Runs

if TYPE_CHECKING:
    from ..codegen.llvm.prepared import Admission
    from .runs.kernels import ArrayKernels

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
