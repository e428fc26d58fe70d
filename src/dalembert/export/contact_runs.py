"""Runs with contacts as exports take them: all modes of the contacts, and the arguments of their loops for one case."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..codegen import backend_named
from ..codegen.c.contact_loops import ContactLoop, ContactMode
from ..codegen.c.descriptions import CSource
from ..codegen.c.library import CFunctions, CLibrary
from ..codegen.c.printing import prefix_of
from ..codegen.compiled_engine import CompiledEngine
from ..contacts.equations.contact_laws import Mode
from ..contacts.phase_maps import no_maps
from ..contacts.phase_stops import PhaseStops
from ..contacts.phase_tables import ANY_PHASE
from ..errors import CapabilityError, ConstraintError, SingularMassMatrixError
from ..events.event_code import Event
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..lanes.sweep_arguments import SweepArguments
from ..options import PrepareOptions
from ..phases.case_runs import CaseRuns
from ..phases.given_values import open_contacts
from ..phases.mode_models import ModeModels
from ..phases.mode_runners import FIRST_PARAMETER, GatheredRows, ModeRunner
from ..phases.output_values import PhaseReductions
from ..phases.runner_choice import RunnerChoice
from ..phases.velocity_jumps import EventJumps
from ..pipeline import Compiled
from ..reduction.admission import admission_of_state
from ..reduction.jumps import has_jumps
from ..reduction.starting import starting
from ..runs.coordinate_checks import GimbalCheck
from ..starts.symbol_assumptions import ROUNDING
from ..stops.input_records import no_inputs
from ..stops.instants import InstantTable, no_instants
from ..subset.arguments import NO_CODE
from ..transforms.passes import EliminateDeadCode
from ..transforms.taylor.periodic import angles_of
from .event_runs import exported_workspace, stops_of_controllers
from .kinds import refuse_contact_scene, refuse_inputs, refuse_program

if TYPE_CHECKING:
    from ..model.model import CompiledModel

MOST_MODES = 12
"""Modes that an export carries, some 5000 lines each: those of two contacts that open, slip and stick, and of one more
that does two of these."""


def modes_of(modes: ModeModels) -> list[Mode]:
    """Return all combinations of what the contacts may do.

    Raises
    ------
    CapabilityError
        Where there are more than `MOST_MODES`.
    """
    automaton = modes.automaton
    states = [automaton.states(i) for i in range(len(automaton.contacts))]
    count = int(np.prod([len(each) for each in states], dtype=object))
    if count > MOST_MODES:
        raise CapabilityError(
            f"the contacts of {modes.equations.name!r} have {count:,} combinations of being open, sliding and sticking,"
            f" and exports carry up to {MOST_MODES}, each of which has code of its own: export a scene with fewer"
            " contacts, or one mode, model.mode(...).export(...)"
        )
    return list(dict.fromkeys(automaton.with_followers(mode) for mode in itertools.product(*states)))


def _time(modes: ModeModels, span: tuple[float, float]) -> dict[str, float]:
    return {modes.equations.symbols.time: span[0]}


def contact_source(
    model: CompiledModel,
    initial: Mapping[str, float] | None,
    numbers: Mapping[str, float],
    method: str,
    tolerances: tuple[float, float],
    span: tuple[float, float],
    events: Sequence[Event] = (),
    *,
    continued: bool = False,
) -> CSource:
    """Return what the C source of a scene with contacts is made of; see `dalembert.export.simulator.c_source`.

    `continued`: its runs go on behind any time at which a step has ended.

    Raises
    ------
    CapabilityError, InitialStateError, OptionError
        For what is not exported, and for initial values that are not enough.
    """
    modes = model.modes
    assert modes is not None
    refuse_contact_scene(modes)
    names = sorted(set(modes.layout.variables if initial is None else initial))
    fitting = _methods_of_example(model, names, numbers, tolerances, span, events) if method == "auto" else {}
    loop = contact_loop(model, method, fitting, tolerances, prefix_of(model.name), events, continued=continued)
    begins = modes.model(modes.starting_mode(frozenset(names), open_contacts(modes, {**numbers, **_time(modes, span)})))
    program, reduced = begins.stages.program, begins.stages.reduced
    start = starting(reduced, names)
    refuse_inputs(begins, start)
    own = program.layout
    layout = replace(modes.layout, parameters=own.parameters, defaults=own.defaults, constants=own.constants)
    return CSource(
        program=replace(program, layout=layout),
        start=start,
        admission=admission_of_state(reduced, ROUNDING),
        dependent=begins.derived.dependence is not None,
        method=", ".join(dict.fromkeys(mode.method for mode in loop.modes)),
        tolerances=tolerances,
        forward_only=has_jumps(reduced) or modes.sampling is not None,
        numbers=numbers,
        span=span,
        sampling=None if modes.sampling is None else modes.sampling.kernels,
        contacts=replace(loop, angles=tuple(own.state[i] for i in angles_of(program))),
    )


def _methods_of_example(
    model: CompiledModel,
    names: Sequence[str],
    numbers: Mapping[str, float],
    tolerances: tuple[float, float],
    span: tuple[float, float],
    events: Sequence[Event],
) -> Mapping[int, str]:
    """Return the methods that fit the modes which a run of the example enters, by the numbers of these."""
    groups = names, model.layout.given, model.layout.inputs
    if not all(name in numbers for some in groups for name in some):
        return {}
    initial, parameters, inputs = ({name: numbers[name] for name in some} for some in groups)
    rtol, atol = tolerances
    given: dict[str, Any] = {"inputs": inputs or None, "events": events, "rtol": rtol, "atol": atol}
    run = model.sweep(span, initial, parameters, threads=1, **given)
    return {number: method for (number, _), method in run.stats.methods.items()}


def contact_loop(
    model: CompiledModel,
    method: str,
    fitting: Mapping[int, str],
    tolerances: tuple[float, float],
    prefix: str,
    events: Sequence[Event] = (),
    *,
    continued: bool = False,
) -> ContactLoop:
    """Return the loops of a scene with contacts, for one case.

    Parameters
    ----------
    model : CompiledModel
    method : str
        A method, or "auto".
    fitting : mapping of int to str
        Methods of modes by their numbers, for which nothing is chosen.
    tolerances : (float, float)
        Relative and absolute.
    prefix : str
        Of the names of functions.
    events : sequence of Event
        That users watch.
    continued : bool
        Whether runs go on behind any time at which a step has ended, and carry the signs of guards over it.

    Raises
    ------
    CapabilityError
        For more modes than exports carry, and modes that are not exported.
    """
    assert model.modes is not None
    functions = CFunctions(prefix)
    modes, every = _own_modes(model, functions), modes_of(model.modes)
    rtol, atol = tolerances
    options = PrepareOptions(method=method, rtol=rtol, atol=atol)
    choice = RunnerChoice(modes, options, PhaseReductions({}, tuple(events)))
    found = [_runner(choice, mode, fitting) for mode in every]
    runners = [runner for runner in found if runner is not None]
    choice.runners += runners
    choice.served = np.array([runner.number for runner in runners], np.int64)
    choice.begins = np.full(len(runners), ANY_PHASE)
    executor = CaseRuns(choice, t_eval=np.full(1, np.nan)).executor
    stops, instants = _stops(modes)
    executor.begin(stops)
    phases, decision, lanes = executor.arguments_alone(continued=continued or bool(modes.layout.inputs))
    layout, automaton = modes.layout, modes.automaton
    return ContactLoop(
        phases=phases,
        decision=decision,
        modes=tuple(_exported(modes, *each) for each in zip(runners, lanes, strict=True)),
        functions=functions,
        variables=layout.variables,
        parameters=layout.parameters,
        inputs=layout.inputs,
        angles=(),
        contacts=tuple((contact.name, automaton.states(i)) for i, contact in enumerate(automaton.contacts)),
        events=tuple(event.label for event in events),
        instants=instants,
        maps=EventJumps(modes, events).maps(1) if any(event.apply for event in events) else no_maps(),
    )


def _stops(modes: ModeModels) -> tuple[PhaseStops | None, InstantTable]:
    """Return the stops of a motion at which controllers act, and their instants."""
    if modes.sampling is None:
        return None, no_instants()
    engine = modes.engine()
    table, instants = stops_of_controllers(modes.sampling.kernels, lambda law: engine.code(law)[0], no_inputs())
    return PhaseStops(table, np.zeros(1), np.zeros((0, 0))), instants


def _own_modes(model: CompiledModel, functions: CFunctions) -> ModeModels:
    """Return the modes of a model, with engines that have names in C in place of machine code."""
    modes = model.modes
    assert modes is not None

    def make(compiled: Compiled) -> CompiledModel:
        program = compiled.stages.program
        engine = CompiledEngine(program, CLibrary(program, functions))
        return model.of(Compiled(compiled.stages, engine, backend_named("llvm").serving(program)))

    own = ModeModels(modes.several, make)
    for mode, made in modes.compiled.items():
        own.compiled[mode] = make(Compiled(made.stages, made.engine, {}))
    return own


def _runner(choice: RunnerChoice, mode: Mode, fitting: Mapping[int, str]) -> ModeRunner | None:
    """Return the runner of a mode; None where the equations do not determine its motions, which end there.

    Raises
    ------
    CapabilityError
        For modes that compiled loops do not run.
    """
    modes, options = choice.modes, choice.options
    try:
        model = modes.model(mode)
    except (ConstraintError, SingularMassMatrixError):
        return None
    named = ", ".join(f"{contact!r}: {state}" for contact, state in modes.named(mode).items())
    program, reduced = model.stages.program, model.stages.reduced
    known = {*GatheredRows.of(modes.layout, modes.equations.contacts).parameters}
    refuse_program(program, ("prescribed",))
    unsuitable = {
        "angles that may lock": any(isinstance(check, GimbalCheck) for check in model.checks),
        "constraints that follow from others at some places only": bool(reduced.unproven or reduced.redundancy),
        "velocities that jump": modes.impulses(mode) is not None,
        "parameters that runs set themselves": not {*model.layout.parameters} <= known,
    }
    for what, is_so in unsuitable.items():
        if is_so:
            raise CapabilityError(
                f"{modes.equations.name!r} has {what} in the mode {{{named}}}, which simulate runs, and exports of"
                " scenes with contacts that change do not carry: export one mode, model.mode(...).export(...)"
            )
    number = modes.automaton.number(mode)
    fits = fitting.get(number, "")  # of any backend
    asked = fits if fits in model.methods else options.method
    if not program.layout.state:  # nothing moves
        asked = "taylor"
    method = model.choose_method(asked, options.rtol, options.atol, many=True)
    expand = model.engine.code(modes.expansion(mode))[0]
    events = *choice.requested, *modes.events(mode)
    return ModeRunner(number, mode, model, events, {}, method, options, expand, {})


def _exported(modes: ModeModels, runner: ModeRunner, lane: SweepArguments) -> ContactMode:
    """Return a mode as an export runs it: its loop returns after each step, which are accepted one by one."""
    lane.state.progress.patience = lane.state.progress.returns = 1
    program, names = runner.model.stages.program, modes.layout.outputs
    outputs = program.layout.outputs
    places = [outputs.index(name if name in outputs else modes.layout.aliases[name]) for name in names]
    rows = GatheredRows.of(modes.layout, modes.equations.contacts).parameters
    guards = [outputs.index(guard.output) for guard in modes.guards(runner.mode)]
    space = exported_workspace(lane.workspace)
    alone = lane._replace(kernels=lane.kernels._replace(advance=NO_CODE), samples=np.empty((0, 0)), workspace=space)
    return ContactMode(
        states=runner.mode,
        method=runner.method,
        arguments=alone,
        program=program,
        outputs=_some_outputs(program, places),
        guards=_some_outputs(program, guards),
        expansion=modes.expansion(runner.mode),
        places=tuple(rows[name] - FIRST_PARAMETER for name in program.layout.parameters),
    )


def _some_outputs(program: Program, places: Sequence[int]) -> Kernel:
    """Return the kernel of some of the outputs of a program."""
    kernel = program.kernel("outputs")
    return EliminateDeadCode()(replace(kernel, outputs=tuple(kernel.outputs[place] for place in places)))
