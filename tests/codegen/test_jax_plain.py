"""Runs on the jax backend with the options of XLA that users have, where two programs are to round alike."""

from functools import cache

import numpy as np
import pytest

from codegen.test_jax_backend import PROGRAMS, problem
from dalembert.codegen import backend_named
from dalembert.methods.tableaus import KVAERNO5

jax = pytest.importorskip("jax")
diffrax = pytest.importorskip("diffrax")

from dalembert.codegen.jax.pieces import PAIRS  # noqa: E402

methods = pytest.mark.parametrize("method", PAIRS)


@cache
def engine():
    backend = backend_named("jax")
    return backend.load(backend.render(PROGRAMS["oscillator"]), cache=False)


def solve(method, **options):
    return engine().integrate(problem(**options), method)


def test_the_implicit_pair_is_that_of_diffrax():
    own, other = KVAERNO5, diffrax.Kvaerno5().tableau
    for i, row in enumerate(other.a_lower):
        np.testing.assert_array_equal(own.A[i + 1, : i + 1], row)
    np.testing.assert_array_equal(np.diag(own.A), other.a_diagonal)
    np.testing.assert_allclose(own.c[1:], other.c, rtol=1e-15)
    np.testing.assert_allclose(own.b, other.b_sol, rtol=0, atol=1e-16)
    np.testing.assert_allclose(own.error[0] / 10.0, other.b_error, rtol=0, atol=1e-16)


@methods
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_steps_dense_output_and_t_eval_agree(method, sign):
    options = {"t1": sign * 6.0}
    run = solve(method, dense=True, **options)
    assert run.success and run.t[0] == 0.0 and run.t[-1] == options["t1"]
    assert len(run.t) == run.steps + 1 and (sign * np.diff(run.t) > 0.0).all()
    np.testing.assert_allclose(run.dense(run.t), run.y, rtol=1e-13, atol=1e-14)
    times = np.unique(np.concatenate([run.t, np.linspace(0.0, options["t1"], 57)]))[:: int(sign)]
    sampled = solve(method, t_eval=times, **options)
    np.testing.assert_array_equal(sampled.t, times)
    np.testing.assert_allclose(sampled.y, run.dense(times), rtol=1e-13, atol=1e-14)
    np.testing.assert_array_equal(sampled.y[np.isin(times, run.t)], run.y)
    assert (sampled.steps, sampled.rejected) == (run.steps, run.rejected)
    exact = solve(method, t_eval=times, rtol=1e-13, atol=1e-14, **options)
    np.testing.assert_allclose(run.dense(times), exact.y, rtol=0, atol=1e-6)
