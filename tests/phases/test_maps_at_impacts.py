"""Maps of events at the very instants of impacts: the map first, then the impact, and a record of that instant."""

import numpy as np
import pytest
from sympy import sin
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

x, z = dynamicsymbols("x z")


@pytest.fixture(scope="module")
def model():
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + z * N.z)
    scene = da.Scene("ball", frame=N, origin=O, coordinates=[x, z])
    scene.add_bodies(Particle("ball", P, 1))
    scene.add_loads((P, -9.81 * N.z))
    R = da.unknowns("R")
    scene.add_joints(da.Joint("plane", body="ball", at=P, force=R * N.z))
    scene.add_contacts(da.UnilateralContact(R, gap=z, restitution=0.5, name="plane"))
    return da.compile_model(scene)


@pytest.mark.parametrize("level", [z, sin(z), z * (2 + x**2)])
def test_a_map_at_an_impact_has_the_states_of_that_instant(model, level):
    """Zeros of the gap and of the event are found some roundings apart."""
    kick = da.Event(level, direction=-1, apply={z.diff(): 1.3 * z.diff()}, name="kick")
    for height in np.linspace(0.1, 1, 40):
        fall = np.sqrt(2 * height / 9.81)
        start = {"x": 0.1, "z": height, "x_dot": 1, "z_dot": 0}
        run = model.simulate((0.3, 0.3 + 2.6 * fall), start, {}, events=[kick])
        found, speeds = run.events["kick"], 9.81 * fall * np.array([1.0, 0.65])
        assert np.array_equal(found.before.t, found.after.t) and np.allclose(found.t, 0.3 + fall * np.array([1, 2.3]))
        assert np.allclose(found.before["z_dot"], -speeds) and np.allclose(found.after["z_dot"], -1.3 * speeds)
