"""`HybridModel`: the model of a scene whose contacts may stick, slip and open."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, final

import numpy as np

from ...arrays import FloatArray
from ...codegen.base import Engine
from ...errors import CapabilityError, ExpressionError, OptionError, list_names
from ...hybrid import CLOSED, OPEN, Mode
from ...integrators.event_code import Event, event_list
from ...ir.conditions import CONDITION_TIME
from ...ir.kernel import Kernel
from ...ir.program import Layout
from ...once import derived_once
from ...options import CompileOptions, PrepareOptions, SimulateOptions, SweepOptions, simulate_options
from ...pipeline import SeveralModes, compile_mode, compile_stages
from ...results.hybrid import HybridTrajectory
from ...results.hybrid_sweep import HybridSweep
from ...results.linearization import Linearization
from ...results.sampler import CaseSet
from ...scene import Scene
from ...scene.model import InputSymbol
from ...values import option
from .. import inputs as run_input
from ..cases import Cases, spans_of, with_grid
from ..elapsed import asked, begins_elsewhere, elapsed_times, extension, noted_from, offset_columns, offset_values
from ..evaluation import Evaluated
from ..event_parameters import event_parameters
from ..input_values import read_inputs, with_inputs
from ..inputs import span_of
from ..linearize import linearize
from ..model import CompiledModel
from ..prepared import PreparedRun
from ..reductions import reduction_table
from .decisions import Decisions
from .evaluate import decided_state, evaluate
from .given_values import plain_mode, run_cases, run_motion, start_state
from .mode_models import ModeModels
from .prepare import prepared, with_extension

__all__ = ["HybridModel"]


@final
class HybridModel(Evaluated):
    """A scene with friction or contacts, compiled for one backend: a model for every mode, made when it is needed.

    `mass_matrix`, `forcing` (without the forces of the contacts) and `constraint_jacobian` (of the constraints that
    hold whatever the contacts do) are the same in all modes; `accelerations` are those of the mode that a state
    decides.

    Attributes
    ----------
    layout : Layout
        Names of everything that arrays hold.
    contacts : tuple of str
        Names of the contacts.
    """

    def __init__(self, several: SeveralModes) -> None:
        options, automaton = several.options, several.automaton
        equations = automaton.equations
        self._several, self._scene, self._options, self._equations = several, several.scene, options, equations
        self._models: dict[Mode, CompiledModel] = {}
        self._counters: dict[tuple[Any, ...], HybridModel] = {}
        self._modes = ModeModels(automaton, Decisions(automaton, self._rows), self._model, self._engine)
        self.contacts = tuple(contact.name for contact in equations.contacts)
        first = self._model(plain_mode(self._modes, OPEN))
        symbols = equations.symbols
        self.layout: Layout = replace(
            first.layout,
            parameters=symbols.parameters,
            unknowns=symbols.unknowns,
            outputs=tuple(str(output) for output in options.outputs),
            defaults={CONDITION_TIME: 0.0} if CONDITION_TIME in symbols.parameters else {},
        )

    # -- what it is made of ----------------------------------------------------------------

    def _model(self, mode: Mode) -> CompiledModel:
        """Return the model of a mode, compiled when it is first needed."""
        return derived_once(self._models, mode, lambda: CompiledModel.of(compile_mode(self._several, mode)))

    def _rows(self, kernel: Kernel, t: FloatArray, y: FloatArray, c: FloatArray) -> FloatArray:
        """Return the outputs of a kernel that belongs to no mode, by the engine of one of them."""
        return self._engine().rows(kernel, t, y, c)

    def _engine(self) -> Engine:
        return self._model(plain_mode(self._modes, OPEN)).engine

    def mode(self, **states: str) -> CompiledModel:
        """Return the model of one mode: an ordinary one, without events.

        Parameters
        ----------
        **states : str
            For each contact "slip", "stick", "closed" or "open"; contacts that are left out slip, or are closed.
            Directions of slip are further parameters of the model, see ``layout.parameters``.

        Raises
        ------
        OptionError
            For contacts that do not exist, and states that they do not have.
        """
        unknown = [name for name in states if name not in self.contacts]
        if unknown:
            raise OptionError(
                f"no contact is called {list_names(map(repr, unknown))}; known: {list_names(self.contacts)}"
            )
        mode = []
        for i, contact in enumerate(self._equations.contacts):
            able = self._modes.automaton.states(i)
            state = states.get(contact.name, able[0])
            if state not in able:
                raise OptionError(f"contact {contact.name!r} cannot be {state!r}; it can be: {list_names(able)}")
            mode.append(state)
        return self._model(tuple(mode))

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self._equations.name

    @property
    def _inputs(self) -> tuple[InputSymbol, ...]:
        """The inputs of the scene."""
        return self._equations.symbols.inputs

    @property
    def backend(self) -> str:
        """Name of the backend."""
        return self._options.backend

    @property
    def formulation(self) -> str:
        """Name of the formulation that was asked for; each mode has its own, see ``mode(...).formulation``."""
        return self._options.formulation

    @property
    def methods(self) -> tuple[str, ...]:
        """Integration methods that serve every mode compiled so far; "auto" takes each mode's first."""
        every = [model.methods for model in self._models.values()]
        return tuple(name for name in every[0] if all(name in methods for methods in every))

    @property
    def source(self) -> str:
        """The generated code of the modes compiled so far."""
        titled = (f"# mode {self._modes.named(mode)}\n\n{model.source}" for mode, model in self._models.items())
        return "\n\n".join(titled)

    @property
    def kernels(self) -> Any:
        """None: each mode has kernels of its own.

        Raises
        ------
        CapabilityError
            Always.
        """
        raise CapabilityError(f"{self.name!r} has kernels for each mode of its contacts: see mode(...).kernels")

    def explain(self, *, passes: bool = False) -> str:
        """Return what the contacts may do, and what was chosen for the modes compiled so far.

        With `passes`, each mode lists the passes that made its program, as `CompiledModel.explain` does.
        """
        lines = [f"{self.name}: contacts {list_names(self.contacts)}; a model for each mode, compiled when it is met"]
        for mode, model in self._models.items():
            told = ", ".join(f"{name}: {state}" for name, state in self._modes.named(mode).items())
            lines += ["", f"mode {told}", model.explain(passes=passes)]
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"<HybridModel {self.name!r}: contacts {list_names(self.contacts)}, {self.backend}>"

    def __getattr__(self, name: str) -> Any:
        hint = ""
        if not name.startswith("_") and hasattr(CompiledModel, name):
            hint = (
                f" of its own, because its contacts change what it is; ask the model of one mode, such as"
                f" model.mode().{name}, or model.mode({self.contacts[0]}={OPEN!r}).{name}"
            )
        raise AttributeError(f"a {type(self).__name__} has no {name!r}{hint}")

    def __reduce__(self) -> tuple[Any, ...]:
        return _compiled, (self._scene, self._options)

    # -- motions ---------------------------------------------------------------------------

    def state(
        self,
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        t: float = 0.0,
        inputs: Mapping[Any, Any] | None = None,
    ) -> FloatArray:
        """Return consistent coordinates, rates and states (2 n_q + n_z,), as `simulate` starts from them."""
        parameters = with_inputs(self.layout, self._inputs, inputs, parameters, option("t", t))
        given = dict(zip(self.layout.parameters, self.parameter_vector(parameters).tolist(), strict=True))
        return start_state(
            self._modes, self.layout, option("t", t), run_input.given_values(self.layout, initial), given
        )

    def _depends_on_states(self, kernel: str) -> bool:
        return kernel in ("forcing", "accelerations", "constraint_jacobian")

    def _outputs(self, kernel: str, t: FloatArray, x: FloatArray, p: FloatArray) -> FloatArray:
        return evaluate(self._modes.decisions, kernel, t, x, p)

    def linearize(
        self,
        t: float,
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        inputs: Mapping[Any, Any] | None = None,
        states: Sequence[str] | None = None,
        outputs: Iterable[Any] | None = None,
    ) -> Linearization:
        """Linearise the motion about a state, in the mode that its contacts have there.

        Parameters
        ----------
        t, initial, parameters, inputs, states, outputs
            As for `dalembert.runtime.model.CompiledModel.linearize`.

        Returns
        -------
        Linearization
            Of the mode alone: it holds for changes that leave the contacts in it.

        Raises
        ------
        UnknownNameError, ValueInputError, InitialStateError, OptionError
            For input that is wrong, and for states that the contacts forbid or do not let go on.
        """
        time = option("t", t)
        p = self.parameter_vector(with_inputs(self.layout, self._inputs, inputs, parameters, time))
        given = dict(zip(self.layout.parameters, p.tolist(), strict=True))
        x = start_state(self._modes, self.layout, time, run_input.given_values(self.layout, initial), given)
        if CONDITION_TIME in given:
            given[CONDITION_TIME] = time
        c = np.array([[given[name] for name in self.layout.parameters]])
        decisions, at = self._modes.decisions, np.array([time])
        state = decided_state(decisions, at, x[np.newaxis], c, "no motion goes on from")
        mode = self._modes.automaton.mode(int(state.mode_numbers()[0]))
        cases = state.cases
        added = self._modes.added(mode, state.directions()[0], cases.sides[0], cases.rest[0])
        values = given | {name: float(value) for name, value in added.items()}
        start = dict(zip(self.layout.variables, state.x[0].tolist(), strict=True))
        return linearize(self._model(mode), time, start, values, states, outputs)

    def _refuse(self, project_invariants: Any) -> None:
        if project_invariants is not False:
            raise OptionError(
                f"project_invariants: friction takes energy, and impacts and changes of contact change what else may be"
                f" conserved in {self.name!r} ({list_names(self.contacts)}). Leave it out, or run a model of one"
                " mode, as mode() gives it"
            )

    def _events(self, events: Any) -> tuple[Event, ...]:
        """Return events, each of which moves in some mode."""
        listed = event_list(events, self.layout.aliases)
        for event in listed:
            told = event.expression
            names = {told} if isinstance(told, str) else {str(symbol) for symbol in getattr(told, "free_symbols", ())}
            if names <= {*self.layout.parameters}:
                raise ExpressionError(
                    f"event {event.label!r} is constant along every motion, so that nothing can be watched: write it"
                    " in coordinates, rates, outputs or time"
                )
        return listed

    def simulate(
        self,
        t_span: tuple[float, float],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        inputs: Mapping[Any, Any] | None = None,
        t_eval: Any = None,
        method: str = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
        first_step: float | None = None,
        max_step: float = np.inf,
        max_steps: int = 1_000_000,
        dense: bool = True,
        events: Any = (),
        error_estimate: bool = False,
        project_invariants: Any = False,
        progress: bool = False,
    ) -> HybridTrajectory:
        """Simulate one trajectory, phase after phase.

        Parameters
        ----------
        t_span, initial, parameters, inputs, t_eval, method, rtol, atol, first_step, max_step, max_steps, dense, events
            As for `dalembert.runtime.model.CompiledModel.simulate`. What `initial` leaves out is fixed by the
            constraints with all contacts closed.
        error_estimate : bool
            As there; the estimate is NaN where the contacts of the run and of its twin do not do the same.
        progress : bool
            As there.

        Returns
        -------
        HybridTrajectory
            What the contacts did is in its `phases`. Numerical failure is its `status`, never an exception.

        Raises
        ------
        UnknownNameError, ValueInputError, InitialStateError, OptionError, ExpressionError
            For input that is wrong, each naming what, what is allowed and what to do; with contacts
            `project_invariants` is.
        """
        self._refuse(project_invariants)
        t0, t1 = span_of(t_span)
        plain = (method, rtol, atol, max_step, max_steps, first_step, dense, error_estimate, False)
        options = simulate_options(
            *plain,
            t_eval=t_eval,
            events=events,
            inputs=read_inputs(self.layout, self._inputs, inputs),
            progress=progress,
        )
        able = self._with_event_parameters(parameters, events)
        return able._simulate_span((t0, t1), initial, parameters, options)

    def _with_event_parameters(
        self, parameters: Mapping[Any, Any], events: Any, reduce: Any = None, grid: CaseSet | None = None
    ) -> HybridModel:
        """Return the model whose parameters include those that only events and reductions contain."""

        def make(symbols: tuple[Any, ...]) -> HybridModel:
            key = ("parameters", symbols)
            return derived_once(
                self._counters, key, lambda: _compiled(self._scene.with_parameters(symbols), self._options)
            )

        return event_parameters(self, self.layout, parameters, events, reduce, grid, make=make)

    def _simulate_span(
        self,
        t_span: tuple[float, float],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        options: SimulateOptions,
    ) -> HybridTrajectory:
        """Simulate one trajectory, counting the time of a run that begins elsewhere from its start."""
        (t0, t1), given_inputs, events = t_span, options.inputs, options.events
        if given_inputs is not None:
            given_inputs.refuse_span(t0, t1)
            parameters = given_inputs.parameters(parameters, t0, after=t1 >= t0)
        other, own, _ = self._counting(t0, t1, events) if begins_elsewhere(t0, t1) else (None, events, None)
        if other is None:
            return self._simulate((t0, t1), initial, parameters, options)
        times = options.t_eval
        wanted = elapsed_times(t0, t1, times)
        given: Mapping[Any, Any] = parameters
        if other is not self:
            values = dict(zip(self.layout.parameters, self.parameter_vector(parameters).tolist(), strict=True))
            given = {**parameters, **offset_values(other._equations.symbols.offsets, t0, values)}
        if given_inputs is not None:
            given_inputs = given_inputs.counted_from(t0)
            given = given_inputs.parameters(given, 0.0, after=t1 >= t0)
        options = replace(options, t_eval=wanted, events=own, inputs=given_inputs)
        run = other._simulate((0.0, t1 - t0), initial, given, options)
        if times is not None and wanted is not None:
            times = times[(wanted - run.t_end) * (1.0 if t1 >= t0 else -1.0) <= 0.0]
        return run.counted_from(t0, times, noted_from(run.stats.note, t0))

    def _counting(self, t0: Any, t1: Any, events: Any = (), reduce: Any = None) -> tuple[HybridModel | None, Any, Any]:
        """Return the model that runs in the time since a start, as that of a scene without contacts does."""
        found = asked(self._equations.symbols, (t0, t1), events, reduce)
        if found is None:
            return None, events, reduce
        if not found.other:
            return self, events, reduce
        self._events(events)

        def make() -> HybridModel:
            return _compiled(self._scene.in_elapsed_time(found.watched), self._options)

        return derived_once(self._counters, found.watched, make), found.events, found.reductions

    def _simulate(
        self,
        t_span: tuple[float, float],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        options: SimulateOptions,
    ) -> HybridTrajectory:
        """Simulate one trajectory, as `simulate` does, in the time of this model."""
        p, values = self.parameter_vector(parameters), run_input.given_values(self.layout, initial)
        return run_motion(self._modes, self.layout, t_span, values, p, options, self._events(options.events))

    def sweep(
        self,
        t_span: tuple[Any, Any],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        *,
        inputs: Mapping[Any, Any] | None = None,
        grid: CaseSet | None = None,
        t_eval: Any = None,
        method: str = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
        max_step: float = np.inf,
        max_steps: int = 1_000_000,
        threads: int | None = None,
        progress: bool = False,
        events: Any = (),
        reduce: Any = None,
        error_estimate: bool = False,
        project_invariants: Any = False,
    ) -> HybridSweep:
        """Simulate many cases, each with its own phases, steps and status; one that fails never touches its neighbours.

        All cases that are in one mode run side by side, up to what ends it for each.

        Parameters
        ----------
        t_span, initial, parameters, inputs, grid, t_eval, method, rtol, atol, max_step, threads, progress
            As for `dalembert.runtime.model.CompiledModel.sweep`, as are `events` and `reduce`; every time of `t_eval`
            ends a step.
        max_steps : int
            Steps of all phases together after which a case ends with a status.
        error_estimate : bool
            As there; the estimate is NaN where the contacts of a case and of its twin do not do the same.

        Returns
        -------
        HybridSweep

        Raises
        ------
        UnknownNameError, ValueInputError, InitialStateError, OptionError
            For input that is wrong for all cases; with contacts `project_invariants` is.
        """
        self._refuse(project_invariants)
        options = SweepOptions(
            grid=grid,
            t_eval=t_eval,
            method=method,
            rtol=rtol,
            atol=atol,
            max_step=max_step,
            max_steps=max_steps,
            threads=threads,
            progress=progress,
            events=events,
            reduce=reduce,
            error_estimate=error_estimate,
            inputs=read_inputs(self.layout, self._inputs, inputs, many=True),
        )
        able = self._with_event_parameters(parameters, events, reduce, grid)
        return able._sweep_span(t_span, initial, parameters, options)

    def _sweep_span(
        self,
        t_span: tuple[Any, Any],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        options: SweepOptions,
    ) -> HybridSweep:
        """Simulate many cases, counting the time of those that begin elsewhere from their starts."""
        events, reduce, grid, t_eval = options.events, options.reduce, options.grid, options.t_eval
        starts, lasts = spans_of(t_span)
        if options.inputs is not None:
            options.inputs.refuse_span(starts, lasts)
            parameters = options.inputs.case_parameters(parameters, starts, lasts)
        together = len(starts) == len(lasts) == 1
        other, own, table = None, events, reduce
        if begins_elsewhere(starts, lasts) and (together or t_eval is None):
            other, own, table = self._counting(starts, lasts, events, reduce)
        if other is None:
            return self._sweep(t_span, initial, parameters, replace(options, events=own, reduce=table))
        times = options.t_eval
        wanted = elapsed_times(float(starts[0]), float(lasts[0]), times)
        given = parameters
        if other is not self:
            whole = (initial, parameters) if grid is None else with_grid(self.layout, grid, initial, parameters)
            model = self._model(plain_mode(self._modes, CLOSED))
            cases = Cases(model.stages.program, model.derived.start, t_span, *whole)
            given = {**parameters, **offset_columns(other._equations.symbols.offsets, starts, cases.parameters)}
        spans = (starts - starts, lasts - starts)
        options = replace(options, t_eval=wanted, events=own, reduce=table)
        if options.inputs is not None:
            options = replace(options, inputs=options.inputs.counted_from(starts))
            given = options.inputs.case_parameters(given, starts - starts, lasts - starts)
        run = other._sweep(spans, initial, given, options)
        reductions = reduction_table(reduce, self.layout.aliases)
        crossings = [name for name, each in reductions.items() if each.kind == "first crossing"]
        return run.counted_from(starts, times, self.layout.parameters, crossings)

    def _sweep(
        self,
        t_span: tuple[Any, Any],
        initial: Mapping[Any, Any],
        parameters: Mapping[Any, Any],
        options: SweepOptions,
    ) -> HybridSweep:
        """Simulate many cases, as `sweep` does, in the time of this model."""
        return run_cases(self._modes, self.layout, t_span, initial, parameters, options, self._events(options.events))

    def prepare(
        self,
        t_span: tuple[float, float],
        *,
        inputs: Mapping[Any, Any] | None = None,
        method: str = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
        max_step: float = np.inf,
        max_steps: int = 1_000_000,
        project_invariants: Any = False,
    ) -> PreparedRun:
        """Return ``run(state, p)``, which gives the final state of many short runs with next to no overhead.

        States are coordinates, rates and first-order states (2 n_q + n_z,), as `state` makes them, and as the run
        returns them. Contacts that touch are taken to be at rest, or struck, as where any motion starts: what they did
        before is not known.

        Parameters
        ----------
        t_span, inputs, method, rtol, atol, max_step
            As for `dalembert.runtime.model.CompiledModel.prepare`.
        max_steps : int
            Steps of all phases together after which a run ends with a status.

        Returns
        -------
        PreparedRun
            A state that the contacts forbid is its ``status`` INITIAL_STATE.

        Raises
        ------
        OptionError, ValueInputError
            For options that do not exist, and for `project_invariants`.
        """
        self._refuse(project_invariants)
        options = PrepareOptions(
            method=method,
            rtol=rtol,
            atol=atol,
            max_step=max_step,
            max_steps=max_steps,
            inputs=None if inputs is None else read_inputs(self.layout, self._inputs, inputs),
        )
        if options.inputs is not None:
            options.inputs.refuse_span(*span_of(t_span))
        return self._prepare(span_of(t_span), options)

    def _prepare(self, t_span: tuple[float, float], options: PrepareOptions) -> PreparedRun:
        """Return a prepared run, in the time since its start where that is what motions are computed in."""
        t0, t1 = t_span
        model = self._model(plain_mode(self._modes, OPEN))
        chosen = model.choose_method(options.method, options.rtol, options.atol, many=True)
        run_input.warn_below_floor(options.rtol, options.atol)
        other, _, _ = self._counting(t0, t1) if begins_elsewhere(t0, t1) else (None, (), None)
        span = t_span if other is None else (0.0, t1 - t0)
        own = other or self
        offsets = own._equations.symbols.offsets
        given = options.inputs
        if given is not None and other is not None:
            given = given.counted_from(t0)
        run = prepared(own._modes, own.layout, span, replace(options, inputs=given))
        if offsets:
            run = with_extension(run, extension(own.layout.parameters, self.layout.parameters, offsets, t0))
        layout = replace(self.layout, state=self.layout.variables)
        return PreparedRun(run, chosen, layout, partial(self._prepare, t_span, options), given, span)


def _compiled(scene: Scene, options: CompileOptions) -> HybridModel:
    several = compile_stages(scene, options)
    assert isinstance(several, SeveralModes)
    return HybridModel(several)
