"""The list of stages, each a function from one frozen type to the next.

Scene --read--> SceneModel --derive--> EquationsOfMotion --reduce--> ReducedSystem --lower--> Program
      --render--> RenderedModule --load--> Engine
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, final

from .codegen import backend_named
from .codegen.base import Engine, RenderedModule
from .errors import EnergyWarning
from .ir.program import Program
from .lowering.programs import lower
from .mechanics.derive import derive
from .mechanics.equations import EquationsOfMotion
from .once import deriving
from .options import CompileOptions
from .reduction import ReducedSystem, reduce
from .reduction.keeping import keeping
from .reduction.modes import Mode, always, in_mode
from .scene import Scene
from .scene.model import SceneModel
from .scene.reading import read
from .transforms.pipelines import PassRecord

__all__ = ["Compiled", "SeveralModes", "Stages", "Stopwatch", "compile_stages", "output_names"]

T = TypeVar("T")


@final
@dataclass(frozen=True)
class Stages:
    """Every object that the pipeline passed from stage to stage, the seconds of each stage, and what was asked for.

    `passes` are records of the passes that made the program, one for each pass and kernel, in their order.
    """

    scene: Scene
    model: SceneModel
    equations: EquationsOfMotion
    reduced: ReducedSystem
    program: Program
    rendered: RenderedModule
    seconds: dict[str, float]
    options: CompileOptions
    mode: Mode | None = None
    kept: tuple[str, ...] = ()
    passes: tuple[PassRecord, ...] = ()

    @property
    def compile_seconds(self) -> float:
        """Seconds of all stages."""
        return sum(self.seconds.values())


@final
@dataclass(frozen=True)
class Compiled:
    """A scene in one mode of its contacts: its stages, the loaded engine, and methods by name with descriptions."""

    stages: Stages
    engine: Engine
    methods: Mapping[str, str]


@final
@dataclass(frozen=True)
class SeveralModes:
    """A scene whose contacts have several modes, each of which is compiled when it is first needed."""

    scene: Scene
    options: CompileOptions
    equations: EquationsOfMotion


@final
class Stopwatch:
    """Runs stages and records the seconds of each."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def __call__(self, stage: str, run: Callable[[], T]) -> T:
        """Return the result of a stage."""
        start = time.perf_counter()
        result = run()
        self.seconds[stage] = time.perf_counter() - start
        return result


@deriving
def compile_stages(
    scene: Scene,
    options: CompileOptions,
    without: tuple[int, ...] = (),
    mode: Mode | None = None,
    kept: tuple[str, ...] = (),
) -> Compiled | SeveralModes:
    """Run the stages.

    Parameters
    ----------
    scene : Scene
        Must not change later.
    options : CompileOptions
        Options of the compilation.
    without : tuple of int
        Constraints that a run found to follow from the others; they are watched, but not enforced.
    mode : Mode or None
        What each contact does; None where there is only one possibility, or for all of them.
    kept : tuple of str
        First integrals that are kept at their initial values.
    """
    names = output_names(options.outputs)
    watch = Stopwatch()
    backend = watch("backend", lambda: backend_named(options.backend))
    model = watch("read", lambda: read(scene, options.outputs))
    equations = watch("derive", lambda: derive(model))
    if equations.contacts:
        mode = mode or always(equations.contacts)
        if mode is None:
            return SeveralModes(scene, options, equations)
        single = mode
        equations = watch("mode", lambda: in_mode(equations, single))
        names += [point.output for point in equations.watchpoints]
    reduced = watch("reduce", lambda: reduce(equations, options.formulation, names, options.gains, without))
    if kept:
        unprojected = reduced
        reduced = watch("keep", lambda: keeping(unprojected, kept))
    records: list[PassRecord] = []
    program = watch("lower", lambda: lower(reduced, records))
    if program.energy_note and {"energy", "potential_energy"} & set(names):
        warnings.warn(program.energy_note, EnergyWarning, stacklevel=3)
    methods = backend.serving(program)
    rendered = watch("render", lambda: backend.render(program))
    engine = watch("load", lambda: backend.load(rendered, cache=options.cache))
    stages = Stages(
        scene, model, equations, reduced, program, rendered, watch.seconds, options, mode, kept, tuple(records)
    )
    return Compiled(stages, engine, methods)


def output_names(outputs: Sequence[Any]) -> list[str]:
    """Return what requested outputs are called: names as they are, symbols and expressions by their text."""
    return [str(output) for output in outputs]
