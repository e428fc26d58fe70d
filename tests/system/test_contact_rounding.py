"""What rounding leaves of a zero decides nothing: tolerances, sweeps and events find the same phases.

At these parameters a normal reaction changes its side, a contact opens, or a plate starts at rest on its supports, and
what should be zero there has the wrong sign in one run or another.
"""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from hard_cases.contacts import contact_motion

MOTIONS = {
    "sides": (
        "plate pushed and pulled",
        {"m": 0.895018678991601, "g": 8.97484543976896, "mu": 0.727080778872385},
        {},
    ),
    "opens": (
        "plate that lifts off",
        {"m": 0.917987819007741, "g": 10.30645690241316, "mu_Q": 0.218275103935925},
        {},
    ),
    "starts apart": (
        "plate with two frictions that slides back",
        {"m": 1.14033544904912, "g": 10.097147239064693, "mu_A": 0.113196981970479, "mu_Q": 0.13727562459885406},
        {"theta_dot": 0.84236455676461},
    ),
    "starts struck": (
        "plate with two frictions that slides back",
        {"m": 1.059197003351675, "g": 10.101013262873236, "mu_A": 0.090374021034091, "mu_Q": 0.1431977890409774},
        {"theta_dot": 1.1255463709535718},
    ),
}


@pytest.mark.parametrize("what", MOTIONS)
def test_phases_do_not_depend_on_rounding(what):
    name, parameters, initial = MOTIONS[what]
    motion = contact_motion(name).motion
    model, end = motion.compile("auto"), max(motion.values)
    p = {str(key): float(value) for key, value in motion.parameters.items()} | parameters
    start = {str(key): float(value) for key, value in motion.initial.items()} | initial
    exact = model.simulate((0, end), start, p, rtol=1e-13, atol=1e-15)
    assert exact.success
    names = (*model.layout.coordinates, *model.layout.rates)
    for rtol in (1e-8, 1e-10, 1e-12):
        tolerances = {"rtol": rtol, "atol": 1e-2 * rtol}
        for events in ([], [motion.scene.coordinates[0] - 1e3]):
            run = model.simulate((0, end), start, p, events=events, **tolerances)
            assert [phase.modes for phase in run.phases] == [phase.modes for phase in exact.phases]
            np.testing.assert_allclose([run[n][-1] for n in names], [exact[n][-1] for n in names], atol=100 * rtol)
        sweep = model.sweep((0, end), start, p | {"m": np.full(3, p["m"])}, **tolerances)
        assert sweep.success.all() and (sweep.phases == len(exact.phases)).all()
        found = np.array([sweep.final[n] for n in names])
        np.testing.assert_allclose(found, np.tile([[exact[n][-1]] for n in names], 3), atol=100 * rtol)


def test_phases_of_cases_that_come_to_rest_are_those_of_single_runs():
    motion = contact_motion("bouncing ball").motion
    model, e = motion.compile("auto"), np.array([0.5, 0.8])
    run = model.simulate((0, 12), motion.initial, motion.parameters | {"e": 0.8})
    sweep = model.sweep((0, 12), motion.initial, motion.parameters | {"e": e})
    assert sweep.success.all() and run.success and sweep.phases[1] == len(run.phases)
    assert len(run.phases) > 30 and (sweep.mode(*run.phases[-1].modes) == "closed").all()


def test_hops_end_at_rest_however_small_they_are():
    """After 2 v / (g (1 - e)), or at once where the hops are shorter than 1e-12 of the span; events kick it, too."""
    motion = contact_motion("bouncing ball").motion
    model, y = motion.compile("auto"), motion.scene.coordinates[1]
    g, p = 9.81, {str(key): float(value) for key, value in motion.parameters.items()} | {"g": 9.81}
    start = {"x": 0.0, "y": 0.0, "x_dot": 0.25, "y_dot": 0.0}
    v, hops = (grid.ravel() for grid in np.meshgrid(np.logspace(-17, -4, 40), [0.0, 0.5]))
    v, hops = np.append(v, 3e-9), np.append(hops, 0.999)
    for end in (1.0, 100.0):
        sweep = model.sweep((0, end), start | {"y_dot": v}, p | {"e": hops})
        assert sweep.success.all() and not sweep["y"].any() and not sweep["y_dot"].any()
        np.testing.assert_allclose(sweep["x"], 0.25 * end, rtol=1e-12)
    for i in range(2, 80, 7):
        run = model.simulate((0, 100), start | {"y_dot": v[i]}, p | {"e": hops[i]})
        assert run.success and run.phases[-1].modes == {"ground": "closed"}
        assert run.phases[-1].t0 == pytest.approx(2.0 * v[i] / (g * (1.0 - hops[i])), rel=1e-6, abs=4e-10)
    kick = da.Event(dynamicsymbols._t - 1, apply={y.diff(): 1e-12}, name="kick")
    run = model.simulate((0, 100), start, p | {"e": 0.5}, events=[kick])
    sweep = model.sweep((0, 100), start, p | {"e": np.full(2, 0.5)}, events=[kick])
    assert run.success and sweep.success.all() and len(run.events["kick"]) == 1 and run["y_dot"][-1] == 0.0


