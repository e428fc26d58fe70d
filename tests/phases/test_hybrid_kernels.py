"""What a model with contacts tells of a state: without their forces, or in the mode that the state decides."""

import functools

import numpy as np
import pytest

import dalembert as da
from dalembert.errors import InitialStateError, ValueInputError

BELT = {"m": 2.0, "k": 4.0, "mu": 0.3, "mu_s": 0.5, "g": 10.0, "v_b": 0.2}
BALL = {"m": 2.0, "e": 0.5, "g": 10.0}


@functools.cache
def belt():
    return da.compile_model(da.scenes.belt_oscillator(), backend="numpy")


@functools.cache
def ball():
    return da.compile_model(da.scenes.bouncing_ball(), backend="numpy")


def test_what_is_the_same_in_all_modes():
    q, qdot = [0.5, 0.0], [0.3, 0.0]
    np.testing.assert_array_equal(belt().mass_matrix(q, BELT), 2.0 * np.eye(2))
    np.testing.assert_array_equal(belt().forcing(0.0, q, qdot, BELT), [-2.0, -20.0])
    np.testing.assert_array_equal(belt().constraint_jacobian(0.0, q, BELT), [[0.0, 1.0]])
    assert ball().constraint_jacobian(0.0, [q, q], BALL).shape == (2, 0, 2)
    with pytest.raises(ValueInputError, match="q must have shape"):
        belt().mass_matrix([0.5], BELT)


def test_accelerations_are_those_of_the_mode_that_the_state_decides():
    """It slips forward, sticks, slips backward, and is torn from sticking: (-k x -+ mu m g) / m."""
    x, v = np.array([0.5, 0.5, 0.5, 3.0]), np.array([0.3, 0.2, 0.1, 0.2])
    q, qdot = np.column_stack([x, 0 * x]), np.column_stack([v, 0 * v])
    found = belt().accelerations(0.0, q, qdot, BELT)
    np.testing.assert_allclose(found[:, 0], [-1.0 - 3.0, 0.0, -1.0 + 3.0, -6.0 + 3.0], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found[:, 1], 0.0, atol=1e-12)
    vector = belt().parameter_vector(BELT)
    np.testing.assert_array_equal(belt().accelerations(0.0, q[0], qdot[0], vector), found[0])


def test_contacts_that_are_open_or_closed():
    high, low, still, down = [0.0, 1.0], [0.0, 0.0], [0.0, 0.0], [0.0, -1.0]
    np.testing.assert_allclose(ball().accelerations(0.0, high, down, BALL), [0.0, -10.0], rtol=1e-12)
    np.testing.assert_allclose(ball().accelerations(0.0, low, still, BALL), 0.0, atol=1e-12)
    with pytest.raises(
        InitialStateError, match=r"y_dot = -1: a closed contact forbids the rates, and y_dot would jump"
    ):
        ball().accelerations(0.0, [high, low], [still, down], BALL)
    with pytest.raises(InitialStateError, match="contradicts a constraint"):
        ball().accelerations(0.0, [0.0, -1.0], still, BALL)


def test_state_is_where_a_motion_starts():
    start = {"x": 0.5, "x_dot": 0.3, "y": 0.0}
    np.testing.assert_allclose(belt().state(start, BELT), [0.5, 0.0, 0.3, 0.0], atol=1e-15)
