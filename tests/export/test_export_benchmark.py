"""The benchmark of exports: what it says of a step of a fixed size."""

import shutil
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

import export_kinds
import exports


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_steps_of_a_fixed_size_are_measured(tmp_path, monkeypatch):
    """Their operations are those of the README, and each row has a cell for each column."""
    monkeypatch.setattr(export_kinds, "LEAST", 0.001)
    steps = (found for found in export_kinds.further(True) if getattr(found[0], "func", None) is export_kinds.fixed)
    measure, motion = next(found for found in steps if found[1].name == "chaplygin sleigh")
    row = measure(motion, tmp_path)
    counted = (tmp_path / "export" / "README.md").read_text().split("## Operations of a step")[1]
    numbers = [line.split("|")[2].strip() for line in counted.splitlines() if line.startswith("| ")]
    assert row.operations == sum(int(number) for number in numbers if number.isdigit()) > 100
    assert row.steps == 2000 and 0 < row.own < 0.1 and 0 < float(row.difference) < 1e-12
    lines = exports.table([row]).splitlines()
    assert len({line.count("|") for line in lines}) == 1
