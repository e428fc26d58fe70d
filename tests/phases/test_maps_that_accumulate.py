"""Events that map the state ever faster end runs of scenes with contacts, as they end those of scenes without."""

import pytest
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
