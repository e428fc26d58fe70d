"""Stops of joints and of expressions, against closed forms, and their faults."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import (
    Particle,
    PinJoint,
    Point,
    PrismaticJoint,
    ReferenceFrame,
    RigidBody,
    SphericalJoint,
    dynamicsymbols,
    inertia,
)

import dalembert as da
from dalembert.errors import SceneError
from system.test_joints_between_bodies import mechanism

m, g, e = sp.symbols("m g e", positive=True)
N, O = ReferenceFrame("N"), Point("O")


def compiled(scene, outputs):
    return da.compile_model(scene, outputs=outputs, backend="numpy", cache=False)


def test_a_rod_that_comes_to_rest_on_a_stop():
    """The stop has the moment of the weight, and the pin the weight."""
    N, O = ReferenceFrame("N"), Point("O")
    ground, rod = RigidBody("ground", masscenter=O, frame=N), RigidBody("rod", mass=m)
    rod.central_inertia = inertia(rod.frame, 0, 0, m / 12)
    scene = da.Scene("rod", frame=N, origin=O)
    scene.add_joints(PinJoint("pin", ground, rod, child_point=-rod.x / 2, joint_axis=N.z))
    scene.add_joints(da.Stop("stop", "pin", lower=-1, upper=1))
    scene.apply_uniform_gravity(-g * N.y)
    model = compiled(scene, ["stop.lower", "stop.upper", "pin.force_x", "pin.force_y"])
    run = model.simulate((0, 1), {"q_pin": 0, "q_pin_dot": 0}, {m: 2, g: 9.81}, rtol=1e-10)
    assert [phase.modes["stop.lower"] for phase in run.phases] == ["open", "closed"]
    assert run["q_pin"][-1] == pytest.approx(-1, abs=1e-10)
    assert run["stop.lower"][-1] == pytest.approx(2 * 9.81 * np.cos(1) / 2, abs=1e-9)
    assert [run[f"pin.force_{axis}"][-1] for axis in "xy"] == pytest.approx([0, 2 * 9.81], abs=1e-9)
    assert not run["stop.upper"].any() and not run["stop.lower"][0]
    speed = np.sqrt(2 * 9.81 * np.sin(1) / 2 / (1 / 3))  # where it arrives, by its energy
    arrived = run.phases[0].t1
    assert np.abs(run["q_pin_dot"][run.t <= arrived]).max() == pytest.approx(speed, abs=1e-7)


def test_a_bead_that_bounces_between_stops():
    """At constant speed v to and fro, slower by the restitution at each."""
    N, O = ReferenceFrame("N"), Point("O")
    ground, bead = RigidBody("ground", masscenter=O, frame=N), Particle("bead", mass=m)
    scene = da.Scene("bead", frame=N, origin=O)
    scene.add_joints(PrismaticJoint("wire", ground, bead, joint_axis=N.x))
    scene.add_contacts(da.Stop("ends", "wire", lower=0, upper=1, restitution=e))
    run = compiled(scene, ()).simulate((0, 6), {"q_wire": 0.5, "u_wire": 1.0}, {m: 2, e: 0.5}, rtol=1e-10)
    assert [phase.t1 for phase in run.phases[:2]] == pytest.approx([0.5, 2.5], abs=1e-9)
    assert run["q_wire"][-1] == pytest.approx(0.25 * 3.5, abs=1e-9)


def test_a_stop_of_an_expression():
    """A cart that leans on a wall with its drive."""
    x, F = dynamicsymbols("x"), sp.Symbol("F")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("cart", P, m))
    scene.add_loads((P, F * N.x))
    scene.add_joints(da.Stop("wall", x, upper=1, body="cart", at=P, direction=N.x))
    run = compiled(scene, ["wall.upper"]).simulate((0, 2), {x: 0, "x_dot": 0}, {m: 2, F: 3.0}, rtol=1e-10)
    assert run.phases[1].t0 == pytest.approx(np.sqrt(2 / 1.5), abs=1e-9)
    assert run["x"][-1] == pytest.approx(1, abs=1e-12) and run["wall.upper"][-1] == pytest.approx(3.0, abs=1e-12)


def test_a_stop_of_a_four_bar_starts_without_the_rates_that_the_loop_gives():
    """Runs and sweeps of the open contact are those of the linkage alone."""
    scene, _, start, p = mechanism("four_bar")
    free, stopped = scene.copy(), scene.copy()
    angle, upper = stopped.coordinates[2], start["c"] + 0.05
    stopped.add_joints(da.Stop("stop", angle, lower=0, upper=upper, body="rocker", axis=stopped.frame.z))
    model = compiled(stopped, ["stop.upper"])
    alone = compiled(free, ()).simulate((0, 0.02), start, p)
    run = model.simulate((0, 0.02), start, p)
    assert run.qdot[0] == pytest.approx(alone.qdot[0], rel=1e-13)
    assert run.q[-1] == pytest.approx(alone.q[-1], rel=1e-7)
    sweep = model.sweep((0, 0.02), {**start, "a_dot": np.array([2.0, start["a_dot"]])}, p)
    assert sweep.success.all() and sweep["c"][1] == pytest.approx(alone.q[-1][2], rel=1e-7)
    run = model.simulate((0, 0.5), start, p)
    assert run.success and run.q[:, 2].max() == pytest.approx(upper, abs=1e-8)


def test_contacts_that_are_apart_are_open_at_a_start_and_the_others_give_a_rate():
    """A bead on a floor, left to fall, has a wall in some distance."""
    x, y = dynamicsymbols("x y")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("corner", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("bead", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_joints(da.Stop("wall", x, upper=1, body="bead", at=P, direction=N.x))
    scene.add_joints(da.Stop("floor", y, lower=0, body="bead", at=P, direction=N.y))
    model = compiled(scene, ["floor.lower"])
    run = model.simulate((0, 0.5), {x: 0, y: 0, x.diff(): 1.0}, {m: 2, g: 9.81})
    assert run["x"][-1] == pytest.approx(0.5, abs=1e-9) and not run["y"].any()
    assert run["floor.lower"] == pytest.approx(2 * 9.81, rel=1e-12)


def test_faults():
    N, O, x = ReferenceFrame("N"), Point("O"), dynamicsymbols("x")
    ground, rod, bead = RigidBody("ground", masscenter=O, frame=N), RigidBody("rod"), Particle("bead")
    scene = da.Scene("faults", frame=N, origin=O)
    scene.add_joints(SphericalJoint("ball", ground, rod), PrismaticJoint("wire", rod, bead, x, joint_axis=rod.x))
    for given, text in (
        ({"of": "wire"}, "it has no limit: give lower=, upper= or both"),
        ({"of": "knee", "lower": 0}, "'knee' is no SymPy joint of the scene; known: ball, wire"),
        (
            {"of": "ball", "lower": 0},
            "'ball' is a SphericalJoint, whose coordinates are not those of a force or torque",
        ),
        ({"of": "wire", "lower": 0, "axis": N.z}, "the joint 'wire' says where it acts; leave out axis"),
        (
            {"of": "wire", "lower": 0, "coordinate": sp.Symbol("z")},
            "coordinate= must be one of the coordinates of 'wire' (x)",
        ),
        ({"of": x, "lower": 0}, "body= is missing: the body that the stop pushes"),
        ({"of": x, "lower": 0, "body": "rod"}, "give at= and direction= of a force, or axis= of a torque"),
        (
            {"of": 3, "lower": 0, "body": "rod", "axis": N.z},
            "it limits 3: give the name of a SymPy joint, or an expression",
        ),
    ):
        with pytest.raises(SceneError) as caught:
            scene.add_joints(da.Stop("stop", **given))
        assert text in str(caught.value)
