"""Damped Newton steps of least norm for equations that may be singular, too many or too few.

A step solves the linearised equations by singular values: exactly where it can, with the least change of the unknowns
where they are not determined, and by least squares where equations contradict each other. It is shortened until the
next one would be shorter (natural monotonicity, P. Deuflhard, Newton Methods for Nonlinear Problems, 2004), which
does not depend on how equations are scaled. Where that fails, a step is damped after Levenberg and Marquardt until it
reduces the residuals (J. J. More, Lecture Notes in Mathematics 630, 1978).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..frozen import frozen

_RANK = 1e-12
"""Share of the largest singular value below which another counts as zero."""

_FLOOR = 1e-3
"""Least scale of an equation, as a share of the largest in its group."""

_NEAR = 1e-9
"""Share of its scale that a residual has at most where Newton's steps converge."""

_FIRST_DAMPING, _MOST_DAMPING = 1e-8, 1e12
_LEAST_SHARE = 2.0**-8
_SMALLEST = 1e-16
_RESTORING = 12
"""Most steps after which some equations hold again."""

Equations = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""From unknowns (n,) to residuals (m,) and their derivatives (m, n)."""


@final
@frozen(eq=False)
class Root:
    """The result of Newton's iteration.

    Attributes
    ----------
    unknowns : ndarray (n,)
    residual : ndarray (m,)
    jacobian : ndarray (m, n)
    scale : ndarray (m,)
        Size of a residual: what it changes by when each unknown changes by its own size.
    iterations : int
    free : ndarray (n, k)
        Directions, of length one, along which no equation changes.
    size : ndarray (n,)
        Sizes of the unknowns.
    """

    unknowns: FloatArray
    residual: FloatArray
    jacobian: FloatArray
    scale: FloatArray
    iterations: int
    free: FloatArray
    size: FloatArray


@final
@frozen(eq=False)
class Units:
    """Sizes by which unknowns and equations are measured.

    Attributes
    ----------
    unknowns : ndarray (n,)
        Least sizes of unknowns.
    equations : ndarray (m,)
        Sizes of equations, by which those of one group are compared.
    groups : ndarray (m,) of int
        Equations of one kind have the same number.
    """

    unknowns: FloatArray
    equations: FloatArray
    groups: NDArray[np.intp]

    def floored(self, sizes: FloatArray) -> FloatArray:
        """Return sizes (m,) of equations, none far below the largest of its group."""
        shares = sizes / self.equations
        largest = np.array([np.max(shares[self.groups == group]) for group in self.groups])
        found: FloatArray = np.maximum(shares, _FLOOR * largest) * self.equations
        return found


@final
@frozen(eq=False)
class _Point:
    """Unknowns with residuals, derivatives, and both without units."""

    z: FloatArray
    r: FloatArray
    jacobian: FloatArray
    size: FloatArray
    scale: FloatArray

    @classmethod
    def at(cls, equations: Equations, z: FloatArray, units: Units) -> _Point:
        r, jacobian = equations(z)
        size = np.maximum(units.unknowns, np.abs(z))
        scale = units.floored(np.abs(jacobian) @ size)
        return cls(z, r, jacobian, size, np.where(scale > 0.0, scale, units.equations))

    @property
    def finite(self) -> bool:
        return bool(np.all(np.isfinite(self.r)) and np.all(np.isfinite(self.jacobian)))

    @property
    def worst(self) -> float:
        """Largest residual beside its scale."""
        return float(np.max(np.abs(self.r / self.scale), initial=0.0))

    def singular_values(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        u, s, vt = np.linalg.svd(self.jacobian * self.size / self.scale[:, np.newaxis], full_matrices=True)
        kept = s > _RANK * max(float(np.max(s, initial=0.0)), 1e-300)
        rank = int(np.count_nonzero(kept))
        return u[:, :rank], s[:rank], vt


def newton(
    equations: Equations,
    start: FloatArray,
    units: Units,
    most: int,
    first: Sequence[int] = (),
    longest: FloatArray | None = None,
) -> Root:
    """Return the root of equations near a start, up to rounding, or the point of least residuals that was reached.

    Parameters
    ----------
    equations : callable
    start : ndarray (n,)
    units : Units
    most : int
        Most iterations.
    first : sequence of int
        Groups of equations that are solved after every step, which then must reduce the residuals of the others.
    longest : ndarray (n,), optional
        Largest change of each unknown in a step. Infinite by default; ignored where there is `first`.
    """
    restore = partial(_restored, equations, units, np.isin(units.groups, first)) if len(first) else None
    here, iterations = _Point.at(equations, start if restore is None else restore(start), units), 0
    while here.finite and iterations < most:
        there = _stepped(equations, here, units, restore, np.full(len(start), np.inf) if longest is None else longest)
        if there is None:
            break
        iterations += 1
        done = here.worst <= _NEAR and there.worst > 0.5 * here.worst  # only rounding is left
        here = here if done and there.worst > here.worst else there
        if done:
            break
    free = here.singular_values()[2] if here.finite else np.eye(len(start))
    rank = len(here.singular_values()[1]) if here.finite else len(start)
    return Root(here.z, here.r, here.jacobian, here.scale, iterations, free[rank:].T, here.size)


def _restored(equations: Equations, units: Units, rows: NDArray[np.bool_], z: FloatArray) -> FloatArray:
    """Return the unknowns (n,) next to z with which some equations (m,) hold."""
    for _ in range(_RESTORING):
        here = _Point.at(equations, z, units)
        if not here.finite:
            return z
        matrix = here.jacobian[rows] * units.unknowns / here.scale[rows, np.newaxis]
        change = units.unknowns * (np.linalg.pinv(matrix, rcond=_RANK) @ (here.r[rows] / here.scale[rows]))
        z = z - change
        if np.all(np.abs(change) <= _NEAR * np.maximum(units.unknowns, np.abs(z))):
            break
    return z


def _stepped(
    equations: Equations,
    here: _Point,
    units: Units,
    restore: Callable[[FloatArray], FloatArray] | None,
    longest: FloatArray,
) -> _Point | None:
    """Return the next point, or None where no step reduces the residuals."""
    u, s, vt = here.singular_values()
    r = here.r / here.scale
    before = float(r @ r)
    if not len(s) or before == 0.0:
        return None

    def correction(residual: FloatArray, damping: float = 0.0) -> FloatArray:
        """Return the change of the unknowns, each as a share of its size, that cancels residuals."""
        change: FloatArray = -(vt[: len(s)].T @ (s / (s * s + damping) * (u.T @ residual)))
        return change

    whole = correction(r)
    length = float(np.linalg.norm(whole))
    within = 1.0 / max(1.0, float(np.max(here.size * np.abs(whole) / longest)))
    share = within if restore is None else 0.0
    if length < _SMALLEST:
        return None
    while share >= _LEAST_SHARE * within:
        there = _Point.at(equations, here.z + share * here.size * whole, units)
        if there.finite and np.linalg.norm(correction(there.r / here.scale)) <= (1.0 - 0.25 * share) * length:
            return there
        share *= 0.5
    damping = 0.0
    while damping < _MOST_DAMPING:
        change = correction(r, damping)
        if np.linalg.norm(change) < _SMALLEST:
            return None
        moved = here.z + here.size * change
        there = _Point.at(equations, moved if restore is None else restore(moved), units)
        left = there.r / here.scale
        fits = restore is not None or bool(np.all(here.size * np.abs(change) <= longest))
        if fits and there.finite and float(left @ left) < before:
            return there
        damping = max(10.0 * damping, _FIRST_DAMPING * float(s[0]) ** 2)
    return None
