"""The Chaplygin sleigh's equations from the kinetic energy printed in example 13.4.6."""

import functools

import sympy as sp

from oracles.lagrange_operator import LagrangeEquations, lagrange_equations


@functools.cache
def sleigh_equations() -> LagrangeEquations:
    """Return the equations in q = (x, y, theta), p = (m, b, I_C), with constraint (1); no action is given."""
    q = _, _, theta = sp.symbols("x y theta")
    qdot = dx, dy, dtheta = sp.symbols("x_dot y_dot theta_dot")
    p = m, b, I_C = sp.symbols("m b I_C")
    sin, cos = sp.sin(theta), sp.cos(theta)
    T2 = m * (dx**2 + dy**2) + 2 * m * b * dtheta * (-dx * sin + dy * cos) + I_C * dtheta**2
    blade = -dx * sin + dy * cos
    return lagrange_equations(T2 / 2, [0, 0, 0], [blade], q, qdot, p)
