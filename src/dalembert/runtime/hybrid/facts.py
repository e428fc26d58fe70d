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

from ...ir.interpret import interpret_rows
from ...mechanics.equations import ContactRow
from ...reduction.contact_data import ContactData
from ...reduction.modes import CLOSED, OPEN, SLIP, SMOOTH, STICK, Mode

__all__ = ["Facts", "Level", "Outcome", "facts_at"]

FloatArray = NDArray[np.float64]
_RESIDUAL = 1e-9


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
    places: tuple[slice, ...] = field(default=())

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

    def solve(self, level: Level, mode: Mode, directions: FloatArray, sides: FloatArray) -> Outcome:
        """Return the solution in a mode, with directions (k, n_contacts, 2) of slip and sides (k, n_contacts)."""
        count, size = len(self), self.mass.shape[1]
        rows, targets = self._rows(level, mode)
        across = np.swapaxes(rows, 1, 2)
        gone = {c.normal for c, state in zip(self.contacts, mode, strict=True) if state == OPEN}
        gone |= {i for c, s in zip(self.contacts, mode, strict=True) if s in (OPEN, SLIP, SMOOTH) for i in c.tangential}
        kept = [i for i in range(self.reactions.shape[2]) if i not in gone]
        supply = np.linalg.pinv(self.reactions[:, :, kept], rcond=1e-12) @ across if kept else np.zeros((count, 0, 0))
        push = across.copy()
        for i, (contact, state) in enumerate(zip(self.contacts, mode, strict=True)):
            if state in (SLIP, SMOOTH):
                kappa = (self.mu[:, i] * sides[:, i])[:, None] * directions[:, i, : len(contact.tangential)]
                force = np.einsum("kij,kj->ki", self.reactions[:, :, list(contact.tangential)], kappa)
                push -= force[:, :, None] * supply[:, kept.index(contact.normal), None, :]
        width = size + rows.shape[1]
        matrix = np.zeros((count, width, width))
        matrix[:, :size, :size], matrix[:, :size, size:], matrix[:, size:, :size] = self.mass, -push, rows
        found = _solved(matrix, np.concatenate([level.load, targets], axis=1))
        motion, multipliers = found[:, :size], found[:, size:]
        forces = _times(supply, multipliers)
        normal, friction = np.zeros((count, len(mode))), np.zeros((count, len(mode), 2))
        gap, slip = np.zeros((count, len(mode))), np.zeros((count, len(mode), 2))
        for i, (contact, state) in enumerate(zip(self.contacts, mode, strict=True)):
            if state != OPEN:
                normal[:, i] = forces[:, kept.index(contact.normal)]
            wide = len(contact.tangential)
            if state == STICK:
                for j, unknown in enumerate(contact.tangential):
                    friction[:, i, j] = forces[:, kept.index(unknown)]
            elif state in (SLIP, SMOOTH):
                kappa = (self.mu[:, i] * sides[:, i])[:, None] * directions[:, i, :wide]
                friction[:, i, :wide] = -kappa * normal[:, i, None]
            if contact.constraint is not None:
                row = contact.constraint
                rate = np.sum(self.jacobian[:, row] * motion, axis=1) - level.rows[:, row]
                gap[:, i] = contact.sense * rate
            place = self.places[i]
            slip[:, i, :wide] = _times(self.slip_jacobian[:, place], motion) - level.slips[:, place]
        return Outcome(motion, normal, friction, gap, slip)

    def _rows(self, level: Level, mode: Mode) -> tuple[FloatArray, FloatArray]:
        """Return the rows that hold in a mode, and what they demand."""
        opened = {c.constraint for c, state in zip(self.contacts, mode, strict=True) if state == OPEN}
        held = [i for i in range(self.jacobian.shape[1]) if i not in opened]
        rows, targets = [self.jacobian[:, held]], [level.rows[:, held]]
        for place, state in zip(self.places, mode, strict=True):
            if state == STICK:
                rows.append(self.slip_jacobian[:, place])
                targets.append(level.slips[:, place])
        return np.concatenate(rows, axis=1), np.concatenate(targets, axis=1)

    def held(self, mode: Mode) -> FloatArray:
        """Return the rates (k, n_q) nearest to the present ones, by kinetic energy, that a mode allows."""
        level = self.impact(np.zeros_like(self.velocity))
        frictionless = np.zeros((len(self), len(mode)))
        smooth = tuple(state if state in (OPEN, STICK) else CLOSED for state in mode)
        return self.solve(level, smooth, np.zeros((len(self), len(mode), 2)), frictionless).motion

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
    """Return solutions; where constraints depend on each other, those with the least multipliers."""
    found = np.full_like(right, np.nan)
    good = np.all(np.isfinite(matrix), axis=(1, 2)) & np.all(np.isfinite(right), axis=1)
    try:
        found[good] = np.linalg.solve(matrix[good], right[good, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        pass
    scale = np.max(np.abs(right), axis=1, initial=0.0) + np.max(np.abs(matrix), axis=(1, 2), initial=0.0)
    left = np.max(np.abs(_times(matrix, found) - right), axis=1, initial=0.0)
    bad = good & ~(left <= _RESIDUAL * scale)
    if np.any(bad):
        found[bad] = _times(np.linalg.pinv(matrix[bad], rcond=1e-11), right[bad])
    return found
