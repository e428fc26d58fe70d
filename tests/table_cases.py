"""A mass on a spring whose force is a table, and its motion by SciPy, stopped at every knot."""

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

x = dynamicsymbols("x")
m, c = sp.symbols("m c", positive=True)
N, O = ReferenceFrame("N"), Point("O")

KINDS = ("linear", "cubic", "hold")
KNOTS = np.linspace(-2.0, 2.0, 9)
VALUES = KNOTS**3 + 0.3 * np.sin(5.0 * KNOTS)
START = (1.7, 0.0)
DAMPING, END = 0.1, 6.0

CURVES = {
    "linear": lambda q: np.interp(q, KNOTS, VALUES),
    "cubic": CubicSpline(KNOTS, VALUES),
    "hold": lambda q: VALUES[np.searchsorted(KNOTS, q, side="right") - 1],
}
"""The force as SciPy and NumPy have it."""


def spring(kind, extrapolate="error", argument=x, name="spring"):
    """Return the table of the force."""
    return da.table(argument, KNOTS, VALUES, kind, extrapolate, name=name)


def oscillator(kind, extrapolate="error"):
    """Return the scene of the mass."""
    P = O.locatenew("P", x * N.x)
    scene = da.Scene(f"table_{kind}", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("mass", P, m))
    scene.add_loads((P, (-spring(kind, extrapolate) - c * x.diff()) * N.x))
    return scene


def pieces(kind):
    """Return polynomials between the knots, highest power first."""
    if kind == "cubic":
        return CubicSpline(KNOTS, VALUES).c.T
    slopes = np.diff(VALUES) / np.diff(KNOTS) if kind == "linear" else np.zeros(len(KNOTS) - 1)
    return np.column_stack([slopes, VALUES[:-1]])


def stopped_at_knots(kind, start=START, end=END):
    """Return the state at the end, by an integration of each piece alone, and how many knots were passed."""
    polynomials, t, y = pieces(kind), 0.0, np.array(start)
    place, passed = int(np.searchsorted(KNOTS, y[0], side="right")) - 1, 0
    while True:

        def rates(t, y, place=place):
            return [y[1], -np.polyval(polynomials[place], y[0] - KNOTS[place]) - DAMPING * y[1]]

        def above(t, y, place=place):
            return y[0] - KNOTS[place + 1]

        def below(t, y, place=place):
            return y[0] - KNOTS[place]

        above.terminal = below.terminal = True
        above.direction, below.direction = 1.0, -1.0
        run = solve_ivp(rates, (t, end), y, method="DOP853", rtol=1e-12, atol=1e-14, events=[above, below])
        t, y = run.t[-1], run.y[:, -1]
        if run.status == 0:
            return y, passed
        passed += 1
        place += 1 if len(run.t_events[0]) else -1
