"""Tables behind SymPy: pieces, derivatives and antiderivatives, and their text in programs."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import dalembert as da
from dalembert.errors import ProgramTextError
from dalembert.ir.graph import Graph
from dalembert.ir.interpret import interpret, interpret_rows
from dalembert.ir.intervals import INTERVAL_OPERATIONS, Interval
from dalembert.ir.program import Program
from dalembert.ir.tables import array_value, piece, value
from dalembert.ir.zero_tests import vanishes
from dalembert.transforms.antiderivatives import Antiderivatives
from dalembert.transforms.derivatives import tangents
from dalembert.transforms.lower_kernels import lower_kernel
from table_cases import CURVES, KINDS, KNOTS, VALUES, oscillator, spring

POINTS = np.concatenate([np.linspace(-1.99, 1.99, 41), KNOTS])


def key_of(kind, extrapolate="error"):
    return spring(kind, extrapolate).curve.table.key


@pytest.mark.parametrize("kind", KINDS)
def test_values_are_those_of_scipy(kind):
    key = key_of(kind)
    np.testing.assert_allclose(array_value(POINTS, key, 0), CURVES[kind](POINTS), rtol=1e-13, atol=1e-14)
    assert [value(q, key, 0) for q in POINTS] == pytest.approx(list(array_value(POINTS, key, 0)))
    assert np.isnan(array_value(np.array([-2.001, 2.001, np.nan]), key, 0)[:2]).all()


@pytest.mark.parametrize(("extrapolate", "kind"), [(e, k) for e in ("hold", "linear") for k in KINDS])
def test_what_lies_outside_of_the_knots(extrapolate, kind):
    table = spring(kind, extrapolate).curve.table
    for end, beyond in ((-2.0, -2.5), (2.0, 3.25)):
        slope = value(end, table.key, 1) if kind != "hold" else 0.0
        if extrapolate == "linear" and kind != "hold":
            inside = end - 1e-9 * np.sign(end)
            slope = value(inside, table.key, 1)
        wanted = CURVES[kind](end) + (slope * (beyond - end) if extrapolate == "linear" else 0.0)
        assert value(beyond, table.key, 0) == pytest.approx(float(wanted), rel=1e-7)


def test_hold_is_continuous_from_the_right():
    key = key_of("hold")
    assert [value(q, key, 0) for q in KNOTS] == list(VALUES)
    assert value(np.nextafter(KNOTS[3], -9.0), key, 0) == VALUES[2]
    assert piece(np.nan, key) == 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_and_antiderivatives_of_the_graph(kind):
    graph = Graph()
    q = graph.input("q")
    curve = graph.call("table", q, graph.const(key_of(kind)), graph.zero)
    whole = Antiderivatives(graph, [q]).by_input(curve, q)
    orders = [whole, curve, tangents(graph, [curve], {q: graph.one})[0]]
    kernel = lower_kernel(graph, "k", orders, {q: ("y", 0)}, arguments=("t", "y", "c"))
    points = np.linspace(-1.93, 1.93, 30)
    rows = interpret_rows(kernel, np.zeros(30), points[:, np.newaxis], np.zeros(0))
    assert interpret(kernel, {"t": 0.0, "y": [points[3]], "c": []}) == pytest.approx(list(rows[3]))
    h = 1e-6
    for i in (0, 1):
        shifted = [
            interpret_rows(kernel, np.zeros(30), (points + d)[:, np.newaxis], np.zeros(0))[:, i] for d in (h, -h)
        ]
        np.testing.assert_allclose((shifted[0] - shifted[1]) / (2 * h), rows[:, i + 1], rtol=1e-7, atol=1e-7)
    if kind == "cubic":
        exact = CubicSpline(KNOTS, VALUES).antiderivative()
        np.testing.assert_allclose(rows[:, 0], exact(points), rtol=1e-12, atol=1e-13)


def test_nothing_is_known_of_a_table_but_its_identity():
    """A table that is nothing, or a line, where random points lie is neither in zero tests nor in antiderivatives."""
    stop = da.table(spring("linear").args[0], [0, 5, 6, 7], [0.0, 0.0, 0.1, 0.3]).curve.table
    graph = Graph()
    q, tenth = graph.input("q"), graph.decimal(graph.const(1).number / 10)
    curve = graph.call("table", q, graph.const(stop.key), graph.zero)
    assert not vanishes(curve * tenth) and vanishes(curve - curve)
    found = Antiderivatives(graph, [q]).along(curve, q)
    assert found is graph.call("table", q, graph.const(stop.key), graph.const(-1))


@pytest.mark.parametrize("kind", KINDS)
def test_programs_print_their_tables(kind):
    program = da.compile_model(oscillator(kind), backend="numpy").stages.program
    text = str(program)
    assert Program.parse(text) == program and str(Program.parse(text)) == text
    (table,) = program.tables
    assert f"table {table.key}\n  name spring\n" in text
    with pytest.raises(ProgramTextError, match="a table with the digest"):
        Program.parse(text.replace("name spring", "name other"))


def test_intervals_enclose_a_table():
    key = key_of("cubic")
    graph = Graph()
    q = graph.input("q")
    curve = graph.call("table", q, graph.const(key), graph.zero)
    kernel = lower_kernel(graph, "k", [curve], {q: ("t", None)}, arguments=("t", "p"))
    ends = np.linspace(-1.9, 1.9, 60)
    low, high = ends[:-1], ends[1:]
    (bounds,) = interpret(kernel, {"t": Interval(low, high, np.ones(59), np.ones(59)), "p": []}, INTERVAL_OPERATIONS)
    for share in (0.0, 0.37, 1.0):
        inside = array_value(low + share * (high - low), key, 0)
        assert np.all((bounds.low <= inside) & (inside <= bounds.high))
