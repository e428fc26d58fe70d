"""Decisions on events at their boundaries, as plain Python."""

import math

import numpy as np
import pytest

from dalembert.events import event_rules as rules
from dalembert.events.event_intervals import push_halves
from dalembert.lanes.workspace import event_workspace, no_events
from dalembert.methods.step_constants import (
    RESOLUTION,
    SHORT_SPAN,
    SOON,
    SOON_IN_A_ROW,
    TIME_NOISE,
    TOGETHER,
)

ABOVE, BELOW = 1.0 + 1e-12, 1.0 - 1e-12


@pytest.mark.parametrize(
    ("value", "noise", "sign"), [(2.0, 1.0, 1.0), (-2.0, 1.0, -1.0), (1.0, 1.0, 0.0), (math.nan, 0.0, 0.0)]
)
def test_sign_beyond(value, noise, sign):
    assert rules.sign_beyond(value, noise) == sign


def test_zero_level_is_noise_and_what_rounding_makes_of_the_time():
    assert rules.zero_level(-3.0, 0.5, -2.0) == 0.5 + TIME_NOISE * 6.0
    assert rules.zero_level(math.inf, 0.5, 1.0) == rules.zero_level(1.0, math.nan, 1.0) == 0.0


@pytest.mark.parametrize(
    ("value", "rate", "forward", "found"),
    [
        (0.5, -1.0, 1.0, (1.0, False)),
        (-0.5, 1.0, 1.0, (-1.0, False)),
        (0.0, -1.0, 1.0, (-1.0, True)),  # a zero takes the sign of its rate
        (0.0, -1.0, -1.0, (1.0, True)),
        (0.0, 0.0, 1.0, (0.0, True)),
        (math.nan, 1.0, 1.0, (0.0, False)),
    ],
)
def test_start_sign(value, rate, forward, found):
    assert rules.start_sign(value, rate, 0.0, 0.0, 0.0, forward, 0) == found


@pytest.mark.parametrize(
    ("noise", "residual", "t", "level"),
    [(1e-3, 0.0, 0.0, 1e-3), (0.0, 1e-3, 0.0, 1e-3), (0.0, 0.0, -5.0, RESOLUTION * 10)],
)
def test_a_start_is_zero_up_to_noise_residual_and_rounding_of_the_time(noise, residual, t, level):
    assert rules.start_sign(-level * BELOW, 2.0, noise, residual, t, 1.0, 0) == (1.0, True)
    assert rules.start_sign(-level * ABOVE, 2.0, noise, residual, t, 1.0, 0) == (-1.0, False)


@pytest.mark.parametrize("direction", [2, -2])
def test_an_armed_event_has_not_occurred_where_the_motion_begins(direction):
    before = -0.5 * direction
    for value, zero in ((before, False), (0.0, True), (before * 1e-20, True), (-before * 1e-20, True), (-before, True)):
        assert rules.start_sign(value, 1.0, 1e-15, 0.0, 0.0, 1.0, direction) == (before, zero)


def test_changes_count_by_direction():
    table = {
        (direction, sign): rules.change_counts(direction, sign) for direction in (0, 1, -1, 2) for sign in (1.0, -1.0)
    }
    assert [pair for pair, counts in table.items() if not counts] == [(1, -1.0), (-1, 1.0), (2, -1.0)]


def test_events_happen_together_within_what_rounding_makes_of_the_time():
    assert rules.happens_together(-3.0 * TOGETHER * BELOW, 3.0, -1.0)
    assert not rules.happens_together(3.0 * TOGETHER * ABOVE, 3.0, -1.0)
    assert rules.happens_together(3.0 * TOGETHER * BELOW, 1.0, -3.0)


def test_jumps_accumulate():
    span = 10.0
    assert rules.too_soon(SOON * span * BELOW, span, 2.0) == 3.0
    assert rules.too_soon(SOON * span * ABOVE, span, 2.0) == 0.0
    apart = 1e-3
    assert not rules.accumulates(apart, 5.0, span, True, SOON_IN_A_ROW - 1.0)
    assert rules.accumulates(apart, 5.0, span, True, float(SOON_IN_A_ROW))
    assert rules.accumulates(apart, 5.0, span, False, 0.0)
    assert rules.accumulates(5.0 * RESOLUTION * BELOW, -5.0, span, True, 0.0)
    assert not rules.accumulates(5.0 * RESOLUTION * ABOVE, -5.0, span, True, 0.0)
    assert rules.accumulates(SHORT_SPAN * span * RESOLUTION * BELOW, 0.0, span, True, 0.0)
    assert not rules.accumulates(SHORT_SPAN * span * RESOLUTION * ABOVE, 0.0, span, True, 0.0)


@pytest.mark.parametrize(
    ("before", "direction", "value", "sign"),
    [
        (math.nan, 0, 1.0, 0.0),  # a motion begins
        (0.0, 0, 1.0, 0.0),  # it was not known
        (1.0, 0, -1.0, 1.0),  # what a stop has changed is seen as a change behind it
        (-1.0, 1, 1.0, -1.0),
        (1.0, 2, 3.0, -1.0),  # an armed event has the sign of its side
        (1.0, -2, 3.0, 1.0),
        (1.0, 2, 0.0, 0.0),  # and none where it is zero
    ],
)
def test_signs_are_carried_over_stops(before, direction, value, sign):
    assert rules.carried_sign(before, value, 1.0, 1e-15, 0.0, 1.0, direction) == sign


@pytest.mark.parametrize("forward", [1.0, -1.0])
def test_what_is_recorded_at_the_time_of_an_occurrence_is_the_motion_after_it(forward):
    t, rounding = 3.0, 3.0 * RESOLUTION
    assert rules.recorded_after(t, t, forward)
    assert rules.recorded_after(t - forward * rounding * 0.9, t, forward)
    assert not rules.recorded_after(t - forward * rounding * 1.1, t, forward)
    assert rules.recorded_after(t + forward, t, forward)


@pytest.mark.parametrize("start", [0.0, 1e9, -1e9])
def test_the_last_instants_are_those_that_still_round_to_the_same_times(start):
    elapsed = np.array([0.25, -0.25, 7.0])
    last = rules.last_instants(elapsed, start)
    np.testing.assert_array_equal(np.sign(last - elapsed), np.sign(elapsed) * (start != 0.0))
    beyond = elapsed + (last - elapsed) * 1.01
    if start:
        np.testing.assert_array_equal(start + (elapsed + (last - elapsed) * 0.99), start + elapsed)
        assert (start + beyond != start + elapsed).all()


def test_halves_of_a_piece_come_in_the_order_of_time():
    space = event_workspace(no_events(), 1, 4, 1, 3, 1)
    assert push_halves(space, 1, 0.5, 1.0, 1.0) == 3
    np.testing.assert_array_equal(space.stack[1:3], [[0.75, 1.0, 2.0], [0.5, 0.75, 2.0]])