def test_what_comes_to_rest_does_so_in_every_unit_of_length():
    """In micrometres, rounding leaves 1e-10 of a velocity that vanishes, where a hundredth of that counts as rest."""
    model = da.compile_model(da.scenes.corner_plate(friction=True))
    ends = []
    for metre in (1.0, 1e3, 1e6, 1e8):
        start = {"x": -0.5 * metre / np.tan(0.6), "theta": 0.6, "theta_dot": 1.0}
        given = {"m": 1, "l": metre, "h": 0.5 * metre, "g": 9.81 * metre, "F_A": 0, "mu": 0.8}
        run = model.simulate((0, 1), start, given)
        sweep = model.sweep((0, 1), start, given | {"mu": np.full(2, 0.8)})
        assert run.success and sweep.success.all()
        assert [phase.modes["corner"] for phase in run.phases] == ["slip", "stick"]
        ends += [run["x"][-1] / metre, sweep.final["x"][1] / metre]
    np.testing.assert_allclose(ends, ends[0], rtol=1e-7)


def test_a_block_stops_wherever_it_started_and_however_fast():
    """Where it comes to rest, no speed is left to compare rounding with, and the way that it went may be short."""
    x, y = dynamicsymbols("x y")
    mu = sp.Symbol("mu", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("block", P, 2))
    scene.apply_uniform_gravity(-9.81 * N.y)
    n, f = da.unknowns("n f")
    scene.add_joints(da.Joint("floor", body="block", at=P, force=n * N.y + f * N.x))
    scene.add_contacts(da.UnilateralContact(n, gap=y, name="floor"))
    scene.add_friction(da.CoulombFriction(n, f, mu=mu, name="floor"))
    model = da.compile_model(scene)
    speeds, frictions = np.logspace(-8, 0, 9), np.array([0.3, 1.0, 1e3, 1e5])
    v, m = (grid.ravel() for grid in np.meshgrid(speeds, frictions))
    ended = model.sweep((0, 2), {x: 0, y: 0, x.diff(): v, y.diff(): 0}, {mu: m})
    assert ended.success.all()
    np.testing.assert_allclose(ended.final["x"], v**2 / (2 * m * 9.81), rtol=1e-9)
    run = model.simulate((0, 2), {x: 0, y: 0, x.diff(): 1e-4, y.diff(): 0}, {mu: 0.3})
    assert run.success and run.mode("floor")[-1] == "stick"


@pytest.mark.parametrize("method", ["dop853", "tsit5", "taylor"])
def test_a_gap_that_opens_without_speed_stays_open_whatever_the_steps(method):
    """It leaves zero as the third power of time, from what rounding leaves of zero in projected positions."""
    name, parameters, _ = MOTIONS["opens"]
    motion = contact_motion(name).motion
    model = motion.compile("auto")
    p = {str(key): float(value) for key, value in motion.parameters.items()} | parameters
    start = {str(key): float(value) for key, value in motion.initial.items()}
    whole = model.simulate((0, max(motion.values)), start, p, rtol=1e-10, atol=1e-12, method="dop853")
    t = float(whole.phases[1].t0)
    opened = {n: float(whole(np.array([t]))[n][0]) for n in (*model.layout.coordinates, *model.layout.rates)}
    for step in (1e-12, 1e-11, 1e-9, 1e-7, 1e-5):
        for rtol in (1e-4, 1e-12):
            run = model.simulate((t, t + 30 * step), opened, p, rtol=rtol, atol=rtol, max_step=step, method=method)
            assert run.success and len(run.phases) == 1


