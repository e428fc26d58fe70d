"""The table of repeated rows names tests that there are, and leaves others alone."""

import re
from pathlib import Path

import pytest

from repeated_rows import REPEATED, repeats

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
