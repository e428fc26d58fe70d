"""Expressions that are zero where a motion begins: the decisions on them, against polynomials, as plain Python."""

import math

import numpy as np
import pytest

from dalembert.events import event_rules as rules
from dalembert.methods.step_constants import BENT, DOUBT, FLAT, RESOLVED

ABOVE, BELOW = 1.0 + 1e-12, 1.0 - 1e-12


@pytest.mark.parametrize(("t", "h"), [(0.0, 0.5), (3.0, 0.5), (-2.0, -0.1), (1e6, 1e-3)])
def test_the_short_share_is_one_that_times_can_tell(t, h):
    share = rules.short_share(t, h)
    assert share > 0.0
    assert t + share * h == (t + share * h)
    assert ((t + share * h) - t) / h == share


def test_a_step_that_rounds_away_has_no_share_and_no_bend():
    share = rules.short_share(1e16, 1.0)
    assert share == 0.0
    assert math.isnan(rules.bend_from_rates(1.0, 2.0, 3.0, share))


@pytest.mark.parametrize("slope", [0.0, 2.0])
@pytest.mark.parametrize("bend", [-3.0, 0.0, 0.25])
def test_bends_of_cubics_come_from_three_rates(slope, bend):
    """Of slope x + bend x^2 + x^3, whose rate is quadratic: differences of second order are exact."""
    share = 0.01
    rates = [slope + 2.0 * bend * x + 3.0 * x * x for x in (0.0, share, 2.0 * share)]
    assert rules.bend_from_rates(*rates, share) == pytest.approx(bend, abs=1e-11)


def test_the_limit_of_an_error_counts_what_values_differ_from_the_bend_and_their_noise():
    share, slope, bend, off = 0.125, 2.0, 3.0, 0.5
    value = lambda x: slope * x + (bend + off) * x * x  # noqa: E731
    values = 8.0 * value(share) - value(2.0 * share) - 6.0 * share * slope
    exact = rules.error_limit(values, bend + off, 0.0, share)
    assert exact == pytest.approx(0.0, abs=1e-12)
    limit = rules.error_limit(values, bend, 0.0, share)
    assert limit > off  # the error that there is lies within
    assert rules.error_limit(values, bend, 1e-3, share) > limit


@pytest.mark.parametrize("slope", [0.0, 1e-3, 1.0])
@pytest.mark.parametrize("bend", [-2.0, -1e-8, 0.0, 1e-3, 2.0])
@pytest.mark.parametrize("least", [0.5, 30.0])
def test_the_deepest_dip_is_the_minimum_of_the_cubic(slope, bend, least):
    roots = np.roots([3.0 * least, -2.0 * bend, -slope])
    x = max(0.0, *roots.real)
    deepest = slope * x + bend * x * x - least * x**3
    assert rules.deepest_dip(slope, bend, least) == pytest.approx(max(deepest, 0.0), rel=1e-9, abs=1e-15)


def leaves(slope=0.0, bend=0.0, twice=-1.0, thrice=-1.0, largest=1.0, noise=0.0, known=False):
    return rules.leaves_zero(slope, bend, twice, thrice, largest, noise, known)


def test_a_flat_start_leaves_zero_where_the_rest_keeps_its_sign():
    assert leaves(twice=0.5)
    assert leaves(slope=FLAT * BELOW, twice=0.5) and not leaves(slope=FLAT * ABOVE, twice=0.5)
    assert not leaves(twice=0.0) and not leaves(twice=-0.5)
    assert leaves(bend=BENT * BELOW, thrice=0.5) and not leaves(bend=BENT * ABOVE, thrice=0.5)
    assert leaves(bend=-BENT * BELOW, thrice=0.5) and not leaves(bend=-BENT * ABOVE, thrice=0.5)


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_what_is_known_to_leave_zero_may_dip_by_its_noise_and_no_more(noise):
    """-slope x + twice x^2 falls to -slope^2 / (4 twice)."""
    twice, nothing = 0.5, max(noise, BENT)
    slope = math.sqrt(4.0 * twice * nothing)
    assert leaves(slope=slope * BELOW, twice=twice, noise=noise, known=True)
    assert not leaves(slope=slope * ABOVE, twice=twice, noise=noise, known=True)
    assert not leaves(slope=slope * BELOW, twice=twice, noise=noise, known=False)


def test_what_is_known_may_dip_by_a_cubic_whose_minimum_is_nothing():
    thrice, nothing = 2.0, 1e-3
    bend = (nothing * 27.0 * thrice**2 / 4.0) ** (
        1.0 / 3.0
    )  # bend x^2 - thrice x^3 is 4 bend^3 / (27 thrice^2) at most
    assert leaves(bend=bend * BELOW, thrice=thrice, noise=nothing, known=True)
    assert not leaves(bend=bend * (1.0 + 1e-9), thrice=thrice, noise=nothing, known=True)


@pytest.mark.parametrize(
    ("slope", "last", "agrees"),
    [(1.0, 2.0, True), (-1.0, -2.0, True), (1.0, -2.0, False), (-FLAT * BELOW, 1.0, True), (-FLAT * ABOVE, 1.0, False)],
)
def test_slopes_agree_with_values_on_their_side(slope, last, agrees):
    assert rules.slope_agrees(slope, last, 1.0) == agrees


@pytest.mark.parametrize(
    ("bend", "last", "twice", "agrees"),
    [
        (-1.0, 1.0, 0.0, True),  # the values do not say that it bends
        (1.0, 1.0, 1.0, True),
        (0.5, 1.0, 1.0, True),
        (0.5 * BELOW, 1.0, 1.0, False),  # it bends less than half of what the values say
        (-1.0, 1.0, 1.0, False),
        (-1.0, -1.0, 1.0, True),
    ],
)
def test_bends_agree_with_values_that_bend(bend, last, twice, agrees):
    assert rules.bend_agrees(bend, last, twice) == agrees


def test_the_doubt_about_a_bend_shrinks_only_by_pieces_that_resolve_it():
    assert rules.least_doubt(math.inf, 2.0, 2.0 * RESOLVED, 5.0) == 2.0
    assert rules.least_doubt(math.inf, 2.0, 2.0 * RESOLVED * ABOVE, 5.0) == math.inf
    assert rules.least_doubt(1.0, 2.0, 0.0, 5.0) == 1.0
    assert rules.least_doubt(4.0, 3.0, 0.0, 0.5) == 0.5


def test_values_within_the_error_of_the_polynomials_are_not_resolved():
    doubt, theta = 1e-6, 0.25
    level = DOUBT * doubt * theta**2
    assert rules.unresolved(-level * BELOW, theta, doubt) and not rules.unresolved(-level * ABOVE, theta, doubt)
    assert not rules.unresolved(0.0, theta, math.inf) and not rules.unresolved(0.0, theta, math.nan)
