"""Runs on the jax backend with the options of XLA that users have, where two programs are to round alike."""

from functools import cache

import numpy as np
import pytest

import dalembert as da
from dalembert.codegen import backend_named
from dalembert.methods.tableaus import KVAERNO5
from jax_backend.test_jax_backend import PROGRAMS, problem

jax = pytest.importorskip("jax")
diffrax = pytest.importorskip("diffrax")

from dalembert.jax.runs import solvers  # noqa: E402
from dalembert.jax.runs.precision import double_precision  # noqa: E402

methods = pytest.mark.parametrize("method", solvers.METHODS)


@cache
def engine():
    backend = backend_named("jax")
    return backend.load(backend.render(PROGRAMS["oscillator"]), cache=False)


def solve(method, **options):
    return engine().integrate(problem(**options), method)


@pytest.mark.matrix
@methods
def test_plain_diffrax_gives_the_same(method):
    times = np.linspace(0.0, 6.0, 23)
    run = solve(method, t_eval=times, first_step=0.01)
    share = solvers.IMPLICIT_SHARE if solvers.METHODS[method].implicit else 1.0
    with double_precision():
        plain = diffrax.diffeqsolve(
            diffrax.ODETerm(lambda t, y, k: jax.numpy.stack([y[1], k * jax.numpy.sin(t) - y[0]])),
            solvers.METHODS[method].solver,
            0.0,
            6.0,
            0.01,
            np.array([1.0, 0.5]),
            1.0,
            saveat=diffrax.SaveAt(ts=times),
            stepsize_controller=diffrax.PIDController(rtol=share * 1e-8, atol=share * 1e-10, pcoeff=0.2, icoeff=0.65),
        )
        np.testing.assert_allclose(run.y, plain.ys, rtol=1e-12, atol=1e-12)
        assert (run.steps, run.rejected) == (
            plain.stats["num_accepted_steps"],
            plain.stats["num_rejected_steps"],
        )


def test_the_implicit_pair_of_traced_runs_is_that_of_diffrax():
    own, other = KVAERNO5, diffrax.Kvaerno5().tableau
    for i, row in enumerate(other.a_lower):
        np.testing.assert_array_equal(own.A[i + 1, : i + 1], row)
    np.testing.assert_array_equal(np.diag(own.A), other.a_diagonal)
    np.testing.assert_allclose(own.c[1:], other.c, rtol=1e-15)
    np.testing.assert_allclose(own.b, other.b_sol, rtol=0, atol=1e-16)
    np.testing.assert_allclose(own.error[0] / 10.0, other.b_error, rtol=0, atol=1e-16)


@pytest.mark.matrix
@pytest.mark.parametrize("formulation", ["minimal", "projected"])
@pytest.mark.parametrize("method", ["dopri8", "tsit5", "kvaerno5"])
def test_traced_loops_agree_with_diffrax(method, formulation):
    """A sweep runs in the loop of our own, `simulate` by diffrax."""
    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax", formulation=formulation)
    start = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
    options = {"method": method, "rtol": 1e-9, "atol": 1e-11}
    alone = model.simulate((0, 2), start, {"m": 1, "b": 0.3, "I_C": 0.5}, **options)
    sweep = model.sweep((0, 2), start, {"m": 1, "b": [0.3, 0.4], "I_C": 0.5}, **options)
    assert alone.success and sweep.success.all()
    np.testing.assert_allclose([sweep[name][0] for name in ("x", "y", "theta")], alone.q[-1], rtol=0, atol=3e-8)
