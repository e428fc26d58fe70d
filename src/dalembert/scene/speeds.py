"""Generalized speeds: kinematic equations solved for them, and for the rates, on the graph."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from sympy.physics.vector import dynamicsymbols

from ..errors import list_names
from ..ir.graph import Node
from ..naming import rate_name
from ..transforms.derivatives import tangents
from ..transforms.linear import Matrix, SingularMatrix, factorize, matmul, matvec, transpose
from .expressions import ExpressionReader
from .model import SpeedGroup
from .symbol_table import Entry

__all__ = ["read_speeds"]


def read_speeds(
    reader: ExpressionReader,
    coordinates: Sequence[Any],
    speeds: Sequence[Any],
    equations: Sequence[Any],
    fault: Callable[[str], Any],
) -> tuple[tuple[SpeedGroup, ...], tuple[Entry, ...], dict[str, str]]:
    """Define the generalized speeds by the kinematic equations.

    Parameters
    ----------
    reader : ExpressionReader
        Gets a definition of each speed in coordinates, rates and time.
    coordinates, speeds : sequence of dynamicsymbols
    equations : sequence of Expr
        Expressions that vanish, affine in rates and speeds.
    fault : callable
        Records a fault.

    Returns
    -------
    groups, entries, aliases
        Speeds with the coordinates that they belong to; how to start from them; and, for those that are just a rate,
        name of the speed -> name of the rate.
    """
    time = dynamicsymbols._t
    names = [str(u.func.__name__) for u in speeds]
    reader.define(dict(zip(speeds, map(reader.graph.input, names), strict=True)))
    rows = [reader.read(equation, f"kinematic equation {equation} = 0") for equation in equations]
    rates = [reader.leaves[q.diff(time)] for q in coordinates]
    inputs = [reader.leaves[u] for u in speeds]
    groups: list[SpeedGroup] = []
    entries: list[Entry] = []
    aliases: dict[str, str] = {}
    for members in _blocks(reader, rows, [*names, *(rate_name(q.func.__name__) for q in coordinates)]):
        held = [i for i, u in enumerate(inputs) if any(rows[r].deps & u.deps for r in members)]
        moved = [i for i, rate in enumerate(rates) if any(rows[r].deps & rate.deps for r in members)]
        mine = list_names(names[i] for i in held) or "no speed"
        if not len(members) == len(held) == len(moved):
            fault(
                f"{len(members)} kinematic equations tie {len(held)} speeds ({mine}) to the rates of {len(moved)}"
                f" coordinates ({list_names(str(coordinates[i].func.__name__) for i in moved)}); there must be as many"
                " of each. For a body in quaternions, use dalembert.free_orientation"
            )
            continue
        try:
            u_of_rates, rates_of_u = _both_ways(reader, [rows[r] for r in members], (inputs, held), (rates, moved))
        except ArithmeticError as reason:
            fault(f"the kinematic equations of {mine} {reason}")
            continue
        named = tuple(names[i] for i in held)
        targets = tuple(rate_name(coordinates[i].func.__name__) for i in moved)
        reader.define({speeds[i]: node for i, node in zip(held, u_of_rates, strict=True)})
        if len(named) == 1 and u_of_rates[0] is rates[moved[0]]:
            aliases[named[0]] = targets[0]
            continue
        slopes = [tangents(reader.graph, u_of_rates, {rates[i]: reader.graph.one}) for i in moved]
        groups.append(SpeedGroup(named, tuple(moved), tuple(zip(*slopes, strict=True))))
        needs = tuple(
            str(q.func.__name__) for q in coordinates if any(reader.leaves[q].deps & x.deps for x in rates_of_u)
        )
        entries.append(Entry(named, needs, targets, tuple(rates_of_u)))
    return tuple(groups), tuple(entries), aliases


def _both_ways(
    reader: ExpressionReader,
    block: Sequence[Node],
    speeds: tuple[Sequence[Node], Sequence[int]],
    rates: tuple[Sequence[Node], Sequence[int]],
) -> tuple[list[Node], list[Node]]:
    """Return speeds from rates, and rates from speeds; of each, all are given with the numbers of those to solve for.

    Raises
    ------
    ArithmeticError
        For equations that do not give them, with the reason.
    """
    (inputs, held), (moving, moved) = speeds, rates
    try:
        return (
            _solved(reader, block, [inputs[i] for i in held], moving),
            _solved(reader, block, [moving[i] for i in moved], inputs),
        )
    except SingularMatrix:
        raise ArithmeticError("do not give speeds from rates, or rates from speeds") from None
    except ArithmeticError:
        raise ArithmeticError("are not affine in speeds and rates") from None


def _blocks(reader: ExpressionReader, rows: Sequence[Node], names: Sequence[str]) -> list[list[int]]:
    """Return the numbers of the equations, those together that have speeds or rates in common."""
    blocks: list[tuple[int, list[int]]] = []
    every = reader.graph.mask(names)
    for number, row in enumerate(rows):
        mask, members = row.deps & every, [number]
        apart = []
        for other, others in blocks:
            if other & mask:
                mask, members = mask | other, others + members
            else:
                apart.append((other, others))
        blocks = [*apart, (mask, members)]
    return sorted(sorted(members) for _, members in blocks)


def _solved(
    reader: ExpressionReader, rows: Sequence[Node], wanted: Sequence[Node], others: Sequence[Node]
) -> list[Node]:
    """Return the inputs `wanted` at which the rows vanish; ``ArithmeticError`` where they are not affine."""
    graph = reader.graph
    both = list(dict.fromkeys([*wanted, *others]))
    columns = [tangents(graph, rows, {u: graph.one}) for u in wanted]
    freed = [[graph.freed_of(x, both) for x in column] for column in columns]
    matrix: Matrix = []
    for row in zip(*freed, strict=True):
        if any(x is None for x in row):
            raise ArithmeticError
        matrix.append([x for x in row if x is not None])
    rest = graph.substitute(rows, dict.fromkeys(wanted, graph.zero))
    across = transpose(matrix)  # the pivots of A^T A vanish nowhere where A is regular; those of A may
    return factorize(graph, matmul(graph, across, matrix)).solve(matvec(graph, across, [-x for x in rest]))
