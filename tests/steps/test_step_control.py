"""Step size control: each decision at its boundaries, as plain Python, and the mirror of it in JAX."""

import math

import numpy as np
import pytest

from dalembert.methods import step_constants as constants
from dalembert.methods.status import RUNNING, Status
from dalembert.steps import step_control as control
from dalembert.steps.step_control import ACCEPTED, REJECTED

TINY = 16.0 * 2.0**-52


def above(value):
    return math.nextafter(value, math.inf)


def below(value):
    return math.nextafter(value, -math.inf)


@pytest.mark.parametrize(
    ("t", "rest", "least"), [(1.0, 0.0, TINY), (-4.0, 0.0, 4.0 * TINY), (0.0, 10.0, 1e-29), (1.0, 1e20, TINY + 1e-10)]
)
def test_smallest_step(t, rest, least):
    assert control.smallest_step(t, rest) == pytest.approx(least, rel=1e-15)


def test_largest_step():
    assert control.largest_step(1.0, 5.0, 2.0) == 2.0
    assert control.largest_step(4.5, 5.0, 2.0) == 0.5
    assert control.largest_step(-4.5, -5.0, 2.0) == 0.5


@pytest.mark.parametrize(
    ("proposed", "t", "t1", "most", "size", "stays"),
    [
        (0.5, 0.0, 10.0, math.inf, 0.5, 0.5),
        (0.5, 0.0, -10.0, math.inf, 0.5, 0.5),
        (0.5, 0.0, 10.0, 0.25, 0.25, 0.25),
        (7.0, 8.0, 10.0, math.inf, 2.0, 7.0),  # cut, and the size stays proposed
        (2.0 * (1.0 - 0.9e-9), 8.0, 10.0, math.inf, 2.0, 2.0 * (1.0 - 0.9e-9)),  # stretched
        (2.0 * (1.0 - 1.1e-9), 8.0, 10.0, math.inf, 2.0 * (1.0 - 1.1e-9), 2.0 * (1.0 - 1.1e-9)),  # falls short
        (1e-20, 8.0, 10.0, math.inf, 8.0 * TINY, 8.0 * TINY),
        (1e-20, 0.0, 10.0, math.inf, 1e-20, 1e-20),
    ],
)
def test_next_step(proposed, t, t1, most, size, stays):
    assert control.next_step(proposed, t, t1, most) == (size, stays)


def test_a_step_ends_exactly_at_the_end():
    assert control.end_of_step(0.1, 0.7, 1.0, abs(0.7 - 0.1), abs(0.7 - 0.1)) == 0.7
    assert control.end_of_step(0.5, -0.5, -1.0, 0.25, 1.0) == 0.25


def test_error_scale():
    assert control.error_scale(0.5, 0.125, 4.0) == 2.125


@pytest.mark.parametrize(
    ("error", "outcome"),
    [
        (0.0, ACCEPTED),
        (1.0, ACCEPTED),
        (above(1.0), Status.STEP_TOO_SMALL),
        (math.inf, Status.NON_FINITE),
        (math.nan, Status.NON_FINITE),
    ],
)
def test_error_test(error, outcome):
    assert control.error_test(error) == outcome


# size, broken, proposed, time, rest; outcome of an attempt that may be rejected, and of a Taylor step
LEAST = control.smallest_step(1.0, 2.0)
ATTEMPTS = {
    "made": (0.5, False, 0.7, ACCEPTED, ACCEPTED),
    "made to the end": (2.0, False, 0.7, ACCEPTED, ACCEPTED),
    "rejected": (0.0, False, 0.1, REJECTED, Status.STEP_TOO_SMALL),
    "rejected, not finite": (0.0, True, 0.1, REJECTED, Status.NON_FINITE),
    "rejected at the least size": (0.0, False, LEAST, REJECTED, Status.STEP_TOO_SMALL),
    "rejected below it": (0.0, False, below(LEAST), Status.STEP_TOO_SMALL, Status.STEP_TOO_SMALL),
    "not finite below it": (0.0, True, below(LEAST), Status.NON_FINITE, Status.NON_FINITE),
    "a proposal that is not a number": (0.0, True, math.nan, Status.NON_FINITE, Status.NON_FINITE),
    "of the least size": (LEAST, False, 0.0, ACCEPTED, ACCEPTED),
    "below it": (below(LEAST), False, 0.0, ACCEPTED, Status.STEP_TOO_SMALL),
    "made, not finite": (0.5, True, 0.7, ACCEPTED, Status.NON_FINITE),
}


