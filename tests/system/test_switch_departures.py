"""Rest on a switch of a coordinate or a speed (`sign`, `Heaviside`, `Piecewise`, `Max`) until a force ends it."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status
from departure_cases import KNOT, PULLS, TIGHT, TIME, N, O, check_traced_runs, ends, pulled, u, v
from table_cases import m, x

y = dynamicsymbols("y")
BELOW = sp.Heaviside(KNOT - x, 0)
SWITCHES = {
    "Heaviside": -BELOW,
    "sign": sp.sign(x - KNOT),
    "Piecewise": sp.Piecewise((-1, x < KNOT), (0, True)),
    "floor": sp.Max(sp.floor(x + 0.5) - 2, -1),
    "speed": -sp.Heaviside(-v, 0),
    "scaled": sp.Piecewise((-1, 2 * x - x**2 / 4 < 2 * KNOT - KNOT**2 / 4), (0, True)),
}
"""Forces of 0 N at rest at x = 1.5, and of -1 N where the mass is pulled to."""
METHODS = ["taylor", "dop853", "tsit5", "radau"]


def masses(first, second, inputs=(u,)):
    """Return the model of two masses of 1 kg on a line under forces."""
    A, B = O.locatenew("A", x * N.x), O.locatenew("B", y * N.x)
    scene = da.Scene("masses", frame=N, origin=O, coordinates=[x, y])
    scene.add_bodies(Particle("a", A, m), Particle("b", B, m))
    scene.add_inputs(*inputs)
    scene.add_loads((A, first * N.x), (B, second * N.x))
    return da.compile_model(scene)


def alone(force, inputs=(u,)):
    """Return the model of one mass on a line under a force."""
    A = O.locatenew("A", x * N.x)
    scene = da.Scene("alone", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("a", A, m))
    scene.add_inputs(*inputs)
    scene.add_loads((A, force * N.x))
    return da.compile_model(scene)


def final(made, start, method, span=(0, 2), **options):
    """Return the final values of a single run and of a sweep, in which those of `start` are the same."""
    options = {"method": method, **TIGHT, **options}
    run = made.simulate(span, start, {m: 1.0}, **options)
    cases = made.sweep(span, start, {m: np.ones(2)}, **options)
    assert run.success and np.all(cases.success)
    names = [*made.layout.coordinates, *made.layout.rates]
    return np.array([[run[name][-1] for name in names], [cases[name][0] for name in names]])


@pytest.mark.parametrize(
    ("switch", "kind", "method"),
    [
        *(("Heaviside", kind, method) for kind in PULLS for method in METHODS),
        *(
            (switch, "linear", method)
            for switch in SWITCHES
            if switch != "Heaviside"
            for method in ("taylor", "dop853")
        ),
    ],
)
def test_a_pull_that_begins_at_a_knot_of_an_input(switch, method, kind):
    given, (speed, way) = PULLS[kind]
    found = ends(pulled(u + SWITCHES[switch]), (0, 2), method, {u: given})
    assert found == pytest.approx(np.tile([KNOT + way - 0.5, speed - 1.0], (len(found), 1)), abs=1e-10)


@pytest.mark.parametrize(
    ("backend", "method"), [("numba", "taylor"), ("numba", "dop853"), ("numpy", "dop853"), ("numpy", "radau")]
)
def test_backends(backend, method):
    given, (speed, way) = PULLS["linear"]
    found = ends(pulled(u - BELOW, backend), (0, 2), method, {u: given})
    assert found == pytest.approx(np.tile([KNOT + way - 0.5, speed - 1.0], (len(found), 1)), abs=1e-10)


@pytest.mark.parametrize("formulation", ["projected", "baumgarte", "ggl"])
def test_formulations(formulation):
    given, (speed, way) = PULLS["hold"]
    made = pulled(u - BELOW, formulation=formulation)
    method = "radau" if formulation == "ggl" else "dop853"
    run = made.simulate((0, 2), {x: KNOT, v: 0.0}, {m: 1.0}, inputs={u: given}, method=method, **TIGHT)
    assert run.success and run["x_dot"][-1] == pytest.approx(speed - 1.0, abs=1e-9)
    assert run["x"][-1] == pytest.approx(KNOT + way - 0.5, abs=1e-9)


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
@pytest.mark.parametrize("power", [0, 2, 3, 6])
def test_a_pull_that_begins_with_a_power_of_time(power, method):
    pull = sp.Piecewise((0, TIME < 1), (-3 * (TIME - 1) ** power, True))
    found = ends(pulled(pull - BELOW, inputs=()), (0, 2), method)
    expected = [KNOT - 3 / ((power + 1) * (power + 2)) - 0.5, -3 / (power + 1) - 1]
    assert found == pytest.approx(np.tile(expected, (len(found), 1)), abs=1e-10)


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_a_pull_of_a_controller(method):
    count = dynamicsymbols("n")
    law = da.Controller("starter", period=1.0, states={count: count + 1}, inputs={u: -3 * sp.Min(count, 1)})
    made = pulled(u - BELOW, controllers=[law])
    start = {x: KNOT, v: 0.0, count: 0}
    run = made.simulate((0, 2), start, {m: 1.0}, method=method, **TIGHT)
    cases = made.sweep((0, 2), start, {m: np.ones(3)}, method=method, **TIGHT)
    assert [run["x_dot"][-1], *cases["x_dot"]] == pytest.approx([-4.0] * 4, abs=1e-11)
    assert [run["x"][-1], *cases["x"]] == pytest.approx([KNOT - 2.0] * 4, abs=1e-11)


@pytest.mark.parametrize("method", METHODS)
def test_backwards_in_time(method):
    given = {u: da.samples([0.0, 1.0, 2.0], [-3.0, 0.0, 0.0], "linear")}
    found = ends(pulled(u - BELOW), (2, 0), method, given)
    assert found == pytest.approx(np.tile([KNOT - 1.0, 2.5], (len(found), 1)), abs=1e-11)


@pytest.mark.parametrize("method", METHODS)
def test_a_start_on_a_switch(method):
    """Forwards and backwards in time, with a force at once and with one that begins as t^2."""
    for span in ((0, 2), (0, -2)):
        assert final(alone(-1 - BELOW, ()), {x: KNOT, v: 0.0}, method, span) == pytest.approx(
            np.tile([KNOT - 4, -2 * span[1]], (2, 1)), abs=1e-10
        )
        assert final(alone(-(TIME**2) - BELOW, ()), {x: KNOT, v: 0.0}, method, span) == pytest.approx(
            np.tile([KNOT - 4 / 3 - 2, -(span[1] ** 3) / 3 - span[1]], (2, 1)), abs=1e-10
        )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("place", [0, KNOT])
def test_the_value_at_a_switch_holds_as_long_as_the_motion_rests_there(place, method):
    """The sign drives the mass away from an equilibrium where it is 0."""
    made = alone(5 * sp.sign(x - place) + u)
    rest = final(made, {x: place, v: 0.0}, method, inputs={u: da.samples([0.0, 1.0, 2.0], [0.0, 0.0, 0.0], "hold")})
    assert rest.tolist() == [[place, 0.0]] * 2
    pull = da.samples([0.0, 1.0, 2.0], [0.0, 0.0, -3.0], "linear")
    moved = final(made, {x: place, v: 0.0}, method, inputs={u: pull})
    assert moved == pytest.approx(np.tile([place - 3.0, -6.5], (2, 1)), abs=1e-10)


@pytest.mark.parametrize("method", METHODS)
def test_a_value_that_only_the_switch_itself_has(method):
    made = alone(sp.Piecewise((-2, x < 0), (-2, x > 0), (0, True)) + u)
    found = final(made, {x: 0.0, v: 0.0}, method, inputs={u: PULLS["linear"][0]})
    assert found == pytest.approx(np.tile([-1.5, -3.5], (2, 1)), abs=1e-11)


@pytest.mark.parametrize("method", METHODS)
def test_a_preloaded_spring(method):
    """It pushes back with 2 N as soon as the mass touches it: a mass under less than that slides along the jump."""
    made = alone(sp.Piecewise((0, x < KNOT), (-2 - 4 * (x - KNOT), True)) + u)
    start, ramps = (
        {x: KNOT, v: 0.0},
        {force: da.samples([0.0, 1.0, 2.0], [0.0, force, force], "hold") for force in (-3, 1, 3)},
    )
    away, into = (final(made, start, method, inputs={u: ramps[force]}) for force in (-3, 3))
    assert away == pytest.approx(np.tile([0.0, -3.0], (2, 1)), abs=1e-11)
    assert into == pytest.approx(np.tile([KNOT + 0.25 * (1 - np.cos(2)), 0.5 * np.sin(2)], (2, 1)), abs=1e-9)
    run = made.simulate((0, 2), start, {m: 1.0}, inputs={u: ramps[1]}, method=method, **TIGHT)
    assert run.status is Status.MAX_STEPS


@pytest.mark.parametrize("force", [-3.0, 3.0])
@pytest.mark.parametrize("kind", ["hold", "linear"])
@pytest.mark.parametrize("spring", [-7 * sp.Max(0, x - KNOT), sp.Piecewise((0, x < KNOT), (-7 * (x - KNOT), True))])
def test_a_gap_that_is_just_closed(spring, kind, force):
    """Without a jump too: by rounding, sweeps stayed on the kink for thousands of Taylor steps."""
    given = da.samples([0.0, 1.0, 2.0], [0.0, force if kind == "hold" else 0.0, force], kind)
    root = np.sqrt(7.0)
    hit = [(1 - np.cos(root)) / 7, np.sin(root) / root] if kind == "hold" else [(1 - np.sin(root) / root) / 7]
    hit = hit if kind == "hold" else [*hit, (1 - np.cos(root)) / 7]
    free = [0.5, 1.0] if kind == "hold" else [1 / 6, 0.5]
    way, speed = force * np.array(hit if force > 0 else free)
    made = alone(spring + u)
    found = final(made, {x: KNOT, v: 0.0}, "taylor", inputs={u: given})
    assert found == pytest.approx(np.tile([KNOT + way, speed], (2, 1)), abs=1e-10)


@pytest.mark.parametrize("method", ["taylor", "dop853"])
def test_a_switch_that_an_input_moves_away(method):
    """The mass rests where the input is, which leaves it upwards or downwards from t = 1 on."""
    made = alone(-sp.Heaviside(u - x, 0))
    for last, expected in ((2.5, [1.0, -1.0]), (0.5, [KNOT, 0.0])):
        given = {u: da.samples([0.0, 1.0, 2.0], [KNOT, KNOT, last], "linear")}
        found = final(made, {x: KNOT, v: 0.0}, method, inputs=given)
        assert found == pytest.approx(np.tile(expected, (2, 1)), abs=1e-11)


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
@pytest.mark.parametrize("kind", PULLS)
def test_a_first_order_state(kind, method):
    z = dynamicsymbols("z")
    A = O.locatenew("A", x * N.x)
    scene = da.Scene("valve", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("a", A, m))
    scene.add_inputs(u)
    scene.add_states({z: u - sp.Heaviside(KNOT - z, 0)})
    start, (given, (change, _)) = {x: 0.0, v: 0.0, z: KNOT}, PULLS[kind]
    made = da.compile_model(scene)
    run = made.simulate((0, 2), start, {m: 1.0}, inputs={u: given}, method=method, **TIGHT)
    assert run.success and run["z"][-1] == pytest.approx(KNOT + change - 1, abs=1e-11)


@pytest.mark.parametrize("method", METHODS)
def test_a_switch_between_two_masses(method):
    """They attract each other by 1 N as long as they are closer than 1 m."""
    near = sp.Heaviside(1 - (y - x), 0)
    start = {x: 0.3, v: 0.0, y: 1.3, y.diff(): 0.0}
    found = final(masses(near, u - near), start, method, inputs={u: PULLS["hold"][0]})
    assert found == pytest.approx(np.tile([0.8, -0.7, 1.0, -4.0], (2, 1)), abs=1e-11)


@pytest.mark.parametrize("method", METHODS)
def test_two_switches_that_are_left_at_once(method):
    """The jump of the first force depends on the side of the second switch too."""
    above = sp.Heaviside(y - 0.7, 0)
    start = {x: KNOT, v: 0.0, y: 0.7, y.diff(): 0.0}
    found = final(masses(u - BELOW * (1 + above), above - u), start, method, inputs={u: PULLS["hold"][0]})
    assert found == pytest.approx(np.tile([KNOT - 2.5, 2.7, -5.0, 4.0], (2, 1)), abs=1e-11)


@pytest.mark.parametrize("method", ["taylor", "dop853", "tsit5"])
def test_cases_of_a_sweep_have_the_bits_of_prepared_runs(method):
    made = pulled(u - BELOW)
    begin, size = KNOT + np.linspace(-0.5, 0.5, 7), np.linspace(-3.0, 3.0, 7)
    begin[[2, 5]] = KNOT
    times, values = np.array([0.0, 0.5, 1.0, 2.0]), np.outer(size, [0.0, 0.0, 1.0, 1.0])
    options = {"method": method, **TIGHT}
    for kind in ("hold", "linear"):
        given = {u: da.samples(times, values, kind)}
        cases = made.sweep((0, 2), {x: begin, v: 0.0}, {m: 1.0}, inputs=given, **options)
        assert np.all(cases.success)
        for i, q in enumerate(begin):
            own = {u: da.samples(times, values[i], kind)}
            go = made.prepare((0, 2), inputs=own, **options)
            end = go(made.state({x: q, v: 0.0}, {m: 1.0}, inputs={u: 0.0}), made.parameter_vector({m: 1.0}))
            assert end.tolist() == [cases[name][i] for name in made.layout.state]


@pytest.mark.usefixtures("quick_xla")
def test_traced_runs():
    pytest.importorskip("jax")
    check_traced_runs(pulled(u - BELOW, "jax"))


def test_nothing_is_added_where_nothing_can_rest_on_a_switch():
    smooth, still, drag = u - 4 * x, -BELOW, u - v * sp.Abs(v) - sp.Max(0, x)
    for force, inputs in ((smooth, (u,)), (still, ()), (drag, (u,))):
        assert alone(force, inputs).stages.program.knot_sides is None
    assert alone(u - BELOW).stages.program.knot_sides is not None


def test_a_start_on_a_kink_at_zero_is_not_moved():
    run = alone(-sp.Max(0, x) - 1, ()).simulate((0, 1), {x: 0.0, v: 0.0}, {m: 1.0})
    assert run["x"][0] == 0.0 and run["x_dot"][-1] == pytest.approx(-1.0, abs=1e-9)