@pytest.fixture(scope="module")
def far_belt():
    """A block on a belt that a spring pulls, whose end moves with the belt and by 0.5 m/s more."""
    x, y, t = *dynamicsymbols("x y"), dynamicsymbols._t
    speed, place = sp.symbols("speed place", real=True)
    frame, origin = ReferenceFrame("N"), Point("O")
    point = origin.locatenew("B", x * frame.x + y * frame.y)
    scene = da.Scene("far belt", frame=frame, origin=origin, coordinates=[x, y])
    scene.add_bodies(Particle("block", point, 1))
    scene.add_loads((point, -2 * (x - place - speed * t - t / 2) * frame.x - 10 * frame.y))
    normal, friction = da.unknowns("N F")
    scene.add_joints(da.Joint("belt", body="block", at=point, force=friction * frame.x + normal * frame.y))
    scene.add_holonomic_constraints(y)
    scene.add_friction(da.CoulombFriction(normal, friction, slip=x.diff() - speed, mu=0.3, mu_static=0.5, name="belt"))
    return da.compile_model(scene)


@pytest.mark.parametrize("method", ["dop853", "tsit5", "taylor"])
@pytest.mark.parametrize(("speed", "place"), [(0.0, 0.0), (1e3, 0.0), (0.0, 1e6), (1e3, 1e6)])
def test_slips_do_not_depend_on_the_frame(far_belt, speed, place, method):
    """The block slips at 5 s, and sticks after the time that the notes of `belt_oscillator` give."""
    start, p = {"x": place, "y": 0.0, "x_dot": speed, "y_dot": 0.0}, {"speed": speed, "place": place}
    run = far_belt.simulate((0, 20), start, p, rtol=1e-11, atol=1e-11, method=method, max_steps=10**6)
    slips = np.sqrt(2.0) * (np.pi - np.arctan(2.0 * np.sqrt(2.0)))
    assert run.success and [phase.modes["belt"] for phase in run.phases] == ["stick", "slip"] * 3
    np.testing.assert_allclose([phase.t0 for phase in run.phases][:3], [0.0, 5.0, 5.0 + slips], atol=1e-5)


def incline(plane):
    """Return the model of a block on a rough incline, x uphill, with friction along x or in the plane."""
    m, g, mu, tilt = sp.symbols("m g mu tilt", positive=True)
    x, y, z = dynamicsymbols("x y z")
    N, O = ReferenceFrame("N"), Point("O")
    block = O.locatenew("P", x * N.x + (y * N.y if plane else 0) + z * N.z)
    scene = da.Scene("incline", frame=N, origin=O, coordinates=[x, y, z] if plane else [x, z])
    scene.add_bodies(Particle("block", block, m))
    scene.apply_uniform_gravity(-g * (sp.cos(tilt) * N.z + sp.sin(tilt) * N.x))
    press, along, across = da.unknowns("R T U")
    force = press * N.z + along * N.x + (across * N.y if plane else 0)
    scene.add_joints(da.Joint("floor", body="block", at=block, force=force))
    scene.add_contacts(da.UnilateralContact(press, gap=z, name="floor"))
    scene.add_friction(da.CoulombFriction(press, (along, across) if plane else along, mu=mu, name="floor"))
    return da.compile_model(scene)


@pytest.mark.parametrize("plane", [False, True])
def test_a_block_that_stops_where_its_weight_is_the_slip_limit_stays(plane):
    """With mu = tan(tilt) it stays, and its mass decides nothing; its deceleration is 2 g sin(tilt) before."""
    model, start = incline(plane), dict.fromkeys(("x", "y", "z", "x_dot", "y_dot", "z_dot"), 0.0)
    start = {name: start[name] for name in model.layout.variables}
    for tilt in (0.3, 0.5, np.arctan(0.3)):
        masses = np.outer(10.0 ** np.arange(-6, 7), [1.0, 1.7, 3.7]).ravel()
        p = {"m": 1.0, "g": 9.81, "tilt": tilt, "mu": np.tan(tilt)}
        for speed, phases in ((-0.0, ["stick"]), (1.0, ["slip", "stick"])):
            for mass in masses:
                run = model.simulate((0, 1), start | {"x_dot": speed}, p | {"m": mass}, rtol=1e-10, atol=1e-12)
                assert run.success and [phase.modes["floor"] for phase in run.phases] == phases, (tilt, mass, speed)
                assert run["x_dot"][-1] == 0.0
                np.testing.assert_allclose(run["x"][-1], speed**2 / (4 * 9.81 * np.sin(tilt)), rtol=1e-9)
            sweep = model.sweep((0, 1), start | {"x_dot": speed}, p | {"m": masses}, rtol=1e-10, atol=1e-12)
            assert sweep.success.all() and (sweep.phases == len(phases)).all() and not sweep["x_dot"].any()


