"""Starts at rest on a knot of a table that jumps there, against closed forms and SciPy stopped at the knots."""

import numpy as np
import pytest
import sympy as sp
from scipy.optimize import brentq
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import InitialStateError
from dalembert.methods.status import Status
from table_cases import DAMPING, c, m, oscillator, stopped_at_knots, x

pytestmark = pytest.mark.usefixtures("quick_xla")

TIGHT = {"rtol": 1e-11, "atol": 1e-13}
METHODS = [
    *(("llvm", method) for method in ("taylor", "dop853", "tsit5", "radau")),
    *(("numba", method) for method in ("taylor", "dop853")),
    *(("numpy", method) for method in ("dop853", "radau")),
]
N, O = ReferenceFrame("N"), Point("O")


def pushed(force, backend="llvm", *, inputs=(), **options):
    """Return the model of a mass on a line under a force."""
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("pushed", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("mass", P, m))
    scene.add_inputs(*inputs)
    scene.add_loads((P, force * N.x))
    return da.compile_model(scene, backend=backend, **options)


def jump(argument, below, above, knot=1.5):
    return da.table(argument, [knot - 4, knot, knot + 4], [below, above, above], "hold", "hold")


@pytest.mark.parametrize(("backend", "method"), METHODS)
def test_an_oscillator_let_go_at_a_knot(backend, method):
    made = da.compile_model(oscillator("hold"), backend=backend)
    exact, _ = stopped_at_knots("hold", (1.5 - 1e-13, 0.0), 3.0)
    given = {m: 1.0, c: DAMPING}
    run = made.simulate((0, 3), {x: 1.5, x.diff(): 0.0}, given, method=method, max_steps=5000, **TIGHT)
    assert run.success and [run["x"][-1], run["x_dot"][-1]] == pytest.approx(list(exact), abs=1e-9)
    starts = {x: np.full(9, 1.5), x.diff(): np.zeros(9)}
    cases = made.sweep((0, 3), starts, given, method=method, max_steps=5000, **TIGHT)
    assert np.all(cases.status == 0) and cases["x"] == pytest.approx(np.full(9, exact[0]), abs=1e-9)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
@pytest.mark.parametrize("off", [0.0, 2e-16, -2e-16])
def test_the_side_is_that_of_the_motion(method, off):
    for below, above, expected in (
        (-2.0, -1.0, -2.0),  # down, with the force below
        (1.0, 3.0, 3.0),  # up, with the force above
        (-2.0, 3.0, 3.0),  # to either: a knot belongs to the piece above
        (-2.0, 0.0, 0.0),  # in equilibrium above
    ):
        made = pushed(jump(x, below, above))
        start = {x: 1.5 + off, x.diff(): 0.0}
        run = made.simulate((0, 1), start, {m: 1.0}, method=method, max_steps=500, **TIGHT)
        if off < 0.0 and below * above <= 0.0:
            continue  # below the knot by rounding, such a motion may go to either side
        assert run.success and run["x_dot"][-1] == pytest.approx(expected, abs=1e-13)
        assert run["x"][-1] == pytest.approx(1.5 + 0.5 * expected, abs=1e-13)
        go = made.prepare((0, 1), method=method, max_steps=500, **TIGHT)
        end = go(made.state(start, {m: 1.0}), made.parameter_vector({m: 1.0}))
        assert end == pytest.approx([1.5 + 0.5 * expected, expected], abs=1e-13)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_a_force_that_begins_at_zero(method):
    u = dynamicsymbols("u")
    made = pushed(u + jump(x, -1.0, 0.0), inputs=[u])
    ramp = {u: da.samples([0.0, 1.0], [0.0, -3.0], "linear")}
    start = {x: 1.5, x.diff(): 0.0}
    run = made.simulate((0, 1), start, {m: 1.0}, inputs=ramp, method=method, max_steps=500, **TIGHT)
    assert run["x_dot"][-1] == pytest.approx(-2.5, abs=1e-12) and run["x"][-1] == pytest.approx(0.5, abs=1e-12)


@pytest.mark.parametrize("formulation", ["minimal", "projected"])
def test_an_argument_of_several_coordinates(formulation):
    y = dynamicsymbols("y")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("plane", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("mass", P, m))
    scene.add_holonomic_constraints(y - 2 * x)
    scene.add_loads((P, jump(x + sp.sin(y), -5.0, -10.0, knot=0.7) * N.x))
    made = da.compile_model(scene, formulation=formulation)
    begin = brentq(lambda q: q + np.sin(2 * q) - 0.7, 0.0, 0.5, xtol=1e-16)
    start = {x: begin, x.diff(): 0.0, y: 2 * begin}
    run = made.simulate((0, 0.4), start, {m: 1.0}, method="dop853", max_steps=500, **TIGHT)
    assert run["x_dot"][-1] == pytest.approx(-0.4, abs=1e-11) and run["x"][-1] == pytest.approx(begin - 0.08, abs=1e-11)


