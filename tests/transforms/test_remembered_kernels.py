"""Kernels that were lowered before: the same for equal values, and for no others."""

from dataclasses import replace

import pytest

from dalembert.ir.graph import Graph
from dalembert.ir.node import unit_names
from dalembert.transforms.lower_kernels import LOWERED, lower_kernel


def lowered(records=None, **changes):
    """Return the kernel of two values of a graph of its own, with changes of what it is made of."""
    graph = Graph()
    graph.input("unused")
    x, y = (graph.input(name) for name in changes.get("names", "xy"))
    b = graph.const(changes.get("number", 3))
    values = [x * y / graph.sin(x) + b * y / graph.sin(x), changes.get("value", lambda x, y: x - y)(x, y)]
    places = {x: ("y", 0), y: changes.get("place", ("y", 1))}
    fixed, arguments = changes.get("fixed", "y"), changes.get("arguments", ("t", "y", "p"))
    still = None if fixed is None else [node for node in (x, y) if str(node.payload) in fixed]
    order = changes.get("order", (0, 1))
    nodes = [values[i] for i in order]
    return lower_kernel(graph, changes.get("name", "rhs"), nodes, places, arguments, fixed=still, records=records)


def test_equal_values_are_lowered_once():
    LOWERED.clear()
    first, again = [], []
    kernel = lowered(first)
    assert lowered(again) is kernel
    assert first[0].name == "rewrite products" and len(first) > 1
    assert again == [replace(record, seconds=0.0) for record in first] != first


OTHERS = {
    "name": {"name": "other"},
    "arguments": {"arguments": ("t", "y", "p", "s")},
    "place": {"place": ("p", 0)},
    "names of inputs": {"names": ("x", "z")},
    "number": {"number": 4},
    "operation": {"value": lambda x, y: x * y},
    "operands": {"value": lambda x, y: y - x},
    "order": {"order": (1, 0)},
    "twice": {"order": (0, 1, 1)},
    "what varies": {"fixed": "x"},
    "no forms": {"fixed": None},
}


@pytest.mark.parametrize("what", OTHERS)
def test_other_values_are_others(what):
    LOWERED.clear()
    expected = lowered(**OTHERS[what])
    LOWERED.clear()
    usual = lowered()
    assert lowered(**OTHERS[what]) == expected != usual


def test_components_of_unit_quaternions_are_not_inputs_of_the_same_names():
    """Squares of the four add up to one, squares of inputs of the same names do not."""

    def squares(names):
        graph = Graph()
        parts = [graph.input(name) for name in names]
        total = graph.sum(part * part for part in parts[:3])
        places = {part: ("y", i) for i, part in enumerate(parts)}
        return lower_kernel(graph, "rhs", [total], places, fixed=[])

    units = unit_names(["a", "b", "c", "d"])
    LOWERED.clear()
    plain = squares([str(name) for name in units])
    assert squares(units) is not plain
