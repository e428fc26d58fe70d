"""Motions with tables, on every backend and by every method, against SciPy stopped at the knots."""

import functools
from itertools import pairwise

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from sympy.physics.mechanics import Particle, RigidBody, dynamicsymbols, inertia

import dalembert as da
from dalembert.errors import OptionError
from dalembert.methods.status import Status
from table_cases import DAMPING, END, KINDS, KNOTS, START, VALUES, N, O, c, m, oscillator, spring, stopped_at_knots, x

GIVEN = {m: 1.0, c: DAMPING}
TIGHT = {"rtol": 1e-11, "atol": 1e-13}
METHODS = [
    *(("llvm", method) for method in ("taylor", "dop853", "tsit5", "radau")),
    *(("numpy", method) for method in ("dop853", "rk45", "radau")),
    ("numba", "taylor"),
    ("jax", "taylor"),
]

reference = functools.cache(stopped_at_knots)


@functools.cache
def model(kind, backend="llvm", extrapolate="error"):
    if backend == "jax":
        pytest.importorskip("jax")
    return da.compile_model(oscillator(kind, extrapolate), backend=backend)


def start(q=START[0], speed=START[1]):
    return {x: q, x.diff(): speed}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("backend", "method"), METHODS, ids=lambda value: value)
def test_motions_are_those_of_scipy_stopped_at_the_knots(backend, method, kind):
    if (backend, method, kind) == ("numpy", "radau", "hold"):
        pytest.skip("SciPy's Newton iteration does not converge where a rate jumps")
    if backend in ("numba", "jax") and kind != "linear":
        pytest.skip("these take long to compile")
    tolerances = {"rtol": 1e-8, "atol": 1e-11} if backend == "jax" else TIGHT
    run = model(kind, backend).simulate((0, END), start(), GIVEN, method=method, **tolerances)
    expected, passed = reference(kind)
    assert run.success and passed > 8
    assert [run["x"][-1], run["x_dot"][-1]] == pytest.approx(list(expected), abs=1e-9)