def test_a_start_that_would_slide_along_the_knot_is_refused_by_name():
    for argument in (x, x.diff()):
        made = pushed(-jump(argument, -1.0, 1.0, knot=0.0) + sp.Symbol("F"))
        start = {x: 0.0, x.diff(): 0.0}
        with pytest.raises(InitialStateError, match=r"'f' is at a knot where the table jumps.*kind=\"linear\""):
            made.simulate((0, 1), start, {m: 1.0, "F": 0.5})
        for method in ("taylor", "dop853"):
            cases = made.sweep((0, 1), start, {m: 1.0, "F": np.array([0.5, 1.5])}, method=method)
            assert list(cases.status) == [Status.INITIAL_STATE, Status.SUCCESS]
            assert cases["x_dot"][1] == pytest.approx(0.5, abs=1e-12)


def test_on_jax():
    jax = pytest.importorskip("jax")
    made = pushed(jump(x, -2.0, -1.0), "jax")
    with jax.enable_x64(True):
        solve = made.solve_fn(["x", "x_dot"], method="tsit5", max_steps=500, **TIGHT)

        def speed(mass):
            return solve([0.0, 1.0], {"x": 1.5, "x_dot": 0.0}, {"m": mass}).y[-1, 1]

        value, slope = jax.jvp(speed, (1.0,), (1.0,))
    assert [float(value), float(slope)] == pytest.approx([-2.0, 2.0], abs=1e-12)


def test_with_contacts():
    y, (X, Y) = dynamicsymbols("y"), da.unknowns("X Y")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("hopper", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("mass", P, m))
    scene.add_loads((P, jump(x, -2.0, -1.0) * N.x - 9.81 * m * N.y))
    scene.add_joints(da.Joint("floor", body="mass", at=P, force=X * N.x + Y * N.y))
    scene.add_contacts(da.UnilateralContact(normal=Y, gap=y, restitution=0.3))
    made = da.compile_model(scene)
    start = {x: 1.5, x.diff(): 0.0, y: 0.2, y.diff(): 0.0}
    for method in ("taylor", "dop853"):
        run = made.simulate((0, 1), start, {m: 1.0}, method=method, max_steps=500, **TIGHT)
        cases = made.sweep((0, 1), start | {y: np.array([0.2, 0.3])}, {m: 1.0}, method=method, max_steps=500, **TIGHT)
        assert run["x"][-1] == pytest.approx(0.5, abs=1e-12) and cases["x"] == pytest.approx([0.5, 0.5], abs=1e-12)


# -- backwards in time --------------------------------------------------------------------------

TIME = dynamicsymbols._t
BACKWARD = [(backend, method) for backend, method in METHODS if (backend, method) != ("numba", "dop853")]


def ends(made, span, start, method, count=3):
    """Return the final positions of a single run, of sweeps and of a prepared run."""
    options = {"method": method, "max_steps": 3000, **TIGHT}
    run = made.simulate(span, start, {m: 1.0}, **options)
    cases = made.sweep(span, {name: np.full(count, value) for name, value in start.items()}, {m: 1.0}, **options)
    go = made.prepare(span, **options)
    final = go(made.state(start, {m: 1.0}), made.parameter_vector({m: 1.0}))
    assert run.success and np.all(cases.success) and go.status is Status.SUCCESS
    return [run["x"][-1], *cases["x"], final[0]]


@pytest.mark.parametrize("end", [1.0, -1.0])
@pytest.mark.parametrize(("backend", "method"), BACKWARD)
def test_a_force_that_grows_from_zero(backend, method, end):
    """The force is t times a table, so that the third derivative decides: forwards up, backwards down."""
    for below, above in ((1.0, 3.0), (-2.0, -1.0)):
        made = pushed(TIME * jump(x, below, above), backend)
        force = above if end * above > 0 else below
        found = ends(made, (0, end), {x: 1.5, x.diff(): 0.0}, method)
        assert found == pytest.approx([1.5 + force * end**3 / 6] * 5, abs=1e-11)


