"""Contacts in other units of length, mass and time: the same phases, at the same instants, and the same motions."""

import math

import numpy as np
import pytest
from sympy import symbols

import dalembert as da
from dalembert.errors import InitialStateError
from dalembert.methods.status import Status
from hard_cases.contacts import corner_plate, loose_plate
from scene.scaled import Units, r, two_feet

LENGTH, SPEED, FORCE, MASS, RATE = (1, 0, 0), (1, 0, -1), (1, 1, -2), (0, 1, 0), (0, 0, -1)
DIMENSIONS = dict.fromkeys(["x", "y", "l", "h", "r"], LENGTH) | dict.fromkeys(["x_dot", "y_dot", "v_b"], SPEED)
DIMENSIONS |= {"m": MASS, "k": (0, 1, -2), "g": (1, 0, -2), "I_C": (2, 1, 0), "F_A": FORCE, "F_0": FORCE, "w": RATE}
DIMENSIONS |= {"theta_dot": RATE}

BLOCK = {"m": 2.0, "g": 9.81, "l": 0.3, "r": 0.2, "I_C": 0.1, "mu": 0.4, "w": 2.0}
REST = {"x": 0.0, "y": 0.2, "theta": 0.0, "x_dot": 0.0, "y_dot": 0.0, "theta_dot": 0.0}
PLATE = {"m": 1.0, "l": 1.0, "h": 0.8, "g": 9.81, "F_A": 4.0}


def _loose():
    force, rough = symbols("F_A mu", positive=True)
    return loose_plate(force, corner=rough, ground=rough)


CASES = {
    "ball": (
        da.scenes.bouncing_ball,
        {"x": 0.0, "y": 1.0, "x_dot": 0.3, "y_dot": 0.0},
        {"m": 1.2, "e": 0.5, "g": 9.81},
        1.5,
    ),
    "belt": (
        da.scenes.belt_oscillator,
        {"x": 0.0, "y": 0.0, "x_dot": 0.5, "y_dot": 0.0},
        {"m": 1.0, "k": 10.0, "v_b": 0.5, "mu": 0.3, "mu_s": 0.5, "g": 9.81},
        4.0,
    ),
    "plate on a corner": (
        lambda: corner_plate(contact=True),
        {"x": -0.8 / math.tan(1.3), "theta": 1.3, "theta_dot": 2.0},
        PLATE | {"mu": 0.3},
        0.4,
    ),
    "plate on ground and corner": (
        _loose,
        {"x": -0.8 / math.tan(0.7), "y": 0.0, "theta": 0.7, "y_dot": 0.0, "theta_dot": 1.0},
        PLATE | {"mu": 0.2},
        1.0,
    ),
    "block tips": (lambda: two_feet(r), REST, BLOCK | {"l": 0.1, "mu": 0.6, "F_0": 12.0}, 0.45),
    "block falls": (
        lambda: two_feet(restitution=0.3),
        REST | {"y": 0.5, "theta": 0.3, "x_dot": 0.4},
        BLOCK | {"F_0": 1e-4},
        0.43,
    ),
}
UNITS = [Units(1e-9), Units(1e-6), Units(1e9), Units(mass=1e-18), Units(time=1e6), Units(1e-6, 1e-15, 1e3)]
FEET = [*UNITS, Units(1e-8), Units(1e-3), Units(1e-2), Units(1e4)]


def _phases(model, name, units, moved=(), end=None):
    """Return the instants and the modes of phases, and the last of the motion, all in ordinary units."""
    _, initial, parameters, whole = CASES[name]
    start, p = units.of(initial | dict(moved), DIMENSIONS), units.of(parameters, DIMENSIONS)
    atol = 1e-10 * min(units.length, 1.0) / max(units.time, 1.0)
    run = model.simulate((0.0, (end or whole) * units.time), start, p, rtol=1e-9, atol=atol)
    assert run.success, (units, run.message)
    back = units.of(dict.fromkeys(initial, 1.0), DIMENSIONS)
    motion = [run[key][-1] / back[key] for key in initial]
    return [phase.modes for phase in run.phases], [phase.t1 / units.time for phase in run.phases], motion


