"""Motions whose power series have few terms: steps end where the next term begins to matter, at every order.

A pendulum released where it is horizontal has terms of orders 0, 2, 6, 10, ..., a mass that passes through the middle
of a cubic spring of orders 1, 5, 9, ...: the last two coefficients of such a series may both be zero.
"""

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

pytestmark = pytest.mark.filterwarnings("ignore:no coordinate or rate:dalembert.errors.PrecisionWarning")

x, k, m = dynamicsymbols("x"), *sp.symbols("k m", positive=True)
FORCES = {
    "pendulum": -sp.cos(x),
    "square": 1 - x**2,
    "cube": -(x**3),
    "cube and weight": 1 - x**3,
    "fourth power": -(x**4),
    "fifth power": -(x**5),
    "fifth power and weight": 1 - x**5,
}
TOLERANCES = [1e-2, *(10.0**-e for e in range(3, 16)), 1e-16]


def particle(force, backend="llvm"):
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("spring", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("p", P, m))
    scene.add_loads((P, k * force * N.x))
    return da.compile_model(scene, backend=backend)


def reference(force, start, end):
    rate = sp.lambdify(x, force)
    run = solve_ivp(lambda t, y: [y[1], rate(y[0])], (0, end), start, "DOP853", rtol=3e-14, atol=1e-15)
    return run.y[0, -1]


@pytest.mark.parametrize("name", FORCES)
def test_steps_end_before_terms_that_no_coefficient_shows(name):
    model = particle(FORCES[name])
    for start in ((0.0, 0.0), (0.0, 1.0), (1e-12, 1.0), (1e-9, 0.0), (1e-3, 1.0)):
        wanted, given = reference(FORCES[name], start, 1.5), {x: start[0], x.diff(): start[1]}
        for rtol in TOLERANCES:
            options = {"method": "taylor", "rtol": rtol, "atol": rtol / 100}
            run = model.simulate((0, 1.5), given, {k: 1, m: 1}, **options)
            cases = model.sweep((0, 1.5), given, {k: np.ones(3), m: 1}, **options)
            assert run.success and cases.success.all()
            errors = np.abs(np.array([run["x"][-1], *cases["x"]]) - wanted)
            assert errors.max() < 30 * rtol + 1e-12, (start, rtol)


def test_numba_takes_the_same_steps():
    pytest.importorskip("numba")
    model = particle(FORCES["pendulum"], "numba")
    for rtol in (1e-7, 1e-10):
        options = {"method": "taylor", "rtol": rtol, "atol": rtol / 100}
        run = model.simulate((0, 5), {x: 0, x.diff(): 0}, {k: 1, m: 1}, **options)
        assert run.success and abs(run["x"][-1] - reference(FORCES["pendulum"], (0, 0), 5)) < 100 * rtol