@pytest.mark.parametrize("end", [1.0, -1.0])
@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_a_speed_on_a_knot(method, end):
    """The speed falls from the knot, backwards in time it rises: the first derivative decides."""
    made = pushed(jump(x.diff(), -1.0, -3.0, knot=0.5))
    force = -1.0 if end > 0 else -3.0
    expected = 1.5 + 0.5 * end + 0.5 * force
    assert ends(made, (0, end), {x: 1.5, x.diff(): 0.5}, method) == pytest.approx([expected] * 5, abs=1e-11)


@pytest.mark.parametrize("end", [1.0, -1.0])
@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_linear_tables(method, end):
    """f = t g(x) with a kink of g at the start, against the stiff side alone: x'' = t (2 + s (x - 1.5))."""
    table = da.table(x, [-2.5, 1.5, 5.5], [-1.0, 2.0, 9.0], "linear", "linear")
    made, slope = pushed(TIME * table), 7.0 / 4 if end > 0 else 3.0 / 4
    series = [0.0, 0.0, 0.0, 2.0 / 6]  # of x - 1.5 by t
    for k in range(4, 40):
        series.append(slope * series[k - 3] / (k * (k - 1)))
    expected = 1.5 + sum(value * end**k for k, value in enumerate(series))
    assert ends(made, (0, end), {x: 1.5, x.diff(): 0.0}, method) == pytest.approx([expected] * 5, abs=1e-10)


def test_cases_of_both_directions_in_one_sweep():
    made, spans = pushed(TIME * jump(x, 1.0, 3.0)), np.array([1.0, -1.0, 0.5, -2.0])
    for method in ("taylor", "dop853"):
        cases = made.sweep((0, spans), {x: 1.5, x.diff(): 0.0}, {m: 1.0}, method=method, max_steps=3000, **TIGHT)
        force = np.where(spans > 0, 3.0, 1.0)
        assert cases["x"] == pytest.approx(1.5 + force * spans**3 / 6, abs=1e-11)


def test_sliding_backwards():
    """A speed whose force pushes it back to the knot slides forwards, not backwards; and the other way round."""
    start = {x: 0.0, x.diff(): 0.5}
    stable, unstable = (pushed(jump(x.diff(), low, -low, knot=0.5)) for low in (1.0, -1.0))
    with pytest.raises(InitialStateError, match="at a knot where the table jumps"):
        stable.simulate((0, 1), start, {m: 1.0})
    assert stable.simulate((0, -1), start, {m: 1.0}).success and unstable.simulate((0, 1), start, {m: 1.0}).success
    with pytest.raises(InitialStateError, match="at a knot where the table jumps"):
        unstable.simulate((0, -1), start, {m: 1.0})
    cases = unstable.sweep((0, [-1.0, 1.0]), start, {m: 1.0})
    assert list(cases.status) == [Status.INITIAL_STATE, Status.SUCCESS]
    go = unstable.prepare((0, -1))
    assert np.all(np.isnan(go(unstable.state(start, {m: 1.0}), unstable.parameter_vector({m: 1.0}))))
    assert go.status is Status.INITIAL_STATE


def test_backwards_on_jax():
    jax = pytest.importorskip("jax")
    made = pushed(TIME * jump(x, 1.0, 3.0), "jax")
    with jax.enable_x64(True):
        solve = made.solve_fn(["x", "x_dot"], method="tsit5", max_steps=500, **TIGHT)
        for end, force in ((1.0, 3.0), (-1.0, 1.0)):
            found = solve([0.0, end], {"x": 1.5, "x_dot": 0.0}, {"m": 1.0}).y[-1, 0]
            assert float(found) == pytest.approx(1.5 + force * end / 6, abs=1e-11)


@pytest.mark.parametrize(("below", "above"), [(1.0, 3.0), (-2.0, -1.0)])
def test_backwards_with_contacts(below, above):
    y, (X, Y) = dynamicsymbols("y"), da.unknowns("X Y")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("hopper", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("mass", P, m))
    scene.add_loads((P, TIME * jump(x, below, above) * N.x - 9.81 * m * N.y))
    scene.add_joints(da.Joint("floor", body="mass", at=P, force=X * N.x + Y * N.y))
    scene.add_contacts(da.UnilateralContact(normal=Y, gap=y, restitution=0.3))
    made = da.compile_model(scene)
    start = {x: 1.5, x.diff(): 0.0, y: 30.0, y.diff(): 0.0}
    for method in ("taylor", "dop853"):
        for end in (1.0, -1.0):
            force = above if end * above > 0 else below
            run = made.simulate((0, end), start, {m: 1.0}, method=method, max_steps=500, **TIGHT)
            cases = made.sweep((0, end), start | {y: [30.0, 40.0]}, {m: 1.0}, method=method, max_steps=500, **TIGHT)
            assert [run["x"][-1], *cases["x"]] == pytest.approx([1.5 + force * end / 6] * 3, abs=1e-11)


