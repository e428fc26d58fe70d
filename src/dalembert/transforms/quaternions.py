"""Quaternions on the graph, scalar first, from components on a body to components on its reference frame.

With e.e = 1 the rates are e_dot = 1/2 E omega, and omega = 2 E^T e_dot, which are regular everywhere
(R. Featherstone, Rigid Body Dynamics Algorithms, section 4.5).
"""

from __future__ import annotations

from collections.abc import Sequence

from ..ir.graph import Node

__all__ = ["rotation_entries", "spin_matrix"]


def rotation_entries(e: Sequence[Node]) -> list[list[Node]]:
    """Return the matrix (3, 3) from components on the body to those on its reference frame."""
    e0, e1, e2, e3 = e
    return [
        [e0 * e0 + e1 * e1 - e2 * e2 - e3 * e3, 2 * (e1 * e2 - e0 * e3), 2 * (e0 * e2 + e1 * e3)],
        [2 * (e0 * e3 + e1 * e2), e0 * e0 - e1 * e1 + e2 * e2 - e3 * e3, 2 * (e2 * e3 - e0 * e1)],
        [2 * (e1 * e3 - e0 * e2), 2 * (e0 * e1 + e2 * e3), e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3],
    ]


def spin_matrix(e: Sequence[Node], *, body: bool) -> list[list[Node]]:
    """Return E (4, 3), for components of the angular velocity on the body or on its reference frame."""
    e0, e1, e2, e3 = e
    if body:
        return [[-e1, -e2, -e3], [e0, -e3, e2], [e3, e0, -e1], [-e2, e1, e0]]
    return [[-e1, -e2, -e3], [e0, e3, -e2], [-e3, e0, e1], [e2, -e1, e0]]
