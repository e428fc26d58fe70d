"""Scenes with contacts backwards in time: up to the change of a contact, before which several pasts are possible."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status
from fuzz.contacts.families import drawn
from fuzz.contacts.scenes import compiled

G = 9.81
BALL = {"m": 1.0, "e": 0.7, "g": G}
BELT = {"m": 1.0, "k": 20.0, "v_b": 0.3, "mu": 0.3, "mu_s": 0.5, "g": G}


@cache
def ball():
    return da.compile_model(da.scenes.bouncing_ball())


@cache
def belt():
    return da.compile_model(da.scenes.belt_oscillator())


@pytest.mark.parametrize("method", ["taylor", "radau"])
def test_what_sticks_may_have_begun_to_slip_anywhere(method):
    """A block that slips as fast as the belt may have stuck before, but not there: the spring would hold it longer."""
    start = {"x": 0.1, "y": 0.0, "x_dot": -0.3, "y_dot": 0.0}
    run = belt().simulate((8.0, 6.5), start, BELT, method=method)
    assert run.status is Status.CONTACT_AMBIGUOUS and "backwards in time" in run.message
    assert [phase.modes["belt"] for phase in run.phases] == ["slip"]
    assert run["x_dot"][-1] == pytest.approx(0.3, abs=1e-7)
    slips = {name: run(7.5)[name][0] for name in ("x", "y", "x_dot", "y_dot")}
    again = belt().simulate((7.5, 8.0), slips, BELT, method=method)
    np.testing.assert_allclose([again["x"][-1], again["x_dot"][-1]], [0.1, -0.3], atol=1e-6)
    sweep = belt().sweep((8.0, [6.5, 7.5]), start, BELT, method=method)
    assert list(sweep.status) == [Status.CONTACT_AMBIGUOUS, Status.SUCCESS]


@pytest.mark.parametrize("push, modes", [(3.0, "slip"), (-3.0, "slip"), (1.0, "stick")])
def test_a_block_that_friction_cannot_hold_has_come_to_rest_against_its_load(push, modes):
    """It has been slowed by the load and friction (2 N)."""
    x, P = dynamicsymbols("x"), sp.Symbol("P")
    N, O = ReferenceFrame("N"), Point("O")
    B = O.locatenew("B", x * N.x)
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("block", B, 1))
    F = da.unknowns("F")
    scene.add_loads((B, P * N.x))
    scene.add_joints(da.Joint("floor", body="block", at=B, force=F * N.x))
    scene.add_friction(da.CoulombFriction(sp.Float(2), F, mu=1, name="floor"))
    run = da.compile_model(scene).simulate((1, 0), {"x": 0.0, "x_dot": 0.0}, {"P": push})
    assert run.status is Status.SUCCESS and [phase.modes["floor"] for phase in run.phases] == [modes]
    past = (push + np.sign(push) * 2) / 2 if modes == "slip" else 0.0
    assert run["x"][-1] == pytest.approx(past, abs=1e-12)


@pytest.mark.parametrize("rtol", [1e-8, 1e-10])
def test_a_block_that_has_broken_away_may_have_stuck(rtol):
    """Friction that is overcome by next to nothing has held it before: it has not come from the other side."""
    case = drawn("slot", 14)
    model, span = compiled(case.scene), (0.881688, 0.0)
    p = {name: case.parameters[name] for name in model.layout.parameters}
    forth = model.simulate((0.0, span[0]), case.initial, p, rtol=rtol, atol=rtol)
    assert [[*phase.modes.values()] for phase in forth.phases] == [["slip"], ["stick"], ["slip"]]
    start = {name: forth[name][-1] for name in case.initial}
    back = model.simulate(span, start, p, rtol=rtol, atol=rtol)
    assert back.status is Status.CONTACT_AMBIGUOUS
    assert back.t_end == pytest.approx(forth.phases[-1].t0, abs=1e-3)


def test_an_impact_is_not_undone():
    run = ball().simulate((1.0, 0.0), {"x": 0.0, "y": 1.0, "x_dot": 0.5, "y_dot": 0.0}, BALL)
    assert run.status is Status.CONTACT_AMBIGUOUS
    assert run.t_end == pytest.approx(1.0 - np.sqrt(2 / G), rel=1e-12) and len(run.phases) == 1


def test_what_is_about_to_be_struck_comes_from_above():
    start = {"x": 0.0, "y": 0.0, "x_dot": 0.5, "y_dot": -3.0}
    run = ball().simulate((1.0, 0.8), start, BALL, t_eval=[1.0, 0.9, 0.8])
    back = 1.0 - run.t
    assert run.status is Status.SUCCESS
    np.testing.assert_allclose(run["y"], 3.0 * back - G / 2 * back**2, atol=1e-12)
    at_rest = ball().simulate((1.0, 0.0), {**start, "y_dot": 0.0}, BALL)
    assert at_rest.status is Status.SUCCESS and at_rest.phases[0].modes == {"ground": "closed"}
