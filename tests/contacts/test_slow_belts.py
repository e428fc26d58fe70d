"""Particles come to rest on a belt that hardly moves, whatever the direction of their slip."""

import numpy as np
import pytest
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status


@pytest.fixture(scope="module")
def model():
    x, y, z = dynamicsymbols("x y z")
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y + z * N.z)
    scene = da.Scene("belt", frame=N, origin=O, coordinates=[x, y, z])
    scene.add_bodies(Particle("particle", P, 1))
    scene.add_loads((P, -9.81 * N.z))
    R, F, G = da.unknowns("R F G")
    scene.add_joints(da.Joint("plane", body="particle", at=P, force=F * N.x + G * N.y + R * N.z))
    scene.add_contacts(da.UnilateralContact(R, gap=z, restitution=0, name="plane"))
    scene.add_friction(da.CoulombFriction(R, (F, G), slip=(x.diff() + 0.001, y.diff()), mu=0.15, name="plane"))
    return da.compile_model(scene)


@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-10])
def test_a_particle_sticks_after_any_slip(model, rtol):
    """What rounding leaves of the slip across the belt is compared with its own terms, not with those along it."""
    angle = np.linspace(0.05, 6.2, 200)
    rates = {"x_dot": -0.001 + 1.9 * np.cos(angle), "y_dot": 1.9 * np.sin(angle), "z_dot": 0}
    sweep = model.sweep((0, 3), {"x": 0, "y": 0, "z": 0} | rates, {}, rtol=rtol, atol=1e-2 * rtol)
    assert np.all(sweep.status == Status.SUCCESS)
    assert np.all(sweep["x_dot"] == -0.001) and np.all(sweep["y_dot"] == 0.0)
    way = 1.9**2 / (2 * 0.15 * 9.81)
    assert np.allclose(sweep["x"], way * np.cos(angle) - 0.003, rtol=0, atol=100 * rtol)
    assert np.allclose(sweep["y"], way * np.sin(angle), rtol=0, atol=100 * rtol)
