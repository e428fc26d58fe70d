"""The list of stages, each a function from one frozen type to the next.

Scene --read--> SceneModel --derive--> EquationsOfMotion --reduce--> ReducedSystem --lower--> Program
      --render--> RenderedModule --load--> Engine

Modes of contacts, models that keep first integrals or drop constraints, and other formulations begin with a copy of the
derived equations of motion.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar, final

from .codegen import backend_named
from .codegen.base import RenderedModule
from .codegen.engine import Engine
from .codegen.kept_kernels import KeptKernels
from .errors import CompileTimeWarning, EnergyWarning, OptionError, SceneError, list_names, warn_caller
from .frozen import frozen
from .ir.program import Program
from .lowering.programs import lower
from .mechanics.derive import derive
from .mechanics.equations import EquationsOfMotion, copied
from .once import deriving
from .options import CompileOptions
from .progress import enter_stage
from .reduction import ReducedSystem, reduce
from .reduction.dependent_rows import Redundancy
from .reduction.stabilised import with_fixed_gains
from .scene import Scene
from .scene.model import SceneModel
from .scene.reading import read
from .transforms.pipelines import PassRecord

if TYPE_CHECKING:
    from .contacts.automaton import HybridAutomaton
    from .contacts.equations.contact_laws import Mode

T = TypeVar("T")


@final
@frozen
class Derivation:
    """A scene and its equations of motion, in all modes of its contacts.

    `equations` are as they were derived: later stages, which give the values of a graph other forms, take copies of
    them. `seconds` are those of the stages up to here.
    """

    scene: Scene
    model: SceneModel
    equations: EquationsOfMotion
    seconds: Mapping[str, float]


@final
@frozen
class Stages:
    """Every object that the pipeline passed from stage to stage, the seconds of each stage, and the options.

    `passes` are records of the passes that made the program, one for each pass and kernel, in their order. `derivation`
    has the equations in all modes, before any formulation.
    """

    scene: Scene
    model: SceneModel
    equations: EquationsOfMotion
    reduced: ReducedSystem
    program: Program
    rendered: RenderedModule
    seconds: Mapping[str, float]
    options: CompileOptions
    derivation: Derivation
    mode: Mode | None = None
    kept: tuple[str, ...] = ()
    passes: tuple[PassRecord, ...] = ()

    @cached_property
    def compile_seconds(self) -> float:
        """Seconds of all stages."""
        return sum(self.seconds.values())


@final
@frozen
class Compiled:
    """A scene in one mode of its contacts: its stages, the loaded engine, and methods by name with descriptions."""

    stages: Stages
    engine: Engine
    methods: Mapping[str, str]


@final
@frozen
class SeveralModes:
    """A scene whose contacts have several modes, each of which is compiled on first use.

    The automaton has a copy of the equations of the derivation.
    """

    scene: Scene
    options: CompileOptions
    automaton: HybridAutomaton
    derivation: Derivation


@final
class Stopwatch:
    """Runs stages and records the seconds of each."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def __call__(self, stage: str, run: Callable[[], T]) -> T:
        """Return the result of a stage."""
        enter_stage(stage)
        start = time.perf_counter()
        result = run()
        self.seconds[stage] = time.perf_counter() - start
        return result


@deriving
def compile_scene(
    scene: Scene,
    options: CompileOptions,
    mode: Mode | None = None,
    without: tuple[int, ...] = (),
    kept: tuple[str, ...] = (),
    redundancy: Redundancy | None = None,
) -> Compiled | SeveralModes:
    """Return a compiled scene or, for contacts with several modes of which none is chosen, the automaton of modes.

    The scene must not change later; the other arguments are those of `compile_equations`.
    """
    derivation = derive_scene(scene, options)
    contacts = derivation.equations.contacts
    if contacts and mode is None:
        from .contacts.automaton import HybridAutomaton
        from .contacts.equations.modes import only_mode

        mode = only_mode(contacts)
        if mode is None:
            automaton = HybridAutomaton.of(copied(derivation.equations), options.impacts)
            return SeveralModes(scene, options, automaton, derivation)
    return compile_equations(derivation, options, mode, without, kept, derivation.seconds, redundancy)


