"""Positions of bodies and points of a scene, for animations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, final

from ..arrays import FloatArray
from ..errors import OptionError, list_names
from ..frozen import frozen
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..scene.joints.joints import NamedOutput, placed
from ..scene.model import Pieces, SceneModel
from ..scene.reading import read
from ..transforms.lower_kernels import lower_kernel
from .kinematics import Kinematics

if TYPE_CHECKING:
    from ..scene import Scene


@final
@frozen
class Skeleton:
    """Points and frames of a scene, as a kernel.

    Attributes
    ----------
    points : tuple of str
        Names of the points: mass centres, then the points of joints, loads and the user, then those between.
    bodies : tuple of str
        Names of the bodies; body i has its mass centre at point i.
    framed : tuple of int
        Numbers of the bodies that have a frame.
    links : tuple of (int, int)
        Pairs of points at fixed distances in one frame.
    kernel : Kernel
        Arguments (t, y, c), y = q and c beginning with the parameters; outputs: positions, axes of the frames, then
        further numbers.
    """

    points: tuple[str, ...]
    bodies: tuple[str, ...]
    framed: tuple[int, ...]
    links: tuple[tuple[int, int], ...]
    kernel: Kernel

    def at(self, t: FloatArray, q: FloatArray, c: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions (n_t, n_points, 3) [m], and axes (n_t, n_framed, 3, 3), one row an axis."""
        rows = interpret_rows(self.kernel, t, q, c)
        size = 3 * len(self.points)
        axes = rows[:, size : size + 9 * len(self.framed)]
        return rows[:, :size].reshape(len(t), -1, 3), axes.reshape(len(t), -1, 3, 3)


def skeleton(
    scene: Scene, parameters: Sequence[str], points: Sequence[Any] = (), numbers: Sequence[Any] = ()
) -> Skeleton:
    """Return the skeleton of a scene.

    Parameters
    ----------
    scene : Scene
        A scene with positions.
    parameters : sequence of str
        Names of the parameters of a motion, in their order.
    points : sequence of Point or str
        Further points, or names of those that lie on the way to bodies, joints and loads.
    numbers : sequence of expressions
        Further numbers that the kernel computes, such as lengths of shapes.

    Raises
    ------
    OptionError
        For a scene without positions, and for points that are not known or have further parameters.
    """
    if scene.velocities or scene.lagrangian is not None:
        raise OptionError(
            f"scene {scene.name!r} came from SymPy without positions of its bodies and cannot be drawn;"
            " .plot() draws its coordinates"
        )
    places, names = placed(points)
    asked = [NamedOutput(f"number {i}", expression) for i, expression in enumerate(numbers)]
    model = read(scene, [*places, *asked])
    kinematics = Kinematics(model)
    known = [point.name for point in model.points]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise OptionError(f"unknown points {list_names(unknown)}; known: {list_names(known)}; or give the Point itself")
    strange = [name for name in model.symbols.parameters if name not in parameters]
    if strange:
        raise OptionError(
            f"points have parameters that the motion does not: {list_names(strange)}; it has {list_names(parameters)}"
        )
    wanted = [body.centre for body in model.bodies]
    wanted += [n for n, name in enumerate(known) if n not in wanted and n in _ends(model, names)]
    links: list[tuple[int, int]] = []
    for number in wanted:  # grows by the points that links lead to
        parent = model.points[number].parent
        if parent is not None and _rigid(model, model.points[number].position):
            if parent not in wanted:
                wanted.append(parent)
            links.append((wanted.index(parent), wanted.index(number)))
    for action in model.actions:
        if action.at is not None and action.other is not None:  # the joint closes the loop to its other body
            links.append((wanted.index(model.bodies[action.other].centre), wanted.index(action.at)))
    framed = tuple(i for i, body in enumerate(model.bodies) if body.inertia is not None)
    nodes = [x for number in wanted for x in kinematics.between(0, number, 0)]
    graph = model.graph
    for i in framed:
        for axis in range(3):
            x, y, z = (graph.one if k == axis else graph.zero for k in range(3))
            nodes += kinematics.to_frame((x, y, z), model.bodies[i].frame, 0)
    nodes += [model.outputs[item.name] for item in asked]
    inputs: dict[Any, tuple[str, int | None]] = {graph.input(model.symbols.time): ("t", None)}
    inputs |= {node: ("y", i) for i, node in enumerate(kinematics.q)}
    inputs |= {graph.input(name): ("c", i) for i, name in enumerate(parameters)}
    kernel = lower_kernel(graph, "skeleton", nodes, inputs, arguments=("t", "y", "c"))
    called, bodies = tuple(known[number] for number in wanted), tuple(body.name for body in model.bodies)
    return Skeleton(called, bodies, framed, tuple(_distinct(links)), kernel)


def _distinct(links: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return links without those of a point to itself, and each pair once."""
    seen: dict[tuple[int, ...], tuple[int, int]] = {}
    for link in links:
        if link[0] != link[1]:
            seen.setdefault(tuple(sorted(link)), link)
    return list(seen.values())


def _ends(model: SceneModel, names: Sequence[str]) -> set[int]:
    """Return the numbers of the points of joints and loads, and of the requested points."""
    ends = {action.at for action in model.actions if action.at is not None}
    return ends | {number for number, point in enumerate(model.points) if point.name in names}


def _rigid(model: SceneModel, position: Pieces) -> bool:
    """Whether a position is constant in one frame."""
    moving = model.graph.mask((model.symbols.time, *model.symbols.coordinates))
    components = [x for piece in position for x in piece.components]
    return len(position) == 1 and not any(x.deps & moving for x in components)
