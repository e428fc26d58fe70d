"""Signs and bounds of expressions over a whole step: never wrong, and exact means where expressions are affine."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from dalembert.events.reductions import KINDS
from dalembert.events.step_reductions import advance
from dalembert.ir.graph import Graph
from dalembert.ir.interpret import interpret
from dalembert.methods.chebyshev import BOUNDS, POINTS
from dalembert.transforms.lower_kernels import lower_kernel
from dalembert.transforms.step_bounds import (
    held_kernel,
    point_bounds_kernel,
    point_signs_kernel,
    polynomial_bounds_kernel,
    polynomial_signs_kernel,
)
from dalembert.transforms.step_polynomials import StepShape, are_polynomials, components_of, step_points_kernel

DEGREE, SIZE_AT, FIRST = 8, 2, 4
C, BEGIN = 1.7, 0.4
DENSE = np.linspace(0.0, 1.0, 401)


def expressions(affine_alone=False):
    """Return the kernel of an affine function of state, time and a constant, and perhaps of a product of states."""
    graph = Graph()
    x, y, t, c = (graph.input(name) for name in ("x", "y", "t", "c"))
    affine = graph.call("sqrt", c) * x - (y + 3 * t) / c + 0.3 * (c - 2 * x)
    inputs = {x: ("y", 0), y: ("y", 1), t: ("t", None), c: ("c", 0)}
    outputs = [affine] if affine_alone else [affine, x * y]
    return lower_kernel(graph, "values", outputs, inputs, arguments=("t", "y", "c"))


def step(random, in_time, direction):
    """Return the outputs of a step, and both expressions as polynomials of its fraction."""
    size = random.uniform(0.3, 1.2)
    h = direction * size if in_time else 1.0
    decay = 0.4 ** np.arange(DEGREE + 1)
    terms = random.normal(size=(2, DEGREE + 1)) * decay * [[random.choice([0.1, 1.0, 10.0])], [1.0]]
    terms[:, 0] = random.normal(size=2)
    x, y = (Polynomial(row) for row in terms)
    given = [x(1.0), y(1.0), size, 0.0, *(terms / h ** np.arange(DEGREE + 1)).ravel()]
    affine = np.sqrt(C) * x - (y + 3 * Polynomial([BEGIN, direction * size])) / C + 0.3 * (C - 2 * x)
    return given, (affine, x * y)


def said_of(values, shape):
    """Return a function from the outputs of a step to what kernels say of expressions: signs, and bounds by `KINDS`."""
    count = len(values.outputs)

    def rows(bounds, given):
        return np.stack([np.reshape(interpret(bounds[kind], given), (-1, BOUNDS)) for kind in KINDS], 1)

    if are_polynomials(values, shape):
        signs = polynomial_signs_kernel(values, shape)
        bounds = {kind: polynomial_bounds_kernel(values, shape, [kind] * count) for kind in KINDS}
        return lambda given: (interpret(signs, given), rows(bounds, given))
    points, signs = step_points_kernel(components_of(values), shape, 2), point_signs_kernel(count, False)
    bounds = {kind: point_bounds_kernel([kind] * count, False) for kind in KINDS}

    def said(given):
        at_points = np.reshape(interpret(points, given), (len(POINTS), 3))
        at = [interpret(values, {"t": row[0], "y": row[1:], "c": given["c"]}) for row in at_points]
        given = {**given, "y": np.ravel(at)}
        return interpret(signs, given), rows(bounds, given)

    return said


@pytest.mark.parametrize("affine", [True, False])
@pytest.mark.parametrize("in_time, direction", [(True, 1.0), (True, -1.0), (False, 1.0)])
def test_what_is_said_of_a_step_holds(in_time, direction, affine):
    random, shape, values = np.random.default_rng(5), StepShape(DEGREE, SIZE_AT, FIRST, in_time), expressions(affine)
    assert are_polynomials(values, shape) == (affine and in_time)
    said_of_step, said, rose = said_of(values, shape), 0, 0
    for _ in range(300):
        outputs, exact = step(random, in_time, direction)
        kept, found = said_of_step({"t": BEGIN, "y": outputs, "c": [C], "s": [1.0, direction]})
        for e, polynomial in enumerate(exact[: len(kept)]):
            dense, slopes = polynomial(DENSE), polynomial.deriv()(DENSE)
            (low_end, low), (high_end, high), (mean, smooth) = found[e] * [[-1.0], [1.0], [1.0]]
            monotone = low == low_end and high == high_end
            assert kept[e] == 0.0 or np.all(kept[e] * dense > 0.0)
            assert low <= np.min(dense) + 1e-12 and high >= np.max(dense) - 1e-12
            ends = sorted(dense[[0, -1]])
            assert [low_end, high_end] == pytest.approx(ends, rel=1e-11, abs=1e-11)
            assert not monotone or np.all(slopes >= 0.0) or np.all(slopes <= 0.0)
            assert not smooth or mean == pytest.approx(polynomial.integ()(1.0), rel=1e-7, abs=1e-9)
            said, rose = said + (kept[e] != 0.0), rose + monotone
        if affine and in_time:
            mean, smooth = found[0, KINDS.index("mean")]
            assert smooth == 1.0 and mean == pytest.approx(exact[0].integ()(1.0), rel=1e-12, abs=1e-13)
    assert min(said, rose) > (75 if affine else 150)


def test_steps_are_held_where_signs_and_bounds_decide_all():
    kinds, random, decided = ("maximum", "mean", "minimum"), np.random.default_rng(3), [0, 0]
    kernel, (t, size, direction) = held_kernel(2, kinds), (0.7, 0.3, -1.0)
    h = (t + direction * size) - t
    for _ in range(1000):
        expected, signs = (random.choice([-1.0, 0.0, 1.0], 2, p=[0.1, 0.05, 0.85]) for _ in range(2))
        bounds = np.array([random.normal(size=3), random.choice([0.0, 1.0], 3, p=[0.1, 0.9])]).T
        totals = random.normal(0.5, 1.0, size=3)
        rows = np.concatenate([expected, signs, bounds.ravel(), totals])
        keeps, *found = interpret(kernel, {"t": t, "y": rows, "c": [size], "s": [1.0, direction]})
        wanted = [
            advance(KINDS.index(kind), total, bounds.reshape(-1, 1), e, 0, h)
            for e, (kind, total) in enumerate(zip(kinds, totals, strict=True))
        ]
        assert found == [total for _, total in wanted]
        assert bool(keeps) == (all(known for known, _ in wanted) and bool(np.all(expected * signs > 0.0)))
        decided[int(keeps)] += 1
    assert min(decided) > 40


@pytest.mark.parametrize("rows", [slice(0, 1), slice(0, 2)])
def test_a_zero_at_the_end_of_a_step_is_no_sign(rows):
    # f = t - T and f (t + 1), where the step ends at T up to rounding, however short it is
    graph, random = Graph(), np.random.default_rng(2)
    t, end = graph.input("t"), graph.input("c")
    inputs = {t: ("t", None), end: ("c", 0)}
    outputs = [t - end, (t - end) * (t + 1)][rows]
    values = lower_kernel(graph, "values", outputs, inputs, arguments=("t", "y", "c"))
    said = said_of(values, StepShape(DEGREE, SIZE_AT, FIRST, in_time=True))
    outputs = np.zeros(FIRST + 2 * (DEGREE + 1))
    for _ in range(1000):
        begin, outputs[SIZE_AT] = random.uniform(0.1, 10.0), 10.0 ** random.uniform(-7, 0)
        signs = said({"t": begin, "y": outputs, "c": [begin + outputs[SIZE_AT]], "s": [1.0, 1.0]})[0]
        assert not np.any(signs)
