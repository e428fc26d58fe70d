"""Prepared runs of closed loops: those that start where constraints depend on each other are run as `simulate` does."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import FloatArray
from ..codegen.runs import Final
from ..errors import InitialStateError, ValueInputError
from ..ir.interpret import interpret_rows
from ..methods.status import Status
from ..options import PrepareOptions, SimulateOptions
from ..reduction.starting import Start
from . import inputs
from .segment_constants import starting_constants
from .simulate import simulate_in_own_time

if TYPE_CHECKING:
    from .model import CompiledModel

__all__ = ["runs_from_dependent", "simulated"]


def runs_from_dependent(
    model: CompiledModel, t_span: tuple[float, float], method: str, options: PrepareOptions
) -> Callable[[FloatArray, FloatArray], Final | None] | None:
    """Return what runs a state where constraints depend on each other as `simulate` does, None for other states.

    None where none of the constraints can depend on others.
    """
    start = model.derived.dependence
    if start is None:
        return None

    def run(state: FloatArray, p: FloatArray) -> Final | None:
        if not _dependent(model, start, t_span, state, p):
            return None
        return simulated(model, t_span, state, p, method, options)

    return run


def _dependent(
    model: CompiledModel, start: Start, t_span: tuple[float, float], state: FloatArray, p: FloatArray
) -> bool:
    """Return whether constraints depend on each other at a state (n_y,), at the start of a span."""
    program = model.stages.program
    c = starting_constants(program, inputs.constants(program, p), *t_span)
    return bool(interpret_rows(start.kernel, np.array(t_span[:1]), state[np.newaxis], c)[0, 0])


def simulated(
    model: CompiledModel,
    t_span: tuple[float, float],
    state: FloatArray,
    p: FloatArray,
    method: str,
    options: PrepareOptions,
) -> Final:
    """Return the final state and the status of a run by `simulate`."""
    layout, nothing = model.layout, np.full_like(state, np.nan)
    program, times = model.stages.program, np.array(t_span[:1])
    c = starting_constants(program, inputs.constants(program, p), *t_span)
    x = interpret_rows(program.kernel("expand"), times, state[np.newaxis], c)[0]
    further = state[len(state) - len(layout.states) :]
    initial = dict(zip(layout.variables, [*x[: 2 * len(layout.coordinates)].tolist(), *further.tolist()], strict=True))
    own = SimulateOptions(
        method=method,
        rtol=options.rtol,
        atol=options.atol,
        max_step=options.max_step,
        max_steps=options.max_steps,
        inputs=options.inputs,
        t_eval=np.array(t_span[1:]),
    )
    try:
        run = simulate_in_own_time(model, t_span, initial, dict(zip(layout.parameters, p.tolist(), strict=True)), own)
    except InitialStateError:
        return nothing, Status.INITIAL_STATE
    except ValueInputError:
        return nothing, Status.ASSUMPTION
    return (run.y[-1].copy() if len(run.t) and run.success else nothing), run.status
