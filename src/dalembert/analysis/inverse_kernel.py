"""Terms of inverse dynamics: the kernel that gives them, and what it does not know.

The equations M q_ddot = f + B u + J^T lam are solved for the inputs u, where the multipliers lam of the constraints are
whatever they have to be (`dalembert.analysis.inverse_dynamics`). Without inputs, u are generalised forces and B is the
identity. Rows are divided by the roots of the diagonal of M, so that coordinates of different units count alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..arrays import FloatArray
from ..errors import CapabilityError, list_names
from ..frozen import frozen
from ..ir.kernel import Kernel
from ..ir.node import Node
from ..ir.program import hidden_parameters
from ..mechanics.equations import ContactRow, EquationsOfMotion, copied
from ..naming import acceleration_input
from ..transforms.derivatives import GUARDED, tangents
from ..transforms.lower_kernels import lower_kernel

if TYPE_CHECKING:
    from ..model.model import CompiledModel

DEPENDENT = 1e-10
"""Share of the largest singular value below which constraints, or inputs, depend on each other."""


@final
@frozen(eq=False)
class InverseKernel:
    """The terms of inverse dynamics as one kernel of (t, (q, q_dot, first-order states, q_ddot), c).

    Attributes
    ----------
    kernel : Kernel
        Its constants are the parameters.
    coordinates, constraints, unknown, friction : tuple of str
        Names: of the rows of the equations, of the constraints, of the inputs that are solved for, or of all
        coordinates where there are none, and of joints with dry friction.
    stops : tuple of str
        Names of contacts that must be open.
    variables : int
        Number of coordinates, rates and first-order states.
    given : tuple of str
        Names of the inputs that are not solved for.
    quaternions : tuple of tuple of int
        Places of the coordinates of unit quaternions.
    """

    kernel: Kernel
    coordinates: tuple[str, ...]
    constraints: tuple[str, ...]
    unknown: tuple[str, ...]
    friction: tuple[str, ...]
    stops: tuple[str, ...]
    variables: int
    given: tuple[str, ...]
    quaternions: tuple[tuple[int, ...], ...]

    @property
    def driven(self) -> bool:
        """Whether inputs are solved for, not generalised forces."""
        return self.unknown != self.coordinates

    @property
    def reads_states(self) -> bool:
        """Whether the terms depend on first-order states, which stand between the rates and the second rates."""
        first, last = 2 * len(self.coordinates), self.variables
        return any(
            load.array == "y" and load.index is not None and first <= load.index < last for load in self.kernel.loads
        )

    def terms(self, row: FloatArray) -> Terms:
        """Return the outputs of the kernel by what they are."""
        n, m, k, f = (len(names) for names in (self.coordinates, self.constraints, self.unknown, self.friction))
        sizes = (n, n, n, n * k, m * n, m, f, f, f, f * n, len(self.stops))
        parts = np.split(row, np.cumsum(sizes)[:-1])
        diagonal, inertia, forces, by_input, jacobian, bias, most, slip, slipping, columns, gaps = parts
        for four in map(list, self.quaternions):
            diagonal[four] = np.max(diagonal[four])  # at a unit vector, one component moves rounding alone
        return Terms(
            np.sqrt(np.maximum(diagonal, 0.0)),
            inertia,
            forces,
            by_input.reshape(n, k),
            jacobian.reshape(m, n),
            bias,
            (most, slip, slipping, columns.reshape(f, n)),
            gaps,
        )


@final
@frozen(eq=False)
class Terms:
    """M q_ddot, given forces, B, J and the bias of J q_ddot at one state; of friction sizes, slips and columns."""

    scales: FloatArray
    inertia: FloatArray
    forces: FloatArray
    by_input: FloatArray
    jacobian: FloatArray
    bias: FloatArray
    friction: tuple[FloatArray, FloatArray, FloatArray, FloatArray]
    gaps: FloatArray

    @property
    def roots(self) -> FloatArray:
        """Roots of the diagonal of M, 1 where it vanishes, by which rows are divided."""
        return np.where(self.scales > 0.0, self.scales, 1.0)

    @property
    def friction_senses(self) -> FloatArray:
        """Signs of the slips of joints with dry friction, or of the slips that begin."""
        _, slip, slipping, _ = self.friction
        return np.where(slip != 0.0, np.sign(slip), np.sign(slipping))

    @property
    def free_directions(self) -> FloatArray:
        """Basis (n_q, k) of what the constraints leave free of coordinates times roots."""
        return _free_directions(self.jacobian / self.roots)


def inverse_kernel(model: CompiledModel, given: Sequence[str]) -> InverseKernel:
    """Return the kernel of a model for inputs of which some are given.

    Raises
    ------
    CapabilityError
        Where an input that is not given acts otherwise than as a load, and for contacts whose forces depend on others.
    """
    equations, contacts = _equations(model)
    graph, names = equations.graph, equations.symbols.coordinates
    controlled = [name for name in equations.symbols.held if name not in given]
    free = [each.name for each in equations.symbols.inputs if each.name not in given]
    changed: dict[Node, Node] = {}
    values = [graph.input(name) for name in controlled]
    for name in free:
        knot, value, *_ = (graph.input(hidden) for hidden in hidden_parameters(name))
        changed[knot] = equations.time
        values.append(value)
    friction = [c for c in contacts if c.tangential]
    stops = [c for c in contacts if c.gap is not None]
    opened = {c.constraint for c in stops}
    rows = [row for i, row in enumerate(equations.constraints) if i not in opened]
    second = [graph.input(acceleration_input(name)) for name in names]
    n = range(len(names))
    forcing = graph.substitute(list(equations.forcing), changed)
    slopes = [tangents(graph, forcing, {value: graph.one}, GUARDED) for value in values]
    _refuse_other_uses(model, equations, rows, (forcing, slopes), [*controlled, *free])
    rest = graph.substitute(forcing, dict.fromkeys(values, graph.zero))
    columns = slopes if values else [[graph.one if i == j else graph.zero for i in n] for j in n]
    nodes = equations.diagonal + equations.momenta(second) + rest
    nodes += [column[i] for i in n for column in columns]
    nodes += [entry for row in rows for entry in row.jacobian] + [row.bias for row in rows]
    nodes += _friction_nodes(equations, friction, second)
    nodes += [c.gap for c in stops if c.gap is not None]
    places: dict[Node, tuple[str, int | None]] = {equations.time: ("t", None)}
    places |= {graph.input(name): ("c", i) for i, name in enumerate(model.layout.parameters)}
    places |= {node: ("y", i) for i, node in enumerate((*equations.variables, *second))}
    kernel = lower_kernel(graph, "inverse_dynamics", nodes, places, arguments=("t", "y", "c"))
    unknown = tuple(controlled + free) if values else names
    labels, quaternions = tuple(row.label for row in rows), tuple(g.coordinates for g in equations.groups if g.norm)
    rubbing, touching = tuple(c.name for c in friction), tuple(c.name for c in stops)
    sizes = len(equations.variables), tuple(given), quaternions
    return InverseKernel(kernel, names, labels, unknown, rubbing, touching, *sizes)


def _equations(model: CompiledModel) -> tuple[EquationsOfMotion, tuple[ContactRow, ...]]:
    """Return a copy of the equations of a model, and the contacts whose forces are not among the forces in them."""
    if model.modes is None:
        equations = copied(equations_of(model))
        smooth = [c.constraint is None and c.normal_load is not None and c.regularization for c in equations.contacts]
        if not all(smooth):
            raise _refused_contacts(model, equations.contacts)
        return equations, ()
    equations = copied(equations_of(model))
    if any(c.tangential and (c.normal_load is None or len(c.tangential) > 1) for c in equations.contacts):
        raise _refused_contacts(model, equations.contacts)
    return equations, equations.contacts


def equations_of(model: CompiledModel) -> EquationsOfMotion:
    """Return the equations of a model, in which contacts that change have no forces."""
    return model.stages.equations if model.modes is None else model.modes.several.derivation.equations


def friction_sizes(equations: EquationsOfMotion) -> list[Node]:
    """Return the largest forces of contacts with dry friction."""
    graph, sizes = equations.graph, []
    for contact in equations.contacts:
        if contact.tangential:
            assert contact.mu is not None and contact.normal_load is not None
            mu = contact.mu
            if contact.slip_speed is not None:
                speed = graph.call("abs", _slip_speed(equations, contact))
                mu = graph.substitute([mu], {contact.slip_speed: speed})[0]
            sizes.append(mu * contact.normal_load)
    return sizes


def _slip_speed(equations: EquationsOfMotion, contact: ContactRow) -> Node:
    (slip,) = contact.slips
    return slip.drift + equations.graph.sum(a * b for a, b in zip(slip.jacobian, equations.qdot, strict=True))


def _friction_nodes(equations: EquationsOfMotion, friction: Sequence[ContactRow], second: Sequence[Node]) -> list[Node]:
    """Return the sizes of friction, slip velocities, their rates, and columns of its power coefficients."""
    graph, rates, columns = equations.graph, [], []
    for contact in friction:
        (slip,), (number,) = contact.slips, contact.tangential
        rates.append(graph.sum(a * b for a, b in zip(slip.jacobian, second, strict=True)) - slip.bias)
        columns += [row[number] for row in equations.reactions]
    slips = [_slip_speed(equations, contact) for contact in friction]
    return [*(friction_sizes(equations) if friction else []), *slips, *rates, *columns]


def _refused_contacts(model: CompiledModel, contacts: Sequence[ContactRow]) -> CapabilityError:
    names = list_names(repr(contact.name) for contact in contacts)
    return CapabilityError(
        f"{model.name!r}: inverse dynamics knows dry friction with a given normal load along one direction, and"
        f" contacts that are open; those of the scene are {names}. Compile the scene without the others, or"
        " with their forces as inputs"
    )


def _refuse_other_uses(
    model: CompiledModel,
    equations: EquationsOfMotion,
    rows: Sequence[Any],
    forces: tuple[list[Node], list[list[Node]]],
    names: Sequence[str],
) -> None:
    """Reject inputs that are no loads: geometry, constraints or rates depend on them, or loads not in proportion.

    Raises
    ------
    CapabilityError
    """
    graph, (forcing, slopes) = equations.graph, forces
    held = set(equations.symbols.held)
    geometry = [entry for row in equations.mass_matrix for entry in row]
    geometry += [node for row in rows for node in (*row.jacobian, row.drift, row.bias)]
    for name in names:
        own = [name] if name in held else list(hidden_parameters(name)[1:])
        every, rates = graph.mask(own), graph.mask(own[1:])
        loads = [node for column in slopes for node in column]
        moves = any(node.deps & every for node in geometry) or any(node.deps & rates for node in forcing)
        if moves or any(node.deps & every for node in loads):
            what = "moves bodies or constraints, or acts by its rate" if moves else "is no factor of the loads"
            raise CapabilityError(
                f"{model.name!r}: the input {name!r} {what}, so that inverse dynamics does not solve for it; give its"
                f" value, inputs={{{name!r}: ...}}"
            )


def _free_directions(jacobian: FloatArray) -> FloatArray:
    """Return an orthonormal basis (n, k) of the directions that the rows of a Jacobian (m, n) leave free."""
    sizes = np.linalg.norm(jacobian, axis=1)
    rows = jacobian[sizes > 0.0] / sizes[sizes > 0.0, np.newaxis]
    if not len(rows):
        return np.eye(jacobian.shape[1])
    _, values, basis = np.linalg.svd(rows)
    return np.asarray(basis[int(np.sum(values > DEPENDENT * values[0])) :].T)
