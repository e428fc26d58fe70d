"""Rooted trees and the Runge-Kutta order conditions they stand for.

Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., section II.2
(theorem 2.13: order p holds when ``sum_j b_j Phi_j(tree) = 1/gamma(tree)`` for every tree of at most p
nodes).
"""

from functools import cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

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
