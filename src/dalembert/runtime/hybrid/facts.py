"""What a scene with contacts is like at some instants, as numbers, and what moves it in a given mode.

The same laws as in `dalembert.reduction.modes`, by another way: as one linear system of accelerations and multipliers
that is solved numerically. It serves every mode without compiling it, for many cases at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import final

import numpy as np
from numpy.typing import NDArray

from ...arrays import FloatArray
from ...ir.interpret import interpret_rows
from ...mechanics.equations import ContactRow
from ...reduction.contact_data import ContactData
from ...reduction.modes import CLOSED, OPEN, SLIP, SMOOTH, STICK, Mode

__all__ = ["Facts", "Level", "Outcome", "facts_at"]

_RESIDUAL, _RANK = 1e-7, 1e-11

TOGETHER = 1e-9
"""Share to which the slips of two contacts may differ from being multiples of each other."""


@final
@dataclass(frozen=True, eq=False)
class Level:
    """What the linear system is to give: second rates, or rates after an impact.

    Attributes
    ----------
    load : ndarray (k, n_q)
        Forcing, or momenta before the impact.
    rows : ndarray (k, n_constraints)
        What the constraints demand of Jacobian times unknown.
    slips : ndarray (k, n_slips)
        What sticking demands.
    """

    load: FloatArray
    rows: FloatArray
    slips: FloatArray


@final
@dataclass(frozen=True, eq=False)
class Outcome:
    """The solution in one mode.

    Attributes
    ----------
    motion : ndarray (k, n_q)
        Second rates, or rates.
    normal : ndarray (k, n_contacts)
        Normal reactions or impulses; zero where open.
    friction : ndarray (k, n_contacts, 2)
        Friction forces or impulses.
    gap, slip : ndarray (k, n_contacts), (k, n_contacts, 2)
        By how much the motion exceeds what keeps a contact closed, and what keeps it sticking.
    """

    motion: FloatArray
    normal: FloatArray
    friction: FloatArray
    gap: FloatArray
    slip: FloatArray


@final
@dataclass(frozen=True, eq=False)
class Facts:
    """Matrices of k instants; see `dalembert.reduction.contact_data.ContactData`."""

    contacts: Sequence[ContactRow]
    mass: FloatArray
    forcing: FloatArray
    jacobian: FloatArray
    bias: FloatArray
    velocity: FloatArray
    slip_jacobian: FloatArray
    slip_bias: FloatArray
    slip_velocity: FloatArray
    reactions: FloatArray
    gap: FloatArray
    mu: FloatArray
    mu_static: FloatArray
    restitution: FloatArray
    regularization: FloatArray
    qdot: FloatArray
    places: tuple[slice, ...]
    _inverses: dict[frozenset[int], tuple[FloatArray, FloatArray]] = field(default_factory=dict, init=False)
    _responses: dict[tuple[int, frozenset[int]], tuple[Level, Outcome]] = field(default_factory=dict, init=False)

    def __len__(self) -> int:
        return len(self.mass)

    def slips(self, i: int) -> FloatArray:
        """Return the slip velocity of a contact (k, 2); the second component is zero along one direction."""
        return _padded(self.slip_velocity[:, self.places[i]])

    def gap_rate(self, i: int) -> FloatArray:
        """Return the rate of the gap of a contact (k,)."""
        contact = self.contacts[i]
        assert contact.constraint is not None
        return contact.sense * self.velocity[:, contact.constraint]

    def largest_rate(self, constraint: int) -> FloatArray:
        """Return the largest rate (k,) that a constraint could have with the kinetic energy that there is.

        With |J q_dot| <= sqrt(q_dot.M.q_dot) sqrt(J.M^-1.J), by Cauchy and Schwarz.
        """
        row, inverse = self.jacobian[:, constraint], np.linalg.pinv(self.mass, hermitian=True)
        energy = np.einsum("ki,kij,kj->k", self.qdot, self.mass, self.qdot)
        return np.sqrt(np.maximum(energy * np.einsum("ki,kij,kj->k", row, inverse, row), 0.0))

    def pushes_open(self, i: int) -> NDArray[np.bool_]:
        """Return where the normal reaction of a contact pushes its gap open (k,), as it must."""
        contact = self.contacts[i]
        assert contact.constraint is not None
        push = np.sum(self.reactions[:, :, contact.normal] * self.jacobian[:, contact.constraint], axis=1)
        return np.asarray(contact.sense * push > 0.0)

    def accelerating(self) -> Level:
        """Return what gives second rates."""
        return Level(self.forcing, self.bias, self.slip_bias)

    def impact(self, after: FloatArray) -> Level:
        """Return what gives the rates after an impact, `after` (k, n_constraints) being those of the constraints."""
        drift = self.velocity - _times(self.jacobian, self.qdot)
        slip_drift = self.slip_velocity - _times(self.slip_jacobian, self.qdot)
        return Level(_times(self.mass, self.qdot), after - drift, -slip_drift)

    def solve(
        self, level: Level, mode: Mode, directions: FloatArray, sides: FloatArray, mu: FloatArray | None = None
    ) -> Outcome:
        """Return the solution in a mode, with directions (k, n_contacts, 2) of slip and sides (k, n_contacts).

        Motion, normal reactions and slip are affine in the friction forces, which the laws then give, with `mu`
        (k, n_contacts) instead of the coefficients of sliding friction if that is given.
        """
        mu = self.mu if mu is None else mu
        response = self._response(level, frozenset(i for i, state in enumerate(mode) if state == OPEN))
        count, total = len(self), self.slip_jacobian.shape[1]
        matrix, right = np.zeros((count, total, total)), np.zeros((count, total))
        for i, state in enumerate(mode):
            for j, place in enumerate(range(self.places[i].start, self.places[i].stop)):
                if state == STICK:
                    matrix[:, place], right[:, place] = response.slip[:, place, 1:], -response.slip[:, place, 0]
                    continue
                matrix[:, place, place] = 1.0
                if state in (SLIP, SMOOTH):
                    kappa = mu[:, i] * sides[:, i] * directions[:, i, j]
                    matrix[:, place] += kappa[:, np.newaxis] * response.normal[:, i, 1:]
                    right[:, place] = -kappa * response.normal[:, i, 0]
        forces = _solved(matrix, right)
        weights = np.concatenate([np.ones((count, 1)), forces], axis=1)
        friction, slip = np.zeros((count, len(mode), 2)), np.zeros((count, len(mode), 2))
        slips = _times(response.slip, weights)
        for i, span in enumerate(self.places):
            wide = span.stop - span.start
            friction[:, i, :wide], slip[:, i, :wide] = forces[:, span], slips[:, span]
        motion, normal = _times(response.motion, weights), _times(response.normal, weights)
        return Outcome(motion, normal, friction, _times(response.gap, weights), slip)

    def _response(self, level: Level, opened: frozenset[int]) -> Outcome:
        """Return what there is without friction and for a unit of each friction force, (..., 1 + n_slips)."""
        key = id(level), opened  # the level is kept with its response, so that no other can have its number
        if key not in self._responses:
            self._responses[key] = level, self._respond(level, opened)
        return self._responses[key][1]

    def _respond(self, level: Level, opened: frozenset[int]) -> Outcome:
        inverse, reactions = self._inverse(opened)
        size, held = self.mass.shape[1], self._held(opened)
        tangential = [unknown for contact in self.contacts for unknown in contact.tangential]
        right = np.zeros((len(self), size + len(held), 1 + len(tangential)))
        right[:, :size, 0], right[:, size:, 0] = level.load, level.rows[:, held]
        right[:, :size, 1:] = self.reactions[:, :, tangential]
        found = inverse @ right
        motion, forces = found[:, :size], reactions @ found[:, size:]
        normal = np.zeros((len(self), len(self.contacts), right.shape[2]))
        gap = np.zeros_like(normal)
        kept = self._kept(opened)
        for i, contact in enumerate(self.contacts):
            if i not in opened:
                normal[:, i] = forces[:, kept.index(contact.normal)]
            if contact.constraint is not None:
                gap[:, i] = contact.sense * np.einsum("ki,kij->kj", self.jacobian[:, contact.constraint], motion)
                gap[:, i, 0] -= contact.sense * level.rows[:, contact.constraint]
        slip = self.slip_jacobian @ motion
        slip[:, :, 0] -= level.slips
        return Outcome(motion, normal, normal[:, :0], gap, slip)

    def yielding(self, level: Level, mode: Mode, i: int) -> FloatArray:
        """Return the slip of a contact that a unit of friction force takes away (k,)."""
        slip = self._response(level, frozenset(n for n, state in enumerate(mode) if state == OPEN)).slip
        place = self.places[i].start
        return np.abs(slip[:, place, 1 + place])

    def coupling(self, level: Level, mode: Mode, i: int, j: int) -> tuple[NDArray[np.bool_], FloatArray]:
        """Return where two contacts can only slip together (k,), and the sign of their slips' ratio (k,)."""
        slip = self._response(level, frozenset(n for n, state in enumerate(mode) if state == OPEN)).slip
        a, b = self.places[i].start, self.places[j].start
        w = slip[:, [a, b]][:, :, [1 + a, 1 + b]]
        own = w[:, 0, 0] * w[:, 1, 1]
        together = np.abs(own - w[:, 0, 1] * w[:, 1, 0]) <= TOGETHER * np.abs(own)
        return together, np.where(w[:, 1, 0] < 0.0, -1.0, 1.0)

    def _held(self, opened: frozenset[int]) -> list[int]:
        """Return the constraints that hold while some contacts are open."""
        gone = {self.contacts[i].constraint for i in opened}
        return [i for i in range(self.jacobian.shape[1]) if i not in gone]

    def _kept(self, opened: frozenset[int]) -> list[int]:
        """Return the reactions that hold constraints while some contacts are open."""
        gone = {i for contact in self.contacts for i in contact.tangential} | {self.contacts[i].normal for i in opened}
        powerless = {i for i in range(self.reactions.shape[2]) if not np.any(self.reactions[:, :, i])}
        needed = {contact.normal for contact in self.contacts}
        return [i for i in range(self.reactions.shape[2]) if i not in gone and (i in needed or i not in powerless)]

    def _inverse(self, opened: frozenset[int]) -> tuple[FloatArray, FloatArray]:
        """Return the inverse of the saddle-point matrix, and what leads from its multipliers to reactions."""
        if opened not in self._inverses:
            size, held, kept = self.mass.shape[1], self._held(opened), self._kept(opened)
            rows = self.jacobian[:, held]
            across = np.swapaxes(rows, 1, 2)
            matrix = np.zeros((len(self), size + len(held), size + len(held)))
            matrix[:, :size, :size], matrix[:, :size, size:], matrix[:, size:, :size] = self.mass, -across, rows
            columns = self.reactions[:, :, kept]
            back = np.swapaxes(columns, 1, 2)
            reactions = _inverted(back @ columns) @ (back @ across)
            self._inverses[opened] = _inverted(matrix), reactions
        return self._inverses[opened]

    def held(self, mode: Mode) -> FloatArray:
        """Return the rates (k, n_q) nearest to the present ones, by kinetic energy, that a mode allows."""
        level = self.impact(np.zeros_like(self.velocity))
        still = tuple(state if state in (OPEN, STICK) else CLOSED for state in mode)
        return self.solve(level, still, np.zeros((len(self), len(mode), 2)), np.zeros((len(self), len(mode)))).motion

    def part(self, some: NDArray[np.intp]) -> Facts:
        """Return the facts of some instants."""
        values = {name: getattr(self, name)[some] for name in _ARRAYS}
        return Facts(self.contacts, **values, places=self.places)


