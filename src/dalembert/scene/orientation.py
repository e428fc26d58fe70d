"""Free orientations by unit quaternions: declared, or in place of three angles.

A quaternion e = (e0, e1, e2, e3), scalar first, leads from the body to the frame that it is oriented in; e.e = 1 is a
holonomic constraint. Nothing is singular at any attitude. The formulation `minimal` takes the angular velocity for
speeds and brings e back to length one after every step.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, final

from sympy.core.function import AppliedUndef
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody
from sympy.physics.vector import Dyadic, Vector, dynamicsymbols

from ..errors import OptionError, SceneError, list_names, nesting_named
from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..naming import rate_name
from ..transforms.derivatives import tangents
from ..transforms.linear import matvec, spin_matrix
from ..values import listed
from .actuators import loads_of
from .angle_sequences import AngleSequence, recognised
from .frames import Tree
from .speeds import without_speeds
from .symbol_table import Entry

if TYPE_CHECKING:
    from .scene import Scene


# Frames that the contents of a scene depend on.


def frames_in_use(scene: Scene, frames: Tree) -> set[ReferenceFrame]:
    """Return the frames that bodies, loads, actuators, joints and gravity are written on, and their ancestors.

    Other frames may be attached to those of a scene, such as the ones of another scene in the same notebook.

    Parameters
    ----------
    scene : Scene
    frames : Tree
        Below the frame of the scene.
    """
    points = Tree(scene.origin, "_pos_dict")
    found: set[ReferenceFrame] = set()
    for frame in _written_on(_contents(scene), points):
        found.update(frames.path(frame) or ())
    return found


def _contents(scene: Scene) -> Iterator[Any]:
    """Yield the points, frames, vectors and dyadics of a scene."""
    yield scene.gravity
    for body in scene.bodies:
        if isinstance(body, Particle):
            yield body.point
        elif isinstance(body, RigidBody):
            yield from (body.masscenter, body.frame, body.central_inertia)
    for load in loads_of(scene):
        if isinstance(load, Sequence):
            yield from load
    for joint in scene.joints:
        yield from (getattr(joint, name, None) for name in ("at", "force", "torque"))


def _written_on(items: Iterable[Any], points: Tree) -> Iterator[ReferenceFrame]:
    """Yield the frames that some points, frames, vectors and dyadics are written on."""
    for item in items:
        if isinstance(item, ReferenceFrame):
            yield item
        elif isinstance(item, Point):
            path = points.path(item) or ()
            yield from _written_on([node._pos_dict[points.parent[node]] for node in path], points)
        elif isinstance(item, Vector):
            yield from (frame for _, frame in item.args)
        elif isinstance(item, Dyadic):
            yield from _written_on([side for _, first, second in item.args for side in (first, second)], points)


@final
@frozen(eq=False)
class FreeOrientation:
    """A frame that a unit quaternion orients in another.

    Attributes
    ----------
    frame, base : ReferenceFrame
    quaternion : tuple of dynamicsymbols
        e0 to e3, scalar first, from `frame` to `base`.
    sequence : AngleSequence or None
        The rotations by three angles that the quaternion stands for, if it does.
    between : tuple of ReferenceFrame
        Frames between `base` and `frame` that those rotations go through.
    """

    frame: ReferenceFrame
    base: ReferenceFrame
    quaternion: tuple[Any, ...]
    sequence: AngleSequence | None = None
    between: tuple[ReferenceFrame, ...] = ()

    @property
    def angles(self) -> tuple[Any, ...]:
        """The three angles; none for an orientation that was declared."""
        return () if self.sequence is None else self.sequence.angles


@nesting_named
def free_orientation(
    scene: Scene, frame: ReferenceFrame, parent: ReferenceFrame | None = None, *, names: Sequence[str] | None = None
) -> tuple[Any, ...]:
    """Orient a frame freely by a unit quaternion, whose components become coordinates of the scene.

    Parameters
    ----------
    scene : Scene
        Gets four coordinates and the holonomic constraint that the quaternion has length one.
    frame : ReferenceFrame
        The frame to orient, such as that of a body; it must not be oriented yet.
    parent : ReferenceFrame, optional
        The frame to orient it in; that of the scene by default.
    names : sequence of four str, optional
        Names of the coordinates; by default e0_S to e3_S for a frame called S.

    Returns
    -------
    tuple of dynamicsymbols
        The quaternion (e0, e1, e2, e3), scalar first, from components on `frame` to components on `parent`. Initial
        values may give the angular velocity, components on `frame`, in place of the rates: omega_S_x, omega_S_y
        and omega_S_z. ``outputs=["omega_S_x", ...]`` records it, whatever the speeds of the formulation are.

    Raises
    ------
    SceneError
        When the frame is oriented already, or the names are not four.

    Examples
    --------
    A free body::

        S = ReferenceFrame("S")
        e = da.free_orientation(scene, S)
        scene.add_bodies(RigidBody("body", O, S, m, (inertia(S, 1, 2, 3), O)))
        start = {e[0]: 1, e[1]: 0, e[2]: 0, e[3]: 0, "omega_S_x": 0.1, "omega_S_y": 5, "omega_S_z": 0}
    """
    parent = scene.frame if parent is None else parent
    faults = [
        f"free_orientation orients a ReferenceFrame, not {item!r}"
        for item in (frame, parent)
        if not isinstance(item, ReferenceFrame)
    ]
    names = _names(frame) if names is None else tuple(listed("names", names, "four names"))
    given: list[Any] = list(names)
    if len(given) != 4 or not all(isinstance(name, str) and name.isidentifier() for name in given):
        faults.append(f"a quaternion has four components; give four names, not {names!r}")
    if not faults and frame._dcm_dict:
        others = list_names(str(other.name) for other in frame._dcm_dict)
        faults.append(
            f"the frame {frame.name!r} is oriented already, relative to {others}; make it with"
            f" ReferenceFrame({frame.name!r}) and let free_orientation orient it"
        )
    if faults:
        raise SceneError(scene.name, faults)
    quaternion = tuple(dynamicsymbols(name) for name in names)
    frame.orient(parent, "Quaternion", quaternion)
    _add(scene, FreeOrientation(frame, parent, quaternion))
    return quaternion


def _names(frame: Any) -> tuple[str, ...]:
    return tuple(f"e{i}_{getattr(frame, 'name', frame)}" for i in range(4))


def _add(scene: Scene, orientation: FreeOrientation) -> None:
    scene.coordinates += orientation.quaternion
    scene.holonomic_constraints += (sum(e**2 for e in orientation.quaternion) - 1,)
    scene.orientations += (orientation,)


def with_quaternions(scene: Scene) -> Scene:
    """Return a scene in which bodies that three angles orient freely have unit quaternions for coordinates instead.

    The angles stay known: initial values may be given in them, and expressions may contain them.

    Raises
    ------
    OptionError
        When no body of the scene is oriented by three angles of its own, with the reason for each.
    """
    scene = without_speeds(scene)
    found: list[FreeOrientation] = []
    reasons = []
    for body in scene.bodies:
        if not isinstance(body, RigidBody):
            reasons.append(f"{body.name!r} is a particle")
            continue
        result = _free(scene, body)
        if isinstance(result, str):
            reasons.append(f"{body.name!r}: {result}")
        elif all(result.frame is not other.frame for other in found):
            found.append(result)
    if not found:
        raise OptionError(
            f"orientation='quaternion' takes the place of three angles that do nothing but orient a body, and scene"
            f" {scene.name!r} has none: {'; '.join(reasons) or 'it has no bodies'}. Leave the option out, or orient the"
            " body with dalembert.free_orientation"
        )
    twin = scene.copy()
    gone = {angle for orientation in found for angle in orientation.angles}
    twin.coordinates = tuple(q for q in scene.coordinates if q not in gone)
    for orientation in found:
        _add(twin, orientation)
        assert orientation.sequence is not None
        twin.imposed += tuple(
            zip(orientation.angles, orientation.sequence.of_quaternion(orientation.quaternion), strict=True)
        )
    return twin


def _free(scene: Scene, body: RigidBody) -> FreeOrientation | str:
    """Return the orientation of a body by three angles of its own, or why it has none."""
    tree = Tree(scene.frame, "_dcm_dict")
    path = tree.path(body.frame)
    if path is None:
        return f"frame {body.frame.name!r} is not oriented in {scene.frame.name!r}"
    moving = [frame for frame in path if _angles(frame._dcm_dict[tree.parent[frame]])]
    if not moving:
        return f"frame {body.frame.name!r} does not turn"
    frame = moving[-1]
    chain: list[ReferenceFrame] = []
    angles: list[Any] = []
    for step in reversed(path[: path.index(frame) + 1]):
        if len(angles) >= 3:
            break
        chain.insert(0, step)
        angles += [a for a in _angles(step._dcm_dict[tree.parent[step]]) if a not in angles]
    if len(angles) != 3:
        return f"{len(angles)} coordinates turn it ({list_names(a.func.__name__ for a in angles)}), not three"
    base = tree.parent[chain[0]]
    why = _entangled(scene, tree, chain, angles)
    if why:
        return why
    sequence = recognised(frame.dcm(base), angles)
    if sequence is None:
        return "the rotations that turn it are not three about axes of coordinates, one after the other"
    names = _names(frame)
    return FreeOrientation(frame, base, tuple(map(dynamicsymbols, names)), sequence, tuple(chain[:-1]))


def _angles(matrix: Any) -> list[Any]:
    return sorted(matrix.atoms(AppliedUndef), key=lambda f: str(f.func.__name__))


def _entangled(scene: Scene, tree: Tree, chain: Sequence[ReferenceFrame], angles: Sequence[Any]) -> str:
    """Return the uses of the angles other than the orientation of the last frame of a chain."""
    named = list_names(a.func.__name__ for a in angles)
    if not all(a in scene.coordinates for a in angles):
        return f"{named} are not all coordinates of the scene"
    carried = [b.name for b in scene.bodies if isinstance(b, RigidBody) and b.frame in chain[:-1]]
    if carried:
        return f"{named} also turn {list_names(map(repr, carried))}, which lies between"
    for frame in sorted(frames_in_use(scene, tree) - set(chain), key=lambda frame: str(frame.name)):
        parent = tree.parent[frame]
        if parent in chain[:-1] or any(matrix_angle in angles for matrix_angle in _angles(frame._dcm_dict[parent])):
            return f"the frame {frame.name!r} is turned by some of {named} and not by all"
    changed = [item.coordinate for item in scene.releases if item.coordinate in angles or item.target in chain]
    changed += [q for q, value in scene.imposed if value.has(*angles)]
    if changed:
        return f"{named} are tied to coordinates that were released or imposed ({list_names(map(str, changed))})"
    return ""


# Alternative initial values of a free orientation: angles and their rates, and the angular velocity.


def angular_velocity(orientation: FreeOrientation) -> tuple[str, str, str]:
    """Return the names of the angular velocity of a free orientation, components on its own frame."""
    name = orientation.frame.name
    return f"omega_{name}_x", f"omega_{name}_y", f"omega_{name}_z"


def entries_of(graph: Graph, orientations: Sequence[FreeOrientation]) -> tuple[Entry, ...]:
    """Return the entries of free orientations, positions before rates."""
    positions: list[Entry] = []
    rates: list[Entry] = []
    for orientation in orientations:
        coordinates = tuple(str(e.func.__name__) for e in orientation.quaternion)
        slopes = tuple(map(rate_name, coordinates))
        if orientation.sequence is not None:
            names = tuple(str(a.func.__name__) for a in orientation.angles)
            angles = [graph.input(name) for name in names]
            half = [graph.node(0.5) * angle for angle in angles]
            values = orientation.sequence.quaternion([(graph.cos(a), graph.sin(a)) for a in half])
            moving = {a: graph.input(rate_name(name)) for a, name in zip(angles, names, strict=True)}
            positions.append(Entry(names, (), coordinates, tuple(values)))
            rates.append(Entry(tuple(map(rate_name, names)), names, slopes, tuple(tangents(graph, values, moving))))
        omega = angular_velocity(orientation)
        turning = spin_matrix([graph.input(name) for name in coordinates], body=True)
        spun: list[Node] = [graph.node(0.5) * x for x in matvec(graph, turning, [graph.input(w) for w in omega])]
        rates.append(Entry(omega, (), slopes, tuple(spun)))
    return (*positions, *rates)
