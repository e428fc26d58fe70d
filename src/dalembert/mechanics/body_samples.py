"""Numbers of the balances of bodies at random states that satisfy the constraints.

Wrenches are columns of six rows a body: force, and moment about the origin, on the frame of the scene. Twists are
columns with which these have their power: velocity at the origin, and angular velocity. A particle has a force and the
velocity of its point alone, and zeros in its other rows.
"""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from typing import final

import numpy as np

from ..arrays import FloatArray
from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.interpret import ARRAY_OPERATIONS
from ..ir.node import Node
from ..ir.ops import GRAPH_OPERATIONS
from ..ir.random_points import random_inputs, values_of
from ..naming import acceleration_input
from ..transforms.derivatives import tangents
from .body_balances import BodyBalances
from .equations import EquationsOfMotion
from .manifold import places_on_manifold

_SMALL = 1e-8
_ROUNDING = 1e-13


@final
@frozen
class BodySample:
    """A state, with the wrenches of inertia less loads, of unknowns, and the twists of coordinates.

    Attributes
    ----------
    demand : array (6 n_bodies,)
        Rates of momentum less loads, and less reactions that the mode gives as loads, along the motion.
    unknowns : array (6 n_bodies, n_unknown)
        Wrenches of all unknowns of the scene.
    mode : array (n_unknown, k)
        All unknowns in terms of those that the mode of the contacts leaves.
    twists : array (6 n_bodies, n_q)
    constraints : array (n_constraints, n_q)
    places : array (n_bodies, 3)
        Positions of the mass centres.
    nodes : mapping of Node to float
        Values of inputs of the balances' graph.
    """

    demand: FloatArray
    unknowns: FloatArray
    mode: FloatArray
    twists: FloatArray
    constraints: FloatArray
    places: FloatArray
    nodes: Mapping[Node, float]


def body_samples(equations: EquationsOfMotion, balances: BodyBalances) -> list[BodySample]:
    """Return samples at a few random states; none where no positions are found that satisfy the constraints."""
    graph, rows = equations.graph, equations.constraints
    gone = list(equations.mode_reactions.values())
    slopes = [tangents(graph, gone, {x: graph.one}) for x in equations.unknowns] if gone else []
    jacobian = [x for row in rows for x in row.jacobian]
    others = [x for row in rows for x in (row.drift, row.bias)] + [x for column in slopes for x in column]
    others += [*equations.forcing, *equations.inertia, *gone]  # finite, as of bodies
    positions = [row.position for row in rows if row.position is not None]
    found = []
    for number, (_, values) in enumerate(places_on_manifold(equations.q, others, positions, jacobian)):
        moving = _rates_on_constraints(equations, values, number)
        found.append(_sample(equations, balances, moving, _mode_of(equations, slopes, moving), number))
    return found


def _rates_on_constraints(equations: EquationsOfMotion, values: dict[Node, float], seed: int) -> dict[Node, float]:
    """Return values with random rates that satisfy the constraints."""
    draw = random.Random(seed)
    rates = np.array([draw.uniform(-1.5, 1.5) for _ in equations.qdot])
    values = values | dict.fromkeys(equations.qdot, 0.0)
    if equations.constraints:
        matrix = _jacobian(equations, values)
        drift = np.array(values_of([row.drift for row in equations.constraints], values))
        rates = rates - np.linalg.lstsq(matrix, matrix @ rates + drift, rcond=1e-10)[0]
    return values | dict(zip(equations.qdot, map(float, rates), strict=True))


def _jacobian(equations: EquationsOfMotion, values: Mapping[Node, float]) -> FloatArray:
    flat = values_of([x for row in equations.constraints for x in row.jacobian], values)
    return np.array(flat).reshape(-1, len(equations.q))


