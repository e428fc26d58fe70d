"""Impulses at the times at which prescribed velocities jump.

Where a given function of time in a position, an orientation or a constraint has a kink, or one in a nonholonomic
constraint jumps, velocities jump. Forces are bounded, so that the momenta dT/dqdot change by the impulses of ideal
constraints alone: with J the constraint Jacobian and J qdot + drift = 0 the velocity constraints,
dT/dqdot after - dT/dqdot before = J^T (impulses).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from ..arrays import FloatArray
from ..errors import ConstraintError
from ..ir.conditions import CONDITION_TIME
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from ..mechanics.equations import EquationsOfMotion
from ..reduction.starting import Start

__all__ = ["Impulses", "impulses_of", "landing_of"]

_JUMP = 1e-10
"""Share of rates, or of positions, from which on a change at a break is no rounding."""


@final
@dataclass(frozen=True)
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
        program, size = self.program, len(self.program.layout.coordinates)
        scale = 1.0 + float(np.max(np.abs(x[size : 2 * size]), initial=0.0))
        self._refuse_jump(t, x, before, after)
        change = self._momenta(t, x, after) - self._momenta(t, x, before) if self.moved else np.zeros(size)
        constrained = "velocity_residual" in program
        left = [self._value("velocity_residual", t, x, c) for c in (before, after)] if constrained else []
        mass = self._value("mass_matrix", t, x, after).reshape(size, size)
        jerked = constrained and bool(np.any(np.abs(left[1] - left[0]) > _JUMP * scale))
        size_of_momentum = float(np.max(np.abs(mass), initial=0.0)) * scale
        if not jerked and not np.any(np.abs(change) > _JUMP * size_of_momentum):
            return None
        return self._struck(t, x, change, after, range(len(left[1]) if constrained else 0))

    def broken(self, t: float, x: FloatArray, before: FloatArray, after: FloatArray, rows: Sequence[int]) -> list[int]:
        """Return those of some rows of velocity constraints that fail if the others alone let the rates jump.

        Parameters are those of `rates`, and the numbers of the rows.
        """
        size = len(self.program.layout.coordinates)
        change = self._momenta(t, x, after) - self._momenta(t, x, before) if self.moved else np.zeros(size)
        others = [i for i in range(len(self._value("velocity_residual", t, x, after))) if i not in rows]
        free = x.copy()
        free[size : 2 * size] = self._struck(t, x, change, after, others)
        scale = 1.0 + float(np.max(np.abs(free[size : 2 * size]), initial=0.0))
        left = self._value("velocity_residual", t, free, after)
        return [i for i in rows if abs(left[i]) > _JUMP * scale]

    def _struck(
        self, t: float, x: FloatArray, change: FloatArray, after: FloatArray, held: Sequence[int]
    ) -> FloatArray:
        """Return the rates (n_q,) behind the impulses of the constraints that are `held`, with a change of momenta."""
        size, number = len(self.program.layout.coordinates), len(held)
        mass = self._value("mass_matrix", t, x, after).reshape(size, size)
        rows, residual = np.empty((0, size)), np.empty(0)
        if number:
            rows = self._value("constraint_jacobian", t, x, after).reshape(-1, size)[list(held)]
            residual = self._value("velocity_residual", t, x, after)[list(held)]
        saddle = np.block([[mass, rows.T], [rows, np.zeros((number, number))]])
        return np.asarray(
            x[size : 2 * size] - np.linalg.lstsq(saddle, np.concatenate([change, residual]), rcond=None)[0][:size]
        )

    def _value(self, kernel: str, t: float, x: FloatArray, c: FloatArray) -> FloatArray:
        return interpret_rows(self.program.kernel(kernel), np.array([t]), x[np.newaxis], c)[0]

    def _momenta(self, t: float, x: FloatArray, c: FloatArray) -> FloatArray:
        """Return dT/dqdot (n_q,): central differences, which are exact for a quadratic function of the rates."""
        size = len(self.program.layout.coordinates)
        rates = slice(size, 2 * size)
        step = 1.0 + float(np.max(np.abs(x[rates]), initial=0.0))
        rows = np.tile(x, (2 * size, 1))
        rows[:size, rates] += step * np.eye(size)
        rows[size:, rates] -= step * np.eye(size)
        kinetic = interpret_rows(self.program.kernel("energy"), np.full(2 * size, t), rows, c)[:, 0]
        return np.asarray((kinetic[:size] - kinetic[size:]) / (2.0 * step), dtype=float)

    def _refuse_jump(self, t: float, x: FloatArray, before: FloatArray, after: FloatArray) -> None:
        if "position_residual" not in self.program:
            return
        left = [self._value("position_residual", t, x, c) for c in (before, after)]
        jumps = np.abs(left[1] - left[0]) > _JUMP * (1.0 + np.abs(left[0]) + np.abs(x).max(initial=0.0))
        if np.any(jumps):
            layout = self.program.layout
            label = [name for name in layout.constraints if name.startswith("holonomic")][int(np.argmax(jumps))]
            raise ConstraintError(
                f"{label} jumps at t = {t:g}: no finite impulse moves a body from one place to another at once."
                " Write a position that is continuous in time, such as a ramp; its velocity may jump"
            )


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
