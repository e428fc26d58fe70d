"""The textbook equations as numbers: at one state, or at random states that fulfil the constraints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, final

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from sympy.core.function import AppliedUndef

from ..arrays import FloatArray
from ..frozen import frozen
from ..scene.expressions.identity import leaves_of
from .functions import function_of

TOLERANCE = 1e-9
"""Relative size below which a number that was computed from random states counts as zero."""

_INPUT_RATES = 4
"""Highest order of the rates of inputs: positions are differentiated twice, and equations once or twice more."""


@final
@frozen
class State:
    """Time, coordinates, rates and parameters, with the accelerations that the equations give there."""

    t: float
    q: FloatArray
    v: FloatArray
    p: FloatArray
    a: FloatArray


@final
class PlainSystem:
    """The Lagrange equations in plain symbols, M q_ddot + bias = given + reactions X, with J q_ddot = gamma.

    Derived from T by differentiation; nothing is simplified.

    Attributes
    ----------
    t, q, v, p : Symbol, or tuple of Symbol
        Time, coordinates, rates, parameters with first-order states and, behind these, inputs with their rates.
    flow : dict of Symbol to Expr
        First-order states and their rates.
    mass, bias, given, power, jacobian, gamma, residual, velocity : Matrix
        `power` holds the coefficients of the unknowns X; `residual` and `velocity` vanish with the constraints.
    """

    def __init__(
        self,
        kinetic: Any,
        given: Sequence[Any],
        power: Sequence[Sequence[Any]],
        forms: Sequence[Sequence[Any]],
        holonomic: Sequence[Any],
        coordinates: Sequence[Any],
        time: Any,
        states: Mapping[Any, Any],
    ) -> None:
        size, names = len(coordinates), [str(q.func) for q in coordinates]
        self.t = sp.Symbol("t")
        self.q = tuple(sp.Symbol(f"q {name}") for name in names)
        self.v = tuple(sp.Symbol(f"v {name}") for name in names)
        table: dict[Any, Any] = {q.diff(time): v for q, v in zip(coordinates, self.v, strict=True)}
        table |= dict(zip(coordinates, self.q, strict=True)) | {time: self.t}
        self._table = table
        table |= {z: sp.Symbol(f"z {z.func}") for z in states}
        self._back = {symbol: leaf for leaf, symbol in table.items()}
        self.flow = {table[z]: self.plain(rate) for z, rate in states.items()}
        table |= {z.diff(time): self.flow[table[z]] for z in states}
        self.kinetic = T = self.plain(kinetic)
        momenta = [T.diff(v) for v in self.v]
        self.momenta = momenta
        self.mass = sp.zeros(size, size)
        for i in range(size):
            for j in range(i + 1):
                self.mass[i, j] = self.mass[j, i] = momenta[i].diff(self.v[j])
        self.bias = sp.Matrix([self._flow(p) - T.diff(q) for p, q in zip(momenta, self.q, strict=True)])
        self.given = sp.Matrix(size, 1, [self.plain(e) for e in given])
        self.power = sp.Matrix(size, len(power[0]) if size else 0, [self.plain(e) for row in power for e in row])
        rows = [[self.plain(e) for e in form] for form in forms]
        self.jacobian = sp.Matrix(len(rows), size, [e for row in rows for e in row[:-1]])
        self.velocity = sp.Matrix(len(rows), 1, [row[-1] for row in rows]) + self.jacobian * sp.Matrix(self.v)
        self.gamma = -self.velocity.applyfunc(self._flow)
        self.residual = sp.Matrix(len(holonomic), 1, [self.plain(e) for e in holonomic])
        everything = [T, *self.given, *self.power, *self.jacobian, *self.velocity, *self.residual]
        everything += [*self.flow, *self.flow.values()]
        state = {self.t, *self.q, *self.v}
        inputs = sorted({u for e in everything for u in e.atoms(AppliedUndef)}, key=str)
        self._inputs = {
            u.diff(self.t, order) if order else u: sp.Symbol(f"rate {order} of {u.func}")
            for u in inputs
            for order in range(_INPUT_RATES + 1)
        }
        parameters = (s for s in leaves_of(everything) if isinstance(s, sp.Symbol) and s not in state)
        self.p = (*parameters, *self._inputs.values())

    def plain(self, expression: Any) -> Any:
        """Return an expression of the scene in plain symbols."""
        return sp.sympify(expression).xreplace(self._table)

    def scene(self, expression: Any) -> Any:
        """Return an expression in plain symbols in the symbols of the scene."""
        return sp.sympify(expression).xreplace(self._back)

    def _flow(self, expression: Any) -> Any:
        """Return the rate of an expression for zero second rates."""
        total = self.explicit_rate(expression)
        for q, v in zip(self.q, self.v, strict=True):
            total += expression.diff(q) * v
        return total

    def explicit_rate(self, expression: Any) -> Any:
        """Return the rate of an expression for fixed coordinates and rates."""
        return expression.diff(self.t) + sum((expression.diff(z) * e for z, e in self.flow.items()), sp.S.Zero)

    def function(self, expressions: Sequence[Any]) -> Any:
        """Return a function of (t, q, v, p) that gives the values of expressions in plain symbols."""
        arguments = (self.t, self.q, self.v, self.p)
        return function_of(arguments, [e.xreplace(self._inputs) for e in map(sp.sympify, expressions)])

    @cached_property
    def _equations(self) -> Any:
        parts = (self.mass, self.bias, self.given, self.power, self.jacobian, self.gamma)
        return self.function([e for part in parts for e in part])

    @cached_property
    def _constraints(self) -> Any:
        gradient = self.residual.jacobian(sp.Matrix(self.q)) if len(self.residual) else self.residual
        parts = (self.residual, gradient, self.velocity, self.jacobian)
        return self.function([e for part in parts for e in part])

    def evaluate(self, t: float, q: Any, v: Any, p: Any) -> tuple[FloatArray, ...]:
        """Return mass matrix, given - bias, reactions' powers, constraint Jacobian and gamma at one state."""
        n, k, m = len(self.q), self.power.shape[1], self.jacobian.shape[0]
        flat = np.array(self._equations(t, q, v, p), dtype=float)
        parts = np.split(flat, np.cumsum([n * n, n, n, n * k, m * n]))
        mass, bias, given, power, jacobian, gamma = parts
        return mass.reshape(n, n), given - bias, power.reshape(n, k), jacobian.reshape(m, n), gamma

    def motion(self, t: float, q: Any, v: Any, p: Any) -> tuple[FloatArray, FloatArray]:
        """Return accelerations (n_q,) and the unknown reactions (n_unknown,) at one state.

        Ideal joints: reactions have no power in the virtual motions S that the constraints leave free, so that
        S^T (M q_ddot - forcing) = 0 and J q_ddot = gamma. Reactions that are not determined are given as nan.
        """
        mass, forcing, power, jacobian, gamma = self.evaluate(t, q, v, p)
        free = null_basis(jacobian, len(self.q))
        system = np.vstack([free.T @ mass, jacobian])
        a = np.linalg.lstsq(system, np.concatenate([free.T @ forcing, gamma]), rcond=None)[0]
        if not power.size:
            return a, np.full(power.shape[1], np.nan)
        x = np.linalg.lstsq(power, mass @ a - forcing, rcond=None)[0]
        x[undetermined(power)] = np.nan
        return a, x

    def consistent(self, t: float, q: Any, v: Any, p: Any) -> tuple[FloatArray, FloatArray]:
        """Return coordinates and rates moved onto the constraints by Newton's method."""
        q, v = np.array(q, dtype=float), np.array(v, dtype=float)
        n, h, m = len(self.q), len(self.residual), self.jacobian.shape[0]
        for _ in range(60):
            if not h:
                break
            flat = np.array(self._constraints(t, q, v, p), dtype=float)
            residual, gradient = flat[:h], flat[h : h + h * n].reshape(h, n)
            step = np.linalg.lstsq(gradient, residual, rcond=None)[0]
            q -= step / max(1.0, float(np.abs(step).max()))
            if np.abs(step).max() < 1e-15:
                break
        for _ in range(3 if m else 0):
            flat = np.array(self._constraints(t, q, v, p), dtype=float)[h + h * n :]
            v -= np.linalg.lstsq(flat[m:].reshape(m, n), flat[:m], rcond=None)[0]
        return q, v


