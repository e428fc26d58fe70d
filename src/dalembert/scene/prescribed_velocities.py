"""Reader of prescribed velocities of a scene onto the graph."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from sympy.physics.mechanics import Particle, Point, ReferenceFrame

from ..errors import SceneError
from .frames import Tree, matrix_of
from .model import Components, GivenBody, GivenLoad, GivenMotion, Pieces

if TYPE_CHECKING:
    from .scene import Scene


def located(scene: Scene) -> bool:
    """Whether every point and frame with a prescribed velocity also has a position or an orientation."""
    points, frames = Tree(scene.origin, "_pos_dict"), Tree(scene.frame, "_dcm_dict")
    return all(
        (points if isinstance(target, Point) else frames).path(target) is not None for target, _ in scene.velocities
    )


def read_given(
    scene: Scene,
    vector: Callable[[Any, str], Pieces],
    scalar: Callable[[Any, str], Any],
    matrix: Callable[[Any, str], tuple[Components, Components, Components]],
    number: Callable[[ReferenceFrame, str], int],
) -> GivenMotion:
    """Return the bodies and loads of a scene with their prescribed velocities.

    Parameters
    ----------
    scene : Scene
        Its `velocities` hold every mass centre, body frame and target of a load.
    vector, scalar, matrix, number : callable
        Read vectors, scalars, symmetric matrices, and frames, met at a place.
    """
    given = {id(target): velocity for target, velocity in scene.velocities}
    bodies = []
    for body in scene.bodies:
        place = f"body {body.name!r}"
        mass = scalar(body.mass, f"mass of {place}")
        velocity = vector(given[id(body.masscenter)], f"velocity of {place}")
        if isinstance(body, Particle):
            bodies.append(GivenBody(body.name, mass, velocity, (), 0, None))
            continue
        spin = vector(given[id(body.frame)], f"angular velocity of {place}")
        dyadic = body.central_inertia
        frame = _frame_of(dyadic, body.frame)
        rows = matrix(matrix_of(dyadic, frame), f"inertia of {place}")
        bodies.append(GivenBody(body.name, mass, velocity, spin, number(frame, place), rows))
    loads = []
    for target, load in _pairs(scene):
        kind = "force at" if isinstance(target, Point) else "torque on"
        where = f"{kind} {target.name!r}"
        loads.append(GivenLoad(where, vector(load, where), vector(given[id(target)], f"velocity under the {where}")))
    return GivenMotion(tuple(bodies), tuple(loads))


def _pairs(scene: Scene) -> list[tuple[Any, Any]]:
    """Return the loads of a scene, all pairs of a point or frame and a vector."""
    faults = [
        f"load {number + 1} is (body, point, force), and the scene prescribes velocities: give the point, and its"
        " velocity as part of the body, in place of the body"
        for number, load in enumerate(scene.loads)
        if len(load) != 2
    ]
    if faults:
        raise SceneError(scene.name, faults)
    return [(target, vector) for target, vector in scene.loads]


def _frame_of(dyadic: Any, frame: ReferenceFrame) -> ReferenceFrame:
    """Return the frame that an inertia is written on, which need not be that of its body."""
    for _, first, _ in dyadic.args:
        for _, on in first.args:
            written: ReferenceFrame = on
            return written
    return frame
