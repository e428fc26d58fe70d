"""Times of events against closed forms: errors of the watched expression in units of the tolerance.

A particle hangs on a spring and a damper that move as sin t: x = sin t and a transient. Where the spring is stiff,
stability limits the steps of Runge-Kutta methods, and their polynomials may be off by far more than the ends of steps.
"""

import functools

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

x, t = dynamicsymbols("x"), dynamicsymbols._t
zeta, omega = sp.symbols("zeta omega", positive=True)
level = sp.Symbol("level", real=True)
END, SPEED = 6.0, 1.3
SPRINGS = {"soft": (1.0, 5.0), "stiff": (10.0, 300.0)}
# of springs that were off by 110 to 380 tolerances while the ends of steps alone were bounded
WORST = {zeta: [0.503, 1.06, 2.39], omega: [241.9, 223.3, 82.96], level: [0.404, 0.417, 0.765]}
MOST = {"taylor": 1.0, "dop853": 20.0, "tsit5": 40.0}


@functools.cache
def model():
    frame, origin = ReferenceFrame("N"), Point("O")
    point = origin.locatenew("P", x * frame.x)
    scene = da.Scene("moved spring", frame=frame, origin=origin, coordinates=[x])
    scene.add_bodies(Particle("p", point, 1))
    force = -2 * zeta * omega * (x.diff(t) - sp.cos(t)) - omega**2 * (x - sp.sin(t)) - sp.sin(t)
    scene.add_loads((point, force * frame.x))
    return da.compile_model(scene)


def springs(what, count):
    """Return parameters of springs, with levels of the velocity that is watched."""
    rng, (low, high) = np.random.default_rng(3), SPRINGS[what]
    values = {
        zeta: 10.0 ** rng.uniform(-1.0, 0.5, count),
        omega: np.geomspace(low, high, count),
        level: rng.uniform(-0.9, 0.9, count),
    }
    extra = WORST if what == "stiff" else {key: [] for key in values}
    return {key: np.concatenate([found, extra[key]]) for key, found in values.items()}


def beyond(p, time):
    """Return the velocity less its level (k,), from the closed form."""
    root = p[omega] * np.sqrt(p[zeta] ** 2 - 1 + 0j)
    fast, slow = -p[zeta] * p[omega] - root, -p[zeta] * p[omega] + root
    transient = (SPEED - 1.0) / (slow - fast) * (slow * np.exp(slow * time) - fast * np.exp(fast * time))
    return np.cos(time) + transient.real - p[level]


@functools.cache
def changes(what, count):
    """Return how often the sign of `beyond` changes (k,) for `springs`."""
    p = springs(what, count)
    signs = np.sign([beyond(p, time) for time in np.linspace(0.0, END, 20_001)])
    return np.sum(signs[1:] * signs[:-1] < 0.0, axis=0)


@pytest.mark.parametrize("rtol", [1e-5, 1e-7, 1e-9])
@pytest.mark.parametrize("method", MOST)
@pytest.mark.parametrize("what", SPRINGS)
def test_events_are_as_accurate_as_steps(what, method, rtol):
    p, options = springs(what, 300), {"method": method, "rtol": rtol, "atol": rtol, "max_steps": 10**6}
    event = x.diff(t) - level
    sweep = model().sweep((0, END), {x: 0.0, x.diff(t): SPEED}, p, events=[event], **options)
    found = sweep.events[event]
    assert sweep.success.all()
    np.testing.assert_array_equal(found.count, changes(what, 300))
    for times in (found.first, found.last):
        happened = np.isfinite(times)
        errors = np.abs(beyond(p, np.where(happened, times, 0.0)))[happened] / rtol
        assert errors.max() <= MOST[method]
    for i in range(-3, 0):
        one = {key: float(values[i]) for key, values in p.items()}
        run = model().simulate((0, END), {x: 0.0, x.diff(t): SPEED}, one, events=[event], **options)
        errors = np.abs(beyond(one, run.events[event].t)) / rtol
        assert run.success and len(errors) == found.count[i] and errors.max() <= MOST[method]