@pytest.mark.parametrize(("backend", "method"), METHODS[:7], ids=lambda value: value)
def test_states_between_steps_and_events(backend, method):
    """Also in the short steps with which runs pass knots."""
    made, times, fine = model("linear", backend), np.linspace(0, END, 501), {"method": method, **TIGHT}
    expected = model("linear").simulate((0, END), start(), GIVEN, method="taylor", t_eval=times, rtol=1e-12)
    run = made.simulate((0, END), start(), GIVEN, **fine)
    watched = made.simulate((0, END), start(), GIVEN, events=[x], **fine)
    for found in (run(times), watched(times)):
        np.testing.assert_allclose(found["x"], expected["x"], atol=1e-8)
    np.testing.assert_allclose(run(watched.events["x(t)"].t)["x"], 0.0, atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_sweeps_and_prepared_runs_are_single_runs(method, kind):
    made = model(kind)
    starts = np.linspace(1.31, 1.7, 17)
    runs = made.sweep((0, END), start(starts), GIVEN, method=method, **TIGHT)
    assert np.all(runs.status == 0)
    for i in (0, 7, 16):
        expected, _ = reference(kind, (float(starts[i]), 0.0))
        assert [runs["x"][i], runs["x_dot"][i]] == pytest.approx(list(expected), abs=1e-9)
    run = made.prepare((0, END), method=method, **TIGHT)
    last = run(made.state(start(), GIVEN), made.parameter_vector(GIVEN))
    assert list(last) == pytest.approx(list(reference(kind)[0]), abs=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_taylor_steps_end_at_knots_and_take_few_more(kind):
    _, passed = reference(kind)
    run = model(kind).simulate((0, END), start(), GIVEN, method="taylor", **TIGHT)
    assert passed <= run.stats.steps <= 4 * passed + 4
    inner = KNOTS[1:-1]
    near = np.min(np.abs(run["x"][:, np.newaxis] - inner), axis=1)
    assert np.sum(near < 1e-9) >= passed


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_no_narrow_piece_is_passed_over(method):
    """A pulse of a thousandth of the way, which no stage of a usual step would meet."""
    knots, force = [-1.0, 4.0, 4.0005, 4.001, 20.0], [0.0, 0.0, 800.0, 0.0, 0.0]
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("pulse", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("mass", P, m))
    scene.add_loads((P, da.table(x, knots, force) * N.x))
    made = da.compile_model(scene)
    work = 0.5 * 0.001 * 800.0
    speed = np.sqrt(1.0 + 2.0 * work)
    run = made.simulate((0, 10), start(0.0, 1.0), {m: 1.0}, method=method, rtol=1e-10, atol=1e-12)
    assert run["x_dot"][-1] == pytest.approx(speed, rel=1e-9)
    starts = {x: np.linspace(0, 1, 9), x.diff(): 1.0}
    cases = made.sweep((0, 10), starts, {m: 1.0}, method=method, rtol=1e-10, atol=1e-12)
    assert cases["x_dot"] == pytest.approx(np.full(9, speed), rel=1e-9)


def test_a_start_at_rest_at_a_knot():
    for kind in ("linear", "cubic"):
        run = model(kind).simulate((0, 3.0), start(1.5), GIVEN, **TIGHT)
        exact, _ = stopped_at_knots(kind, (1.5 - 1e-13, 0.0), 3.0)
        assert run.stats.steps < 40 and run["x"][-1] == pytest.approx(exact[0], abs=1e-9)


@pytest.mark.parametrize(("backend", "method"), [row for row in METHODS if row[0] in ("llvm", "numpy")])
def test_a_run_that_leaves_the_knots_ends_there_by_name(backend, method):
    made = model("linear", backend)
    run = made.simulate((0, END), start(speed=3.0), GIVEN, method=method, rtol=1e-9)
    assert run.status is Status.OUTSIDE_TABLE and not run.success
    assert run["x"][-1] == pytest.approx(2.0, abs=1e-6)
    assert "the knots of the table 'spring' go from -2 to 2, and its argument left them at 2" in run.message
    assert 'extrapolate="hold" or "linear"' in run.message
    cases = made.sweep((0, END), {x: [1.7, 1.7, 3.0], x.diff(): [0.0, 3.0, 0.0]}, GIVEN, method=method, rtol=1e-9)
    assert list(cases.status) == [Status.SUCCESS, Status.OUTSIDE_TABLE, Status.OUTSIDE_TABLE]


@pytest.mark.parametrize("extrapolate", ["hold", "linear"])
def test_runs_go_on_outside_of_the_knots(extrapolate):
    run = model("linear", extrapolate=extrapolate).simulate((0, 0.3), start(speed=6.0), GIVEN, **TIGHT)
    slope = (VALUES[-1] - VALUES[-2]) / (KNOTS[-1] - KNOTS[-2]) if extrapolate == "linear" else 0.0

    def rates(t, y):
        force = np.interp(y[0], KNOTS, VALUES) + slope * max(y[0] - 2.0, 0.0)
        return [y[1], -force - DAMPING * y[1]]

    exact = solve_ivp(rates, (0, 0.3), [1.7, 6.0], method="DOP853", rtol=1e-11, atol=1e-12, max_step=1e-4)
    assert run["x"][-1] > 2.1
    assert run["x"][-1] == pytest.approx(exact.y[0, -1], abs=1e-9)


def test_methods_with_a_memory_are_refused():
    for method in ("bdf", "lsoda"):
        with pytest.raises(OptionError, match="end at the knots of the tables"):
            model("linear", "numpy").simulate((0, 1), start(), GIVEN, method=method)


k = sp.symbols("k", positive=True)


def test_the_energy_of_a_spring_is_the_antiderivative_of_its_table():
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("spring", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("mass", P, m))
    scene.add_loads((P, -k * spring("cubic") * N.x))
    made = da.compile_model(scene, outputs=["energy", spring("cubic")])
    run = made.simulate((0, 10), start(), {m: 1.0, k: 2.0}, **TIGHT)
    potential = CubicSpline(KNOTS, VALUES).antiderivative()
    assert np.ptp(run["energy"]) < 1e-9
    assert run["energy"][0] == pytest.approx(2.0 * float(potential(1.7)), rel=1e-12)
    np.testing.assert_allclose(run["spring(x(t))"], CubicSpline(KNOTS, VALUES)(run["x"]), atol=1e-12)


@pytest.mark.parametrize("kind", ["linear", "cubic"])
def test_sensitivities(kind):
    made = model(kind)

    def last(q, damping):
        run = made.simulate((0, 3), start(q), {m: 1.0, c: damping}, rtol=1e-12, atol=1e-14)
        return run["x"][-1]

    h = 1e-5
    found = made.sensitivity((0, 3), start(), GIVEN, of=[x], wrt=[c, x], **TIGHT).jacobians[-1]
    by_damping = (last(1.7, DAMPING + h) - last(1.7, DAMPING - h)) / (2 * h)
    by_start = (last(1.7 + h, DAMPING) - last(1.7 - h, DAMPING)) / (2 * h)
    assert np.ravel(found)[-2:] == pytest.approx([by_damping, by_start], rel=1e-5)


t = dynamicsymbols._t


def test_a_table_of_time():
    P = O.locatenew("P", x * N.x)
    times, force = np.linspace(0, 5, 11), np.sin(np.arange(11.0))
    scene = da.Scene("pushed", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("mass", P, m))
    scene.add_loads((P, da.table(t, times, force, name="push") * N.x))
    made = da.compile_model(scene)
    for method in ("taylor", "dop853"):
        run = made.simulate((0, 5), start(0.0), {m: 1.0}, method=method, rtol=1e-10)
        assert run["x_dot"][-1] == pytest.approx(np.trapezoid(force, times), rel=1e-12)
        back = made.simulate((4.7, 0.2), start(0.0), {m: 1.0}, method=method, rtol=1e-10)
        knots = np.concatenate([[0.2], times[1:10], [4.7]])
        assert back["x_dot"][-1] == pytest.approx(-np.trapezoid(np.interp(knots, times, force), knots), rel=1e-10)
    assert made.simulate((0, 6), start(0.0), {m: 1.0}).status is Status.OUTSIDE_TABLE


theta, J = dynamicsymbols("theta"), sp.symbols("J", positive=True)


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_a_torque_curve_by_speed(method):
    speeds, torques = [0.0, 50.0, 100.0, 200.0, 300.0], [20.0, 35.0, 40.0, 30.0, 0.0]
    B = N.orientnew("B", "Axis", (theta, N.z))
    scene = da.Scene("motor", frame=N, origin=O, coordinates=[theta])
    scene.add_bodies(RigidBody("rotor", O, B, m, (inertia(B, 0, 0, J), O)))
    scene.add_loads((B, da.table(theta.diff(), speeds, torques, extrapolate="hold", name="torque") * N.z))
    run = da.compile_model(scene).simulate(
        (0, 10), {theta: 0.0, theta.diff(): 0.0}, {J: 0.5, m: 1.0}, method=method, **TIGHT
    )
    w, left = 0.0, 10.0
    for (a, below), (b, above) in pairwise(zip(speeds, torques, strict=True)):  # w' = torque / J, line by line
        rate = (above - below) / (b - a) / 0.5
        end = np.log(above / below) / rate if above > 0.0 else np.inf
        if end > left:
            w = a + below / 0.5 * np.expm1(rate * left) / rate
            break
        left -= end
    assert run["theta_dot"][-1] == pytest.approx(w, rel=1e-10)


def test_a_road_in_a_position_and_in_a_constraint():
    y, g = dynamicsymbols("y"), sp.symbols("g", positive=True)
    places = np.linspace(-1, 12, 27)
    heights = 0.3 * np.sin(places) + 0.05 * np.cos(3 * places)
    road = da.table(x, places, heights, "cubic", name="road")
    given = {m: 1.0, g: 9.81}
    ends = []
    for constrained in (False, True):
        scene = da.Scene("slide", frame=N, origin=O, coordinates=[x, y] if constrained else [x])
        Q = O.locatenew("Q", x * N.x + (y if constrained else road) * N.y)
        scene.add_bodies(Particle("mass", Q, m))
        scene.apply_uniform_gravity(-g * N.y)
        if constrained:
            scene.add_holonomic_constraints(y - road)
        for formulation in ("minimal", "projected") if constrained else ("minimal",):
            made = da.compile_model(scene, formulation=formulation, outputs=["energy"])
            begin = {x: 0.0, x.diff(): 3.0} | ({y: float(CubicSpline(places, heights)(0.0))} if constrained else {})
            run = made.simulate((0, 2), begin, given, **TIGHT)
            assert run.success and np.ptp(run["energy"]) < 1e-9
            ends.append(run["x"][-1])
    assert ends == pytest.approx([ends[0]] * 3, abs=1e-9)
    hit = made.simulate((0, 2), begin, given, events=[da.Event(road - 0.2, terminal=True)], **TIGHT)
    assert hit.status is Status.EVENT and CubicSpline(places, heights)(hit["x"][-1]) == pytest.approx(0.2, abs=1e-9)


def test_sensitivities_across_a_jump_are_refused():
    with pytest.raises(OptionError, match=r"the rates of the motion jump at t = .* in a state that depends on it"):
        model("hold").sensitivity((0, 3), start(), GIVEN, of=[x], wrt=[c])
    inside = model("hold").sensitivity((0, 0.1), start(1.75), GIVEN, of=[x], wrt=[c], **TIGHT)
    assert inside.success


@pytest.mark.usefixtures("quick_xla")
def test_pairs_of_jax_stop_at_knots_and_are_differentiated():
    jax = pytest.importorskip("jax")
    made, tolerances = model("linear", "jax"), {"rtol": 1e-10, "atol": 1e-12}
    expected, _ = reference("linear")
    run = made.simulate((0, END), start(), GIVEN, method="dopri8", **tolerances)
    cases = made.sweep((0, END), start(np.array([1.4, 1.7])), GIVEN, method="dopri8", **tolerances)
    assert [run["x"][-1], cases["x"][1]] == pytest.approx([expected[0]] * 2, abs=1e-9)
    with jax.enable_x64(True):
        solve = made.solve_fn(method="dopri8", **tolerances)
        found = jax.grad(
            lambda damping: solve([0.0, 3.0], {"x": 1.7, "x_dot": 0.0}, {"m": 1.0, "c": damping}).y[-1, 0]
        )(DAMPING)
    exact = model("linear").sensitivity((0, 3), start(), GIVEN, of=[x], wrt=[c], **TIGHT).jacobians[-1]
    assert float(found) == pytest.approx(float(np.ravel(exact)[0]), rel=1e-6)


def straight(as_table, argument=x, slope=-3.0, constant=1.0, name="line"):
    """Return a line as a table with knots all along it, or as it is."""
    knots = np.linspace(-6, 6, 25)
    values = slope * knots + constant
    return da.table(argument, knots, values, name=name) if as_table else slope * argument + constant


def on_a_line(as_table):
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("line", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("mass", P, m))
    scene.add_loads((P, straight(as_table) * N.x))
    return scene, P


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_tables_of_inputs_and_in_states(method):
    u, z = dynamicsymbols("u z")
    times = np.linspace(0, 4, 9)
    record = da.samples(times, 2.0 * np.sin(3.0 * times), kind="linear")
    ends = []
    for as_table in (True, False):
        scene, P = on_a_line(as_table)
        scene.add_inputs(u)
        scene.add_states({z: straight(as_table, z, -1.0, 0.0) + x})
        scene.add_loads((P, (0.3 * z + straight(as_table, u, 2.0, 0.0)) * N.x))
        begin = {x: 1.2, x.diff(): 0.3, z: 0.5}
        run = da.compile_model(scene).simulate((0, 4), begin, {m: 1.0}, inputs={u: record}, method=method, **TIGHT)
        assert run.success
        ends.append([run["x"][-1], run["z"][-1]])
    assert ends[0] == pytest.approx(ends[1], abs=1e-10)


def test_events_and_reductions_in_sweeps():
    bounce = da.Event(x - 1.0, direction=1, apply={x.diff(): -0.9 * x.diff()}, name="bounce")
    found = []
    for as_table in (True, False):
        made = da.compile_model(on_a_line(as_table)[0])
        cases = made.sweep(
            (0, 4),
            {x: np.linspace(-1, 0.9, 9), x.diff(): 1.0},
            {m: 1.0},
            events=[bounce],
            reduce={"hit": da.first_crossing(x - 0.3)},
            method="taylor",
            **TIGHT,
        )
        found.append([cases["x"], cases.reduced["hit"], cases.events["bounce"].last])
    for with_table, without in zip(*found, strict=True):
        np.testing.assert_allclose(with_table, without, atol=1e-9)


def test_contacts():
    y, g = dynamicsymbols("y"), sp.symbols("g", positive=True)
    X, Y = da.unknowns("X Y")
    given, ends = {m: 1.0, g: 9.81}, []
    for as_table in (True, False):
        scene = da.Scene("hopper", frame=N, origin=O, coordinates=[x, y])
        Q = O.locatenew("Q", x * N.x + y * N.y)
        scene.add_bodies(Particle("mass", Q, m))
        scene.add_loads((Q, straight(as_table) * N.x))
        scene.apply_uniform_gravity(-g * N.y)
        scene.add_joints(da.Joint("floor", body="mass", at=Q, force=X * N.x + Y * N.y))
        scene.add_contacts(da.UnilateralContact(normal=Y, gap=y, restitution=0.3))
        made = da.compile_model(scene)
        begin = {x: 1.5, y: 0.2, x.diff(): 0.0, y.diff(): 0.0}
        run = made.simulate((0, 3), begin, given, **TIGHT)
        cases = made.sweep((0, 3), begin | {x: [1.0, 1.5]}, given, **TIGHT)
        assert run.success and np.all(cases.status == 0)
        ends.append([run["x"][-1], *cases["x"]])
        if as_table:
            fast = {x: [1.5, 5.0], y: 0.2, x.diff(): [0.0, 30.0], y.diff(): 0.0}
            assert list(made.sweep((0, 3), fast, given).status) == [Status.SUCCESS, Status.OUTSIDE_TABLE]
    assert ends[0] == pytest.approx(ends[1], abs=1e-10)


def test_names_of_labels_in_assembly_serve_as_names():
    from dalembert.naming import Namer

    assert not {Namer()(name) for name in ("entry", "orders", "turn", "close")} & {"entry", "orders", "turn", "close"}
