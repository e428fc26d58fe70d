"""Comparison and span of covectors at random positions that satisfy holonomic constraints."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence

import numpy as np

from ..arrays import FloatArray
from ..ir.graph import Graph
from ..ir.node import Node
from ..ir.random_points import random_inputs, values_in_order, values_of

_POINTS, _DRAWS, _ITERATIONS = 3, 60, 60
_TOLERANCE = 1e-9
"""Relative size of a difference that counts as zero at positions that satisfy the constraints."""

_CONVERGED = 1e-11
"""Relative size of a step of Newton's method after which its square, which is left, is below rounding."""


def agree_on_manifold(
    q: Sequence[Node],
    first: Sequence[Node],
    second: Sequence[Node],
    positions: Sequence[Node],
    rows: Sequence[Sequence[Node]],
) -> bool:
    """Return whether two covectors have the same power on all velocities that constraints allow.

    Parameters
    ----------
    q : sequence of Node
        The coordinates; all nodes are of one graph.
    first, second : sequence of Node, length n_q
    positions : sequence of Node
        Expressions that vanish, of the first of the constraints.
    rows : sequence of sequence of Node
        Rows of the constraint Jacobian.

    Returns
    -------
    bool
        Also False where no positions are found that satisfy the constraints.
    """
    size, found = len(q), 0
    for matrix, flat in _samples(q, [*first, *second], positions, rows):
        p, s = flat.reshape(2, size)
        rest = p - s
        if len(matrix):
            rest = rest - matrix.T @ np.linalg.lstsq(matrix.T, rest, rcond=1e-10)[0]
        if np.abs(rest).max() > _TOLERANCE * max(np.abs(p).max(), np.abs(s).max()):
            return False
        found += 1
    return found == _POINTS


def outside_span_on_manifold(
    q: Sequence[Node],
    covectors: Sequence[Sequence[Node]],
    positions: Sequence[Node],
    rows: Sequence[Sequence[Node]],
) -> tuple[int, ...] | None:
    """Return the coordinates along which the constraint Jacobian has what is no combination of covectors.

    Parameters
    ----------
    q : sequence of Node
    covectors : sequence of sequence of Node
        Each of length n_q.
    positions, rows : sequences
        As of `agree_on_manifold`.

    Returns
    -------
    tuple of int or None
        At positions that satisfy the constraints; None where none are found.
    """
    found, missing = 0, np.zeros(len(q), dtype=bool)
    for matrix, flat in _samples(q, [node for row in covectors for node in row], positions, rows):
        columns = flat.reshape(len(covectors), len(q)).T
        columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        left, values, _ = np.linalg.svd(columns)
        basis = left[:, : int(np.sum(values > _TOLERANCE))]
        rest = matrix.T - basis @ (basis.T @ matrix.T)
        missing |= np.abs(rest).max(axis=1) > _TOLERANCE * np.abs(matrix).max()
        found += 1
    return tuple(map(int, np.nonzero(missing)[0])) if found == _POINTS else None


def meets_span_on_manifold(
    q: Sequence[Node],
    covectors: Sequence[Sequence[Node]],
    positions: Sequence[Node],
    rows: Sequence[Sequence[Node]],
) -> bool | None:
    """Return whether some combination of covectors is one of the rows of the constraint Jacobian.

    Parameters
    ----------
    q : sequence of Node
    covectors : sequence of sequence of Node
        Each of length n_q.
    positions, rows : sequences
        As of `agree_on_manifold`.

    Returns
    -------
    bool or None
        At a position that satisfies the constraints; None where none are found.
    """
    found = 0
    for matrix, flat in _samples(q, [node for row in covectors for node in row], positions, rows):
        parts = [flat.reshape(len(covectors), len(q)), matrix]
        ranks = [np.linalg.matrix_rank(_unit_rows(part), tol=_TOLERANCE) for part in (*parts, np.vstack(parts))]
        if ranks[2] < ranks[0] + ranks[1]:
            return True
        found += 1
    return False if found == _POINTS else None


def _unit_rows(matrix: FloatArray) -> FloatArray:
    return np.asarray(matrix / np.maximum(np.linalg.norm(matrix, axis=1, keepdims=True), 1e-300))


def _samples(
    q: Sequence[Node], others: Sequence[Node], positions: Sequence[Node], rows: Sequence[Sequence[Node]]
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield the constraint Jacobian and values of other nodes at a few positions that satisfy the constraints."""
    jacobian = [node for row in rows for node in row]
    for nodes, place in places_on_manifold(q, others, positions, jacobian):
        flat = _numbers(nodes, place)[len(positions) :]
        yield flat[: len(jacobian)].reshape(-1, len(q)), flat[len(jacobian) :]


def places_on_manifold(
    q: Sequence[Node], others: Sequence[Node], positions: Sequence[Node], jacobian: Sequence[Node]
) -> Iterator[tuple[Sequence[Node], dict[Node, float]]]:
    """Yield all nodes, and values of their inputs at a few positions that satisfy the constraints.

    `jacobian` are the rows of the constraint Jacobian, one behind the other, first those of `positions`.
    """
    nodes = [*positions, *jacobian, *others]
    found = 0
    for seed in range(_DRAWS):
        draw = random.Random(seed)
        values = random_inputs([*nodes, *q], draw)
        place = _consistent(nodes, q, len(positions), values | {x: draw.uniform(-1.5, 1.5) for x in q})
        if place is None or not np.all(np.isfinite(_numbers(nodes, place))):
            continue
        yield nodes, place
        found += 1
        if found == _POINTS:
            return


def _consistent(
    nodes: Sequence[Node], q: Sequence[Node], count: int, values: dict[Node, float]
) -> dict[Node, float] | None:
    """Return values with coordinates moved onto the first `count` nodes' zeros by Newton's method, or None."""
    size, needed = len(q), nodes[: count + count * len(q)]
    order = [node for node in Graph.topological(needed) if node not in values]
    for _ in range(_ITERATIONS):
        if not count:
            return values
        flat = np.array(values_in_order(needed, order, values))
        if not np.all(np.isfinite(flat)):
            return None
        residual, rows = flat[:count], flat[count:].reshape(count, size)
        step = np.linalg.lstsq(rows, residual, rcond=1e-10)[0]
        largest = float(np.abs(step).max())
        x = np.array([values[node] for node in q]) - step / max(1.0, largest)
        values = values | dict(zip(q, map(float, x), strict=True))
        if largest < _CONVERGED * max(1.0, float(np.abs(x).max())):
            return values if np.abs(residual).max() < 1e-11 else None
    return None


def _numbers(nodes: Sequence[Node], values: dict[Node, float]) -> FloatArray:
    return np.array(values_of(nodes, values))
