"""Runs with events as exports take them: the arguments of the loop over lanes for a run alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..codegen.c.descriptions import EventRun
from ..codegen.c.library import CFunctions, CLibrary
from ..codegen.c.printing import prefix_of
from ..codegen.kernel_code import KernelCode
from ..codegen.lane_runs import LaneRuns
from ..codegen.steppers import Steppers
from ..events.event_code import Event
from ..ir.kernel import Kernel
from ..ir.program import Program, coefficient_places
from ..lanes.sweep_arguments import no_columns, no_part_samples
from ..lanes.workspace import EventWorkspace
from ..reduction.sampling_kernels import SamplingKernels, sampling_kernels
from ..steps.problem import IntegrationProblem
from ..stops.break_tables import BreakTable, break_kernels, breaks_of
from ..stops.input_records import InputTable, no_inputs
from ..stops.instants import InstantTable, instants_of, no_instants, stops_at_instants
from ..stops.stops import StopTable, no_stops
from ..subset.arguments import NO_CODE, OwnedAddress

if TYPE_CHECKING:
    from ..model.model import CompiledModel

_NEVER = -1
"""Patience with which a loop returns where its record is full, and not before."""


def exported_workspace(workspace: EventWorkspace) -> EventWorkspace:
    """Return the memory of events with one row more than is filled: compilers of C see that none is written behind."""
    found = workspace.found
    return workspace._replace(found=np.zeros((len(found) + 1, found.shape[1])))


def stops_of_controllers(
    sampling: SamplingKernels | None,
    code: Callable[[Kernel], OwnedAddress],
    inputs: InputTable,
    breaks: BreakTable | None = None,
) -> tuple[StopTable, InstantTable]:
    """Return the stops of a run with inputs, controllers (whose kernels are code) and breaks; then those two alone."""
    if sampling is None:
        stops = no_stops(inputs) if breaks is None else stops_at_instants((), (), inputs, breaks)
        return stops, no_instants(breaks)
    laws = [action.kernel for action in sampling.actions]
    places, codes = [action.places for action in sampling.actions], [code(law) for law in laws if law is not None]
    instants = instants_of(code(sampling.times), len(laws), breaks)
    return stops_at_instants(places, codes, inputs, breaks), instants


def event_run(
    model: CompiledModel,
    events: Sequence[Event],
    method: str,
    tolerances: tuple[float, float],
    span: tuple[float, float],
    *,
    continued: bool = False,
) -> EventRun:
    """Return the loop of a run with events by a method; `continued`: it continues behind any end, and carries signs.

    Raises
    ------
    ExpressionError, UnknownNameError
        For events that cannot be watched, and for what cannot jump.
    """
    program, (rtol, atol) = model.stages.program, tolerances
    functions = CFunctions(prefix_of(program.name))
    library = CLibrary(program, functions)
    code = KernelCode(program, library)
    lanes = LaneRuns(library, code, Steppers(library, program), program.layout)
    n, constants = len(program.layout.state), len(program.kernel("prepare").outputs)
    problem = IntegrationProblem(
        t0=span[0],
        t1=span[1],
        y0=np.zeros(n),
        constants=np.zeros(constants),
        rtol=rtol,
        atol=atol,
        dense=True,
        bounded=True,
    )
    watch = model.derived.events(tuple(events))
    assert watch is not None
    carried = np.tile([np.nan, 0.0], len(events)) if continued else None
    made = lanes.recorded_lane(problem, method, watch, carried).arguments
    made.state.progress.patience, made.state.progress.returns = _NEVER, 1
    made.happened[0, ::3] = 0.0
    part = no_part_samples()._replace(clock=np.zeros((1, 1)), states=np.zeros((n, 1)))
    inputs, shape, sampling = no_inputs(), made.shape, sampling_kernels(model.stages.reduced)
    breaks = _breaks(program, functions)
    stopped = bool(program.layout.inputs) or sampling is not None or continued or breaks is not None
    if stopped:
        places = np.array(coefficient_places(program.layout.parameters, program.layout.inputs), np.int64)
        memory = np.zeros((n + 2 + shape.memory, 1))
        inputs = inputs._replace(places=places, ends=np.zeros((1, 1)), remembered=memory)
    stops, instants = stops_of_controllers(sampling, partial(code.of, lanes=1), inputs, breaks)
    prepare = NO_CODE if breaks is None else functions.number(f"{functions.prefix}_constants")
    arguments = made._replace(
        kernels=made.kernels._replace(prepare=prepare),
        stops=stops,
        columns=no_columns(),
        workspace=exported_workspace(made.workspace),
        steps=made.steps[:1].copy(),
        part=part,
    )
    return EventRun(
        events=tuple(event.label for event in events),
        arguments=arguments,
        functions=functions,
        implicit=method == "radau",
        stops=stopped,
        instants=instants,
        values=watch.watch.values,
    )


def _breaks(program: Program, functions: CFunctions) -> BreakTable | None:
    """Return the table of the conditions of a program, whose kernels the simulator prints."""
    if program.conditions is None:
        return None
    codes = {name: functions.number(f"{functions.prefix}_{name}") for name in break_kernels(program.conditions)}
    return breaks_of(program.conditions, codes, len(program.layout.parameters), len(program.kernel("prepare").outputs))
