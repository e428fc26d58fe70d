"""Functions as inputs of traced runs: laws of force, networks, and their derivatives."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.errors import OptionError
from jax_backend.jax_options import QUICK
from jax_backend.test_jax_inputs import KNOTS, PARAMETERS, START, VALUES, compiled, differences, double, solve_fn
from starts.test_input_values import driven

jax = pytest.importorskip("jax")
pytest.importorskip("diffrax")

pytestmark = pytest.mark.usefixtures("quick_xla")
jnp = jax.numpy

__all__ = ["double"]  # a fixture

T = np.array([0.2, 0.9, 1.7])
THETA = {"w": np.array([[0.3, -0.8], [1.1, 0.4], [-0.5, 0.7]]), "v": np.array([0.9, -0.6, 0.4]), "bias": 0.2}


def damping(t, q, qdot, d):
    return -d * qdot[0]


def damped(t, d):
    """Return the motion of a damped oscillator from START, known."""
    m, k = PARAMETERS["m"], PARAMETERS["k"]
    rate, x0, v0 = d / (2.0 * m), START["x"], START["x_dot"]
    w, s = np.sqrt(k / m - rate**2), t - t[0]
    return np.exp(-rate * s) * (x0 * np.cos(w * s) + (v0 + rate * x0) / w * np.sin(w * s))


def network(t, q, qdot, theta):
    return theta["v"] @ jnp.tanh(theta["w"] @ jnp.concatenate([q, qdot])) + theta["bias"] * jnp.sin(t)


def force(t, q, qdot):
    return network(t, q, qdot, THETA)


def test_a_law_of_force_is_that_of_the_known_motion():
    solve = solve_fn("dopri8")

    def run(d):
        return solve(T, START, PARAMETERS, inputs={"u": da.feedback(damping, d)})

    def everything(d):
        return run(d), jax.jacfwd(lambda d: run(d).q[:, 0])(d)

    found, slope = jax.jit(everything, compiler_options=QUICK)(0.4)
    assert found.status == 0
    np.testing.assert_allclose(found.q[:, 0], damped(T, 0.4), rtol=1e-9)
    np.testing.assert_allclose(found.outputs[:, 0], -0.4 * found.qdot[:, 0], rtol=1e-12)
    np.testing.assert_allclose(slope, (damped(T, 0.4 + 1e-5) - damped(T, 0.4 - 1e-5)) / 2e-5, rtol=1e-6, atol=1e-8)


def last(theta, solve=None, start=START, t=T):
    run = (solve or solve_fn("tsit5"))(t, start, PARAMETERS, inputs={"u": da.feedback(network, theta)})
    return jnp.sum(run.q[-1] + run.outputs[1])


def test_gradients_by_weights_start_and_times_in_batches():
    flat, whole = jax.flatten_util.ravel_pytree(THETA)
    both = jax.value_and_grad(lambda theta, x, t: last(whole(theta), start={**START, "x": x}, t=t), (0, 1, 2))
    batch = jax.jit(jax.vmap(both, (0, None, None)), compiler_options=QUICK)
    found = batch(np.stack([0.5 * flat, flat]), START["x"], T)[1]
    by_theta, by_x, by_t = jax.tree.map(lambda rows: rows[1], found)

    def value(theta, x, t):
        return batch(np.stack([theta, theta]), x, t)[0][1]

    want = differences(lambda theta: np.asarray(value(theta, START["x"], T)), np.asarray(flat))
    np.testing.assert_allclose(by_theta, want, rtol=1e-6, atol=1e-8)
    want = differences(lambda x: np.asarray(value(flat, x[0], T)), np.array([START["x"]]))
    np.testing.assert_allclose(by_x, want[0], rtol=1e-6)
    np.testing.assert_allclose(by_t, differences(lambda t: np.asarray(value(flat, START["x"], t)), T), rtol=1e-6)


@pytest.mark.matrix
def test_functions_may_close_over_what_is_differentiated_and_stand_beside_samples():
    start, p = {"theta": 0.3, "theta_dot": -0.2}, {"m": 1.1, "ell": 0.7, "g": 9.81}
    solve, road = solve_fn("tsit5", driven, tuple(start)), da.samples(KNOTS, VALUES / 4.0, "cubic")

    def end(theta):
        given = {"u": road, "v": lambda t, q, qdot: network(t, q, qdot, theta)}
        return solve(T[[0, 2]], start, p, inputs=given).q[-1, 0]

    closed = jax.jit(jax.value_and_grad(end), compiler_options=QUICK)
    gradient = closed(THETA)[1]
    ahead, behind = (closed({**THETA, "bias": 0.2 + h})[0] for h in (1e-5, -1e-5))
    np.testing.assert_allclose(gradient["bias"], (ahead - behind) / 2e-5, rtol=1e-6)


@pytest.mark.matrix
def test_rules_of_users_are_respected():
    solve = solve_fn("tsit5")

    @jax.custom_jvp
    def pushed(x):
        return x**2

    @pushed.defjvp
    def _(values, tangents):
        return pushed(*values), 3.0 * values[0] * tangents[0]

    @jax.custom_vjp
    def pulled(x):
        return x**2

    pulled.defvjp(lambda x: (x**2, x), lambda x, given: (3.0 * x * given,))

    def law(square):
        return lambda t, q, qdot, d: -square(d) * qdot[0]

    def slope(square, transform):
        def run(d):
            return solve(T[:2], START, PARAMETERS, inputs={"u": da.feedback(law(square), d)}).q[-1, 0]

        return float(jax.jit(transform(run), compiler_options=QUICK)(0.6))

    size = 1e-5
    plain = 2.0 * 0.6 * (damped(T[:2], 0.36 + size) - damped(T[:2], 0.36 - size))[-1] / (2.0 * size)
    for square, transform, factor in (
        (lambda d: 0.25 * jax.lax.stop_gradient(d) * d + 0.75 * pushed(d), jax.grad, 1.25),
        (pulled, jax.grad, 1.5),
        (pulled, jax.jacfwd, 1.5),
    ):
        assert slope(square, transform) == pytest.approx(factor * plain, rel=1e-6)


@pytest.mark.matrix
def test_a_module_of_equinox_is_a_function_and_a_tree_of_weights():
    equinox = pytest.importorskip("equinox")

    class Law(equinox.Module):
        mlp: equinox.nn.MLP

        def __call__(self, t, q, qdot):
            return self.mlp(jnp.concatenate([q, qdot]))

    law = Law(equinox.nn.MLP(2, "scalar", 4, 1, activation=jnp.tanh, key=jax.random.key(0)))
    solve = solve_fn("tsit5")

    def end(law):
        return solve(T[:2], START, PARAMETERS, inputs={"u": law}).q[-1, 0]

    gradient = equinox.filter_grad(end)(law)

    def where(law):
        return law.mlp.layers[1].bias

    ahead, behind = (end(equinox.tree_at(where, law, where(law) + h)) for h in (1e-5, -1e-5))
    np.testing.assert_allclose(where(gradient), (ahead - behind) / 2e-5, rtol=1e-6)


def test_what_is_wrong_with_functions_is_named():
    solve, start = solve_fn("tsit5"), {"theta": 0.3, "theta_dot": -0.2}

    def run(law, function=solve):
        return function(T, START, PARAMETERS, inputs={"u": law})

    for law, message in (
        (lambda t, q: 0.0, r"called as \(t, q, qdot, theta\).*does not take that: too many"),
        (network, "does not take that: missing a required argument: 'theta'"),
        (lambda t, q, qdot: qdot, r"must return one real number, of shape \(\), not shape \(1,\)"),
        (lambda t, q, qdot: None, "must return one real number"),
        (da.feedback(network, {**THETA, "extra": [{1, 2}]}), "neither an array nor constant"),
    ):
        with pytest.raises(OptionError, match=message):
            run(law)
    for method in ("taylor", "kvaerno5"):
        with pytest.raises(OptionError, match=f"'{method}' needs more of input 'u' than the values"):
            run(force, solve_fn(method))
    with pytest.raises(OptionError, match="dense output does not know the function of input 'u'"):
        run(force, solve_fn("tsit5", dense=True))
    with pytest.raises(OptionError, match="input 'u' cannot be a function of the state"):
        solve_fn("tsit5", driven, tuple(start))(T, start, {"m": 1, "ell": 1, "g": 1}, inputs={"u": force, "v": 0.0})
    with pytest.raises(OptionError, match="the function of input 'u' is called as f"):
        compiled(backend="llvm").simulate((0, 1), START, PARAMETERS, inputs={"u": force})
    with pytest.raises(OptionError, match="feedback takes a function"):
        da.feedback(3.0)


@pytest.mark.matrix
def test_functions_beside_forces_that_change_at_a_time():
    (x, u), (m, F) = dynamicsymbols("x u"), sp.symbols("m F")
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", x * N.x)
    scene = da.Scene("pushed", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("mass", P, m))
    scene.add_inputs(u)
    scene.add_loads((P, (u + sp.Piecewise((F, dynamicsymbols._t < 0.6), (0, True))) * N.x))
    solve = da.compile_model(scene, backend="jax").solve_fn(("x", "x_dot"), method="tsit5", rtol=1e-9, atol=1e-12)

    def end(d, push):
        given = {"u": da.feedback(damping, d)}
        run = solve(np.array([0.0, 1.5]), {"x": 0.0, "x_dot": 0.0}, {"m": 1.0, "F": push}, inputs=given)
        return run.q[-1, 0]

    def known(d, push):
        return push / d * (0.6 - np.exp(-d * 0.9) * (1.0 - np.exp(-d * 0.6)) / d)

    assert jax.jit(end, compiler_options=QUICK)(0.4, 2.0) == pytest.approx(known(0.4, 2.0), rel=1e-8)
    slope = jax.jit(jax.vmap(jax.grad(end), (None, 0)), compiler_options=QUICK)(0.4, np.array([1.0, 2.0]))
    want = (known(0.4 + 1e-5, 2.0) - known(0.4 - 1e-5, 2.0)) / 2e-5
    np.testing.assert_allclose(slope, [want / 2.0, want], rtol=1e-6)
