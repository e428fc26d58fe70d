"""`HybridModel`: the model of a scene whose contacts may stick, slip and open."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from typing import Any, final

from ...arrays import FloatArray
from ...codegen.base import Engine
from ...codegen.runs import Prepared
from ...errors import CapabilityError, OptionError, list_names
from ...hybrid import OPEN
from ...ir.program import Layout
from ...mechanics.equations import EquationsOfMotion
from ...once import BoundedTable, derived_once
from ...options import (
    CompileOptions,
    PrepareOptions,
    SensitivityOptions,
    SimulateOptions,
    StoreOptions,
    SweepOptions,
    TrimOptions,
)
from ...pipeline import SeveralModes, compile_stages
from ...results.discrete_linearization import DiscreteLinearization
from ...results.hybrid import HybridTrajectory
from ...results.hybrid_sweep import HybridSweep
from ...results.linearization import Linearization
from ...results.operating_point import OperatingPoint
from ...results.sensitivity import Sensitivity
from ...scene import Scene
from .. import inputs as run_input
from ..base import Given, Model
from ..capabilities import WITHOUT
from ..input_values import GivenInputs
from ..interface.traced import hybrid_solve_fn
from ..model import CompiledModel
from ..variants import MOST_VARIANTS
from .at_state import assemble_open, linearize_mode, trim_mode
from .given_values import moving_events, refuse_open_gains, run_cases, run_motion, start_state
from .mode_models import ModeModels
from .prepare import prepared

__all__ = ["HybridModel"]


@final
@dataclass(frozen=True, eq=False, repr=False)
class HybridModel(Model[HybridTrajectory, HybridSweep]):
    """A scene with friction or contacts, compiled for one backend: a model for every mode, made when it is needed.

    `mass_matrix`, `forcing` (without the forces of the contacts) and `constraint_jacobian` (of the constraints that
    hold whatever the contacts do) are the same in all modes; `accelerations` are those of the mode that a state
    decides, and `linearize` is that of this mode alone.

    Attributes
    ----------
    layout : Layout
        Names of everything that arrays hold.
    contacts : tuple of str
        Names of the contacts.
    """

    several: SeveralModes
    modes: ModeModels = field(init=False)
    layout: Layout = field(init=False)
    contacts: tuple[str, ...] = field(init=False)
    _variants: BoundedTable[tuple[Any, ...], HybridModel] = field(
        init=False, default_factory=lambda: BoundedTable(MOST_VARIANTS)
    )

    def __post_init__(self) -> None:
        modes = ModeModels(self.several)
        object.__setattr__(self, "modes", modes)
        object.__setattr__(self, "contacts", tuple(contact.name for contact in self._equations.contacts))
        object.__setattr__(self, "layout", modes.layout)

    solve_fn = hybrid_solve_fn

    # -- what it is made of ----------------------------------------------------------------

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
            able = self.modes.automaton.states(i)
            state = states.get(contact.name, able[0])
            if state not in able:
                raise OptionError(f"contact {contact.name!r} cannot be {state!r}; it can be: {list_names(able)}")
            mode.append(state)
        return self.modes.model(tuple(mode))

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self._equations.name

    @property
    def backend(self) -> str:
        """Name of the backend."""
        return self.several.options.backend

    @property
    def formulation(self) -> str:
        """Name of the requested formulation; each mode has its own, see ``mode(...).formulation``."""
        return self.several.options.formulation

    @property
    def methods(self) -> tuple[str, ...]:
        """Integration methods that serve every mode compiled so far; "auto" takes each mode's first."""
        every = [model.methods for model in self.modes.compiled.values()]
        return tuple(name for name in every[0] if all(name in methods for methods in every))

    @property
    def source(self) -> str:
        """The generated code of the modes compiled so far."""
        titled = (f"# mode {self.modes.named(mode)}\n\n{model.source}" for mode, model in self.modes.compiled.items())
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
        for mode, model in self.modes.compiled.items():
            states = ", ".join(f"{name}: {state}" for name, state in self.modes.named(mode).items())
            lines += ["", f"mode {states}", model.explain(passes=passes)]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.explain())}</pre>"

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
        return compile_hybrid, (self.several.scene, self.several.options)

    # -- what functions over models call ---------------------------------------------------

    @property
    def _equations(self) -> EquationsOfMotion:
        return self.several.automaton.equations

    def _outputs(self, kernel: str, t: FloatArray, x: FloatArray, p: FloatArray) -> FloatArray:
        return self.modes.decisions.evaluate(kernel, t, x, p)

    def _depends_on_states(self, kernel: str) -> bool:
        return kernel in ("forcing", "accelerations", "constraint_jacobian")

    def _state(self, t: float, initial: Given, parameters: Given) -> FloatArray:
        values = run_input.given_values(self.layout, initial)
        return start_state(self.modes, t, values, self.parameter_values(parameters))

    @property
    def _starting_model(self) -> CompiledModel:
        return self.modes.model(self.modes.closed_mode)

    @property
    def _prepared_layout(self) -> Layout:
        return replace(self.layout, state=self.layout.variables)

    def _simulate_in_own_time(
        self, t_span: tuple[float, float], initial: Given, parameters: Given, options: SimulateOptions
    ) -> HybridTrajectory:
        self._refuse(options.project_invariants)
        p, values = self.parameter_vector(parameters), run_input.given_values(self.layout, initial)
        events = moving_events(self.layout, options.events)
        return run_motion(self.modes, t_span, values, p, options, events)

    def _with_parameters(self, symbols: tuple[Any, ...]) -> HybridModel:
        return self._variant(("parameters", symbols), lambda: self.several.scene.with_parameters(symbols))

    def _in_elapsed_time(self, watched: tuple[Any, ...]) -> HybridModel:
        return self._variant(("elapsed", watched), lambda: self.several.scene.in_elapsed_time(watched))

    def _check_watched(self, events: Any, reduce: Any) -> None:
        moving_events(self.layout, events)
        self.modes.model(self.modes.open_mode).derived.events(events, reduce)

    def _sweep_in_own_time(
        self, t_span: tuple[Any, Any], initial: Given, parameters: Given, options: SweepOptions
    ) -> HybridSweep:
        self._refuse(options.project_invariants)
        events = moving_events(self.layout, options.events)
        return run_cases(self.modes, t_span, initial, parameters, options, events)

    def _stored_sweep(
        self, given: tuple[Any, Given, Given, Given | None], options: SweepOptions, to: StoreOptions
    ) -> Any:
        from ..stored.sweep import stored_sweep
        from ..stored.swept_models import ContactModel

        self._refuse(options.project_invariants)
        return stored_sweep(ContactModel(self), given, options, to)

    def _prepare_in_own_time(self, t_span: tuple[float, float], options: PrepareOptions) -> tuple[str, Prepared]:
        self._refuse(options.project_invariants)
        run_input.warn_below_floor(options.rtol, options.atol)
        refuse_open_gains(self.modes)
        opened = self.modes.model(self.modes.open_mode)
        method = opened.choose_method(options.method, options.rtol, options.atol, many=True)
        return method, prepared(self.modes, t_span, options)

    def _linearize(
        self, t: float, initial: Given, parameters: Given, states: Sequence[str] | None, outputs: Any
    ) -> Linearization:
        return linearize_mode(self, t, initial, parameters, states, outputs)

    def _linearize_period(
        self,
        t: float,
        initial: Given,
        parameters: Given,
        inputs: GivenInputs | None,
        states: Sequence[str] | None,
        outputs: Any,
    ) -> DiscreteLinearization:
        names = list_names(item.name for item in self._controllers)
        raise CapabilityError(
            f"linearize does not support sampled controllers ({names}) in scenes whose contacts change: {WITHOUT}"
        )

    def _sensitivity(
        self, t_span: tuple[float, float], initial: Given, parameters: Given, options: SensitivityOptions
    ) -> Sensitivity:
        raise CapabilityError(
            f"derivatives across changes of contacts ({list_names(self.contacts)}) are not computed: differentiate runs"
            " of one mode, as model.mode().sensitivity(...), or take differences of runs"
        )

    def _assemble(
        self, t: float, guess: dict[str, float], parameters: Given, fixed: Collection[str]
    ) -> dict[str, float]:
        return assemble_open(self, t, guess, parameters, fixed)

    def _trim(self, guess: Given, parameters: Given, options: TrimOptions) -> OperatingPoint:
        return trim_mode(self, guess, parameters, options)

    def _refuse(self, project_invariants: Any) -> None:
        if project_invariants is not False:
            raise OptionError(
                f"project_invariants: friction takes energy, and impacts and changes of contact change what else may be"
                f" conserved in {self.name!r} ({list_names(self.contacts)}). Leave it out, or run a model of one"
                " mode, as mode() gives it"
            )

    # -- what runs of this package read ----------------------------------------------------

    def parameter_values(self, parameters: Given) -> dict[str, float]:
        """Return the parameters by name, checked."""
        return dict(zip(self.layout.parameters, self.parameter_vector(parameters).tolist(), strict=True))

    def on_backend(self, name: str) -> HybridModel:
        """Return the model of the scene on another backend."""
        options = replace(self.several.options, backend=name)
        return derived_once(self._variants, ("backend", name), lambda: compile_hybrid(self.several.scene, options))

    @property
    def traced_engine(self) -> Engine:
        """An engine of the backend, which makes traced functions."""
        return self.modes.engine()

    def _variant(self, key: tuple[Any, ...], scene: Callable[[], Scene]) -> HybridModel:
        return derived_once(self._variants, key, lambda: compile_hybrid(scene(), self.several.options))


def compile_hybrid(scene: Scene, options: CompileOptions) -> HybridModel:
    """Return the model of a scene whose contacts have several modes."""
    several = compile_stages(scene, options)
    assert isinstance(several, SeveralModes)
    return HybridModel(several)
