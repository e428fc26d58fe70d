"""Guards of contacts that share a load while the equations leave some reactions undetermined.

Contacts that can only slip together hold each other while they stick. Their reactions r are determined up to
r + z_1 s_1 + ... + z_k s_k, and each law says that a linear function a + b s of the shares s is not negative. There are
lawful shares as long as no sum of k + 1 laws with weights >= 0, in which the shares cancel, falls below zero
(J. Farkas, Journal fuer die reine und angewandte Mathematik 124 (1902) 1-27).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import final

from ...errors import ConstraintError
from ...frozen import frozen
from ...ir.graph import Graph
from ...ir.node import Node, sharing
from ...mechanics.equations import EquationsOfMotion
from ...reduction.reaction_columns import independent_columns
from ...reduction.reaction_solutions import reaction_solver
from ...transforms.linear import DEPENDENT, Matrix

Direction = Mapping[int, Node]
"""Reactions by number, and how they change along a direction that the motion does not depend on."""

_CANCELLED = 1e-9
"""Share of the weights up to which one of the wrong sign counts as zero, and all of them as none."""

_MOST_SUMS = 128
"""Largest number of sums that are guards of one mode."""


@final
@frozen
class SharedLaw:
    """A value that must not be negative, and its slopes along the undetermined directions (k,)."""

    value: Node
    slopes: tuple[Node, ...]


def undetermined_directions(
    frictionless: EquationsOfMotion, kept: Sequence[int], shared: Sequence[int]
) -> tuple[Direction, ...]:
    """Return one direction for each shared reaction: how others change where it grows by one.

    Parameters
    ----------
    frictionless : EquationsOfMotion
        Of the mode.
    kept : sequence of int
        The reactions that it has, by their numbers in the scene.
    shared : sequence of int
        Those of them that repeat what others can do.
    """
    if not shared:
        return ()
    graph = frictionless.graph
    others = [place for place, number in enumerate(kept) if number not in shared]
    independent, _ = independent_columns([[row[place] for place in others] for row in frictionless.reactions])
    base = [others[i] for i in independent]
    reactions = [[row[place] for place in base] for row in frictionless.reactions]
    solve = reaction_solver(frictionless, reactions)
    directions: list[Direction] = []
    for number in shared:
        own = [row[list(kept).index(number)] for row in frictionless.reactions]
        weights = solve(own)
        changes = {kept[place]: -weight for place, weight in zip(base, weights, strict=True) if not weight.is_zero}
        directions.append({**changes, number: graph.one})
    return tuple(directions)


def lawful_sums(graph: Graph, name: str, laws: Sequence[SharedLaw]) -> list[Node]:
    """Return sums that are not negative as long as some share of the load satisfies all laws.

    Raises
    ------
    ConstraintError
        For too many sums; `name` is that of the scene.
    """
    found: dict[tuple[Node, ...], Node] = {}
    for part in _parts(laws):
        for some in combinations(part, len(_active(part)) + 1):
            terms = _cancelling(graph, some)
            node = _sum(graph, terms)
            if node is not None:
                found.setdefault(tuple(law.value for law, _ in terms), node)
    if len(found) > _MOST_SUMS:
        raise ConstraintError(
            f"scene {name!r}: {len(laws)} laws of contacts that hold each other while they stick leave"
            f" {len(found)} ways to share a load, more than the {_MOST_SUMS} that can be watched: give some of the"
            " contacts a regularization"
        )
    return list(found.values())


def _parts(laws: Sequence[SharedLaw]) -> list[list[SharedLaw]]:
    """Return laws in groups that have no direction in common."""
    directions = [sum(1 << a for a, slope in enumerate(law.slopes) if not slope.is_zero) for law in laws]
    return [[laws[i] for i in members] for members in sharing(directions)]


def _sum(graph: Graph, terms: Sequence[tuple[SharedLaw, Node]]) -> Node | None:
    """Return the sum of laws with weights of one sign, made positive; 1 where their signs differ, None if always."""
    known = [weight.number for _, weight in terms]
    numbers = [number for number in known if number is not None]
    if len(numbers) == len(terms):
        if not numbers or min(numbers) < 0 < max(numbers):
            return None
        return graph.sum(graph.const(abs(n)) * law.value for n, (law, _) in zip(numbers, terms, strict=True))
    sizes = [graph.call("abs", weight) for _, weight in terms]
    size, together = graph.sum(sizes), graph.call("abs", graph.sum(weight for _, weight in terms))
    noise = graph.node(_CANCELLED)
    value = graph.sum(s * law.value for s, (law, _) in zip(sizes, terms, strict=True))
    watched = graph.call("select", graph.call("less", noise * size, size - together), graph.one, value)
    return graph.call("select", graph.call("less", size, noise), graph.one, watched)


def _active(laws: Sequence[SharedLaw]) -> list[int]:
    """Return the directions along which any of these laws changes."""
    return [a for a in range(len(laws[0].slopes)) if any(not law.slopes[a].is_zero for law in laws)]


def _cancelling(graph: Graph, laws: Sequence[SharedLaw]) -> list[tuple[SharedLaw, Node]]:
    """Return those of k + 1 laws that cancel along the k directions, with their weights: signed minors.

    Where fewer laws cancel along their own directions, the minors of all have a common factor, which may vanish at the
    values of a run; where all change along fewer than k directions, none are returned.
    """
    while len(active := _active(laws)) + 1 == len(laws):
        rows = [[law.slopes[a] for a in active] for law in laws]
        weights = [(1 if j % 2 == 0 else -1) * _determinant(graph, rows[:j] + rows[j + 1 :]) for j in range(len(rows))]
        terms = [(law, weight) for law, weight in zip(laws, weights, strict=True) if not weight.is_zero]
        fewer = [law for law, _ in terms]
        if not fewer or len(fewer) == len(laws) or len(_active(fewer)) + 1 != len(fewer):
            return terms
        laws = fewer
    return []


def _determinant(graph: Graph, rows: Matrix) -> Node:
    """Return a small determinant, by its first row."""
    if not rows:
        return graph.one
    minors = ([row[:j] + row[j + 1 :] for row in rows[1:]] for j in range(len(rows)))
    terms = (
        (entry if j % 2 == 0 else -entry) * _determinant(graph, minor)
        for j, (entry, minor) in enumerate(zip(rows[0], minors, strict=True))
        if not entry.is_zero
    )
    return graph.sum(terms)


def support_distance(
    graph: Graph, entries: Sequence[Node], weights: Sequence[Node], whole: Node, moves: Sequence[Node]
) -> Node:
    """Return the distance of the support of an open contact, positive while it bears nothing, if others hold it.

    The supports of contacts that bear move by their reactions times their compliances, and the body with them: an open
    contact by the same share of each as its gap is of their gaps. One that others do not hold has 1.

    Parameters
    ----------
    entries, weights : sequence of Node, length n
        The products of the open contact's row with the rows that hold, in the metric of the inverse masses, and the
        shares of these rows in its own.
    whole : Node
        Its product with itself.
    moves : sequence of Node, length n
        Compliance times reaction along each row.
    """
    left = whole - graph.sum(weight * entry for weight, entry in zip(weights, entries, strict=True))
    away = graph.sum(-(weight * move) for weight, move in zip(weights, moves, strict=True))
    return graph.call("select", graph.call("less", graph.node(DEPENDENT) * whole, left), graph.one, away)
