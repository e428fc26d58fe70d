"""Contacts that stick while their normal reaction passes through zero, with hardly any force along the contact."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

TIME = dynamicsymbols._t


def block_in_slot(force):
    """Return a block between the two sides of a moving slot, pressed to each in turn, that a force pushes along it."""
    N, O, (x, y) = ReferenceFrame("N"), Point("O"), dynamicsymbols("x y")
    scene = da.Scene("slot", frame=N, origin=O, coordinates=[x, y])
    P = O.locatenew("P", x * N.x + y * N.y)
    scene.add_bodies(Particle("block", P, sp.Float(1.3)))
    scene.add_loads((P, sp.Float(8.6) * sp.sin(sp.Float(6.9) * TIME) * N.y + sp.Float(force) * N.x))
    R, F = da.unknowns("R F")
    scene.add_joints(da.Joint("slot", body="block", at=P, force=F * N.x + R * N.y))
    scene.add_holonomic_constraints(y)
    scene.add_friction(da.CoulombFriction(R, F, slip=x.diff(TIME) - sp.Float(0.3), mu=sp.Float(0.9), name="slot"))
    return scene


@pytest.mark.parametrize("force", [0.0, 1e-17, 1e-15, 1e-12, 1e-10, 1e-9, -1e-9, 1e-4])
def test_a_block_sticks_on_where_it_is_pressed_to_the_other_side(force):
    # Friction fails to hold for 2 |force| / (0.9 * 8.6 * 6.9) s, in which the block hardly gains speed.
    start = {"x": 0.0, "y": 0.0, "x_dot": 0.3, "y_dot": 0.0}
    run = da.compile_model(block_in_slot(force)).simulate((0.05, 2.0), start, {}, rtol=1e-8, atol=1e-10)
    assert run.success
    sides = np.pi / 6.9 * np.arange(1, 5)
    assert [phase.modes["slot"] for phase in run.phases if phase.t1 - phase.t0 > 1e-3] == ["stick"] * 5
    assert [phase.t0 for phase in run.phases if phase.t1 - phase.t0 > 1e-3][1:] == pytest.approx(sides, abs=1e-5)
    gained = force / 1.3 * abs(force) / (0.9 * 8.6 * 6.9)
    assert run.qdot[:, 0] == pytest.approx(0.3, abs=1e-12 + 4 * abs(gained))
