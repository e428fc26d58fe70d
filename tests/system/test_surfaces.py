"""Surfaces of data over two values: their numbers, and motions with them on every backend, against SciPy."""

import functools
import subprocess
import sys

import numpy as np
import pytest
import sympy as sp
from scipy.interpolate import RectBivariateSpline, RegularGridInterpolator
from sympy.physics.mechanics import Particle, dynamicsymbols

import dalembert as da
from dalembert.errors import ExpressionError, ProgramTextError, SceneError, ValueInputError
from dalembert.ir.graph import Graph
from dalembert.ir.program import Program
from dalembert.ir.surfaces import array_surface, surface_value
from dalembert.ir.zero_tests import vanishes
from dalembert.methods.status import Status
from dalembert.transforms.derivatives import tangents
from surface_cases import END, GIVEN, KNOTS, START, VALUES, N, O, m, motion, s, scene, surface, x, y

pytestmark = pytest.mark.usefixtures("quick_xla")

TIGHT = {"rtol": 1e-11, "atol": 1e-13}
NAMES = ("x", "y", "x_dot", "y_dot")
RUNS = [
    *(("llvm", method) for method in ("taylor", "dop853", "tsit5", "radau")),
    *(("numpy", method) for method in ("dop853", "radau")),
    ("numba", "taylor"),
    ("jax", "taylor"),
]
A, B = np.random.default_rng(5).uniform(-1, 1, (2, 300)) * [[2.0], [3.0]]


@functools.cache
def model(kind, backend="llvm", extrapolate="error"):
    if backend == "jax":
        pytest.importorskip("jax")
    return da.compile_model(scene(kind, extrapolate), backend=backend)


def last(run):
    return np.array([run[name][-1] for name in NAMES])


def test_cubic_values_and_derivatives_are_those_of_scipy():
    key, spline = surface("cubic").curve.table.key, RectBivariateSpline(*KNOTS, VALUES)
    for i, j in np.ndindex(3, 3):
        np.testing.assert_allclose(array_surface(A, B, key, i, j), spline.ev(A, B, dx=i, dy=j), atol=3e-13)
    np.testing.assert_allclose(array_surface(*np.meshgrid(*KNOTS, indexing="ij"), key, 0, 0), VALUES, atol=1e-13)


def test_linear_and_held_values_and_those_outside():
    lines = RegularGridInterpolator(KNOTS, VALUES, bounds_error=False, fill_value=np.nan)
    key = surface("linear").curve.table.key
    np.testing.assert_allclose(array_surface(A, B, key, 0, 0), lines((A, B)), atol=1e-14)
    assert np.isnan([surface_value(*at, key, 0, 0) for at in ((2.1, 0.0), (0.0, -3.1), (-2.1, 3.1))]).all()
    held = surface("hold", "hold").curve.table.key
    at = [
        np.clip(np.searchsorted(line, q, side="right") - 1, 0, None)
        for line, q in zip(KNOTS, (2 * A, 2 * B), strict=True)
    ]
    np.testing.assert_array_equal(array_surface(2 * A, 2 * B, held, 0, 0), VALUES[at[0], at[1]])
    clamped = surface("cubic", "hold").curve.table.key
    ends = np.clip(2 * A, -2, 2), np.clip(2 * B, -3, 3)
    np.testing.assert_allclose(
        array_surface(2 * A, 2 * B, clamped, 0, 0), RectBivariateSpline(*KNOTS, VALUES).ev(*ends), atol=1e-13
    )
    beyond = surface("cubic", "linear").curve.table.key
    slope = surface_value(2.0, 0.3, beyond, 1, 0)
    assert surface_value(2.5, 0.3, beyond, 0, 0) == pytest.approx(surface_value(2.0, 0.3, beyond, 0, 0) + 0.5 * slope)


def test_derivatives_of_the_graph_and_identities():
    graph = Graph()
    p, q = graph.input("p"), graph.input("q")
    key = graph.const(surface("cubic").curve.table.key)
    made = graph.call("surface", p * q, q, key, graph.zero, graph.zero)
    by_q = tangents(graph, [made], {q: graph.one})[0]
    step = 1e-6

    def value(a, b):
        return surface_value(a * b, b, float(key.number), 0, 0)

    wanted = (value(0.4, 1.1 + step) - value(0.4, 1.1 - step)) / (2 * step)
    first = graph.call("surface", p * q, q, key, graph.one, graph.zero)
    second = graph.call("surface", p * q, q, key, graph.zero, graph.one)
    assert vanishes(by_q - (p * first + second)) and not vanishes(by_q - first) and not vanishes(first - second)
    exact = 0.4 * surface_value(0.44, 1.1, float(key.number), 1, 0) + surface_value(0.44, 1.1, float(key.number), 0, 1)
    assert exact == pytest.approx(wanted, abs=1e-8)


