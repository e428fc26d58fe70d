"""A mass in a plane whose forces are surfaces of data, and its motion by SciPy on equations written by hand."""

import functools

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.interpolate import RectBivariateSpline, RegularGridInterpolator
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

x, y = dynamicsymbols("x y")
m, c, s = sp.symbols("m c s", positive=True)
N, O = ReferenceFrame("N"), Point("O")

KNOTS = (np.array([-2.0, -1.4, -0.9, -0.2, 0.3, 0.8, 1.5, 2.0]), np.array([-3.0, -1.8, -0.6, 0.4, 1.3, 2.2, 3.0]))
_X, _V = np.meshgrid(*KNOTS, indexing="ij")
VALUES = _X**3 + 0.4 * np.sin(2.0 * _X + _V) + 0.3 * _V * (1.0 + 0.2 * _X**2)
GIVEN = {m: 1.3, c: 0.1, s: 1.5}
START = {x: 1.2, y: -0.4, x.diff(): 0.3, y.diff(): 0.9}
END = 5.0


def surface(kind, extrapolate="error", values=VALUES):
    """Return the force of a spring and damper in one, over place and speed."""
    return da.table((x, y.diff()), KNOTS, values, kind, extrapolate, name="map")


def scene(kind, extrapolate="error", values=VALUES):
    """Return the scene of the mass: the surface acts along x, and on y times c."""
    P = O.locatenew("P", x * N.x + y * N.y)
    made = da.Scene(f"surface_{kind}", frame=N, origin=O, coordinates=[x, y])
    made.add_bodies(Particle("mass", P, m))
    force = surface(kind, extrapolate, values)
    made.add_loads((P, -force * N.x - (s * y + c * force) * N.y))
    return made


def function(kind):
    """Return the surface as SciPy has it."""
    if kind == "cubic":
        return RectBivariateSpline(*KNOTS, VALUES).ev
    lines = RegularGridInterpolator(KNOTS, VALUES)
    return lambda a, b: lines((a, b))


@functools.cache
def motion(kind, end=END, mass=1.3):
    """Return the state (x, y, x_dot, y_dot) at the end by DOP853, with steps so short that knots matter little."""
    force = function(kind)

    def rates(t, z):
        pull = float(force(z[0], z[3]))
        return [z[2], z[3], -pull / mass, -(1.5 * z[1] + 0.1 * pull) / mass]

    start = list(START.values())
    return solve_ivp(rates, (0, end), start, "DOP853", rtol=1e-12, atol=1e-13, max_step=4e-3).y[:, -1]
