"""Linearisation on the constraints: against closed forms, differences of the motion, and the benchmark bicycle."""

import functools
import math

import numpy as np
import pytest

import dalembert as da
from dalembert.errors import InitialStateError, OptionError, UnknownNameError
from hard_cases import machines
from hard_cases.case import reference
from scene.builders import cartesian_pendulum, double_pendulum, four_bar, shaken_pendulum
from system.stiff_scenes import GOVERNOR, GOVERNOR_START, governor

PENDULUM = {"m": 1.3, "l": 2.0, "g": 9.81}
HANGING = {"x": 0.0, "y": -2.0, "x_dot": 0.0}
SLEIGH = {"m": 1.0, "b": 0.3, "I_C": 0.5}
STRAIGHT = {"x": 0.0, "y": 0.0, "theta": 0.0, "x_dot": 1.5, "theta_dot": 0.0}
SADDLES = ("projected", "baumgarte", "ggl", "augmented")


@functools.cache
def compiled(build, formulation="auto", backend="numpy"):
    return da.compile_model(build(), backend=backend, formulation=formulation)


@pytest.mark.parametrize("formulation", SADDLES)
def test_pendulum_in_redundant_coordinates(formulation):
    found = compiled(cartesian_pendulum, formulation).linearize(0.0, HANGING, PENDULUM)
    assert found.states == ("x", "x_dot")
    np.testing.assert_allclose(found.A, [[0, 1], [-9.81 / 2, 0]], atol=1e-13)
    np.testing.assert_allclose(found.drift, 0, atol=1e-14)
    frequency = math.sqrt(9.81 / 2)
    np.testing.assert_allclose(found.eigenvalues, [1j * frequency, -1j * frequency], atol=1e-12)


@pytest.mark.parametrize("formulation", ["minimal", *SADDLES])
def test_sleigh_about_straight_motion(formulation):
    """Its spin decays at m b v / I_C; positions and speed are marginal."""
    found = compiled(da.scenes.chaplygin_sleigh, formulation).linearize(0.0, STRAIGHT, SLEIGH)
    assert len(found.states) == 5
    np.testing.assert_allclose(sorted(found.eigenvalues.real), [-0.3 * 1.5 / 0.5, 0, 0, 0, 0], atol=1e-7)
    assert found.drift[found.states.index("x")] == pytest.approx(1.5)


def test_a_moving_state_against_differences_of_the_rates():
    """Off every equilibrium, with time and damping in the equations."""
    for build, start, p in (
        (lambda: shaken_pendulum(), {"a": 0.4, "a_dot": 1.1}, dict.fromkeys(("h", "w", "l", "r", "m", "g", "A"), 0.7)),
        (governor, GOVERNOR_START, GOVERNOR),
        (lambda: double_pendulum(True), {"a": 0.3, "b": 1.0, "a_dot": 0.5, "b_dot": -1.0}, None),
    ):
        model = compiled(build, "minimal")
        given = dict.fromkeys(model.layout.parameters, 0.8) if p is None else {k: p[k] for k in model.layout.parameters}
        found = model.linearize(0.3, start, given)
        y = model.state(start, given, t=0.3)

        def rates(y, given, model=model):
            n = len(model.layout.coordinates)
            return np.concatenate([y[n:], model.accelerations(0.3, y[:n], y[n:], given)])

        for i in range(len(y)):
            step = 1e-6 * np.eye(len(y))[i]
            difference = (rates(y + step, given) - rates(y - step, given)) / 2e-6
            np.testing.assert_allclose(found.A[:, i], difference, rtol=1e-6, atol=1e-6 * np.abs(found.A).max())
        for k, name in enumerate(found.parameters):
            step = 1e-4 * given[name]
            more, less = ({**given, name: given[name] + sign * step} for sign in (1, -1))
            difference = (rates(y, more) - rates(y, less)) / (2 * step)
            np.testing.assert_allclose(
                found.B_parameters[:, k], difference, rtol=1e-5, atol=1e-6 * max(1, np.abs(difference).max())
            )


