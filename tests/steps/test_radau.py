"""Radau IIA: its coefficients, its orders, stiff problems with known solutions, and both ways to its Jacobian."""

import math

import numpy as np
import pytest

from dalembert.codegen.llvm.loops import loop_named
from dalembert.codegen.numpy import solvers
from dalembert.codegen.numpy.methods import IMPLICIT
from dalembert.methods import collocation as radau
from dalembert.methods.status import Status
from dalembert.steps import implicit_loop as implicit
from dalembert.steps.problem import IntegrationProblem
from dalembert.steps.recorded_runs import RunCodes
from steps.integrator_cases import MIXED_START, machine_code, mixed, mixed_solution, solve

VAN_DER_POL_START = np.array([2.0, 0.0])
VAN_DER_POL_END = np.array([1.706167732170483, -0.8928097010247975])
"""At t = 2, for a stiffness of 1e-6 (test set for IVP solvers)."""


def van_der_pol(t, y, c, out):
    out[0] = y[1]
    out[1] = ((1.0 - y[0] * y[0]) * y[1] - y[0]) / c[0]


def oscillator(t, y, c, out):
    """Linear with constant coefficients, so that Newton's first step is exact; y = sin t and a forced one."""
    out[0] = y[1]
    out[1] = -y[0]
    out[2] = -2.0 * y[2] + math.exp(-t)


def oscillator_solution(t):
    t = np.asarray(t)
    return np.stack([np.sin(t), np.cos(t), np.exp(-t)], axis=-1)


def prothero_robinson(t, y, c, out):
    """y = sin t, however stiff c[0] makes it."""
    out[0] = -c[0] * (y[0] - math.sin(t)) + math.cos(t)


def belt(t, y, c, out):
    """A block on a belt, by a friction of tanh."""
    out[0] = y[1]
    out[1] = c[0] * math.tanh((0.5 - y[1]) / 1e-3) - 10.0 * y[0]


def gliding_belt(t, y, c, out):
    """A block on a belt, by a friction that bends less sharply."""
    slip = y[1] - 0.2
    out[0] = y[1]
    out[1] = -c[0] * slip / math.sqrt(slip * slip + 1e-6) - 4.0 * y[0]


def decay(t, y, c, out):
    for i in range(len(y)):
        out[i] = -c[i] * y[i]


def test_transformation_diagonalises_the_inverse_of_the_method():
    a, b = radau.COMPLEX.real, -radau.COMPLEX.imag
    blocks = np.array([[radau.REAL, 0, 0], [0, a, b], [0, -b, a]])
    product = radau.FROM_MODES @ blocks @ radau.TO_MODES @ radau.METHOD
    np.testing.assert_allclose(product, np.eye(3), atol=1e-13)


def test_quadrature_is_exact_up_to_degree_four_and_the_estimate_up_to_three():
    weights = radau.METHOD[2]
    for degree in range(5):
        assert weights @ radau.NODES**degree == pytest.approx(1 / (degree + 1), abs=1e-15)
    assert abs(weights @ radau.NODES**5 - 1 / 6) > 1e-4
    estimate = [radau.ERROR_WEIGHTS @ radau.NODES**degree for degree in (1, 2, 3)]
    np.testing.assert_allclose(estimate, [-1, 0, 0], atol=1e-13)


def test_slope_at_the_end_is_exact_up_to_degree_three():
    for degree in range(1, 4):
        assert radau.END_SLOPES @ radau.NODES**degree == pytest.approx(degree, abs=1e-13)


def test_order():
    counts = np.array([10, 14, 20, 28])
    errors = []
    for n in counts:
        h = 2.0 / n * (1 + 1e-12)
        start = oscillator_solution(0.0)
        run = solve("llvm-radau", oscillator, start, t0=0.0, t1=2.0, first_step=h, max_step=h, rtol=1e6, atol=1e6)
        assert run.steps == n
        errors.append(np.abs(run.y[-1] - oscillator_solution(2.0)).max())
    assert np.polyfit(np.log(2.0 / counts), np.log(errors), 1)[0] == pytest.approx(5, abs=0.2)


def test_order_of_dense_output():
    sizes, errors = np.array([0.05, 0.1, 0.2]), []
    for h in sizes:
        start = oscillator_solution(1.0)
        run = solve("llvm-radau", oscillator, start, t0=1.0, t1=1.0 + h, first_step=h, rtol=1e6, atol=1e6, dense=True)
        assert run.steps == 1
        times = np.linspace(1.0, 1.0 + h, 41)
        errors.append(np.abs(run.dense(times) - oscillator_solution(times)).max())
    assert np.polyfit(np.log(sizes), np.log(errors), 1)[0] == pytest.approx(4, abs=0.2)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8, 1e-10])
