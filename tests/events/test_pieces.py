"""Pieces of steps: which need no cut, and what they add to extrema and means, on polynomials, as plain Python."""

import math

import numpy as np
import pytest

from dalembert.events.event_intervals import SERIES, converges, simple_piece, state_at, transformed
from dalembert.events.step_reductions import MAXIMUM, MEAN, MINIMUM, _mean_of_piece, _turning, advance
from dalembert.lanes.workspace import event_workspace, no_events
from dalembert.methods.chebyshev import POINTS


def watched(*functions, noise=0.0, **starts):
    """Return a workspace that holds the values of expressions at the points of the whole step."""
    space = event_workspace(no_events()._replace(directions=np.zeros(len(functions), np.int64)), 1, 4, 1, 1, 1)
    for e, function in enumerate(functions):
        space.values[e] = [function(x) for x in POINTS]
    space.noise[0] = noise
    for name, value in starts.items():
        getattr(space, name)[...] = value
    return space


def simple(*functions, fresh=False, **about):
    """Return whether the whole step is simple, and whether all values are finite."""
    return simple_piece(np.zeros(len(functions), np.int64), watched(*functions, **about), 0, fresh, 1.0, 1.0)


@pytest.mark.parametrize(
    ("function", "is_simple"),
    [
        (lambda x: 1.0 + x * x, True),  # no zero
        (lambda x: x - 0.3, True),  # one
        (lambda x: (x - 0.3) * (1.0 + x), True),
        (lambda x: (x - 0.3) * (x - 0.31), False),  # two between neighbouring points, where the values show one sign
        (lambda x: (x - 0.5) ** 2 - 1e-6, False),
        (lambda x: (x - 0.5) ** 2 + 1e-6, True),  # it comes near zero, as its series shows
        (lambda x: (x - 0.2) * (x - 0.5) * (x - 0.9), False),
        (lambda x: (x - 0.5) ** 3, False),  # a zero without a slope
    ],
)
def test_a_piece_is_simple_where_no_zero_but_that_of_its_ends_can_be(function, is_simple):
    assert simple(function) == (is_simple, True)


def test_one_expression_that_is_not_simple_cuts_the_piece_of_all():
    one, two = (lambda x: x - 0.3), (lambda x: (x - 0.3) * (x - 0.31))
    assert simple(one, two) == simple(two, one) == (False, True)
    space = watched(one, two)
    space.may_change[0, 1] = 0.0  # bounds over the step say that it keeps its sign
    assert simple_piece(np.zeros(2, np.int64), space, 0, False, 1.0, 1.0) == (True, True)


def test_what_does_not_rise_above_its_noise_has_no_zeros():
    wave = lambda x: 1e-9 * math.sin(40.0 * x)  # noqa: E731
    assert simple(wave) == (False, True)
    assert simple(wave, noise=1e-9) == (True, True)


def test_values_that_are_not_finite_are_told():
    assert simple(lambda x: x - 0.3 if x < 0.5 else math.nan)[1] is False
    assert simple(lambda x: math.inf) == (True, False)


@pytest.mark.parametrize(
    ("function", "rate", "is_simple"),
    [
        (lambda x: x + x * x, 1.0, True),
        (lambda x: x - 2.0 * x * x, 1.0, False),  # it comes back
        (lambda x: x * x, 0.0, True),  # it leaves without a slope
        (lambda x: x * x * (0.4 - x), 0.0, False),
        (lambda x: x + x * x, -1.0, False),  # the rate contradicts the values
    ],
)
def test_a_step_that_begins_in_a_zero(function, rate, is_simple):
    assert simple(function, fresh=True, zero=1.0, rates=[[rate], [0.0], [math.inf], [math.inf]])[0] == is_simple


def test_series_of_polynomials_converge_and_those_of_what_oscillates_between_the_points_do_not():
    for function, expected in ((lambda x: x**3 - x, True), (lambda x: math.sin(60.0 * x), False)):
        space = watched(function)
        transformed(SERIES, space, 0, 0)
        assert converges(space.work) == expected
        again = np.polynomial.chebyshev.chebval(2.0 * POINTS - 1.0, space.work[0])
        np.testing.assert_allclose(again, space.values[0], atol=1e-14)


def test_states_are_those_of_their_polynomials():
    space = watched(lambda x: x)
    space.series[0] = [1.0, -2.0, 0.5, 4.0, -1.0]
    state_at(space, 1, 0.3, 1)
    assert space.one_point[1, 0] == pytest.approx(np.polynomial.polynomial.polyval(0.3, space.series[0]), rel=1e-15)


def bounds(value, reach):
    """Return what `advance` reads over a step: of a maximum, the larger value at the ends, and an upper bound."""
    return np.array([[value], [reach]])


def test_bounds_that_cannot_raise_an_extremum_decide_a_step():
    assert advance(MAXIMUM, 5.0, bounds(0.0, 4.0), 0, 0, 0.1) == (True, 5.0)
    assert advance(MAXIMUM, 5.0, bounds(6.0, 6.0), 0, 0, 0.1) == (True, 6.0)
    assert advance(MAXIMUM, 5.0, bounds(6.0, 6.1), 0, 0, 0.1) == (False, 6.0)
    assert advance(MINIMUM, -5.0, bounds(0.0, 4.0), 0, 0, 0.1) == (True, -5.0)
    assert advance(MINIMUM, -5.0, bounds(6.0, 6.1), 0, 0, 0.1) == (False, -6.0)


def test_means_that_the_step_knows_are_added():
    assert advance(MEAN, 1.0, bounds(3.0, 1.0), 0, 0, 0.5) == (True, 2.5)
    assert not advance(MEAN, 1.0, bounds(3.0, 0.0), 0, 0, 0.5)[0]


def test_means_of_polynomials_are_exact_and_those_of_what_is_not_resolved_wait_for_the_last_piece():
    smooth, wave = np.polynomial.Polynomial([1.0, -3.0, 2.0, 5.0]), lambda x: math.sin(60.0 * x)
    for function, settled in ((smooth, True), (wave, False)):
        space = watched(function)
        transformed(SERIES, space, 0, 0)
        assert _mean_of_piece(space.work, False)[0] == settled
        assert _mean_of_piece(space.work, True)[0]
    space = watched(smooth)
    transformed(SERIES, space, 0, 0)
    assert _mean_of_piece(space.work, False)[1] == pytest.approx(smooth.integ()(1.0), rel=1e-14)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("top", [0.125, 0.5, 0.9])
def test_a_slope_that_falls_changes_its_sign_at_the_extremum(sign, top):
    space = watched(lambda x: 0.0)
    space.work[1] = 0.0
    space.work[1, :2] = sign * (top - 0.5), -sign * 0.5  # of sign times (top - x), by the piece from -1 to 1
    assert _turning(space.work, sign) == pytest.approx(top, abs=1e-14)
