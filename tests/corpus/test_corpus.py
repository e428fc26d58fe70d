"""A part of the corpus holds; ``make corpus`` compares all of it."""

import pytest

from corpus import named_scenes, random_scenes
from corpus.files import NAMED, RANDOM, entries

SOME = ("ready: chaplygin_sleigh", "ready: edge_plate", "slider-crank", "rod that sticks and slips")
FEW = entries(RANDOM)[::20]


def _name(entry):
    return f"{entry['seed']}-{entry['family']}-{entry['style']}"


def test_the_corpus_is_whole():
    named, random = entries(NAMED), entries(RANDOM)
    assert len(named) + len(random) >= 200
    assert len({entry["name"] for entry in named}) == len(named)
    assert len({entry["seed"] for entry in random}) == len(random)
    assert sum(file.stat().st_size for file in (NAMED, RANDOM)) < 1_000_000
    assert all(entry["bound"] <= 1e-6 for entry in random)
    loose = {entry["name"] for entry in named if entry["bound"] > 1e-6}
    assert loose == {"double pendulum, angles", "double pendulum, Cartesian"}  # chaotic


@pytest.mark.parametrize("name", SOME)
def test_named_scenes_end_as_recorded(name):
    (entry,) = [entry for entry in entries(NAMED) if entry["name"] == name]
    assert named_scenes.checked(entry)[1] == []


@pytest.mark.parametrize("entry", FEW, ids=_name)
def test_random_scenes_end_at_the_reference(entry):
    assert random_scenes.checked(entry)[1] == []


def test_a_difference_is_found():
    entry = dict(FEW[0])
    entry["final"] = [entry["final"][0] + 1e-6, *entry["final"][1:]]
    _, (text,) = random_scenes.checked(entry)
    assert text.startswith("final off by 1.0e-06")
