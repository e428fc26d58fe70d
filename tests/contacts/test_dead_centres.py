"""Rods at rest at a dead centre of a slot: the motion leaves it, though no slip velocity has a direction there."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fuzz.contacts.scenes import compiled

G, L, MU = 9.81, 0.6, 0.3


def _turning(_, state):
    """Return the rates of the angle and of its rate: the floor's slot is rough, that of the wall is smooth."""
    s, c, rate = np.sin(state[0]), np.cos(state[0]), state[1]
    pushed = G * c - 2.0 * MU * s * (G + L * s * rate**2)
    return rate, pushed / (4.0 / 3.0 * L - 2.0 * MU * L * s * c)


@pytest.mark.parametrize("slots", [{}, {"mu_wall": 0.2}])
def test_a_rod_falls_from_rest_at_the_dead_centre_of_a_slot(slots):
    p = {"m": 1.0, "l": L, "g": G, "A": 0.0, "omega": 1.0, "mu": MU, "mu_wall": 0.0} | slots
    start = {"x": L, "y": 0.0, "theta": 0.0, "x_dot": 0.0, "y_dot": 0.0, "theta_dot": 0.0}
    run = compiled("trammel").simulate((0.0, 0.35), start, p, rtol=1e-9, atol=1e-11)
    assert run.success and [phase.modes for phase in run.phases] == [{"a": "slip", "b": "slip"}]
    exact = solve_ivp(_turning, (0.0, 0.35), (0.0, 0.0), rtol=1e-11, atol=1e-13).y[0, -1]
    if slots:
        assert 0.0 < run["theta"][-1] < exact  # the wall brakes it
    else:
        np.testing.assert_allclose(run["theta"][-1], exact, rtol=1e-7)
