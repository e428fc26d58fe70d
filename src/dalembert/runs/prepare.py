"""Prepared runs of models: fixed span, method and tolerances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import FloatArray
from ..codegen.llvm.prepared import Admission
from ..codegen.runs import Final, Prepared, PreparedStates
from ..errors import InitialStateError, ValueInputError
from ..ir.interpret import interpret, interpret_rows
from ..ir.program import KnotSides, along_run, decay_rate_among
from ..methods.status import Status
from ..once import derived_once
from ..options import PrepareOptions, SimulateOptions
from ..reduction.invariant_projection import refuse_formulation
from ..starts import inputs
from ..starts.constraint_choice import dependent_at_start
from ..starts.first_integrals import keeping_model, kept_values, refuse_unknown
from ..starts.inputs import span_of
from ..starts.segment_constants import starting_constants
from ..steps.problem import IntegrationProblem
from .elapsed import begins_elsewhere, extension, in_elapsed_time
from .prepared_run import PreparedRun
from .run_check import FAILED
from .sampling import diverged, free_places
from .simulate import simulate_in_own_time

if TYPE_CHECKING:
    from ..model.model import CompiledModel


# Prepared runs of closed loops: those that start where constraints depend on each other are run as `simulate` does.


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
        if not dependent_at_start(model.stages.program, start, t_span, state, p):
            return None
        return simulated(model, t_span, state, p, method, options)

    return run


def simulated(
    model: CompiledModel,
    t_span: tuple[float, float],
    state: FloatArray,
    p: FloatArray,
    method: str,
    options: PrepareOptions,
    *,
    recorded: bool = False,
) -> Final:
    """Return the final state and the status of a run by `simulate`, whose steps are `recorded` or not."""
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
        t_eval=None if recorded else np.array(t_span[1:]),
    )
    try:
        run = simulate_in_own_time(model, t_span, initial, dict(zip(layout.parameters, p.tolist(), strict=True)), own)
    except InitialStateError:
        return nothing, Status.INITIAL_STATE
    except ValueInputError:
        return nothing, Status.ASSUMPTION
    return (run.y[-1].copy() if len(run.t) and run.success else nothing), run.status


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
            from ..phases.given_values import prepare_with_contacts as run_prepared
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
    reduced = model.stages.reduced
    if reduced.unproven or reduced.equations.kinked_locks:  # which are looked at along the run
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
    return method, _watched(model, t_span, method, options, run) if model.controllers else run


def _watched(
    model: CompiledModel, t_span: tuple[float, float], method: str, options: PrepareOptions, run: Prepared
) -> Prepared:
    """Return a prepared run of a scene with controllers, which has the status of an unstable loop where it is one.

    Where the state that a failed run reached is not known, it is run again as `simulate` does.
    """
    free = free_places(model.layout)

    def watched(state: FloatArray, p: FloatArray) -> Final:
        final, status = run(state, p), run.status()
        if diverged([status], state[np.newaxis, free], final[np.newaxis, free])[0]:
            return final, Status.DIVERGED
        if status in FAILED and np.isnan(final).any():
            status = simulated(model, t_span, state, p, method, options, recorded=True)[1]
        return final, status

    return PreparedStates(watched)


def _decaying(names: tuple[str, ...], run: Prepared) -> Prepared:
    """Return a prepared run backward in time whose violations of constraints decay."""

    def decaying(state: FloatArray, p: FloatArray) -> Final:
        return run(state, along_run(names, p, backward=True)), run.status()

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
