"""Polynomials of steps that end where the steps do."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.steps.projection import end_differences, end_in, end_polynomial

TERMS, N = 6, 4


@pytest.fixture
def polynomials():
    random = np.random.default_rng(3)
    found = random.standard_normal((5, TERMS, N)) * 10.0 ** random.integers(-8, 8, (5, TERMS, N))
    found[0] = 0.0
    return found


@pytest.mark.parametrize("miss", [0.0, 1e-15, 1e-13, 1e-3, np.nan])
def test_loops_and_arrays_correct_alike(polynomials, miss):
    ends = polynomials.sum(axis=1) + miss * np.abs(polynomials).sum(axis=1)
    found = polynomials.copy()
    end_in(ends, found)
    for k, m in np.ndindex(len(ends), N):
        row = np.concatenate([[7.0], polynomials[k].ravel()])[np.newaxis]
        difference = ends[k, m] - polynomials[k].sum(axis=0)[m]
        end_polynomial(row, 0, 1 + m, N, difference, np.abs(polynomials[k]).sum(axis=0)[m])
        np.testing.assert_array_equal(row[0, 1:].reshape(TERMS, N)[:, m], found[k, :, m])
    kept = np.all(found == polynomials, axis=(1, 2))
    assert kept[0] == (not np.isnan(miss)) and np.all(kept[1:] == (miss <= 1e-15))
    if miss > 1e-13:
        np.testing.assert_allclose(found[1:].sum(axis=1), ends[1:], rtol=1e-9, atol=1e-12 * np.abs(found).max())


def test_differences_beyond_rounding_stay():
    found = end_differences(np.array([1e-15, 1e-14, -1e-15, -1.0]), np.ones(4))
    np.testing.assert_array_equal(found, [0.0, 1e-14, 0.0, -1.0])


def test_rounding_makes_no_event_of_a_motion_that_begins_with_slope_zero():
    """A force of t**3 on a particle at rest: it moves by t**5, and comes back neither in place nor in speed."""
    frame, origin, (x,), t = ReferenceFrame("N"), Point("O"), dynamicsymbols("x:1"), dynamicsymbols._t
    m, k = sp.symbols("m k", positive=True)
    scene = da.Scene("thrust", frame=frame, origin=origin, coordinates=[x])
    point = origin.locatenew("P", x * frame.x)
    scene.add_bodies(Particle("P", point, m))
    scene.add_loads((point, k * t**3 * frame.x))
    model = da.compile_model(scene)
    random = np.random.default_rng(1)
    for place, strength, end in random.standard_normal((40, 3)):
        start, p = {"x0": place, "x0_dot": 0.0}, {"m": 1.0, "k": np.exp(strength)}
        run = model.simulate(
            (0, 1 + abs(end)), start, p, method="taylor", events=[da.Event(x.diff()), da.Event(x - place)]
        )
        assert [len(run.events[name]) for name in run.events] == [0, 0]
