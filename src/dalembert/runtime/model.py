"""`CompiledModel`: the result of `dalembert.compile_model`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from typing import TYPE_CHECKING, Any, cast, final

from ..arrays import FloatArray
from ..codegen import backend_named
from ..codegen.base import Capability, Engine
from ..errors import OptionError, list_names, unknown_name
from ..ir.program import Layout, representative
from ..mechanics.equations import EquationsOfMotion
from ..once import derived_property, once_property
from ..options import (
    CompileOptions,
    PrepareOptions,
    SensitivityOptions,
    StoreOptions,
    SweepOptions,
    TrimOptions,
)
from ..pipeline import Compiled, Stages, compile_equations, derive_scene
from ..results.trajectory import Trajectory
from ..scene import Scene
from ..values import tolerances
from . import inputs as run_input
from .base import Given, Model
from .capabilities import refusal, require
from .derived import Derived
from .engines import engine_of
from .initial_states import initial_state
from .interface import motions, states, traced
from .segment_constants import at_time
from .simulate import simulate_in_own_time
from .variants import Variants

if TYPE_CHECKING:
    from ..codegen.base import FunctionEngine, TracedEngine
    from ..codegen.runs import Prepared
    from ..hybrid.modes import Mode
    from ..results.discrete_linearization import DiscreteLinearization
    from ..results.linearization import Linearization
    from ..results.operating_point import OperatingPoint
    from ..results.sensitivity import Sensitivity
    from ..results.sweep import Sweep
    from .input_values import GivenInputs
    from .run_check import RunCheck

__all__ = ["CompiledModel"]

_MOST_CHOSEN = 64
"""Tolerances for which the method that "auto" takes is remembered."""


@final
@dataclass(frozen=True, eq=False, repr=False)
class CompiledModel(Model[Trajectory, "Sweep"]):
    """A scene compiled for one backend in one formulation.

    It holds what was compiled and does not change; `simulate`, `sweep`, `prepare`, `sensitivity`, `linearize` and
    `explain` are functions over it, in modules of these names. Models of equal programs are equal: compiled code that
    JAX keeps for one serves the other.

    Attributes
    ----------
    stages : Stages
        Every object of the pipeline, from the scene to the rendered module.
    engine : Engine
        The loaded module: compiled kernels, and integrators that call them.
    method_descriptions : mapping of str to str
        Integration methods by name, each with one line of description.
    dropped : tuple of int
        Constraints that are not enforced, because they follow from the others around the start of a run.
    layout : Layout
        Names of everything that arrays hold.
    derived : Derived
        Kernels and facts that are derived on demand, and kept.
    variants : Variants
        Other models of the scene that runs need, compiled on demand, and kept.
    """

    stages: Stages
    engine: Engine
    method_descriptions: Mapping[str, str]
    dropped: tuple[int, ...]
    derived: Derived
    variants: Variants
    layout: Layout = field(init=False)
    _chosen: dict[tuple[float, float, bool], str] = field(init=False, default_factory=dict)

    compare_formulations = motions.compare_formulations
    expand = states.expand
    solve_fn = traced.solve_fn

    def __post_init__(self) -> None:
        object.__setattr__(self, "layout", self.stages.program.layout)
        self.engine.accept_as_static(CompiledModel)

    @classmethod
    def of(cls, compiled: Compiled, dropped: tuple[int, ...] = ()) -> CompiledModel:
        """Return the model of a scene that went through all stages."""
        stages = compiled.stages
        derived, variants = Derived(stages, compiled.engine), Variants(stages, dropped, cls.of)
        return cls(stages, engine_of(compiled, derived.start), compiled.methods, dropped, derived, variants)

    @once_property
    def for_segments(self) -> CompiledModel:
        """The model for parts of runs that end where functions of time break, and between acts of controllers."""
        program = replace(self.stages.program, conditions=None)
        stages = replace(self.stages, program=program)
        variants = Variants(self.stages, self.dropped, lambda *compiled: CompiledModel.of(*compiled).for_segments)
        return replace(self, stages=stages, engine=self.engine.for_segments, variants=variants)

    # -- what was compiled -----------------------------------------------------------------

    @derived_property
    def checks(self) -> tuple[RunCheck, ...]:
        """What runs of the model are checked for."""
        from .run_checks import run_checks

        return run_checks(self)

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self.stages.program.name

    @property
    def backend(self) -> str:
        """Name of the backend."""
        return self.stages.rendered.backend

    @property
    def formulation(self) -> str:
        """Name of the formulation."""
        return self.stages.program.formulation

    @property
    def methods(self) -> tuple[str, ...]:
        """Integration methods of the backend, other than "auto"."""
        return tuple(self.method_descriptions)

    @property
    def note(self) -> str:
        """Which constraints are not enforced and why; nothing where all are."""
        labels = [self.layout.constraints[i] for i in self.dropped]
        if not labels:
            return ""
        return f"not enforced, because it follows from the others around the start: {'; '.join(labels)}"

    @property
    def source(self) -> str:
        """The generated code that runs by default, by the method "auto" at the default tolerances."""
        return self.stages.rendered.source

    def source_of(self, method: str = "auto", rtol: float = 1e-8, atol: float = 1e-10) -> str:
        """Return the generated code that `simulate` runs by a method at some tolerances.

        Raises
        ------
        OptionError
            For a method that the backend does not have, or tolerances that are not positive.
        """
        rtol, atol = tolerances(rtol, atol)
        return self.engine.source_of(self.choose_method(method, rtol, atol), rtol, atol) or self.source

    def choose_method(self, method: Any, rtol: float, atol: float, *, many: bool = False) -> str:
        """Return the method that a run takes, checked; `many` says whether it is to run many cases at once.

        Raises
        ------
        OptionError
            For a method that the model does not have, with those that it has.
        """
        if isinstance(method, str) and method == "auto":
            key = rtol, atol, many
            found = self._chosen.get(key)
            if found is None:
                if len(self._chosen) >= _MOST_CHOSEN:
                    self._chosen.clear()
                found = self._chosen[key] = self.engine.automatic(self.methods, rtol, atol, many=many)
            return found
        if isinstance(method, str) and method in self.method_descriptions:
            return method
        why = backend_named(self.backend).refusal(self.stages.program, str(method))
        if why:
            raise OptionError(f"{why}. Take one of: {list_names(['auto', *self.methods])}")
        raise OptionError(
            unknown_name("method", str(method), ["auto", *self.methods]) + f" (of the backend {self.backend!r})"
        )

    @property
    def kernels(self) -> Any:
        """The generated kernels as functions of numba, by name, for people's own compiled code (backend "numba").

        ``prepare(p, c)`` computes constants c (``layout.constants``,) from parameters p (n_p,), ``rhs(t, y, c, out)``
        the rate of the state, and so on: see `source`. numba compiles each when it is first called.

        Raises
        ------
        CapabilityError
            For another backend, and for scenes whose functions of time a run takes piece by piece.
        """
        require(self.backend, self.stages.program, Capability.KERNEL_FUNCTIONS)
        return cast("FunctionEngine", self.engine).functions

    @property
    def vector_field(self) -> Callable[[Any, Any, Any], Any]:
        """``vector_field(t, y, args)``: dy/dt (n_y,) of the state y (n_y,) at parameters args (n_p,), for JAX programs.

        It is traced, and made for ``diffrax.ODETerm``. The components are those of ``layout.state`` and
        ``layout.parameters``; `state` and `parameter_vector` make such arrays. Fields of equal models are equal.

        Raises
        ------
        CapabilityError
            For a backend other than "jax".
        OptionError
            When called with a state or parameters of another length.
        """
        require(self.backend, self.stages.program, Capability.VECTOR_FIELD)
        return cast("TracedEngine", self.engine).vector_field

    @property
    def functions(self) -> Any:
        """Pure functions of (t, y, p) that JAX traces, vectorises and differentiates, for the backend "jax".

        They are `expand`, `outputs`, `energy`, `mass_matrix`, `forcing`, `constraint_jacobian`, `accelerations` and
        `project`; t is a time, y (n_y,) a state, p a mapping of parameters and inputs to scalars, or an array as of
        `parameter_vector`.

        Raises
        ------
        CapabilityError
            For a backend other than "jax".
        """
        require(self.backend, self.stages.program, Capability.STATE_FUNCTIONS)
        return cast("TracedEngine", self.engine).state_functions

    @property
    def _traced_functions(self) -> Any:
        served = not refusal(self.backend, self.stages.program, Capability.STATE_FUNCTIONS)
        return cast("TracedEngine", self.engine).state_functions if served else None

    def explain(self, *, passes: bool = False, formulations: bool = False) -> str:
        """Return, in a few lines, what was chosen and why, what was left out, and operation counts.

        Parameters
        ----------
        passes : bool
            Whether to list the passes that made the program, each with its time in all kernels and the operations that
            it removed from each. Passes on steps of integrators, which are made when a run needs them, are not among
            them.
        formulations : bool
            Whether to count the operations of a right-hand side in every formulation, which derives them. Otherwise
            nothing is derived or compiled.
        """
        from .explain import explain

        return explain(self, passes=passes, formulations=formulations)

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, CompiledModel) and self._identity == other._identity)

    def __hash__(self) -> int:
        return hash(self._identity[1:])

    @once_property
    def _identity(self) -> tuple[Any, ...]:
        """The parts that decide whether models are equal: then compiled code of one serves the other."""
        program = representative(self.stages.program)
        return program, hash(program), self.backend, self.dropped, self.stages.kept

    def __repr__(self) -> str:
        return f"<CompiledModel {self.name!r}: {self.formulation}, {self.backend}>"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.explain())}</pre>"

    def __reduce__(self) -> tuple[Any, ...]:
        return _compiled_again, (self.stages.scene, self.stages.options, self.stages.mode, self.stages.kept)

    # -- what functions over models call; but for `simulate` it is imported when it is first needed ---------

    @property
    def _equations(self) -> EquationsOfMotion:
        return self.stages.equations

    @property
    def _starting_model(self) -> CompiledModel:
        return self

    _simulate_in_own_time = simulate_in_own_time

    def _with_parameters(self, symbols: tuple[Any, ...]) -> CompiledModel:
        return self.variants.with_parameters(symbols)

    def _in_elapsed_time(self, watched: tuple[Any, ...]) -> CompiledModel:
        return self.variants.in_elapsed_time(watched)

    def _check_watched(self, events: Any, reduce: Any) -> None:
        self.derived.events(events, reduce)

    def _sweep_in_own_time(
        self, t_span: tuple[Any, Any], initial: Given, parameters: Given, options: SweepOptions
    ) -> Sweep:
        from .sweep import sweep_in_own_time

        return sweep_in_own_time(self, t_span, initial, parameters, options)

    def _stored_sweep(
        self, given: tuple[Any, Given, Given, Given | None], options: SweepOptions, to: StoreOptions
    ) -> Any:
        from .stored.sweep import stored_sweep
        from .stored.swept_models import SmoothModel

        return stored_sweep(SmoothModel(self), given, options, to)

    def _prepare_in_own_time(self, t_span: tuple[float, float], options: PrepareOptions) -> tuple[str, Prepared]:
        from .prepare import prepare_in_own_time

        return prepare_in_own_time(self, t_span, options)

    def _linearize(
        self, t: float, initial: Given, parameters: Given, states: Sequence[str] | None, outputs: Any
    ) -> Linearization:
        from .linearize import linearize

        return linearize(self, t, initial, parameters, states, outputs)

    def _linearize_period(
        self,
        t: float,
        initial: Given,
        parameters: Given,
        inputs: GivenInputs | None,
        states: Sequence[str] | None,
        outputs: Any,
    ) -> DiscreteLinearization:
        from .linearize_period import linearize_period

        return linearize_period(self, t, initial, parameters, inputs, states, outputs)

    def _sensitivity(
        self, t_span: tuple[float, float], initial: Given, parameters: Given, options: SensitivityOptions
    ) -> Sensitivity:
        from .sensitivity import differentiate_run

        return differentiate_run(self, t_span, initial, parameters, options)

    def _assemble(
        self, t: float, guess: dict[str, float], parameters: Given, fixed: Collection[str]
    ) -> dict[str, float]:
        from .assembly import assembled

        program = self.stages.program
        c = run_input.constants(program, self.parameter_vector(parameters))
        return assembled(program, at_time(program, c, t), t, guess, fixed)

    def _trim(self, guess: Given, parameters: Given, options: TrimOptions) -> OperatingPoint:
        from .trim import find_operating_point

        return find_operating_point(self, guess, parameters, options)

    def _state(self, t: float, initial: Given, parameters: Given) -> FloatArray:
        program = self.stages.program
        c = run_input.constants(program, self.parameter_vector(parameters))
        values = self.initial_values(initial)
        return initial_state(self.derived.start(values), t, values, at_time(program, c, t), program)

    def monitors(self, c: FloatArray, t: FloatArray, x: FloatArray) -> dict[str, FloatArray]:
        """Return the first integrals along a motion, as arrays (n_t,) by name.

        Parameters
        ----------
        c : ndarray (n_c,) or (n_t, n_c)
            Constants.
        t, x : ndarray (n_t,), (n_t, 2 n_q + n_z)
            Times [s]; coordinates, rates and first-order states.
        """
        from .monitors import conserved

        return conserved(self.stages.program, self.derived.invariants, c, t, x)

    def _outputs(self, kernel: str, t: FloatArray, x: FloatArray, p: FloatArray) -> FloatArray | None:
        program = self.stages.program
        if kernel not in program:
            return None
        if p.ndim == 1:
            return self.engine.evaluate(kernel, t, x, run_input.constants(program, p))
        if program.conditions is not None:
            program.conditions.decide_at(p, t)
        return self.engine.rows(program.kernel(kernel), t, x, run_input.prepare_rows(program, p))

    def _depends_on_states(self, kernel: str) -> bool:
        program, first = self.stages.program, 2 * len(self.layout.coordinates)
        loads = program.kernel(kernel).loads if kernel in program else ()
        return any(load.array == "y" and load.index is not None and load.index >= first for load in loads)


def _compiled_again(scene: Scene, options: CompileOptions, mode: Mode | None, kept: tuple[str, ...]) -> CompiledModel:
    """Return the model of a scene that has left the process, in one of the modes of its contacts."""
    derivation = derive_scene(scene, options)
    return CompiledModel.of(compile_equations(derivation, options, mode, (), kept, derivation.seconds))
