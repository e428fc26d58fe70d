"""The times at which conditions on time change, found before a run."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import dynamicsymbols

from dalembert.errors import BreakTimesError
from dalembert.ir.conditions import CONDITION_TIME, Conditions
from dalembert.ir.graph import Graph
from dalembert.scene.expressions.reader import ExpressionReader
from dalembert.stops.breakpoints import break_times, break_times_of_cases
from dalembert.transforms.lower_kernels import lower_kernel

t = dynamicsymbols._t
T, a, q, w = sp.symbols("T a q w")
step = sp.Heaviside


def conditions_of(expression):
    graph = Graph()
    time = graph.input("t")
    reader = ExpressionReader(graph, {t: time}, time=time)
    reader.read(expression, "an expression")
    assert not reader.faults
    names = [*sorted(reader.parameters), CONDITION_TIME]
    inputs = {time: ("t", None)} | {graph.input(name): ("p", i) for i, name in enumerate(names)}
    functions = [condition.function for condition in reader.conditions]
    within = graph.input(CONDITION_TIME).deps
    return Conditions(
        len(names) - 1,
        tuple(lower_kernel(graph, "condition", [f], inputs, arguments=("t", "p")) for f in functions),
        tuple(condition.kind for condition in reader.conditions),
        tuple(bool(f.deps & within) for f in functions),
        tuple(
            None
            if c.sharpness is None
            else lower_kernel(graph, "sharpness", [c.sharpness], inputs, arguments=("t", "p"))
            for c in reader.conditions
        ),
    ), names[:-1]


def times_of(expression, t0, t1, **values):
    conditions, names = conditions_of(expression)
    return break_times(conditions, np.array([*(values[name] for name in names), 0.0]), t0, t1)


CASES = {
    "pulse": (step(t - 2) - step(t - sp.Float(2.05)), (0, 3), {}, [2, 2.05]),
    "at the ends of the span": (step(t) + step(t - 1) + step(t - 2), (0, 2), {}, [1]),
    "square wave": (sp.sign(sp.sin(20 * t)), (0, 1), {}, np.arange(1, 7) * np.pi / 20),
    "cosine": (sp.Abs(sp.cos(3 * t + a)), (0, 2), {"a": 0.5}, (np.pi * np.array([0.5, 1.5]) - 0.5) / 3),
    "duty cycle": (
        sp.sign(sp.sin(w * t) - q),
        (0, 1),
        {"w": 10.0, "q": 0.5},
        np.array([1, 5, 13, 17]) * np.pi / 60,
    ),
    "remainder": (sp.Mod(t, T), (0, 1), {"T": 0.3}, [0.3, 0.6, 0.9]),
    "remainder of a remainder": (sp.Mod(sp.Mod(t, 1), sp.Rational(2, 5)), (0, 2), {}, [0.4, 0.8, 1, 1.4, 1.8]),
    "ceiling": (sp.ceiling(t**2), (0.5, 2), {}, np.sqrt([1, 2, 3])),
    "touches": (sp.Abs(sp.sin(t) - 1) + sp.floor(sp.sin(t) / 1), (0, 3), {}, []),
    "third power": (sp.Abs((t - 1) ** 3), (0, 2), {}, [1]),
    "zero for a while": (sp.Piecewise((1, t - sp.Min(t, 2) > 0), (0, True)), (0, 3), {}, [2]),
    "poles": (sp.sign(sp.tan(t)), (0.1, 5), {}, np.arange(1, 4) * np.pi / 2),
    "logical": (
        sp.Piecewise((1, sp.And(t > 2, t <= 3)), (2, sp.Or(t < sp.Rational(1, 2), t >= 4)), (0, True)),
        (0, 5),
        {},
        [0.5, 2, 3, 4],
    ),
    "narrow": (sp.sign(sp.Float(1e-7) - sp.Abs(t - sp.Float(1.23))), (0, 3), {}, [1.23 - 1e-7, 1.23, 1.23 + 1e-7]),
    "time cancels": (sp.Min(t - t / 2, (t + a) / 2, evaluate=False), (0, 3), {"a": -0.5}, []),
    "identity": (sp.sign(sp.sin(t) ** 2 + sp.cos(t) ** 2 - 1), (0, 3), {}, []),
}


@pytest.mark.parametrize("name", CASES)
def test_every_change_is_found_at_its_time(name):
    expression, (t0, t1), values, expected = CASES[name]
    expected = np.asarray(expected, dtype=float)
    np.testing.assert_allclose(times_of(expression, t0, t1, **values), expected, rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(times_of(expression, t1, t0, **values), expected[::-1], rtol=1e-13, atol=1e-14)


def test_changes_of_random_conditions_agree_with_fine_sampling():
    random = np.random.default_rng(5)
    for _ in range(20):
        c = [sp.Float(float(x)) for x in random.uniform(0.5, 3.0, 5)]
        smooth = sp.sin(c[0] * t + c[1]) * sp.exp(-t / 5) + sp.cos(c[2] * t**2 / 3) - c[3] / 4
        times = times_of(sp.sign(smooth + sp.floor(c[4] * t) / 7), 0, 5)
        dense = np.linspace(0, 5, 200_001)
        value = np.sign(sp.lambdify(t, smooth + sp.floor(c[4] * t) / 7, "numpy")(dense))
        changes = dense[:-1][value[1:] != value[:-1]]
        assert all(np.min(np.abs(times - x)) < 5e-5 for x in changes)


def test_many_changes_cost_what_their_number_says_and_too_many_are_refused():
    times = times_of(sp.sign(sp.sin(w * t) - q), 0, 10, w=6e4, q=0.3)
    assert len(times) == 190_986
    for expression in (sp.sign(sp.sin(1 / t)), sp.floor(10**9 * t)):
        with pytest.raises(BreakTimesError, match="changes too often"):
            times_of(expression, -1, 1)


def test_runs_side_by_side_have_each_their_own():
    conditions, names = conditions_of(sp.Mod(t, T))
    assert names == ["T"]
    p = np.array([[0.3, 0.0], [0.7, 0.0], [5.0, 0.0], [np.nan, 0.0]])
    starts, times = break_times_of_cases(conditions, p, np.zeros(4), np.array([1.0, -1.0, 1.0, 1.0]))
    assert starts.tolist() == [0, 3, 4, 4, 4]
    np.testing.assert_allclose(times, [0.3, 0.6, 0.9, -0.7], rtol=1e-14)
