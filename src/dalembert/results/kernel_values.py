"""Values along a motion, computed by the kernels of its program."""

from __future__ import annotations

from functools import cached_property
from typing import final

import numpy as np

from ..arrays import FloatArray
from ..integrators.segments import Constants, constants_at
from ..ir.interpret import interpret_rows
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..transforms.periodic import angles_in
from .shared_loads import output_rows

__all__ = ["KernelValues"]


@final
class KernelValues:
    """Coordinates, rates, outputs, energies and residuals at the states of a motion, each computed on first use.

    Parameters
    ----------
    program : Program
    constants : Constants
        Constants of the program along the motion.
    t : ndarray (n_t,)
        Times [s] of the model that ran.
    y : ndarray (n_t, n_y)
        States.
    wrapped : ndarray (n_t, n_y) or None
        States whose angles are less whole turns; functions of period 2 pi are computed from them, with smaller rounding
        errors.
    """

    def __init__(
        self, program: Program, constants: Constants, t: FloatArray, y: FloatArray, wrapped: FloatArray | None
    ) -> None:
        self._program, self._layout = program, program.layout
        self._constants, self._t, self._y, self._wrapped = constants, t, y, wrapped

    @property
    def constants(self) -> FloatArray:
        """The constants (n_c,), or (n_t, n_c) where they change along the motion."""
        return constants_at(self._constants, self._t)

    @cached_property
    def expanded(self) -> tuple[FloatArray, FloatArray]:
        """Coordinates and rates (n_t, n_q)."""
        size, kernel, c = len(self._layout.coordinates), self._program.kernel("expand"), self.constants
        x = interpret_rows(kernel, self._t, self._y, c)
        rates = slice(size, 2 * size)
        if self._wrapped is None:
            return x[:, :size], x[:, rates]
        return x[:, :size], interpret_rows(kernel, self._t, self._states(kernel, size), c)[:, rates]

    @property
    def variables(self) -> FloatArray:
        """Coordinates, rates and first-order states (n_t, 2 n_q + n_z)."""
        return np.hstack([*self.expanded, self._y[:, self._y.shape[1] - len(self._layout.states) :]])

    @cached_property
    def outputs(self) -> FloatArray:
        """Requested outputs (n_t, n_outputs)."""
        kernel = self._program.kernel("outputs")
        return output_rows(self._program, self._t, self._states(kernel), self.constants)

    @cached_property
    def state_rates(self) -> FloatArray:
        """Rates of the first-order states (n_t, n_z)."""
        rates = self._of_states("rhs")
        return rates[:, rates.shape[1] - len(self._layout.states) :]

    @cached_property
    def energies(self) -> FloatArray:
        """Kinetic and potential energy (n_t, 2)."""
        return self._of_variables("energy")

    @cached_property
    def velocity_residuals(self) -> FloatArray:
        """Velocity residual of each constraint (n_t, n_constraints)."""
        return self._of_variables("velocity_residual")

    @cached_property
    def residuals(self) -> FloatArray:
        """Constraint residuals (n_t, n_constraints): positions of holonomic, velocities of nonholonomic ones."""
        velocities = self.velocity_residuals[:, self._layout.holonomic :]
        return np.hstack([self._of_variables("position_residual"), velocities])

    def named(self, name: str) -> FloatArray | None:
        """Return a coordinate, a rate or a state by its name (n_t,); None for another name."""
        layout = self._layout
        for place, names in enumerate((layout.coordinates, layout.rates)):
            if name in names:
                return self.expanded[place][:, names.index(name)].copy()
        return self._y[:, layout.state.index(name)].copy() if name in layout.state else None

    def _states(self, kernel: Kernel, first: int = 0) -> FloatArray:
        """Return the states, wrapped where the outputs of a kernel from number `first` on have that period."""
        if self._wrapped is None:
            return self._y
        places = sorted(angles_in(kernel, first))
        y = self._y.copy()
        y[:, places] = self._wrapped[:, places]
        return y

    def _of_states(self, name: str) -> FloatArray:
        """Return the outputs of a kernel of times, states and constants."""
        kernel = self._program.kernel(name)
        return interpret_rows(kernel, self._t, self._states(kernel), self.constants)

    def _of_variables(self, name: str) -> FloatArray:
        """Return the outputs of a kernel of times, `variables` and constants; without columns where there is none."""
        if name not in self._program:
            return np.empty((len(self._t), 0))
        kernel, x, layout = self._program.kernel(name), self.variables, self._layout
        if self._wrapped is not None:
            for i in angles_in(kernel):
                if i < len(layout.coordinates) and layout.coordinates[i] in layout.state:
                    x[:, i] = self._wrapped[:, layout.state.index(layout.coordinates[i])]
        return interpret_rows(kernel, self._t, x, self.constants)
