"""Independent speeds: a basis of the velocities that constraints allow.

Holonomic constraints are solved for a coordinate that enters them linearly with a coefficient
made of parameters only; nonholonomic ones for a quasi-velocity with such a coefficient. No
other pivot is used, so the basis never divides by a function of the configuration. Which
quasi-velocities stand for the rates of a group is tried out: the choice that needs the fewest
operations per evaluation wins.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import final

from ..errors import ConstraintError
from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.zero_tests import magnitude, vanishes
from ..mechanics.equations import ConstraintRow, EquationsOfMotion
from ..mechanics.quasi_velocities import VelocityChoice, VelocityGroup
from ..transforms.derivatives import tangents
from ..transforms.linear import matvec

_SMALL = 1e-3
"""Share of another number below which a number is not divided by, so that eliminations do not amplify rounding."""


class NoRegularBasis(Exception):
    """No basis without a division by a function of the configuration was found; the text says where."""


@final
@frozen
class Parametrization:
    """q and q_dot in terms of the coordinates kept and independent speeds u.

    Attributes
    ----------
    kept : tuple of int
        Numbers of the coordinates kept.
    coordinates : tuple of Node, length n_q
        q in terms of the kept ones and time.
    rates : tuple of Node, length n_q
        q_dot in terms of kept coordinates, time and u.
    names : tuple of str
        Names of u.
    speeds : tuple of Node
        u as inputs.
    definitions : tuple of Node
        u in terms of q and q_dot.
    notes : tuple of str
        Eliminated coordinates and speeds, for `explain()`.
    pivots : tuple of (str, Node)
        Label of a constraint, and the function of the parameters that it was divided by, where that is no number.
    """

    kept: tuple[int, ...]
    coordinates: tuple[Node, ...]
    rates: tuple[Node, ...]
    names: tuple[str, ...]
    speeds: tuple[Node, ...]
    definitions: tuple[Node, ...]
    notes: tuple[str, ...]
    pivots: tuple[tuple[str, Node], ...]


def parametrizations(equations: EquationsOfMotion, cost: Callable[[Parametrization], float]) -> Parametrization:
    """Return the cheapest regular parametrization, by `cost`.

    Raises
    ------
    NoRegularBasis
        When there is none, with the constraint that cannot be solved for.
    ConstraintError
        When a constraint follows from others or contradicts them.
    """
    holonomic = _solve_holonomic(equations)
    groups = [group for group in equations.groups if not set(group.coordinates) & set(holonomic.solved)]
    picks: list[VelocityChoice | None] = [group.choices[0] if group.norm else None for group in groups]
    best: Parametrization | None = None
    best_cost, reason = float("inf"), ""
    trials: list[dict[int, VelocityChoice | None]] = [{}]
    if equations.tree is None:
        trials += [{place: choice} for place, group in enumerate(groups) for choice in group.choices]
    else:  # of many bodies, each of which makes a trial longer, all groups change together
        for k in range(max((len(group.choices) for group in groups), default=0)):
            trials.append(dict(enumerate(group.choices[min(k, len(group.choices) - 1)] for group in groups)))
    for changed in trials:
        trial = [changed.get(place, pick) for place, pick in enumerate(picks)]
        try:
            found = _parametrize(equations, holonomic, groups, trial)
        except NoRegularBasis as failure:
            reason = reason or str(failure)
            continue
        price = cost(found) if len(trials) > 1 or equations.tree is None else 0.0
        if price < best_cost:
            best, best_cost, picks = found, price, trial
        elif equations.tree is not None:  # bodies come by their distance from the root, with which costs grow
            break
    if best is None:
        raise NoRegularBasis(reason)
    return best


@final
@frozen
class _Holonomic:
    """Coordinates solved for: number -> expression in the others, and the values of q and q_dot that follow.

    `pivots` are as in `Parametrization`.
    """

    solved: dict[int, Node]
    coordinates: tuple[Node, ...]
    rates: tuple[Node, ...]
    pivots: tuple[tuple[str, Node], ...]


def _add_solution(
    graph: Graph, solved: dict[int, Node], number: int, unknown: Node, expression: Node, slope: Node
) -> None:
    """Solve an expression that vanishes, affine in `unknown` with a slope, and substitute it in what is solved."""
    value = -graph.substitute([expression], {unknown: graph.zero})[0] / slope
    for i, old in solved.items():
        if old.deps & unknown.deps:
            solved[i] = graph.substitute([old], {unknown: value})[0]
    solved[number] = value


def _solve_holonomic(equations: EquationsOfMotion) -> _Holonomic:
    graph, q = equations.graph, equations.q
    solved: dict[int, Node] = {}
    pivots: list[tuple[str, Node]] = []
    for row in (row for row in equations.constraints if row.position is not None):
        assert row.position is not None
        known = {q[i]: value for i, value in solved.items()}
        residual = _without_rounding(graph, graph.substitute([row.position], known)[0], q)
        turning = {i for group in equations.groups if group.norm for i in group.coordinates}
        free = {i: x for i, x in enumerate(q) if residual.deps & x.deps and i not in solved and i not in turning}
        pivot = _pivot(graph, residual, free, equations.moving)
        if pivot is None:
            _refuse_dependent(equations, row, residual, q)
            raise NoRegularBasis(f"{row.label} gives no coordinate in closed form")
        number, slope = pivot
        if slope.number is None:
            pivots.append((row.label, slope))
        _add_solution(graph, solved, number, q[number], residual, slope)
    coordinates = tuple(solved.get(i, node) for i, node in enumerate(q))
    flow = dict(zip(q, equations.qdot, strict=True)) | {equations.time: graph.one}
    rates = list(equations.qdot)
    for number, value in solved.items():
        rates[number] = tangents(graph, [value], flow)[0]
    return _Holonomic(solved, coordinates, tuple(rates), tuple(pivots))


def _refuse_dependent(
    equations: EquationsOfMotion, row: ConstraintRow, residual: Node, variables: Sequence[Node]
) -> None:
    """Raise for a constraint that has no variable after elimination of the others."""
    graph = equations.graph
    if any(graph.freed_of(residual, [x]) is None and not vanishes(_slope(graph, residual, x)) for x in variables):
        return
    verdict, wrong = ("follows from", "repeats") if vanishes(residual) else ("contradicts", "contradicts")
    raise ConstraintError(
        f"scene {equations.name!r}: {row.label} {verdict} the other constraints at every state."
        f" Remove it, or correct the one that it {wrong}"
    )


def _slope(graph: Graph, node: Node, x: Node) -> Node:
    return tangents(graph, [node], {x: graph.one})[0]


def _without_rounding(graph: Graph, node: Node, variables: Sequence[Node]) -> Node:
    """Return a value without the variables whose coefficients are zero up to the rounding of decimals."""
    if not graph.decimals:
        return node
    noise = [x for x in variables if graph.freed_of(node, [x]) is None and vanishes(_slope(graph, node, x))]
    try:
        return graph.substitute([node], dict.fromkeys(noise, graph.zero))[0] if noise else node
    except ZeroDivisionError:
        return node


def _pivot(
    graph: Graph, residual: Node, candidates: Mapping[int, Node], moving: Sequence[Node]
) -> tuple[int, Node] | None:
    """Return the number of the variable to solve a constraint for, and its coefficient; numbers before parameters."""
    best: tuple[int, Node] | None = None
    for number, variable in candidates.items():
        slope = graph.freed_of(_slope(graph, residual, variable), moving)
        if slope is not None and not vanishes(slope) and (best is None or _preferred(slope, best[1])):
            best = (number, slope)
    return best


def _preferred(slope: Node, other: Node) -> bool:
    """Whether to divide by a slope rather than by another: units before numbers before parameters, none too small."""
    if slope.number is not None and other.number is not None:
        small, large = sorted((magnitude(slope), magnitude(other)))
        if small < _SMALL * large:
            return magnitude(slope) == large
    return _rank(slope) < _rank(other)


def _rank(slope: Node) -> int:
    return 0 if slope.is_one or (-slope).is_one else 1 if slope.number is not None else 2


def _parametrize(
    equations: EquationsOfMotion,
    holonomic: _Holonomic,
    groups: Sequence[VelocityGroup],
    picks: Sequence[VelocityChoice | None],
) -> Parametrization:
    graph = equations.graph
    kept = [i for i in range(len(equations.q)) if i not in holonomic.solved]
    names = {i: equations.symbols.rates[i] for i in kept}
    speeds = {i: equations.qdot[i] for i in kept}
    definitions: dict[int, Node] = dict(speeds)
    turned: dict[Node, Node] = {}
    at_kept = dict(zip(equations.q, holonomic.coordinates, strict=True))
    for group, pick in zip(groups, picks, strict=True):
        if pick is None:
            continue
        rows = [graph.substitute(row, at_kept) for row in pick.rows]
        inputs = [graph.input(f"speed {name}") for name in pick.names]
        rates = matvec(graph, pick.inverse, inputs) if pick.inverse else _solve(graph, rows, inputs)
        turned |= {equations.qdot[i]: rate for i, rate in zip(group.coordinates, rates, strict=True)}
        for i in group.coordinates[len(inputs) :]:  # a quaternion has one rate more than speeds
            del names[i], speeds[i], definitions[i]
        for i, name, speed, row in zip(group.coordinates, pick.names, inputs, pick.rows, strict=False):
            names[i], speeds[i] = name, speed
            definitions[i] = graph.sum(a * equations.qdot[j] for a, j in zip(row, group.coordinates, strict=True))
    solved, pivots = _solve_nonholonomic(equations, at_kept, holonomic, turned, speeds)
    independent = [i for i in speeds if i not in solved]
    free = [speeds[i] for i in independent]
    dependent = {speeds[i]: value for i, value in solved.items()}
    rates = graph.substitute(graph.substitute(holonomic.rates, turned), at_kept)
    rates = [_linear(graph, rate, free) for rate in graph.substitute(rates, dependent)]
    notes = [f"{equations.symbols.coordinates[i]} is given by a holonomic constraint" for i in sorted(holonomic.solved)]
    notes += [f"{names[i]} is given by a nonholonomic constraint" for i in sorted(solved)]
    return Parametrization(
        kept=tuple(kept),
        coordinates=holonomic.coordinates,
        rates=tuple(rates),
        names=tuple(names[i] for i in independent),
        speeds=tuple(free),
        definitions=tuple(definitions[i] for i in independent),
        notes=tuple(notes),
        pivots=(*holonomic.pivots, *pivots),
    )


def _solve_nonholonomic(
    equations: EquationsOfMotion,
    at_kept: dict[Node, Node],
    holonomic: _Holonomic,
    turned: dict[Node, Node],
    speeds: dict[int, Node],
) -> tuple[dict[int, Node], list[tuple[str, Node]]]:
    """Return the speeds that nonholonomic constraints give, each in terms of the independent ones, and the pivots."""
    graph = equations.graph
    solved: dict[int, Node] = {}
    pivots: list[tuple[str, Node]] = []
    moving = (*equations.moving, *speeds.values())
    for row in (row for row in equations.constraints if row.position is None):
        jacobian = graph.substitute([*row.jacobian, row.drift], at_kept)
        rates = graph.substitute(graph.substitute(holonomic.rates, turned), at_kept)
        velocity = graph.sum(a * b for a, b in zip(jacobian, rates, strict=False)) + jacobian[-1]
        velocity = graph.substitute([velocity], {speeds[i]: value for i, value in solved.items()})[0]
        velocity = _linear(graph, velocity, tuple(speeds.values()))
        pivot = _pivot(graph, velocity, {i: speed for i, speed in speeds.items() if i not in solved}, moving)
        if pivot is None:
            _refuse_dependent(equations, row, velocity, tuple(speeds.values()))
            raise NoRegularBasis(f"{row.label} gives no velocity without a division by a function of the configuration")
        number, slope = pivot
        if slope.number is None:
            pivots.append((row.label, slope))
        _add_solution(graph, solved, number, speeds[number], velocity, slope)
    independent = [speed for i, speed in speeds.items() if i not in solved]
    return {i: _linear(graph, value, independent) for i, value in solved.items()}, pivots


def _linear(graph: Graph, node: Node, speeds: Sequence[Node]) -> Node:
    """Return `node`, which is affine in the speeds, having offered it the form sum of slope times speed."""
    speeds = [speed for speed in speeds if speed.deps & node.deps]
    slopes = [tangents(graph, [node], {speed: graph.one})[0] for speed in speeds]
    slopes = [graph.zero if vanishes(slope) else slope for slope in slopes]
    rest = graph.substitute([node], dict.fromkeys(speeds, graph.zero))[0]
    return graph.sum(slope * speed for slope, speed in zip(slopes, speeds, strict=True)) + rest


def _solve(graph: Graph, rows: Sequence[Sequence[Node]], values: Sequence[Node]) -> list[Node]:
    """Return x with rows . x = values, for two or three rows: units are eliminated, the rest goes by cofactors."""
    size = range(len(rows))
    unit = [(i, j) for i in size for j in size if rows[i][j].is_one or (-rows[i][j]).is_one]
    for i, j in unit:
        others = [k for k in size if k != i]
        if len(rows) == 3 and all(rows[k][j].is_zero for k in others):
            left = [c for c in size if c != j]
            part = _cofactors(graph, [[rows[k][c] for c in left] for k in others], [values[k] for k in others])
            last = values[i] - graph.sum(rows[i][c] * x for c, x in zip(left, part, strict=True))
            part.insert(j, last * rows[i][j])
            return part
    return _cofactors(graph, rows, values)


def _cofactors(graph: Graph, rows: Sequence[Sequence[Node]], values: Sequence[Node]) -> list[Node]:
    if len(rows) == 2:
        (a, b), (c, d) = rows
        cofactors = [[d, -b], [-c, a]]
        determinant = a * d - b * c
    else:
        cofactors = [
            [
                rows[(j + 1) % 3][(i + 1) % 3] * rows[(j + 2) % 3][(i + 2) % 3]
                - rows[(j + 1) % 3][(i + 2) % 3] * rows[(j + 2) % 3][(i + 1) % 3]
                for j in range(3)
            ]
            for i in range(3)
        ]
        determinant = graph.sum(rows[0][j] * cofactors[j][0] for j in range(3))
    if vanishes(determinant):
        raise NoRegularBasis("three rotations that do not turn a frame freely")
    return [
        graph.sum(entry / determinant * value for entry, value in zip(row, values, strict=True)) for row in cofactors
    ]
