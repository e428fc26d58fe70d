"""Tables whose values are parameters, against tables of numbers, differences of runs and SciPy's splines."""

import pickle

import numpy as np
import pytest
import sympy as sp
from scipy.interpolate import CubicSpline
from sympy.physics.mechanics import Particle

import dalembert as da
from dalembert.errors import OptionError, ValueInputError
from dalembert.methods.status import Status
from table_cases import DAMPING, KINDS, KNOTS, VALUES, N, O, c, m, stopped_at_knots, x

pytestmark = pytest.mark.usefixtures("quick_xla")

TIGHT = {"rtol": 1e-11, "atol": 1e-13}
v = sp.symbols("v0:9")
NUMBERS = dict(zip(v, VALUES, strict=True))
GIVEN = {m: 1.0, c: DAMPING, **NUMBERS}
START = {x: 1.7, x.diff(): 0.0}
_MADE = {}


def model(kind, backend="llvm", values=v, **options):
    key = kind, backend, tuple(values), tuple(options)
    if key not in _MADE:
        P = O.locatenew("P", x * N.x)
        scene = da.Scene(f"values_{kind}", frame=N, origin=O, coordinates=[x])
        scene.add_bodies(Particle("mass", P, m))
        scene.add_loads((P, (-da.table(x, KNOTS, values, kind, name="spring") - c * x.diff()) * N.x))
        _MADE[key] = da.compile_model(scene, backend=backend, **options)
    return _MADE[key]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("backend", "method"),
    [("llvm", "taylor"), ("llvm", "dop853"), ("llvm", "radau"), ("numpy", "dop853")],
)
def test_motions_are_those_of_a_table_of_numbers(kind, backend, method):
    made = model(kind, backend)
    exact, _ = stopped_at_knots(kind, (1.7, 0.0), 6.0)
    run = made.simulate((0, 6), START, GIVEN, method=method, **TIGHT)
    assert run.success and [run["x"][-1], run["x_dot"][-1]] == pytest.approx(list(exact), abs=1e-9)
    swept = GIVEN | {v[6]: VALUES[6] * np.linspace(0.9, 1.1, 3)}
    cases = made.sweep((0, 6), START, swept, method=method, **TIGHT)
    assert cases["x"][1] == pytest.approx(exact[0], abs=1e-9) and np.ptp(cases["x"]) > 1e-3


FEW = (*VALUES[:7].tolist(), *v[7:])
"""Values of which two alone are parameters, where code takes long to compile."""


def test_on_numba():
    exact, _ = stopped_at_knots("linear", (1.7, 0.0), 6.0)
    few = {m: 1.0, c: DAMPING, v[7]: VALUES[7], v[8]: VALUES[8]}
    run = model("linear", "numba", FEW).simulate((0, 6), START, few, method="dop853", **TIGHT)
    assert run["x"][-1] == pytest.approx(exact[0], abs=1e-9)


@pytest.mark.parametrize("kind", ["linear", "cubic"])
def test_derivatives_by_values_against_differences(kind):
    made, h = model(kind), 1e-5
    found = made.sensitivity((0, 3), START, GIVEN, of=[x], wrt=v, **TIGHT).jacobians[-1, 0]
    for i in (1, 4, 6, 8):
        ends = [made.simulate((0, 3), START, GIVEN | {v[i]: VALUES[i] + s * h}, **TIGHT)["x"][-1] for s in (1, -1)]
        assert found[i] == pytest.approx((ends[0] - ends[1]) / (2 * h), abs=1e-7)


def test_derivatives_by_values_of_a_hold_table_end_at_its_jumps():
    made = model("hold")
    with pytest.raises(OptionError, match="the rates of the motion jump at t ="):
        made.sensitivity((0, 3), START, GIVEN, of=[x], wrt=[v[7]])
    inside = made.sensitivity((0, 0.1), {x: 1.75, x.diff(): 0.0}, GIVEN | {c: 0.0}, of=[x], wrt=[v[7], v[6]], **TIGHT)
    assert inside.jacobians[-1, 0] == pytest.approx([-0.005, 0.0], abs=1e-12)


def test_gradients_of_jax_by_values():
    jax = pytest.importorskip("jax")
    with jax.enable_x64(True):
        solve = model("linear", "jax", FEW).solve_fn(method="tsit5", rtol=1e-9, atol=1e-11)

        def end(numbers):
            given = {"m": 1.0, "c": DAMPING, "v7": numbers[0], "v8": numbers[1]}
            return solve([0.0, 2.0], {"x": 1.7, "x_dot": 0.0}, given).y[-1, 0]

        found = jax.grad(end)(jax.numpy.array(VALUES[7:]))
    expected = model("linear").sensitivity((0, 2), START, GIVEN, of=[x], wrt=v[7:], **TIGHT).jacobians[-1, 0]
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_energy_is_the_antiderivative():
    made = model("cubic", outputs=["energy"])
    run = made.simulate((0, 5), START, GIVEN | {c: 0.0}, **TIGHT)
    potential = CubicSpline(KNOTS, VALUES).antiderivative()
    assert np.ptp(run["energy"]) < 1e-9
    assert run["energy"][0] == pytest.approx(float(potential(1.7)), rel=1e-12)


def test_some_values_are_expressions():
    k = sp.Symbol("k")
    mixed = [*VALUES[:6], VALUES[6] * k**2, VALUES[7] * k, VALUES[8]]
    made = model("linear", values=mixed)
    exact, _ = stopped_at_knots("linear", (1.7, 0.0), 6.0)
    run = made.simulate((0, 6), START, {m: 1.0, c: DAMPING, k: 1.0}, **TIGHT)
    assert run["x"][-1] == pytest.approx(exact[0], abs=1e-9)
    curve = da.table(x, KNOTS, mixed, name="spring")
    assert curve.free_symbols == {k, sp.Symbol("t")}
    assert float(curve.subs({x: 1.2, k: 1.0})) == pytest.approx(np.interp(1.2, KNOTS, VALUES), rel=1e-14)
    assert pickle.loads(pickle.dumps(curve)) == curve


def test_what_is_refused():
    for method in ("taylor", "dop853"):
        run = model("linear").simulate((0, 6), START | {x.diff(): 3.0}, GIVEN, method=method)
        assert run.status is Status.OUTSIDE_TABLE and "spring" in run.message
    with pytest.raises(ValueInputError, match=r"table 'spring': the knots are not numbers"):
        da.table(x, v, VALUES, name="spring")
    with pytest.raises(ValueInputError, match=r"65 of the values are expressions, and 64 at most may be"):
        da.table(x, np.arange(65), sp.symbols("w0:65"), name="spring")
    with pytest.raises(ValueInputError, match=r"9 knots and 8 values"):
        da.table(x, KNOTS, v[:-1], name="spring")
    with pytest.raises(ValueInputError, match=r"number 1 of the values is nan"):
        da.table(x, [0, 1, 2], [v[0], np.nan, 1.0], name="spring")


def test_a_start_at_rest_on_a_knot_goes_where_the_values_say():
    a, b = sp.symbols("a b")
    made = model("hold", values=[*VALUES[:6], a, b, VALUES[8]])
    for below, above, force in ((2.0, 1.0, -2.0), (-1.0, -3.0, 3.0)):
        given = {m: 1.0, c: 0.0, a: below, b: above}
        for method in ("taylor", "dop853"):
            run = made.simulate((0, 0.3), {x: 1.5, x.diff(): 0.0}, given, method=method, max_steps=500, **TIGHT)
            assert run["x_dot"][-1] == pytest.approx(0.3 * force, abs=1e-12)
