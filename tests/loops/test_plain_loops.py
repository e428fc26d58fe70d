"""Compiled loops as plain Python with bounds checks (DALEMBERT_DEBUG=1): the same results to the last bit."""

import ctypes
import math

import numpy as np
import pytest
from sympy import Piecewise, cos
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen.llvm import foreign_batch, prepared, sweeps
from dalembert.codegen.llvm import recorded as recorded_runs
from dalembert.codegen.llvm.loops import DEBUG_VARIABLE, Loop, compiled_entry, debugging, loop_named
from dalembert.errors import OptionError
from dalembert.ir.interpret import interpret
from dalembert.lanes.sweep_arguments import CaseRows, CaseShape
from dalembert.methods.status import Status
from dalembert.methods.step_constants import ANY_START
from dalembert.phases import phases
from dalembert.steps.row_loops import KernelRowsArguments
from dalembert.subset import compiled_subset
from dalembert.subset.compiled_subset import CheckedArray, exp, fma, log, row, sqrt, take

START = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
PARAMETERS = {"m": 1, "b": 0.3, "I_C": 0.5}
MANY = {**PARAMETERS, "b": [0.1, 0.2, 0.3, 0.4, 0.5]}
LOOSE = {"rtol": 1e-6, "atol": 1e-8}
theta = dynamicsymbols("theta")


@pytest.fixture
def plainly(monkeypatch):
    """Give what runs a function with machine code and as plain Python, and tells which loops ran in the latter."""

    def clear():
        debugging.cache_clear()
        loop_named.cache_clear()

    def both(run):
        clear()
        compiled, names, plain = run(), set(), Loop._plain

        def recorded(self, pointer):
            names.add(self._name)
            return plain(self, pointer)

        with monkeypatch.context() as patch:
            patch.setenv(DEBUG_VARIABLE, "1")
            patch.setattr(Loop, "_plain", recorded)
            clear()
            found = run()
        clear()
        return compiled, found, names

    yield both
    clear()


def assert_same_bits(compiled, found):
    assert len(compiled) == len(found)
    for a, b in zip(compiled, found, strict=True):
        np.testing.assert_array_equal(a, b)


def sleigh(formulation="minimal"):
    return da.compile_model(da.scenes.chaplygin_sleigh(), formulation=formulation)


@pytest.mark.parametrize(
    ("method", "formulation", "loop"),
    [
        ("taylor", "minimal", "taylor_loop"),
        ("taylor", "projected", "taylor_loop"),
        ("dop853", "minimal", "explicit_loop"),
        ("dop853", "projected", "explicit_loop"),
        ("tsit5", "projected", "explicit_loop"),
        ("radau", "minimal", "implicit_loop"),
        ("radau", "projected", "implicit_loop"),
        ("radau", "ggl", "implicit_loop"),
    ],
)
def test_single_runs(plainly, method, formulation, loop):
    def run():
        model, ends = sleigh(formulation), np.array([0.0, 0.13, 0.4])
        done = model.simulate((0, 0.4), START, PARAMETERS, method=method, **LOOSE)
        asked = model.simulate((0, 0.4), START, PARAMETERS, method=method, t_eval=ends, **LOOSE)
        back = model.simulate((0.4, 0.1), START, PARAMETERS, method=method, **LOOSE)
        return [done.t, done.y, done(np.array([0.05, 0.33]))["x"], asked.y, back.y]

    compiled, found, names = plainly(run)
    assert loop in names
    assert_same_bits(compiled, found)


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_prepared_runs_that_pause(plainly, monkeypatch, method, formulation):
    monkeypatch.setattr(prepared, "_PATIENCE", 2)

    def run():
        model = sleigh(formulation)
        state, p = model.state(START, PARAMETERS), model.parameter_vector(PARAMETERS)
        return [model.prepare((0, 1.5), method=method, **LOOSE)(state, p)]

    compiled, found, names = plainly(run)
    assert names >= {"prepared_loop"}
    assert_same_bits(compiled, found)


