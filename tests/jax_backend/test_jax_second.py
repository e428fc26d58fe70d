"""Second derivatives of traced runs: all ways to nest first ones, by everything that is given together."""

import re

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from analysis.test_sensitivity import MOTIONS
from dalembert.errors import CapabilityError
from jax_backend.jax_options import QUICK

jax = pytest.importorskip("jax")

pytestmark = pytest.mark.usefixtures("quick_xla")

OPTIONS = {"method": "tsit5", "rtol": 1e-10, "atol": 1e-12, "max_step": 0.02, "max_steps": 64}
STEP = 1e-4


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


def value_of(model, given, sizes):
    """Return a function of parameters, given values and times side by side; these are the numbers of each."""
    solve = model.solve_fn(given, **OPTIONS)

    def value(z):
        p, initial, times = jax.numpy.split(z, np.cumsum(sizes)[:-1])
        motion = solve(times, initial, dict(zip(model.layout.given, p, strict=True)))
        rows = jax.numpy.concatenate([motion.q, motion.qdot, motion.outputs], axis=1)
        return (jax.numpy.cos(1.0 + jax.numpy.arange(rows.size).reshape(rows.shape)) * rows).sum()

    return value


def difference(gradient, at, direction):
    """Return the change of a gradient in a direction."""
    values = [np.array(gradient(at + k * STEP * direction)) for k in (-2, -1, 1, 2)]
    return (values[0] - 8.0 * values[1] + 8.0 * values[2] - values[3]) / (12.0 * STEP)


@pytest.mark.parametrize(
    "scene", [pytest.param(name, marks=[] if name == "chaplygin_sleigh" else [pytest.mark.matrix]) for name in MOTIONS]
)
def test_products_with_hessians(scene):
    """By parameters, initial values and times together: the start, one within, the end."""
    parameters, initial, outputs = MOTIONS[scene]
    model = da.compile_model(getattr(da.scenes, scene)(), backend="jax", outputs=list(outputs))
    given = [parameters[name] for name in model.layout.given]
    at = np.concatenate([given, list(initial.values()), [0.1, 0.2, 0.4]])
    value = value_of(model, initial, (len(given), len(initial), 3))
    pair = jax.jit(lambda z, v: jax.jvp(jax.grad(value), (z,), (v,)), compiler_options=QUICK)
    direction = np.sin(1.0 + np.arange(len(at)))
    expected = difference(lambda z: pair(z, direction)[0], at, direction)
    np.testing.assert_allclose(pair(at, direction)[1], expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def on_a_spring(factor):
    """Return a number of a motion on a hard spring, whose force has a factor, and a point; see `value_of`."""
    k, m, x = *sp.symbols("k m", positive=True), dynamicsymbols("x")
    N, O = ReferenceFrame("N"), Point("O")
    scene = da.Scene("on a spring", frame=N, origin=O, coordinates=[x])
    mass = O.locatenew("mass", x * N.x)
    scene.add_bodies(Particle("body", mass, m))
    scene.add_loads((mass, -k * x**3 * factor * N.x))
    value = value_of(da.compile_model(scene, backend="jax"), ("x", "x_dot"), (2, 2, 2))
    return value, np.array([1.3, 0.7, 0.8, 0.4, 0.2, 0.9])


def test_a_product_with_a_hessian():
    """By parameters, initial values and times together, forward over reverse mode."""
    value, at = on_a_spring(1)
    pair = jax.jit(lambda z, v: jax.jvp(jax.grad(value), (z,), (v,)), compiler_options=QUICK)
    direction = np.sin(1.0 + np.arange(len(at)))
    expected = difference(lambda z: pair(z, direction)[0], at, direction)
    np.testing.assert_allclose(pair(at, direction)[1], expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@pytest.fixture(scope="module")
def switched():
    """A spring whose force stops at half a second: steps end there, wherever runs start."""
    t = dynamicsymbols._t
    with jax.enable_x64(True):
        value, at = on_a_spring(sp.Piecewise((1 + t, t < sp.Rational(1, 2)), (2, True)))
        gradient = jax.jit(jax.grad(value), compiler_options=QUICK)
        return value, at, np.array([difference(gradient, at, unit) for unit in np.eye(len(at))])


@pytest.mark.parametrize(
    "hessian",
    [jax.hessian, lambda f: jax.jacfwd(jax.jacfwd(f)), lambda f: jax.jacrev(jax.jacfwd(f))],
    ids=["hessian", "forward twice", "reverse of forward"],
)
def test_all_ways_to_nest_derivatives_over_a_break(switched, hessian):
    value, at, expected = switched
    found = jax.jit(hessian(value), compiler_options=QUICK)(at)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def test_products_with_hessians_in_batches(switched):
    """Cases with points and directions of their own; one that runs out of steps is NaN, and it alone."""
    value, at, expected = switched

    def product(z, v):
        return jax.jvp(jax.grad(value), (z,), (v,))[1]

    directions = np.cos(np.arange(18.0)).reshape(3, 6)
    long = at + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 90.0])
    found = np.array(jax.jit(jax.vmap(product), compiler_options=QUICK)(np.stack([at, long, at]), directions))
    assert np.isnan(found[1]).all()
    np.testing.assert_allclose(found[::2], directions[::2] @ expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("batched", [False, True])
def test_programs_in_which_jax_drops_rules_are_refused(batched):
    """Forward over reverse, older releases differentiate `jax.lax.scan` without the rules of what is inside."""
    parameters, initial, _ = MOTIONS["chaplygin_sleigh"]
    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax")
    solve, times, p = model.solve_fn(**OPTIONS), np.array([0.0, 0.1]), model.parameter_vector(parameters)

    def end(y, p):
        return jax.vmap(lambda y: solve(times, y, p).y[-1])(y[None])[0] if batched else solve(times, y, p).y[-1]

    def chained(p):
        y = jax.numpy.asarray(model.state(initial, parameters))
        return jax.lax.scan(lambda y, _: (end(y, p), None), y, length=3)[0][0]

    try:
        found = jax.hessian(chained)(p)
    except CapabilityError as error:
        assert re.search(r"jax.lax.scan or jax.lax.map .* Use jax.jacrev\(jax.jacfwd", str(error))
    else:  # JAX 0.12 keeps them
        np.testing.assert_allclose(found, jax.jacrev(jax.jacfwd(chained))(p), rtol=1e-9, atol=1e-12)
