"""Normal reactions of contacts act along their gaps; others are refused before anything moves."""

import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import ConstraintError

x, y = dynamicsymbols("x y")
m, g = sp.symbols("m g", positive=True)
N, O = ReferenceFrame("N"), Point("O")
P = O.locatenew("P", x * N.x + y * N.y)
NORMAL, FRICTION = da.unknowns("R F")


def block(normal, gap, friction=None):
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("block", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    force = NORMAL * normal + (0 if friction is None else FRICTION * friction)
    scene.add_joints(da.Joint("floor", body="block", at=P, force=force))
    scene.add_contacts(da.UnilateralContact(NORMAL, gap=gap, name="floor"))
    if friction is not None:
        scene.add_friction(da.CoulombFriction(NORMAL, FRICTION, mu=0.3))
    return scene


@pytest.mark.parametrize("friction", [None, N.x])
def test_a_normal_that_pushes_along_the_floor_is_refused(friction):
    """At rest 10 N of friction under a load of 20 N were taken to stick, although mu = 0.3 allows 6 N."""
    scene = block(N.y + N.x / 2, y, friction)
    with pytest.raises(ConstraintError, match=r"'R' of .* 'floor' does not act along its gap.*on x, y differ"):
        da.compile_model(scene)


def test_a_normal_may_depend_on_the_place():
    """On the curve y = x**2 / 2 the normal is that of the curve."""
    scene = block(N.y - x * N.x, y - x**2 / 2, N.x + x * N.y)
    start = {"x": 0.2, "y": 0.02, "x_dot": 0.0, "y_dot": 0.0}
    held = da.compile_model(scene, outputs=["R", "F"]).simulate((0, 1), start, {m: 2, g: 10})
    assert held.success and held.phases[0].modes == {"floor": "stick"}
    size = 1.04  # of (1, x) squared: the weight in both directions
    assert held["R"][-1] == pytest.approx(20 / size) and held["F"][-1] == pytest.approx(4 / size)
