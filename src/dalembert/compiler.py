"""`compile_model`: the public function from a scene to a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from .errors import nesting_named
from .naming import rate_name
from .once import deriving
from .options import CompileOptions
from .pipeline import compile_scene, output_names
from .progress import compilation_meter
from .scene import Scene
from .scene.contacts.made import with_made_contacts
from .scene.joints.joints import requested
from .scene.joints.reactions import with_reactions
from .scene.orientation import with_quaternions
from .values import flag

if TYPE_CHECKING:
    from sympy.physics.mechanics import KanesMethod, LagrangesMethod, System

    from .model.model import CompiledModel


@deriving
@nesting_named
def compile_model(
    source: Scene | System | KanesMethod | LagrangesMethod,
    *,
    backend: str = "llvm",
    formulation: str = "auto",
    outputs: Sequence[Any] | Mapping[str, Any] = (),
    cache: bool = True,
    gains: tuple[float, float] | None = None,
    orientation: str = "scene",
    impacts: str = "newton",
    progress: bool = False,
) -> CompiledModel:
    """Compile a scene to a simulator.

    Parameters
    ----------
    source : Scene, or System, KanesMethod or LagrangesMethod of SymPy
        The scene; it is copied, so that later changes to it do not reach the model. For what SymPy's systems become,
        see `Scene.from_sympy`.
    backend : str
        "llvm" (default): kernels as LLVM assembly, compiled in a fraction of a second; "numba": a generated module that
        numba compiles in seconds, whose functions can be called in other compiled code (`CompiledModel.kernels`);
        "jax"; "numpy": plain Python.
    formulation : str
        "minimal", "projected", "baumgarte", "ggl" or "augmented"; "auto" takes "minimal" where independent speeds
        exist that are regular at every configuration, else "projected".
    outputs : sequence of str, SymPy expressions, Points, Vectors or mappings, or mapping of names to them
        What to record beside coordinates, rates and energy: names of unknown reaction components (for those without
        power on the coordinates, bodies are moved in the program of reactions alone), expressions of the
        scene's symbols, points, of which ``"P_x"``, ``"P_y"`` and ``"P_z"`` are the position from the scene's origin
        on its frame, or vectors, of which a mapping ``{"v": vector}`` gives the components ``"v_x"``, ``"v_y"`` and
        ``"v_z"`` on that frame, or what `Scene.reaction` returns, of which ``{"R": scene.reaction("elbow")}`` gives
        ``"R.force_x"`` and so on. Expressions and vectors may contain accelerations ``x.diff(t, 2)``; alone, one is
        called ``"x_ddot"``. Nothing else is computed.
    cache : bool
        Whether the equations as they are compiled, and their code, may be kept on disk.
    gains : (float, float), optional
        Gains alpha and beta [1/s] of "baumgarte". Without them they are parameters ``baumgarte_alpha`` and
        ``baumgarte_beta``, which may be left out: `simulate` then takes one over the size of the run's first steps.
    orientation : str
        "scene" (default) takes the coordinates as they are. With "quaternion", bodies that three angles orient, and do
        nothing else, have unit quaternions for coordinates, which are singular nowhere; initial values are given in
        the angles or the quaternion, and the angles and their rates are outputs.
    impacts : str
        What several contacts do at an impact. "newton" (default): all that touch take part at once, each that is
        struck with its coefficient of restitution. "poisson": all that touch take part at once; each returns its
        coefficient times the normal impulse that has pressed it together, so that friction does not make energy.
        "sequence": the one that approaches fastest is struck alone, as if the others were a little open, then the next,
        until none approaches; so balls in touch pass momentum on as balls with small gaps do. ``traj.message`` says
        where impacts shared an instant.
    progress : bool
        Whether to show a bar with the stages of the compilation (needs tqdm). Machine code of long steps is compiled
        in the first run, whose bar shows it.

    Returns
    -------
    CompiledModel

    Raises
    ------
    SceneError, ConstraintError, SingularMassMatrixError
        For a scene that is not complete or contradicts itself.
    FormulationError, OptionError, UnknownNameError, MissingExtraError
        For options that do not exist, or do not support the scene.

    Examples
    --------
    The pendulum of `Scene`, with its height as a further result::

        model = da.compile_model(scene, outputs={"height": -l * cos(theta)})
        print(model.explain())
    """
    with compilation_meter(flag("progress", progress)):
        return _compiled(
            source, CompileOptions(backend, formulation, requested(outputs), cache, gains, orientation, impacts)
        )


def _compiled(source: Any, options: CompileOptions) -> CompiledModel:
    """Return the model of a scene or a SymPy system, with the outputs that every model of it has."""
    scene = with_made_contacts(source.copy() if isinstance(source, Scene) else Scene.from_sympy(source))
    angles: list[str] = []
    scene, wanted = with_reactions(scene, options.outputs)
    options = replace(options, outputs=wanted)
    if options.orientation == "quaternion":
        scene = with_quaternions(scene)
        angles = [a.func.__name__ for item in scene.orientations for a in item.angles]
    given = [u.func.__name__ for u in (*scene.speeds, *scene.inputs) if hasattr(u, "func")]
    known = output_names(options.outputs)
    outputs = (*angles, *map(rate_name, angles), *options.outputs, *(name for name in given if name not in known))
    options = replace(options, outputs=tuple(dict.fromkeys(outputs)))
    compiled = compile_scene(scene, options)
    from .model.model import CompiledModel

    return CompiledModel.of(compiled)
