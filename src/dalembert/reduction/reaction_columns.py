"""Columns of power coefficients of reactions, and reactions from balances of bodies."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..errors import ConstraintError, list_names
from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.random_points import values_of
from ..ir.zero_tests import terms_of, vanishes
from ..mechanics.balance_choice import Released
from ..mechanics.equations import EquationsOfMotion
from ..mechanics.manifold import places_on_manifold
from ..naming import acceleration_input
from ..transforms.derivatives import tangents
from ..transforms.linear import SET_ASIDE, Matrix, dependence, factorize, matmul, matvec, transpose
from .reaction_solutions import least_energy

_BRANCHING = frozenset(
    {"sqrt", "pow", "asin", "acos", "atan", "atan2", "abs", "sign", "floor", "min", "max"}
    | {"less", "less_equal", "select"}
)
"""Operations that are not one analytic function: what has none of them vanishes everywhere or almost nowhere."""

_CANCELLED = 1e-9
"""Share of its terms below which a power coefficient has cancelled at a position on the constraints."""

_PRESENT = 1e-3
"""Share of its terms from which on a power coefficient that should vanish does not, for drift from constraints."""

_WEIGHT = 1e-6
"""Weight of a unit column from which on it takes part in a dependence."""


def independent_columns(matrix: Matrix) -> tuple[list[int], set[int]]:
    """Return columns that are independent for almost every state, and those whose weight is not determined.

    A graph of its own decides it: it keeps the form in which a value was computed first, and weights computed here add
    lengths to angles, so that they lose their digits in small and large units.
    """
    graph = Graph()
    columns = [graph.adopt(column) for column in transpose(matrix)] if matrix and matrix[0] else []
    independent: list[int] = []
    free: set[int] = set()
    for number, column in enumerate(columns):
        if all(vanishes(entry) for entry in column):
            free.add(number)
            continue
        weights = dependence(graph, [columns[i] for i in independent], column)
        if weights is None:
            independent.append(number)
        else:
            free |= {number} | {i for i, weight in zip(independent, weights, strict=True) if not vanishes(weight)}
    return independent, free


def loose_on_constraints(equations: EquationsOfMotion) -> tuple[set[str], set[str]]:
    """Return the unknowns without power, and those whose power others have too, at some position on the constraints.

    Independent columns may vanish or depend on each other there: by the constraints, or on one branch of a root, such
    as r cos(a) - r sqrt(cos(a)**2) where the cosine is positive. Numbers at random positions decide it, up to the
    rounding of the terms of each coefficient; a graph of its own has these terms.
    """
    names, graph = equations.symbols.unknowns, Graph()
    entries = [entry for row in equations.reactions for entry in row]
    rows = [row for row in equations.constraints if row.position is not None]
    if not names or not (rows or branches(entries)):
        return set(), set()
    entries = graph.adopt(entries)
    q = graph.adopt(equations.q)
    positions = graph.adopt([row.position for row in rows if row.position is not None])
    jacobian = graph.adopt([entry for row in rows for entry in row.jacobian])
    both = [*entries, *(terms_of(graph, entry) for entry in entries)]
    silent, tied = np.zeros(len(names), bool), np.zeros(len(names), bool)
    for nodes, values in places_on_manifold(q, both, positions, jacobian):
        numbers = np.array(values_of(nodes[-len(both) :], values))
        powers, terms = numbers.reshape(2, len(equations.q), len(names))
        powers = np.where(np.abs(powers) > _CANCELLED * terms, powers, 0.0)
        lengths = np.linalg.norm(powers, axis=0)
        silent |= lengths == 0.0
        _, sizes, across = np.linalg.svd(powers / np.where(lengths > 0.0, lengths, 1.0))
        loose = across[int(np.sum(sizes > _CANCELLED)) :]
        tied |= np.abs(loose).max(axis=0, initial=0.0) > _WEIGHT
    tied &= ~silent
    without, shared = ({names[i] for i in np.flatnonzero(found)} for found in (silent, tied))
    return without, shared


def branches(nodes: Sequence[Node]) -> bool:
    """Whether some values have an operation that is not one analytic function."""
    return any(node.op in _BRANCHING for node in Graph.topological(nodes))


def where_determined(graph: Graph, value: Node, column: Sequence[Node], *, hidden: bool) -> Node:
    """Return a reaction where its power coefficients vanish as they should, or do not, and NaN elsewhere.

    Parameters
    ----------
    graph : Graph
    value : Node
        The reaction.
    column : sequence of Node
        Its power coefficients.
    hidden : bool
        Whether it comes from balances of bodies because it has no power; it must have some otherwise.
    """
    present = [entry for entry in column if not entry.is_zero]
    power = graph.sum(entry * entry for entry in present)
    terms = graph.sum(size * size for size in (terms_of(graph, entry) for entry in present))
    bound = graph.node((_PRESENT if hidden else _CANCELLED) ** 2) * terms
    kept = graph.call("less", power, bound) if hidden else graph.call("less", bound, power)
    one_or_huge = graph.call("select", kept, graph.one, graph.node(SET_ASIDE))
    return value * graph.call("sqrt", graph.node(2) - one_or_huge)  # the root is 1 or NaN


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
