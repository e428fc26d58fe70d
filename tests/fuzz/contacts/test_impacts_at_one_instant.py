"""Several things that happen at one instant: impacts in turn, an impact and a lift, contacts that rest without load."""

import math

import numpy as np
import pytest

from fuzz.contacts.impact_sequences import impacts_in_turn
from fuzz.contacts.invariants import rows_at
from fuzz.contacts.scenes import compiled, setting

CHAIN = dict.fromkeys(setting("chain").parameters, 0.0) | {"omega": 1.0, "m1": 1.0, "m2": 1.0, "m3": 1.0}
CHAIN |= {"k1": 1.0, "k2": 1.0, "k3": 1.0, "a3": 5.0}  # the springs of the first two rest at the wall
FAR = {"x3": 5.0, "x3_dot": 0.0}


def runs(scene, parameters, initial, span):
    """Return runs at three tolerances, and a sweep at the last."""
    model = compiled(scene)
    used = {name: parameters[name] for name in model.layout.parameters}
    found = [model.simulate((0.0, span), initial, used, rtol=r, atol=1e-2 * r) for r in (1e-6, 1e-8, 1e-10)]
    name = next(iter(initial))
    sweep = model.sweep((0.0, span), initial | {name: np.full(3, initial[name])}, used, rtol=1e-10, atol=1e-12)
    return found, sweep


def words(motion):
    return [tuple(phase.modes.values()) for phase in motion.phases]


def assert_same(found, sweep):
    assert all(motion.success for motion in found) and np.all(sweep.success), found[-1].message
    assert words(found[0]) == words(found[1]) == words(found[2])
    assert set(sweep.phases) == {len(found[2].phases)}


@pytest.mark.parametrize("gap", [0.0, 1e-12, 1e-3])
def test_two_masses_that_run_into_a_wall_stop(gap):
    """Without restitution, whether they touch or not; afterwards they rest without any load."""
    start = {"x1": 0.3, "x2": 0.3 + gap, "x1_dot": -1.0, "x2_dot": -1.0} | FAR
    found, sweep = runs("chain", CHAIN, start, 1.0)
    assert_same(found, sweep)
    for motion in found:
        assert words(motion)[-1] == ("closed", "closed", "open")
        assert motion.phases[-1].t0 == pytest.approx(math.atan(0.3 + gap), abs=1e-5)
        np.testing.assert_allclose(motion.q[-1], [0.0, 0.0, 5.0], atol=1e-14)
        np.testing.assert_allclose(motion.qdot[-1], 0.0, atol=1e-14)


@pytest.mark.parametrize("e_wall", [0.0, 0.5])
def test_masses_whose_load_vanishes_where_they_hit_a_wall(e_wall):
    """Two masses at springs that rest at the wall: one reaction vanishes there, as the other mass hits it.

    Newton's law sends both back together, since what touches is pushed; with e = 0 they rest there without load.
    """
    p = CHAIN | {"k2": 3.0, "e_wall": e_wall}
    start = {"x1": 0.2, "x2": 0.2, "x1_dot": 0.0, "x2_dot": 0.0} | FAR
    found, sweep = runs("chain", p, start, 3.0)
    assert_same(found, sweep)
    omega = math.sqrt(2.0)
    first = math.pi / (2.0 * omega)
    for motion in found:
        assert motion.phases[1].t0 == pytest.approx(first, abs=1e-6)
        x = 0.2 * e_wall * math.sin(omega * (3.0 - first)) if e_wall else 0.0
        np.testing.assert_allclose(motion.q[-1, :2], x, atol=1e-6)
    assert words(found[2]) == [("open", "closed", "open"), ("closed" if e_wall == 0.0 else "open", "closed", "open")]


@pytest.mark.parametrize("ratio", [1e-6, 1e-16, 1e-24])
def test_a_light_mass_that_a_heavy_one_strikes_leaves_it_twice_as_fast(ratio):
    """Elastically: at rest, on its way to meet the heavy one, or after it has come back from the wall with 3 m/s."""
    p = CHAIN | {"k1": 1e-40, "k2": 1e-40, "k3": 1e-40, "m1": ratio, "e_wall": 1.0, "e": 1.0}
    for light, meets, end in ((0.0, 0.0, 1.2), (0.5, 0.5, 1.2), (-3.0, 3.0, 3.1)):
        start = {"x1": 5.0, "x2": 5.5, "x1_dot": light, "x2_dot": -1.0} | FAR | {"x3": 9.0}
        found, sweep = runs("chain", p, start, end)
        assert_same(found, sweep)
        for motion in found:
            exact = ((ratio - 1.0) * meets - 2.0) / (1.0 + ratio)
            np.testing.assert_allclose(motion["x1_dot"][-1], exact, rtol=1e-12)
            assert motion["x2_dot"][-1] == pytest.approx(exact + meets + 1.0, abs=1e-12)


def test_infinitely_many_impacts_at_one_instant_end_at_rest():
    """A heavy mass drives a light one against a wall, faster and faster; what is left of it rests without load."""
    p = CHAIN | {"m1": 0.483, "m2": 2.641, "k1": 0.483, "k2": 2.641, "e_wall": 0.312, "e": 0.083}
    start = {"x1": 0.02, "x2": 0.03, "x1_dot": -2.0, "x2_dot": -2.0} | FAR
    found, sweep = runs("chain", p, start, 1.0)
    assert_same(found, sweep)
    for motion in found:
        assert words(motion)[-1] == ("closed", "closed", "open")
        np.testing.assert_allclose(motion.q[-1, :2], 0.0, atol=1e-12)
        assert not np.any(motion.qdot[-1, :2])


