"""Guards that begin at zero without a rate and bend down: normal reactions, gaps, limits of friction."""

import math
from functools import cache

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.events.event_rules import bend_from_rates, deepest_dip, leaves_zero, short_share

pytestmark = pytest.mark.filterwarnings("ignore:no coordinate or rate:dalembert.errors.PrecisionWarning")

TIME = dynamicsymbols._t
BENDS = (0.3, 0.1, 0.03, 0.01, 0.004)
TOLERANCES = (1e-6, 1e-8, 1e-10)
b, c = sp.symbols("b c", real=True)


def scene(name):
    frame, origin = ReferenceFrame("N"), Point("O")
    x, y = dynamicsymbols("x y")
    made = da.Scene(name, frame=frame, origin=origin, coordinates=[x, y])
    return made, frame, origin.locatenew("P", x * frame.x + y * frame.y), x, y


@cache
def lifted():
    """A particle on a floor: R = -b s^2 + c s^3 with s the place along the floor, which is the time."""
    made, N, P, x, y = scene("lifted")
    R = da.unknowns("R")
    made.add_bodies(Particle("body", P, 1))
    made.add_loads((P, (b * x**2 - c * x**3) * N.y))
    made.add_joints(da.Joint("floor", body="body", at=P, force=R * N.y))
    made.add_contacts(da.UnilateralContact(R, gap=y, name="floor"))
    return da.compile_model(made, outputs=["R"])


@cache
def hollow():
    """A particle without weight before a wall -b x^4 + c x^5, that recedes first: it flies straight on."""
    made, N, P, x, y = scene("hollow")
    R = da.unknowns("R")
    gap = y + b * x**4 - c * x**5
    made.add_bodies(Particle("body", P, 1))
    made.add_joints(da.Joint("wall", body="body", at=P, force=R * (N.y + sp.diff(gap, x) * N.x)))
    made.add_contacts(da.UnilateralContact(R, gap=gap, name="wall"))
    return da.compile_model(made, outputs=["R"])


@cache
def dragged():
    """A particle of weight 1 on a rough floor (mu = 1), pulled by 1 + b t^2 - c t^3."""
    made, N, P, x, y = scene("dragged")
    R, F = da.unknowns("R F")
    made.add_bodies(Particle("body", P, 1))
    made.add_loads((P, (1 + b * TIME**2 - c * TIME**3) * N.x - N.y))
    made.add_joints(da.Joint("floor", body="body", at=P, force=F * N.x + R * N.y))
    made.add_contacts(da.UnilateralContact(R, gap=y, name="floor"))
    made.add_friction(da.CoulombFriction(R, F, slip=x.diff(TIME), mu=1, name="floor"))
    return da.compile_model(made, outputs=["R", "F"])


@cache
def sprung():
    """Two equal masses at equal springs, which pass their common rest position; one is pulled by b x^2 - c x^3."""
    frame, origin = ReferenceFrame("N"), Point("O")
    x, z = dynamicsymbols("x z")
    made = da.Scene("sprung", frame=frame, origin=origin, coordinates=[x, z])
    A, B = origin.locatenew("A", x * frame.x), origin.locatenew("B", z * frame.x)
    R = da.unknowns("R")
    made.add_bodies(Particle("left", A, 1), Particle("right", B, 1))
    made.add_loads((A, -4 * x * frame.x), (B, (-4 * z + b * z**2 - c * z**3) * frame.x))
    made.add_joints(da.Joint("back", body="left", at=A, force=-R * frame.x))
    made.add_joints(da.Joint("forth", body="right", at=B, force=R * frame.x))
    made.add_contacts(da.UnilateralContact(R, gap=z - x, name="touch"))
    return da.compile_model(made, outputs=["R"])


def sprung_meet(bend):
    """Return when the masses meet again, by SciPy."""

    def rates(t, state):
        z, speed = state
        return speed, -4.0 * z + bend * z**2 - z**3

    def gap(t, state):
        return 1e12 * (state[0] - 0.5 * math.sin(2.0 * t)) if t > 0.5 * bend else 1.0

    gap.terminal = True
    found = solve_ivp(rates, (0.0, 1.0), [0.0, 1.0], "DOP853", rtol=3e-14, atol=1e-30, max_step=0.002, events=gap)
    return float(found.t_events[0][0])


@cache
def waves():
    """A particle on a floor: R = x^2 cos(b x), and a step may hold many of its waves."""
    made, N, P, x, y = scene("waves")
    R = da.unknowns("R")
    made.add_bodies(Particle("body", P, 1))
    made.add_loads((P, -(x**2) * sp.cos(b * x) * N.y))
    made.add_joints(da.Joint("floor", body="body", at=P, force=R * N.y))
    made.add_contacts(da.UnilateralContact(R, gap=y, name="floor"))
    return da.compile_model(made, outputs=["R"])


CASES = {
    "a lifting force": (lifted, ("open", "closed"), lambda bend: 5.0 * bend / 3.0),
    "a wall that recedes": (hollow, ("open", "closed"), lambda bend: bend),
    "a pull at the limit of friction": (dragged, ("slip", "stick"), lambda bend: 4.0 * bend / 3.0),
}


def states(model):
    first, second = model.layout.coordinates
    speeds = {f"{first}_dot": 0.0 if model is dragged() else 1.0, f"{second}_dot": 0.0}
    if model is sprung():
        speeds[f"{second}_dot"] = 1.0
    return {first: 0.0, second: 0.0} | speeds