def null_basis(matrix: FloatArray, size: int) -> FloatArray:
    """Return an orthonormal basis (size, k) of the null space of a matrix (m, size)."""
    if not len(matrix):
        return np.eye(size)
    _, singular, rows = np.linalg.svd(matrix)
    return rows[int(np.sum(singular > TOLERANCE * max(float(np.max(singular, initial=0.0)), 1e-300))) :].T


def rank(matrix: FloatArray) -> int:
    """Return the numerical rank of a matrix."""
    if not matrix.size:
        return 0
    singular = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(singular > TOLERANCE * max(float(np.max(singular, initial=0.0)), 1e-300)))


def undetermined(power: FloatArray) -> NDArray[np.bool_]:
    """Return which unknowns (k,) the equations power . X = r do not fix."""
    basis = null_basis(power, power.shape[1])
    return np.asarray(np.abs(basis).max(axis=1, initial=0) > 1e-7)


@final
class States:
    """Random states of a system that fulfil its constraints, for identities that hold along motions."""

    def __init__(self, system: PlainSystem, count: int = 0) -> None:
        self.system = system
        self._count = count or 2 * len(system.q) + 6

    @cached_property
    def states(self) -> list[State]:
        """The states; parameters and time differ from one to the next."""
        system, found, n = self.system, [], len(self.system.q)
        rng = np.random.default_rng(1)
        for _ in range(20 * self._count):
            t, p = rng.uniform(0.4, 1.3), rng.uniform(0.4, 1.3, len(system.p))
            with np.errstate(all="ignore"):
                try:
                    q, v = system.consistent(t, rng.uniform(0.3, 1.3, n), rng.uniform(-1, 1, n), p)
                    if not self._holds(t, q, v, p):
                        continue
                    a, _ = system.motion(t, q, v, p)
                except (np.linalg.LinAlgError, ZeroDivisionError, OverflowError):
                    continue
            if np.all(np.isfinite(a)) and np.abs(a).max(initial=0) < 1e4:
                found.append(State(t, q, v, p, a))
            if len(found) == self._count:
                break
        return found

    def _holds(self, t: float, q: FloatArray, v: FloatArray, p: FloatArray) -> bool:
        if not np.all(np.isfinite(q)) or not np.all(np.isfinite(v)):
            return False
        if not self.system.jacobian.shape[0]:
            return True
        h, n = len(self.system.residual), len(q)
        flat = np.array(self.system._constraints(t, q, v, p), dtype=float)
        off = np.concatenate([flat[:h], flat[h + h * n : h + h * n + self.system.jacobian.shape[0]]])
        return bool(np.abs(off).max(initial=0) < 1e-11)

    def values(self, expressions: Sequence[Any]) -> FloatArray:
        """Return the values (n_state, n_expression) of expressions in the scene's symbols."""
        function = self.system.function([self.system.plain(e) for e in expressions])
        return np.array([function(s.t, s.q, s.v, s.p) for s in self.states], dtype=float)

    def rates(self, expressions: Sequence[Any]) -> FloatArray:
        """Return the rates (n_state, n_expression) of expressions along the motion."""
        system, flat = self.system, []
        for e in expressions:
            plain = system.plain(e)
            flat += [system.explicit_rate(plain), *(plain.diff(x) for x in (*system.q, *system.v))]
        function, n = system.function(flat), len(system.q)
        rows = []
        for s in self.states:
            slopes = np.array(function(s.t, s.q, s.v, s.p), dtype=float).reshape(-1, 1 + 2 * n)
            rows.append(slopes @ np.concatenate([[1.0], s.v, s.a]))
        return np.array(rows)

    def vanishes_on_constraints(self, expression: Any) -> bool:
        """Return whether an expression is zero at every state that fulfils the constraints."""
        if not self.system.jacobian.shape[0] or not self.states:
            return False
        return bool(np.abs(self.values([expression])).max() < TOLERANCE)
