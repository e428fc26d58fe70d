"""Projection onto constraints: each decision at its boundaries, and lanes beside each other, as plain Python."""

import math

import numpy as np
import pytest

from dalembert.methods.step_constants import (
    BRANCH,
    LINEAR_CHANGE,
    LINEAR_CORRECTIONS,
    MOST_CORRECTIONS,
    QUADRATIC_CHANGE,
    SMALL_COMPONENT,
    SMALLEST_OF_TIME,
)
from dalembert.steps import projection
from dalembert.steps.projection import (
    FAILED,
    NONE,
    PENDING,
    add_correction,
    correct,
    correction_test,
    largest_change,
    project_row,
)

pytestmark = pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")

ABOVE = 1.0 + 1e-12
CONVERGED = projection._CONVERGED
LAST = MOST_CORRECTIONS - 1


def test_a_correction_is_measured_by_the_state_where_it_is_corrected():
    states, delta = np.array([[9.0], [9.0], [4.0], [-3.0]]), np.array([[0.0], [0.5]])
    change, size, magnitude, finite = add_correction(states, 2, states, 2, delta, 0, 1e-9)
    assert (size, magnitude, finite) == (0.5, 3.0, True)  # the component that is left alone says nothing
    assert change == 0.5 / (SMALL_COMPONENT * 3.0 + 1e-9 + 2.5)
    np.testing.assert_array_equal(states.ravel(), [9.0, 9.0, 4.0, -2.5])
    assert add_correction(states, 2, states, 0, delta, 0, 0.0)[2] == 9.0  # as large as it was before the step
    assert not add_correction(states, 0, states, 0, np.array([[math.nan], [0.0]]), 0, 0.0)[3]
    assert not add_correction(states, 0, states, 0, np.array([[math.inf], [0.0]]), 0, 0.0)[3]


def test_a_body_at_rest_stays_on_its_branch_whatever_rounding_moves_it_by():
    before, delta, given = np.array([[0.0], [2.0]]), np.array([[-5e-17], [3e-3]]), (1e-9, 1e-18)
    rested, moving = np.array([[5e-17], [2.0]]), np.array([[0.0], [2.0]])
    for states, entry, outcome in ((rested, 0, PENDING), (moving, 1, FAILED)):
        some = np.where(np.arange(2)[:, np.newaxis] == entry, delta, 0.0)
        found = add_correction(states, 0, before, 0, some, 0, given[1])
        assert correction_test(0, LINEAR_CORRECTIONS, *found, *given) == outcome


@pytest.mark.parametrize("unit", [1e-9, 1e-3, 1.0, 1e6])
def test_corrections_are_judged_alike_in_all_units(unit):
    states, delta = np.array([[2e-4], [3.0]]), np.array([[1e-4], [0.5]])
    found = add_correction(states.copy(), 0, states, 0, delta, 0, 1e-8)
    scaled = add_correction(states * unit, 0, states * unit, 0, delta * unit, 0, 1e-8 * unit)
    np.testing.assert_allclose(scaled, (found[0], found[1] * unit, found[2] * unit, found[3]), rtol=1e-12)
    for rtol in (1e-12, 1e-6, 1e-2):
        wanted = largest_change(3.0, rtol, 1e-8)
        assert largest_change(3.0 * unit, rtol, 1e-8 * unit) == pytest.approx(wanted * unit, rel=1e-12)


def test_projections_may_take_the_energy_of_an_error():
    assert largest_change(2.0, 1e-8, 0.0) == pytest.approx(10.0 * 1e-4 * 2.0)
    assert largest_change(2.0, 0.1, 0.0) == BRANCH * 2.0
    assert largest_change(2.0, 0.0, 0.0) == pytest.approx(20.0 * math.sqrt(SMALLEST_OF_TIME))
    assert largest_change(0.0, 1e-8, 1e-6) == pytest.approx(1e-5)  # at rest
    assert largest_change(1e-2, 1e-8, 1e-6) == pytest.approx(10.0 * math.sqrt(1.0001e-6 * 1e-2) + 1e-5)


