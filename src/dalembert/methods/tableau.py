"""Tableau of a Runge-Kutta pair with dense output, checked on construction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..frozen import frozen

# Rooted trees and the Runge-Kutta order conditions they stand for.
#
# Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., section II.2
# (theorem 2.13: order p holds when ``sum_j b_j Phi_j(tree) = 1/gamma(tree)`` for every tree of at most p nodes).

Tree: TypeAlias = "tuple[Tree, ...]"


@cache
def trees_of_order(order: int) -> tuple[Tree, ...]:
    """All rooted trees with ``order`` nodes; a tree is the sorted tuple of its subtrees."""
    if order == 1:
        return ((),)
    grown = {larger for tree in trees_of_order(order - 1) for larger in _with_one_more_leaf(tree)}
    return tuple(sorted(grown))


def _with_one_more_leaf(tree: Tree) -> list[Tree]:
    grown: list[Tree] = [tuple(sorted((*tree, ())))]
    for i, child in enumerate(tree):
        grown += [tuple(sorted((*tree[:i], larger, *tree[i + 1 :]))) for larger in _with_one_more_leaf(child)]
    return grown


def node_count(tree: Tree) -> int:
    """Order of a tree."""
    return 1 + sum(node_count(child) for child in tree)


def density(tree: Tree) -> int:
    """Return the density gamma of a tree."""
    product = node_count(tree)
    for child in tree:
        product *= density(child)
    return product


def elementary_weights(tree: Tree, A: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the vector Phi(tree) (n_stages,) of a Runge-Kutta matrix ``A`` (n_stages, n_stages)."""
    weights = np.ones(len(A))
    for child in tree:
        weights = weights * (A @ elementary_weights(child, A))
    return weights


_TREE_ORDER = 5
_TOLERANCE = 3e-14


@final
@frozen(eq=False, kw_only=True)
class Tableau:
    """A Runge-Kutta pair, explicit or diagonally implicit with an explicit first stage.

    The stages are, in this order: those that the step is made of, one at the end of the step (``A[end] ==
    b``, ``c[end] == 1``, the first stage of the next step), and those that only the dense output needs.

    Attributes
    ----------
    name
        Name of the method, as users write it.
    order, error_order, dense_order
        Order of the step, of the error estimate (the estimate is O(h**(error_order + 1))) and of the dense
        output.
    c, A
        Nodes (n_total,) and matrix (n_total, n_total), strictly lower triangular unless the pair is `implicit`.
    end
        Number of the stage at the end of the step.
    error
        Rows of error weights (1 or 2, n_total). The estimate is ``|h| E0`` with one row and
        ``|h| E0**2 / sqrt(E0**2 + 0.01*E1**2)`` with two, E0 and E1 being their RMS norms.
    error_orders
        Order of the embedded method behind each row.
    P
        Dense output (n_total, degree): ``y(theta) = y + h*sum_j theta**j (K^T P)_j`` for j = 1 .. degree.
    source
        Where the coefficients are published.
    bounded
        Whether a step is rejected, too, where its dense output is off by more than
        `dalembert.methods.step_constants.POLYNOMIAL_ERROR` tolerances (see `between`).
    implicit
        Whether stages but the first are implicit.

    Raises
    ------
    ValueError
        If the coefficients do not satisfy their conditions; the message lists every fault.
    """

    name: str
    order: int
    error_order: int
    dense_order: int
    c: FloatArray
    A: FloatArray
    end: int
    error: FloatArray
    error_orders: tuple[int, ...]
    P: FloatArray
    source: str
    bounded: bool = False
    implicit: bool = False

    def __post_init__(self) -> None:
        faults = list(_faults(self))
        if faults:
            raise ValueError(f"tableau {self.name!r} is wrong: " + "; ".join(faults))
        for array in (self.c, self.A, self.error, self.P):
            array.flags.writeable = False

    @property
    def b(self) -> FloatArray:
        """Weights of the step (n_total,)."""
        weights: FloatArray = self.A[self.end]
        return weights

    @property
    def n_total(self) -> int:
        """Number of stages, those of the dense output included."""
        return len(self.c)

    @property
    def degree(self) -> int:
        """Degree of the dense output in theta."""
        return int(self.P.shape[1])

    @property
    def between(self) -> FloatArray:
        """Weights (n_total,) of an estimate of the error of the dense output.

        It is the difference from the point of the last stage, which must be one that only the dense output needs, at
        the node of that.
        """
        powers = self.c[-1] ** np.arange(1, self.degree + 1)
        weights: FloatArray = self.P @ powers - self.A[-1]
        return weights

    @property
    def fsal(self) -> bool:
        """Whether the error estimate needs the stage at the end of the step (else only accepted steps do)."""
        return bool(np.any(self.error[:, self.end]))