_ARRAYS = (
    *("mass", "forcing", "jacobian", "bias", "velocity", "slip_jacobian", "slip_bias", "slip_velocity"),
    *("reactions", "gap", "mu", "mu_static", "restitution", "regularization", "qdot"),
)


def facts_at(data: ContactData, contacts: Sequence[ContactRow], t: FloatArray, x: FloatArray, c: FloatArray) -> Facts:
    """Return the facts at times t (k,), states x = (q, q_dot) (k, 2 n_q) and parameters c (k, n_p)."""
    n, m, s, u, k = data.coordinates, data.constraints, data.slips, data.unknowns, data.contacts
    out = interpret_rows(data.kernel, t, x, c)
    sizes = [n * n, n, (m + s) * (n + 2), n * u, 5 * k]
    mass, forcing, rows, reactions, numbers = np.split(out, np.cumsum(sizes)[:-1], axis=1)
    rows = rows.reshape(-1, m + s, n + 2)
    numbers = numbers.reshape(-1, k, 5)
    ends = np.cumsum([len(contact.slips) for contact in contacts])
    places = tuple(slice(int(end) - len(c.slips), int(end)) for end, c in zip(ends, contacts, strict=True))
    return Facts(
        contacts,
        mass=mass.reshape(-1, n, n),
        forcing=forcing,
        jacobian=rows[:, :m, :n],
        bias=rows[:, :m, n],
        velocity=rows[:, :m, n + 1],
        slip_jacobian=rows[:, m:, :n],
        slip_bias=rows[:, m:, n],
        slip_velocity=rows[:, m:, n + 1],
        reactions=reactions.reshape(-1, n, u),
        gap=numbers[:, :, 0],
        mu=numbers[:, :, 1],
        mu_static=numbers[:, :, 2],
        restitution=numbers[:, :, 3],
        regularization=numbers[:, :, 4],
        qdot=x[:, n:],
        places=places,
    )


