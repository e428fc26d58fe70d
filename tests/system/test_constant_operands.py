"""Functions of which one operand does not vary, in the equations of a scene."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

t = dynamicsymbols._t
x = dynamicsymbols("x")
a = sp.Symbol("a")

FORCES = {
    "atan2": sp.atan2(x, 2) + sp.atan2(sp.Float(1.5), x + 3) + sp.atan2(x, a) - sp.atan2(a, x + 3) + sp.atan2(t, 3),
    "power": sp.Pow(2, x) - sp.Pow(a, x) + (x + 3) ** 2.5 + (x + 3) ** a + (t + 1) ** sp.Float(1.3),
    "extremum": sp.Max(x, -5) + sp.Min(x, a, 9) + sp.Max(a, 1) + sp.Min(t, 7),
    "piecewise": sp.Piecewise((2, x > 5), (a, x > 4), (x, True)) + sp.Piecewise((t, a < 9), (1, True)),
    "quotient": a / (x + 3) + 2 / (x + 3) - (x + 3) / a + sp.Mod(a, 3) + sp.floor(a) + sp.sign(a) * x,
}
START = {x: 0.3, x.diff(): -0.2}


@cache
def model(name, backend):
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene(f"constant operands of {name}", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("bob", P, 1))
    scene.add_loads((P, (FORCES[name] - 4 * x) / 4 * N.x))
    return da.compile_model(scene, backend=backend)


@cache
def expected(name):
    run = model(name, "numpy").simulate((0.1, 1.1), START, {a: 1.7}, method="dop853", rtol=1e-11, atol=1e-12)
    assert run.success, run.message
    return run["x"][-1]


@pytest.mark.parametrize("backend, method", [("llvm", "taylor"), ("llvm", "dop853"), ("llvm", "radau")])
@pytest.mark.parametrize("name", FORCES)
def test_numba(name, backend, method):
    run = model(name, backend).simulate((0.1, 1.1), START, {a: 1.7}, method=method, rtol=1e-10, atol=1e-12)
    assert run.success and run["x"][-1] == pytest.approx(expected(name), rel=1e-8)


@pytest.mark.parametrize("name", FORCES)
def test_sweep(name):
    sweep = model(name, "llvm").sweep((0.1, 1.1), START, {a: np.full(5, 1.7)}, rtol=1e-10, atol=1e-12)
    assert np.all(sweep.success) and np.allclose(sweep.final["x"], expected(name), rtol=1e-8)


@pytest.mark.parametrize("name", ["atan2", "power"])
def test_sensitivity(name):
    found = model(name, "llvm").sensitivity((0.1, 1.1), START, {a: 1.7}, of=[x], wrt=[a], rtol=1e-9)
    ends = [
        model(name, "llvm").simulate((0.1, 1.1), START, {a: 1.7 + s}, rtol=1e-11, atol=1e-13)["x"][-1]
        for s in (-1e-4, 1e-4)
    ]
    assert found.jacobian(x, a)[-1] == pytest.approx((ends[1] - ends[0]) / 2e-4, rel=1e-5)


@pytest.mark.usefixtures("quick_xla")
@pytest.mark.parametrize("name", ["atan2", "power"])
def test_jax(name):
    run = model(name, "jax").simulate((0.1, 1.1), START, {a: 1.7}, method="taylor", rtol=1e-6, atol=1e-8)
    assert run.success and run["x"][-1] == pytest.approx(expected(name), rel=1e-5)
