"""Contacts decided by little: derivatives of reactions, the edge of a cone, the last of infinitely many impacts."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from dalembert.methods.status import Status
from fuzz.contacts.compare import examine
from fuzz.contacts.families import Case
from fuzz.contacts.scenes import compiled, setting

TIGHT = {"rtol": 1e-10, "atol": 1e-12}
AT_REST = {"x": 0.0, "y": 0.0, "x_dot": 0.0, "y_dot": 0.0}
MASS_ON_FLOOR = dict.fromkeys(setting("particle").parameters, 0.0) | {"m": 1.0, "omega": 1.0, "nu": 1.0, "mu": 0.3}
DISC = dict.fromkeys(setting("disc").parameters, 0.0) | {"m": 1.0, "omega": 1.0, "nu": 1.0, "g_z": 9.81}
CHAIN = dict.fromkeys(setting("chain").parameters, 0.0) | {"omega": 1.0}
PLATE = {"m": 1.0, "I": 0.25, "b": 0.3, "h": 0.7, "g": 9.81, "mu": 0.8, "A": 0.0, "omega": 1.0, "phi": 0.0}


def run(scene, parameters, initial, span, **more):
    model = compiled(scene)
    used = {name: parameters[name] for name in model.layout.parameters}
    return model.simulate((0.0, span), initial, used, **(TIGHT | more))


def words(motion):
    return [tuple(phase.modes.values()) for phase in motion.phases]


def assert_agrees(case):
    report = examine(case, steps=800)
    assert report.outcome == "agree", (report.found, str(case))


# -- a normal reaction that is 0 where it is decided -----------------------------------------------


def test_a_force_that_grows_from_zero_lifts():
    """m y'' = c t: N(0) = 0, and its derivative decides; y = c t^3 / 6."""
    motion = run("particle", MASS_ON_FLOOR | {"B": 3.0}, AT_REST, 2.0)
    assert motion.success and words(motion)[-1] == ("open",)
    assert motion["y"][-1] == pytest.approx(4.0, abs=1e-9)
    assert np.max(np.abs(motion["R"])) == 0.0


def test_a_force_that_grows_from_zero_presses():
    motion = run("particle", MASS_ON_FLOOR | {"B": -3.0}, AT_REST, 2.0)
    assert motion.success and words(motion)[-1] == ("stick",)
    assert motion["y"][-1] == 0.0 and motion["R"][-1] == pytest.approx(6.0)


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_a_short_lift_before_the_first_sample_of_a_step(method):
    """N = -eps t + t^3 - ... is negative for 3 % of the span; y = (eps/6 - 1) t^3 - 6 sin t + 6 t until it lands."""
    eps = 1e-3
    loads = MASS_ON_FLOOR | {"B": eps - 6.0, "C": 6.0}
    end = brentq(lambda t: (eps / 6.0 - 1.0) * t**3 - 6.0 * math.sin(t) + 6.0 * t, 0.03, 0.09)
    motion = run("particle", loads, AT_REST, 1.0, method=method)
    assert words(motion) == [("open",), ("stick",)]
    assert motion.phases[0].t1 == pytest.approx(end, rel=1e-6)
    assert np.min(motion["R"]) >= 0.0


@pytest.mark.parametrize("k, c", [(3.0, 4.0), (4.0, 3.0)])
def test_the_third_derivative_of_a_reaction_decides(k, c):
    """C sin(nu t) - C nu t is -C nu^3 t^3 / 6 + ...: it lifts for C < 0, and presses for C > 0."""
    for C in (-k, k):
        p = MASS_ON_FLOOR | {"C": C, "nu": c, "B": -C * c}
        motion = run("particle", p, AT_REST, 1.0)
        assert motion.success
        exact = -C * (math.sin(c) / c**2 - 1.0 / c + c / 6.0) if C < 0 else 0.0
        assert motion["y"][-1] == pytest.approx(exact, abs=1e-8)
        assert words(motion)[-1] == (("open",) if C < 0 else ("stick",))


@pytest.mark.parametrize("speed", [1.0, -1.0])
def test_two_sprung_masses_through_their_common_rest_position(speed):
    """They touch with R = 0 and part, x_i = v / w_i sin(w_i t), if R would fall; else both swing as one."""
    p = CHAIN | {"m1": 1.0, "m2": 1.0, "m3": 1.0, "k1": 9.0, "k2": 4.0, "k3": 1.0, "a1": 2.0, "a2": 2.0, "a3": 9.0}
    start = {"x1": 2.0, "x2": 2.0, "x3": 9.0, "x1_dot": speed, "x2_dot": speed, "x3_dot": 0.0}
    motion = run("chain", p, start, 0.4)
    assert motion.success
    if speed > 0:  # the first is the stiffer one, and falls behind
        expected = 2.0 + np.array([math.sin(1.2) / 3.0, math.sin(0.8) / 2.0])
        assert words(motion)[-1] == ("open", "open", "open")
    else:
        w = math.sqrt(6.5)
        expected = np.full(2, 2.0 - math.sin(0.4 * w) / w)
        assert words(motion)[-1] == ("open", "closed", "open")
    np.testing.assert_allclose(motion.q[-1, :2], expected, atol=1e-9)
    assert np.min(motion["R2"]) >= -1e-9


def test_two_sprung_masses_part_where_their_springs_rest():
    """Pressed together at first, they part at the rest position, where R changes its sign."""
    p = CHAIN | {"m1": 1.0, "m2": 1.0, "m3": 1.0, "k1": 9.0, "k2": 4.0, "k3": 1.0, "a1": 2.0, "a2": 2.0, "a3": 9.0}
    start = {"x1": 1.7, "x2": 1.7, "x3": 9.0, "x1_dot": 0.0, "x2_dot": 0.0, "x3_dot": 0.0}
    motion = run("chain", p, start, 1.0)
    w = math.sqrt(6.5)
    parts, speed = 0.5 * math.pi / w, 0.3 * w
    assert words(motion) == [("open", "closed", "open"), ("open", "open", "open")]
    assert motion.phases[1].t0 == pytest.approx(parts, abs=1e-8)
    expected = 2.0 + speed * np.array([math.sin(3.0 * (1 - parts)) / 3.0, math.sin(2.0 * (1 - parts)) / 2.0])
    np.testing.assert_allclose(motion.q[-1, :2], expected, atol=1e-8)


def test_friction_in_a_slot_whose_load_grows_from_zero():
    """m x'' = -mu |B sin(nu t)| while it slips forwards."""
    p = dict.fromkeys(setting("slot").parameters, 0.0) | {"m": 2.0, "B": 10.0, "nu": 3.0, "mu": 0.4, "omega": 1.0}
    motion = run("slot", p, AT_REST | {"x_dot": 2.0}, 0.5)
    lost = 0.4 * 10.0 / 2.0 * (1 - math.cos(1.5)) / 3.0
    assert motion.success and motion["x_dot"][-1] == pytest.approx(2.0 - lost, abs=1e-9)


# -- no friction ----------------------------------------------------------------------------------


def test_nothing_sticks_without_friction():
    """A plate on two feet with mu = 0 swings under 14 sin(w t) as if it were in the air."""
    p = PLATE | {"mu": 0.0, "A": 1.4, "omega": 5.6, "h": 0.1}
    start = {"x": 0.0, "y": 0.1, "theta": 0.0, "x_dot": 0.0, "y_dot": 0.0, "theta_dot": 0.0}
    motion = run("plate", p, start, 2.0)
    assert motion.success and set(words(motion)) == {("slip", "slip")}
    assert motion["x"][-1] == pytest.approx(1.4 / 5.6 * (2.0 - math.sin(11.2) / 5.6), abs=1e-9)


# -- friction in a plane --------------------------------------------------------------------------


@pytest.mark.parametrize("place", [(0.0, 0.2), (0.02, -0.25)])
@pytest.mark.parametrize("at", ["rest", "the belt's speed"])
@pytest.mark.parametrize("mu", [0.1, 0.3])
def test_a_particle_on_a_belt_at_a_spring(place, at, mu):
    p = DISC | {"k_x": 20.0, "k_y": 20.0, "u_x": 0.4, "mu": mu}
    start = {"x": place[0], "y": place[1], "z": 0.0, "x_dot": 0.0 if at == "rest" else 0.4, "y_dot": 0.0, "z_dot": 0.0}
    assert_agrees(Case("disc", p, start, 2.0))


def test_slip_in_a_plane_begins_where_the_spring_overcomes_friction():
    """It rides on the belt until k |r| = mu m g."""
    p = DISC | {"k_x": 20.0, "k_y": 20.0, "u_x": 0.4, "mu": 0.3}
    start = {"x": 0.0, "y": 0.1, "z": 0.0, "x_dot": 0.4, "y_dot": 0.0, "z_dot": 0.0}
    motion = run("disc", p, start, 1.0)
    assert motion.success and words(motion)[:2] == [("stick",), ("slip",)]
    limit = 0.3 * 9.81 / 20.0
    assert motion.phases[0].t1 == pytest.approx(math.sqrt(limit**2 - 0.01) / 0.4, abs=1e-9)


def test_oblique_impacts_with_friction_in_a_plane():
    """The slip after is u (1 - mu P / (m |u|)) with P = m (1 + e) |w|, or zero where that factor is negative."""
    e, mu, m, g = 0.5, 0.4, 1.7, 9.81
    factor = np.repeat(np.array([-0.5, -0.1, -1e-3, 1e-3, 0.01, 0.05, 0.1, 0.15, 0.2, 0.25, 0.5, 0.9]), 6)
    angle = np.tile(np.array([0.0, 0.3, 1.2, 2.5, -0.9, -2.2]), 12)
    drop, low, belt = 0.2, -1.0, np.array([0.3, -0.2])
    w = math.sqrt(low**2 + 2.0 * g * drop)
    size = mu * (1.0 + e) * w / (1.0 - factor)
    direction = np.stack([np.cos(angle), np.sin(angle)])
    u = size * direction
    p = DISC | {"m": m, "mu": mu, "e": e, "u_x": belt[0], "u_y": belt[1]}
    start = {"x": 0.0, "y": 0.0, "z": drop, "x_dot": u[0] + belt[0], "y_dot": u[1] + belt[1], "z_dot": low}
    model = compiled("disc")
    used = {name: p[name] for name in model.layout.parameters}
    end = (w + low) / g + 0.05
    sweep = model.sweep((0.0, end), start, used, **TIGHT)
    assert set(sweep.status) == {Status.SUCCESS}
    after = np.maximum(factor, 0.0) * u + belt[:, None]
    np.testing.assert_allclose(np.stack([sweep["x_dot"], sweep["y_dot"]]), after, atol=1e-9)
    np.testing.assert_allclose(sweep["z_dot"], e * w - 0.05 * g, atol=1e-9)
    for i in range(0, len(factor), 7):
        motion = model.simulate((0.0, end), {name: float(np.broadcast_to(x, 72)[i]) for name, x in start.items()}, used)
        assert motion.success
        np.testing.assert_allclose(motion.qdot[-1, :2], after[:, i], atol=1e-7)


def test_a_contact_that_slides_into_an_impact_has_the_coefficient_of_slip():
    """With mu P < m |u| < mu_static P it slides on."""
    p = MASS_ON_FLOOR | {"g_y": 10.0, "mu": 0.3, "mu_s": 0.6, "e": 0.5}
    speed = 2.0  # at the floor, so that P = 3
    start = {"x": 0.0, "y": 0.2, "x_dot": 1.2, "y_dot": 0.0}
    motion = run("particle static", p, start, 0.3)
    assert motion.success
    assert motion["x_dot"][-1] == pytest.approx(1.2 - 0.3 * 1.5 * speed, abs=1e-9)


def test_a_wheel_that_rolls_against_a_smooth_wall_spins_on():
    """No impulse presses it to the floor, so that it keeps its spin; friction then takes it, and pushes to the wall."""
    m, r, I, mu, g, v = 1.0, 0.5, 0.1, 0.4, 9.81, 2.0
    p = dict.fromkeys(setting("wheel").parameters, 0.0)
    p |= {"m": m, "I": I, "r": r, "g_y": g, "omega": 1.0, "mu": mu, "x_wall": 1.5}
    start = {"x": 0.0, "y": r, "theta": 0.0, "x_dot": v, "y_dot": 0.0, "theta_dot": -v / r}
    hits, spin = 1.0 / v, v / r
    rests = hits + spin * I / (mu * m * g * r)
    motion = run("wheel", p, start, 1.0)
    assert motion.success
    assert [floor for floor, _ in words(motion)] == ["stick", "slip", "stick"]
    assert [phase.t0 for phase in motion.phases[1:]] == pytest.approx([hits, rests], abs=1e-9)
    turned = spin * hits + spin * (rests - hits) / 2.0
    np.testing.assert_allclose(motion.q[-1], [1.0, r, -turned], atol=1e-9)
    assert motion([0.5 * (hits + rests)])["R_w"][0] == pytest.approx(mu * m * g)


# -- infinitely many impacts -----------------------------------------------------------------------


def test_a_ball_comes_to_rest():
    """At sqrt(2 H / g) (1 + e) / (1 - e), after which it stays, and slides on."""
    e, g, H = 0.5, 9.81, 0.3
    p = MASS_ON_FLOOR | {"g_y": g, "mu": 0.0, "e": e}
    motion = run("particle", p, {"x": 0.0, "y": H, "x_dot": 1.0, "y_dot": 0.0}, 3.0)
    assert motion.success, motion.message
    rests = math.sqrt(2.0 * H / g) * (1.0 + e) / (1.0 - e)
    assert words(motion)[-1] == ("slip",) and motion.phases[-1].t0 == pytest.approx(rests, abs=1e-6)
    assert motion["y"][-1] == pytest.approx(0.0, abs=1e-9) and motion["R"][-1] == pytest.approx(g)
    assert motion["x"][-1] == pytest.approx(3.0, abs=1e-9)


@pytest.mark.parametrize("mu", [0.125, 0.8])
def test_a_plate_rocks_to_rest(mu):
    theta = 0.05
    start = {"x": 0.0, "theta": theta, "x_dot": 0.0, "y_dot": 0.0, "theta_dot": 0.0}
    start["y"] = 0.3 * math.sin(theta) + 0.7 * math.cos(theta)
    motion = run("plate", PLATE | {"mu": mu}, start, 3.0, max_steps=100_000)
    assert motion.success, motion.message
    assert words(motion)[-1] == ("stick", "stick")
    assert motion["theta"][-1] == pytest.approx(0.0, abs=1e-8) and motion["y"][-1] == pytest.approx(0.7, abs=1e-8)
    assert motion["R_left"][-1] + motion["R_right"][-1] == pytest.approx(9.81)
    assert_agrees(Case("plate", PLATE | {"mu": mu}, start, 3.0))


@pytest.mark.parametrize("mu, mu_wall", [(0.0, 0.0), (0.2, 0.3), (0.4, 0.0)])
def test_a_rod_lies_down_in_a_corner(mu, mu_wall):
    """It slides down, and its upper end comes to the floor in the corner or after it has left the wall."""
    for theta in (-1.2, -0.2):
        l = 0.8
        p = {"m": 1.0, "l": l, "g": 9.81, "A": 0.0, "omega": 1.0, "mu": mu, "mu_wall": mu_wall}
        start = {"x": l * math.cos(theta), "y": -l * math.sin(theta), "theta": theta}
        start |= {"x_dot": 0.0, "y_dot": 0.0, "theta_dot": 0.0}
        assert_agrees(Case("rod in corner", p, start, 1.0))


def test_a_block_rests_in_a_slot_whose_load_turns():
    p = dict.fromkeys(setting("slot").parameters, 0.0) | {"m": 1.0, "B": 2.0, "nu": 7.3, "mu": 0.3, "omega": 1.0}
    motion = run("slot", p, AT_REST, 3.0)
    assert motion.success and set(words(motion)) == {("stick",)}
    assert np.max(np.abs(motion.y)) == 0.0


def test_a_rod_in_two_slots_starts_at_the_turning_point_of_an_end():
    """The slip there is zero for an instant, and no friction can hold it."""
    p = {"m": 2.0, "l": 0.9, "g": 10.0, "A": 0.0, "omega": 1.0, "mu": 0.2, "mu_wall": 0.1}
    start = {"x": 0.9, "y": 0.0, "theta": 0.0, "x_dot": 0.0, "y_dot": 1.8, "theta_dot": -2.0}
    assert_agrees(Case("trammel", p, start, 1.0))


def test_a_plate_that_sticks_on_two_feet_tips():
    """Where F h = m g b; it sticks on the other foot."""
    p = PLATE | {"mu": 0.9, "A": 6.0, "omega": 0.8}
    start = {"x": 0.0, "y": 0.7, "theta": 0.0, "x_dot": 0.0, "y_dot": 0.0, "theta_dot": 0.0}
    motion = run("plate", p, start, 1.2)
    assert motion.success and words(motion) == [("stick", "stick"), ("open", "stick")]
    assert motion.phases[1].t0 == pytest.approx(math.asin(9.81 * 0.3 / 0.7 / 6.0) / 0.8, abs=1e-9)
    assert motion["theta"][-1] < 0.0


def test_a_foot_that_lands_takes_the_other_one_off():
    """Of the impulses that the laws allow, trial finds one: the left foot sticks, the right one leaves."""
    p = {"m": 1.673, "I": 0.3402, "b": 0.471, "h": 0.623, "g": 9.81, "mu": 0.43, "A": 7.4, "omega": 5.885, "phi": 0.0}
    theta = -0.232
    start = {"x": 0.0, "theta": theta, "x_dot": 0.0, "y_dot": 0.0, "theta_dot": 0.0}
    start["y"] = p["b"] * math.sin(-theta) + p["h"] * math.cos(theta)
    assert_agrees(Case("plate", p, start, 0.5))


def test_a_wheel_at_a_smooth_wall_rolls_away_when_its_motor_reverses():
    """T sin(omega t) presses it to the wall, at rest, until t = pi / omega."""
    p = dict.fromkeys(setting("wheel").parameters, 0.0)
    p |= {"m": 1.0, "I": 0.1, "r": 0.5, "g_y": 9.81, "T": -0.8, "omega": 4.0, "mu": 0.5, "x_wall": 0.5}
    start = {"x": 0.0, "y": 0.5, "theta": 0.0, "x_dot": 0.0, "y_dot": 0.0, "theta_dot": 0.0}
    motion = run("wheel", p, start, 1.2)
    away = math.pi / 4.0
    assert motion.success and motion.phases[-1].t0 == pytest.approx(away, abs=1e-7)
    assert words(motion)[-1] == ("stick", "open")
    s = 1.2 - away
    angle = 0.8 / (0.1 + 0.25) * (s / 4.0 - math.sin(4.0 * s) / 16.0)
    np.testing.assert_allclose(motion.q[-1], [-0.5 * angle, 0.5, angle], atol=1e-8)


def test_a_wall_stops_a_wheel_that_a_belt_drives():
    # once the wall holds the wheel, belt and wall can only slip together but for the speed of the belt
    m, I, r, belt, mu, mu_wall = 2.0, 0.2, 0.3, 0.3, 0.25, 0.7
    x_dot, theta_dot = 1.0, 0.8
    run = compiled("wheel").simulate(
        (0.0, 0.5),
        {"x": 0.0, "y": r, "theta": 0.0, "x_dot": x_dot, "y_dot": 0.0, "theta_dot": theta_dot},
        {"m": m, "I": I, "r": r, "g_x": 0.0, "g_y": 9.81, "belt": belt, "T": 0.0, "omega": 1.0, "A": 0.0}
        | {"mu": mu, "mu_wall": mu_wall, "x_wall": r + 0.01, "e": 0.0},
    )
    after = 1 + int(np.flatnonzero(np.diff(run.t) == 0.0)[0])
    before = run.qdot[after - 1]
    floor = I * before[2] / r / (1.0 - mu)  # normal impulses: the wall's friction presses the wheel on the belt
    wall = m * before[0] + mu * floor
    assert floor < mu_wall * wall
    np.testing.assert_allclose(run.qdot[after], 0.0, atol=1e-12)
    assert run.status is Status.SUCCESS


@pytest.mark.parametrize("method", ["auto", "dop853", "radau"])
def test_slip_in_a_plane_that_ends_below_its_rest_speed(method):
    """A load that is beyond the limit of friction for 0.03 s, by 3e-4 of it.

    The body slips at 4e-5 m/s at most, which is a rest speed at rtol 1e-6. It stops where the load has been below the
    limit for as long as its speed takes to fall: its impulse beyond the limit, divided by the mass, is the slip speed.
    """
    p = {"m": 2.148, "g_z": 9.81, "k_x": 18.967, "k_y": 17.753, "A": 8.727, "omega": 4.97, "C": 1.543, "nu": 3.022}
    p |= {"mu": 0.809, "e": 0.0, "c": 0.0, "g_x": 0.0, "g_y": 0.0, "u_x": 0.0, "u_y": 0.0}
    start = {"x": 0.346, "y": -0.151, "z": 0.126, "x_dot": 0.0, "y_dot": 0.0, "z_dot": 0.0}
    run = compiled("disc").simulate((0, 2), start, p, rtol=1e-6, atol=1e-8, method=method, max_steps=30_000)
    assert run.success, run.message
    assert [phase.modes["plane"] for phase in run.phases] == ["open", "stick", "slip", "stick"]
    np.testing.assert_allclose(run.qdot[-1], 0.0, atol=1e-14)

    def excess(t):
        f_x = p["A"] * np.cos(p["omega"] * t) - p["k_x"] * 0.3561032
        f_y = p["A"] * np.sin(p["omega"] * t) + p["k_y"] * 0.1215590
        return np.hypot(f_x, f_y) - p["mu"] * (p["m"] * p["g_z"] - p["C"] * np.sin(p["nu"] * t))

    t = np.linspace(run.phases[2].t0, 0.6, 20_001)
    assert excess(t[0]) == pytest.approx(0.0, abs=1e-4)
    if method == "radau":
        speed = np.cumsum(excess(t)) * (t[1] - t[0]) / p["m"]
        ended = t[(speed < 0.0) & (t > t[0] + 0.01)][0]  # at first there is less than rounding of the positions
        assert run.phases[2].t1 == pytest.approx(ended, abs=1e-3)