def phases(motion):
    """Return when a contact enters other modes, and these, without what lasts less than 10 us."""
    found = []
    for phase in motion.phases:
        mode = next(iter(phase.modes.values()))
        if phase.t1 - phase.t0 > 1e-5 and (not found or found[-1][1] != mode):
            found.append((phase.t0, mode))
    times, modes = zip(*found, strict=True)
    return times, modes


def run(model, bend, method, rtol, span=1.0):
    p = {"b": bend, "c": 1.0}
    return model.simulate((0.0, span), states(model), p, method=method, rtol=rtol, atol=1e-2 * rtol)


@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize("method", ["taylor", "dop853"])
@pytest.mark.parametrize("case", CASES)
def test_a_dip_before_the_first_sample_of_a_step(case, method, rtol):
    build, modes, ends = CASES[case]
    for bend in BENDS:
        motion = run(build(), bend, method, rtol)
        assert motion.success, motion.message
        assert phases(motion) == (pytest.approx((0.0, ends(bend)), rel=1e-4, abs=2e-6), modes), bend
        assert np.min(motion["R"]) >= 0.0


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_sprung_masses_part_for_an_instant(method):
    for bend in BENDS[:-1]:
        motion = run(sprung(), bend, method, 1e-10)
        assert motion.success, motion.message
        assert phases(motion) == (pytest.approx((0.0, sprung_meet(bend)), rel=1e-4, abs=2e-6), ("open", "closed")), bend


@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize("method", ["tsit5", "radau"])
@pytest.mark.parametrize("case", CASES)
def test_methods_of_lower_order_see_it_as_far_as_their_tolerance(case, method, rtol):
    """Their polynomials are off by more than the dip: phases may come and go, but the motion is right."""
    build, modes, ends = CASES[case]
    for bend in BENDS[:3]:
        motion = run(build(), bend, method, rtol)
        assert motion.success, motion.message
        times, found = phases(motion)
        assert len(found) > 1 and found[-1] == modes[1] and times[-1] <= ends(bend) + 0.1, bend


@pytest.mark.parametrize("case", CASES)
def test_sweeps_see_the_same(case):
    model, span = CASES[case][0](), 0.02
    bends = np.array([*BENDS, 0.0, -0.01, -0.3])
    sweep = model.sweep((0.0, span), states(model), {"b": bends, "c": 1.0}, rtol=1e-8, atol=1e-10)
    assert sweep.success.all()
    for i, bend in enumerate(bends):
        single = run(model, bend, "auto", 1e-8, span)
        for name in model.layout.coordinates:
            np.testing.assert_allclose(sweep[name][i], single[name][-1], rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
@pytest.mark.parametrize("case", CASES)
def test_nothing_opens_where_a_guard_bends_up_or_begins_with_a_third_power(case, method):
    build, modes, _ = CASES[case]
    for bend in (0.0, -1e-6, -0.01, -0.3):
        motion = run(build(), bend, method, 1e-8)
        assert motion.success and phases(motion)[1] == modes[1:], (bend, motion.message)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_waves_within_a_step_are_no_error_of_its_polynomials(method):
    model = waves()
    for number in range(3, 60, 8):
        p = {"b": float(number)}
        motion = model.simulate((0.0, 1.0), states(model), p, method=method, rtol=1e-6, atol=1e-8)
        times, modes = phases(motion)
        assert motion.success and modes[:2] == ("closed", "open")
        assert times[1] == pytest.approx(0.5 * math.pi / number, rel=1e-9)


@pytest.mark.parametrize("slope", [0.0, 1e-6, 0.02])
@pytest.mark.parametrize("bend", [-0.5, 0.0, 0.01, 0.4])
def test_the_deepest_dip_of_a_cubic(slope, bend):
    x = np.linspace(0.0, 2.0, 2_000_001)
    for least in (0.3, 1.0):
        exact = -np.min(least * x**3 - bend * x**2 - slope * x)
        assert deepest_dip(slope, bend, least) == pytest.approx(exact, rel=1e-5, abs=1e-11)


def test_a_dip_counts_from_a_billionth_of_the_values_or_the_noise_on():
    for depth, leaves in ((0.9e-9, True), (1.1e-9, False)):
        bend = (27.0 / 4.0 * depth) ** (1.0 / 3.0)
        assert leaves_zero(0.0, bend, -1.0, 1.0, 1.0, 0.0, True) == leaves
        assert leaves_zero(0.0, bend, -1.0, 1.0, 1.0, 2.0 * depth, True)
        assert not leaves_zero(0.0, bend, -1.0, 1.0, 1.0, 2.0 * depth, False)  # to either side


@pytest.mark.parametrize("t, h", [(0.0, 0.1), (0.0, -0.1), (1e6, 1e-3)])
def test_bends_by_rates(t, h):
    """Of f(t + x h) = 3 x + 0.7 x^2 - 2 x^3."""
    share = short_share(t, h)
    first, second, third = (3.0 + 1.4 * x - 6.0 * x**2 for x in (0.0, share, 2.0 * share))
    assert share == pytest.approx(1e-4, rel=1e-3)
    assert bend_from_rates(first, second, third, share) == pytest.approx(0.7, abs=1e-10)
    assert math.isnan(bend_from_rates(first, second, third, short_share(1e9, 1e-6)))
