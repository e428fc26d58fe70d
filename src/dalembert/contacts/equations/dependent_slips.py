"""Slip velocities that depend on each other, found from numbers at random states: coupled contacts, points of one link.

Where all contacts are closed, the slip velocity of one may follow from the gaps and the slip velocity of another: the
corners of a box on a plane. Such contacts can only slip together, and share a friction force while they stick.

Where the points of two contacts in one plane belong to one rigid link and both are closed, the slip velocities of the
two points differ by what a turn of the link about the normal makes of the line between them: they are equal along it,
dJ = D a^T. Where both stick, one row across the line holds the second point besides the two of the first, the friction
forces along the line are determined up to what one point takes of them, and their sum, the normal reactions and the
motion are not changed by that. The line stays where it is meanwhile.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import FloatArray
from ...ir.interpret import interpret_rows
from ...ir.kernel import Kernel
from ...mechanics.equations import EquationsOfMotion
from ...subset.compiled_subset import compiled_subset, sqrt
from ..contact_system import STICK, Combination, ContactSystem
from .contact_laws import NUMBERS, contact_data

DEPENDENT = 1e-9
"""Share of a row that others leave of it, up to which it depends on them; and weight up to which one counts as zero."""

Dependence = dict[int, FloatArray]
"""By the number of a row that depends on rows before it in an order: the weights (n_rows,) with which these add up."""

_SLIP_SEED = 5


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
    rng = np.random.default_rng(_SLIP_SEED)
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


_SEED, _STATES, _ROUNDS = 7, 3, 40
"""Random states at which pairs are looked for, and Newton steps that close their gaps."""

_CLOSED, _EQUAL = 1e-12, 1e-8
"""Gaps up to which contacts are closed; and share of the difference of slip velocities up to which a part is zero."""

_STEP, _TURNED = 1e-5, 1e-3
"""Length of a motion with both points at rest, and share of it up to which the line has not turned."""

_ONE_LINE = 1e-12
"""Determinant of the products of differences, as a share of their squares, up to which slips are equal along a line."""


def pairs_of_one_link(equations: EquationsOfMotion, sticking: Sequence[int]) -> dict[int, int]:
    """Return the second contact of each pair, with the first; no contact is in two pairs.

    Contacts with several laws of friction are in none.
    """
    contacts, found = equations.contacts, dict[int, int]()
    leaders = {contact.leader for contact in contacts}
    able = [i for i in sticking if len(contacts[i].slips) == 2 and contacts[i].constraint is not None]
    able = [i for i in able if i not in leaders]
    if len(able) < 2:
        return found
    data = contact_data(equations)
    for d in able:
        alone = [b for b in able if b < d and not {b, d} & {*found, *found.values()}]
        mate = next((b for b in alone if _Probe(equations, data, (b, d)).holds()), None)
        if mate is not None:
            found[d] = mate
    return found


class _Probe:
    """The slip velocities of two contacts at random states at which both are closed."""

    def __init__(self, equations: EquationsOfMotion, data: Kernel, pair: tuple[int, int]) -> None:
        self.equations, self.data, self.pair = equations, data, pair
        self.rows = [slip_rows(equations)[i] for i in self.pair]
        self.gaps = [constraint for i in self.pair if (constraint := equations.contacts[i].constraint) is not None]
        self.units = [list(group.coordinates) for group in equations.groups if group.norm]
        self.rng = np.random.default_rng(_SEED)
        self.t = self.rng.uniform(size=1)
        self.c = self.rng.uniform(0.5, 1.5, size=(1, len(equations.symbols.parameters)))

    def holds(self) -> bool:
        """Return whether the slip velocities are equal along a line that does not turn while both are zero."""
        n = len(self.equations.q)
        for _ in range(_STATES):
            y = self._closed(self.rng.normal(size=(1, len(self.equations.symbols.variables))))
            across = None if y is None else self._across(y)
            if y is None or across is None:
                return False
            rest = self._at_rest(y)
            moved = y.copy()
            moved[0, :n] += _STEP * rest
            after = self._closed(moved)
            turned = None if after is None else self._across(after)
            if turned is None or abs(across[0] * turned[1] - across[1] * turned[0]) > _TURNED * _STEP:
                return False
        return True

    def _numbers(self, y: FloatArray) -> FloatArray:
        with np.errstate(all="ignore"):
            return np.asarray(interpret_rows(self.data, self.t, y, self.c))

    def _held(self, y: FloatArray, rows: FloatArray) -> FloatArray:
        """Return the rows of both gaps and of the lengths of quaternions."""
        lengths = np.zeros((len(self.units), rows.shape[1]))
        for row, places in zip(lengths, self.units, strict=True):
            row[places] = y[0, places]
        return np.vstack([rows[self.gaps], lengths])

    def _closed(self, y: FloatArray) -> FloatArray | None:
        """Return a state with both gaps closed and quaternions of length one, None where it is not found."""
        y, n, k = y.copy(), len(self.equations.q), len(self.equations.contacts)
        senses = [self.equations.contacts[i].sense for i in self.pair]
        for _ in range(_ROUNDS):
            for places in self.units:
                y[0, places] /= np.linalg.norm(y[0, places])
            values = self._numbers(y)
            gaps = np.array(senses) * values[0, values.shape[1] - len(NUMBERS) * k :][list(self.pair)]
            held = self._held(y, jacobians(self.equations, values)[0])
            if not np.isfinite([*gaps, *held.ravel()]).all():
                return None
            if np.max(np.abs(gaps)) <= _CLOSED:
                return y
            y[0, :n] -= np.linalg.lstsq(held, np.append(gaps, np.zeros(len(self.units))), rcond=None)[0]
        return None

    def _across(self, y: FloatArray) -> FloatArray | None:
        """Return the direction (2,) across the line.

        None where slip velocities, and what friction forces do, are not equal along one line alone.
        """
        values, n = self._numbers(y), len(self.equations.q)
        rows, count = jacobians(self.equations, values)[0], len(self.equations.constraints)
        count += sum(len(contact.slips) for contact in self.equations.contacts)
        left = values[0, n * n + n + count * (n + 1) :]
        speeds, powers = left[:count], left[count:][: n * len(self.equations.symbols.unknowns)].reshape(-1, n)
        forces = [list(self.equations.contacts[i].tangential) for i in self.pair]
        both = zip(self.rows, forces, strict=True)
        first, second = (np.column_stack([rows[own], speeds[own], powers[pushed]]) for own, pushed in both)
        difference = second - first
        if not np.isfinite(difference).all():
            return None
        axes, sizes, _ = np.linalg.svd(difference)
        least = _EQUAL * max(np.linalg.norm(first), np.linalg.norm(second))
        return axes[:, 0] if sizes[0] > least and sizes[1] <= _EQUAL * sizes[0] else None

    def _at_rest(self, y: FloatArray) -> FloatArray:
        """Return a random change of the coordinates (n_q,) of length one that moves neither point; zero without any."""
        rows = jacobians(self.equations, self._numbers(y))[0]
        held = np.vstack([self._held(y, rows), *(rows[own] for own in self.rows)])
        _, sizes, right = np.linalg.svd(held)
        free = right[int(np.sum(sizes > _EQUAL * sizes[0])) :]
        change = self.rng.normal(size=len(free)) @ free
        size = np.linalg.norm(change)
        return np.asarray(change / size if size > 0.0 else change)


@compiled_subset
def point_across(system: ContactSystem, chosen: Combination) -> None:
    """Write the directions across the lines of pairs that stick, in place of directions of slip of the second points.

    There, the products of the differences of slip velocities have the matrix (n n^T) |a|^2.
    """
    for d in range(system.contacts):
        for b in range(d):
            stick = chosen.mode[b] == STICK and chosen.mode[d] == STICK
            if not stick or system.width[b] < 2 or system.width[d] < 2:
                continue
            xx = xy = yy = 0.0
            for j in range(system.coordinates):
                x = system.jacobian[system.row[d], j] - system.jacobian[system.row[b], j]
                y = system.jacobian[system.row[d] + 1, j] - system.jacobian[system.row[b] + 1, j]
                xx, xy, yy = xx + x * x, xy + x * y, yy + y * y
            if xx + yy > 0.0 and xx * yy - xy * xy <= _ONE_LINE * (xx + yy) * (xx + yy):
                x, y = (xx, xy) if xx > yy else (xy, yy)
                size = sqrt(x * x + y * y)
                chosen.along[d, 0], chosen.along[d, 1] = x / size, y / size
