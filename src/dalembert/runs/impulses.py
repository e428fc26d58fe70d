"""Impulses at the times at which prescribed velocities jump.

Where a given function of time in a position, an orientation or a constraint has a kink, or one in a nonholonomic
constraint jumps, velocities jump. Forces are bounded, so that the momenta dT/dqdot change by the impulses of ideal
constraints alone: with J the constraint Jacobian and J qdot + drift = 0 the velocity constraints,
dT/dqdot after - dT/dqdot before = J^T (impulses).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import final

import numpy as np

from ..arrays import FloatArray
from ..errors import ConstraintError
from ..frozen import frozen
from ..ir.conditions import CONDITION_TIME
from ..ir.interpret import interpret_rows, mass_matrices
from ..ir.program import Program
from ..mechanics.equations import EquationsOfMotion
from ..reduction.starting import Start
from ..starts.state_sizes import coordinate_sizes

_JUMP = 1e-10
"""Share of the terms of a constraint, or of a momentum, from which on a change at a break is no rounding."""


@final
@frozen
class Impulses:
    """The jumps of rates of one program.

    Attributes
    ----------
    moved : bool
        Whether positions and orientations of bodies depend on conditions on time.
    """

    program: Program
    moved: bool

    def rates(self, t: float, x: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray | None:
        """Return the rates (n_q,) behind a break, None where they do not jump.

        Parameters
        ----------
        t : float
            The time of the break [s].
        x : ndarray (2 n_q + n_z,)
            Coordinates, rates and first-order states at its end.
        before, after : ndarray (n_c,)
            Constants of the segments before and behind the break.

        Raises
        ------
        ConstraintError
            Where a position constraint itself jumps.
        """
        self._refuse_jump(t, x, before, after)
        change, jerked = self._momentum_change(t, x, before, after)
        count = 0
        if "velocity_residual" in self.program:
            was, now = (self._value("velocity_residual", t, x, c) for c in (before, after))
            terms, count = self._rate_terms(t, x, after) + np.abs(was) + np.abs(now), len(now)
            jerked = jerked or bool(np.any(np.abs(now - was) > _JUMP * terms))
        return self._struck(t, x, change, after, range(count)) if jerked else None

    def broken(self, t: float, x: FloatArray, before: FloatArray, after: FloatArray, rows: Sequence[int]) -> list[int]:
        """Return those of some rows of velocity constraints that fail if the others alone let the rates jump.

        Parameters are those of `rates`, and the numbers of the rows.
        """
        size = len(self.program.layout.coordinates)
        change, _ = self._momentum_change(t, x, before, after)
        others = [i for i in range(len(self._value("velocity_residual", t, x, after))) if i not in rows]
        free = x.copy()
        free[size : 2 * size] = self._struck(t, x, change, after, others)
        left = np.abs(self._value("velocity_residual", t, free, after))
        was = np.abs(self._value("velocity_residual", t, x, after))
        terms = np.maximum(self._rate_terms(t, free, after), self._rate_terms(t, x, after)) + left + was
        return [i for i in rows if left[i] > _JUMP * terms[i]]

    def _struck(
        self, t: float, x: FloatArray, change: FloatArray, after: FloatArray, held: Sequence[int]
    ) -> FloatArray:
        """Return the rates (n_q,) behind the impulses of the constraints that are `held`, with a change of momenta."""
        size, number = len(self.program.layout.coordinates), len(held)
        mass = self._mass(t, x, after)
        rows, residual = np.empty((0, size)), np.empty(0)
        if number:
            rows = self._value("constraint_jacobian", t, x, after).reshape(-1, size)[list(held)]
            residual = self._value("velocity_residual", t, x, after)[list(held)]
        return np.asarray(x[size : 2 * size] - _impulsive(mass, rows, change, residual))

    def _rate_terms(self, t: float, x: FloatArray, c: FloatArray) -> FloatArray:
        """Return the sizes of the terms of velocity constraints (n_constraints,)."""
        size = len(self.program.layout.coordinates)
        rows = np.abs(self._value("constraint_jacobian", t, x, c).reshape(-1, size))
        return np.asarray(rows @ np.abs(x[size : 2 * size]))

    def _momentum_change(
        self, t: float, x: FloatArray, before: FloatArray, after: FloatArray
    ) -> tuple[FloatArray, bool]:
        """Return by how much the momenta (n_q,) of x jump, and whether that is more than rounding."""
        size = len(self.program.layout.coordinates)
        if not self.moved:
            return np.zeros(size), False
        mass = np.diag(self._mass(t, x, after))
        energy = max(0.0, *(float(self._value("energy", t, x, c)[0]) for c in (before, after)))
        sizes = np.sqrt(2.0 * energy * np.maximum(mass, 0.0))
        change = self._momenta(t, x, after, sizes) - self._momenta(t, x, before, sizes)
        return change, bool(np.any(np.abs(change) > _JUMP * sizes))

    def _value(self, kernel: str, t: float, x: FloatArray, c: FloatArray) -> FloatArray:
        return interpret_rows(self.program.kernel(kernel), np.array([t]), x[np.newaxis], c)[0]

    def _mass(self, t: float, x: FloatArray, c: FloatArray) -> FloatArray:
        return mass_matrices(self.program, np.array([t]), x[np.newaxis], c)[0]

    def _momenta(self, t: float, x: FloatArray, c: FloatArray, sizes: FloatArray) -> FloatArray:
        """Return dT/dqdot (n_q,): central differences, which are exact for a quadratic function of the rates.

        Rates are moved by what gives momenta of these sizes (n_q,).
        """
        size = len(self.program.layout.coordinates)
        rates, mass = slice(size, 2 * size), np.diag(self._mass(t, x, c))
        steps = np.where((sizes > 0.0) & (mass > 0.0), sizes / np.where(mass > 0.0, mass, 1.0), 1.0)
        rows = np.tile(x, (2 * size, 1))
        rows[:size, rates] += np.diag(steps)
        rows[size:, rates] -= np.diag(steps)
        kinetic = interpret_rows(self.program.kernel("energy"), np.full(2 * size, t), rows, c)[:, 0]
        return np.asarray((kinetic[:size] - kinetic[size:]) / (2.0 * steps), dtype=float)

    def _refuse_jump(self, t: float, x: FloatArray, before: FloatArray, after: FloatArray) -> None:
        if "position_residual" not in self.program:
            return
        left = [self._value("position_residual", t, x, c) for c in (before, after)]
        sizes = coordinate_sizes(self.program, np.array([t]), x[np.newaxis], after)[0]
        size, count = len(sizes), len(left[0])
        rows = self._value("constraint_jacobian", t, x, after).reshape(-1, size)[:count]
        terms = np.abs(rows) @ np.maximum(np.abs(x[:size]), sizes)
        jumps = np.abs(left[1] - left[0]) > _JUMP * (terms + np.abs(left[0]))
        if np.any(jumps):
            layout = self.program.layout
            label = [name for name in layout.constraints if name.startswith("holonomic")][int(np.argmax(jumps))]
            raise ConstraintError(
                f"{label} jumps at t = {t:g}: no finite impulse moves a body from one place to another at once."
                " Write a position that is continuous in time, such as a ramp; its velocity may jump"
            )


def _impulsive(mass: FloatArray, rows: FloatArray, change: FloatArray, residual: FloatArray) -> FloatArray:
    """Return changes of rates (n_q,) that take back those of momenta (n_q,) and residuals (m,) of constraints.

    Of least squares, in coordinates of unit inertia and with constraints of unit length.
    """
    diagonal, count = np.diag(mass), len(rows)
    sizes = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    rows = rows * sizes
    lengths = np.linalg.norm(rows, axis=1)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    rows = rows / lengths[:, np.newaxis]
    saddle = np.block([[sizes[:, np.newaxis] * mass * sizes, rows.T], [rows, np.zeros((count, count))]])
    found = np.linalg.lstsq(saddle, np.concatenate([sizes * change, residual / lengths]), rcond=None)[0]
    moved: FloatArray = sizes * found[: len(mass)]
    return moved


def impulses_of(equations: EquationsOfMotion, program: Program) -> Impulses | None:
    """Return the jumps of rates of a program; None where no prescribed velocity can jump."""
    if program.conditions is None or not program.conditions.decides:
        return None
    decided = equations.graph.input(CONDITION_TIME).deps
    moved = bool(equations.kinetic_energy.deps & decided)
    rows = [node for row in equations.constraints for node in (row.position, row.drift, *row.jacobian)]
    constrained = any(node is not None and node.deps & decided for node in rows)
    return Impulses(program, moved) if moved or constrained else None


def landing_of(
    equations: EquationsOfMotion, program: Program, start: Callable[[Iterable[str]], Start]
) -> Callable[[float, FloatArray, FloatArray, FloatArray], FloatArray] | None:
    """Return the function that gives the state after a break of a run; None where no state jumps.

    Its arguments are a time, a state (n_y,) and the constants (n_c,) before and after it. `start` gives the kernel
    from given values to the state.
    """
    impulses, layout = impulses_of(equations, program), program.layout
    if impulses is None or not layout.state:
        return None

    def landed(t: float, y: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
        time = np.array([t])
        x = interpret_rows(program.kernel("expand"), time, y[np.newaxis], before)
        rates = impulses.rates(t, x[0], before, after)
        if rates is None:
            return y
        size, names = len(layout.coordinates), layout.variables
        x[0, size : 2 * size] = rates
        own = start(names)
        given = x[:, [names.index(name) for name in own.given]]
        return interpret_rows(own.kernel, time, given, after)[0, : len(y)]

    return landed
