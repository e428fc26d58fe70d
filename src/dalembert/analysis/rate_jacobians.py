"""Derivatives of the rates of the state by state and inputs, as one compiled kernel.

The equations M(q) u_dot = Q(t, q, u) - c(q, u) of the speeds of formulation `minimal` are differentiated without their
solution: d u_dot = M^-1 (dQ - d(M u_dot + c)) at given u_dot (J. Carpentier, N. Mansard, "Analytical derivatives of
rigid body dynamics algorithms", Robotics: Science and Systems 2018), where the gradients of inertia terms come from
composite bodies. Where bodies move otherwise than by coordinates that turn or shift whole subtrees, and in other
formulations, the right-hand side itself is differentiated forward.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, final

import numpy as np

from ..arrays import FloatArray
from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.kernel import Kernel
from ..ir.node import Node
from ..ir.program import hidden_parameters
from ..mechanics.equations import moved_to
from ..mechanics.inertia_tree import InertiaTree
from ..mechanics.inverse_dynamics_gradients import inverse_dynamics_gradients
from ..mechanics.kinematics import Kinematics, Motion
from ..mechanics.virtual_power import given_powers, inertia_tree
from ..reduction.base import ReducedSystem
from ..scene.model import Components, SceneModel
from ..transforms.derivatives import GUARDED, tangents
from ..transforms.linear import Matrix, SingularMatrix, factorize, matvec, transpose
from ..transforms.lower_kernels import lower_kernel

if TYPE_CHECKING:
    from ..model.model import CompiledModel


class RateJacobians(NamedTuple):
    """Derivatives of the rates of the state by the state, (n_y, n_y), and by the inputs, (n_y, n_u); or rows of such.

    Rows and columns are in the order of ``layout.state`` and ``layout.inputs``.
    """

    by_state: FloatArray
    by_inputs: FloatArray


@final
@frozen(eq=False)
class JacobianKernel:
    """A kernel of (t, y, parameters) whose outputs are the entries that do not vanish everywhere.

    Attributes
    ----------
    kernel : Kernel
    places : ndarray (n_out,) of int
        Where they stand in the matrix (n_y, n_y + n_u), flattened.
    shape : (int, int)
    quaternions : tuple of ndarray of int
        Places of the components of unit quaternions in the state.
    along_tree : bool
        Whether the gradients come from composite bodies.
    """

    kernel: Kernel
    places: np.ndarray[tuple[int], np.dtype[np.intp]]
    shape: tuple[int, int]
    quaternions: tuple[np.ndarray[tuple[int], np.dtype[np.intp]], ...]
    along_tree: bool

    def matrices(self, found: FloatArray, y: FloatArray) -> RateJacobians:
        """Return the derivatives (k, n_y, n_y) and (k, n_y, n_u) from outputs (k, n_out) at states (k, n_y).

        Those by quaternions are taken along the sphere: the rest has no meaning.
        """
        size, columns = self.shape
        entries = np.zeros((len(found), size * columns))
        entries[:, self.places] = found
        whole = entries.reshape(len(found), size, columns)
        for four in self.quaternions:
            e = y[:, four] / np.linalg.norm(y[:, four], axis=1, keepdims=True)
            own = whole[:, :, four]
            whole[:, :, four] = own - (own @ e[:, :, np.newaxis]) * e[:, np.newaxis, :]
        return RateJacobians(whole[:, :, :size], whole[:, :, size:])


def jacobian_kernel_of(model: CompiledModel) -> JacobianKernel:
    """Return the kernel of a model without modes."""
    reduced = model.stages.reduced
    names = model.layout.inputs
    found = _of_composite_bodies(reduced, names)
    along_tree = found is not None
    graph, inputs, rows = found or _forward(reduced, names)
    parameters = {graph.input(name): ("c", i) for i, name in enumerate(model.layout.parameters)}
    places: dict[Node, tuple[str, int | None]] = {graph.input(reduced.equations.symbols.time): ("t", None)}
    places |= parameters | {node: ("y", i) for node, i in inputs.items()}
    flat = [entry for row in rows for entry in row]
    kept = [i for i, entry in enumerate(flat) if not entry.is_zero]
    kernel = lower_kernel(graph, "rate_jacobians", [flat[i] for i in kept], places, arguments=("t", "y", "c"))
    state = list(reduced.state)
    groups = [
        [reduced.equations.symbols.coordinates[i] for i in group.coordinates]
        for group in reduced.equations.groups
        if group.norm and group.norm in {row.label for row in reduced.equations.constraints}
    ]
    fours = tuple(np.array([state.index(name) for name in four]) for four in groups if set(four) <= set(state))
    shape = len(state), len(state) + len(names)
    return JacobianKernel(kernel, np.array(kept, dtype=np.intp), shape, fours, along_tree)


_Found = tuple[Graph, dict[Node, int], Matrix]
"""A graph, places of inputs in the state, and rows of derivatives by the state, then by the inputs."""


def _values(graph: Graph, names: Sequence[str]) -> list[Node]:
    """Return what the values of inputs are called."""
    return [graph.input(hidden_parameters(name)[1]) for name in names]


def _forward(reduced: ReducedSystem, names: Sequence[str]) -> _Found:
    """Return the derivatives of the right-hand side."""
    graph = Graph()
    inputs, rates = graph.adopt(list(reduced.inputs)), graph.adopt(list(reduced.rhs))
    known = dict(zip(graph.adopt(list(reduced.places)), reduced.places.values(), strict=True))
    columns = [tangents(graph, rates, {x: graph.one}, GUARDED) for x in (*inputs, *_values(graph, names))]
    return graph, known, transpose(columns)


def _of_composite_bodies(reduced: ReducedSystem, names: Sequence[str]) -> _Found | None:
    """Return the derivatives by composite bodies, None where the scene or the formulation does not allow them."""
    scene, equations = reduced.equations.scene, reduced.equations
    count = len(equations.q)
    speeds = len(reduced.state) - count
    whole = reduced.formulation == "minimal" and scene is not None and not equations.states and not equations.contacts
    if not whole or reduced.state[:count] != equations.symbols.coordinates or not speeds:
        return None
    assert scene is not None
    graph = scene.graph.copy()
    model = replace(moved_to(scene, scene.graph, graph), graph=graph)
    kinematics = Kinematics(model)
    tree, loads = inertia_tree(kinematics), given_powers(kinematics)
    inputs = graph.adopt(list(reduced.inputs))
    q, u = inputs[:count], inputs[count:]
    rates = graph.adopt(list(reduced.rhs[:count]))
    basis = transpose([tangents(graph, rates, {speed: graph.one}) for speed in u])
    values = {a: b for a, b in zip(kinematics.q, q, strict=True) if a is not b}
    tree = tree.substituted(graph, values)
    in_speeds = tree if rates == u else _freed(graph, tree.in_speeds(graph, basis), q)
    gravity = kinematics.resolve(model.gravity, 0)
    drifts = graph.substitute(rates, dict.fromkeys(u, graph.zero))
    if not all(drift.is_zero for drift in drifts) or not _steady(graph, model, (tree, in_speeds), gravity, inputs):
        return None
    values |= {a: b for a, b in zip(kinematics.qdot, rates, strict=True) if a is not b}
    loads = matvec(graph, transpose(basis), graph.substitute(loads, values))
    if any(load.deps & graph.mask(model.symbols.unknowns) for load in loads):
        return None
    rest = inverse_dynamics_gradients(graph, (tree, in_speeds), gravity, u, [graph.zero] * len(u))
    try:
        factors = factorize(graph, rest.mass_matrix)
    except SingularMatrix:
        return None
    u_dot = factors.solve([load - term for load, term in zip(loads, rest.values, strict=True)])
    own = inverse_dynamics_gradients(graph, (tree, in_speeds), gravity, u, u_dot)
    inertial = [*transpose(own.by_coordinates), *transpose(own.by_speeds)]
    columns = []
    for number, x in enumerate((*inputs, *_values(graph, names))):
        slopes = tangents(graph, loads, {x: graph.one}, GUARDED)
        if number < len(inputs):
            slopes = [a - b for a, b in zip(slopes, inertial[number], strict=True)]
        columns.append([*tangents(graph, rates, {x: graph.one}, GUARDED), *factors.solve(slopes)])
    return graph, {node: i for i, node in enumerate(inputs)}, transpose(columns)


def _freed(graph: Graph, tree: InertiaTree, q: Sequence[Node]) -> InertiaTree:
    """Return a tree whose partial kinematic screws are freed of coordinates on which they do not depend in value."""

    def freed(motion: Motion) -> Motion:
        x, y, z = (graph.freed_of(entry, q) or entry for entry in motion.direction)
        return replace(motion, direction=(x, y, z))

    steps = (replace(step, motions=tuple(map(freed, step.motions))) for step in tree.steps)
    return replace(tree, steps=tuple(steps))


def _steady(
    graph: Graph,
    model: SceneModel,
    trees: tuple[InertiaTree, InertiaTree],
    gravity: Components,
    inputs: Sequence[Node],
) -> bool:
    """Return whether steps change by their own coordinates alone, and their speeds have constant screws."""
    moving = graph.mask([model.symbols.time, *model.symbols.rates, *model.symbols.coordinates])
    moving |= graph.mask([hidden for each in model.symbols.inputs for hidden in hidden_parameters(each.name)])
    for node in inputs:
        moving |= node.deps
    if any(entry.deps & moving for entry in gravity):
        return False
    for step, of_speeds in zip(trees[0].steps, trees[1].steps, strict=True):
        own = 0
        for motion in step.motions:
            own |= inputs[motion.coordinate].deps
        shape = [*(entry for row in step.rotation or () for entry in row), *(step.offset or ())]
        fixed = [entry for motion in of_speeds.motions for entry in motion.direction]
        if step.inertia is not None:
            body = step.inertia
            fixed += [body.mass, *body.moment, *(entry for row in body.second for entry in row)]
        if any(entry.deps & moving & ~own for entry in shape) or any(entry.deps & moving for entry in fixed):
            return False
    return True
