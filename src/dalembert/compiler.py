"""The pipeline: a list of stages, each a function from one frozen type to the next.

Scene --read--> SceneModel --derive--> EquationsOfMotion --reduce--> ReducedSystem --lower--> Program
      --render--> RenderedModule --load--> CompiledModel
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, final

from sympy import Basic
from sympy.physics.mechanics import Point

from .errors import OptionError, list_names
from .ir.lower import lower
from .ir.program import Program
from .mechanics.derive import derive
from .mechanics.equations import EquationsOfMotion
from .naming import rate_name
from .options import CompileOptions
from .reduction import ReducedSystem, reduce
from .reduction.keeping import keeping
from .reduction.modes import Mode, always, in_mode
from .scene import Scene
from .scene.model import SceneModel
from .scene.orientation import with_quaternions
from .scene.reading import read
from .scene.scene import Place

if TYPE_CHECKING:
    from sympy.physics.mechanics import KanesMethod, LagrangesMethod, System

    from .codegen.base import RenderedModule
    from .runtime.hybrid import HybridModel
    from .runtime.model import CompiledModel

__all__ = ["Stages", "compile_model"]


@final
@dataclass(frozen=True)
class Stages:
    """Every object that the pipeline passed from stage to stage, the seconds of each stage, and what was asked for."""

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


def compile_model(
    source: Scene | System | KanesMethod | LagrangesMethod,
    *,
    backend: str = "numba",
    formulation: str = "auto",
    outputs: Sequence[Any] = (),
    cache: bool = True,
    gains: tuple[float, float] | None = None,
    orientation: str = "scene",
) -> CompiledModel | HybridModel:
    """Compile a scene to a simulator.

    Parameters
    ----------
    source : Scene, or System, KanesMethod or LagrangesMethod of SymPy
        The scene; it is copied, so that later changes to it do not reach the model. For what SymPy's systems become,
        see `Scene.from_sympy`.
    backend : str
        "numba" (default), "jax" or "numpy".
    formulation : str
        "minimal", "projected", "baumgarte", "ggl" or "augmented"; "auto" takes "minimal" where independent speeds
        exist that are regular at every configuration, else "projected".
    outputs : sequence of str, SymPy expressions or Points
        What to record beside coordinates, rates and energy: names of unknown reaction components, expressions of the
        scene's symbols, or points, of which ``"P_x"``, ``"P_y"`` and ``"P_z"`` are the position from the scene's
        origin on its frame. Nothing else is computed.
    cache : bool
        Whether the generated module and its compiled code may be kept on disk.
    gains : (float, float), optional
        Gains alpha and beta [1/s] of "baumgarte". Without them they are parameters ``baumgarte_alpha`` and
        ``baumgarte_beta``, which may be left out: `simulate` then takes one over the size of the run's first steps.
    orientation : str
        "scene" (default) takes the coordinates as they are. With "quaternion", bodies that three angles orient, and do
        nothing else, have unit quaternions for coordinates, which are singular nowhere; initial values are given in
        the angles or the quaternion, and the angles and their rates are outputs.

    Returns
    -------
    CompiledModel or HybridModel
        A scene with friction or contacts that has several modes gives the second, which is used like the first.

    Raises
    ------
    SceneError, ConstraintError, SingularMassMatrixError
        For a scene that is not complete or contradicts itself.
    FormulationError, OptionError, UnknownNameError, MissingExtraError
        For options that do not exist, or cannot serve the scene.
    """
    scene = source.copy() if isinstance(source, Scene) else Scene.from_sympy(source)
    wanted = tuple(part for output in _listed(outputs) for part in _parts(output))
    options = CompileOptions(backend, formulation, wanted, cache, gains, orientation)
    angles: list[str] = []
    if orientation == "quaternion":
        scene = with_quaternions(scene)
        angles = [a.func.__name__ for item in scene.orientations for a in item.angles]
    speeds = [u.func.__name__ for u in scene.speeds]
    named = dict.fromkeys((*angles, *map(rate_name, angles), *wanted))
    named |= dict.fromkeys(name for name in speeds if name not in _names(wanted))
    options = replace(options, outputs=tuple(named))
    return _compile(scene, options)


def recompile(stages: Stages, without: tuple[int, ...] = (), kept: tuple[str, ...] | None = None) -> CompiledModel:
    """Return the model of the same scene with less, or more, done after each step.

    Parameters
    ----------
    stages : Stages
        Of the model.
    without : tuple of int
        Constraints that a run found to follow from the others; they are watched, but not enforced.
    kept : tuple of str, optional
        First integrals that are kept at their initial values; by default as before.

    Raises
    ------
    FormulationError
        Where the formulation cannot keep first integrals.
    """
    options = replace(stages.options, formulation=stages.program.formulation)
    return compile_mode(stages.scene, options, stages.mode, without, stages.kept if kept is None else kept)


def compile_mode(
    scene: Scene,
    options: CompileOptions,
    mode: Mode | None,
    without: tuple[int, ...] = (),
    kept: tuple[str, ...] = (),
) -> CompiledModel:
    """Return the model of a scene in one of the modes of its contacts; None for a scene that has only one."""
    from .runtime.hybrid import HybridModel

    model = _compile(scene, options, without, mode, kept)
    assert not isinstance(model, HybridModel)
    return model


def compile_modes(scene: Scene, options: CompileOptions) -> CompiledModel | HybridModel:
    """Return the model of a scene with contacts."""
    return _compile(scene, options)


def _compile(
    scene: Scene,
    options: CompileOptions,
    without: tuple[int, ...] = (),
    mode: Mode | None = None,
    kept: tuple[str, ...] = (),
) -> CompiledModel | HybridModel:
    from .codegen import backend_named
    from .runtime.model import CompiledModel

    names = _names(options.outputs)
    watch = _Watch()
    chosen = watch("backend", lambda: backend_named(options.backend))
    model = watch("read", lambda: read(scene, options.outputs))
    equations = watch("derive", lambda: derive(model))
    if equations.contacts:
        mode = mode or always(equations.contacts)
        if mode is None:
            from .runtime.hybrid import HybridModel

            return HybridModel(scene, options, equations)
        equations = watch("mode", lambda: in_mode(equations, mode))
        names += [point.output for point in equations.watchpoints]
    reduced = watch("reduce", lambda: reduce(equations, options.formulation, names, options.gains, without))
    if kept:
        reduced = watch("keep", lambda: keeping(reduced, kept))
    program = watch("lower", lambda: lower(reduced))
    methods = chosen.serving(program)
    rendered = watch("render", lambda: chosen.render(program, cache=options.cache))
    engine = watch("load", lambda: chosen.load(rendered, cache=options.cache))
    stages = Stages(scene, model, equations, reduced, program, rendered, watch.seconds, options, mode, kept)
    return CompiledModel(stages, engine, methods)


def _listed(outputs: Any) -> tuple[Any, ...]:
    """Return requested outputs, or the one that was given alone.

    Raises
    ------
    OptionError
        For what is no output.
    """
    kinds = str | Basic | Point
    listed = (outputs,) if isinstance(outputs, kinds) or not isinstance(outputs, Iterable) else tuple(outputs)
    strange = [repr(output) for output in listed if not isinstance(output, kinds)]
    if strange:
        raise OptionError(f"outputs are names, expressions of the scene's symbols or Points, not {list_names(strange)}")
    return listed


def _parts(output: Any) -> tuple[Any, ...]:
    """Return an output as it is, and a point as the components of its position."""
    return tuple(Place(output, axis) for axis in range(3)) if isinstance(output, Point) else (output,)


def _names(outputs: Sequence[Any]) -> list[str]:
    """Return what requested outputs are called: names as they are, symbols and expressions by their text."""
    return [str(output) for output in outputs]


@final
class _Watch:
    """Runs stages and takes down how long each took."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def __call__(self, stage: str, run: Any) -> Any:
        start = time.perf_counter()
        result = run()
        self.seconds[stage] = time.perf_counter() - start
        return result
