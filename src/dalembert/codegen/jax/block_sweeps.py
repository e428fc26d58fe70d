"""Sweeps of the JAX backend: all cases of a block in one call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import jax
import numpy as np

from ...arrays import FloatArray
from ...integrators.cases import BlockResult, CaseBlock
from ...integrators.jax.compiling import LARGEST_FUSED
from ...integrators.jax.kernels import Kernels
from ...integrators.jax.lanes import Attempts, Batch, TaylorAttempts, run_batch
from ...integrators.jax.many import diffrax_batch
from ...integrators.jax.pairs import PairAttempts
from ...integrators.jax.precision import double_precision
from ...integrators.jax.projection import CORRECTIONS
from ...integrators.jax.run_data import Limits
from ...integrators.jax.solvers import METHODS
from ...integrators.jax.solvers import Settings as SolverSettings
from ...ir.program import Program
from ...methods.step_constants import SMALLEST_SCALE
from ...once import computed_once
from ...transforms.recurrences import Recurrences
from ...transforms.taylor import clipped_tolerance, order_for, scale_floor, step_kernel
from .foreign import ForeignRuns, row_of_limits
from .kernels import compile_kernel
from .pieces import PAIRS, pieces_of

__all__ = ["BlockSweeps", "padded"]

_SMALLEST_BATCH = 16


def padded(rows: FloatArray) -> FloatArray:
    """Return `rows` with the last one repeated until their number is a power of two."""
    size = max(_SMALLEST_BATCH, 1 << (len(rows) - 1).bit_length())
    return np.concatenate([rows, np.repeat(rows[-1:], size - len(rows), axis=0)])


def _columns(rows: FloatArray) -> tuple[FloatArray, ...]:
    """Return the columns of padded `rows`, one array each."""
    return tuple(np.ascontiguousarray(column) for column in padded(rows).T)


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

    def __init__(self, program: Program, kernels: Kernels, series: Callable[[], Recurrences]) -> None:
        self._program, self._kernels, self._recurrences = program, kernels, series
        self._runners: dict[tuple[str, int], Callable[..., Any]] = {}

    def integrate(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        """Integrate the cases of a block without events; see `Engine.integrate_block`."""
        with double_precision():
            if method in METHODS and METHODS[method].implicit:
                self._diffrax_block(block, method, result)
            elif self._calls_machine_code(method):
                self._called_block(block, method, result)
            else:
                self._own_block(block, method, result)

    def _calls_machine_code(self, method: str) -> bool:
        """Return whether machine code that XLA calls runs the cases: on CPUs."""
        device = jax.config.jax_default_device  # type: ignore[attr-defined]
        platform = getattr(device, "platform", device) or jax.default_backend()
        served = self._program.conditions is None and bool(self._program.layout.state)
        return platform == "cpu" and served and ForeignRuns(self._program, method).serves_batches

    def _called_block(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        """Run cases in one call; those that pad their number to a power of two end where they begin."""
        tolerance = clipped_tolerance(block.rtol, block.atol)
        floor, least = scale_floor(block.rtol, block.atol), max(block.atol, SMALLEST_SCALE)
        limits = Limits(block.rtol, least, floor, block.max_step, block.max_steps)
        order, count = order_for(tolerance) if method == "taylor" else 0, len(block.y)

        def make() -> Callable[..., Any]:
            steps = pieces_of(self._program, self._kernels, method, order).steps
            return ForeignRuns(self._program, method).sweep(limits, steps)

        runner = computed_once(self._runners, (f"call {method}", order), make)
        t, states = padded(block.spans), padded(block.y)
        t[count:, 1] = t[count:, 0]
        if len(block.t_eval):  # whose span is that of all cases
            t = np.concatenate([t[:1, :1], block.t_eval[np.newaxis], t[:1, 1:]], axis=1)
            states[count:] = np.nan
        row = np.array([row_of_limits(limits, method)])
        out, samples = jax.device_get(runner(t, states, padded(block.c), row))
        if len(block.t_eval):
            result.samples[:] = samples[:count, 1:-1]
        result.y[:] = out.end[:count]
        result.ends[:] = np.stack([out.reached, out.status, out.steps], axis=1)[:count]

    def _own_block(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        tolerance = clipped_tolerance(block.rtol, block.atol)
        key = method, order_for(tolerance) if method == "taylor" else 0
        runner = computed_once(self._runners, key, lambda: self._batch_runner(*key))
        batch = Batch(
            y=_columns(block.y),
            c=_columns(block.c),
            t0=padded(block.spans[:, 0]),
            t1=padded(block.spans[:, 1]),
            t_eval=np.asarray(block.t_eval, dtype=np.float64),
            floor=np.float64(scale_floor(block.rtol, block.atol)),
            rtol=np.float64(block.rtol),
            atol=np.float64(max(block.atol, SMALLEST_SCALE)),
            max_step=np.float64(block.max_step),
            max_steps=np.float64(block.max_steps),
        )
        out = jax.device_get(runner(batch))
        count = len(block.y)
        result.y[:] = np.stack(out.y, axis=1)[:count]
        result.ends[:] = np.stack([out.t, out.status, out.steps], axis=1)[:count]
        if len(block.t_eval):
            result.samples[:] = out.samples.transpose(2, 0, 1)[:count]

    def _batch_runner(self, method: str, order: int) -> Callable[..., Any]:
        """Return the loop of a method over a batch of cases."""
        projections = [
            (compile_kernel(self._program.kernel(name)), count)
            for name, count in CORRECTIONS.items()
            if name in self._program
        ]
        attempts: Attempts
        if method == "taylor":
            step = step_kernel(self._recurrences(), order, dense=False)
            step_growth_limited = self._recurrences().step_growth_limited
            attempts, operations = (
                TaylorAttempts(compile_kernel(step), step_growth_limited=step_growth_limited),
                len(step.body),
            )
        else:
            rhs = self._program.kernel("rhs")
            knots = compile_kernel(self._program.kernel("knots")) if "knots" in self._program else None
            attempts = PairAttempts(
                compile_kernel(rhs), PAIRS[method], moved=bool(projections), knots=knots, operations=len(rhs.body)
            )
            operations = LARGEST_FUSED + 1
        return run_batch(attempts, projections, operations + self._kernels.correction_operations)

    def _diffrax_block(self, block: CaseBlock, method: str, result: BlockResult) -> None:
        key = method, 0
        runner = computed_once(self._runners, key, lambda: diffrax_batch(self._kernels, method))
        spans = padded(block.spans)
        direction = np.where(spans[:, 1] >= spans[:, 0], 1.0, -1.0)
        settings = SolverSettings(
            direction,
            direction * spans[:, 0],
            direction * spans[:, 1],
            padded(block.c),
            np.float64(block.rtol),
            np.float64(block.atol),
            np.float64(0.0),
            np.float64(block.max_step),
        )
        t_eval, budget = np.asarray(block.t_eval, dtype=np.float64), np.int64(block.max_steps)
        out = jax.device_get(runner(settings, padded(block.y), t_eval, budget))
        count = len(block.y)
        result.y[:], result.ends[:] = out[0][:count], out[2][:count]
        if len(t_eval):
            result.samples[:] = out[1][:count]
