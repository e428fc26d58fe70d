"""Events with series of their own: the series, what they do to a Taylor step, and the test of their signs."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from dalembert.events import event_series
from dalembert.events.event_series import at_most_one_zero
from dalembert.ir.graph import Graph
from dalembert.ir.interpret import interpret
from dalembert.lanes.workspace import event_workspace, no_events
from dalembert.transforms.lower_kernels import lower_kernel
from dalembert.transforms.step_bounds import series_signs_kernel
from dalembert.transforms.taylor.nonsmooth import nonanalytic_operations
from dalembert.transforms.taylor.recurrences import recurrences
from dalembert.transforms.taylor.step import step_kernel

ORDER = 14
STATE, LARGEST = [0.7, 0.4], 5.0


def joint(*expressions):
    """Return the kernel of a pendulum's right-hand side and of expressions of graph, angle, rate and time."""
    graph = Graph()
    x, v, t = (graph.input(name) for name in ("x", "v", "t"))
    nodes = [v, -9.81 * graph.sin(x), *(make(graph, x, v, t) for make in expressions)]
    inputs = {x: ("y", 0), v: ("y", 1), t: ("t", None)}
    return lower_kernel(graph, "joint", nodes, inputs, arguments=("t", "y", "c"))


def stepped(kernel, count, direction=1.0):
    """Return the state after a step, its size, and the series of state and integrals."""
    step = step_kernel(recurrences(kernel, count), ORDER, dense=True)
    given = {"t": 0.3, "y": [*STATE, *[0.0] * count], "c": [], "s": [LARGEST, direction, 1e-3]}
    out = interpret(step, given)
    size = 2 + count
    assert out[2:size] == [0.0] * count  # integrals begin anew in the next step
    return np.array(out[:2]), out[size], np.reshape(out[size + 2 :], (size, ORDER + 1))


def pull(graph, x, v, t):
    return v * v * 2 + 9.81 * graph.cos(x) - graph.sin(3 * t) / (2 + x)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_series_are_those_of_the_expressions(direction):
    kernel = joint(pull)
    _, size, series = stepped(kernel, 1, direction)
    terms = series[2, 1:] * np.arange(1, ORDER + 1)
    for h in direction * size * np.array([0.0, 0.4, 1.0]):
        state = [np.polynomial.polynomial.polyval(h, row) for row in series[:2]]
        exact = interpret(kernel, {"t": 0.3 + h, "y": state, "c": []})[2]
        assert np.polynomial.polynomial.polyval(h, terms) == pytest.approx(exact, rel=1e-6)


def test_units_of_what_is_followed_do_not_set_the_step():
    sizes = [stepped(joint(lambda g, x, v, t, c=c: c * pull(g, x, v, t)), 1)[1] for c in (1e-9, 1.0, 1e9)]
    np.testing.assert_allclose(sizes, sizes[1], rtol=1e-9)


def test_what_varies_fast_shortens_the_step_and_nothing_does_not():
    plain, fast, zero = (
        stepped(joint(make), 1)[1]
        for make in (lambda g, x, v, t: v, lambda g, x, v, t: g.sin(60 * t), lambda g, x, v, t: v - v)
    )
    assert fast < 0.5 * plain
    assert zero == stepped(joint(), 0)[1] >= plain


def test_the_state_moves_as_without():
    alone, size, _ = stepped(joint(), 0)
    together, other, _ = stepped(joint(lambda g, x, v, t: v - v), 1)
    assert size == other
    np.testing.assert_array_equal(alone, together)


def test_the_sign_over_a_step_is_never_wrong():
    """Random series: what is said to keep its sign does, and most of those far from zero are said to."""
    kernel, rng, sure = series_signs_kernel(1, 3, ORDER), np.random.default_rng(11), 0
    for _ in range(200):
        h = rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 2.0)
        terms = rng.normal(size=ORDER) * 0.4 ** np.arange(ORDER) / np.abs(h) ** np.arange(ORDER)
        terms[0] += rng.choice([-1.5, 0.0, 1.5])
        integral = np.concatenate([[0.0], terms / np.arange(1, ORDER + 1)])
        y = [0.0] * 3 + [abs(h), 0.0] + [0.0] * (2 * (ORDER + 1)) + integral.tolist()
        (sign,) = interpret(kernel, {"t": 0.0, "y": y, "c": [], "s": [9.0, np.sign(h)]})
        values = np.polynomial.polynomial.polyval(np.linspace(0, h, 200), terms)
        if sign:
            assert np.all(sign * values > 0)
        sure += bool(sign)
    assert sure > 60


def test_what_no_series_shows_is_not_followed():
    assert not nonanalytic_operations(joint(pull))
    assert nonanalytic_operations(joint(lambda g, x, v, t: g.call("abs", v)))
    assert nonanalytic_operations(joint(lambda g, x, v, t: g.call("tanh", v)))


def test_a_plain_step_has_what_its_ends_say():
    """Random series, some of which leave zero, some of these flatly: no zero inside but the one between other signs."""
    rng, theta, found = np.random.default_rng(5), np.linspace(0, 1, 400)[1:], {True: 0, False: 0}
    space = event_workspace(
        no_events()._replace(events_with_series=1, directions=np.ones(1, np.int64)), 1, ORDER, 1, 2, 1
    )
    for i in range(600):
        terms = rng.normal(size=ORDER) * 0.3 ** np.arange(ORDER)
        fresh = bool(i % 2)
        if fresh:
            terms[: 1 + i % 3 // 2] = 0.0
        space.event_series[0], space.zero[0, 0], space.may_change[0, 0] = terms, float(fresh), 1.0
        if not at_most_one_zero(space, 0, fresh):
            continue
        values = np.polynomial.polynomial.polyval(theta, terms)
        signs = np.sign(values[np.abs(values) > 1e-14])
        first, last = space.values[0, 0], space.values[0, 7]
        assert last == pytest.approx(values[-1], abs=1e-14)
        changes = np.count_nonzero(np.diff(signs))
        assert changes == (0 if fresh else int(first * last < 0.0))
        found[fresh] += 1
    assert min(found.values()) > 100


@pytest.mark.parametrize("error", [1e-2, 1e-4, 1e-9])
def test_a_zero_is_that_of_the_expression_whatever_its_series_leaves_out(monkeypatch, error):
    """The series of cos(2 theta) - 0.3 to order six, with further errors in value and slope."""
    exact = math.acos(0.3) / 2.0
    series = np.array([[0.7, 0.0, -2.0, 0.0, 2.0 / 3.0, 0.0, -4.0 / 45.0]])
    series[0, :3] += error
    monkeypatch.setattr(event_series, "value_at", lambda *given: math.cos(2.0 * given[5]) - 0.3)
    space = SimpleNamespace(event_series=series)
    ends = math.cos(0.2) - 0.3, math.cos(2.0) - 0.3
    found = event_series.zero_of_series(None, space, 0, 0.0, 1.0, 0, 0.1, 1.0, *ends)
    assert abs(found - exact) <= 4e-16
