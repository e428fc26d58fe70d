"""Contacts with friction at the dead centres of their points: there the slip velocity does not depend on the rates."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status

TIME = dynamicsymbols._t
A, P, Q = sp.symbols("A P Q")
G = sp.Float("9.81")


def _hanging(contacts, sense=1):
    """Return two links of unit length that hang at a wall, beside an oscillator; the wall touches some of their points.

    P presses the tip to the wall, Q pulls the elbow off, and A sin(t) turns the upper link towards the wall. Slip is
    counted upwards, or downwards.
    """
    a, b, z = dynamicsymbols("a b z")
    N, O = ReferenceFrame("N"), Point("O")
    elbow = O.locatenew("elbow", sp.sin(a) * N.x - sp.cos(a) * N.y)
    tip = elbow.locatenew("tip", sp.sin(b) * N.x - sp.cos(b) * N.y)
    beside = O.locatenew("beside", z * N.z)
    scene = da.Scene("hanging", frame=N, origin=O, coordinates=[a, b, z])
    scene.add_bodies(Particle("elbow", elbow, 1), Particle("tip", tip, 1), Particle("beside", beside, 1))
    scene.add_loads((elbow, -Q * N.x - G * N.y), (tip, P * N.x - G * N.y), (beside, -z * N.z))
    scene.add_loads((N.orientnew("U", "Axis", (a, N.z)), A * sp.sin(TIME) * N.z))
    for name, mu in contacts.items():
        point, out = (elbow, sp.sin(a)) if name == "elbow" else (tip, sp.sin(a) + sp.sin(b))
        R, F = da.unknowns(f"R_{name} F_{name}")
        up = sp.sin(a) * a.diff(TIME) + (sp.sin(b) * b.diff(TIME) if name == "tip" else 0)
        scene.add_joints(da.Joint(name, body=name, at=point, force=sense * F * N.y - R * N.x))
        scene.add_contacts(da.UnilateralContact(R, gap=-out, name=name))
        scene.add_friction(da.CoulombFriction(R, F, slip=sense * up, mu=mu, name=name))
    return da.compile_model(scene)


def _start(a=0.0):
    return {"a": a, "b": -a, "z": 1.0, "a_dot": 0.0, "b_dot": 0.0, "z_dot": 0.0}


@pytest.mark.parametrize("sense", [1, -1])
def test_a_point_that_is_pulled_from_its_dead_centre_slips_and_does_not_stick(sense):
    model = _hanging({"tip": 0.3}, sense)
    run, beside = (model.simulate((0, 0.3), _start(a), {"A": 0, "P": 5, "Q": 2}) for a in (0.0, -1e-9))
    assert run.status is Status.SUCCESS
    assert [phase.modes["tip"] for phase in run.phases][-1] == "slip"
    np.testing.assert_allclose(run.q[-1], beside.q[-1], atol=1e-8)
    assert run["a"][-1] < -0.05
    cases = model.sweep((0, 0.3), _start(), {"A": 0, "P": 5, "Q": np.full(3, 2.0)})
    np.testing.assert_array_equal(cases.status, 0)
    np.testing.assert_allclose(cases["a"], run["a"][-1], atol=1e-12)


@pytest.mark.parametrize("rtol, torque", [(1e-5, 5), (1e-7, 3), (1e-10, 5)])
def test_a_point_leaves_with_the_link_that_lets_its_dead_centre_go(rtol, torque):
    """While the links are pressed to the wall nothing moves, and the tip sticks; then the elbow takes it along."""
    model = _hanging({"tip": 0.4, "elbow": 0.0})
    values = {"A": torque, "P": 0, "Q": 0}
    run = model.simulate((0, 4), _start(), values, rtol=rtol, atol=rtol * 1e-2)
    assert run.status is Status.SUCCESS
    assert run.phases[0].modes == {"tip": "stick", "elbow": "slip"}
    assert run.phases[0].t1 == pytest.approx(np.pi, abs=1e-12)
    assert run.phases[-1].t0 < np.pi + 1e-4
    assert run.phases[-1].modes == {"tip": "open", "elbow": "open"}
    free = _hanging({}).simulate((np.pi, 4), _start() | {"z": -1.0}, values, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(run.q[-1], free.q[-1], atol=100 * rtol)
