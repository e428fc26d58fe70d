"""Long runs, shorter than those of the report: rounding grows like the square root of time, constraints hold."""

import math

import numpy as np
import pytest
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from hard_cases import hard_case

TIGHTEST = {"rtol": 1e-16, "atol": 1e-18, "dense": False, "max_steps": 1_000_000, "method": "taylor"}


@pytest.fixture(scope="module")
def oscillator():
    """Return a particle on a spring of period 2 pi."""
    x = dynamicsymbols("x")
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    body = Particle("body", P, 1)
    body.potential_energy = x**2 / 2
    scene = da.Scene("oscillator", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(body)
    scene.add_loads((P, -x * N.x))
    return da.compile_model(scene)


def test_phase_and_energy_of_an_oscillator(oscillator):
    """Plain sums of time would put the phase off by 1e-11 after 1e4 time units, rounded 1/k the energy by 1.5e-13."""
    end = 1e4
    run = oscillator.simulate((0, end), {"x": 1, "x_dot": 0}, {}, t_eval=[end], **TIGHTEST)
    phase = math.atan2(-run["x_dot"][0], run["x"][0]) - math.atan2(math.sin(end), math.cos(end))
    assert abs(phase) < 1e-13
    assert abs(2 * run["energy"][0] - 1) < 6e-14


def test_angles_that_wind_up_do_not_loosen_the_tolerance():
    """psi and phi of the disk pass 1000 rad; the energy depends on neither."""
    case = hard_case("rolling disk")
    run = case.compile("minimal").simulate((0, 1000), case.initial, case.parameters, t_eval=[0, 1000], **TIGHTEST)
    assert np.max(np.abs(run["phi"])) > 1000
    assert case.change(run) < 1e-13


@pytest.mark.parametrize(
    ("name", "formulation", "end", "bound"),
    [("slider-crank", "projected", 300, 1e-13), ("double pendulum, angles", "minimal", 800, 1e-13)],
)
def test_energy_where_it_depends_on_angles_that_wind_up(name, formulation, end, bound):
    """Large angles lose the turns that they have made, and so no digits; the slider-crank would change by 1e-12."""
    case = hard_case(name)
    times = np.linspace(0, end, 21)
    run = case.compile(formulation).simulate((0, end), case.initial, case.parameters, t_eval=times, **TIGHTEST)
    assert np.max(np.abs(run.q)) > 50  # more than the turns that angles keep; how far depends on its steps, if chaotic
    assert case.change(run) < bound


def test_angles_are_recorded_with_the_turns_that_they_have_made():
    case = hard_case("vertical disk")
    model = case.compile("minimal")
    options = TIGHTEST | {"dense": True}
    run = model.simulate((0, 300), case.initial, case.parameters, **options)
    for name in ("phi", "theta"):
        rate = run[f"{name}_dot"][0]
        np.testing.assert_allclose(run[name], run[name][0] + rate * run.t, rtol=1e-13)
    between = 0.5 * (run.t[1:] + run.t[:-1])
    np.testing.assert_allclose(run(between)["phi"], run["phi"][0] + run["phi_dot"][0] * between, rtol=1e-13)
    sampled = model.simulate((0, 300), case.initial, case.parameters, t_eval=between, **TIGHTEST)
    np.testing.assert_allclose(sampled["phi"], run(between)["phi"], rtol=1e-13)
    assert np.max(np.abs(sampled.constraint_violation)) < 1e-14


@pytest.fixture(scope="module")
def pendulums():
    """Return runs of the Cartesian pendulum over 2000 time units, 30,000 steps, by formulation."""
    case = hard_case("pendulum, Cartesian (IFToMM A01)")
    times = np.linspace(0, 2000, 21)
    return {
        name: case.compile(name).simulate((0, 2000), case.initial, case.parameters, t_eval=times, **TIGHTEST)
        for name in ("projected", "augmented")
    }


def test_projection_holds_and_augmented_drifts(pendulums):
    violation = {name: np.max(np.abs(run.constraint_violation)) for name, run in pendulums.items()}
    assert violation["projected"] < 1e-14
    assert violation["augmented"] > 1e3 * violation["projected"]


def test_energy_of_a_projected_run(pendulums):
    energy = pendulums["projected"]["energy"]
    assert np.max(np.abs(energy - energy[0])) < 5e-14 * 9.81


def test_constraints_hold_over_a_million_steps():
    """Positions to 1e-12 and velocities to 1e-11, as rounding leaves them after whatever many steps."""
    case = hard_case("pendulum, Cartesian (IFToMM A01)")
    options = {"method": "tsit5", "rtol": 1e-9, "atol": 1e-11, "dense": False, "max_steps": 2_000_000}
    end = 16_000.0
    run = case.compile("projected").simulate(
        (0, end), case.initial, case.parameters, t_eval=np.linspace(0, end, 201), **options
    )
    assert run.success and run.stats.steps > 1_000_000
    assert np.max(np.abs(run.constraint_violation)) < 1e-14
    assert np.max(np.abs(run.velocity_violation)) < 1e-13


def test_energy_over_1e5_time_units():
    """A sum that stays near 1 is rounded down more often than up: steps of the size for truncation would give 4e-12."""
    case = hard_case("sleigh, b = 0")
    times = np.linspace(0, 1e5, 11)
    run = case.compile("projected").simulate((0, 1e5), case.initial, case.parameters, t_eval=times, **TIGHTEST)
    assert case.change(run) < 1e-12


def test_first_integrals_of_the_chaplygin_sphere():
    case = hard_case("sphere with unequal moments")
    run = case.compile("projected").simulate((0, 200), case.initial, case.parameters, t_eval=[0, 200], **TIGHTEST)
    assert case.change(run) < 3e-14
