"""Events that map the state ever faster end runs of scenes with contacts, as they end those of scenes without."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status


def bouncing(contact):
    """Return a particle that an event turns back at y = 0, with a contact far away or without."""
    x, y = dynamicsymbols("x y")
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("particle", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("particle", P, 1))
    scene.add_loads((P, -10 * N.y))
    if contact:
        R = da.unknowns("R")
        scene.add_joints(da.Joint("wall", body="particle", at=P, force=R * N.x))
        scene.add_contacts(da.UnilateralContact(R, x + 5, name="wall", restitution=0))
    return da.compile_model(scene), y


@pytest.mark.parametrize("contact", [False, True])
@pytest.mark.parametrize("ratio", [0.5, 0.9])
def test_a_particle_does_not_fall_through_where_its_bounces_end(contact, ratio):
    model, y = bouncing(contact)
    floor = da.Event(y, direction=-1, apply={y.diff(): -ratio * y.diff()}, name="floor")
    start = {"x": 0, "y": 0.3, "x_dot": 0, "y_dot": 0}
    run = model.simulate((0, 20), start, {}, events=[floor])
    sweep = model.sweep((0, 20), start | {"y": [0.3, 0.3]}, {}, events=[floor])
    fall = (2 * 0.3 / 10) ** 0.5
    end = fall * (1 + ratio) / (1 - ratio)
    assert run.status == sweep.status[0] == Status.EVENTS_ACCUMULATE
    assert run.t[-1] == pytest.approx(end, rel=1e-6) and sweep.t[0] == pytest.approx(end, rel=1e-6)
    assert abs(run["y"][-1]) < 1e-12 and abs(sweep["y"][0]) < 1e-12
    assert len(run.events["floor"]) == sweep.events["floor"].count[0]


def test_a_second_run_begins_anew():
    """Times of earlier jumps are those of a run; two maps at one time are not two that follow each other."""
    model, y = bouncing(True)
    floor = da.Event(y, direction=-1, apply={y.diff(): -y.diff()}, name="floor")
    drag = da.Event(y - 1e-30, direction=-1, apply={"x_dot": 1}, name="drag")
    for _ in range(2):
        run = model.simulate((0, 1), {"x": 0, "y": 0.3, "x_dot": 0, "y_dot": 0}, {}, events=[floor, drag])
        assert run.status == Status.SUCCESS and len(run.events["floor"]) == len(run.events["drag"]) == 2


def bead():
    """Return a bead on a rough ring in a vertical plane, pushed along x, that an event turns back where y = -0.4241."""
    x, y = dynamicsymbols("x y")
    radius, t = sp.Float("0.627"), dynamicsymbols._t
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("ring", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bead", P, sp.Float("2.263")))
    push = sp.Float("13.715") * sp.sin(sp.Float("7.317") * t)
    scene.add_loads((P, push * N.x - sp.Float("22.2") * N.y))
    H, F = da.unknowns("H F")
    outward, along = (x * N.x + y * N.y) / radius, (x * N.y - y * N.x) / radius
    scene.add_joints(da.Joint("ring", body="bead", at=P, force=F * along + H * outward))
    scene.add_holonomic_constraints((x**2 + y**2 - radius**2) / (2 * radius))
    scene.add_friction(da.CoulombFriction(H, F, mu=sp.Float("0.554"), name="ring"))
    kick = {rate: -sp.Float("0.7") * rate for rate in (x.diff(), y.diff())}
    return da.compile_model(scene), da.Event(y + sp.Float("0.4241"), direction=-1, apply=kick, name="kick")


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10])
def test_a_reversal_of_slip_between_kicks_does_not_let_a_bead_pass(tolerance):
    """Where it is turned back for the last time, it slides up and down again within rounding: two phases."""
    model, kick = bead()
    angle = -2.186 - 0.01 * np.arange(12)
    starts = {"x": 0.627 * np.cos(angle), "y": 0.627 * np.sin(angle)}
    starts |= {"x_dot": 2.117 * np.sin(angle), "y_dot": -2.117 * np.cos(angle)}
    sweep = model.sweep((0, 2), starts, {}, events=[kick], rtol=tolerance, atol=tolerance)
    assert list(sweep.status) == [Status.EVENTS_ACCUMULATE] * 12
    assert np.all(np.abs(sweep["y"] + 0.4241) < 1e-13)
    for i in range(0, 12, 4):
        start = {name: values[i] for name, values in starts.items()}
        run = model.simulate((0, 2), start, {}, events=[kick], rtol=tolerance, atol=tolerance)
        assert run.status == Status.EVENTS_ACCUMULATE
        assert len(run.events["kick"]) == sweep.events["kick"].count[i]
        assert run.t[-1] == pytest.approx(sweep.t[i], rel=1e-6)