def test_van_der_pol(tolerance):
    options = {"t0": 0.0, "t1": 2.0, "constants": np.array([1e-6]), "rtol": tolerance, "atol": tolerance}
    run = solve("llvm-radau", van_der_pol, VAN_DER_POL_START, **options, max_steps=10**5)
    assert run.success
    np.testing.assert_allclose(run.y[-1], VAN_DER_POL_END, atol=max(50 * tolerance, 1e-9))
    if tolerance == 1e-6:
        peer = solve("scipy-radau", van_der_pol, VAN_DER_POL_START, **options)
        assert run.steps <= 1.2 * peer.steps


@pytest.mark.parametrize(
    ("rhs", "frictions", "rtol"),
    [(belt, (1.96, 5.89), 1e-3), (belt, (1.96, 5.89), 1e-4), (gliding_belt, (1.0, 5.0), 1e-3)],
)
def test_blocks_that_leave_a_belt(rhs, frictions, rtol):
    """Sticking is stiff and slipping is not: steps that pass from one to the other must not end before Newton does."""
    for friction in np.linspace(*frictions, 32):
        options = {"t0": 0.0, "t1": 10.0, "constants": np.array([friction])}
        run, exact = (solve("llvm-radau", rhs, np.zeros(2), **options, rtol=r, atol=r / 100) for r in (rtol, 1e-9))
        assert run.success and exact.success
        np.testing.assert_allclose(run.y[-1], exact.y[-1], atol=10 * rtol)


@pytest.mark.parametrize("stiffness", [1e2, 1e5, 1e8])
def test_stiff_relaxation_towards_a_smooth_solution_takes_few_steps(stiffness):
    options = {"t0": 0.0, "t1": 10.0, "constants": np.array([stiffness]), "rtol": 1e-6, "atol": 1e-8, "dense": True}
    run = solve("llvm-radau", prothero_robinson, [0.5], **options)
    assert run.success and run.steps < 300
    times = np.linspace(1.0, 10.0, 50)
    np.testing.assert_allclose(run.dense(times)[:, 0], np.sin(times), atol=2e-5)
    np.testing.assert_allclose(run.y[-1, 0], math.sin(10.0), atol=1e-6)


def decay_codes(whole):
    """Return kernels for `decay` in five components, with the whole Jacobian or its columns."""
    n = 5

    def jacobian(t, y, c, out):
        for i in range(n * n):
            out[i] = 0.0
        for i in range(n):
            out[i * n + i] = -c[i]

    def tangent(t, y, c, out):
        for i in range(n):
            out[i] = -c[i] * y[n + i]

    kernel = machine_code(jacobian, (n, n, n * n)) if whole else machine_code(tangent, (2 * n, n, 2 * n))
    return RunCodes(machine_code(decay, (n, n, n)), **{"jacobian" if whole else "tangent": kernel})


def test_jacobian_by_columns_is_the_jacobian():
    problem = IntegrationProblem(t0=0.0, t1=3.0, y0=np.ones(5), constants=10.0 ** np.arange(5), rtol=1e-9, atol=1e-12)
    whole, columns = (
        implicit.integrate(loop_named("implicit_loop"), decay_codes(kind), problem) for kind in (True, False)
    )
    np.testing.assert_array_equal(whole.y, columns.y)
    np.testing.assert_allclose(whole.y[-1], np.exp(-3.0 * problem.constants), atol=1e-8)


def test_backward_in_time_through_an_unstable_mode():
    run = solve("llvm-radau", mixed, mixed_solution(3.0), t0=3.0, t1=0.0, rtol=1e-8, atol=1e-10)
    assert run.success and np.all(np.diff(run.t) < 0)
    np.testing.assert_allclose(run.y[-1], MIXED_START, atol=1e-6)


def leaves_its_domain(t, y, c, out):
    out[0] = -1e5 * y[0] + math.sqrt(1.0 - t)


def test_end_of_a_domain_is_a_status():
    run = solve("llvm-radau", leaves_its_domain, [0.0], t0=0.0, t1=2.0, rtol=1e-6, atol=1e-8)
    assert run.status is Status.NON_FINITE
    assert 0.9 < run.t[-1] <= 1.0


def test_scipy_takes_a_generated_jacobian():
    from dalembert.steps.problem import Kernels

    calls = []

    def jacobian(t, y, c, out):
        calls.append(t)
        out[:] = [0.0, 1.0, (-2.0 * y[0] * y[1] - 1.0) / c[0], (1.0 - y[0] * y[0]) / c[0]]

    problem = IntegrationProblem(t0=0.0, t1=1.0, y0=VAN_DER_POL_START, constants=np.array([1e-6]), rtol=1e-6, atol=1e-6)
    for method in IMPLICIT:
        calls.clear()
        run = solvers.integrate(Kernels(van_der_pol, jacobian=jacobian), method, problem)
        assert run.success and calls
