"""Import of `System`, `KanesMethod` and `LagrangesMethod` of ``sympy.physics.mechanics`` as scenes.

Their contents are imported, not the equations that they derive. Velocities are those that SymPy gives to points and
frames. Where they are the rates of the positions, the scene is an ordinary one. Where they are not, as with a wheel
whose rolling is written into the velocity of its hub, the scene keeps them, and the equations are formed from them. A
`LagrangesMethod` has no bodies; its scene has the Lagrangian. The joints of a `System` bring their reactions.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, final

import sympy as sp
from sympy.physics.mechanics import KanesMethod, LagrangesMethod, Particle, Point, ReferenceFrame, RigidBody, System
from sympy.physics.vector import Vector, dynamicsymbols

from ..errors import SceneError, list_names
from ..frozen import frozen
from ..scene.actuators import actuator_loads
from ..scene.frames import Tree
from ..scene.joints.sympy_joints import REACTIONS, reaction_of
from ..scene.velocity_checks import located

if TYPE_CHECKING:
    from ..scene.scene import Scene

SOURCES = (System, KanesMethod, LagrangesMethod)
"""Classes that can become scenes."""


@final
@frozen
class _Contents:
    """Contents of a system of SymPy."""

    frame: ReferenceFrame
    origin: Point | None
    coordinates: tuple[Any, ...]
    speeds: tuple[Any, ...] = ()
    zero_speeds: tuple[Any, ...] = ()
    kinematic_equations: tuple[Any, ...] = ()
    bodies: tuple[Any, ...] = ()
    loads: tuple[tuple[Any, Any], ...] = ()
    holonomic: tuple[Any, ...] = ()
    nonholonomic: tuple[Any, ...] = ()
    lagrangian: Any = None
    joints: tuple[Any, ...] = ()


def scene_from_sympy(source: Any, name: str | None = None) -> Scene:
    """Return the scene of a system of SymPy; see `dalembert.Scene.from_sympy`."""
    name = type(source).__name__ if name is None else str(name)
    if isinstance(source, System):
        held = _of_system(source)
    elif isinstance(source, KanesMethod):
        held = _of_kane(source, name)
    elif isinstance(source, LagrangesMethod):
        held = _of_lagrange(source, name)
    else:
        kinds = list_names(kind.__name__ for kind in SOURCES)
        raise SceneError(
            type(source).__name__, [f"compile_model takes a Scene, or one of SymPy's {kinds}, not {source!r}"]
        )
    return _scene(held, name)


# -- contents of SymPy's objects ----------------------------------------------------------------


def _of_system(system: System) -> _Contents:
    actuators = [load for actuator in system.actuators for load in actuator_loads(actuator)]
    return _Contents(
        frame=system.frame,
        origin=system.fixed_point,
        coordinates=tuple(system.q),
        speeds=tuple(system.u),
        zero_speeds=tuple(system.u_aux),
        kinematic_equations=tuple(system.kdes),
        bodies=tuple(system.bodies),
        loads=_pairs((*system.loads, *actuators)),
        holonomic=tuple(system.holonomic_constraints),
        nonholonomic=_not_rates(system.velocity_constraints, system.holonomic_constraints),
        joints=tuple(joint for joint in system.joints if type(joint) in REACTIONS),
    )


def _of_kane(method: KanesMethod, name: str) -> _Contents:
    if not method.bodies:
        why = "it was given no bodies; give it bodies= and forcelist=, or call kanes_equations(bodies, loads)"
        raise SceneError(name, [why])
    rates = method.kindiffdict()
    hidden = _hidden_of_kane(method)
    return _Contents(
        frame=hidden.frame,
        origin=None,
        coordinates=tuple(method.q),
        speeds=tuple(method.u),
        zero_speeds=hidden.zero_speeds,
        kinematic_equations=hidden.kinematic_equations,
        bodies=tuple(method.bodies),
        loads=_pairs(method.loads or ()),
        holonomic=hidden.holonomic,
        nonholonomic=_not_rates(hidden.nonholonomic, hidden.holonomic, rates),
    )


def _hidden_of_kane(method: Any) -> _Contents:
    """Return the private contents of a `KanesMethod`; the only place that reads its internals."""
    velocity = tuple(method._k_nh * method.u + method._f_nh) if method._k_nh else ()
    rates = method.q.diff(dynamicsymbols._t)  # as they were given; kindiffdict() has them solved, with divisions
    kinematic = method._k_kqdot_implicit * rates + method._k_ku_implicit * method.u + method._f_k_implicit
    return _Contents(
        frame=method._inertial,
        origin=None,
        coordinates=(),
        zero_speeds=tuple(method._uaux),
        kinematic_equations=tuple(kinematic),
        holonomic=tuple(method._f_h),
        nonholonomic=velocity,
    )


def _of_lagrange(method: LagrangesMethod, name: str) -> _Contents:
    if method.forcelist and method.inertial is None:
        raise SceneError(name, ["the LagrangesMethod has forces and no frame that they work in; give it frame="])
    lagrangian, holonomic = _hidden_of_lagrange(method)
    return _Contents(
        frame=method.inertial or ReferenceFrame("N"),
        origin=None,
        coordinates=tuple(method.q),
        loads=_pairs(method.forcelist),
        holonomic=holonomic,
        nonholonomic=tuple(method.coneqs)[len(holonomic) :],
        lagrangian=lagrangian,
    )


def _hidden_of_lagrange(method: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return Lagrangian and holonomic constraints of a `LagrangesMethod`; the only place that reads its internals."""
    return method._L[0], tuple(method._hol_coneqs)