@pytest.mark.parametrize("kind", ["cubic", "linear"])
@pytest.mark.parametrize(("backend", "method"), RUNS, ids=lambda value: value)
def test_motions_are_those_of_scipy(backend, method, kind):
    if backend in ("numba", "jax") and kind == "linear":
        pytest.skip("these take long to compile")
    run = model(kind, backend).simulate((0, END), START, GIVEN, method=method, **TIGHT)
    assert run.success
    np.testing.assert_allclose(last(run), motion(kind), atol=1e-9)


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_sweeps_and_prepared_runs_are_single_runs(method):
    made, masses = model("cubic"), np.linspace(0.9, 1.7, 9)
    cases = made.sweep((0, END), START, {**GIVEN, m: masses}, method=method, **TIGHT)
    for i in (2, 4):
        found = [cases[name][i] for name in NAMES]
        assert found == pytest.approx(list(motion("cubic", END, float(masses[i]))), abs=1e-9)
    run = made.prepare((0, END), method=method, **TIGHT)
    ended = run(made.state(START, GIVEN), made.parameter_vector(GIVEN))
    assert list(ended) == pytest.approx(list(motion("cubic")), abs=1e-9)


def test_sensitivities_and_linearisation():
    made = model("cubic")
    found = made.sensitivity((0, 2), START, GIVEN, of=[x, y], wrt=[m], **TIGHT)
    ends = [motion("cubic", 2, 1.3 + step) for step in (1e-4, -1e-4)]
    for q, place in ((x, 0), (y, 1)):
        assert found.jacobian(q, m)[-1] == pytest.approx((ends[0][place] - ends[1][place]) / 2e-4, abs=1e-6)
    spline = RectBivariateSpline(*KNOTS, VALUES)
    lin = made.linearize(0, START, GIVEN)
    by_x, by_v = spline.ev(1.2, 0.9, dx=1), spline.ev(1.2, 0.9, dy=1)
    wanted = np.array([[-by_x, 0, 0, -by_v], [-0.1 * by_x, -1.5, 0, -0.1 * by_v]]) / 1.3
    np.testing.assert_allclose(np.asarray(lin.A)[2:], wanted, atol=1e-11)


def test_a_run_that_leaves_the_grid_says_which_argument_did():
    for backend, method in (("llvm", "taylor"), ("llvm", "dop853"), ("numpy", "dop853")):
        made = model("linear", backend)
        run = made.simulate((0, END), {**START, y.diff(): 2.9, y: -4}, GIVEN, method=method, rtol=1e-9)
        assert run.status is Status.OUTSIDE_TABLE
        assert (
            "the knots of the table 'map (argument 2)' go from -3 to 3, and its argument left them at 3" in run.message
        )
        cases = made.sweep((0, END), {**START, x.diff(): [0.3, 9.0]}, GIVEN, method=method, rtol=1e-9)
        assert list(cases.status) == [Status.SUCCESS, Status.OUTSIDE_TABLE]


