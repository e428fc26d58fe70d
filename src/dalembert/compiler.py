"""The pipeline: a list of stages, each a function from one frozen type to the next.

Scene --read--> SceneModel --derive--> EquationsOfMotion --reduce--> ReducedSystem --lower--> Program
      --render--> RenderedModule --load--> CompiledModel
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from .errors import EnergyWarning, nesting_named
from .ir.lower import lower
from .mechanics.derive import derive
from .naming import rate_name
from .once import deriving
from .options import CompileOptions
from .reduction import reduce
from .reduction.keeping import keeping
from .reduction.modes import Mode, always, in_mode
from .scene import Scene
from .scene.orientation import with_quaternions
from .scene.outputs import requested
from .scene.reading import read
from .stages import Stages, Stopwatch

if TYPE_CHECKING:
    from sympy.physics.mechanics import KanesMethod, LagrangesMethod, System

    from .runtime.hybrid import HybridModel
    from .runtime.model import CompiledModel

__all__ = ["Stages", "compile_model", "compile_scene"]


@deriving
@nesting_named
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
    return _compiled(source, CompileOptions(backend, formulation, requested(outputs), cache, gains, orientation))


def _compiled(source: Any, options: CompileOptions) -> CompiledModel | HybridModel:
    """Return the model of a scene, or of what becomes one, with the outputs that it always has."""
    scene = source.copy() if isinstance(source, Scene) else Scene.from_sympy(source)
    wanted = options.outputs
    angles: list[str] = []
    if options.orientation == "quaternion":
        scene = with_quaternions(scene)
        angles = [a.func.__name__ for item in scene.orientations for a in item.angles]
    speeds = [u.func.__name__ for u in scene.speeds]
    named = dict.fromkeys((*angles, *map(rate_name, angles), *wanted))
    named |= dict.fromkeys(name for name in speeds if name not in _names(wanted))
    options = replace(options, outputs=tuple(named))
    return compile_scene(scene, options)


@deriving
def compile_scene(
    scene: Scene,
    options: CompileOptions,
    without: tuple[int, ...] = (),
    mode: Mode | None = None,
    kept: tuple[str, ...] = (),
) -> CompiledModel | HybridModel:
    """Return the model of a scene by the stages; `recompiling` tells the arguments."""
    from .codegen import backend_named
    from .runtime.model import CompiledModel
    from .runtime.segments import segmented

    names = _names(options.outputs)
    watch = Stopwatch()
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
    if program.energy_note and {"energy", "potential_energy"} & set(names):
        warnings.warn(program.energy_note, EnergyWarning, stacklevel=3)
    methods = chosen.serving(program)
    rendered = watch("render", lambda: chosen.render(program, cache=options.cache))
    engine = watch("load", lambda: segmented(chosen.load(rendered, cache=options.cache), program))
    stages = Stages(scene, model, equations, reduced, program, rendered, watch.seconds, options, mode, kept)
    return CompiledModel(stages, engine, methods)


def _names(outputs: Sequence[Any]) -> list[str]:
    """Return what requested outputs are called: names as they are, symbols and expressions by their text."""
    return [str(output) for output in outputs]
