"""Prepared runs of a compiled model: fixed span, method and tolerances."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import FloatArray
from ..codegen.runs import Prepared, PreparedStates
from ..integrators.problem import IntegrationProblem
from ..methods.status import Status
from ..once import derived_once
from ..options import PrepareOptions
from ..reduction.invariant_projection import refuse_formulation
from . import inputs
from .elapsed import begins_elsewhere, extension, in_elapsed_time
from .inputs import span_of
from .invariant_projection import keeping_model, kept_values, refuse_unknown
from .prepared import PreparedRun
from .segment_constants import starting_constants

if TYPE_CHECKING:
    from .model import CompiledModel

__all__ = ["prepare"]


def prepare(model: CompiledModel, t_span: tuple[float, float], options: PrepareOptions) -> PreparedRun:
    """Return a function from a state and parameters to the final state; see `CompiledModel.prepare`."""
    t0, t1 = span_of(t_span)
    again = partial(prepare, model, (t0, t1), options)
    if options.inputs is not None:
        options.inputs.refuse_span(t0, t1)
    if begins_elsewhere(t0, t1):
        other, _, _ = in_elapsed_time(model, t0, t1)
        if other is not None:
            return _prepared_in_elapsed_time(model, other, (t0, t1), options)
    method = model.choose_method(options.method, options.rtol, options.atol)
    if options.project_invariants is not False:
        refuse_formulation(model.stages.reduced)
        refuse_unknown(options.project_invariants, model.derived.invariants)
        return PreparedRun(
            _prepared_keeping(model, (t0, t1), options), method, model.layout, again, options.inputs, (t0, t1)
        )
    inputs.warn_below_floor(options.rtol, options.atol, model.stages.program, method)
    problem = IntegrationProblem(
        t0=t0,
        t1=t1,
        y0=np.zeros(len(model.layout.state)),
        constants=np.zeros(model.layout.constants),
        rtol=options.rtol,
        atol=options.atol,
        max_step=options.max_step,
        max_steps=options.max_steps,
        inputs=None if options.inputs is None else options.inputs.records(model.layout),
    )
    if not model.layout.state:  # the constraints prescribe the motion
        still = PreparedStates(lambda state, p: (np.zeros(0), Status.SUCCESS))
        return PreparedRun(still, method, model.layout, again, options.inputs, (t0, t1))
    run = model.engine.prepared(problem, method, lambda p: inputs.constants(model.stages.program, p))
    return PreparedRun(run, method, model.layout, again, options.inputs, (t0, t1))


def _prepared_in_elapsed_time(
    model: CompiledModel, other: CompiledModel, t_span: tuple[float, float], options: PrepareOptions
) -> PreparedRun:
    """Return a prepared run in the time since its start, by this model or another one of the scene."""
    t0, t1 = t_span
    elapsed = options if options.inputs is None else replace(options, inputs=options.inputs.counted_from(t0))
    kept = prepare(other, (0.0, t1 - t0), elapsed)
    offsets = other.stages.equations.symbols.offsets
    if not offsets:
        return kept
    extended = extension(other.layout.parameters, model.layout.parameters, offsets, t0)

    def run(state: FloatArray, p: FloatArray) -> tuple[FloatArray, Status]:
        final = kept(state, extended(p))
        return final, kept.status

    again = partial(prepare, model, t_span, options)
    return PreparedRun(PreparedStates(run), kept.method, model.layout, again, options.inputs, t_span)


def _prepared_keeping(model: CompiledModel, t_span: tuple[float, float], options: PrepareOptions) -> Prepared:
    """Return a prepared run that keeps first integrals, made when it is first called."""
    t, found, program = np.array([t_span[0]]), model.derived.invariants, model.stages.program
    wanted, plain = options.project_invariants, replace(options, project_invariants=False)
    made: dict[str, tuple[PreparedRun, tuple[str, ...]]] = {}

    def run(state: FloatArray, p: FloatArray) -> tuple[FloatArray, Status]:
        c = starting_constants(program, inputs.constants(program, p), *t_span)

        def make() -> tuple[PreparedRun, tuple[str, ...]]:
            keeper, names = keeping_model(model, wanted, c, t_span[0], state)
            return prepare(keeper, t_span, plain), names

        kept, names = derived_once(made, "run", make)
        further = kept_values(names, program, found, c[np.newaxis], t, state[np.newaxis], model.engine.rows)
        final = kept(state, np.concatenate([p, *further.values()]))
        return final, kept.status

    return PreparedStates(run)
