"""Regressors: inverse dynamics as a matrix times the inertial parameters of the bodies and coefficients of loads.

The columns are power coefficients (`mechanics.regressor`), evaluated for all states at once, and projected like the
equations of inverse dynamics: onto what constraints leave free, and onto the inputs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..arrays import FloatArray
from ..errors import CapabilityError, ValueInputError, list_names
from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.node import Node
from ..ir.program import hidden_parameters
from ..ir.zero_tests import agree
from ..mechanics.equations import moved_to
from ..mechanics.kinematics import Kinematics
from ..mechanics.regressor import TEN, BodyColumns, body_columns
from ..mechanics.virtual_power import given_powers
from ..naming import acceleration_input
from ..transforms.derivatives import GUARDED, tangents
from ..transforms.lower_kernels import lower_kernel
from .inverse_dynamics import at_times, inverse_of, terms_at
from .inverse_kernel import DEPENDENT, InverseKernel, Terms, equations_of, friction_sizes

if TYPE_CHECKING:
    from ..model.model import CompiledModel

LOADS = "loads"
"""Name of the column of all loads that are no unknown parameters; its factor is 1."""


@final
@frozen(eq=False)
class RegressorKernel:
    """Columns of generalised forces as one kernel of the same arguments as that of inverse dynamics.

    Attributes
    ----------
    inverse : InverseKernel
        Constraints, inputs and dry friction at the same states.
    columns : Kernel
        A row (n_q) each for bodies and further parameters, then given loads (n_q), then sizes of dry friction without
        the further parameters, and by each of them.
    values : Kernel
        The factors of the columns.
    names : tuple of str
        Of the columns.
    further : int
        How many of them, before the last, are coefficients of loads.
    loaded : bool
        Whether there is a column of given loads, the last.
    """

    inverse: InverseKernel
    columns: Kernel
    values: Kernel
    names: tuple[str, ...]
    further: int
    loaded: bool


def regressor_kernel(model: CompiledModel, given: Sequence[str], further: Sequence[str]) -> RegressorKernel:
    """Return the kernels of a model for inputs of which some are given, and parameters that loads are linear in.

    Raises
    ------
    CapabilityError
        For scenes without positions, inertia that changes, and parameters that loads are not linear in.
    """
    inverse = model.inverse_kernel(given)
    equations = equations_of(model)
    if equations.scene is None:
        raise CapabilityError(
            f"{model.name!r} gives velocities or a Lagrangian, not positions of its bodies: a regressor is by the"
            " inertia of bodies with positions. Write it as a scene with points and frames"
        )
    graph = equations.scene.graph.copy()
    scene = replace(moved_to(equations.scene, equations.scene.graph, graph), graph=graph)
    kinematics, symbols = Kinematics(scene), scene.symbols
    second = [graph.input(acceleration_input(name)) for name in symbols.coordinates]
    bodies = body_columns(kinematics, second)
    values = [value for body in bodies for value in body.values]
    _refuse_changing(model, graph, values)
    changed = {graph.input(name): graph.zero for name in symbols.unknowns}
    for name in (*symbols.held, *symbols.input_names):
        if name not in given:
            knot, *coefficients = hidden_parameters(name)
            changed |= {graph.input(name): graph.zero, graph.input(knot): graph.input(symbols.time)}
            changed |= {graph.input(coefficients[0]): graph.zero}
    powers = graph.substitute(given_powers(kinematics), changed)
    _refuse_unknown_loads(model, graph, changed, (powers, bodies))
    sizes = graph.adopt(friction_sizes(equations)) if inverse.friction else []
    forces = [-power for power in powers] + list(sizes)
    parameters = [graph.input(name) for name in further]
    slopes = [_slope(model, graph, forces, place, parameters) for place in range(len(parameters))]
    rest = graph.substitute(forces, dict.fromkeys(parameters, graph.zero))
    n = len(symbols.coordinates)
    nodes = [node for body in bodies for column in body.columns for node in column]
    nodes += [node for slope in slopes for node in slope[:n]] + rest[:n]
    nodes += rest[n:] + [node for slope in slopes for node in slope[n:]]
    loaded = not all(node.is_zero for node in rest)
    names = [f"{body.name}.{what}" for body in bodies for what in TEN[: len(body.values)]] + list(further)
    factors = [*values, *parameters, *([graph.one] if loaded else [])]
    states = [*kinematics.q, *kinematics.qdot, *map(graph.input, symbols.states), *second]
    places: dict[Node, tuple[str, int | None]] = {graph.input(name): ("c", i) for i, name in _numbered(model)}
    columns = lower_kernel(
        graph,
        "regressor",
        nodes,
        {graph.input(symbols.time): ("t", None), **places} | {x: ("y", i) for i, x in enumerate(states)},
        arguments=("t", "y", "c"),
    )
    inertia = lower_kernel(graph, "inertial_parameters", factors, places, arguments=("t", "y", "c"))
    return RegressorKernel(inverse, columns, inertia, tuple(names + ([LOADS] if loaded else [])), len(further), loaded)


def _numbered(model: CompiledModel) -> list[tuple[int, str]]:
    return list(enumerate(model.layout.parameters))


def _refuse_unknown_loads(
    model: CompiledModel, graph: Graph, changed: Mapping[Node, Node], parts: tuple[list[Node], list[BodyColumns]]
) -> None:
    """Raise unless the columns, their factors and the loads are the forces of the equations at zero second rates.

    Raises
    ------
    CapabilityError
    """
    equations, (powers, bodies) = equations_of(model), parts
    second = [graph.input(acceleration_input(name)) for name in equations.symbols.coordinates]
    forces = graph.substitute(graph.adopt(equations.forcing), changed)
    columns = [(column, value) for body in bodies for column, value in zip(body.columns, body.values, strict=True)]
    bias = [power - graph.sum(c[i] * value for c, value in columns) for i, power in enumerate(powers)]
    if not agree(forces, graph.substitute(bias, dict.fromkeys(second, graph.zero))):
        raise CapabilityError(
            f"{model.name!r}: the equations have forces that are neither inertia nor loads of the scene, such as"
            " regularised friction; a regressor takes dry friction, without regularization="
        )


def _slope(model: CompiledModel, graph: Graph, forces: list[Node], place: int, parameters: list[Node]) -> list[Node]:
    """Return the derivative of loads by one of the parameters, which it must not depend on.

    Raises
    ------
    CapabilityError
    """
    parameter = parameters[place]
    slope = [graph.freed_of(node, parameters) for node in tangents(graph, forces, {parameter: graph.one}, GUARDED)]
    if any(node is None for node in slope) or all(node is not None and node.is_zero for node in slope):
        why = "no load depends on it" if None not in slope else "loads are not linear in it"
        raise CapabilityError(
            f"{model.name!r}: {str(parameter.payload)!r} is no column of a regressor: {why}. Coefficients of loads,"
            " such as those of damping and dry friction, are; masses and inertias are columns anyway"
        )
    return [node for node in slope if node is not None]


def _refuse_changing(model: CompiledModel, graph: Graph, values: Sequence[Node]) -> None:
    known = [graph.input(name) for _, name in _numbered(model)]
    graph.heal(list(values), known)
    allowed = graph.mask(str(node.payload) for node in known)
    if any(node.deps & ~allowed for node in values):
        raise CapabilityError(
            f"{model.name!r}: masses, mass centres or inertias change along a motion; a regressor takes constant ones"
        )


def regressor_at(
    model: CompiledModel, kernel: RegressorKernel, t: FloatArray, y: FloatArray, p: FloatArray
) -> FloatArray:
    """Return regressors (k, n_u, n_pi) at times (k,), rows (k, n) and parameters (n_p,) or (k, n_p).

    Raises
    ------
    ValueInputError
        Where several values of the inputs do the same.
    """
    p, inverse = at_times(model, t, p), kernel.inverse
    n, f, count = len(inverse.coordinates), len(inverse.friction), len(kernel.names) - kernel.loaded
    rows = interpret_rows(kernel.columns, t, y, p)
    full = rows[:, : n * count].reshape(len(t), count, n).transpose(0, 2, 1)
    rest = rows[:, n * count : n * (count + 1)]
    sizes = rows[:, n * (count + 1) :].reshape(len(t), 1 + kernel.further, f)
    out = np.empty((len(t), len(inverse.unknown), len(kernel.names)))
    for place, (where, terms) in enumerate(terms_at(model, inverse, t, y, p)):
        rubbed = (sizes[place] * terms.friction_senses) @ terms.friction[3]
        columns = full[place].copy()
        columns[:, count - kernel.further :] += rubbed[1:].T
        if kernel.loaded:
            columns = np.column_stack([columns, rest[place] + rubbed[0]])
        out[place] = _projected(inverse, terms, columns, where)
    return out


def _projected(inverse: InverseKernel, terms: Terms, columns: FloatArray, where: str) -> FloatArray:
    """Return columns of generalised forces (n_q, n) as those of inputs (n_u, n)."""
    if not len(terms.jacobian) and not inverse.driven:
        return columns
    free, scales = terms.free_directions, terms.roots
    able = free.T @ (terms.by_input / scales[:, np.newaxis])
    if inverse.driven and np.linalg.matrix_rank(able, tol=DEPENDENT * np.linalg.norm(able)) < able.shape[1]:
        raise ValueInputError(
            f"{where} several values of the inputs {list_names(inverse.unknown)} do the same, so that a motion does not"
            " determine them: give what was measured as inputs=..., which puts them into the column"
            f" {LOADS!r}, and leaves generalised forces"
        )
    return np.asarray(inverse_of(able) @ (free.T @ (columns / scales[:, np.newaxis])))


def parameter_values(kernel: RegressorKernel, p: FloatArray) -> dict[str, Any]:
    """Return the factors of the columns at parameters (n_p,), by name."""
    values = interpret_rows(kernel.values, np.zeros(1), np.zeros((1, 0)), p)[0]
    return dict(zip(kernel.names, values.tolist(), strict=True))
