"""The references of motions with friction checked against closed forms, published numbers, and each other."""

import json
from pathlib import Path

import mpmath as mp
import pytest

from hard_cases import derive_friction
from hard_cases.contact_case import contact_reference
from oracles.extrapolation import advance, follow
from oracles.friction_plate import Plate, history, slip_velocity, state_at
from oracles.friction_rod import Rod

# Computed elsewhere, by Taylor series in 55 digits and by closed forms.
PUBLISHED = {
    "belt": {"7.5": ["0.324073565797656887688", "-0.569606051661826577953"], "100.0": ["1.1537053312153337006", None]},
    "coulomb_oscillator": {"1.0": ["-0.323917680734866246336"], "4.0": ["0.0132840884143035124783"]},
    "incline_back": {"2.0": ["-2.05679586996926933037", "-3.36777720342903416971"]},
    "incline_sticks": {"2.0": ["0.419403508094509753415", "0"]},
    "billiard": {"1.0": ["1.2270201322700261461", "0.27624266986763914757", "0.91428571428571428571"]},
}
TRANSITIONS = {
    "belt": {1: "6.13125", 2: "7.90316371079183792634"},
    "coulomb_oscillator": {13: "4.08407044966673121000"},
    "incline_back": {1: "0.411754774571511152608"},
    "incline_sticks": {1: "0.279602338729673168943"},
    "billiard": {1: "0.57608971733952184817"},
}


@pytest.fixture(autouse=True)
def many_digits():
    """Compare in as many digits as were computed."""
    with mp.workdps(32):
        yield


def plate(**changes):
    numbers = {"m": 1, "l": 1, "h": "0.8", "g": "9.81"} | changes
    return Plate(**{key: mp.mpf(value) for key, value in numbers.items()})


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_values(name):
    entry = contact_reference(name)
    rows = {row["t"]: row["state"] for row in entry["rows"]}
    for t, values in PUBLISHED[name].items():
        for ours, theirs in zip(rows[t], values, strict=False):
            assert theirs is None or abs(mp.mpf(ours) - mp.mpf(theirs)) < mp.mpf("1e-17")
    for number, t in TRANSITIONS[name].items():
        assert abs(mp.mpf(entry["phases"][number]["t"]) - mp.mpf(t)) < mp.mpf("1e-17")


@pytest.mark.parametrize("name", ["belt", "coulomb_oscillator", "billiard", "bouncing"])
def test_the_file_is_what_the_script_gives(name):
    with mp.workdps(32):
        made = json.loads(json.dumps(getattr(derive_friction, name)()))
    assert made == contact_reference(name)
    assert Path(derive_friction.FILE).name == "friction_references.json"


def test_extrapolation_of_an_oscillator():
    with mp.workdps(32):
        end, change = advance(lambda t, y: [y[1], -y[0]], mp.mpf(0), [mp.mpf(1), mp.mpf(0)], mp.mpf("0.1"))
        assert abs(end[0] - mp.cos(mp.mpf("0.1"))) < mp.mpf("1e-29") and change < mp.mpf("1e-25")
        found = follow(lambda t, y: [y[1], -y[0]], 0, [1, 0], 10, {"rest": lambda t, y: -y[1]}, step="0.1")
        assert found.name == "rest" and abs(found.t - mp.pi) < mp.mpf("1e-26")


def test_plate_without_friction_is_the_published_one():
    """Theta, theta_dot, N_A and N_B of the frictionless rod on a corner, released at theta = 1."""
    with mp.workdps(32):
        case = plate()
        spans = list(history(case, 1, 0, "0.2"))
        theta, omega, forces = state_at(case, spans, "0.2")
    expected = [
        "0.86661087417554145965139",
        "-1.1731848410876491790840",
        "2.0169283813479216548",
        "7.637910132659736753",
    ]
    for ours, theirs in zip((theta, omega, forces.N_A, forces.N_Q), expected, strict=True):
        assert abs(ours - mp.mpf(theirs)) < mp.mpf("1e-18")


def test_power_of_the_forces_is_the_change_of_the_energy():
    """The equations are those of Newton and Euler; the energy knows nothing of them."""
    with mp.workdps(32):
        case = plate(mu_A="0.3", mu_Q="0.2")
        theta, omega, sign = mp.mpf("0.9"), mp.mpf("-1.1"), -1

        def energy(th, w):
            s, c = mp.sin(th), mp.cos(th)
            vx, vy = case.h * w / s**2 - case.l * s * w, case.l * c * w
            return case.m * (vx**2 + vy**2) / 2 + case.m * case.l**2 / 6 * w**2 + case.m * case.g * case.l * s

        forces = case.sliding(mp.mpf(0), theta, omega, sign)
        rate = mp.diff(lambda t: energy(theta + omega * t + forces.alpha * t * t / 2, omega + forces.alpha * t), 0)
        along = case.h * omega / mp.sin(theta) ** 2
        power = forces.T_A * along + forces.F_Q * slip_velocity(case, theta, omega)
        assert power < 0 and abs(rate - power) < mp.mpf("1e-12")


def test_rest_of_the_plate_in_closed_form():
    """With friction at the corner alone, the plate holds while tan(theta) is at most mu, if nothing pushes it."""
    with mp.workdps(32):
        angle = mp.atan(mp.mpf("0.8"))
        for theta, holds in ((angle - mp.mpf("1e-20"), True), (angle + mp.mpf("1e-20"), False)):
            _, right, left = plate(mu_Q="0.8").resting(mp.mpf(0), theta)
            assert (right <= 0 <= left) is holds


def test_rod_conserves_its_moment_about_a_point_it_turns_about():
    with mp.workdps(32):
        rod = Rod(*(mp.mpf(x) for x in ("1", "1", "0.5", "9.81")))
        alpha, N, F = rod.sticking(mp.mpf("0.7"), mp.mpf("1.3"))
        s, c = mp.sin(mp.mpf("0.7")), mp.cos(mp.mpf("0.7"))
        assert abs(alpha / 3 - (-c * N + s * F)) < mp.mpf("1e-30")  # about G
        assert abs(4 * alpha / 3 + rod.g * c) < mp.mpf("1e-30")  # about A


def test_critical_friction_of_the_rod():
    with mp.workdps(32):
        rod = Rod(*(mp.mpf(x) for x in ("1", "1", "0", "9.81")))
        critical = Rod(rod.m, rod.l, mp.mpf(4) / 3, rod.g)
        p, b = critical.contact(mp.atan(2), mp.mpf(0), -1)
        assert abs(p) < mp.mpf("1e-30") and b == -rod.g
        for theta in (mp.mpf("1.0"), mp.mpf("1.2")):
            assert critical.contact(theta, mp.mpf(0), -1)[0] > 0
