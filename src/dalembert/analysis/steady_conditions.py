"""Conditions of equilibria and steady motions, with their derivatives by the values that are free."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..frozen import frozen
from ..ir.program import Program
from ..runs.partials import Partials
from ..starts.inputs import prepare_rows
from ..starts.segment_constants import at_time
from ..starts.state_sizes import AT_REST, coordinate_sizes
from .linear_equations import LinearEquations, LinearPoint, scene_equations
from .newton import Units

_RANK = 1e-9
_ROUNDED, _UNIT = 6, 4e-16
"""Number and size of the random roundings of values."""

_SHORT = 0.5
"""Largest change of an angle in a step that is to stay near [rad]."""


@final
@frozen(eq=False)
class SteadyConditions:
    """Constraints hold, and chosen coordinates, rates and first-order states do not change in time.

    Attributes
    ----------
    program : Program
    partials : Partials
        Of the program.
    t : float
        Time [s].
    x : ndarray (n,)
        Coordinates, rates and first-order states, of which some are free.
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
        """Return coordinates, rates and states (n,) and parameters (n_p,) for free values z (n,)."""
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
        names = layout.variables
        return (
            *layout.constraints[: layout.holonomic],
            *(f"rate of {label}" for label in layout.constraints[: layout.holonomic]),
            *layout.constraints[layout.holonomic :],
            *(f"d({names[i]})/dt" for i in self.steady),
        )

    @property
    def groups(self) -> NDArray[np.intp]:
        """Numbers (m,) of the kinds of conditions: positions, velocities, steady coordinates, rates and states."""
        layout, n = self.program.layout, len(self.program.layout.coordinates)
        kinds = [0] * layout.holonomic + [1] * len(layout.constraints)
        return np.array([*kinds, *(2 + min(i // n, 2) for i in self.steady)], dtype=np.intp)

    def sizes(self) -> FloatArray:
        """Return the sizes of coordinates (n_q,) at the start."""
        c = self.constants(self.p)
        return coordinate_sizes(self.program, np.array([self.t]), self.x[np.newaxis], c)[0]

    def units(self) -> Units:
        """Return the sizes of free values and conditions at the start.

        Those of a value without a unit of its own, such as a parameter that is zero, are by how much it changes the
        conditions, beside their terms.
        """
        layout, sizes = self.program.layout, self.sizes()
        n = len(sizes)
        speed = float(np.sum(np.abs(self.x[n : 2 * n]) / sizes))
        known = np.concatenate([sizes, sizes * (speed if speed > AT_REST else 0.0), np.abs(self.x[2 * n :])])
        j = self.jacobian(self.x, self.constants(self.p))
        lengths = np.abs(j) @ sizes
        of_steady = np.concatenate([sizes, sizes, np.abs(self.x[2 * n :])])[list(self.steady)]
        equations = np.concatenate([lengths[: layout.holonomic], lengths, of_steady])
        least = np.concatenate([known[list(self.free_x)], np.abs(self.p[list(self.free_p)])])
        unknowns = np.where(least > 0.0, least, self._effects())
        return Units(unknowns, np.where(np.isfinite(equations) & (equations > 0.0), equations, 1.0), self.groups)

    def _effects(self) -> FloatArray:
        """Return by how much free values (n,) must change before a condition changes by its terms, one without any."""
        _, jacobian = self.equations(self.start)
        with np.errstate(all="ignore"):
            shares = np.abs(jacobian) / self.terms(self.start)[:, np.newaxis]
        effects = np.max(np.where(np.isfinite(shares), shares, 0.0), axis=0, initial=0.0)
        return np.where(effects > 0.0, 1.0 / np.where(effects > 0.0, effects, 1.0), 1.0)

    def short_steps(self) -> FloatArray:
        """Return by how much each free value (n,) may change in a step that is to stay near, infinite but of angles."""
        layout = self.program.layout
        angles = [i < len(layout.coordinates) and layout.coordinates[i] in layout.angles for i in self.free_x]
        return np.where([*angles, *(False for _ in self.free_p)], _SHORT, np.inf)

    def _linear(self, z: FloatArray, parameters: bool) -> tuple[LinearEquations, FloatArray]:
        """Return rates and constraints at free values z (n,), and the parameters (n_p,)."""
        x, p = self.values(z)
        c = self.constants(p)
        y = self.partials.value("initial", self.t, x, c)
        return scene_equations(LinearPoint(self.program, self.partials, self.t, y, c, parameters), x), p

    def equations(self, z: FloatArray, *, forces: bool = False) -> tuple[FloatArray, FloatArray]:
        """Return the residuals (m,) of all conditions at free values z (n,), and their derivatives (m, n).

        With `forces`, those of accelerations are multiplied by the mass matrix where all of them must vanish. Forces
        change sign only at equilibria, and their derivatives do not vanish between as those of accelerations do.
        """
        linear, _ = self._linear(z, bool(self.free_p))
        n = linear.coordinates
        whole = forces and set(range(n, 2 * n)) <= set(self.steady)
        rates = linear.rates_in_forces() if whole else linear.rates
        parts = linear.constraints, rates.rows(self.steady)
        by_x = np.vstack([part.by_state[:, list(self.free_x)] for part in parts])
        by_p = np.vstack([part.by_parameters[:, list(self.free_p)] for part in parts])
        return np.concatenate([part.value for part in parts]), np.hstack([by_x, by_p])

    def terms(self, z: FloatArray) -> FloatArray:
        """Return the sizes (m,) of the terms that residuals are the sum of, to first order.

        They are what the residuals change by when everything they depend on changes by its own size.
        """
        linear, p = self._linear(z, True)
        x, sizes = np.abs(linear.state), []
        for part in (linear.constraints, linear.rates.rows(self.steady)):
            sizes.append(np.abs(part.by_state) @ x + np.abs(part.by_parameters) @ np.abs(p))
        return np.concatenate(sizes)

    def rounding(self, z: FloatArray) -> FloatArray:
        """Return by how much residuals (m,) differ next to free values z, where all values are rounded differently."""
        x, p = self.values(z)
        found = []
        for seed in range(_ROUNDED):
            rng = np.random.default_rng(seed)
            near, given = (v * (1.0 + _UNIT * rng.uniform(-1.0, 1.0, len(v))) for v in (x, p))
            found.append(self._residuals(near, given))
        spread: FloatArray = np.ptp(np.array(found), axis=0)
        return np.where(np.isfinite(spread), spread, 0.0)

    def _residuals(self, x: FloatArray, p: FloatArray) -> FloatArray:
        c = self.constants(p)
        residuals = [self.partials.value(name, self.t, x, c) for name in ("position_residual", "velocity_residual")]
        return np.concatenate([*residuals, self.changes(x, c)[list(self.steady)]])

    def changes(self, x: FloatArray, c: FloatArray) -> FloatArray:
        """Return the time derivatives (n,) of coordinates, rates and states x (n,)."""
        y = self.partials.value("initial", self.t, x, c)
        n, further = len(self.program.layout.coordinates), len(self.program.layout.states)
        second = self.partials.value("accelerations", self.t, x, c)
        rates = self.partials.value("rhs", self.t, y, c) if further else np.zeros(0)
        return np.concatenate([x[n : 2 * n], second, rates[len(rates) - further :]])

    def jacobian(self, x: FloatArray, c: FloatArray) -> FloatArray:
        """Return the Jacobian of the velocity constraints (n_c, n_q)."""
        n = len(self.program.layout.coordinates)
        return self.partials.value("constraint_jacobian", self.t, x, c).reshape(-1, n)

    def accelerations_left(self, x: FloatArray, c: FloatArray, steady: Sequence[int]) -> tuple[int, int]:
        """Return how many independent accelerations there are, and how many of them `steady` determines."""
        n = len(self.program.layout.coordinates)
        j = self.jacobian(x, c) * self.sizes()
        lengths = np.linalg.norm(j, axis=1, keepdims=True)
        _, s, vt = np.linalg.svd(j / np.where(lengths > 0.0, lengths, 1.0))
        directions = vt[np.count_nonzero(s > _RANK) :]
        rows = directions[:, [i - n for i in steady if n <= i < 2 * n]]
        return len(directions), int(np.linalg.matrix_rank(rows, tol=_RANK)) if rows.size else 0
