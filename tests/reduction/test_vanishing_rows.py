"""Sizes of rows of the constraint Jacobian that vanish at some angles."""

import pytest

from dalembert.ir.graph import Graph
from dalembert.reduction.dependent_rows import row_scale


def _row(graph, *texts):
    names = {name: graph.input(name) for name in ("a", "b", "x", "l")}
    sines = {f"{kind} {angle}": graph.call(kind, names[angle]) for kind in ("sin", "cos") for angle in ("a", "b")}
    known = {**names, **sines, "0": graph.zero, "1": graph.one}
    products = (text.split(" * ") for text in texts)
    return [known[factors[0]] if len(factors) == 1 else known[factors[0]] * known[factors[1]] for factors in products]


@pytest.mark.parametrize(
    ("row", "vanishes"),
    [
        (("l * cos a", "l * cos b"), True),
        (("l * cos a", "0"), True),
        (("x", "x * cos a"), False),
        (("1", "l * cos a"), False),
        (("sin a", "cos a", "x * cos a"), False),  # a unit vector and a moment
        (("sin a", "cos b"), True),
    ],
)
def test_rows_that_vanish_at_some_angles(row, vanishes):
    graph = Graph()
    entries = _row(graph, *row)
    assert row_scale(graph, entries, [graph.one] * len(entries)).is_zero is not vanishes
