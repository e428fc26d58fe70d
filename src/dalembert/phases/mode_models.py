"""Models of the modes of a scene with contacts, and the guards that end each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..arrays import FloatArray
from ..codegen.engine import Engine
from ..codegen.llvm.prepared import AdmissionCode
from ..contacts.automaton import HybridAutomaton
from ..contacts.equations.contact_laws import OPEN, Mode, mode_parameters
from ..contacts.equations.switched_modes import any_mode, switched_guards, switches
from ..errors import InitialStateError
from ..events.event_code import Event, armed
from ..ir.conditions import CONDITION_TIME, Conditions
from ..ir.graph import Graph
from ..ir.kernel import Kernel
from ..ir.program import Layout
from ..mechanics.equations import EquationsOfMotion, Guard
from ..once import derived_once, derived_property
from ..pipeline import Compiled, SeveralModes, compile_mode
from ..reduction.admission import admission_of_variables
from ..reduction.base import condition_kernels
from ..reduction.sampling_kernels import SampledVariables, SamplingKernels, sampling_kernels
from ..reduction.state_reader import coordinates_kernel
from ..runs.impulses import Impulses, impulses_of
from ..runs.sampling import Sampling
from ..starts.symbol_assumptions import ROUNDING
from ..stops.breakpoints import CaseBreaks
from .common_program import CommonProgram, why_separate
from .decisions import Decisions

if TYPE_CHECKING:
    from ..model.model import CompiledModel


def all_modes(model: CompiledModel) -> ModeModels:
    """Return the modes of a model that has several."""
    assert model.modes is not None
    return model.modes


@final
@dataclass(frozen=True, eq=False, repr=False)
class ModeModels:
    """The automaton of a scene, its decisions, and the model of every mode.

    Attributes
    ----------
    several : SeveralModes
    make : function of a compiled mode
        Makes its model.
    compiled : dict of Mode to CompiledModel
        The models that have been needed so far.
    recorders : dict of str to list of MotionRecorder or CaseRuns
        Recorders of single runs, and runs of sweeps, that are not in use, by options and events.
    """

    several: SeveralModes
    make: Callable[[Compiled], CompiledModel]
    compiled: dict[Mode, CompiledModel] = field(default_factory=dict, init=False)
    recorders: dict[str, list[Any]] = field(default_factory=dict, init=False)
    _guards: dict[Mode, list[Guard]] = field(default_factory=dict, init=False)
    _kinked: dict[Mode, set[str]] = field(default_factory=dict, init=False)
    _expansions: dict[Mode, Kernel] = field(default_factory=dict, init=False)
    _starting: dict[tuple[frozenset[str], frozenset[int]], Mode] = field(default_factory=dict, init=False)

    @property
    def automaton(self) -> HybridAutomaton:
        """Modes, guards and transitions."""
        return self.several.automaton

    def model(self, mode: Mode) -> CompiledModel:
        """Return the model of a mode, compiled when it is first needed."""
        return derived_once(self.compiled, mode, lambda: self.make(compile_mode(self.several, mode)))

    @cached_property
    def why_separate(self) -> str:
        """Why each mode has a program of its own; empty where one program serves modes."""
        return why_separate(self.equations, self.several.options.formulation)

    @derived_property
    def common(self) -> CommonProgram | None:
        """The program of all modes, None where each has its own."""
        return None if self.why_separate else CommonProgram(self.equations, self.decisions.values)

    def sharing(self, mode: Mode) -> dict[int, int] | None:
        """Return which contacts share friction forces of others in the common program; None for its own program."""
        return None if self.common is None else self.common.sharing.get(mode)

    def program(self, mode: Mode) -> Mode:
        """Return the mode whose model serves the runs of a mode: itself, or that of the common program."""
        return mode if self.sharing(mode) is None else any_mode(len(mode))

    def serving(self, mode: Mode) -> CompiledModel:
        """Return the model that serves the runs of a mode."""
        return self.model(self.program(mode))

    def settle(self, mode: Mode, t: FloatArray, x: FloatArray, p: FloatArray) -> None:
        """Decide which program serves the runs of a mode, at the first state (1, n_x) that enters it."""
        if self.common is not None:
            self.common.settle(mode, t, x, p)

    def engine(self) -> Engine:
        """Return the engine that evaluates kernels which belong to no mode."""
        return self.model(self.open_mode).engine

    @cached_property
    def decisions(self) -> Decisions:
        """Mode selection and impacts."""
        return Decisions(self.automaton, self.engine)

    @property
    def equations(self) -> EquationsOfMotion:
        """The equations of the scene, of no mode."""
        return self.automaton.equations

    @cached_property
    def layout(self) -> Layout:
        """Names of the scene, of no mode."""
        symbols, opened = self.equations.symbols, self.model(self.open_mode).layout
        return replace(
            opened,
            state=opened.variables,
            parameters=symbols.parameters,
            unknowns=symbols.unknowns,
            outputs=tuple(str(output) for output in self.several.options.outputs),
            defaults={**self.equations.defaults, **dict.fromkeys({CONDITION_TIME} & {*symbols.parameters}, 0.0)},
        )

    @cached_property
    def conditions(self) -> Conditions | None:
        """The conditions on time alone, in the parameters of the scene."""
        return condition_kernels(self.equations)

    @derived_property
    def admission(self) -> AdmissionCode | None:
        """The test of what prepared runs are given, None where there is nothing to test."""
        model, names = self.model(self.open_mode), self.layout.parameters
        kernel = admission_of_variables(model.stages.reduced.equations, names, ROUNDING)
        sizes = len(self.layout.variables), len(names)
        return None if kernel is None else AdmissionCode(kernel, sizes, model.engine.folder)

    @property
    def changes(self) -> bool:
        """Whether there are conditions on time or controllers."""
        return self.conditions is not None or bool(self.equations.controllers)

    def breaks(self, p: FloatArray, t0: FloatArray, t1: FloatArray) -> CaseBreaks | None:
        """Return when conditions change in cases of parameters (k, n_p) between t0 and t1 (k,); None without any."""
        if self.conditions is None:
            return None
        found = CaseBreaks.of(self.conditions, p, t0, t1)
        return found if self.conditions.decides or len(found.times) else None

    @derived_property
    def _sampling(self) -> SamplingKernels | None:
        return sampling_kernels(SampledVariables(self.equations))

    @property
    def sampling(self) -> Sampling | None:
        """The controllers on coordinates, rates and first-order states."""
        if not self.equations.controllers:
            return None
        kernels = self._sampling
        assert kernels is not None
        return Sampling(self.layout, kernels, None)

    def guards(self, mode: Mode) -> list[Guard]:
        """Return what can end a mode; what is constant along its motions cannot, and is left out of its own program."""

        def make() -> list[Guard]:
            sharing = self.sharing(mode)
            if sharing is not None:
                return switched_guards(self.equations.contacts, mode, sharing)
            reduced = self.model(mode).stages.reduced
            graph, moving = reduced.equations.graph, [*reduced.inputs, *reduced.equations.timing]
            found = reduced.equations.guards
            return [guard for guard in found if graph.freed_of(reduced.outputs[guard.output], moving) is None]

        return derived_once(self._guards, mode, make)

    def kinks(self, mode: Mode) -> list[Guard]:
        """Return the guards of a mode at kinks of the gaps of its closed contacts."""
        return [guard for guard in self.guards(mode) if guard.kind == "kink"]

    def kinked_contacts(self, mode: Mode) -> list[str]:
        """Return the names of the closed contacts of a mode whose gaps have kinks."""
        contacts = zip(self.equations.contacts, mode, strict=True)
        return [repr(contact.name) for contact, state in contacts if contact.kinks and state != OPEN]

    def kinked(self, mode: Mode) -> set[str]:
        """Return the outputs of the guards of a mode that contain tables: steps end beside their knots, not on them."""

        def make() -> set[str]:
            outputs = self.serving(mode).stages.reduced.outputs
            nodes = {guard.output: Graph.topological([outputs[guard.output]]) for guard in self.guards(mode)}
            return {name for name, found in nodes.items() if any(node.op in ("table", "surface") for node in found)}

        return derived_once(self._kinked, self.program(mode), make)

    def events(self, mode: Mode) -> list[Event]:
        """Return the guards of a mode as events, which occur where they fall through zero, or at once below it.

        Kinks are passed in both directions.
        """
        return [
            Event(guard.output, terminal=True, name=guard.output)
            if guard.kind == "kink"
            else armed(Event(guard.output, terminal=True, direction=-1, name=guard.output))
            for guard in self.guards(mode)
        ]

    def states(self, mode: Mode, t: FloatArray, x: FloatArray, c: FloatArray) -> FloatArray:
        """Return the states (k, n_y) of a mode at variables (k, 2 n_q + n_z), for its constants (k, n_c)."""
        model = self.serving(mode)
        start = model.derived.start(model.layout.variables)
        names = model.layout.variables
        given = x[:, [names.index(name) for name in start.given]]
        return np.ascontiguousarray(model.engine.rows(start.kernel, t, given, c)[:, : len(model.layout.state)])

    def expansion(self, mode: Mode) -> Kernel:
        """Return the kernel of coordinates and rates in a mode."""
        program = self.program(mode)
        return derived_once(self._expansions, program, lambda: coordinates_kernel(self.model(program).stages.reduced))

    def added(self, mode: Mode, values: FloatArray) -> dict[str, Any]:
        """Return the parameters that contacts add in a mode by name, of `ContactCases.added` (..., 4 n_contacts)."""
        switched = {name: np.full(values.shape[:-1], value)[()] for name, value in self.switched(mode).items()}
        names = [name for contact in self.equations.contacts for name in mode_parameters(contact)]
        known = {*self.serving(mode).layout.parameters}
        return {name: values[..., i] for i, name in enumerate(names) if name in known} | switched

    def switched(self, mode: Mode) -> dict[str, float]:
        """Return the switches of the common program in a mode by name, none where the mode has its own."""
        sharing = self.sharing(mode)
        return {} if sharing is None else switches(self.equations.contacts, mode, sharing)

    @cached_property
    def open_mode(self) -> Mode:
        """The mode in which contacts that can open are open, and all others slip."""
        contacts = enumerate(self.equations.contacts)
        return self.automaton.sliding_mode([i for i, contact in contacts if contact.constraint is not None])

    @cached_property
    def constants_when_open(self) -> Kernel:
        """The kernel from (t, y, c), c being the parameters, to the constants of `open_mode`."""
        prepare = self.model(self.open_mode).stages.program.kernel("prepare")
        return replace(prepare, loads=tuple(replace(load, array="c") for load in prepare.loads))

    @cached_property
    def closed_mode(self) -> Mode:
        """The mode in which all contacts are closed and slip."""
        return self.automaton.sliding_mode([])

    def starting_mode(self, given: frozenset[str], apart: frozenset[int] = frozenset()) -> Mode:
        """Return the mode whose model starts from values of given names.

        Its constraints fix what is left out, as a loop fixes rates of a linkage. The first that does is taken: contacts
        are open, or else only those that are apart (their numbers), or else none is.
        """

        def first() -> Mode:
            for mode in (self.open_mode, self.automaton.sliding_mode(apart)):
                try:
                    self.model(mode).derived.start(given)
                except InitialStateError:
                    continue
                return mode
            return self.closed_mode

        return derived_once(self._starting, (given, apart), first)

    def named(self, mode: Mode) -> dict[str, str]:
        """Return what each contact does in a mode."""
        return {contact.name: state for contact, state in zip(self.equations.contacts, mode, strict=True)}

    def impulses(self, mode: Mode) -> Impulses | None:
        """Return the jumps of rates of a mode; None where no prescribed velocity can jump."""
        if self.sharing(mode) is not None:
            return None
        stages = self.model(mode).stages
        return impulses_of(stages.equations, stages.program)

    def closed(self, mode: Mode) -> tuple[str | None, ...]:
        """Return, for each constraint of the scene, the contact that is closed in the common program, or None."""
        if self.sharing(mode) is None:
            return ()
        closed = {c.constraint: c.name for c, s in zip(self.equations.contacts, mode, strict=True) if s != OPEN}
        return tuple(closed.get(i) for i in range(len(self.equations.constraints)))

    def opened(self, mode: Mode) -> tuple[str | None, ...]:
        """Return, for each constraint of the scene, the name of the contact that is open in a mode instead, or None."""
        opened = {c.constraint: c.name for c, s in zip(self.equations.contacts, mode, strict=True) if s == OPEN}
        return tuple(opened.get(i) for i in range(len(self.equations.constraints)))