def _times(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("kij,kj->ki", matrices, vectors))


def _padded(values: FloatArray) -> FloatArray:
    wide = np.zeros((len(values), 2))
    wide[:, : values.shape[1]] = values
    return wide


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Return solutions of small systems (k, n), the least ones where they are singular."""
    if matrix.shape[1] == 0:
        return right
    if matrix.shape[1] == 1:
        pivot = matrix[:, :, 0]
        return np.where(pivot == 0.0, 0.0, right / np.where(pivot == 0.0, 1.0, pivot))
    return _times(_inverted(matrix), right)


def _inverted(matrix: FloatArray) -> FloatArray:
    """Return inverses (k, n, n), pseudo-inverses where there are none, and NaN where entries are not finite."""
    size = matrix.shape[1]
    if size == 0:
        return matrix
    good = np.all(np.isfinite(matrix), axis=(1, 2))
    found = np.full_like(matrix, np.nan)
    try:
        found[good] = np.linalg.inv(matrix[good])
    except np.linalg.LinAlgError:
        found[good] = np.linalg.pinv(matrix[good], rcond=_RANK)
        return found
    left = np.max(np.abs(matrix @ found - np.eye(size)), axis=(1, 2))
    bad = good & ~(left <= _RESIDUAL)
    if np.any(bad):
        found[bad] = np.linalg.pinv(matrix[bad], rcond=_RANK)
    return found
