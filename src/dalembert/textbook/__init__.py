"""Symbolic view of a scene: the derivations of section 13.4 of the text."""

from __future__ import annotations

from typing import Any

from ..errors import SceneError, nesting_named
from ..once import deriving
from ..scene import Scene
from ..scene.contacts.made import with_made_contacts
from ..scene.joints.reactions import with_closures
from ..scene.reading import read
from ..scene.speeds import without_speeds
from .actions import Screw
from .energy import lagrange_operator
from .view import LagrangeView

__all__ = ["LagrangeView", "Screw", "lagrange", "lagrange_operator"]


@deriving
@nesting_named
def lagrange(scene: Scene, *, kinetic_energy: Any = None) -> LagrangeView:
    """Return the textbook view of a scene: everything that section 13.4 derives by hand, as SymPy.

    It forms T symbolically and applies the operator of Lagrange, on purpose another route than that of
    `dalembert.compile_model`: each checks the other.

    Parameters
    ----------
    scene : Scene
        The scene; it is copied.
    kinetic_energy : Expr, optional
        The kinetic energy as you would write it. It must be T with all coordinates and rates independent
        (assumption 13.1.2); one that was simplified with a constraint is rejected (remark 13.4.8).

    Returns
    -------
    LagrangeView

    Raises
    ------
    SceneError
        With every fault of the scene, or the reason why the kinetic energy is rejected.

    Examples
    --------
    The pendulum of `Scene`::

        view = da.lagrange(scene)
        print(view)  # the whole derivation; LaTeX in a notebook
        view.equation(theta), view.equations_of_motion[theta.diff().diff()]
    """
    if not isinstance(scene, Scene):
        raise SceneError(type(scene).__name__, [f"lagrange takes a Scene, not {scene!r}"])
    scene = with_closures(without_speeds(with_made_contacts(scene)))
    read(scene)
    return LagrangeView(scene.copy(), kinetic_energy)