REDUCED = {"far": da.maximum("x"), "low": da.minimum("y"), "mean": da.mean("theta")}
STOPPING = [da.Event(cos(3 * theta), terminal=2), da.Event(cos(5 * theta), direction=1)]
TURNING = [da.Event(cos(3 * theta), apply={"theta_dot": -0.5 * theta.diff()})]
SWEEPS = {
    "nothing": {},
    "samples": {"t_eval": [0.1, 0.2, 0.8]},
    "stops": {"events": STOPPING},
    "jumps": {"events": TURNING},
    "reductions": {"reduce": REDUCED},
    "all": {"events": STOPPING, "reduce": REDUCED, "t_eval": [0.1, 0.8]},
}


PAIRS = [(what, "minimal") for what in SWEEPS if what != "samples"]
PAIRS += [(what, "projected") for what in ("nothing", "samples", "all")]


@pytest.mark.parametrize("watched", [STOPPING, TURNING])
@pytest.mark.parametrize(
    ("method", "formulation", "loop"),
    [
        ("taylor", "minimal", "event_lane_loop"),
        ("dop853", "projected", "event_lane_loop"),
        ("radau", "minimal", "implicit_lane_loop"),
    ],
)
def test_single_runs_with_events(plainly, monkeypatch, method, formulation, loop, watched):
    monkeypatch.setattr(recorded_runs, "_ROWS", 2)

    def run():
        done = sleigh(formulation).simulate(
            (0, 0.8), START, PARAMETERS, method=method, events=watched, dense=True, **LOOSE
        )
        seen = [part for record in done.events.values() for part in (record.t, record.y, record.after.y)]
        assert any(map(len, done.events.values()))
        return [done.t, done.y, done(np.array([0.05, 0.1]))["x"], *seen]

    compiled, found, names = plainly(run)
    assert loop in names
    assert_same_bits(compiled, found)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
@pytest.mark.parametrize(("what", "formulation"), PAIRS)
def test_sweeps_that_pause(plainly, monkeypatch, what, method, formulation):
    monkeypatch.setattr(sweeps, "_FIRST_ROUNDS", 3)
    options = SWEEPS[what]

    def run():
        done = sleigh(formulation).sweep((0, 0.8), START, MANY, method=method, threads=2, **options, **LOOSE)
        seen = [part for events in done.events.values() for part in (events.count, events.first, events.last)]
        return [done.y, done.status, done.t, done.samples, *seen, *done.reduced.values()]

    compiled, found, names = plainly(run)
    projected = formulation == "projected"
    watched = "events" in options or "reduce" in options
    assert ("event_lane_loop" if watched else "projected_lane_loop" if projected else "lane_loop") in names
    assert ("sample_projection" in names) == (projected and "t_eval" in options)
    assert_same_bits(compiled, found)


@pytest.mark.parametrize(("formulation", "room", "extra"), [("minimal", 30, 2), ("projected", 3, 1)])
def test_records_of_many_cases(plainly, monkeypatch, formulation, room, extra):
    """Batches in programs of JAX, with rows of steps or of times; one case cannot begin."""
    given = {}
    monkeypatch.setattr(foreign_batch, "foreign_batch", lambda kernels, sizes, *_: given.update(of=(kernels, sizes)))

    def run():
        model = sleigh(formulation)
        model.engine.foreign_batch("tsit5", 0, None, recorded=True, alone=False)
        kernels, sizes = given["of"]
        n, cases = sizes.n, 11
        states = model.state(START, PARAMETERS) * (1.0 + 0.1 * np.arange(cases)[:, None])
        states[3] = np.nan
        p = model.parameter_vector(PARAMETERS)
        constants = interpret(model.stages.program.kernel("prepare"), {"p": p.tolist()})
        times = np.array([[0.0, 0.3, 0.8]])
        out, ends, record = np.zeros((cases, n)), np.zeros((cases, 5)), np.zeros((cases * room, n + extra))
        loop_named("recorded_lane_loop")(
            foreign_batch.sweep_arguments(kernels, sizes)._replace(
                shape=CaseShape(n, 0, 0, sizes.memory, 0, 0, 0, cases, 2),
                limits=np.array([[np.inf, 100.0, 1e-6, 1e-8, ANY_START, 1e-8]]),
                out=out,
                ends=ends,
                rows=CaseRows(times, states, np.array([constants]), record),
            )
        )
        return [out, ends, record]

    compiled, found, names = plainly(run)
    assert "recorded_lane_loop" in names
    assert_same_bits(compiled, found)
    _, ends, record = compiled
    whole = np.arange(len(ends)) != 3
    assert np.all(ends[whole, 1] == Status.SUCCESS) and ends[3, 1] == Status.NON_FINITE
    begins = record[:, 0].reshape(len(ends), room)
    assert np.all(np.diff(begins[whole]) >= 0.0) and np.all(begins[whole, 0] == 0.0)
    assert np.all(ends[whole, 4] == (ends[whole, 2] if extra == 2 else room))


