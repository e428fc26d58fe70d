"""A ball on a floor that shakes fast, from starts nearly on it: hops as small as rounding do not end runs.

The reference goes from impact to impact, whose times are roots of the gap between points of a fine grid, and to rest
where hops have become too small.
"""

import functools

import numpy as np
import pytest
import sympy as sp
from scipy.optimize import brentq
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

m, g, e, A, w = sp.symbols("m g e A w", positive=True)
TIGHT = {"rtol": 1e-10, "atol": 1e-12}


@functools.cache
def ball():
    y, Y, TIME = dynamicsymbols("y"), da.unknowns("Y"), dynamicsymbols._t
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", y * N.y)
    scene = da.Scene("ball", frame=N, origin=O, coordinates=[y])
    scene.add_bodies(Particle("ball", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_joints(da.Joint("floor", body="ball", at=P, force=Y * N.y))
    scene.add_contacts(da.UnilateralContact(normal=Y, gap=y - A * sp.sin(w * TIME), restitution=e))
    return da.compile_model(scene)


class Reference:
    """One ball, of which `height` is the height at the end."""

    def __init__(self, bounce, size, rate, start, speed, span):
        self.bounce, self.size, self.rate = bounce, size, rate
        self.t, self.end, self.y = start, start + span, self.floor(start)
        self.v, self.fastest = self.floor(start, 1) + speed, 0.0
        while self.t < self.end:
            self.fly()
        self.height = self.y

    def floor(self, t, order=0):
        """Return the height of the floor, its speed or its acceleration."""
        return self.size * self.rate**order * np.sin(self.rate * t + order * np.pi / 2)

    def gap(self, s):
        """Return the gap after a time s of flight."""
        return self.y + self.v * s - 4.905 * s * s - self.floor(self.t + s)

    def move(self, s):
        self.y, self.v, self.t = self.y + self.v * s - 4.905 * s * s, self.v - 9.81 * s, self.t + s

    def rest(self):
        """Go with the floor until it falls faster than the ball."""
        phase = np.arcsin(9.81 / (self.size * self.rate**2))
        turns = np.ceil((self.rate * self.t - phase) / (2 * np.pi))
        self.t = min((phase + 2 * np.pi * turns) / self.rate, self.end)
        self.y, self.v = self.floor(self.t), self.floor(self.t, 1)

    def fly(self):
        """Go on to the next impact and past it, or to the end."""
        leaves, bends = self.v - self.floor(self.t, 1), -9.81 - self.floor(self.t, 2)
        if leaves < 1e-7 * self.fastest and bends <= 0.0:
            self.rest()
            if self.t == self.end:
                return
            leaves, bends = 0.0, 0.0
        grid = 0.01 / self.rate
        s = min(grid, 2 * leaves / abs(bends)) / 5 if bends else 1e-7
        while self.gap(s) <= 0.0 and s > 1e-20:
            s *= 0.5
        while self.t + s < self.end and self.gap(min(s + grid, self.end - self.t)) > 0.0:
            s += grid
        if self.t + s >= self.end:
            self.move(self.end - self.t)
            return
        self.move(brentq(self.gap, s, min(s + grid, self.end - self.t), xtol=1e-17, rtol=1e-15))
        ground = self.floor(self.t, 1)
        self.fastest = max(self.fastest, ground - self.v)
        self.y, self.v = self.floor(self.t), ground + self.bounce * (ground - self.v)


@pytest.mark.parametrize("seed", [0, 1])
def test_starts_nearly_on_the_floor(seed):
    draw, count = np.random.default_rng(seed), 20
    bounce, size, rate = (
        value * draw.uniform(0.95, 1.05, count)
        for value in (0.12208386711743224, 0.03173502658790556, 138.36433175043044)
    )
    start, speed = 4.357 + draw.uniform(-0.05, 0.05, count), 0.0095 * 10.0 ** draw.uniform(-1.5, 1.5, count)
    if seed:  # far from time 0, and hops of many sizes
        bounce, rate = draw.uniform(0.0, 0.7, count), 10.0 ** draw.uniform(1.0, 3.0, count)
        size = 9.81 / rate**2 * draw.uniform(1.2, 10.0, count)
        start = 10.0 ** draw.uniform(-1.0, 3.0, count)
        speed = size * rate * 10.0 ** draw.uniform(-5.0, 0.0, count)
    span = 30.0 / rate if seed else np.full(count, 0.3)
    cases = zip(bounce, size, rate, start, speed, span, strict=True)
    expected = np.array([Reference(*case).height for case in cases])
    given = {"y": size * np.sin(rate * start), "y_dot": size * rate * np.cos(rate * start) + speed}
    p = {m: 0.3, g: 9.81, e: bounce, A: size, w: rate}
    for method in ("taylor", "dop853"):
        sweep = ball().sweep((start, start + span), given, p, method=method, **TIGHT)
        assert np.all(sweep.success), (method, sweep.status)
        np.testing.assert_array_less(np.abs(sweep["y"] - expected), 1e-5 * size)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_a_single_run(method):
    """Its fifth hop rises by less than rounding of the gap, and does not end at once the next ones."""
    p = {m: 0.3, g: 9.81, e: 0.12208386711743224, A: 0.03173502658790556, w: 138.36433175043044}
    start = 4.356995188626138
    given = {"y": p[A] * np.sin(p[w] * start), "y_dot": p[A] * p[w] * np.cos(p[w] * start) + 0.0095}
    run = ball().simulate((start, start + 1), given, p, method=method, **TIGHT)
    assert run.success and len(run.phases) < 60
    expected = Reference(p[e], p[A], p[w], start, 0.0095, 1.0).height
    assert run["y"][-1] == pytest.approx(expected, abs=1e-9)
