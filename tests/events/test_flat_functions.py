"""Extrema, means and zeros of functions of which nothing but rounding is left over part of a motion: searches end."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

t, x, k = dynamicsymbols._t, dynamicsymbols("x"), sp.Symbol("k")

# functions of x = cos(t), y = -sin(t)
FLAT = {
    "saturated": sp.tanh(20 * x) + sp.Rational(1, 2),
    "saturated at zero": sp.tanh(20 * x) - 1,
    "difference of equals": 1 - sp.tanh(20 * x) ** 2,
    "coarse rounding": (sp.tanh(20 * x) + sp.Symbol("large")) - sp.Symbol("large"),
    "underflow": sp.exp(-1000 * (x + 2) ** 2),
    "nothing": sp.Float("1e-320") * x,
    "steps": sp.floor(3 * x),
    "piecewise constant": sp.Piecewise((1, x > 0), (2, True)),
    "dead zone": sp.Max(sp.Abs(x) - sp.Rational(9, 10), 0),
    "constant but for rounding": sp.tanh(20 * (x**2 + x.diff() ** 2)),
    "fading": sp.exp(-400 * t),
    "logistic": 1 / (1 + sp.exp(-100 * x)),
}


@cache
def model(backend):
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("oscillator", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("bob", P, 1))
    scene.add_loads((P, -k * x * N.x))
    return da.compile_model(scene, backend=backend)


def written(name):
    return FLAT[name].xreplace({sp.Symbol("large"): sp.Float(1e8)})


def samples(name):
    times = np.linspace(0.0, 7.0, 200_001)
    function = sp.lambdify((t, x, x.diff()), FLAT[name].xreplace({sp.Symbol("large"): 0}), "numpy")
    with np.errstate(all="ignore"):
        return np.broadcast_to(function(times, np.cos(times), -np.sin(times)), times.shape)


# a search takes milliseconds in compiled code, and tenths of a second a step in Python
@pytest.mark.parametrize("backend, method", [("llvm", "taylor"), ("llvm", "tsit5"), ("numpy", "dop853")])
def test_extrema_and_means_end(backend, method):
    kept = {}
    names = list(FLAT) if backend == "llvm" else ["saturated", "saturated at zero", "underflow", "steps", "dead zone"]
    for name in names:
        kept |= {f"{name} {kind.__name__}": kind(written(name)) for kind in (da.maximum, da.minimum, da.mean)}
    sweep = model(backend).sweep(
        (0.0, 7.0), {x: 1.0, x.diff(): 0.0}, {k: np.ones(2)}, reduce=kept, method=method, rtol=1e-9, threads=1
    )
    assert np.all(sweep.success)
    for name in names:
        values = samples(name)
        noise = 3e-8 if name == "coarse rounding" else 0.0
        for kind, right in (("maximum", values.max()), ("minimum", values.min())):
            found = sweep.reduced[f"{name} {kind}"]
            assert found == pytest.approx(right, abs=1e-7 + noise), f"{kind} of {name}"
        mean = 0.5 * (values[1:] + values[:-1]).mean()
        assert sweep.reduced[f"{name} mean"] == pytest.approx(mean, abs=2e-4), name


@pytest.mark.parametrize("sweeping", [False, True])
def test_events_end(sweeping):
    """What is flat at zero is no event; what crosses 0.3 does so once in each of its changes."""
    for name in FLAT:
        changes = np.count_nonzero(np.diff(np.sign(samples(name) - 0.3)))
        watched = [da.Event(written(name) - sp.Float(0.3))]
        options = {"events": watched, "rtol": 1e-9}
        start = {x: 1.0, x.diff(): 0.0}
        if sweeping:
            run = model("llvm").sweep((0.0, 7.0), start, {k: np.ones(2)}, threads=1, **options)
            count = int(np.asarray(next(iter(run.events.values())).count)[0])
        else:
            run = model("llvm").simulate((0.0, 7.0), start, {k: 1.0}, **options)
            count = len(run.events[0].t)
        assert np.all(run.success) and count == changes, name