def test_outputs_constraints_inputs_and_text():
    """A mass on a guide whose height is a surface over place and time; the force is one over place and an input."""
    u, t = dynamicsymbols("u"), dynamicsymbols._t
    P = O.locatenew("P", x * N.x + y * N.y)
    made = da.Scene("guide", frame=N, origin=O, coordinates=[x, y])
    made.add_bodies(Particle("mass", P, m))
    made.add_inputs(u)
    guide, force = surface("cubic").subs(y.diff(), t / 2), surface("linear").subs(y.diff(), u)
    made.add_loads((P, -force * N.x))
    made.add_holonomic_constraints(y - guide)
    compiled = da.compile_model(made, outputs={"height": guide, "force": force})
    run = compiled.simulate((0, 2), {x: 0.5, x.diff(): 0.1}, {m: 1}, inputs={u: da.samples([0, 2], [0, 2])}, rtol=1e-10)
    assert run.success
    spline, lines = RectBivariateSpline(*KNOTS, VALUES), RegularGridInterpolator(KNOTS, VALUES)
    np.testing.assert_allclose(run["y"], spline.ev(run["x"], run.t / 2), atol=1e-9)
    np.testing.assert_allclose(run["height"], run["y"], atol=1e-9)
    np.testing.assert_allclose(run["force"], lines((run["x"], np.minimum(run.t, 2))), atol=1e-12)
    program = compiled.stages.program
    assert str(Program.parse(str(program))) == str(program)
    with pytest.raises(ProgramTextError, match="a surface with the digest"):
        Program.parse(str(program).replace("  cells 9, 8", "  cells 8, 9", 1))
    rough = da.Scene("rough", frame=N, origin=O, coordinates=[x, y])
    rough.add_bodies(Particle("mass", P, m))
    rough.add_holonomic_constraints(y - surface("linear").subs(y.diff(), t))
    with pytest.raises(SceneError, match=r"the table 'map \(argument 1\)' has a slope that jumps"):
        da.compile_model(rough)


def test_the_text_of_a_program_has_the_axes_of_its_surfaces():
    """Also where a table with the same knots finds the piece, in a process that has not met the numbers."""
    made = scene("hold")
    made.add_loads((made.bodies[0].masscenter, da.table(y.diff(), KNOTS[1], KNOTS[1], "cubic") * N.y))
    text = str(da.compile_model(made).stages.program)
    read = f"from dalembert.ir.program import Program; text = {text!r}; assert str(Program.parse(text)) == text"
    subprocess.run([sys.executable, "-c", read], check=True)
    for axis in surface("hold").curve.axes:
        assert text.index(f"table {axis.key}") < text.index("surface ")


def test_values_may_be_parameters():
    corner = sp.Symbol("f")
    values = VALUES.tolist()
    values[5][3] = corner
    fitted = da.compile_model(scene("cubic", values=values))
    given = {**GIVEN, corner: VALUES[5, 3]}
    np.testing.assert_allclose(last(fitted.simulate((0, END), START, given, **TIGHT)), motion("cubic"), atol=1e-9)


def test_an_unreadable_grid_is_refused():
    for arguments, knots, values, error, message in (
        ((x, y, s), KNOTS, VALUES, ValueInputError, "3 arguments and 2 rows of knots; a surface has two of both"),
        ((x, y), KNOTS[0], VALUES, ValueInputError, "2 arguments and 8 rows of knots"),
        ((x, y), 3, VALUES, ValueInputError, "2 arguments and 0 rows of knots"),
        ((x, y), KNOTS, VALUES.T, ValueInputError, r"shape \(7, 8\), and the knots are 8 by 7; give one row of values"),
        ((x, y), KNOTS, [[1.0], [1.0, 2.0]], ValueInputError, "give one row of values for each knot"),
        ((x, "y"), KNOTS, VALUES, ExpressionError, "'y' is not a SymPy expression"),
        ((x, y), (KNOTS[0], KNOTS[1][::-1]), VALUES, ValueInputError, "the knots are not increasing"),
        ((x, y), (KNOTS[0], [0, 1, 2]), VALUES[:, :3], ValueInputError, "3 knots; 'cubic' needs 4"),
    ):
        with pytest.raises(error, match=message):
            da.table(arguments, knots, values, "cubic", name="map")
    beyond = da.Scene("beyond", frame=N, origin=O, coordinates=[x])
    beyond.add_bodies(Particle("mass", O.locatenew("P", x * N.x), m))
    beyond.add_loads((beyond.bodies[0].masscenter, surface("linear").subs(y.diff(), 4).doit() * N.x))
    with pytest.raises(SceneError, match=r"outside of the knots of the table 'map \(argument 2\)'"):
        da.compile_model(beyond)


def test_names_of_derivatives():
    made = surface("cubic")
    assert str(made.diff(x, y.diff())) == "map^(1,1)(x(t), Derivative(y(t), t))"
    assert sp.latex(made.diff(x)).startswith(r"map^{(1,0)}{\left(x")
    assert float(made.subs({x: 0.3, y.diff(): 0.4}).doit()) == pytest.approx(VALUES[4, 3])
    assert surface("linear").diff(x, 2) == 0