def test_kernels_at_many_instants(plainly):
    q, qdot = np.arange(30.0).reshape(10, 3), np.ones((10, 3))

    def run():
        return [sleigh("projected").accelerations(0.0, q, qdot, PARAMETERS)]

    compiled, found, names = plainly(run)
    assert names == {"kernel_rows"}
    assert_same_bits(compiled, found)


@pytest.mark.parametrize("scene", ["belt_oscillator", "bouncing_ball"])
def test_phases_of_contacts(plainly, scene):
    start, parameters, span = {
        "belt_oscillator": (
            {"x": [0.5, 0.9, 1.2], "x_dot": 0.3, "y": 0.0},
            {"m": 2.0, "k": 4.0, "mu": 0.3, "mu_s": 0.5, "g": 10.0, "v_b": 0.2},
            (0, 4),
        ),
        "bouncing_ball": ({"x": 0, "y": [1.0, 2.0], "x_dot": 1, "y_dot": 0}, {"m": 2.0, "e": 0.5, "g": 10.0}, (0, 1)),
    }[scene]

    def run():
        model = da.compile_model(getattr(da.scenes, scene)())
        done = model.sweep(span, start, parameters, method="taylor", **LOOSE)
        return [done["x"], done["y"], done["y_dot"], done.status, done.t]

    compiled, found, names = plainly(run)
    assert "phase_loop" in names
    assert_same_bits(compiled, found)


def test_stops_of_phases(plainly):
    """Knots, conditions on time and instants of controllers, which lift a ball that bounces."""
    ball, wind, push = da.scenes.bouncing_ball(), dynamicsymbols("wind"), dynamicsymbols("push")
    place, frame, (_, y), t = ball.bodies[0].point, ball.frame, ball.coordinates, dynamicsymbols._t
    ball.add_inputs(wind, push)
    ball.add_loads((place, wind * frame.x + (push + Piecewise((0, t < 0.4), (9, True))) * frame.y))
    ball.add_controllers(da.Controller("push", period=0.15, inputs={push: 4 - 30 * y}))
    records = {"wind": da.samples(np.linspace(0, 1, 11), np.sin(np.arange(11.0)), "linear")}
    start = {"x": 0, "y": [0.1, 0.0], "x_dot": 1, "y_dot": 0}

    def run():
        model = da.compile_model(ball)
        low = da.Event("push", name="low", terminal=False)
        options = {"inputs": records, "events": [low], **LOOSE}
        done = model.sweep((0, 0.7), start, {"m": 2.0, "e": 0.5, "g": 10.0}, **options)
        one = model.simulate((0, 0.7), {**start, "y": 0.1}, {"m": 2.0, "e": 0.5, "g": 10.0}, **options)
        assert len(one.phases) > 2 and done["x"][0] == one["x"][-1]
        return [done["x"], done["y"], done.status, done.events["low"].count, one["y_dot"], one.events["low"].t]

    compiled, found, names = plainly(run)
    assert "phase_loop" in names
    assert_same_bits(compiled, found)


BALL = {"x": 0, "y": 1.0, "x_dot": 1, "y_dot": 0}, {"m": 2.0, "e": 0.5, "g": 10.0}


