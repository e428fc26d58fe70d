"""Derivatives of one trajectory of a compiled model by parameters and initial values."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import OptionError, UnknownNameError
from ..options import NamedTolerances, SensitivityOptions
from ..reduction.variational import input_of, weight_of
from ..results.analyses import Sensitivity
from ..runs.elapsed import begins_elsewhere, elapsed_times, in_elapsed_time, noted_from, with_offsets
from ..runs.simulate import ended_early
from ..scene.expressions.elapsed import Offset
from ..scene.symbol_table import SymbolTable
from ..starts import inputs
from ..starts.constraint_choice import divisible_model, independent_model
from ..starts.initial_states import directed, initial_state
from ..starts.input_values import GivenInputs
from ..starts.inputs import span_of
from ..starts.segment_constants import starting_constants
from ..steps.problem import IntegrationProblem
from ..stops.samples import Samples, samples
from ..values import listed
from .variation import chosen_names, through_offsets

if TYPE_CHECKING:
    from ..model.model import CompiledModel


# Names of values of inputs by which runs are differentiated, and the weights of these values.

_MOST = 2000
"""Largest number of values of inputs to differentiate by: each is another column of equations."""


def value_names(inputs: GivenInputs, symbols: SymbolTable, wrt: Sequence[str]) -> list[str]:
    """Return names of the variables of differentiation, with "u[0]", "u[1]", ... in place of an input u with samples.

    Raises
    ------
    OptionError
        For more values of inputs than are differentiated by.
    UnknownNameError
        For values that an input does not have.
    """
    found: list[str] = []
    for name in wrt:
        stem = input_of(name, symbols)
        value = None if stem is None else inputs.values[stem]
        known = [f"{stem}[{i}]" for i in range(len(value.t))] if isinstance(value, Samples) else [str(stem)]
        if isinstance(value, Samples) and value.function:
            raise OptionError(
                f"input {stem!r} is a function, which has no values to differentiate by: give it as"
                " dalembert.samples(times, values, kind), or write it into the scene with parameters"
            )
        if stem is None or name in known:
            found.append(name)
        elif name == stem:
            found += known
        else:
            raise UnknownNameError(
                f"{name!r} is no value of the input {stem!r}, which has "
                + (f"{known[0]!r} to {known[-1]!r}" if len(known) > 1 else f"one, {known[0]!r}")
            )
    count = sum(input_of(name, symbols) is not None for name in found)
    if count > _MOST:
        raise OptionError(
            f"derivatives by {count} values of inputs, of which there are {_MOST} at most: name some of them, such as"
            f" {next(name for name in found if input_of(name, symbols))!r}; or take the gradient of a number by all of"
            ' them with the solve function of model.solve_fn(...), backend="jax"'
        )
    return found


def with_weights_of(inputs: GivenInputs, symbols: SymbolTable, wrt: Sequence[str]) -> GivenInputs:
    """Return inputs and, beside them, the weights of those of their values by which a run is differentiated."""
    weights: dict[str, float | Samples] = {}
    for name in wrt:
        stem = input_of(name, symbols)
        if stem is None:
            continue
        value = inputs.values[stem]
        if not isinstance(value, Samples):
            weights[weight_of(name)] = 1.0
            continue
        place = int(name.partition("[")[2][:-1])
        unit = np.zeros(len(value.t))
        unit[place] = 1.0
        weights[weight_of(name)] = samples(value.t, unit, value.kind, value.extrapolate)
    return replace(inputs, values={**inputs.values, **weights}) if weights else inputs


Given = Mapping[Any, Any]

_BLOCK = 100
"""Number of values of inputs and others by which one run is differentiated; for more there are several runs."""


def differentiate_run(
    model: CompiledModel, t_span: tuple[float, float], initial: Given, parameters: Given, options: SensitivityOptions
) -> Sensitivity:
    """Return one trajectory with derivatives; see `CompiledModel.sensitivity`."""
    t0, t1 = span_of(t_span)
    if options.inputs is not None:
        options.inputs.refuse_span(t0, t1)
        parameters = options.inputs.parameters(parameters, t0, after=t1 >= t0)
        options = replace(options, wrt=_variables(model, options))
        if len(options.wrt) > _BLOCK:
            return _in_blocks(model, (t0, t1), initial, parameters, options)
    return _one_run(model, (t0, t1), initial, parameters, options)


def _in_blocks(
    model: CompiledModel, t_span: tuple[float, float], initial: Given, parameters: Given, options: SensitivityOptions
) -> Sensitivity:
    """Return the derivatives by many values, from a run for each block of them, at the times of the first run."""
    runs: list[Sensitivity] = []
    for first in range(0, len(options.wrt), _BLOCK):
        times = runs[0].t if runs and options.t_eval is None else options.t_eval
        block = replace(options, wrt=options.wrt[first : first + _BLOCK], t_eval=times)
        runs.append(_one_run(model, t_span, initial, parameters, block))
    count = min(len(run.t) for run in runs)
    return replace(
        runs[0],
        t=runs[0].t[:count],
        wrt=tuple(name for run in runs for name in run.wrt),
        values=runs[0].values[:count],
        jacobians=np.concatenate([run.jacobians[:count] for run in runs], axis=2),
        status=next((run.status for run in runs if not run.success), runs[0].status),
        steps=sum(run.steps for run in runs),
    )


def _one_run(
    model: CompiledModel, t_span: tuple[float, float], initial: Given, parameters: Given, options: SensitivityOptions
) -> Sensitivity:
    """Return one trajectory with derivatives; inputs are among the parameters."""
    t0, t1 = t_span
    other = in_elapsed_time(model, t0, t1)[0] if begins_elsewhere(t0, t1) else None
    if other is None:
        return _in_own_time(model, (t0, t1), initial, parameters, options)
    times = options.t_eval
    given = with_offsets(model, other, t0, parameters)
    requested = [options.wrt] if isinstance(options.wrt, str) else list(options.wrt)
    offsets = _offsets(model, other, requested)
    if options.inputs is not None:
        options = replace(options, inputs=options.inputs.counted_from(t0))
        given = options.inputs.parameters(given, 0.0, after=t1 >= t0)
    more = replace(options, t_eval=elapsed_times(t0, t1, times), wrt=[*requested, *(offset.name for offset in offsets)])
    try:
        found = _in_own_time(other, (0.0, t1 - t0), initial, given, more)
    except OptionError as refusal:
        raise OptionError(noted_from(str(refusal), t0)) from None
    if offsets:
        found = through_offsets(found, offsets, t0, inputs.named_parameters(model, parameters))
    return replace(found, t=t0 + found.t if times is None else times[: len(found.t)])


def _variables(model: CompiledModel, options: SensitivityOptions) -> Any:
    """Return the names of the variables of differentiation, with the values of inputs one by one."""
    assert options.inputs is not None
    layout = model.layout
    given = listed("wrt", options.wrt, "names or symbols")
    names = [key if str(key) in layout.given else layout.aliases.get(str(key), str(key)) for key in given]
    return value_names(options.inputs, model.stages.equations.symbols, [str(name) for name in names])


def _offsets(model: CompiledModel, other: CompiledModel, requested: list[Any]) -> list[Offset]:
    """Return the offsets of time that depend on the variables of differentiation."""
    names = {model.layout.aliases.get(str(w), str(w)) for w in requested}
    every = other.stages.equations.symbols.offsets
    return [offset for offset in every if any(symbol.name in names for symbol in offset.symbols)]


def _in_own_time(
    model: CompiledModel, t_span: tuple[float, float], initial: Given, parameters: Given, options: SensitivityOptions
) -> Sensitivity:
    """Return one trajectory with derivatives, in the time of the model."""
    t0, t1 = t_span
    program = model.stages.program
    p = model.parameter_vector(parameters)
    values = model.initial_values(initial)
    able = divisible_model(model, t0, initial, parameters)
    if able is not model:
        return _in_own_time(able, t_span, initial, parameters, options)
    start, begun = model.derived.start(values), directed(values, t0, t1)
    symbols = model.stages.equations.symbols
    of, wrt = chosen_names(program, start.given, options.of, options.wrt, symbols)
    c = starting_constants(program, inputs.constants(program, p), t0, t1)
    problem = IntegrationProblem(
        t0=t0,
        t1=t1,
        y0=initial_state(model.derived.start(begun), t0, begun, c, program),
        constants=c,
        rtol=options.rtol,
        atol=options.atol,
        t_eval=options.t_eval,
        max_steps=options.max_steps,
        inputs=None if options.inputs is None else options.inputs.records(program.layout),
    )
    found = independent_model(model, problem, options.method, time.perf_counter())
    if found is not model and isinstance(found, type(model)):
        return _in_own_time(found, t_span, initial, parameters, replace(options, of=of, wrt=wrt))
    variation = model.derived.variation(start.given, of, wrt)
    if isinstance(options.atol, NamedTolerances):
        size = len(program.layout.state)
        own = options.atol.with_derivatives(variation.program.layout.state, size)
        problem = replace(problem, atol=own)
    if options.automatic:
        method = variation.engine.automatic(model.methods, options.rtol, options.atol)
    else:
        method = model.choose_method(options.method, options.rtol, options.atol)
    given = np.array([values[name] for name in start.given])
    weighed = None if options.inputs is None else with_weights_of(options.inputs, symbols, wrt)
    problem, status = ended_early(model, problem)
    run = variation.run(problem, given, p, method, weighed)
    status = run.status if status is None or not run.status.success else status
    return replace(run, status=status, aliases=model.layout.aliases)
