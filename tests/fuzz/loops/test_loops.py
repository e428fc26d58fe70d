"""Random closed loops with redundant conditions, a few of those of ``python -m fuzz.loops``."""

import pytest

from fuzz.loops.compare import compared, examined
from fuzz.loops.mechanisms import FAMILIES, LONG, Draw

SEEDS = [
    *range(len(FAMILIES)),
    *(pytest.param(len(FAMILIES) + i, marks=pytest.mark.matrix) for i in range(len(FAMILIES))),
]


@pytest.mark.parametrize("seed", SEEDS)
def test_loops_move_as_derived_by_hand(seed):
    outcome, text = examined(seed)
    assert outcome == "agree", text


@pytest.mark.parametrize("formulation", ["baumgarte", "augmented", "ggl"])
@pytest.mark.parametrize("family", ["three_cranks", "scott_russell", "sarrus"])
def test_loops_move_alike_in_all_formulations(family, formulation):
    outcome, text = examined(list(FAMILIES).index(family), formulation)
    assert outcome == "agree", text


@pytest.mark.parametrize("formulation", ["auto", "baumgarte", "augmented", "ggl"])
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("family", LONG)
def test_long_loops_move_as_derived_by_hand(family, seed, formulation):
    """Their conditions are solved in groups."""
    outcome, text = compared(family, LONG[family](Draw(seed)), formulation)
    assert outcome == "agree", text
