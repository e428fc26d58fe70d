"""Contacts that hold each other while they stick: how long a lawful share of their load exists."""

import math

import numpy as np
import pytest
from scipy.optimize import linprog

from dalembert.hybrid.shared_loads import SharedLaw, lawful_sums
from dalembert.ir.graph import Graph
from fuzz.contacts.scenes import compiled, setting

WHEEL = dict.fromkeys(setting("wheel").parameters, 0.0)
WHEEL |= {"m": 1.8, "I": 0.036, "r": 0.2, "g_x": -1.1, "g_y": 9.81, "T": -2.2, "omega": 2.2, "mu": 0.7, "x_wall": 0.7}


@pytest.mark.parametrize("directions, laws", [(1, 4), (2, 6), (3, 8)])
def test_sums_of_laws_are_positive_where_a_share_breaks_none(directions, laws):
    rng, found = np.random.default_rng(directions), []
    for _ in range(40):
        values, slopes = rng.normal(size=laws) + 0.6, rng.normal(size=(laws, directions)).round(rng.integers(0, 4))
        graph = Graph()
        given = [
            SharedLaw(graph.const(float(a)), tuple(graph.const(float(b)) for b in row))
            for a, row in zip(values, slopes, strict=True)
        ]
        sums = [float(node.number) for node in lawful_sums(graph, "test", given)]
        cost = np.append(np.zeros(directions), -1.0)  # the largest margin
        above, bounds = np.hstack([-slopes, np.ones((laws, 1))]), [(None, None)] * directions + [(None, 1.0)]
        margin = -linprog(cost, A_ub=above, b_ub=values, bounds=bounds).fun
        found.append(margin > 0.0)
        assert (min(sums, default=1.0) > 0.0) == found[-1], (values, slopes, margin, sums)
    assert 5 < sum(found) < 35


@pytest.mark.parametrize("mu_wall", [0.1, 0.3])
def test_a_wheel_in_a_corner_leaves_the_wall_when_it_can_push_no_less(mu_wall):
    """The floor bears m g_x, and its moment: whatever the wall does beyond that, it presses until |T| = m |g_x| r."""
    p = WHEEL | {"mu_wall": mu_wall}
    start = {"x": 0.5, "y": 0.2, "theta": 0.0, "x_dot": 0.0, "y_dot": 0.0, "theta_dot": 0.0}
    model = compiled("wheel")
    used = {name: p[name] for name in model.layout.parameters}
    motion = model.simulate((1.1, 1.6), start, used, rtol=1e-10, atol=1e-12)
    away = (math.pi - math.asin(1.8 * 1.1 * 0.2 / 2.2)) / 2.2
    assert [tuple(phase.modes.values()) for phase in motion.phases] == [("stick", "stick"), ("stick", "open")]
    assert motion.phases[-1].t0 == pytest.approx(away, abs=1e-9)
    s, c = 1.6 - away, 2.2 * away
    turned = (math.sin(c) - math.sin(c + 2.2 * s)) / 2.2 + math.cos(c) * s  # of the second integral of sin(2.2 t)
    x = 0.5 + (1.8 * -1.1 * 0.5 * s * s + 2.2 / 0.2 * turned / 2.2) / (1.8 + 0.036 / 0.2**2)
    np.testing.assert_allclose(motion.q[-1, :2], [x, 0.2], atol=1e-9)
    sweep = model.sweep((1.1, 1.6), {**start, "x": np.full(3, 0.5)}, used, rtol=1e-10, atol=1e-12)
    assert list(sweep.phases) == [2, 2, 2]
    np.testing.assert_allclose(sweep["x"], x, atol=1e-9)
