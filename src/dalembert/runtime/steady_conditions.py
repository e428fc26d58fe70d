"""Conditions of equilibria and steady motions, with their derivatives by the values that are free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..ir.program import Program
from .inputs import prepare_rows
from .partials import Partials
from .segments import at_time

__all__ = ["SteadyConditions"]

_RANK = 1e-9


@final
@dataclass(frozen=True, eq=False)
class SteadyConditions:
    """Constraints hold, and chosen coordinates and rates do not change in time.

    Attributes
    ----------
    program : Program
    partials : Partials
        Of the program.
    t : float
        Time [s].
    x : ndarray (2 n_q,)
        Coordinates and rates, of which some are free.
    p : ndarray (n_p,)
        Parameters, of which some are free.
    free_x, free_p : tuple of int
        Places of what is free, in x and in p.
    steady : tuple of int
        Places in x of what must not change.
    """

    program: Program
    partials: Partials
    t: float
    x: FloatArray
    p: FloatArray
    free_x: tuple[int, ...]
    free_p: tuple[int, ...]
    steady: tuple[int, ...]

    @property
    def start(self) -> FloatArray:
        """The free values (n,), coordinates and rates before parameters."""
        return np.concatenate([self.x[list(self.free_x)], self.p[list(self.free_p)]])

    def values(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return coordinates and rates (2 n_q,) and parameters (n_p,) for free values z (n,)."""
        x, p = self.x.copy(), self.p.copy()
        x[list(self.free_x)], p[list(self.free_p)] = z[: len(self.free_x)], z[len(self.free_x) :]
        return x, p

    def constants(self, p: FloatArray) -> FloatArray:
        """Return the constants (n_c,) of parameters (n_p,), which need not be finite."""
        return at_time(self.program, prepare_rows(self.program, p[np.newaxis])[0], self.t)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the conditions, in the order of their residuals."""
        layout = self.program.layout
        names = (*layout.coordinates, *layout.rates)
        return (
            *layout.constraints[: layout.holonomic],
            *(f"rate of {label}" for label in layout.constraints[: layout.holonomic]),
            *layout.constraints[layout.holonomic :],
            *(f"d({names[i]})/dt" for i in self.steady),
        )

    @property
    def groups(self) -> NDArray[np.intp]:
        """Numbers (m,) of the kinds of conditions: positions, velocities, steady coordinates, steady rates."""
        layout, n = self.program.layout, len(self.program.layout.coordinates)
        kinds = [0] * layout.holonomic + [1] * len(layout.constraints)
        return np.array([*kinds, *(2 if i < n else 3 for i in self.steady)], dtype=np.intp)

    def equations(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the residuals (m,) of all conditions at free values z (n,), and their derivatives (m, n)."""
        x, p = self.values(z)
        c = self.constants(p)
        n = len(x) // 2
        steady = list(self.steady)
        r, by_x, by_p = [], [], []
        for kernel in ("position_residual", "velocity_residual"):
            r.append(self.partials.value(kernel, self.t, x, c))
            by_x.append(self.partials.by_state(kernel, self.t, x, c)[:, list(self.free_x)])
            by_p.append(self._by_parameters(kernel, x, c))
        changes = np.concatenate([x[n:], self.partials.value("accelerations", self.t, x, c)])
        slope = np.vstack([np.eye(2 * n)[n:], self.partials.by_state("accelerations", self.t, x, c)])
        by_given = np.vstack([np.zeros((n, len(self.free_p))), self._by_parameters("accelerations", x, c)])
        r.append(changes[steady])
        by_x.append(slope[np.ix_(steady, self.free_x)])
        by_p.append(by_given[steady])
        return np.concatenate(r), np.hstack([np.vstack(by_x), np.vstack(by_p)])

    def terms(self, z: FloatArray) -> FloatArray:
        """Return the sizes (m,) of the terms that residuals are the sum of, to first order.

        They are what the residuals change by when every coordinate, rate and parameter changes by its own size.
        """
        x, p = self.values(z)
        c, n = self.constants(p), len(x) // 2
        sizes = [
            np.abs(self.partials.by_state(kernel, self.t, x, c)) @ np.abs(x)
            + np.abs(self.partials.by_parameters(kernel, self.t, x, c)) @ np.abs(p)
            for kernel in ("position_residual", "velocity_residual", "accelerations")
        ]
        moving = np.concatenate([np.abs(x[n:]), sizes[2]])
        return np.concatenate([sizes[0], sizes[1], moving[list(self.steady)]])

    def _by_parameters(self, kernel: str, x: FloatArray, c: FloatArray) -> FloatArray:
        if not self.free_p:
            return np.zeros((len(self.partials.value(kernel, self.t, x, c)), 0))
        return self.partials.by_parameters(kernel, self.t, x, c)[:, list(self.free_p)]

    def jacobian(self, x: FloatArray, c: FloatArray) -> FloatArray:
        """Return the Jacobian of the velocity constraints (n_c, n_q)."""
        n = len(x) // 2
        return self.partials.value("constraint_jacobian", self.t, x, c).reshape(-1, n)

    def accelerations_left(self, x: FloatArray, c: FloatArray, steady: Sequence[int]) -> tuple[int, int]:
        """Return how many independent accelerations there are, and how many of them `steady` determines."""
        n = len(x) // 2
        j = self.jacobian(x, c)
        lengths = np.linalg.norm(j, axis=1, keepdims=True)
        _, s, vt = np.linalg.svd(j / np.where(lengths > 0.0, lengths, 1.0))
        directions = vt[np.count_nonzero(s > _RANK) :]
        rows = directions[:, [i - n for i in steady if i >= n]]
        return len(directions), int(np.linalg.matrix_rank(rows, tol=_RANK)) if rows.size else 0
