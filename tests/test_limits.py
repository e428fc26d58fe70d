"""The generated parts of docs/limits.md are those of the code."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("jax")
pytest.importorskip("numba")
sys.path.insert(0, str(Path(__file__).parents[1] / "docs"))

import generate_limits


def test_the_page_is_current():
    """If it is not: ``python docs/generate_limits.py``."""
    page = generate_limits.PAGE.read_text()
    assert generate_limits.filled(page) == page


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        ("'solve_fn' is for JAX: compile anew", ("'solve_fn' is for JAX", "compile anew")),
        ("… has loops (…), at which: no. Use another", ("a scene that has loops, at which: no", "Use another")),
        ("…: the input does not fit; give another", ("the input does not fit", "give another")),
        ("… does not support controllers (…): …", ("a call that does not support controllers", "the message names it")),
    ],
)
def test_messages_are_split_into_reason_and_remedy(message, expected):
    assert tuple(part.replace("… a", "a") for part in generate_limits.split(message)) == expected


def test_every_error_of_the_source_is_in_the_list():
    sources = (Path(generate_limits.ROOT) / "src").rglob("*.py")
    raised = sum(text.count("raise CapabilityError(\n") for text in (path.read_text() for path in sources))
    listed = generate_limits.errors().count("\n")
    assert 15 < raised <= listed
