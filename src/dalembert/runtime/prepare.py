"""Prepared runs of models: fixed span, method and tolerances."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import FloatArray
from ..codegen.llvm.admission import Admission
from ..codegen.runs import Final, Prepared, PreparedStates
from ..integrators.problem import IntegrationProblem
from ..ir.decay_rates import along_run, decay_rate_among
from ..ir.interpret import interpret
from ..ir.program import KnotSides
from ..methods.status import Status
from ..once import derived_once
from ..options import PrepareOptions
from ..reduction.invariant_projection import refuse_formulation
from . import inputs
from .dependent_starts import runs_from_dependent, simulated
from .elapsed import begins_elsewhere, extension, in_elapsed_time
from .inputs import span_of
from .invariant_projection import keeping_model, kept_values, refuse_unknown
from .prepared import PreparedRun
from .segment_constants import starting_constants

if TYPE_CHECKING:
    from .model import CompiledModel

__all__ = ["prepare", "prepare_in_own_time"]


def prepare(model: CompiledModel, t_span: tuple[float, float], options: PrepareOptions) -> PreparedRun:
    """Return a function from a state and parameters to the final state; see `CompiledModel.prepare`."""
    t0, t1 = t_span = span_of(t_span)
    again, given = partial(prepare, model, t_span, options), options.inputs
    if given is not None:
        given.refuse_span(t0, t1)
    other = in_elapsed_time(model, t0, t1)[0] if begins_elsewhere(t0, t1) else None
    if other is None:
        run_prepared = prepare_in_own_time
        if model.modes is not None:
            from .hybrid.prepare import prepare_with_contacts as run_prepared
        method, run = run_prepared(model, t_span, options)
        return PreparedRun(run, method, model.layout, again, given, t_span)
    elapsed = options if given is None else replace(options, inputs=given.counted_from(t0))
    kept, offsets = prepare(other, (0.0, t1 - t0), elapsed), other.equations.symbols.offsets
    if not offsets:
        return kept
    extended = extension(other.layout.parameters, model.layout.parameters, offsets, t0)

    def run_extended(state: FloatArray, p: FloatArray) -> Final:
        final = kept(state, extended(p))
        return final, kept.status

    return PreparedRun(PreparedStates(run_extended), kept.method, model.layout, again, given, t_span)


def prepare_in_own_time(
    model: CompiledModel, t_span: tuple[float, float], options: PrepareOptions
) -> tuple[str, Prepared]:
    """Return the method and the run of a model without contacts, in the time of the model."""
    method = model.choose_method(options.method, options.rtol, options.atol)
    if options.project_invariants is not False:
        refuse_formulation(model.stages.reduced)
        refuse_unknown(options.project_invariants, model.derived.invariants)
        return method, _prepared_keeping(model, t_span, options)
    inputs.warn_below_floor(options.rtol, options.atol, model.stages.program, method)
    tests = model.derived.admission
    otherwise = runs_from_dependent(model, t_span, method, options)
    admission = None if tests is None else Admission(tests, t_span[0], options.rtol, otherwise)
    if not model.layout.state:  # the constraints prescribe the motion
        return method, PreparedStates(lambda state, p: (np.zeros(0), Status.SUCCESS), admission)
    if model.stages.reduced.unproven:  # what follows from others at some places only is looked at along the run
        return method, PreparedStates(lambda state, p: simulated(model, t_span, state, p, method, options))
    sides = model.stages.program.knot_sides
    problem = IntegrationProblem(
        t0=t_span[0],
        t1=t_span[1],
        y0=np.zeros(len(model.layout.state)),
        constants=np.zeros(model.layout.constants),
        rtol=options.rtol,
        atol=options.atol,
        max_step=options.max_step,
        max_steps=options.max_steps,
        inputs=None if options.inputs is None else options.inputs.records(model.layout, sides),
    )
    run = model.engine.prepared(problem, method, lambda p: inputs.constants(model.stages.program, p), admission)
    if t_span[1] < t_span[0] and sides is not None:
        run = _from_knots(model, sides, run, t_span)
    if t_span[1] < t_span[0] and decay_rate_among(model.layout.parameters):
        run = _decaying(model.layout.parameters, run)
    return method, run


def _decaying(names: tuple[str, ...], run: Prepared) -> Prepared:
    """Return a prepared run backward in time whose violations of constraints decay."""

    def decaying(state: FloatArray, p: FloatArray) -> Final:
        final = run(state, along_run(names, p, backward=True))
        return final, run.status()

    return PreparedStates(decaying)


def _from_knots(model: CompiledModel, sides: KnotSides, run: Prepared, t_span: tuple[float, float]) -> Prepared:
    """Return a prepared run backwards in time that begins on the side of a knot to which it goes."""
    program, size = model.stages.program, len(model.layout.state)

    def start(state: FloatArray, p: FloatArray) -> tuple[FloatArray, Status]:
        c = starting_constants(program, inputs.constants(program, p), *t_span)
        out = interpret(sides.sides, {"t": t_span[0], "y": state.tolist(), "c": c.tolist()})[size:]
        if any(out[size:]):
            return np.full(size, np.nan), Status.INITIAL_STATE
        final = run(np.array(out[:size]), p)
        return final, run.status()

    return PreparedStates(start)


def _prepared_keeping(model: CompiledModel, t_span: tuple[float, float], options: PrepareOptions) -> Prepared:
    """Return a prepared run that keeps first integrals, made when it is first called."""
    t, found, program = np.array([t_span[0]]), model.derived.invariants, model.stages.program
    requested, plain = options.project_invariants, replace(options, project_invariants=False)
    made: dict[str, tuple[PreparedRun, tuple[str, ...]]] = {}

    def run(state: FloatArray, p: FloatArray) -> tuple[FloatArray, Status]:
        c = starting_constants(program, inputs.constants(program, p), *t_span)

        def make() -> tuple[PreparedRun, tuple[str, ...]]:
            keeper, names = keeping_model(model, requested, c, t_span[0], state)
            return prepare(keeper, t_span, plain), names

        kept, names = derived_once(made, "run", make)
        further = kept_values(names, program, found, c[np.newaxis], t, state[np.newaxis], model.engine.rows)
        final = kept(state, np.concatenate([p, *further.values()]))
        return final, kept.status

    return PreparedStates(run)
