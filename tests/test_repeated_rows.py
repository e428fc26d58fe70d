"""The table of repeated rows names tests that there are, and leaves others alone."""

import re
from pathlib import Path

import pytest

from repeated_rows import REPEATED, repeated_in_products, repeats

TESTS = Path(__file__).parent


@pytest.mark.parametrize("file, pattern", REPEATED)
def test_every_row_names_a_test(file, pattern):
    name = re.match(r"test_\w+", pattern)
    assert name and f"def {name[0]}" in (TESTS / file).read_text()


def test_rows_of_backends_stay_where_they_are_compared():
    assert repeats("system/test_tables.py", "test_motions[numba-taylor]", ["numba", "taylor"])
    assert not repeats("system/test_tables.py", "test_motions[llvm-taylor]", ["llvm", "taylor"])
    assert not repeats("codegen/test_kernels.py", "test_kernels[numba]", ["numba"])
    assert repeats("stops/test_function_samples.py", "test_every_backend[jax]", ["jax"])
    assert not repeats("system/test_tables.py", "test_motions[jax-taylor]", ["jax", "taylor"])


def test_each_value_of_a_product_stays_and_values_take_turns():
    scenes, formulations = ("sleigh", "sphere", "plate", "pendulum"), ("minimal", "projected")
    rows = {f"{a}-{b}": {"scene": a, "formulation": b} for a in scenes for b in formulations}
    dropped = repeated_in_products(rows)
    kept = [row for name, row in rows.items() if name not in dropped]
    assert [row["scene"] for row in kept] == [*scenes]
    assert sorted(row["formulation"] for row in kept) == ["minimal", "minimal", "projected", "projected"]


def test_rows_that_share_no_value_all_stay():
    assert repeated_in_products({"1-2": {"a": 1, "b": 2}, "3-4": {"a": 3, "b": 4}}) == []