# -- events that map the state onto a knot -------------------------------------------------------


def after_maps(made, span, start, event, method):
    """Return the final positions of a single run and of the cases of a sweep with an event that maps the state."""
    options = {"method": method, "max_steps": 3000, "events": [event], **TIGHT}
    run = made.simulate(span, start, {m: 1.0}, **options)
    cases = made.sweep(span, start, {m: np.ones(3)}, **options)
    assert run.success and np.all(cases.success), (run.message, cases.status)
    assert len(run.events["set"].t) == 1 and np.all(cases.events["set"].count == 1)
    return [run["x"][-1], *cases["x"]]


@pytest.mark.parametrize("end", [1.0, -1.0])
@pytest.mark.parametrize(("backend", "method"), METHODS)
def test_a_map_onto_a_knot(backend, method, end):
    """From rest on the knot at t = 0 under a force of t times a table: backwards in time, to the other side."""
    for below, above in ((1.0, 3.0), (-2.0, -1.0)):
        made = pushed(TIME * jump(x, below, above), backend)
        event = da.Event(TIME, apply={x: 1.5, x.diff(): 0.0}, name="set")
        found = after_maps(made, (-end, end), {x: 0.25, x.diff(): 0.1}, event, method)
        force = above if end * above > 0 else below
        assert found == pytest.approx([1.5 + force * end**3 / 6] * 4, abs=1e-11)


@pytest.mark.parametrize("end", [1.0, -1.0])
@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5", "radau"])
def test_a_map_onto_a_speed_on_a_knot(method, end):
    """The speed falls from the knot, backwards in time it rises."""
    made = pushed(jump(x.diff(), -1.0, -3.0, knot=0.5))
    event = da.Event(TIME - 0.25, apply={x: 1.5, x.diff(): 0.5}, name="set")
    found = after_maps(made, (0.25 - end, 0.25 + end), {x: 0.0, x.diff(): 2.0}, event, method)
    force = -1.0 if end > 0 else -3.0
    assert found == pytest.approx([1.5 + 0.5 * end + 0.5 * force] * 4, abs=1e-11)


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_a_map_to_a_slide(method):
    """Where neither side lets the motion go forwards, both do backwards; and the other way round."""
    event = da.Event(TIME - 0.25, apply={x: 1.5, x.diff(): 0.5}, name="set")
    for low, refused in ((1.0, 1.0), (-1.0, -1.0)):
        made = pushed(jump(x.diff(), low, -low, knot=0.5))
        for end in (1.0, -1.0):
            start = {x: 0.0, x.diff(): 7.0 if low * end < 0 else -7.0}
            options = {"method": method, "events": [event], "max_steps": 3000, **TIGHT}
            run = made.simulate((0.25 - end, 0.25 + end), start, {m: 1.0}, **options)
            cases = made.sweep((0.25 - end, 0.25 + end), start, {m: np.ones(2)}, **options)
            expected = Status.EVENT_STATE if end == refused else Status.SUCCESS
            assert [run.status, *cases.status] == [expected] * 3


def test_a_map_onto_a_knot_with_contacts():
    """Forwards the speed would slide along the knot; backwards it leaves it to either side, and takes that above."""
    y, (X, Y) = dynamicsymbols("y"), da.unknowns("X Y")
    P = O.locatenew("P", x * N.x + y * N.y)
    scene = da.Scene("hopper", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("mass", P, m))
    scene.add_loads((P, jump(x.diff(), 1.0, -1.0, knot=0.5) * N.x - 9.81 * m * N.y))
    scene.add_joints(da.Joint("floor", body="mass", at=P, force=X * N.x + Y * N.y))
    scene.add_contacts(da.UnilateralContact(normal=Y, gap=y, restitution=0.3))
    made = da.compile_model(scene)
    event = da.Event(TIME - 0.25, apply={x: 1.5, x.diff(): 0.5}, name="set")
    start = {x: 0.0, x.diff(): 7.0, y: 30.0, y.diff(): 0.0}
    for method in ("taylor", "dop853"):
        options = {"method": method, "events": [event], "max_steps": 3000, **TIGHT}
        run = made.simulate((1.25, -0.75), start, {m: 1.0}, **options)
        cases = made.sweep((1.25, -0.75), start | {y: [30.0, 40.0]}, {m: 1.0}, **options)
        assert run.success and np.all(cases.success), (run.message, cases.status)
        assert [run["x"][-1], *cases["x"]] == pytest.approx([0.5] * 3, abs=1e-11)