@pytest.mark.parametrize("name", CASES)
def test_phases_and_motions_are_the_same_in_all_units(name):
    model = da.compile_model(CASES[name][0]())
    modes, instants, motion = _phases(model, name, Units())
    for units in FEET if "block" in name else UNITS:
        found = _phases(model, name, units)
        assert found[0] == modes, units
        np.testing.assert_allclose(found[1], instants, rtol=1e-8, err_msg=str(units))
        np.testing.assert_allclose(found[2], motion, rtol=1e-7, atol=1e-7, err_msg=str(units))


def test_a_gap_is_closed_by_its_share_of_the_lengths():
    model = da.compile_model(da.scenes.bouncing_ball(), backend="numpy")
    for units in [Units(), *UNITS]:
        for gap, mode in ((0.0, "closed"), (1e-9, "closed"), (1e-6, "open")):
            modes = _phases(model, "ball", units, {"x": 1.0, "y": gap, "x_dot": 0.0}, 1e-5)[0]
            assert modes[0]["ground"] == mode, (units, gap)
        with pytest.raises(InitialStateError, match="penetrates"):
            _phases(model, "ball", units, {"x": 1.0, "y": -1e-6, "x_dot": 0.0})


@pytest.mark.parametrize("backend, method", [("llvm", "taylor"), ("llvm", "dop853"), ("numpy", "dop853")])
def test_a_ball_lands_whatever_is_left_of_its_other_coordinate(backend, method):
    """Its height was 1 before, of which landing leaves rounding: more than a share of x, the largest when it lies."""
    model = da.compile_model(da.scenes.bouncing_ball(), backend=backend)
    p = {"m": 1.0, "e": 0.0, "g": 9.81}
    for x in (1e-8, 1e-9, 1e-10, 1e-11):
        run = model.simulate((0.0, 1.0), {"x": x, "y": 1.0, "x_dot": 0.0, "y_dot": 0.0}, p, method=method)
        assert run.success and len(run.phases) == 2, x
        assert run.phases[0].t1 == pytest.approx(math.sqrt(2 / 9.81), rel=1e-9)
        assert abs(run["y"][-1]) <= 1e-8 * x and run["x"][-1] == x


def test_a_contact_that_cannot_close_ends_the_motion_with_a_status():
    """The time of landing is rounded to a share of the span, in which the ball would fall far."""
    model = da.compile_model(da.scenes.bouncing_ball())
    start, span = {"x": 0.0, "y": 1.0, "x_dot": 0.0, "y_dot": 0.0}, (0.0, 1.0)
    for g, landing in ((1e25, math.sqrt(2e-25)), (1e100, 0.0)):
        p = {"m": 1.0, "e": 0.0, "g": g}
        run = model.simulate(span, start, p, method="taylor")
        cases = model.sweep(span, start, p | {"m": np.array([1.0])}, method="taylor")
        assert run.status is Status.PROJECTION_FAILED and cases.status[0] == run.status
        assert [phase.modes["ground"] for phase in run.phases] == ["open"] and cases.phases[0] == 1
        assert run.t_end == cases.t[0] == pytest.approx(landing, rel=1e-4)
        assert run["y"][-1] == pytest.approx(cases["y"][0]) and abs(run["y"][0] - 1.0) < 1e-12


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_accelerations_that_overflow_are_not_finite(method):
    model = da.compile_model(da.scenes.bouncing_ball())
    start, p = {"x": 0.0, "y": 1.0, "x_dot": 0.0, "y_dot": 0.0}, {"m": 1.0, "e": 0.0, "g": 1e300}
    run = model.simulate((0.0, 1.0), start, p, method=method)
    cases = model.sweep((0.0, 1.0), start, p | {"m": np.array([1.0])}, method=method)
    assert run.status is Status.NON_FINITE and cases.status[0] == run.status
    assert np.isnan(cases["y"][0])
