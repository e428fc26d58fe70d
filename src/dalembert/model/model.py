"""`CompiledModel`: the result of `dalembert.compile_model`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import TYPE_CHECKING, Any, cast, final

from ..codegen.base import Capability
from ..codegen.engine import Engine
from ..errors import list_names
from ..ir.program import Layout, representative
from ..mechanics.equations import EquationsOfMotion
from ..once import BoundedTable, derived_once, derived_property, once_property
from ..options import CompileOptions
from ..pipeline import Compiled, SeveralModes, Stages, compile_scene
from ..runs.capabilities import require
from ..runs.engines import engine_of
from ..scene import Scene
from . import choices, derivatives, evaluation, exports, inverse, motions, rows, states, sweeps, traced
from .choices import OfOneMode
from .derived import Derived, Variants

if TYPE_CHECKING:
    from ..analysis.inverse_kernel import InverseKernel
    from ..analysis.rate_jacobians import JacobianKernel
    from ..analysis.regressor import RegressorKernel
    from ..codegen.engine import TracedEngine
    from ..contacts.equations.contact_laws import Mode
    from ..phases.mode_models import ModeModels
    from ..runs.run_check import RunCheck
    from ..scene.model import ControllerModel
    from ..scene.symbol_table import InputSymbol

_MOST_INVERSE = 8
"""Sets of given inputs of which the kernels of inverse dynamics are kept."""


@final
@dataclass(frozen=True, eq=False, repr=False, init=False)
class CompiledModel:
    """A scene compiled for one backend in one formulation.

    It holds what was compiled and does not change. Its methods are functions over it, in this package.
    Models of equal programs are equal: compiled code that JAX keeps for one serves the other.

    A scene whose contacts change between sliding, sticking and being open has a model for each mode, made when it is
    needed (`mode`), and no stages of its own. Its `mass_matrix`, `forcing` (without the forces of the contacts) and
    `constraint_jacobian` (of the constraints that hold whatever the contacts do) are the same in all modes.
    `accelerations` are those of the mode that a state decides, and `linearize` is that of this mode alone.

    Attributes
    ----------
    layout : Layout
        Names of everything that arrays hold; with contacts that change, the state is coordinates, rates and first-order
        states.
    equations : EquationsOfMotion
        The equations of the scene, in a mode those of the mode.
    options : CompileOptions
        Options of the compilation.
    inputs, controllers : tuple
        Inputs and controllers of the scene.
    variants : Variants
        Other models of the scene that runs need, compiled on demand, and kept.
    modes : ModeModels or None
        Models of the modes; None for a scene whose contacts do not change, and for a mode. Then there are, too:
    stages : Stages
        Every object of the pipeline, from the scene to the rendered module.
    engine : Engine
        The loaded module: compiled kernels, and integrators that call them.
    method_descriptions : mapping of str to str
        Integration methods by name, each with one line of description.
    dropped : tuple of int
        Constraints that are not enforced, because they follow from the others around the start of a run.
    derived : Derived
        Kernels and facts that are derived on demand, and kept.
    chosen : dict
        Methods that "auto" took, by `rtol`, `atol` and whether many cases ran at once.
    """

    equations: EquationsOfMotion
    layout: Layout
    options: CompileOptions
    inputs: tuple[InputSymbol, ...]
    controllers: tuple[ControllerModel, ...]
    variants: Variants
    modes: ModeModels | None
    stages: Stages
    engine: Engine
    method_descriptions: Mapping[str, str]
    dropped: tuple[int, ...]
    derived: Derived
    chosen: dict[tuple[float, float, bool], str]

    mode = choices.mode
    choose_method = choices.choose_method
    source_of = OfOneMode(choices.source_of)
    parameter_vector = states.parameter_vector
    initial_values = states.initial_values
    state = states.state
    expand = OfOneMode(states.expand)
    assemble = states.assemble
    mass_matrix = evaluation.mass_matrix
    forcing = evaluation.forcing
    constraint_jacobian = evaluation.constraint_jacobian
    accelerations = evaluation.accelerations
    rate_jacobians = evaluation.rate_jacobians
    inverse_dynamics = inverse.inverse_dynamics
    regressor = inverse.regressor
    inertial_parameters = inverse.inertial_parameters
    monitors = evaluation.monitors
    simulate = motions.simulate
    sweep = sweeps.sweep
    prepare = motions.prepare
    export = exports.export
    to_casadi = exports.to_casadi
    compare_formulations = OfOneMode(motions.compare_formulations)
    sensitivity = derivatives.sensitivity
    linearize = derivatives.linearize
    trim = derivatives.trim
    solve_fn = traced.solve_fn
    kernels = property(choices.kernels)
    functions = property(choices.functions)
    read_parameters = once_property(rows.read_parameters)
    read_initial = once_property(rows.read_initial)

    def __init__(self, source: Stages | ModeModels, variants: Variants, **of_one_mode: Any) -> None:
        """Initialise a model of modes, or of stages with `engine`, `method_descriptions`, `dropped` and `derived`."""
        if isinstance(source, Stages):
            about: dict[str, Any] = {"stages": source, "modes": None, "chosen": {}}
            layout, options = source.program.layout, source.options
        else:
            about, layout, options = {"modes": source}, source.layout, source.several.options
        equations = source.equations
        about |= {"equations": equations, "layout": layout, "options": options, "variants": variants}
        given = {"inputs": equations.symbols.inputs, "controllers": equations.controllers}
        self.__dict__.update(about | given | of_one_mode)

    @classmethod
    def of(cls, compiled: Compiled | SeveralModes, dropped: tuple[int, ...] = ()) -> CompiledModel:
        """Return the model of a scene that went through all stages, or of one with several modes."""
        if isinstance(compiled, SeveralModes):
            from ..phases.mode_models import ModeModels  # imported where there are contacts, because it takes a while

            return cls(ModeModels(compiled, cls.of), Variants(compiled, (), cls.of))
        stages = compiled.stages
        derived, variants = Derived(stages, compiled.engine), Variants(stages, dropped, cls.of)
        engine = engine_of(compiled, derived.start)
        engine.accept_as_static(cls)
        about = {"method_descriptions": compiled.methods, "dropped": dropped, "derived": derived}
        return cls(stages, variants, engine=engine, **about)

    @once_property
    def for_segments(self) -> CompiledModel:
        """The model for parts of runs that end where functions of time break, and between acts of controllers."""
        about = {name: getattr(self, name) for name in ("method_descriptions", "dropped", "derived")}
        variants = Variants(self.stages, self.dropped, lambda *compiled: CompiledModel.of(*compiled).for_segments)
        stages = replace(self.stages, program=replace(self.stages.program, conditions=None))
        return CompiledModel(stages, variants, engine=self.engine.for_segments, **about)

    # -- the modes of contacts -------------------------------------------------------------

    @property
    def contacts(self) -> tuple[str, ...]:
        """Names of the contacts of the scene."""
        derivation = self.stages.derivation if self.modes is None else self.modes.several.derivation
        return tuple(contact.name for contact in derivation.equations.contacts)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(choices.missing(self, name))

    # -- what was compiled -----------------------------------------------------------------

    @derived_property
    def checks(self) -> tuple[RunCheck, ...]:
        """What runs of the model are checked for."""
        from ..runs.run_checks import run_checks

        return run_checks(self)

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self.equations.name

    @property
    def backend(self) -> str:
        """Name of the backend."""
        return self.options.backend

    @property
    def formulation(self) -> str:
        """Name of the formulation; with several modes the requested one, and each mode has its own."""
        return self.stages.program.formulation if self.modes is None else self.options.formulation

    @property
    def methods(self) -> tuple[str, ...]:
        """Integration methods of the backend, other than "auto"; those that serve every mode compiled so far."""
        if self.modes is None:
            return tuple(self.method_descriptions)
        every = [model.methods for model in self.modes.compiled.values()]
        return tuple(name for name in every[0] if all(name in methods for methods in every))

    @property
    def note(self) -> str:
        """Which constraints are not enforced and why; nothing where all are."""
        labels = [self.layout.constraints[i] for i in self.dropped]
        if not labels:
            return ""
        return f"not enforced, because it follows from the others around the start: {'; '.join(labels)}"

    @property
    def source(self) -> str:
        """The generated code that runs by default, by "auto" at the default tolerances; of all modes so far."""
        if self.modes is None:
            return self.stages.rendered.source
        every = self.modes.compiled.items()
        return "\n\n".join(f"# mode {self.modes.named(mode)}\n\n{model.source}" for mode, model in every)

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

    def explain(self, *, passes: bool = False, formulations: bool = False) -> str:
        """Return, in a few lines, what was chosen and why, what was left out, and operation counts.

        With contacts that change it reports every mode compiled so far.

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
        if self.modes is not None:
            return id(self), id(self)
        program = representative(self.stages.program)
        return program, hash(program), self.backend, self.dropped, self.stages.kept

    def __repr__(self) -> str:
        about = self.formulation if self.modes is None else f"contacts {list_names(self.contacts)}"
        return f"<CompiledModel {self.name!r}: {about}, {self.backend}>"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.explain())}</pre>"

    def __reduce__(self) -> tuple[Any, ...]:
        if self.modes is not None:
            return _compiled_again, (self.modes.several.scene, self.options)
        return _compiled_again, (self.stages.scene, self.options, self.stages.mode, self.stages.kept)

    # -- what functions over models read ---------------------------------------------------

    def inverse_kernel(self, given: Sequence[str]) -> InverseKernel:
        """Return the kernel of inverse dynamics for some given inputs, derived once for each set of them."""
        from ..analysis.inverse_kernel import inverse_kernel

        return derived_once(self._inverse_kernels, tuple(sorted(given)), lambda: inverse_kernel(self, given))

    def regressor_kernel(self, given: Sequence[str], loads: tuple[str, ...]) -> RegressorKernel:
        """Return the kernel of the regressor for some given inputs and coefficients of loads, derived once for each."""
        from ..analysis.regressor import regressor_kernel

        key = tuple(sorted(given)), loads
        return derived_once(self._regressor_kernels, key, lambda: regressor_kernel(self, given, loads))

    @derived_property
    def jacobian_kernel(self) -> JacobianKernel:
        """The kernel of the derivatives of the rates of the state."""
        from ..analysis.rate_jacobians import jacobian_kernel_of

        return jacobian_kernel_of(self)

    @once_property
    def _inverse_kernels(self) -> BoundedTable[tuple[str, ...], InverseKernel]:
        return BoundedTable(_MOST_INVERSE)

    @once_property
    def _regressor_kernels(self) -> BoundedTable[tuple[tuple[str, ...], tuple[str, ...]], RegressorKernel]:
        return BoundedTable(_MOST_INVERSE)


def _compiled_again(
    scene: Scene, options: CompileOptions, mode: Mode | None = None, kept: tuple[str, ...] = ()
) -> CompiledModel:
    """Return the model of a scene that has left the process, in one of the modes of its contacts."""
    return CompiledModel.of(compile_scene(scene, options, mode, kept=kept))
