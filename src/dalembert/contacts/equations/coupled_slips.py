"""Contacts that can only slip together, found from numbers at random states.

Where all contacts are closed, the slip velocity of one may follow from the gaps and the slip velocity of another: the
corners of a box on a plane. Such contacts share a friction force while they stick.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import FloatArray
from ...ir.interpret import interpret_rows
from ...mechanics.equations import EquationsOfMotion
from .contact_data import contact_data

DEPENDENT = 1e-9
"""Share of a row that others leave of it, up to which it depends on them; and weight up to which one counts as zero."""

Dependence = dict[int, FloatArray]
"""By the number of a row that depends on rows before it in an order: the weights (n_rows,) with which these add up."""

_SEED = 5


def jacobians(equations: EquationsOfMotion, values: FloatArray) -> FloatArray:
    """Return the rows (k, n_rows, n_q) of constraints and slip velocities in numbers of contacts (k, n_values)."""
    n, contacts = len(equations.q), equations.contacts
    count, first = len(equations.constraints) + sum(len(c.slips) for c in contacts), n * n + n
    return values[:, first : first + count * n].reshape(len(values), count, n)


def dependences(rows: FloatArray, order: Sequence[int]) -> Dependence:
    """Return which of some rows (n_rows, n_q) depend on those before them in an order, each of length one."""
    size = np.linalg.norm(rows, axis=1)
    unit = rows / np.where(size > 0.0, size, 1.0)[:, np.newaxis]
    found, base = Dependence(), list[int]()
    for i in order:
        weights = np.zeros(len(rows))
        if base:
            weights[base] = np.linalg.lstsq(unit[base].T, unit[i], rcond=None)[0]
        if np.linalg.norm(unit[i] - weights @ unit) <= DEPENDENT:
            found[i] = weights * size[i] / np.where(size > 0.0, size, 1.0)
        else:
            base.append(i)
    return found


def slip_rows(equations: EquationsOfMotion) -> list[list[int]]:
    """Return the numbers of the rows of the slip velocities of each contact."""
    first, found = len(equations.constraints), list[list[int]]()
    for contact in equations.contacts:
        found.append(list(range(first, first + len(contact.slips))))
        first += len(contact.slips)
    return found


def coupled_slips(equations: EquationsOfMotion) -> dict[tuple[int, int], int]:
    """Return pairs of contacts that can only slip together along a line, with the sign of one slip by the other."""
    rng = np.random.default_rng(_SEED)
    y = rng.normal(size=(1, len(equations.symbols.variables)))
    c = rng.uniform(0.5, 1.5, size=(1, len(equations.symbols.parameters)))
    with np.errstate(all="ignore"):
        values = interpret_rows(contact_data(equations), rng.uniform(size=1), y, c)
    rows = jacobians(equations, values)[0]
    if not np.isfinite(rows).all():
        return {}
    slips = slip_rows(equations)
    single = {own[0]: i for i, own in enumerate(slips) if len(own) == 1}
    normals = list(range(len(equations.constraints)))
    groups: dict[int, dict[int, int]] = {}
    for row, weights in dependences(rows, [*normals, *sorted(single)]).items():
        others = [i for i in np.flatnonzero(np.abs(weights) > DEPENDENT).tolist() if i in single]
        if row in single and len(others) == 1:
            groups.setdefault(single[others[0]], {})[single[row]] = 1 if weights[others[0]] > 0.0 else -1
    found: dict[tuple[int, int], int] = {}
    for first, rest in groups.items():
        members = {first: 1, **rest}
        found |= {(b, d): members[b] * members[d] for b in members for d in members if b < d}
    return found