def _pairs(loads: Iterable[Any]) -> tuple[tuple[Any, Any], ...]:
    """Return loads as pairs of a point or frame and a vector; a body is replaced by its mass centre or frame."""
    return tuple((load[0], load[1]) for load in loads)


def _not_rates(velocity: Iterable[Any], holonomic: Iterable[Any], rates: Any = None) -> tuple[Any, ...]:
    """Return velocity constraints without those that are written as rates of holonomic ones."""
    time = dynamicsymbols._t
    known = [sp.diff(constraint, time) for constraint in holonomic]
    known += [rate.xreplace(rates) for rate in known] if rates else []
    return tuple(constraint for constraint in velocity if constraint not in known)


# -- the scene ------------------------------------------------------------------------------------


def _scene(held: _Contents, name: str) -> Scene:
    from ..scene.scene import Scene

    still = dict.fromkeys(held.zero_speeds, sp.S.Zero)
    frame = held.frame
    moving = [body for body in held.bodies if any(_velocity(target, frame, still) != 0 for target in _targets(body))]
    loads = [load for load in held.loads if load[1] != 0 and _velocity(load[0], frame, still) != 0]
    named = [u for u in held.speeds if not isinstance(u, sp.Derivative)]
    tied = {u for equation in held.kinematic_equations for u in equation.atoms(sp.Function)}
    loose = {u: dynamicsymbols(f"{u.func.__name__}_integral") for u in named if u not in tied}
    scene = Scene(
        name,
        frame=frame,
        origin=held.origin or _origin(moving, frame, still),
        coordinates=(*held.coordinates, *loose.values()),
    )
    scene.bodies = tuple(moving)
    scene.holonomic_constraints = tuple(sp.sympify(c) for c in held.holonomic)
    scene.nonholonomic_constraints = tuple(sp.sympify(c).xreplace(still) for c in held.nonholonomic)
    scene.speeds = tuple(named)
    if named:
        equations = [sp.sympify(equation).xreplace(still) for equation in held.kinematic_equations]
        scene.kinematic_equations = (*equations, *(q.diff(dynamicsymbols._t) - u for u, q in loose.items()))
    scene.loads = tuple((target, _without_auxiliary_speeds(vector, still)) for target, vector in loads)
    scene.lagrangian = held.lagrangian
    scene.connections = tuple(map(reaction_of, held.joints))
    targets = dict.fromkeys([target for body in moving for target in _targets(body)] + [t for t, _ in loads])
    scene.velocities = tuple((target, _velocity(target, frame, still)) for target in targets)
    return _with_derived_velocities(scene) if held.lagrangian is None and located(scene) else scene


