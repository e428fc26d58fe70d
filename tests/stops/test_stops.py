"""Stops of sweeps: changes of conditions, instants and knots, which the lanes pass in place."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen.compiled_engine import CompiledEngine
from dalembert.codegen.engine import Engine
from dalembert.errors import ConstraintError
from dalembert.methods.status import Status
from dalembert.runs.stop_lists import segments_of_cases, stop_lists
from dalembert.stops.breakpoints import CaseBreaks
from dalembert.stops.input_records import InputRecords
from dalembert.stops.stops import begin_stops, end_of_steps, is_due, no_stops, take_next

t = dynamicsymbols._t
x, y, u, w, e = dynamicsymbols("x y u w e")
m, tp, T, r = sp.symbols("m tp T r", positive=True)
COUNT = 7
CASES = {m: 1.5, tp: np.linspace(0.31, 0.47, COUNT), T: np.array([0.1, 0.1, 0.07, 0.13, 0.3, 0.11, 5.0]), r: 0.4}
START = {x: 0.6, y: -0.8, x.diff(): 0.4, e: 0.1}
KNOTS = np.linspace(0, 3, 16)
RECORD = da.samples(KNOTS, np.random.default_rng(0).normal(size=(COUNT, 16)), "linear")
TIMES = np.sort(np.append(np.linspace(0, 3, 11), [0.31, 0.5, KNOTS[3]]))
TIGHT = {"rtol": 1e-10, "atol": 1e-12}


def pendulum(formulation, backend="llvm"):
    """Return a pendulum with a square wave, a record and a sampled law as forces."""
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("pendulum", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("P", P, m))
    scene.add_holonomic_constraints(x**2 + y**2 - 1)
    scene.add_inputs(u, w)
    wave = sp.Piecewise((1, sp.Mod(t, tp) < tp / 2), (-1, True))
    scene.add_loads((P, (u + w + wave) * N.x - 9.81 * m * N.y))
    law = {"states": {e: e + T * (r - x)}, "inputs": {u: 4 * (r - x) + e + wave / 2 - x.diff()}}
    scene.add_controllers(da.Controller("pid", period=T, **law))
    return da.compile_model(scene, formulation=formulation, backend=backend)


@pytest.fixture
def in_lanes(monkeypatch):
    """No case of a sweep runs alone."""

    def refuse(*arguments):
        raise AssertionError("cases were run one by one")

    monkeypatch.setattr(Engine, "integrate_block", refuse)


def of_case(i):
    return {key: np.broadcast_to(value, COUNT)[i] for key, value in CASES.items()}


def record_of(i):
    return {w: da.samples(KNOTS, RECORD.values[i], "linear")}


@pytest.mark.parametrize(
    ("method", "formulation", "backend"),
    [
        ("taylor", "augmented", "llvm"),
        ("taylor", "projected", "llvm"),
        ("dop853", "projected", "llvm"),
        ("tsit5", "augmented", "llvm"),
        pytest.param("dop853", "augmented", "numba", marks=pytest.mark.matrix),
    ],
)
def test_sweeps_are_single_runs(in_lanes, method, formulation, backend):
    model, watch = pendulum(formulation, backend), {"events": [da.Event(x, name="through")]}
    options = {"method": method, **TIGHT}
    ends = model.sweep((0, 3), START, CASES, inputs={w: RECORD}, **watch, reduce={"far": da.maximum(x)}, **options)
    rows = model.sweep((0, 3), START, CASES, inputs={w: RECORD}, t_eval=TIMES, **options)
    bound = 1e-7 if method == "tsit5" else 1e-8
    for i in range(COUNT):
        run = model.simulate((0, 3), START, of_case(i), inputs=record_of(i), t_eval=TIMES, **watch, **options)
        for name in ("x", "x_dot", "u", "e"):
            np.testing.assert_allclose(rows[name][i], run[name], rtol=0, atol=bound)
            np.testing.assert_allclose(ends[name][i], run[name][-1], rtol=0, atol=bound)
        assert ends.events["through"].count[i] == len(run.events["through"].t)
        assert ends.reduced["far"][i] >= np.max(run["x"]) - bound
    assert formulation == "augmented" or np.max(np.abs(rows["x"] ** 2 + rows["y"] ** 2 - 1)) < 1e-9


@pytest.mark.parametrize("kind", ["hold", "cubic"])
@pytest.mark.parametrize(("method", "formulation"), [("taylor", "projected"), ("dop853", "augmented")])
def test_events_of_inputs_occur_at_knots_too(in_lanes, method, formulation, kind):
    model, half = pendulum(formulation), {x.diff(): x.diff() / 2, y.diff(): y.diff() / 2}
    events = [
        da.Event(w - 0.2, name="record"),
        da.Event(x + w - 0.3, name="jump", direction=-1, apply=half),
        da.Event(w - 1.2, name="end", terminal=True),
    ]
    records, options = RECORD.values, {"method": method, "events": events, **TIGHT}
    sweep = model.sweep((0, 3), START, CASES, inputs={w: da.samples(KNOTS, records, kind)}, **options)
    for i in range(COUNT):
        run = model.simulate((0, 3), START, of_case(i), inputs={w: da.samples(KNOTS, records[i], kind)}, **options)
        assert sweep.status[i] == run.status
        np.testing.assert_allclose(sweep.y[i], run.y[-1], rtol=0, atol=1e-8)
        for name, found in run.events.items():
            ends = [found.t[0], found.t[-1]] if len(found.t) else [np.nan, np.nan]
            own = sweep.events[name]
            assert own.count[i] == len(found.t)
            np.testing.assert_allclose([own.first[i], own.last[i]], ends, rtol=0, atol=1e-9)
    assert sum(sweep.status == Status.EVENT) > 0 and sum(sweep.events["jump"].count) > COUNT


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_a_case_has_the_bits_that_it_has_alone(method):
    model = pendulum("projected")
    options = {"method": method, "rtol": 1e-8, "atol": 1e-10, "t_eval": TIMES, "events": [da.Event(x, name="through")]}
    whole = model.sweep((0, 3), START, CASES, inputs={w: RECORD}, **options)
    for i in range(COUNT):
        alone = model.sweep((0, 3), START, {**of_case(i), T: [of_case(i)[T]]}, inputs=record_of(i), **options)
        assert alone.t[0] == whole.t[i] and alone.stats.steps > 0
        for name in ("x", "x_dot", "u"):
            np.testing.assert_array_equal(alone[name][0], whole[name][i])
        np.testing.assert_array_equal(alone.events["through"].first, whole.events["through"].first[i : i + 1])


def cart(force, *controllers):
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("cart", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("P", P, m))
    scene.add_inputs(u)
    scene.add_loads((P, force * N.x))
    scene.add_controllers(*controllers)
    return da.compile_model(scene)


@pytest.mark.parametrize("before", [False, True])
def test_a_law_at_a_change_reads_conditions_as_of_that_time(in_lanes, before):
    """What follows counts in the motion: the force changes there, the law may still see what was."""
    past = t <= 1 if before else t < 1
    model = cart(
        u + sp.Piecewise((0, past), (3, True)), da.Controller("c", 1, inputs={u: sp.Piecewise((0, past), (6, True))})
    )
    sweep = model.sweep((0, 2), {x: 0, x.diff(): 0}, {m: [1.0, 2.0]}, **TIGHT)
    run = model.simulate((0, 2), {x: 0, x.diff(): 0}, {m: 1.0}, **TIGHT)
    assert sweep["u"][0] == run["u"][-1] == (0 if before else 6)
    np.testing.assert_allclose(sweep["x_dot"], (3.0 + sweep["u"]) / [1, 2], rtol=1e-12)


def test_steps_in_all_pieces_count_together(in_lanes):
    model = cart(u - sp.sin(x), da.Controller("c", T, inputs={u: -x}))
    values = {m: 1.0, T: [0.1, 10.0]}
    sweep = model.sweep((0, 2), {x: 1, x.diff(): 0}, values, max_steps=10, max_step=0.5, **TIGHT)
    assert sweep.status.tolist() == [Status.MAX_STEPS, Status.SUCCESS]
    assert abs(sweep.t[0] - 1.0) < 1e-12 and sweep["u"][0] != -sweep["x"][0]  # no law acts where a case has failed


def test_errors_of_impulses_reach_the_caller(in_lanes):
    N, O = ReferenceFrame("N"), Point("O")
    C, B = O.locatenew("C", x * N.x), O.locatenew("B", (x + sp.sin(y)) * N.x - sp.cos(y) * N.y)
    scene = da.Scene("jumping", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("cart", C, 2), Particle("bob", B, 1))
    scene.add_holonomic_constraints(x - sp.Heaviside(t - 1))
    model = da.compile_model(scene, formulation="projected")
    with pytest.raises(ConstraintError, match="jumps at t = 1"):
        model.sweep((0, 2), {"x": 0, "x_dot": 0, "y": np.linspace(0.1, 0.5, 3), "y_dot": 0}, {})


def test_lists_of_changes():
    spans = np.zeros(3), np.array([3.0, 3.0, 3.0])
    breaks = CaseBreaks(1, *spans, np.array([0, 2, 2, 3]), np.array([1.0, 2.0, 0.5]))
    where, starts, middles = segments_of_cases(breaks)
    assert where.tolist() == [0, 3, 4, 6] and starts.tolist() == [0, 1, 2, 0, 0, 0.5]
    assert middles.tolist() == [0.5, 1.5, 2.5, 1.5, 0.25, 1.75]
    lists, bad = stop_lists(breaks, None, np.zeros((3, 2)), np.zeros(0), landing=4)
    assert lists.first.tolist() == [1, 4, 5] and lists.last.tolist() == [3, 4, 6] and not np.any(bad)
    assert lists.acts.tolist() == [0, 4, 4, 0, 0, 4]


@pytest.mark.parametrize(
    ("method", "formulation"), [("taylor", "projected"), ("dop853", "augmented"), ("tsit5", "projected")]
)
def test_prepared_runs_are_single_runs(monkeypatch, method, formulation):
    model = pendulum(formulation)
    runs = [
        model.simulate((0, 3), START, of_case(i), inputs=record_of(0), method=method, **TIGHT) for i in range(COUNT)
    ]
    prepared = model.prepare((0, 3), inputs=record_of(0), method=method, **TIGHT)
    few = model.prepare((0, 3), inputs=record_of(0), method=method, max_steps=9, **TIGHT)
    monkeypatch.setattr(CompiledEngine, "integrate", None)  # no segment runs alone
    for i, run in enumerate(runs):
        p = model.parameter_vector(of_case(i))
        state = model.state(START, of_case(i), inputs=record_of(0))
        for _ in range(2):
            found = prepared(state, p)
            np.testing.assert_allclose(found, run.y[-1], rtol=0, atol=1e-7 if method == "tsit5" else 1e-8)
        assert prepared.status is Status.SUCCESS
        few(state, p)
        assert few.status is Status.MAX_STEPS


def test_a_lane_takes_its_stops_in_order():
    lists = {"first": np.array([0, 2]), "last": np.array([2, 4]), "next": np.zeros(1, np.int64)}
    lists |= {"until": np.zeros(1, np.int64), "acting": np.zeros(1, np.int64), "place": 1}
    lists |= {"times": np.array([1.0, 2.0, 2.0, 1.0]), "acts": np.array([1, 2, 0, 3])}
    stops = no_stops()._replace(**lists, middles=np.array([np.nan, 0.5, np.nan, 0.25]))
    stops, c = stops._replace(inputs=InputRecords((), (), np.zeros(1)).table(1)), np.zeros((2, 1))
    assert begin_stops(stops, c, 0, 1, 3.0, 0.0, False) == 0.0
    assert end_of_steps(stops, 0, 0.0, False) == 2.0 and not is_due(stops, 0, 2.5, False)
    assert is_due(stops, 0, 2.0, False) and not take_next(stops, c, 0)
    assert end_of_steps(stops, 0, 1.5, False) == 1.5 and is_due(stops, 0, np.nextafter(1.0, 2.0), False)
    assert take_next(stops, c, 0) and c[1, 0] == 0.25 and stops.acting[0] == 3
    assert end_of_steps(stops, 0, 0.0, False) == 0.0 and not is_due(stops, 0, 0.0, False)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_a_scene_without_parameters(method):
    """A push that ends at t = 1, then free motion: v = 1, x = 1/2 + (t - 1)."""
    q = dynamicsymbols("q")
    frame, origin = ReferenceFrame("N"), Point("O")
    place = origin.locatenew("P", q * frame.x)
    scene = da.Scene("pushed", frame=frame, origin=origin, coordinates=[q])
    scene.add_bodies(Particle("body", place, 1))
    scene.add_loads((place, sp.Piecewise((1, dynamicsymbols._t < 1), (0, True)) * frame.x))
    model = da.compile_model(scene)
    sweep = model.sweep((0, 3), {q: [0.0, 1.0], q.diff(): 0.0}, {}, method=method)
    np.testing.assert_allclose(sweep["q"], [2.5, 3.5], rtol=1e-12)
    final = model.prepare((0, 3), method=method)(model.state({q: 0, q.diff(): 0}, {}), model.parameter_vector({}))
    np.testing.assert_allclose(final, [2.5, 1.0], rtol=1e-12)
