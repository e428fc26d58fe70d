"""Parts of a model that its simulator in C is made of, and checks that it can be exported."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..codegen.c.descriptions import CSource
from ..codegen.c.fixed_simulator import start_in_single
from ..errors import OptionError, unknown_name
from ..events.event_code import Event
from ..ir.conditions import CONDITION_TIME
from ..methods.names import PAIRS
from ..reduction.admission import admission_of_state
from ..reduction.jumps import has_jumps
from ..reduction.sampling_kernels import sampling_kernels
from ..reduction.starting import Start, starting
from ..runs.coordinate_checks import GimbalCheck
from ..starts.initial_states import initial_state
from ..starts.inputs import constants
from ..starts.segment_constants import starting_constants
from ..starts.symbol_assumptions import ROUNDING
from .event_runs import event_run
from .kinds import refuse_inputs, refuse_scene

if TYPE_CHECKING:
    from ..model.model import CompiledModel


def method_of(model: CompiledModel, method: Any, rtol: float, atol: float) -> str:
    """Return the method of an export.

    Raises
    ------
    OptionError
        For a method that there is not.
    """
    known = ("auto", "taylor", *PAIRS, "radau")
    if not isinstance(method, str) or method not in known:
        raise OptionError(unknown_name("method", str(method), known))
    return model.engine.automatic(("taylor", "dop853"), rtol, atol) if method == "auto" else str(method)


def start_of(model: CompiledModel, initial: Mapping[str, float] | None) -> Start:
    """Return the start from initial values of the given names, by default from all coordinates, rates and states.

    Raises
    ------
    InitialStateError
        When something is neither given nor fixed by a constraint.
    """
    names: Sequence[str] = model.layout.variables if initial is None else tuple(initial)
    return starting(model.stages.reduced, sorted(set(names)))


def c_source(
    model: CompiledModel,
    initial: Mapping[str, float] | None,
    numbers: Mapping[str, float],
    method: str,
    tolerances: tuple[float, float],
    span: tuple[float, float],
    step: float | None = None,
    precision: str = "double",
    *,
    events: Sequence[Event] = (),
    continued: bool = False,
) -> CSource:
    """Return what the C source of a model is made of; see `dalembert.model.exports.export` for the arguments.

    `continued`: for a unit, whose runs go on behind any time at which a step has ended, with contacts and controllers.

    Raises
    ------
    CapabilityError, InitialStateError, OptionError
        For what is not exported, and for initial values that are not enough.
    """
    if model.modes is not None:
        from .contact_runs import contact_source

        return contact_source(model, initial, numbers, method, tolerances, span, events, continued=continued)
    refuse_scene(model)
    start = start_of(model, initial)
    refuse_inputs(model, start)
    reduced = model.stages.reduced
    admission, single = admission_of_state(reduced, ROUNDING), precision != "double"
    check = GimbalCheck.of(model)
    chosen = method_of(model, method, *tolerances) if step is None else method
    return CSource(
        program=model.stages.program,
        start=start_in_single(start) if single else start,
        admission=admission,
        dependent=model.derived.dependence is not None,
        method=chosen,
        tolerances=tolerances,
        forward_only=has_jumps(reduced) or bool(model.controllers),
        numbers=numbers,
        span=span,
        locks=None if check is None else check.found.kernel,
        locking=() if check is None else locking_groups(model, check, start, numbers, span),
        step=step,
        single=single,
        sampling=sampling_kernels(reduced),
        events=event_run(model, events, chosen, tolerances, span, continued=continued) if events else None,
        continued=continued,
    )


def locking_groups(
    model: CompiledModel, check: GimbalCheck, start: Start, numbers: Mapping[str, float], span: tuple[float, float]
) -> tuple[int, ...]:
    """Return the groups of angles at whose lock a run ends: all that may be singular there.

    Where the example says how the scene moves, those are left out at which its motions are regular.
    """
    program, layout = model.stages.program, model.layout
    wanted = (*start.given, *(name for name in layout.parameters if name != CONDITION_TIME))
    if not all(name in numbers for name in wanted):
        return tuple(range(len(check.found.kernel.outputs)))
    p = np.array([numbers.get(name, 0.0) for name in layout.parameters])
    c = starting_constants(program, constants(program, p), *span)
    y = initial_state(start, span[0], numbers, c, program)
    return tuple(check.locking(span[0], y, c))
