"""Rates, constraints and outputs of a motion at one state, with their derivatives by state and parameters.

They are written in coordinates and rates, which every formulation has, so that what is made of them does not depend on
the formulation; or in the state of the formulation itself, where its own speeds are requested.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np

from ..arrays import FloatArray
from ..frozen import frozen
from ..ir.program import Program
from ..runs.partials import Partials


@final
@frozen(eq=False)
class Derivatives:
    """Values (k,) with their derivatives by a state (k, n) and by the parameters (k, n_p)."""

    value: FloatArray
    by_state: FloatArray
    by_parameters: FloatArray

    def through(self, state: Derivatives) -> Derivatives:
        """Return the same values with derivatives by the variables that their state is a function of."""
        return Derivatives(
            self.value,
            self.by_state @ state.by_state,
            self.by_parameters + self.by_state @ state.by_parameters,
        )

    def rows(self, places: Sequence[int]) -> Derivatives:
        """Return some of the values."""
        chosen = np.array(places, dtype=np.intp)
        return Derivatives(self.value[chosen], self.by_state[chosen], self.by_parameters[chosen])


@final
@frozen(eq=False)
class LinearPoint:
    """A program at time t, state y (n_y,) and constants c (n_c,).

    Derivatives by parameters are zeros where `parameters` is False, which saves their time. Constraints `left_out`
    follow from the others there.
    """

    program: Program
    partials: Partials
    t: float
    y: FloatArray
    c: FloatArray
    parameters: bool = True
    left_out: tuple[int, ...] = ()

    def derivatives(self, kernel: str, state: FloatArray) -> Derivatives:
        """Return the outputs of a kernel at a state (n,), with their derivatives."""
        where = kernel, self.t, state, self.c
        value = self.partials.value(*where)
        if self.parameters:
            by_parameters = self.partials.by_parameters(*where)
        else:
            by_parameters = np.zeros((len(value), len(self.program.layout.parameters)))
        return Derivatives(value, self.partials.by_state(*where), by_parameters)


@final
@frozen(eq=False)
class LinearEquations:
    """A state x with names, its rates, its constraints, and outputs.

    Attributes
    ----------
    names : tuple of str
    state : ndarray (n,)
    rates : Derivatives
    constraints : Derivatives
        Of x and parameters, zero along the motion.
    holonomic : int
        Number of constraints that do not depend on rates, which come first.
    coordinates : int
        How many coordinates are at the beginning of x, followed by as many rates; 0 where x is not of that form.
    point : Point
        Where they hold.
    """

    names: tuple[str, ...]
    state: FloatArray
    rates: Derivatives
    constraints: Derivatives
    holonomic: int
    coordinates: int
    point: LinearPoint

    def outputs(self, names: Sequence[str]) -> Derivatives:
        """Return components of x, of the formulation's state, coordinates, rates and compiled outputs, by name."""
        layout, size = self.point.program.layout, len(self.state)
        count = self.rates.by_parameters.shape[1]
        tables = {self.names: Derivatives(self.state, np.eye(size), np.zeros((size, count)))}
        scene = layout.variables
        for kernel, rows in (("initial", layout.state), ("expand", scene), ("outputs", layout.outputs)):
            lacking = [name for name in names if not any(name in table for table in tables)]
            if any(name in rows for name in lacking):
                tables[rows] = self._own(kernel) if kernel != "initial" else self.formulation_state()
        found = [
            next(table.rows([rows.index(name)]) for rows, table in tables.items() if name in rows) for name in names
        ]
        return _stacked(found, size, count)

    def rates_in_forces(self) -> Derivatives:
        """Return the rates, with the mass matrix times the accelerations in place of accelerations."""
        forces, rest = self._forces(), 2 * self.coordinates
        first, last = self.rates.rows(range(self.coordinates)), self.rates.rows(range(rest, len(self.names)))
        return _stacked([first, forces, last], *forces.by_state.shape[1:], *forces.by_parameters.shape[1:])

    def _forces(self) -> Derivatives:
        """Return the mass matrix times the accelerations (n_q,)."""
        n, state = self.coordinates, self.state
        second = self.rates.rows(range(n, 2 * n))
        if "momenta" in self.point.program:  # of accelerations in place of rates
            moved = Derivatives(state.copy(), np.eye(len(state)), np.zeros((len(state), second.by_parameters.shape[1])))
            moved.value[n : 2 * n], moved.by_state[n : 2 * n] = second.value, second.by_state
            moved.by_parameters[n : 2 * n] = second.by_parameters
            return self.point.derivatives("momenta", moved.value).through(moved)
        entries = self.point.derivatives("mass_matrix", state)
        mass = entries.value.reshape(n, n)
        of_mass = (each.reshape(n, n, -1) for each in (entries.by_state, entries.by_parameters))
        by_state, by_parameters = (np.einsum("ijk,j->ik", each, second.value) for each in of_mass)
        by_state, by_parameters = by_state + mass @ second.by_state, by_parameters + mass @ second.by_parameters
        return Derivatives(mass @ second.value, by_state, by_parameters)

    def formulation_state(self) -> Derivatives:
        """Return the state of the formulation as a function of x."""
        if not self.coordinates:
            size, count = len(self.state), self.rates.by_parameters.shape[1]
            return Derivatives(self.state, np.eye(size), np.zeros((size, count)))
        return self.point.derivatives("initial", self.state)

    def _own(self, kernel: str) -> Derivatives:
        """Return outputs of a kernel of the formulation's state."""
        return self.point.derivatives(kernel, self.point.y).through(self.formulation_state())


def scene_equations(point: LinearPoint, x: FloatArray | None = None) -> LinearEquations:
    """Return the equations in coordinates, rates and first-order states x (n,), by default those of the state."""
    layout = point.program.layout
    n = len(layout.coordinates)
    if x is None:
        x = point.partials.value("expand", point.t, point.y, point.c)
    further = len(x) - 2 * n
    names = layout.variables
    second = point.derivatives("accelerations", x)
    count = second.by_parameters.shape[1]
    first = Derivatives(x[n : 2 * n], np.eye(len(x))[n : 2 * n], np.zeros((n, count)))
    parts = [first, second]
    if further:
        rates = point.derivatives("rhs", point.y).through(point.derivatives("initial", x))
        parts.append(rates.rows(range(len(rates.value) - further, len(rates.value))))
    positions = [i for i in range(layout.holonomic) if i not in point.left_out]
    speeds = [i for i in range(len(layout.constraints)) if i not in point.left_out]
    kernels = {"position_residual": positions, "velocity_residual": speeds}
    rows = [point.derivatives(kernel, x).rows(kept) for kernel, kept in kernels.items()]
    constraints = _stacked(rows, len(x), count)
    return LinearEquations(names, x, _stacked(parts, len(x), count), constraints, len(positions), n, point)


def own_equations(point: LinearPoint) -> LinearEquations:
    """Return the equations in the state of `minimal`, which only unit quaternions constrain."""
    rates = point.derivatives("rhs", point.y)
    constraints = point.derivatives("project_position", point.y)
    return LinearEquations(point.program.layout.state, point.y, rates, constraints, 0, 0, point)


def _stacked(parts: Sequence[Derivatives], size: int, count: int) -> Derivatives:
    """Return derivatives by the state above derivatives by the parameters, as rows."""
    return Derivatives(
        np.concatenate([np.zeros(0), *(part.value for part in parts)]),
        np.vstack([np.zeros((0, size)), *(part.by_state for part in parts)]),
        np.vstack([np.zeros((0, count)), *(part.by_parameters for part in parts)]),
    )
