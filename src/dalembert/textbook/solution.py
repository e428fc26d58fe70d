"""Closed-form solution for accelerations, reactions and multipliers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, final

import numpy as np
import sympy as sp

from ..errors import RELEASE, ConstraintError, UnknownNameError, list_names, unknown_name
from .energy import readable, readable_fraction
from .linear import Field, Plain, arithmetic, null_space, row_echelon, solve
from .numeric import PlainSystem, States, rank, undetermined


@final
class Solution:
    """The motion that Lagrange equations, constraints and ideal joints determine.

    Released coordinates are imposed again once T has been differentiated, as the text does with y = 0.

    Reactions have no power in the virtual motions S that the constraints leave free. The projection of the
    Lagrange equations on S is free of them (section 13.6: Maggi's equations); with the constraints
    differentiated it gives the accelerations, and the Lagrange equations then give the reactions.
    """

    def __init__(
        self, system: PlainSystem, states: States, unknowns: Sequence[Any], released: Mapping[Any, Any] | None = None
    ) -> None:
        self.system, self.states, self.unknowns = system, states, tuple(unknowns)
        self._released = dict(released or {})
        self.power = self._imposed(system.power)
        self.jacobian = self._imposed(system.jacobian)

    def _imposed(self, matrix: Any) -> Any:
        """Return a matrix in the scene's symbols, released coordinates set to the values that they keep."""
        matrix = matrix.applyfunc(self.system.scene)
        return matrix.applyfunc(lambda e: e.xreplace(self._released)) if self._released else matrix

    @cached_property
    def mass(self) -> Any:
        """Mass matrix in the scene's symbols."""
        return self._readable(self.system.mass)

    @cached_property
    def forcing(self) -> Any:
        """Given powers less the bias terms."""
        return self._readable(self.system.given - self.system.bias)

    @cached_property
    def gamma(self) -> Any:
        """Right-hand sides of the constraints differentiated, J q_ddot = gamma."""
        return self._readable(self.system.gamma)

    def _readable(self, matrix: Any) -> Any:
        return self._imposed(matrix).applyfunc(readable)

    @cached_property
    def rows(self) -> list[int]:
        """Constraints that are independent at a random state."""
        return self._independent_rows()

    def _independent_rows(self) -> list[int]:
        if not self.jacobian.shape[0] or not self.states.states:
            return list(range(self.jacobian.shape[0]))
        s = self.states.states[0]
        jacobian = self.system.evaluate(s.t, s.q, s.v, s.p)[3]
        rows: list[int] = []
        for i in range(len(jacobian)):
            if rank(jacobian[[*rows, i]]) > len(rows):
                rows.append(i)
        return rows

    @cached_property
    def free(self) -> list[Any]:
        """The virtual motions that the constraints leave free, as columns of q_dot."""
        size = len(self.system.q)
        if not self.rows:
            return [sp.eye(size)[:, i] for i in range(size)]
        return null_space(self.jacobian.extract(self.rows, list(range(size))))

    @cached_property
    def _field(self) -> tuple[Field | Plain, dict[str, list[list[Any]]]]:
        """One arithmetic for all matrices, and their elements in it; directions are the columns of `free` as rows."""
        matrices = {
            "mass": self.mass,
            "forcing": self.forcing.T,
            "power": self.power,
            "jacobian": self.jacobian,
            "gamma": self.gamma.T,
            "free": sp.Matrix([list(s) for s in self.free]) if self.free else sp.zeros(0, len(self.system.q)),
        }
        field = arithmetic([e for matrix in matrices.values() for e in matrix])
        elements, start = {}, 0
        for name, matrix in matrices.items():
            rows, columns = matrix.shape
            flat = field.elements[start : start + rows * columns]
            elements[name] = [flat[i * columns : (i + 1) * columns] for i in range(rows)]
            start += rows * columns
        return field, elements

    @cached_property
    def _accelerations(self) -> list[Any]:
        field, held = self._field
        mass, (forcing,), (gamma,) = held["mass"], held["forcing"], held["gamma"] or [[]]
        rows = [held["jacobian"][i] for i in self.rows]
        right = [gamma[i] for i in self.rows]
        for direction in held["free"]:
            rows.append([_dot(direction, column) for column in zip(*mass, strict=True)])
            right.append(_dot(direction, forcing))
        try:
            return solve(field, rows, right)
        except ZeroDivisionError:
            raise ConstraintError(
                "the equations do not determine the accelerations: a coordinate moves no inertia in a direction that"
                " the constraints leave free. Give the bodies it moves mass or inertia, or drop the coordinate"
            ) from None

    def accelerations(self) -> list[Any]:
        """Return q_ddot in terms of q, q_dot and t."""
        field, _ = self._field
        return [readable_fraction(field.expression(e)) for e in self._accelerations]

    def multipliers(self) -> list[Any]:
        """Return the multiplier of every constraint in terms of q, q_dot and t."""
        if len(self.rows) < self.jacobian.shape[0]:
            raise ConstraintError("the multipliers of constraints that depend on each other are not determined")
        return self._balance("jacobian", self.rows)

    def _balance(self, name: str, vectors: Sequence[int]) -> list[Any]:
        """Return the weights of independent vectors that sum up to M q_ddot - forcing.

        The vectors are columns of the reactions' powers, or rows of the constraint Jacobian.
        """
        field, held = self._field
        symbolic = self.power if name == "power" else self.jacobian.T
        _, rows = row_echelon(symbolic.extract(list(range(symbolic.shape[0])), list(vectors)).T)
        chosen = sorted(rows)
        forcing = held["forcing"][0]
        residual = [_dot(held["mass"][i], self._accelerations) - forcing[i] for i in chosen]
        columns = held["power"] if name == "power" else list(zip(*held["jacobian"], strict=True))
        square = [[columns[i][j] for j in vectors] for i in chosen]
        return [readable_fraction(field.expression(e)) for e in solve(field, square, residual)]

    def undetermined(self) -> list[int]:
        """Return the unknowns that no equation fixes, each tested at random states."""
        lost = np.ones(len(self.unknowns), dtype=bool)
        for s in self.states.states[:4]:
            lost &= undetermined(self.system.evaluate(s.t, s.q, s.v, s.p)[2])
        return [i for i, free in enumerate(lost) if free]

    def powerless(self) -> list[int]:
        """Return the unknowns that have no power on any coordinate: they appear in no equation."""
        columns = range(len(self.unknowns))
        return [i for i in columns if all(readable(e) == 0 for e in self.power[:, i])]

    def carries(self) -> bool:
        """Return whether the joints can exert the reactions of the constraints."""
        for s in self.states.states[:4]:
            mass, forcing, power, _, _ = self.system.evaluate(s.t, s.q, s.v, s.p)
            demand = mass @ s.a - forcing
            x = np.linalg.lstsq(power, demand, rcond=None)[0] if power.size else np.zeros(power.shape[1])
            if np.abs(power @ x - demand).max(initial=0) > 1e-8 * max(1.0, np.abs(forcing).max(initial=0)):
                return False
        return True

    def reactions(self) -> dict[Any, Any]:
        """Return the determined unknowns in terms of q, q_dot and t."""
        lost = self.undetermined()
        columns = [i for i in range(len(self.unknowns)) if i not in self.powerless()]
        if not columns:
            return {}
        s = self.states.states[0]
        power = self.system.evaluate(s.t, s.q, s.v, s.p)[2]
        independent: list[int] = []
        for i in columns:
            if rank(power[:, [*independent, i]]) > len(independent):
                independent.append(i)
        found = self._balance("power", independent)
        return {self.unknowns[i]: e for i, e in zip(independent, found, strict=True) if i not in lost}


def _dot(a: Any, b: Any) -> Any:
    """Return the sum of products of elements."""
    terms = [x * y for x, y in zip(a, b, strict=True) if x != 0 and y != 0]
    return sum(terms[1:], terms[0]) if terms else a[0] - a[0]


@final
class Reactions(Mapping[Any, Any]):
    """Unknown -> expression in coordinates, rates and time; keys are the unknowns or their names."""

    def __init__(self, found: Mapping[Any, Any], missing: Mapping[str, str], remedy: str) -> None:
        self._found = dict(found)
        self._names = {str(symbol): symbol for symbol in found}
        self._missing, self._remedy = dict(missing), remedy

    def __getitem__(self, key: Any) -> Any:
        name = str(key)
        if name in self._names:
            return self._found[self._names[name]]
        if name in self._missing:
            raise ConstraintError(f"the unknown {name!r} {self._missing[name]}. {self._remedy}")
        raise UnknownNameError(unknown_name("unknown", name, [*self._names, *self._missing]))

    def __contains__(self, key: object) -> bool:
        return str(key) in self._names

    def __iter__(self) -> Iterator[Any]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)

    def __repr__(self) -> str:
        return f"<Reactions {list_names(self._names)}; undetermined: {list_names(self._missing)}>"


def reactions_of(solution: Solution, scene: str) -> Reactions:
    """Return the reactions that a solution determines, with the reasons why it does not determine others.

    Raises
    ------
    ConstraintError
        When the joints of the scene of that name cannot exert the reactions of its constraints.
    """
    unknowns = solution.unknowns
    if unknowns and not solution.carries():
        raise ConstraintError(
            f"scene {scene!r}: its joints cannot exert the reactions of its constraints. Give a joint the"
            " unknown force or torque component that holds the constraint"
        )
    silent = [unknowns[i] for i in solution.powerless()]
    missing = {
        str(x): "appears in no equation: its power coefficients all vanish"
        if x in silent
        else "is not determined: only a combination of it with others appears in the equations"
        for x in (unknowns[i] for i in solution.undetermined())
    }
    remedy = f"Release the coordinate along which it acts: {RELEASE}"
    return Reactions(solution.reactions() if unknowns else {}, missing, remedy)
