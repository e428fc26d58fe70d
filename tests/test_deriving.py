"""Collections of garbage while something is derived."""

import gc

import pytest

from dalembert.once import deriving


@pytest.fixture
def threshold():
    """Set other limits than Python's own, and set these again after a test."""
    before = gc.get_threshold()
    gc.set_threshold(701, 11, 12)
    yield (701, 11, 12)
    gc.set_threshold(*before)


def test_old_objects_are_not_collected_while_something_is_derived(threshold):
    """Limits of young objects stay, and all are as before in the end, also where one derivation is within another."""

    @deriving
    def inner():
        return gc.get_threshold()

    @deriving
    def outer():
        return inner(), gc.get_threshold()

    within, after = outer()
    assert within == after
    assert within[:2] == threshold[:2]
    assert within[2] > 1000 * threshold[2]
    assert gc.get_threshold() == threshold


def test_limits_are_as_before_after_an_error(threshold):
    """An error of a derivation leaves nothing changed."""

    @deriving
    def fails():
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        fails()
    assert gc.get_threshold() == threshold
