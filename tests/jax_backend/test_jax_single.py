"""Traced runs in a process of single precision: its numbers all through, its tolerances, and what it refuses."""

import warnings
from functools import cache, partial

import numpy as np
import pytest
from sympy import Piecewise
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from analysis.test_sensitivity import MOTIONS
from dalembert.errors import OptionError, PrecisionWarning
from dalembert.methods.status import Status
from starts.test_input_values import forced

jax = pytest.importorskip("jax")

pytestmark = pytest.mark.usefixtures("quick_xla")
jnp = jax.numpy

T = np.array([0.0, 0.5, 1.0])
QUICK = {"xla_backend_optimization_level": 0}
PARAMETERS, INITIAL, OUTPUTS = MOTIONS["chaplygin_sleigh"]


@pytest.fixture(autouse=True)
def single():
    with jax.enable_x64(False):
        yield


@cache
def sleigh(formulation="minimal", force=0.0, backend="jax"):
    scene = da.scenes.chaplygin_sleigh()
    if force:
        scene.add_loads((scene.bodies[0].masscenter, force * scene.frame.x))
    return da.compile_model(scene, backend=backend, formulation=formulation, outputs=[] if force else list(OUTPUTS))


def exact(formulation="minimal", force=0.0):
    """Return the motion at the times T by the compiled backend."""
    model = sleigh(formulation, force, "llvm")
    return model.simulate((0.0, 1.0), INITIAL, PARAMETERS, t_eval=T, rtol=1e-11)


@pytest.mark.parametrize(
    ("formulation", "method"), [("minimal", "tsit5"), ("projected", "dopri8"), ("minimal", "taylor")]
)
def test_everything_is_single_and_meets_the_tolerances(formulation, method):
    model = sleigh(formulation)
    solve = model.solve_fn(INITIAL, method=method)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = solve(T, INITIAL, PARAMETERS)
    assert int(found.status) == Status.SUCCESS
    assert {leaf.dtype.name for leaf in found[:5]} == {"float32"}
    code = str(jax.make_jaxpr(lambda p: solve(T, INITIAL, p).y)(PARAMETERS))
    assert "f64" not in code and "i64" not in code
    run = exact(formulation)
    np.testing.assert_allclose(found.y, run.y, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(found.outputs[:, 0], run["X"], rtol=1e-4, atol=1e-4)


def test_gradients_alone_and_in_batches():
    model = sleigh()
    y, p = model.state(INITIAL, PARAMETERS), model.parameter_vector(PARAMETERS)
    found = {}
    for double in (False, True):
        with jax.enable_x64(double):
            solve = model.solve_fn(method="tsit5")
            gradient = jax.grad(lambda y, p, solve=solve: jnp.cos(solve(T[[0, 2]], y, p).y).sum(), argnums=(0, 1))
            rows = jax.jit(jax.vmap(gradient, (0, None)))(jnp.asarray([y, 1.1 * y]), jnp.asarray(p))
            found[double] = jax.tree.map(np.asarray, rows)
    for one, other in zip(found[False], found[True], strict=True):
        assert one.dtype == np.float32 and other.dtype == np.float64
        np.testing.assert_allclose(one, other, rtol=2e-5, atol=2e-5)


def test_steps_end_where_conditions_on_time_change():
    t = dynamicsymbols._t
    force = Piecewise((3.0, (t > 0.2) & (t < 0.7)), (0.0, True))
    found = sleigh(force=force).solve_fn(INITIAL, method="tsit5")(T, INITIAL, PARAMETERS)
    run = exact(force=force)
    assert int(found.status) == Status.SUCCESS
    np.testing.assert_allclose(found.y, run.y, rtol=1e-5, atol=1e-5)


@pytest.mark.matrix
def test_inputs_are_followed_and_differentiated():
    """Samples and a function; double precision has the reference."""
    model, p = da.compile_model(forced(), backend="jax"), {"m": 0.8, "k": 2.0}
    knots, values, start = np.array([0.0, 0.31, 0.5, 1.0]), np.array([0.4, -1.1, 0.7, 1.6]), [0.2, -0.1]

    def found(values, p, solve):
        run = solve(T, start, p, inputs={"u": da.samples(knots, values)})
        drag = solve(T, start, p, inputs={"u": da.feedback(lambda t, q, qdot, c: -c * qdot[0] * t, p["k"])})
        return jnp.concatenate([run.y.ravel(), run.outputs.ravel(), drag.y.ravel()])

    rows = {}
    for double in (False, True):
        with jax.enable_x64(double):
            ends = partial(found, solve=model.solve_fn(method="tsit5"))
            along = jax.jit(lambda *at, f=ends: jax.jvp(f, at, at), compiler_options=QUICK)
            rows[double] = along(jnp.asarray(values), jax.tree.map(jnp.asarray, p))
    for one, other in zip(rows[False], rows[True], strict=True):
        assert one.dtype == np.float32
        np.testing.assert_allclose(one, other, rtol=2e-5, atol=2e-5)
    late = {"u": da.samples(knots + 1e4, values)}
    with pytest.warns(PrecisionWarning, match=r"rounds the knots of input 'u' by up to 0\.0006 s.*0\.2 s apart"):
        jax.make_jaxpr(lambda t: model.solve_fn(method="tsit5")(t, start, p, inputs=late).y)(T + 1e4)


def test_projection_of_a_state():
    model = sleigh("projected")
    y, p = (jnp.asarray(v) for v in (model.state(INITIAL, PARAMETERS), model.parameter_vector(PARAMETERS)))
    held = model.functions.project(0.0, y + 1e-3, p)
    assert held.dtype == np.float32 and np.isfinite(held).all()


def test_tolerances_out_of_reach_are_told_and_not_tried():
    model = sleigh()
    small = model.solve_fn(INITIAL, method="tsit5", rtol=1e-12, atol=1e-12)
    with pytest.warns(PrecisionWarning, match=r"rtol = 1e-12 and atol = 1e-12 .*takes rtol = 1e-06 and atol = 1e-08"):
        found = small(T, INITIAL, PARAMETERS)
    assert int(found.status) == Status.SUCCESS
    same = model.solve_fn(INITIAL, method="tsit5", rtol=1e-6, atol=1e-8)(T, INITIAL, PARAMETERS)
    np.testing.assert_array_equal(found.y, same.y)


def test_what_single_precision_does_not_serve_is_refused():
    x = dynamicsymbols("x")
    table = da.table(x, [-5.0, 0.0, 5.0], [1.0, 0.0, -1.0], kind="linear", extrapolate="hold")
    refused = {1e-13 * x: r"1e-13 in .*minimal.*jax_enable_x64", table: "tables take steps to knots.*jax_enable_x64"}
    for force, message in refused.items():
        with pytest.raises(OptionError, match=message):
            sleigh(force=force).solve_fn(INITIAL)(T, INITIAL, PARAMETERS)
    stiff = sleigh(force=-(abs(x) ** 1.5)).solve_fn(INITIAL, method="taylor")
    with pytest.raises(OptionError, match='take method="dopri8" or "tsit5"'):
        stiff(T, INITIAL, PARAMETERS)
    with pytest.raises(OptionError, match="rtol must be finite and not negative"):
        sleigh().solve_fn(rtol=-1.0)