@pytest.mark.parametrize("first", ["0", "1"])
def test_a_plan_runs_as_it_was_made(plainly, monkeypatch, first):
    """Was a segmentation fault: the compiled loop over phases called the number of a plain loop as code."""
    model, found = da.compile_model(da.scenes.bouncing_ball()), []
    for debug in (first, "01".replace(first, ""), first):
        monkeypatch.setenv(DEBUG_VARIABLE, debug)
        debugging.cache_clear()
        loop_named.cache_clear()
        found.append([model.simulate((0, 1), *BALL, method="taylor", **LOOSE).y])
    assert_same_bits(found[0], found[1])
    assert_same_bits(found[0], found[2])


@pytest.mark.parametrize("called", ["contact_decisions", "lane_loop"])
def test_compiled_code_that_calls_a_plain_loop_is_an_error(monkeypatch, called):
    def mixed(name, lanes=1):
        return Loop(name, plain=called in name, lanes=lanes)

    for module in (phases, sweeps):
        monkeypatch.setattr(module, "loop_named", mixed)
    model = da.compile_model(da.scenes.bouncing_ball())
    with pytest.raises(OptionError, match=rf"{called} runs as plain Python, which compiled code cannot call"):
        model.simulate((0, 1), *BALL, method="taylor", **LOOSE)


def test_plain_loops_have_no_code_for_other_libraries(plainly, monkeypatch):
    assert compiled_entry("foreign_batch_loop") != 0
    monkeypatch.setenv(DEBUG_VARIABLE, "1")
    debugging.cache_clear()
    loop_named.cache_clear()
    with pytest.raises(OptionError, match="the loop foreign_batch_loop runs as plain Python"):
        compiled_entry("foreign_batch_loop")


def test_an_index_outside_an_array_names_it():
    checked = CheckedArray(np.zeros((2, 3)), "state.clock")
    for place in ((-1, 0), (0, 3), (2, 0), 2, -1):
        with pytest.raises(IndexError, match=r"state\.clock\[.* is outside the array, of shape \(2, 3\)"):
            checked[place]
    with pytest.raises(IndexError, match=r"state\.clock\[1\]\[-1\] is outside"):
        checked[1][-1] = 1.0
    with pytest.raises(IndexError, match=r"state\.clock of shape \(2, 3\) has no row 2"):
        row(checked, 2)
    with pytest.raises(TypeError, match="one element is written at a time"):
        checked[0] = 1.0
    checked[1, 2] = 0.5
    assert type(checked[1, 2]) is np.float64
    assert type(CheckedArray(np.arange(2), "n")[1]) is int


def test_a_loop_that_leaves_its_arrays_is_stopped():
    arrays = np.zeros(1), np.zeros((1, 2)), np.zeros((1, 1)), np.zeros((1, 1))
    overwritten = np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1))
    with pytest.raises(IndexError, match=r"states\[1, 0\] is outside the array, of shape \(1, 1\)"):
        Loop("kernel_rows", plain=True)(KernelRowsArguments(0, *arrays, *overwritten))


def test_other_values_of_the_variable_are_refused(plainly, monkeypatch):
    monkeypatch.setenv(DEBUG_VARIABLE, "yes")
    debugging.cache_clear()
    with pytest.raises(OptionError, match="DALEMBERT_DEBUG is 'yes': set it to 1"):
        debugging()


def test_threads_share_a_count():
    count = np.array([5])
    assert (take(count, 3), take(count, 2), count[0]) == (5, 8, 10)


def test_functions_of_doubles_follow_ieee_754():
    assert math.isnan(sqrt(-1.0))
    assert math.isnan(log(-1.0))
    assert (log(0.0), exp(1000.0), sqrt(4.0)) == (-math.inf, math.inf, 2.0)


TINY, HUGE = 5e-324, 1.7976931348623157e308
NUMBERS = (0.0, -0.0, 1.0, -3.0, 0.1, 1.0 + 2.0**-52, 1.0 - 2.0**-53, TINY, -2.5e-308, HUGE, math.inf, math.nan)


