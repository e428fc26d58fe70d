"""Equations of motion from a kinetic energy by the Lagrange operator, on another route than virtual power.

From ``T(q, qdot)`` and the power coefficients ``Q`` of the given actions,

    (d/dt d/dqdot_i - d/dq_i) T = Q_i + reactions      becomes      M qddot = forcing + reactions,
    M = d2T/dqdot2,     forcing = Q - (d/dt dT/dqdot - M qddot - dT/dq).
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
import sympy as sp


@final
@dataclass(frozen=True)
class LagrangeEquations:
    """The equations of a scene, symbolic, with functions that evaluate them at many states.

    Attributes
    ----------
    q, qdot, qddot : tuple of Symbol
        Coordinates, rates and second derivatives, each of length n_q; plain symbols, not functions of time.
    p : tuple of Symbol
        Parameters.
    operator : Matrix, shape (n_q, 1)
        (d/dt d/dqdot - d/dq) T, the left-hand sides.
    M : Matrix, shape (n_q, n_q)
        Mass matrix, of q and p.
    F : Matrix, shape (n_q, 1)
        Forcing, of q, qdot and p.
    J : Matrix, shape (n_lam, n_q)
        Constraint Jacobian, of q and p.
    J_dot : Matrix, shape (n_lam, n_q)
        Its derivative in time, of q, qdot and p.
    """

    q: tuple[sp.Symbol, ...]
    qdot: tuple[sp.Symbol, ...]
    qddot: tuple[sp.Symbol, ...]
    p: tuple[sp.Symbol, ...]
    operator: sp.ImmutableMatrix
    M: sp.ImmutableMatrix
    F: sp.ImmutableMatrix
    J: sp.ImmutableMatrix
    J_dot: sp.ImmutableMatrix

    def mass_matrix(self, q: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """Return M at the states `q` of shape (..., n_q), in an array of shape (..., n_q, n_q)."""
        return self._evaluate(self.M, q, np.zeros_like(q), p)

    def forcing(self, q: np.ndarray, qdot: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """Return the forcing at the states `q`, `qdot` of shape (..., n_q), in an array of that shape."""
        return self._evaluate(self.F, q, qdot, p)[..., 0]

    def constraint_jacobian(self, q: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """Return J at the states `q` of shape (..., n_q), in an array of shape (..., n_lam, n_q)."""
        return self._evaluate(self.J, q, np.zeros_like(q), p)

    def accelerations(self, q: np.ndarray, qdot: np.ndarray, p: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """Solve the saddle-point system at one state (n_q,) for qddot and the reactions J^T lam."""
        M, J = self.mass_matrix(q, p), self.constraint_jacobian(q, p)
        gamma = -self._evaluate(self.J_dot, q, qdot, p) @ qdot
        system = np.block([[M, -J.T], [J, np.zeros((len(J), len(J)))]])
        solution = np.linalg.solve(system, np.concatenate([self.forcing(q, qdot, p), gamma]))
        return solution[: len(q)], J.T @ solution[len(q) :]

    def _evaluate(self, matrix, q, qdot, p) -> np.ndarray:
        rows, columns = matrix.shape
        parameters = [p[symbol.name] for symbol in self.p]
        function = _function((self.q, self.qdot, self.p), matrix)
        entries = function(np.moveaxis(q, -1, 0), np.moveaxis(qdot, -1, 0), parameters)
        filled = [np.broadcast_to(entry, q.shape[:-1]) for entry in entries]
        return np.stack(filled, axis=-1).reshape(*q.shape[:-1], rows, columns)


def lagrange_equations(
    T: sp.Expr,
    Q: Sequence[sp.Expr],
    constraints: Sequence[sp.Expr],
    q: Sequence[sp.Symbol],
    qdot: Sequence[sp.Symbol],
    p: Sequence[sp.Symbol],
) -> LagrangeEquations:
    """Apply the Lagrange operator to a kinetic energy in plain symbols.

    Parameters
    ----------
    T : Expr
        Kinetic energy, of q, qdot and p, with the constraints ignored (assumption 13.1.2).
    Q : sequence of Expr, length n_q
        Power coefficients of the given actions; unknown reactions are left out.
    constraints : sequence of Expr, length n_lam
        Expressions linear in qdot that vanish.
    q, qdot, p : sequence of Symbol
        Coordinates, rates, parameters.

    Returns
    -------
    LagrangeEquations
    """
    qddot = tuple(sp.Symbol(f"{symbol.name}_ddot") for symbol in q)

    def time_derivative(expression: sp.Expr) -> sp.Expr:
        states = zip((*q, *qdot), (*qdot, *qddot), strict=True)
        return sum((expression.diff(symbol) * rate for symbol, rate in states), sp.S.Zero)

    pairs = zip(q, qdot, strict=True)
    operator = sp.Matrix([time_derivative(T.diff(v_i)) - T.diff(q_i) for q_i, v_i in pairs])
    M = sp.hessian(T, qdot)
    F = (sp.Matrix(Q) - (operator - M * sp.Matrix(qddot))).applyfunc(sp.expand)
    J = sp.Matrix(constraints).jacobian(qdot)
    J_dot = J.applyfunc(time_derivative)
    matrices = map(sp.ImmutableMatrix, (operator, M, F, J, J_dot))
    return LagrangeEquations(tuple(q), tuple(qdot), qddot, tuple(p), *matrices)


@functools.cache
def _function(arguments: tuple[tuple[sp.Symbol, ...], ...], matrix: sp.ImmutableMatrix) -> Callable:
    return sp.lambdify(arguments, list(matrix), modules="numpy", cse=True)
