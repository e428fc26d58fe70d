"""Recomputed and continuous adjoints of runs whose constants change: inputs, functions, conditions on time."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import sympy as sp

import dalembert as da
from codegen.test_jax_feedback import THETA, network
from codegen.test_jax_inputs import KNOTS, PARAMETERS, QUICK, START, VALUES, compiled, differences, double, expected
from codegen.test_jax_jumps import AT, D, F, T, pushed, t, w, x

jax = pytest.importorskip("jax")
started = pytest.importorskip("dalembert.integrators.jax.starts").started

pytestmark = pytest.mark.usefixtures("quick_xla")
jnp = jax.numpy

__all__ = ["double"]  # a fixture

OTHERS = ("recomputed", "continuous")
TIGHT = {"rtol": 1e-10, "atol": 1e-12, "max_steps": 512}


def compare(motion, *at, also=(), adjoints=OTHERS):
    """Return the recorded gradients of a function of an adjoint and of arguments, to which others are compared.

    Arguments `also` stand behind, and are not differentiated; there is a result for each of them.
    """
    every, results = tuple(range(len(at))), {}
    for adjoint in ("recorded", *adjoints):
        own = jax.jit(jax.grad(partial(motion, adjoint), every), compiler_options=QUICK)
        results[adjoint] = [own(*at, more) for more in also] or own(*at)
    for adjoint in adjoints:
        pairs = zip(jax.tree.leaves(results[adjoint]), jax.tree.leaves(results["recorded"]), strict=True)
        for one, other in pairs:
            np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-8)
    return results["recorded"]


def test_gradients_by_values_of_held_records_in_a_batch_backward_in_time():
    times = np.array([1.9, 1.4, 0.7, 0.1])
    weights = np.array([0.3, 1.0, -0.7, 0.5])

    def one(solve, values, mass):
        run = solve(times, START, {"m": mass, "k": 2.0}, inputs={"u": da.samples(KNOTS, values, "hold")})
        return weights @ run.q[:, 0] + run.outputs[-1, 0]

    def total(adjoint, values, mass):
        solve = compiled().solve_fn(tuple(START), method="tsit5", adjoint=adjoint, **TIGHT)
        return jnp.sum(jax.vmap(lambda values: one(solve, values, mass))(values))

    values = np.stack([VALUES, np.roll(VALUES, 1)])
    by_values, by_mass = compare(total, values, PARAMETERS["m"])

    def known(values, m=PARAMETERS["m"]):
        found = expected(times, {"u": da.samples(KNOTS, values, "hold")}, p={"m": m, "k": 2.0})
        return weights @ found[:, 0] + found[-1, 2]

    for row, own in zip(by_values, values, strict=True):
        np.testing.assert_allclose(row, differences(known, own), rtol=1e-6, atol=1e-7)
    want = sum(differences(lambda m, v=v: known(v, m[0]), np.array([PARAMETERS["m"]]))[0] for v in values)
    np.testing.assert_allclose(by_mass, want, rtol=1e-6)


def test_gradients_by_weights_of_a_function():
    def last(adjoint, theta, x):
        solve = compiled().solve_fn(tuple(START), method="dopri8", adjoint=adjoint, **TIGHT)
        inputs = {"u": da.feedback(network, theta)}
        return jnp.sum(solve([0.2, 1.7], {**START, "x": x}, PARAMETERS, inputs=inputs).q ** 2)

    by_theta = compare(last, THETA, START["x"])[0]
    flat, whole = jax.flatten_util.ravel_pytree(THETA)
    value = jax.jit(lambda theta: last("recorded", whole(theta), START["x"]), compiler_options=QUICK)
    want = differences(lambda theta: np.asarray(value(theta)), np.asarray(flat))
    np.testing.assert_allclose(jax.flatten_util.ravel_pytree(by_theta)[0], want, rtol=1e-6, atol=1e-8)


def test_conditions_on_time_that_parameters_move():
    """Behind a jump, derivatives by what moves it are NaN, as recorded ones are; a kink is no harm."""
    pulse = sp.Heaviside(t - T) - sp.Heaviside(t - T - D)
    model = pushed(F * pulse + sp.Piecewise((0, t < w), (t - w, True)) - 4 * x)
    p, times = {"F": 2.0, "T": 1.0, "D": 0.1, "w": 0.8}, np.array([0.0, 0.5, 0.9, 1.05, 1.5])

    def sums(adjoint, t, y, p, last):
        run = model.solve_fn(adjoint=adjoint, method="tsit5", **TIGHT)(t, y, p)
        return jnp.sum(jnp.where(jnp.arange(len(t)) <= last, run.q[:, 0], 0.0) ** 2)

    before, after = compare(sums, times, AT, p, also=(2, 4))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves((before, after[:2], after[2]["F"])))
    assert all(np.isnan(after[2][name]) for name in ("T", "D", "w"))


def test_cases_that_differ_in_constants_alone_have_starts_that_move():
    """JAX took the start for one of all cases, and its change for one of each."""

    def end(t, c):
        return started(lambda t, y, c: c * y, jnp.array([2.0]), t, c)[0]

    cases = jnp.array([[0.5], [-1.0]])
    found = jax.jit(jax.grad(lambda t: jnp.array([1.0, 3.0]) @ jax.vmap(end, (None, 0))(t, cases)))(0.0)
    np.testing.assert_allclose(found, -2.0 * (0.5 - 3.0), rtol=1e-14)