def test_fma_is_rounded_once(monkeypatch):
    """Against the C library, bit for bit; NaN has many."""
    monkeypatch.setitem(compiled_subset._TARGET, "fused", True)
    reference = ctypes.CDLL(None).fma
    reference.restype, reference.argtypes = ctypes.c_double, (ctypes.c_double,) * 3
    random = np.random.default_rng(0)
    drawn = random.standard_normal((500, 3)) * 2.0 ** random.integers(-40, 40, (500, 3))
    near = [(a, b, -a * b * (1.0 + k * 2.0**-53)) for a, b, _ in drawn[:200] for k in (-1.0, 0.0, 1.0)]
    cases = [(a, b, c) for a in NUMBERS for b in NUMBERS for c in NUMBERS] + near + drawn.tolist()
    with np.errstate(all="ignore"):
        found = np.array([fma(np.float64(a), b, c) for a, b, c in cases])
    expected = np.array([reference(a, b, c) for a, b, c in cases])
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    finite = ~np.isnan(expected)
    np.testing.assert_array_equal(found[finite].view(np.int64), expected[finite].view(np.int64))
    assert fma(0.1, 10.0, -1.0) == 2.0**-54
    monkeypatch.setitem(compiled_subset._TARGET, "fused", False)
    assert fma(0.1, 10.0, -1.0) == 0.0


@pytest.fixture(scope="module")
def forced():
    """Return a mass on a spring under an input, and its record."""
    x, u = dynamicsymbols("x u")
    N, O = ReferenceFrame("N"), Point("O")
    where = O.locatenew("P", x * N.x)
    scene = da.Scene("forced", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("p", where, 1))
    scene.add_loads((where, (u - 2 * x) * N.x))
    scene.add_inputs(u)
    values = np.random.default_rng(0).normal(size=(3, 7))
    return scene, np.linspace(0.0, 1.2, 7), values


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
@pytest.mark.parametrize(("kind", "span"), [("hold", (0.0, 0.7)), ("cubic", (0.7, 0.0))])
def test_loops_with_inputs_that_have_knots(plainly, forced, method, kind, span):
    scene, knots, values = forced
    start = {"x": 0.3, "x_dot": 0.0}

    def run():
        model = da.compile_model(scene)
        options = {"method": method, **LOOSE}
        one, many = {"u": da.samples(knots, values[0], kind)}, {"u": da.samples(knots, values, kind)}
        single = model.simulate(span, start, {}, inputs=one, **options)
        sweep = model.sweep(span, start, {}, inputs=many, **options)
        prepared = model.prepare(span, inputs=one, **options)
        last = prepared(np.array([0.3, 0.0]), model.parameter_vector({}))
        alone = model.sweep(span, start, {}, inputs={"u": da.samples(knots, values[:1], kind)}, **options)
        assert sweep.final["x"][0] == alone.final["x"][0] == last[0]
        return [single.t, single.y, sweep.final["x"], sweep.t, last]

    compiled, found, names = plainly(run)
    assert_same_bits(compiled, found)
    wanted = {"taylor": "taylor_loop", "radau": "implicit_loop"}.get(method, "explicit_loop")
    assert wanted in names and (method == "radau" or {"stop_lane_loop", "prepared_loop"} <= names)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_watched_lanes_with_inputs_that_have_knots(plainly, forced, method):
    scene, knots, values = forced
    x = scene.coordinates[0]
    bounce = da.Event(x + 0.1, apply={x.diff(): -0.5 * x.diff()}, name="bounce")
    kept = {"most": da.maximum(x), "mean": da.mean(x)}

    def run():
        options = {"method": method, "events": [bounce], "reduce": kept, **LOOSE}
        inputs = {"u": da.samples(knots, values, "linear")}
        sweep = da.compile_model(scene).sweep((0.0, 1.1), {"x": 0.3, "x_dot": -1.0}, {}, inputs=inputs, **options)
        happened = sweep.events["bounce"]
        return [sweep.final["x"], sweep.reduced["most"], sweep.reduced["mean"], happened.first, happened.count]

    compiled, found, names = plainly(run)
    assert_same_bits(compiled, found)
    assert "stop_event_lane_loop" in names