@pytest.mark.parametrize("share", [1e-12, 1e-8])
def test_a_block_just_beyond_the_slip_limit_slides(share):
    """What is beyond rounding decides: a share of the friction force accelerates it downhill."""
    model, start = incline(False), {"x": 0.0, "z": 0.0, "x_dot": 0.0, "z_dot": 0.0}
    p = {"m": 2.54, "g": 9.81, "tilt": 0.3}
    run = model.simulate((0, 1), start, p | {"mu": np.tan(0.3) * (1.0 - share)})
    assert [phase.modes["floor"] for phase in run.phases] == ["slip"]
    np.testing.assert_allclose(run["x_dot"][-1], -9.81 * np.sin(0.3) * share, rtol=1e-3)


def test_a_block_at_rest_up_to_rounding_sticks():
    """Speeds that rounding leaves are shares of the positions in the span; what is beyond slips."""
    model, p = incline(False), {"m": 2.0, "tilt": 0.3, "mu": 0.5}
    for metre in (1e-6, 1.0, 1e6):
        for speed, phases in ((1e-48, ["stick"]), (-1e-17, ["stick"]), (1e-12, ["slip", "stick"])):
            start = {"x": 0.3 * metre, "z": 0.0, "x_dot": speed * metre, "z_dot": -1e-3 * abs(speed) * metre}
            run = model.simulate((0, 1.5), start, p | {"g": 9.81 * metre}, atol=1e-10 * min(metre, 1.0))
            assert run.success and [phase.modes["floor"] for phase in run.phases] == phases, (metre, speed)


@pytest.fixture(scope="module")
def sprung_row():
    """Three masses on a line before a wall, each at a spring that is relaxed at the wall; they do not rebound."""
    places, stiffnesses, masses = dynamicsymbols("x1:4"), sp.symbols("k1:4"), sp.symbols("m1:4")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("row", frame=N, origin=O, coordinates=list(places))
    points = [O.locatenew(f"P{i}", x * N.x) for i, x in enumerate(places)]
    for i, (x, P) in enumerate(zip(places, points, strict=True)):
        R = da.unknowns(f"R{i}")
        scene.add_bodies(Particle(f"body{i}", P, masses[i]))
        scene.add_loads((P, -stiffnesses[i] * x * N.x))
        scene.add_joints(da.Joint(f"c{i} right", body=f"body{i}", at=P, force=R * N.x))
        if i:
            scene.add_joints(da.Joint(f"c{i} left", body=f"body{i - 1}", at=points[i - 1], force=-R * N.x))
        scene.add_contacts(da.UnilateralContact(R, gap=x - (places[i - 1] if i else 0), name=f"c{i}"))
    return da.compile_model(scene)


@pytest.mark.parametrize("mass", [0.01, 3.0])
@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
def test_what_strikes_bodies_at_rest_without_a_force_stays_at_them(sprung_row, mass, rtol):
    """The reactions are zero from then on, up to what rounding of the place makes of the spring force."""
    start = {"x1": 0, "x2": 0, "x3": 0.2, "x1_dot": 0, "x2_dot": 0, "x3_dot": 0}
    values = {"k1": 24, "k2": 13, "k3": np.linspace(20, 60, 64), "m1": mass, "m2": 1.5, "m3": 2.2}
    cases = sprung_row.sweep((0, 2), start, values, rtol=rtol, atol=1e-2 * rtol)
    assert cases.success.all()
    for contact in ("c0", "c1", "c2"):
        assert (cases.mode(contact) == "closed").all()
    assert np.max(np.abs([cases[x] for x in ("x1", "x2", "x3")])) < 1e-15
