"""Margins as event functions: from a loss of rank of the constraints, from gimbal lock, and from ends of positions.

The Gram determinant of the rows J_i of the constraint Jacobian, over the squares of their lengths s_i, is at most some
times the square of the smallest singular value. The singular value itself, or what follows it more closely, dips too
narrowly for the points at which a step is looked at; the determinant is as smooth as the Jacobian. A row that vanishes
is not to hide it: s_i^2 = |J_i|^2 + 0.01 sum |J_k|^2 / n + |T dJ_i/dt|^2, with a time T that is short beside the runs.

Where a motion with an error passes beside a place where rank is lost, the determinant falls no further than the error
allows. So the turn of the Jacobian by the correction of the positions onto the constraints is watched too, against the
least share of a pivot (`dalembert.runs.singular`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import final

from ..frozen import frozen
from ..ir.graph import Graph
from ..ir.kernel import Kernel
from ..ir.node import Node
from ..transforms.derivatives import tangents
from ..transforms.linear import Matrix, SingularMatrix, factorize, matvec, transpose
from ..transforms.lower_kernels import lower_kernel
from .base import ReducedSystem
from .dependent_rows import RankSolver, Redundancy, least_share
from .grouped_rows import solver_of

_OTHERS = 1e-2
_SHORT, _STEP = 1e-2, 1024.0
"""A time [s], and the factor from one such time to the next: runs of ordinary duration have the first."""

_LEVELS = (1e-3, 1e-6, 1e-9, 1e-12)
"""A determinant that is small all along falls below the next of them where rank is lost."""

_TURN = 0.05
"""Turn of the Jacobian by a correction, over the share, from which on a case is looked at."""

_LOCKED, _FLOOR = 1e-6, 1e-8
"""Share of the coordinates by which constraints may be off where they lock, and the least square of these."""

_TINY = 1e-300


def short_time(duration: float) -> float:
    """Return a time that is short beside runs of a duration, in whatever unit: 0.01 for all from 1/1024 to 1024."""
    return _SHORT * _STEP ** int(math.log(duration, _STEP)) if 0.0 < duration < math.inf else _SHORT


def rank_margins(system: ReducedSystem, short: float) -> dict[str, Node]:
    """Return functions of coordinates, rates and time by name, one of which changes its sign where rank is lost.

    `short` is a time in which no row changes by much, unless it vanishes (`short_time`).

    None where the Jacobian is constant along motions, or of less than full rank whatever the state.
    """
    equations, graph = system.equations, system.equations.graph
    rows = [row.jacobian for i, row in enumerate(equations.constraints) if i not in system.left_out]
    flow = dict(zip(equations.q, equations.qdot, strict=True)) | {equations.time: graph.one}
    flow |= equations.state_flow
    if system.redundancy is not None:
        return _joint_margins(system, system.redundancy, flow, short)
    gram = [[graph.sum(a * b for a, b in zip(x, y, strict=True)) for y in rows] for x in rows]
    mean = graph.node(_OTHERS / len(rows)) * graph.sum(gram[i][i] for i in range(len(rows)))
    try:
        pivots = factorize(graph, gram).pivots
    except SingularMatrix:
        return {}
    share = graph.one
    for pivot in pivots:
        share = share * pivot
    for i, row in enumerate(rows):
        rates = tangents(graph, row, flow)
        share = share / (gram[i][i] + mean + graph.node(short * short) * graph.sum(rate * rate for rate in rates))
    if graph.freed_of(share, list(equations.moving)) is not None:
        return {}
    levels = {f"Gram determinant less {level:g}": share - graph.node(level) for level in _LEVELS}
    return levels | _turn_margin(system, rows, gram, mean)


def _joint_margins(
    system: ReducedSystem, redundancy: Redundancy, flow: Mapping[Node, Node], short: float
) -> dict[str, Node]:
    """Return the margins of constraints that are enforced together, though some follow from others.

    In place of the determinant stands the least eigenvalue of the Gram matrix that does not vanish. Another margin is
    negative where positions leave more than changes of coordinates explain.
    """
    equations, graph = system.equations, system.equations.graph
    rows = redundancy.scaled([row for i, row in enumerate(equations.constraints) if i not in system.left_out])
    jacobian = [row.jacobian for row in rows]
    gram = [[graph.sum(a * b for a, b in zip(x, y, strict=True)) for y in jacobian] for x in jacobian]
    speeds = [rate for row in jacobian for rate in tangents(graph, row, flow)]
    size = graph.sum(gram[i][i] for i in range(len(rows))) + graph.node(short * short) * graph.sum(
        rate * rate for rate in speeds
    )
    size = size / graph.node(float(len(rows))) + graph.node(_TINY)
    solver = solver_of(graph, gram, redundancy)
    least = least_share(graph, gram, solver.rank) if isinstance(solver, RankSolver) else solver.least_share()
    share = least / size
    found = {f"least eigenvalue less {level:g}": share - graph.node(level) for level in _LEVELS}
    residual = [graph.zero if row.position is None else row.position for row in rows]
    step = matvec(graph, transpose([list(row) for row in jacobian]), solver.solve(residual))
    turns = tangents(graph, [entry for row in jacobian for entry in row], dict(zip(equations.q, step, strict=True)))
    turned = graph.sum(turn * turn for turn in turns) / size
    if not turned.is_zero:
        found["turn of the Jacobian"] = (share - graph.node(_TURN**-2) * turned) * share * share
    beside = [a - b for a, b in zip(residual, solver.within(residual), strict=True)]
    reach = graph.sum(q * q for q in equations.q) + graph.node(_FLOOR)
    allowed = graph.node(_LOCKED * _LOCKED) * size * reach
    found["positions that no change explains"] = allowed - graph.sum(value * value for value in beside)
    return found


def _turn_margin(system: ReducedSystem, rows: Sequence[Sequence[Node]], gram: Matrix, mean: Node) -> dict[str, Node]:
    """Return a function that is negative where corrections of positions turn the Jacobian by as much as its share.

    It is multiplied by the square of a pivot, without which it would dip too narrowly.
    """
    equations, graph = system.equations, system.equations.graph
    tiny = graph.node(_TINY)
    positions = [row.position for i, row in enumerate(equations.constraints) if i not in system.left_out]
    residual = [graph.zero if position is None else position for position in positions]
    solved = factorize(graph, gram, lambda pivot, diagonal, row: graph.call("max", pivot, tiny))
    step = matvec(graph, transpose(rows), solved.solve(residual))
    flow = dict(zip(equations.q, step, strict=True))
    turns = [graph.sum(turn * turn for turn in tangents(graph, row, flow)) for row in rows]
    if all(turn.is_zero for turn in turns):
        return {}
    sizes = [gram[i][i] + mean + tiny for i in range(len(rows))]
    turned = graph.sum(turn / size for turn, size in zip(turns, sizes, strict=True))
    pivots = list(zip(solved.order, solved.pivots, strict=True))
    share, least = (
        graph.one / graph.sum(factors[row] / pivot for row, pivot in pivots)
        for factors in (sizes, [graph.one] * len(rows))
    )
    return {"turn of the Jacobian": (share - graph.node(_TURN**-2) * turned) * least * least}


_LOCK = 1e-6
"""Square of the determinant below which a case is looked at."""


def lock_margins(system: ReducedSystem) -> dict[str, Node]:
    """Return functions of coordinates by name, one of which falls through zero where angles come to lock at a kink."""
    graph = system.equations.graph
    return {f"lock {i}": lock * lock - graph.node(_LOCK) for i, lock in enumerate(system.equations.kinked_locks)}


# Ends of what positions are defined for.
#
# The height -sqrt(L**2 - x**2) of a pendulum ends at x = L, where its inertia in x is infinite. Explicit and implicit
# steps of a motion that goes on beyond become ever smaller there, until x no longer changes and its rate does: the
# motion loses its energy, comes back and succeeds. On the way x is as near to the end as numbers can be. A height
# log(x) has no end, but comes to where x is less than its error.

ROOT_END = 1e-12
"""Share of the largest terms of its argument below which a root has come to its end: rounding leaves some 1e-16."""

_NEAR, _NOTHING = 1e-6, 1e-15
"""Share of its terms below which a case is looked at, and the argument where that is one term."""


@final
@frozen
class Ends:
    """Where positions of a system end: kernel of (t, y, c) of arguments, then of the sizes of their terms.

    Of the arguments, `roots` are those of roots, and the others what the kinetic energy is divided by.
    """

    kernel: Kernel
    roots: int


def position_ends(system: ReducedSystem) -> Ends | None:
    """Return where positions and constraints of a system end; None where no argument can vanish."""
    roots, divisors = _ending(system)
    found, graph = [*roots, *divisors], Graph()
    if not found:
        return None
    q, coordinates = graph.adopt(system.equations.q), graph.adopt(system.coordinates)
    values = {a: b for a, b in zip(q, coordinates, strict=True) if a is not b}
    nodes = graph.adopt([*(argument for argument, _ in found), *(size for _, size in found)])
    return Ends(_state_kernel(system, "position_ends", graph, graph.substitute(nodes, values)), len(roots))


def end_margins(system: ReducedSystem) -> dict[str, Node]:
    """Return functions of coordinates by name, one of which falls through zero where positions are near an end."""
    graph, (roots, divisors) = system.equations.graph, _ending(system)
    pairs = [(argument, size, ROOT_END) for argument, size in roots]
    pairs += [(argument, size, _NEAR) for argument, size in divisors]
    return {
        f"end {i}": argument
        - (graph.node(_NOTHING) if size is graph.call("abs", argument) else graph.node(share) * size)
        for i, (argument, size, share) in enumerate(pairs)
    }


def _ending(system: ReducedSystem) -> tuple[list[tuple[Node, Node]], list[tuple[Node, Node]]]:
    """Return what may vanish with the size of its terms: arguments of roots, and factors of divisors of the energy."""
    equations, graph = system.equations, system.equations.graph
    rows = [row.jacobian for i, row in enumerate(equations.constraints) if i not in system.left_out]
    positions = [row.position for row in equations.constraints if row.position is not None]
    inside = [equations.kinetic_energy, *positions, *(entry for row in rows for entry in row)]
    moving = graph.mask(equations.symbols.coordinates)
    roots = dict.fromkeys(node.args[0] for node in Graph.topological(inside) if _is_root(node))
    divided = [node.args[1] for node in Graph.topological([equations.kinetic_energy]) if node.op == "div"]
    divisors = dict.fromkeys(factor for node in divided for factor in _factors(node))
    sizes = {node: _terms(graph, node) for node in (*roots, *divisors) if node.deps & moving}
    found = [[node for node in nodes if sizes.get(node, node) is not node] for nodes in (roots, divisors)]
    return [(node, sizes[node]) for node in found[0]], [(graph.call("abs", node), sizes[node]) for node in found[1]]


def _is_root(node: Node) -> bool:
    """Whether an operation is a root, or a power that is not whole."""
    power = node.args[1].number if node.op == "pow" else None
    return node.op == "sqrt" or (power is not None and power % 1 != 0)


def _factors(node: Node) -> list[Node]:
    return [factor for arg in node.args for factor in _factors(arg)] if node.op == "mul" else [node]


def _terms(graph: Graph, value: Node) -> Node:
    """Return the size of the terms of a value: itself where these are positive, as squares and their sums are."""
    if value.op in ("add", "sub"):
        return _terms(graph, value.args[0]) + _terms(graph, value.args[1])
    if value.op in ("mul", "div") and value.args[0] is not value.args[1]:
        a, b = (_terms(graph, arg) for arg in value.args)
        return a * b if value.op == "mul" else a / b
    if value.op == "neg":
        return _terms(graph, value.args[0])
    positive = value.op in ("mul", "sqrt", "abs", "exp", "cosh") or (value.number is not None and value.number > 0)
    return value if positive else graph.call("abs", value)


# Distance of three orientation angles from gimbal lock.
#
# The angular velocity is rows . rates; the determinant of the rows is sin(theta) or cos(theta) for rotations about
# axes of coordinates, and vanishes where two of the angles turn the frame about the same line.


@final
@frozen
class Gimbals:
    """The angles of a system that may lock.

    Attributes
    ----------
    kernel : Kernel
        Of (t, y, c), y being the state and c beginning with the parameters: one determinant for each group of angles.
    angles : tuple of tuple of str
        The names of the three angles of each group.
    decisive : tuple of str
        The angle that each determinant depends on; empty where it depends on more.
    """

    kernel: Kernel
    angles: tuple[tuple[str, ...], ...]
    decisive: tuple[str, ...]


def gimbals(system: ReducedSystem) -> Gimbals | None:
    """Return the angles of a system that may lock, or None where there are none."""
    equations = system.equations
    symbols = equations.symbols
    graph = Graph()  # a separate graph, so that the kernel depends on the system alone
    q = graph.adopt(equations.q)
    found: list[tuple[Node, tuple[str, ...], str]] = []
    for group in equations.groups:
        if group.angles:
            node = group.lock(graph)
            inside = [i for i, x in enumerate(q) if graph.freed_of(node, [x]) is None]
            if inside:
                names = tuple(symbols.coordinates[i] for i in group.coordinates)
                found.append((node, names, symbols.coordinates[inside[0]] if len(inside) == 1 else ""))
    if not found:
        return None
    values = {a: b for a, b in zip(q, graph.adopt(system.coordinates), strict=True) if a is not b}
    nodes = graph.substitute([node for node, _, _ in found], values)
    kernel = _state_kernel(system, "gimbals", graph, nodes)
    return Gimbals(kernel, tuple(names for _, names, _ in found), tuple(name for _, _, name in found))


def _state_kernel(system: ReducedSystem, name: str, graph: Graph, nodes: Sequence[Node]) -> Kernel:
    """Return a kernel of (t, y, c), y being the state and c beginning with the parameters."""
    symbols = system.equations.symbols
    inputs: dict[Node, tuple[str, int | None]] = {graph.input(symbols.time): ("t", None)}
    inputs |= {graph.input(name): ("c", i) for i, name in enumerate(symbols.parameters)}
    inputs |= {node: ("y", i) for i, node in enumerate(graph.adopt(system.inputs))}
    return lower_kernel(graph, name, nodes, inputs, arguments=("t", "y", "c"))