def matrix_from_rows(n: int, rows: Mapping[int, Mapping[int, float]]) -> FloatArray:
    """Square matrix (n, n) from its non-zero entries ``rows[i][j]``."""
    matrix = np.zeros((n, n))
    for i, row in rows.items():
        for j, value in row.items():
            matrix[i, j] = value
    return matrix


def _faults(tableau: Tableau) -> Iterator[str]:
    n = len(tableau.c)
    if tableau.A.shape != (n, n) or tableau.error.shape[1:] != (n,) or len(tableau.P) != n:
        yield f"A, error and P must have {n} stages like c"
        return
    if len(tableau.error_orders) != len(tableau.error) or len(tableau.error) not in (1, 2):
        yield "there must be one or two rows of error weights, each with its order"
    if tableau.degree < 3:
        yield "the dense output must have at least degree 3"
    if tableau.bounded and n == tableau.end + 1:
        yield "no stage estimates the error of the dense output"
    if np.any(np.triu(tableau.A, int(tableau.implicit))) or tableau.A[0, 0]:
        shape = "lower triangular, and its first row 0" if tableau.implicit else "strictly lower triangular"
        yield f"A must be {shape}"
    if _differ(tableau.A.sum(axis=1), tableau.c, tableau.A):
        yield "row sums of A must be c"
    if tableau.c[tableau.end] != 1.0:
        yield "c[end] must be 1"
    if _differ(tableau.P.sum(axis=1), tableau.b, tableau.P):
        yield "P at theta = 1 must be b"
    for row in tableau.error:
        if _differ(row.sum(), 0.0, row):
            yield "error weights must sum to 0"
    for k in range(1, tableau.order + 1):
        if _differ(tableau.b @ tableau.c ** (k - 1), 1.0 / k, tableau.b):
            yield f"b must integrate c**{k - 1} exactly"
    yield from _tree_faults(tableau)


def _tree_faults(tableau: Tableau) -> Iterator[str]:
    powers = np.arange(1, tableau.degree + 1)
    for order in range(1, min(_TREE_ORDER, tableau.order) + 1):
        for tree in trees_of_order(order):
            weights = elementary_weights(tree, tableau.A)
            target = 1.0 / density(tree)
            if _differ(tableau.b @ weights, target, tableau.A):
                yield f"order condition of the tree {tree} fails for b"
            if order <= tableau.dense_order and _differ(weights @ tableau.P, target * (powers == order), tableau.P):
                yield f"order condition of the tree {tree} fails for P"
            for row, row_order in zip(tableau.error, tableau.error_orders, strict=True):
                if order <= row_order and _differ(row @ weights, 0.0, tableau.A):
                    yield f"order condition of the tree {tree} fails for the error weights"


def _differ(left: object, right: object, scale: FloatArray) -> bool:
    """Whether two sides of a condition differ by more than rounding in coefficients such as ``scale``."""
    bound = _TOLERANCE * max(1.0, float(np.abs(scale).max()))
    return not np.allclose(np.asarray(left), np.asarray(right), rtol=0.0, atol=bound)