def test_friction_that_has_nothing_to_hold_is_none():
    """A link that lies against a wall cannot slip along it while its joint holds: it sticks, whatever rounding says."""
    p = dict.fromkeys(setting("pendulum").parameters, 0.0) | {"m_1": 2.8, "m_2": 1.4, "l_1": 1.0, "l_2": 0.6}
    p |= {"g": 9.81, "d": -0.1, "omega": 4.2, "mu_elbow": 0.5}
    angle = math.asin(-0.1)
    for rate in (0.0, 1.7, 2.713):
        start = {"a": angle - 0.05, "b": angle - 0.3, "a_dot": rate, "b_dot": 0.5}
        found, sweep = runs("pendulum", p, start, 0.4)
        assert_same(found, sweep)
        assert not any("slip" in mode[1] for motion in found for mode in words(motion))


def test_a_phase_that_begins_at_the_end_is_none():
    """It slides with x' = -0.6 and stops after exactly 3 s, which is the end."""
    p = dict.fromkeys(setting("particle").parameters, 0.0)
    p |= {"m": 1.8, "g_y": 2.0, "omega": 1.0, "nu": 1.0, "mu": 0.1, "mu_s": 0.1}
    found, sweep = runs("particle", p, {"x": 0.4, "y": 0.0, "x_dot": -0.6, "y_dot": 0.0}, 3.0)
    assert_same(found, sweep)


def test_a_jump_is_recognized_as_impacts_in_turn():
    """The light one is struck by the heavy one, and then hits the wall; no order of impacts gives more than that."""
    names = setting("chain").parameters
    p = np.array([(CHAIN | {"e_wall": 0.5, "e": 0.2})[name] for name in names])
    before = np.array([0.1, -1.0, 0.0])
    rows = rows_at("chain", 0.0, np.array([1e-15, 1e-15, 5.0]), before, p)
    first = np.array([-0.56, -0.34, 0.0])  # momentum, and a relative rate of 0.2 times 1.1
    second = np.array([0.28, -0.34, 0.0])
    assert impacts_in_turn(rows, before, first) and impacts_in_turn(rows, before, second)
    assert not impacts_in_turn(rows, before, np.array([0.4, -0.34, 0.0]))
    assert not impacts_in_turn(rows, before, np.array([-0.45, -0.45, 0.0]))


def test_a_rod_that_hangs_along_a_wall_hits_it_with_its_tip():
    """The elbow touches the wall, and the impulse at the tip below it is across the rod.

    The elbow is at rest after the impact whether it takes a part of the impulse or none, so that this is one motion. At
    rtol 1e-6 the rod is vertical to the last bit, and the rates after the impact are roundings of zero.
    """
    p = {"m_1": 2.6, "m_2": 0.4, "l_1": 0.7, "l_2": 0.6, "g": 9.81, "d": -0.1, "A": 5.6, "omega": 6.2, "c": 0.2}
    start = {"a": -0.9, "b": -1.2, "a_dot": 2.8, "b_dot": 1.0}
    found, sweep = runs("pendulum", p | {"mu": 0.3, "e": 0.0, "mu_elbow": 0.0}, start, 1.0)
    assert_same(found, sweep)
    assert words(found[2])[1:3] == [("open", "slip"), ("stick", "slip")]


def test_a_wheel_struck_between_wall_and_belt_slips_on_both_in_opposite_ways():
    """It lies against the wall and falls on a belt: the rotation that follows is faster than the wall, not the belt.

    Impulses P of the floor, mu P of its friction and so of the wall, and -mu mu_wall P of the wall's friction.
    """
    p = {"m": 2.5, "I": 0.3125, "r": 0.5, "g_x": 4.4, "g_y": 9.81, "belt": 0.8, "T": 0.0, "omega": 6.6, "A": 0.0}
    p |= {"mu": 0.7, "mu_wall": 0.3, "x_wall": 0.9, "e": 0.0}
    start = {"x": 0.4, "y": 0.5, "theta": 0.0, "x_dot": 0.0, "y_dot": -0.25, "theta_dot": 0.28}
    found, sweep = runs("wheel", p, start, 0.01)
    assert_same(found, sweep)
    push = p["m"] * 0.25 / (1.0 - 0.7 * 0.3)
    after = 0.28 + p["r"] * (0.7 - 0.7 * 0.3) * push / p["I"]
    assert 0.0 < p["r"] * after < p["belt"]
    for motion in found:
        assert words(motion)[0] == ("slip", "slip")
        np.testing.assert_allclose(motion(1e-9).qdot[0], [0.0, 0.0, after], atol=1e-7)


def test_a_pendulum_that_hangs_along_a_wall_leaves_it_whatever_rounding_says():
    """Both masses lie against the wall until the moment turns at pi / omega; then both leave it.

    The tip is at a dead centre, where its slip turns back. That roundings of the angles put that a little earlier or
    later must not matter.
    """
    p = {"m_1": 2.3, "m_2": 1.2, "l_1": 0.5, "l_2": 0.4, "g": 9.81, "d": -0.0, "A": 8.9, "omega": 4.7, "c": 0.4}
    p |= {"mu": 0.3, "e": 0.0, "mu_elbow": 0.3}
    start = {"a": -0.9, "b": -0.2, "a_dot": 2.7, "b_dot": -0.5}
    model = compiled("pendulum")
    ends = []
    for rtol in np.logspace(-6, -12, 25):
        run = model.simulate((0.0, 1.5), start, p, rtol=rtol, atol=1e-2 * rtol)
        assert run.success
        assert words(run)[-1] == ("open", "open")
        assert run.phases[-1].t0 == pytest.approx(math.pi / 4.7, abs=1e-6)
        ends.append(run.qdot[-1])
    np.testing.assert_allclose(ends, [ends[-1]] * len(ends), atol=2e-6)
