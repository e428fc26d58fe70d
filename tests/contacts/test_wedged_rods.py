"""A rod at rest between rough walls: a share of the load that no equation determines holds it, if the cones allow."""

import numpy as np
import pytest
from sympy import symbols
from sympy.physics.mechanics import Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da

SLOPE = 0.3
"""Angle of the rod [rad]: the line of both ends lies in the cones where mu is above its tangent."""


@pytest.fixture(scope="module")
def model():
    x, y, theta = dynamicsymbols("x y theta")
    m, l, g, mu, d = symbols("m l g mu d", positive=True)
    N, O, R = ReferenceFrame("N"), Point("O"), ReferenceFrame("R")
    R.orient_axis(N, N.z, theta)
    G = O.locatenew("G", x * N.x + y * N.y)
    rod = RigidBody("rod", G, R, m, (inertia(R, 0, 0, m * l**2 / 12), G))
    scene = da.Scene("wedged", frame=N, origin=O, coordinates=[x, y, theta])
    scene.add_bodies(rod)
    scene.apply_uniform_gravity(-g * N.y)
    walls = {"left": (-1, O, N.x), "right": (1, O.locatenew("W", d * N.x), -N.x)}
    for name, (side, place, normal) in walls.items():
        end = G.locatenew(f"{name} end", side * l / 2 * R.x)
        wall = da.PointPlane(name, body=rod, point=end, plane=(place, normal), friction=mu, restitution=0)
        scene.add_contacts(wall)
    return da.compile_model(scene)


def test_it_is_held_where_the_cones_allow_it(model):
    """The ends need normal reactions of m g / (2 (mu - tan a)): 700 times the weight at the third coefficient."""
    start = {"x": 0.5 * np.cos(SLOPE), "y": 0, "theta": SLOPE, "x_dot": 0, "y_dot": 0, "theta_dot": 0}
    given = {"m": 1, "l": 1, "g": 9.81, "d": float(np.cos(SLOPE))}
    coefficients = np.tan(SLOPE) + np.array([-0.2, -7e-4, 7e-4, 0.01, 0.3])
    found = []
    for mu in coefficients:
        run = model.simulate((0, 0.5), start, {**given, "mu": mu})
        assert run.status.name == "SUCCESS"
        found.append(run["y"][-1])
    falls = coefficients < np.tan(SLOPE)
    np.testing.assert_allclose(found, np.where(falls, -9.81 / 8, 0), rtol=0, atol=1e-9)
    sweep = model.sweep((0, 0.5), start, {**given, "mu": coefficients})
    np.testing.assert_allclose(sweep["y"], found, rtol=0, atol=1e-12)