def _targets(body: Any) -> tuple[Any, ...]:
    if not isinstance(body, RigidBody | Particle):
        raise SceneError("SymPy's system", [f"{body!r} is not a RigidBody or Particle"])
    return (body.masscenter,) if isinstance(body, Particle) else (body.masscenter, body.frame)


def _velocity(target: Any, frame: ReferenceFrame, still: dict[Any, Any]) -> Any:
    """Return the velocity of a point, or the angular velocity of a frame, as SymPy has it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # SymPy warns where points give a velocity in several ways
            if isinstance(target, Point):
                return _without_auxiliary_speeds(target.vel(frame), still)
            return _without_auxiliary_speeds(target.ang_vel_in(frame), still)
    except ValueError as unknown:
        what = "point" if isinstance(target, Point) else "frame"
        how = "locate it, or set_vel" if isinstance(target, Point) else "orient it, or set_ang_vel"
        raise SceneError(
            "SymPy's system",
            [f"SymPy has no velocity of the {what} {target.name!r} in {frame.name!r}; {how}: {unknown}"],
        ) from None


def _without_auxiliary_speeds(vector: Any, still: dict[Any, Any]) -> Any:
    """Return a vector without auxiliary speeds, which are zero."""
    return vector.xreplace(still) if still and isinstance(vector, Vector) else vector


def _origin(bodies: Sequence[Any], frame: ReferenceFrame, still: dict[Any, Any]) -> Point:
    """Return a point at rest that the bodies are located from, or else a new one."""
    for body in bodies:
        for point in Tree(body.masscenter, "_pos_dict").parent:
            if frame in point._vel_dict and _without_auxiliary_speeds(point._vel_dict[frame], still) == 0:
                return point
    return Point("O")


def _with_derived_velocities(scene: Scene) -> Scene:
    """Return a scene without its velocities where they follow from the positions, and with gravity as gravity."""
    from ..mechanics.virtual_power import velocities_agree
    from ..scene.reading import read

    if not velocities_agree(read(scene)):
        return scene
    plain = scene.copy()
    plain.velocities = ()
    field = _gravity(plain)
    if field is not None:
        plain.gravity = field
        weighed = [body.masscenter for body in plain.bodies]
        plain.loads = tuple(load for load in plain.loads if not (load[0] in weighed and _weight(plain, load) == field))
    return plain


def _gravity(scene: Scene) -> Vector | None:
    """Return the uniform field that every body has exactly one load of, where no potential energy stands for it."""
    if any(getattr(body, "potential_energy", 0) != 0 for body in scene.bodies):
        return None
    fields = [
        [field for load in scene.loads if load[0] is body.masscenter and (field := _weight(scene, load)) is not None]
        for body in scene.bodies
    ]
    if not all(len(own) == 1 for own in fields) or any(own[0] != fields[0][0] for own in fields):
        return None
    return fields[0][0]


def _weight(scene: Scene, load: tuple[Any, Any]) -> Vector | None:
    """Return a load on a mass centre divided by the mass, where that is a constant vector; else None."""
    bodies = [body for body in scene.bodies if body.masscenter is load[0]]
    if len(bodies) != 1 or len(load[1].args) != 1 or load[1].args[0][1] is not scene.frame:
        return None
    field = [sp.cancel(component / bodies[0].mass) for component in load[1].args[0][0]]
    if any(x.has(bodies[0].mass) or x.has(sp.Function) or x.has(sp.Derivative) for x in field):
        return None
    x, y, z = field
    return x * scene.frame.x + y * scene.frame.y + z * scene.frame.z