def test_closed_loop_against_differences_of_the_motion():
    """Moved along the loop, and with a rod lengthened while the independent coordinate and speed are held."""
    bars, model = {"m": 1.0, "l1": 1.0, "l2": 2.0, "l3": 1.5, "r": 2.0, "g": 9.81}, compiled(four_bar)

    def closed(q1, p):
        from scipy.optimize import fsolve

        lengths = np.array([p["l1"], p["l2"], p["l3"]])

        def left(z):
            a = np.cumsum([q1, *z])
            return [np.cos(a) @ lengths - p["r"], np.sin(a) @ lengths]

        return dict(zip(("q1", "q2", "q3"), (q1, *fsolve(left, [-0.5, -2], xtol=1e-12)), strict=True))

    def second(q1, speed, p):
        y = model.state({**closed(q1, p), "q1_dot": speed}, p)
        return model.accelerations(0.0, y[:3], y[3:], p)[0]

    found = model.linearize(0.0, {**closed(0.9, bars), "q1_dot": 1.2}, bars, states=["q1", "q1_dot"])
    h = 1e-5
    by_angle = (second(0.9 + h, 1.2, bars) - second(0.9 - h, 1.2, bars)) / (2 * h)
    by_speed = (second(0.9, 1.2 + h, bars) - second(0.9, 1.2 - h, bars)) / (2 * h)
    longer, shorter = ({**bars, "l2": 2.0 + sign * h} for sign in (1, -1))
    by_length = (second(0.9, 1.2, longer) - second(0.9, 1.2, shorter)) / (2 * h)
    np.testing.assert_allclose(found.A, [[0, 1], [by_angle, by_speed]], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        found.B_parameters[:, found.parameters.index("l2")], [0, by_length], rtol=1e-6, atol=1e-6
    )
    assert found.drift == pytest.approx([1.2, second(0.9, 1.2, bars)])


def test_chosen_states_and_blocks():
    model = compiled(cartesian_pendulum)
    start = {"x": 1.0, "y": -math.sqrt(3.0), "x_dot": 0.0}
    by_height = model.linearize(0.0, start, PENDULUM, states=["y", "y_dot"])
    np.testing.assert_allclose(
        np.sort_complex(by_height.eigenvalues**2).shape,
        np.sort_complex(model.linearize(0.0, start, PENDULUM).eigenvalues).shape,
    )
    assert by_height.states == ("y", "y_dot")
    assert by_height.block("y_dot", "y").tolist() == by_height.A[::-1, ::-1].tolist()
    with pytest.raises(KeyError, match="none of the states"):
        by_height.block("x")
    for wrong in (["x", "y"], ["x"], ["x", "x"], ["x", "x_dot", "y"]):
        with pytest.raises(OptionError, match="not independent"):
            model.linearize(0.0, start, PENDULUM, states=wrong)
    with pytest.raises(OptionError, match="unknown state 'z'"):
        model.linearize(0.0, start, PENDULUM, states=["z", "x"])


def test_wrong_input_is_that_of_simulate():
    model = compiled(cartesian_pendulum)
    with pytest.raises(UnknownNameError, match="missing parameters"):
        model.linearize(0.0, HANGING, {"m": 1.0})
    with pytest.raises(InitialStateError, match="contradict"):
        model.linearize(0.0, {**HANGING, "y": -2.5}, PENDULUM)


def test_every_backend_linearises_alike():
    plain, compiled_ = (
        compiled(cartesian_pendulum, "projected", backend).linearize(0.0, HANGING, PENDULUM)
        for backend in ("numpy", "llvm")
    )
    np.testing.assert_array_equal(plain.A, compiled_.A)


@pytest.mark.parametrize("speed", range(0, 11, 2))
def test_eigenvalues_of_the_benchmark_bicycle(speed):
    model = compiled(machines.bicycle_scene, "projected")
    found = machines.bicycle_linearized(model, float(speed))
    table = reference("whipple_bicycle_eigenvalues")["values"]["table"][str(speed)]["mine"]
    expected = np.sort_complex([complex(float(a), float(b)) for a, b in table])
    np.testing.assert_allclose(np.sort_complex(found), expected, rtol=0, atol=1e-11)