@deriving
def derive_scene(scene: Scene, options: CompileOptions) -> Derivation:
    """Return the equations of motion of a scene."""
    watch = Stopwatch()
    watch("backend", lambda: backend_named(options.backend))
    model = watch("read", lambda: read(scene, options.outputs))
    unused = [each.name for each in model.symbols.inputs if not each.used]
    if unused:
        raise SceneError(
            scene.name,
            [
                f"nothing in the scene depends on the input {name!r}; use it, or leave it out of add_inputs"
                for name in unused
            ],
        )
    equations = watch("derive", lambda: with_fixed_gains(derive(model), options.gains))
    equations.graph.store = KeptKernels() if options.cache else None
    if equations.contacts:
        from .mechanics.released_balances import with_hidden_normals

        bare = equations
        equations = watch("balances", lambda: with_hidden_normals(bare))
    return Derivation(scene, model, equations, watch.seconds)


def compile_mode(several: SeveralModes, mode: Mode) -> Compiled:
    """Return a scene in one of the modes of its contacts, compiled."""
    return compile_equations(several.derivation, several.options, mode)


@deriving
def compile_equations(
    derivation: Derivation,
    options: CompileOptions,
    mode: Mode | None = None,
    without: tuple[int, ...] = (),
    kept: tuple[str, ...] = (),
    seconds: Mapping[str, float] | None = None,
    redundancy: Redundancy | None = None,
) -> Compiled:
    """Return equations of motion compiled: the stages from the formulation on.

    Parameters
    ----------
    derivation : Derivation
        The scene and its equations.
    options : CompileOptions
        Options of the compilation; the outputs are among those that the equations have.
    mode : Mode or None
        What each contact does; None without contacts.
    without : tuple of int
        Constraints that a run found to follow from the others; they are monitored, but not enforced.
    kept : tuple of str
        First integrals that are kept at their initial values.
    seconds : mapping of str to float, optional
        Seconds of stages that were run for this compilation alone.
    redundancy : Redundancy, optional
        What a run found of constraints that are enforced together, though some follow from others.
    """
    names, watch = output_names(options.outputs), Stopwatch()
    watch.seconds.update(seconds or {})
    backend = backend_named(options.backend)
    equations, switched = watch("copy", lambda: copied(derivation.equations)), False
    if mode is not None:
        from .contacts.equations.modes import mode_equations
        from .contacts.equations.switched_modes import any_mode, switched_equations, switched_system

        single, whole = mode, equations
        switched = mode == any_mode(len(mode))
        equations = watch("mode", lambda: switched_equations(whole) if switched else mode_equations(whole, single))
        names += [] if switched else [point.output for point in equations.guards]
    if switched:
        reduced = watch("reduce", lambda: switched_system(equations, whole, names))
    else:
        reduced = watch("reduce", lambda: reduce(equations, options.formulation, names, without, redundancy))
    _refuse_names_of_the_state(derivation.model, reduced)
    if kept:
        from .reduction.invariant_projection import project_invariants

        unprojected = reduced
        reduced = watch("project", lambda: project_invariants(unprojected, kept))
    records: list[PassRecord] = []
    program = watch("lower", lambda: lower(reduced, records))
    if program.energy_note and {"energy", "potential_energy"} & set(names):
        warn_caller(program.energy_note, EnergyWarning)
    methods, long = backend.serving(program), backend.long_compilation(program)
    if long:
        warn_caller(long, CompileTimeWarning)
    rendered = watch("render", lambda: backend.render(program))
    engine = watch("load", lambda: backend.load(rendered, cache=options.cache))
    stages = Stages(
        derivation.scene,
        derivation.model,
        equations,
        reduced,
        program,
        rendered,
        watch.seconds,
        options,
        derivation,
        mode,
        kept,
        tuple(records),
    )
    return Compiled(stages, engine, methods)


def _refuse_names_of_the_state(model: SceneModel, reduced: ReducedSystem) -> None:
    """Raise for outputs that have the name of a component of the state."""
    known = (*model.symbols.coordinates, *model.symbols.rates)
    taken = [name for name in model.chosen if name in reduced.state and name not in known]
    if taken:
        raise OptionError(
            f"scene {model.name!r}: the outputs {list_names(taken)} have the names of components of the state in the"
            f" formulation {reduced.formulation!r}; give them other names"
        )


def output_names(outputs: Sequence[Any]) -> list[str]:
    """Return the names of requested outputs: strings unchanged, symbols and expressions by their text."""
    return [str(output) for output in outputs]
