"""Reactions from balances of bodies, which the coordinates hide."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from ..errors import ConstraintError, list_names
from ..ir.node import Node
from ..mechanics.balance_choice import Released
from ..mechanics.equations import EquationsOfMotion
from ..naming import acceleration_input
from ..transforms.derivatives import tangents
from ..transforms.linear import Matrix, factorize, matmul, matvec, transpose
from .reaction_columns import independent_columns

_SHIFT, _IMPROVEMENTS = 1e-7, 2
"""Share of the diagonal that is added to it, and how often what it leaves is improved."""


def solve_released(
    equations: EquationsOfMotion, released: Released, values: Mapping[Node, Node], accelerations: Sequence[Node]
) -> dict[Node, Node]:
    """Return the released reactions in terms of the state.

    Parameters
    ----------
    equations : EquationsOfMotion
    released : Released
        Balances that determine them.
    values : mapping of Node to Node
        Coordinates and rates in terms of the state.
    accelerations : sequence of Node, length n_q
        Second rates in terms of the state.
    """
    graph, unknowns = equations.graph, equations.unknowns
    powers = iter(graph.adopt([balance.power for balance in released.balances if balance.power is not None]))
    names = map(acceleration_input, equations.symbols.coordinates)
    seconds = dict(zip(map(graph.input, names), accelerations, strict=True))
    given = {graph.input(name): value for name, value in equations.mode_reactions.items()}
    rows: Matrix = []
    demands: list[Node] = []
    for balance in released.balances:
        if balance.coordinate is None:
            power = next(powers)
        else:
            power = _along_coordinate(equations, balance.coordinate, list(seconds))
        power = graph.substitute([power], given)[0] if given else power
        own = [unknowns[i] for i in balance.unknowns]
        slopes = [graph.freed_of(tangents(graph, [power], {x: graph.one})[0], unknowns) for x in own]
        rest = graph.substitute([power], dict.fromkeys(unknowns, graph.zero))[0]
        found = graph.substitute([*(-x for x in slopes if x is not None), rest], {**values, **seconds})
        row = dict(zip(balance.unknowns, found, strict=False))
        rows.append([row.get(i, graph.zero) for i in range(len(unknowns))])
        demands.append(found[-1])
    solved: dict[Node, Node] = {}
    for some, columns in _blocks(rows):
        block = [[rows[i][j] for j in columns] for i in some]
        independent, _ = independent_columns(block)
        wanted = {i for i, j in enumerate(columns) if str(unknowns[j].payload) in released.unknowns}
        if released.shared & {*columns} or not wanted <= {*independent}:  # determined where the constraints hold
            parts = least_energy(equations, block, [unknowns[j] for j in columns], [demands[i] for i in some])
            solved |= dict(zip((unknowns[j] for j in columns), parts, strict=True))
            continue
        matrix = [[row[i] for i in independent] for row in block]
        across = transpose(matrix)
        factors = factorize(graph, matmul(graph, across, matrix))
        solution = factors.solve(matvec(graph, across, [demands[i] for i in some]))
        solved |= {unknowns[columns[i]]: value for i, value in zip(independent, solution, strict=True)}
    return {graph.input(name): solved[graph.input(name)] for name in released.unknowns}


def least_energy(
    equations: EquationsOfMotion, rows: Matrix, unknowns: Sequence[Node], demands: Sequence[Node]
) -> list[Node]:
    """Return the reactions x with A x = b of the least elastic energy, 1/2 sum c_i x_i^2.

    They are those of supports on rigid bodies that move: x = W A^T y, with W = diag(1 / c) and A W A^T y = b. Unknowns
    without a compliance are determined, so that any weight serves for them. Rows that come to depend on each other have
    a small part of the diagonal beside it; what that leaves is improved, and is 1e-14 or less of the reactions.
    """
    graph = equations.graph
    names = [str(node.payload) for node in unknowns]
    given = [equations.compliances[name] for name in names if name in equations.compliances]
    mean = graph.sum(given) / graph.node(float(len(given))) if given else graph.one
    weighted = [
        [entry / equations.compliances.get(name, mean) for entry, name in zip(row, names, strict=True)] for row in rows
    ]
    normal, across = matmul(graph, weighted, transpose(rows)), transpose(weighted)
    small = graph.node(_SHIFT**2) * graph.sum(normal[i][i] for i in range(len(normal)))
    for i in range(len(normal)):
        normal[i][i] = normal[i][i] * graph.node(1.0 + _SHIFT) + small
    factors = factorize(graph, normal)
    solution = matvec(graph, across, factors.solve(demands))
    for _ in range(_IMPROVEMENTS):
        rest = [b - a for a, b in zip(matvec(graph, rows, solution), demands, strict=True)]
        more = matvec(graph, across, factors.solve(rest))
        solution = [a + b for a, b in zip(solution, more, strict=True)]
    return solution


def with_shared(released: Released, tied: Sequence[str]) -> Released:
    """Return what was released, with the reactions that share loads in the equations of the coordinates."""
    if not tied:
        return released
    text = f"{list_names(tied)} share loads by their compliances (least elastic energy), beside rigid other connections"
    text = f"{released.text}; {text}" if released.text else text
    return replace(released, unknowns=(*released.unknowns, *tied), text=text)


def compliances_serve(equations: EquationsOfMotion, tied: Sequence[str], shared: Collection[str]) -> bool:
    """Whether some needed reactions have compliances, as all then must that share loads where the constraints hold.

    Raises
    ------
    ConstraintError
        With those that have none.
    """
    if not {*tied} & {*equations.compliances}:
        return False
    bare = [name for name in equations.symbols.unknowns if name in shared and name not in equations.compliances]
    if bare:
        raise ConstraintError(
            f"scene {equations.name!r}: the reactions {list_names(tied)} share loads where the constraints hold, with"
            f" {list_names(bare)}, which have no compliance: give them one by scene.add_compliances, or none to all"
        )
    return True


def _blocks(rows: Matrix) -> list[tuple[list[int], list[int]]]:
    """Return the numbers of rows and columns that depend on each other, block by block."""
    blocks: list[tuple[list[int], set[int]]] = []
    for i, row in enumerate(rows):
        columns = {j for j, entry in enumerate(row) if not entry.is_zero}
        own = [i]
        for other in [block for block in blocks if block[1] & columns]:
            blocks.remove(other)
            own, columns = other[0] + own, columns | other[1]
        blocks.append((own, columns))
    return [(sorted(own), sorted(columns)) for own, columns in blocks if columns]


def _along_coordinate(equations: EquationsOfMotion, number: int, seconds: Sequence[Node]) -> Node:
    """Return the equation of a coordinate: inertia less loads and reactions."""
    graph = equations.graph
    inertia = graph.sum(m * a for m, a in zip(equations.mass_matrix[number], seconds, strict=True))
    reactions = graph.sum(c * x for c, x in zip(equations.reactions[number], equations.unknowns, strict=True))
    return inertia - equations.forcing[number] - reactions