@pytest.mark.parametrize(
    ("attempt", "change", "finite", "outcome"),
    [
        (0, QUADRATIC_CHANGE, True, CONVERGED),
        (0, QUADRATIC_CHANGE * ABOVE, True, PENDING),
        (0, 1e3, True, PENDING),  # positions may be far away
        (LAST, LINEAR_CHANGE, True, PENDING),  # good enough
        (LAST, LINEAR_CHANGE * ABOVE, True, FAILED),
        (LAST - 1, LINEAR_CHANGE * ABOVE, True, PENDING),
        (LAST, QUADRATIC_CHANGE, True, CONVERGED),
        (0, 0.0, False, FAILED),
    ],
)
def test_outcomes_of_corrections_of_positions(attempt, change, finite, outcome):
    assert correction_test(attempt, MOST_CORRECTIONS, change, change, 1.0, finite, 1e-8, 1e-10) == outcome


@pytest.mark.parametrize("magnitude", [0.0, 2.0])
def test_the_first_correction_of_velocities_must_stay_on_its_branch(magnitude):
    given = magnitude, True, 1e-8, 1e-10
    largest = largest_change(magnitude, 1e-8, 1e-10)
    assert correction_test(0, LINEAR_CORRECTIONS, 0.2, largest, *given) == PENDING
    assert correction_test(0, LINEAR_CORRECTIONS, 0.2, largest * ABOVE, *given) == FAILED
    assert correction_test(1, LINEAR_CORRECTIONS, LINEAR_CHANGE, largest * 2.0, *given) == PENDING
    assert correction_test(0, MOST_CORRECTIONS, 0.2, largest * 2.0, *given) == PENDING


def kernel(monkeypatch, delta, corrections):
    """Have calls of code number k write the next of its corrections (n, lanes) to `delta`; return which were called."""
    calls = []

    def call_code(code, *addresses):
        calls.append(code)
        delta[...] = corrections[code][min(calls.count(code), len(corrections[code])) - 1]

    monkeypatch.setattr(projection, "call_code", call_code)
    return calls


def test_lanes_are_projected_until_each_has_settled(monkeypatch):
    states, delta, mark = np.full((1, 4), 10.0), np.zeros((1, 4)), np.array([PENDING, PENDING, NONE, PENDING])
    positions = [[[1.0, 1e-9, 5.0, 1.0]], [[1e-3, 5.0, 5.0, math.nan]], [[0.0, 5.0, 5.0, 5.0]]]
    calls = kernel(monkeypatch, delta, {1: positions, 2: [[[0.0, 5.0, 5.0, 5.0]]]})
    correct(1, 2, np.zeros((1, 4)), states, 0, states, 0, np.ones((1, 4)), delta, mark, 0.1, 1e-9)
    assert calls == [1, 1, 1, 2]
    assert list(mark) == [PENDING, FAILED, NONE, FAILED]  # the second was thrown off its branch by the velocities
    np.testing.assert_allclose(states[0, [0, 2]], [11.001, 10.0], rtol=1e-15)


def test_positions_that_do_not_settle_fail_after_the_most_corrections(monkeypatch):
    states, delta, mark = np.ones((1, 1)), np.zeros((1, 1)), np.array([PENDING])
    calls = kernel(monkeypatch, delta, {1: [[[1.0]], [[-1.0]]] * MOST_CORRECTIONS})
    correct(1, 0, np.zeros((1, 1)), states, 0, states, 0, np.ones((1, 1)), delta, mark, 1e-8, 1e-9)
    assert (len(calls), mark[0]) == (MOST_CORRECTIONS, FAILED)


def test_a_row_is_projected_at_its_time(monkeypatch):
    clock, rows, delta, mark = np.zeros((1, 1)), np.array([[1.0, 8.0], [2.0, 8.0]]), np.zeros((1, 1)), np.zeros(1, int)
    rest = rows, 0, np.ones((1, 1)), delta, mark, 1e-8, 1e-9
    assert project_row(0, 0, 3.0, clock, rows, 1, *rest)
    assert clock[0, 0] == 0.0  # nothing to do
    kernel(monkeypatch, delta, {1: [[[0.5]], [[0.0]]]})
    assert project_row(1, 0, 3.0, clock, rows, 1, *rest)
    assert clock[0, 0] == 3.0
    np.testing.assert_array_equal(rows, [[1.0, 8.0], [2.5, 8.0]])
    kernel(monkeypatch, delta, {1: [[[math.inf]]]})
    assert not project_row(1, 0, 3.0, clock, rows, 0, *rest)
