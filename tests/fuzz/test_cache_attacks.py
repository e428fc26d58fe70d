"""A few rounds of the attacks on the cache; the scripts run as many as one likes."""

import os

import pytest

from fuzz import damaged_cache, kills

pytestmark = [pytest.mark.matrix, pytest.mark.skipif(not hasattr(os, "fork"), reason="children are forked")]


def test_damaged_caches_give_right_results():
    counts, wrong = damaged_cache.attacked(12, 0)
    assert not wrong, wrong
    assert sum(counts.values()) == 12


def test_killed_processes_leave_a_cache_that_is_right():
    counts, wrong = kills.attacked(3, 0)
    assert not wrong, wrong
    assert counts["right"] == 1