def _mode_of(
    equations: EquationsOfMotion, slopes: Sequence[Sequence[Node]], values: Mapping[Node, float]
) -> tuple[FloatArray, FloatArray]:
    """Return all unknowns of the scene by those that a mode leaves: a matrix, and their values where these are zero.

    The latter are those of friction under given loads.
    """
    assert equations.scene is not None
    names, kept = equations.scene.symbols.unknowns, equations.symbols.unknowns
    matrix, given = np.zeros((len(names), len(kept))), np.zeros(len(names))
    gone, nodes = [names.index(name) for name in equations.mode_reactions], list(equations.mode_reactions.values())
    given[gone] = values_of(nodes, {**values, **dict.fromkeys(equations.unknowns, 0.0)})
    for j, name in enumerate(kept):
        matrix[names.index(name), j] = 1.0
    for j, column in enumerate(slopes):
        matrix[gone, j] = values_of(column, values)
    return matrix, given


def _sample(
    equations: EquationsOfMotion,
    balances: BodyBalances,
    state: Mapping[Node, float],
    mode: tuple[FloatArray, FloatArray],
    seed: int,
) -> BodySample:
    symbols, graph, size = balances.model.symbols, balances.graph, len(balances.poses)
    names = {str(node.payload): value for node, value in state.items() if node.op == "input"}
    rates, unknowns = list(symbols.rates), list(symbols.unknowns)
    seconds = [acceleration_input(name) for name in symbols.coordinates]
    n_q, n_x = len(rates), len(unknowns)
    # one column a case: the state; each rate alone and none; each second rate and each unknown in addition
    cases = 2 + 2 * n_q + n_x
    nodes = _nodes(balances)
    inputs: dict[Node, FloatArray] = {
        node: np.full(cases, names.get(str(node.payload), value))
        for node, value in random_inputs(nodes, random.Random(seed)).items()
    }
    for name, first in ((rates, 1), (seconds, 2 + n_q), (unknowns, 2 + 2 * n_q)):
        for j, each in enumerate(name):
            values = np.full(cases, names.get(each, 0.0)) if name is rates else np.zeros(cases)
            if name is rates:
                values[1 : 2 + n_q] = 0.0
            values[first + j] = 1.0
            inputs[graph.input(each)] = values
    table = _array_values(nodes, inputs, cases).reshape(size, -1, cases)
    twists, wrenches = np.zeros((6 * size, cases)), np.zeros((6 * size, cases))
    places = np.empty((size, 3))
    for b, body in enumerate(balances.model.bodies):
        turn = table[b, :9, 0].reshape(3, 3).T  # columns: axes of the body's frame
        place = places[b] = table[b, 9:12, 0]
        v, omega, force, moment = (turn @ table[b, 12 + 3 * k : 15 + 3 * k] for k in range(4))
        wrenches[6 * b : 6 * b + 3], twists[6 * b : 6 * b + 3] = force, v
        if body.inertia is not None:
            wrenches[6 * b + 3 : 6 * b + 6] = moment + np.cross(place, force.T).T
            twists[6 * b : 6 * b + 3] += np.cross(place, omega.T).T
            twists[6 * b + 3 : 6 * b + 6] = omega
    along = twists[:, 1 : 1 + n_q] - twists[:, 1 + n_q : 2 + n_q]
    inertia = wrenches[:, 2 + n_q : 2 + 2 * n_q] - wrenches[:, :1]
    forces = wrenches[:, :1] - wrenches[:, 2 + 2 * n_q :]
    constraints = _jacobian(equations, state) if equations.constraints else np.zeros((0, n_q))
    mass, rest = along.T @ inertia, -along.T @ wrenches[:, 0]
    if equations.mode_reactions:  # friction of the mode is in its forcing
        rest = np.array(values_of(equations.forcing, {**random_inputs(equations.forcing, random.Random(0)), **state}))
    bias = np.array(values_of([row.bias for row in equations.constraints], state))
    whole = np.block([[mass, constraints.T], [constraints, np.zeros((len(bias), len(bias)))]])
    accelerations = np.linalg.lstsq(whole, np.concatenate([rest, bias]), rcond=1e-12)[0][:n_q]
    matrix, given = mode
    terms = np.hstack([wrenches[:, :1], inertia * accelerations, -forces * given])
    demand = terms.sum(axis=1)
    demand[np.abs(demand) <= _ROUNDING * np.abs(terms).sum(axis=1)] = 0.0  # of loads that balance
    known = {node: float(value[0]) for node, value in inputs.items()}
    return BodySample(demand, forces, matrix, along, constraints, places, known)


