"""Expressions that oscillate many times within one step: in free flight steps are as long as the span."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from scipy.optimize import brentq
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

import dalembert as da

TIME = dynamicsymbols._t
G, AMPLITUDE, RATE = 9.81, 0.02, 20.0
y, (m, e, a, w) = dynamicsymbols("y"), sp.symbols("m e a w", positive=True)
SHAKEN = {m: 0.3, a: AMPLITUDE, w: RATE}


def floor(t):
    return AMPLITUDE * np.sin(RATE * t)


@cache
def shaken():
    """A ball over a floor that moves as a sin(w t)."""
    frame, origin = ReferenceFrame("N"), Point("O")
    ball = origin.locatenew("P", y * frame.y)
    scene = da.Scene("shaken", frame=frame, origin=origin, coordinates=[y])
    scene.add_bodies(Particle("ball", ball, m))
    scene.apply_uniform_gravity(-G * frame.y)
    normal = da.unknowns("normal")
    scene.add_joints(da.Joint("floor", body="ball", at=ball, force=normal * frame.y))
    gap = y - a * sp.sin(w * TIME)
    scene.add_contacts(da.UnilateralContact(normal, gap=gap, restitution=e, name="floor"))
    return da.compile_model(scene, outputs=["normal"])


def impacts(restitution, height, end, most):
    """Return the times of the first impacts of a ball dropped at time zero, and when the ball comes to rest or None."""
    t, place, speed, found = 0.0, height, 0.0, []
    while len(found) < most:

        def gap(s, t=t, place=place, speed=speed):
            return place + speed * (s - t) - G / 2 * (s - t) ** 2 - floor(s)

        relative = speed - AMPLITUDE * RATE * np.cos(RATE * t)
        grid = t + np.concatenate([np.geomspace(0.01, 1, 60) * max(relative, 1e-3) / 20.0, np.arange(1e-3, end, 1e-3)])
        below = np.flatnonzero(gap(grid) < 0)
        if grid[below[0]] > end:
            break
        hit = brentq(gap, grid[below[0] - 1] if below[0] else t, grid[below[0]], xtol=1e-15)
        moving = AMPLITUDE * RATE * np.cos(RATE * hit)
        place, speed, t = floor(hit), moving - restitution * (speed - G * (hit - t) - moving), hit
        found.append(hit)
    return found


@pytest.mark.parametrize("method", ["taylor", "dop853"])
@pytest.mark.parametrize("restitution", [0.1, 0.2, 0.3, 0.5])
def test_a_ball_does_not_fall_through_a_floor_that_shakes(method, restitution):
    """The flights after the impacts begin at a gap of zero, and the floor oscillates ten times in what is left."""
    run = shaken().simulate((0, 3), {y: 0.5, y.diff(): 0}, {**SHAKEN, e: restitution}, method=method, rtol=1e-10)
    assert run.success
    assert run.phases[-1].modes == {"floor": "closed"}
    expected = impacts(restitution, 0.5, 3.0, 5)
    np.testing.assert_allclose([phase.t0 for phase in run.phases][1:6], expected, rtol=0, atol=1e-8)
    assert run["y"][-1] == pytest.approx(floor(3.0), abs=1e-12)
    assert run["normal"][-1] == pytest.approx(0.3 * (G - AMPLITUDE * RATE**2 * np.sin(RATE * 3.0)), rel=1e-9)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_balls_over_floors_that_shake_fast_fly_and_rest_above_them(method):
    """They leave the floor without a rate or a second rate of the gap, each from where it shakes them off."""
    rng = np.random.default_rng(5)
    values = {e: rng.uniform(0, 1, 60), a: 10 ** rng.uniform(-4, -1, 60), w: 10 ** rng.uniform(0.5, 2.3, 60)}
    start = {y: rng.uniform(0.2, 0.6, 60), y.diff(): 0}
    kept = {"gap": da.minimum(y - a * sp.sin(w * TIME))}
    sweep = shaken().sweep((0, 5), start, {m: 0.3, **values}, method=method, reduce=kept)
    np.testing.assert_array_equal(sweep.status, 0)
    assert np.min(sweep.reduced["gap"]) > -1e-9


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_outputs_of_cases_whose_whole_motion_is_prescribed_at_the_end(method):
    sweep = shaken().sweep((0, 3), {y: 0.5, y.diff(): 0}, {**SHAKEN, e: np.array([0.3, 0.8])}, method=method)
    assert sweep.mode("floor").tolist() == ["closed", "open"]
    expected = 0.3 * (G - AMPLITUDE * RATE**2 * np.sin(RATE * 3.0))
    np.testing.assert_allclose(sweep.final["normal"], [expected, 0.0], rtol=1e-9)
    assert sweep.final["y"][0] == pytest.approx(floor(3.0), abs=1e-12)


phase, rate, level = sp.symbols("phase rate level", real=True)
NUMBERS = {
    rate: np.geomspace(10, 100, 100),
    phase: np.linspace(0, 6, 100),
    level: np.tile([0.3, 0.7, 0.9, 0.99], 25),
}
ABOVE = da.Event(y + sp.sin(rate * TIME + phase) - level, name="crossed")
END = 8.0


@cache
def drifting(backend="llvm"):
    """A particle that keeps its velocity: one step takes it to the end."""
    frame, origin = ReferenceFrame("N"), Point("O")
    scene = da.Scene("drifting", frame=frame, origin=origin, coordinates=[y])
    scene.add_bodies(Particle("particle", origin.locatenew("P", y * frame.y), m))
    return da.compile_model(scene, backend=backend)


def crossings(case):
    """Return the times at which sin(rate t + phase) passes the level."""
    w, begin, top = (NUMBERS[name][case] for name in (rate, phase, level))
    turns, angle = 2 * np.pi * np.arange(-1, int(w * END)), np.arcsin(top)
    times = (np.concatenate([angle + turns, np.pi - angle + turns]) - begin) / w
    return np.sort(times[(times > 0) & (times < END)])


@pytest.mark.parametrize("method", ["taylor", "dop853"])
@pytest.mark.parametrize("case", [2, 30, 51, 67, 83, 95, 99])
def test_no_event_is_missed_in_a_step_that_has_many(method, case):
    values = {m: 1, **{name: numbers[case] for name, numbers in NUMBERS.items()}}
    run = drifting().simulate((0, END), {y: 0, y.diff(): 0}, values, method=method, events=[ABOVE])
    np.testing.assert_allclose(run.events["crossed"].t, crossings(case), rtol=0, atol=1e-9)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_no_event_of_a_sweep_is_missed_in_a_step_that_has_many(method):
    sweep = drifting().sweep((0, END), {y: 0, y.diff(): 0}, {m: 1, **NUMBERS}, method=method, events=[ABOVE])
    found, expected = sweep.events["crossed"], [crossings(case) for case in range(100)]
    np.testing.assert_array_equal(found.count, [len(times) for times in expected])
    np.testing.assert_allclose(found.first, [times[0] for times in expected], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.last, [times[-1] for times in expected], rtol=0, atol=1e-9)


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_thousands_of_events_in_one_step_are_all_found(backend):
    numbers, start = {m: 1, rate: 2250.0, phase: 0.1, level: 0.3}, {y: 0, y.diff(): 0}
    w, angle, turns = 2250.0, np.arcsin(0.3), 2 * np.pi * np.arange(3000)
    times = np.sort((np.concatenate([angle + turns, np.pi - angle + turns]) - 0.1) / w)
    times = times[times < END]
    model = drifting(backend)
    sweep = model.sweep((0, END), start, numbers, events=[ABOVE])
    assert sweep.events["crossed"].count.tolist() == [len(times)]
    run = model.simulate((0, END), start, numbers, events=[ABOVE])
    np.testing.assert_allclose(run.events["crossed"].t, times, rtol=0, atol=1e-9)


@pytest.mark.parametrize("backend", ["llvm", "numpy"])
def test_no_maximum_is_missed_in_a_step_that_has_many(backend):
    """sin(rate t + phase) + v t is largest where its rate vanishes last, or at the end."""
    model, speed = drifting(backend), 0.01
    some = {name: numbers[:: 10 if backend == "numpy" else 1] for name, numbers in NUMBERS.items() if name != level}
    kept = {"top": da.maximum(y + sp.sin(rate * TIME + phase)), "bottom": da.minimum(sp.sin(rate * TIME + phase) - y)}
    sweep = model.sweep((0, END), {y: 0, y.diff(): speed}, {m: 1, **some}, reduce=kept)
    for case, (w, begin) in enumerate(zip(some[rate], some[phase], strict=True)):
        angles = np.arccos(-speed / w) + 2 * np.pi * np.arange(int(w * END / 6) + 3)
        times = np.concatenate([[0.0, END], (angles - begin) / w])
        times = times[(times >= 0) & (times <= END)]
        assert sweep.reduced["top"][case] == pytest.approx(np.max(speed * times + np.sin(w * times + begin)), abs=1e-9)
        times = np.concatenate([[0.0, END], (2 * np.pi - np.arccos(speed / w) + angles - angles[0] - begin) / w])
        times = times[(times >= 0) & (times <= END)]
        expected = np.min(np.sin(w * times + begin) - speed * times)
        assert sweep.reduced["bottom"][case] == pytest.approx(expected, abs=1e-9)


@cache
def tumbling():
    """A rod of length 2 that falls on a floor, which stops its ends without friction or restitution."""
    frame, origin = ReferenceFrame("N"), Point("O")
    theta = dynamicsymbols("theta")
    rod = frame.orientnew("R", "Axis", (theta, frame.z))
    centre = origin.locatenew("G", y * frame.y)
    scene = da.Scene("tumbling", frame=frame, origin=origin, coordinates=[y, theta])
    scene.add_bodies(RigidBody("rod", centre, rod, 1, (inertia(rod, 0, 0, sp.Rational(1, 3)), centre)))
    scene.apply_uniform_gravity(-G * frame.y)
    for name, side in (("left", -1), ("right", 1)):
        end, normal = centre.locatenew(name, side * rod.x), da.unknowns(f"N_{name}")
        scene.add_joints(da.Joint(name, body="rod", at=end, force=normal * frame.y))
        scene.add_contacts(da.UnilateralContact(normal, gap=y + side * sp.sin(theta), name=name))
    return da.compile_model(scene)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_a_rod_that_tumbles_fast_meets_the_floor(method):
    """The first end that comes down ends the flight, of up to 90 radians in one step."""
    speeds, heights = np.linspace(5, 60, 12), np.tile([3.0, 5.0, 12.0], 4)
    grid = np.linspace(0, 1.6, 160_001)
    for spin, height in zip(speeds, heights, strict=True):
        model, start = tumbling(), {"y": height, "y_dot": 0, "theta": 0.1, "theta_dot": spin}
        run = model.simulate((0, 1.6), start, {}, method=method, rtol=1e-9)
        gap = height - G / 2 * grid**2 - abs(np.sin(0.1 + spin * grid))
        met = grid[np.argmax(gap < 0)] if np.any(gap < 0) else 1.6
        assert run.phases[0].t1 == pytest.approx(met, abs=1.1e-5)