@pytest.mark.parametrize("name", ATTEMPTS)
def test_attempt_test(name):
    size, broken, proposed, attempt, series = ATTEMPTS[name]
    assert control.attempt_test(size, broken, proposed, True, 1.0, 2.0) == attempt
    assert control.attempt_test(size, broken, 0.0, False, 1.0, 2.0) == series


def test_a_step_that_is_all_that_is_left_may_be_of_any_size():
    rest = below(control.smallest_step(1.0, 0.0))
    assert control.attempt_test(rest, False, 0.0, False, 1.0, rest) == ACCEPTED
    assert control.attempt_test(0.5 * rest, False, 0.0, False, 1.0, rest) == Status.STEP_TOO_SMALL


def test_blind_retry():
    assert control.blind_retry(0.5, 1.0, 2.0) == constants.REDUCTION_BLIND * 0.5
    assert control.blind_retry(9.9 * LEAST, 1.0, 2.0) == 0.0
    assert control.blind_retry(10.1 * LEAST, 1.0, 2.0) > 0.0


@pytest.mark.parametrize(
    ("ended", "attempts", "status"),
    [(True, 10.0, Status.SUCCESS), (False, 9.0, RUNNING), (False, 10.0, Status.MAX_STEPS), (True, 0.0, Status.SUCCESS)],
)
def test_status_after(ended, attempts, status):
    assert control.status_after(ended, attempts, 10.0) == status


def test_growth_is_within_its_limits_and_never_after_a_retry():
    assert control.growth(0.0, 1e-4, False, 0.125) == constants.LARGEST_GROWTH
    assert control.growth(1e-30, 1.0, False, 0.125) == constants.LARGEST_GROWTH
    assert control.growth(0.0, 1e-4, True, 0.125) == control.growth(1e-30, 1.0, True, 0.125) == 1.0
    assert control.growth(1.0, 1.0, False, 0.125) == constants.SAFETY
    assert control.growth(1.0, 1e-4, False, 1.0) == constants.LARGEST_REDUCTION
    expected = 0.9 * 0.3 ** (-0.85 / 8) * 0.5 ** (0.2 / 8)
    assert control.growth(0.3, 0.5, False, 0.125) == pytest.approx(expected, rel=1e-14)


def test_reduction_follows_an_error_that_is_known():
    assert control.reduction(Status.STEP_TOO_SMALL, 2.0, 0.25) == pytest.approx(0.9 * 2.0**-0.25, rel=1e-14)
    assert control.reduction(Status.STEP_TOO_SMALL, 1e9, 0.25) == constants.LARGEST_REDUCTION
    for failure in (Status.NON_FINITE, Status.PROJECTION_FAILED):
        assert control.reduction(failure, 2.0, 0.25) == constants.REDUCTION_BLIND


def test_jax_has_the_same_limits():
    pytest.importorskip("jax")
    diffrax_control = pytest.importorskip("dalembert.jax.runs.control")
    from dalembert.jax.runs.precision import double_precision
    from dalembert.jax.runs.step_rules import smallest_step

    times, rests = np.array([0.0, 1.0, -1e3, 1e-25]), np.array([1.0, 1e20, 0.0, 10.0])
    expected = [control.smallest_step(t, rest) for t, rest in zip(times, rests, strict=True)]
    with double_precision():
        found = np.array(smallest_step(times, rests))
    np.testing.assert_allclose(found, expected, rtol=1e-15)
    assert diffrax_control._PROPORTIONAL == constants.INTEGRAL
    exponent = diffrax_control._PROPORTIONAL + diffrax_control._INTEGRAL
    assert exponent == pytest.approx(1.0 - constants.PROPORTIONAL * constants.INTEGRAL, rel=1e-15)