def _nodes(balances: BodyBalances) -> list[Node]:
    """Return for each body: axes of its frame, position, velocity, angular velocity, and screw (24)."""
    kinematics, graph = balances.kinematics, balances.graph
    zero, one = graph.zero, graph.one
    nodes: list[Node] = []
    for pose, screw in zip(balances.poses, balances.screws, strict=True):
        for axis in ((one, zero, zero), (zero, one, zero), (zero, zero, one)):
            nodes += kinematics.to_frame(axis, pose.frame, 0)
        nodes += [*kinematics.position(pose), *pose.v, *pose.omega, *screw[0], *screw[1]]
    return nodes


def _array_values(nodes: Sequence[Node], inputs: Mapping[Node, FloatArray], cases: int) -> FloatArray:
    """Return the values of nodes (n_nodes, cases)."""
    known: dict[int, FloatArray] = {node.index: value for node, value in inputs.items()}
    with np.errstate(all="ignore"):
        for node in Graph.topological(nodes):
            if node.index in known:
                continue
            if node.op == "const":
                known[node.index] = np.full(cases, float(node.payload))  # type: ignore[arg-type]
                continue
            values = [known[arg.index] for arg in node.args]
            if node.op == "select":
                known[node.index] = values[2] + values[0] * (values[1] - values[2])
            elif node.op in ARRAY_OPERATIONS:
                known[node.index] = np.asarray(ARRAY_OPERATIONS[node.op](*values))
            else:
                known[node.index] = np.vectorize(GRAPH_OPERATIONS[node.op].evaluate, otypes=[float])(*values)
    return np.array([known[node.index] for node in nodes])


def values_at(sample: BodySample, nodes: Sequence[Node]) -> FloatArray:
    """Return the values of nodes of the balances' graph at a sample."""
    if all(node.op == "const" for node in nodes):
        return np.array([float(node.payload) for node in nodes])  # type: ignore[arg-type]
    return np.array(values_of(nodes, {**random_inputs(nodes, random.Random(0)), **sample.nodes}))


def reaction_direction(samples: Sequence[BodySample], number: int, rigid: Sequence[bool]) -> FloatArray | None:
    """Return the one force or torque (6,) on one body that has the power of a constraint, of size 1 and any sign.

    None where it moves several bodies, where it needs a force at the mass centre and a torque, and where the direction
    differs between samples.
    """
    found = []
    for sample in samples:
        row = sample.constraints[number]
        moving = np.abs(row) > _SMALL * np.abs(row).max()
        twists = sample.twists.reshape(len(rigid), 6, len(row))
        moved = np.flatnonzero(np.abs(twists[:, :, moving]).max(axis=(1, 2)))
        if len(moved) != 1:
            return None
        body = int(moved[0])
        twist = twists[body].copy()
        if rigid[body]:
            twist[:3] += np.cross(twist[3:], sample.places[body], axis=0)  # the velocity of the mass centre
        wrench = np.linalg.lstsq(twist.T, row, rcond=_SMALL)[0]
        size = np.abs(wrench).max()
        wrench[np.abs(wrench) < _SMALL * size] = 0.0
        found.append(wrench / (size * np.sign(wrench[np.flatnonzero(wrench)[0]])))
    one = found[0]
    fixed = all(np.abs(other - one).max() < _SMALL for other in found)
    return one if fixed and not (one[:3].any() and one[3:].any()) else None
