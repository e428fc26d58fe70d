"""Rest on a knot of a table that jumps, until a force sets the motion going in the course of a run: closed forms."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from departure_cases import KNOT, PULLS, TIGHT, TIME, check_traced_runs, ends, pulled, u, v
from table_cases import m, x

METHODS = [
    *(("llvm", method) for method in ("taylor", "dop853", "tsit5", "radau")),
    *(("numba", method) for method in ("taylor", "dop853")),
    *(("numpy", method) for method in ("dop853", "radau")),
]


def jump(argument, below, above, knot=KNOT):
    return da.table(argument, [knot - 40, knot, knot + 40], [below, above, above], "hold", "hold")


@pytest.mark.parametrize("kind", PULLS)
@pytest.mark.parametrize(("backend", "method"), METHODS)
def test_a_pull_that_begins_at_a_knot_of_an_input(backend, method, kind):
    """Above the knot the mass rests; below it the table adds -1 N."""
    given, (speed, way) = PULLS[kind]
    made = pulled(u + jump(x, -1.0, 0.0), backend)
    found = ends(made, (0, 2), method, {u: given})
    assert found == pytest.approx(np.tile([KNOT + way - 0.5, speed - 1.0], (len(found), 1)), abs=1e-11)


@pytest.mark.parametrize("kind", PULLS)
@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_a_jump_at_a_speed(method, kind):
    given, (speed, way) = PULLS[kind]
    found = ends(pulled(u + jump(v, -1.0, 0.0, knot=0.0)), (0, 2), method, {u: given})
    assert found == pytest.approx(np.tile([KNOT + way - 0.5, speed - 1.0], (len(found), 1)), abs=1e-11)


@pytest.mark.parametrize("formulation", ["minimal", "projected", "baumgarte", "augmented", "ggl"])
def test_every_formulation(formulation):
    given, (speed, way) = PULLS["hold"]
    made = pulled(u + jump(x, -1.0, 0.0), formulation=formulation)
    method = "radau" if formulation == "ggl" else "dop853"
    run = made.simulate((0, 2), {x: KNOT, v: 0.0}, {m: 1.0}, inputs={u: given}, method=method, **TIGHT)
    assert run.success and run["x_dot"][-1] == pytest.approx(speed - 1.0, abs=1e-9)
    assert run["x"][-1] == pytest.approx(KNOT + way - 0.5, abs=1e-9)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
@pytest.mark.parametrize(
    ("pull", "ending"),
    [
        (sp.Piecewise((0, TIME < 1), (-3, True)), (-3.0, -1.5)),
        (-3 * sp.Max(0, TIME - 1), (-1.5, -0.5)),
    ],
)
def test_a_pull_that_begins_at_a_condition_on_time(pull, ending, method):
    found = ends(pulled(pull + jump(x, -1.0, 0.0), inputs=()), (0, 2), method)
    assert found == pytest.approx(np.tile([KNOT + ending[1] - 0.5, ending[0] - 1.0], (len(found), 1)), abs=1e-11)


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_a_pull_of_a_controller(method):
    count = dynamicsymbols("n")
    law = da.Controller("starter", period=1.0, states={count: count + 1}, inputs={u: -3 * sp.Min(count, 1)})
    made = pulled(u + jump(x, -1.0, 0.0), controllers=[law])
    start = {x: KNOT, v: 0.0, count: 0}
    run = made.simulate((0, 2), start, {m: 1.0}, method=method, **TIGHT)
    cases = made.sweep((0, 2), start, {m: np.ones(3)}, method=method, **TIGHT)
    assert [run["x_dot"][-1], *cases["x_dot"]] == pytest.approx([-4.0] * 4, abs=1e-11)
    assert [run["x"][-1], *cases["x"]] == pytest.approx([KNOT - 2.0] * 4, abs=1e-11)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_backwards_in_time(method):
    """Backwards from t = 2 the mass rests until t = 1."""
    for given, (speed, way) in (
        (da.samples([0.0, 1.0, 2.0], [-3.0, 0.0, 0.0], "hold"), (-3.0, -1.5)),
        (da.samples([0.0, 1.0, 2.0], [-3.0, 0.0, 0.0], "linear"), (-1.5, -0.5)),
    ):
        found = ends(pulled(u + jump(x, -1.0, 0.0)), (2, 0), method, {u: given})
        assert found == pytest.approx(np.tile([KNOT + way - 0.5, -speed + 1.0], (len(found), 1)), abs=1e-11)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_cases_of_a_sweep_have_the_bits_of_prepared_runs(method):
    """Some cases rest on the knot, others pass it or never come near; cases with other records run beside them."""
    made = pulled(u + jump(x, -1.0, 0.0))
    begin, size = KNOT + np.linspace(-0.5, 0.5, 11), np.linspace(-3.0, 3.0, 11)
    begin[[2, 7]] = KNOT
    times, values = np.array([0.0, 0.5, 1.0, 2.0]), np.outer(size, [0.0, 0.0, 1.0, 1.0])
    options = {"method": method, **TIGHT}
    for kind in ("hold", "linear"):
        given = {u: da.samples(times, values, kind)}
        cases = made.sweep((0, 2), {x: begin, v: 0.0}, {m: 1.0}, inputs=given, **options)
        for i, q in enumerate(begin):
            own = {u: da.samples(times, values[i], kind)}
            go = made.prepare((0, 2), inputs=own, **options)
            state = made.state({x: q, v: 0.0}, {m: 1.0}, inputs={u: 0.0})
            final = go(state, made.parameter_vector({m: 1.0}))
            assert final.tolist() == [cases[name][i] for name in made.layout.state]


def test_events_and_recorded_times():
    given, _ = PULLS["hold"]
    made = pulled(u + jump(x, -1.0, 0.0))
    passes = da.Event(x - KNOT + 0.5, direction=-1, terminal=False)
    for method in ("taylor", "dop853", "radau"):
        options = {"inputs": {u: given}, "method": method, **TIGHT}
        run = made.simulate((0, 2), {x: KNOT, v: 0.0}, {m: 1.0}, events=[passes], **options)
        assert run["x_dot"][-1] == pytest.approx(-4.0, abs=1e-11)
        assert run.events[0].t == pytest.approx([1.5], abs=1e-9)
        times = np.linspace(0, 2, 9)
        sampled = made.simulate((0, 2), {x: KNOT, v: 0.0}, {m: 1.0}, t_eval=times, **options)
        assert sampled["x"] == pytest.approx(KNOT - 2 * np.maximum(0, times - 1) ** 2, abs=1e-9)


@pytest.mark.usefixtures("quick_xla")
def test_traced_runs():
    pytest.importorskip("jax")
    check_traced_runs(pulled(u + jump(x, -1.0, 0.0), "jax"))
