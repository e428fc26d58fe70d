"""Generated attempts of Runge-Kutta steps: they accept, reject and propose as the functions of step control do."""

import math
from dataclasses import replace

import numpy as np
import pytest

from codegen.programs import oscillator
from dalembert.ir.interpret import interpret
from dalembert.ir.kernel import Assignment, Kernel, Load
from dalembert.methods.status import Status
from dalembert.methods.step_constants import LARGEST_GROWTH, POLYNOMIAL_ERROR, REDUCTION_BLIND, SMALLEST_PREVIOUS
from dalembert.methods.tableaus import TABLEAUS, bounded
from dalembert.steps import step_control as control
from dalembert.steps.explicit_stages import error_norm
from dalembert.steps.packed_tableaus import ALLOWED, packed_tableau
from dalembert.transforms.runge_kutta import attempt_kernel
from dalembert.transforms.runge_kutta_parts import GROWTH_AT, PROPOSAL_AT

N, RHS = 2, oscillator().kernel("rhs")
Y, C = np.array([0.7, -0.4]), [0.3, 2.0, 4.0]
RTOL, ATOL = 1e-6, 1e-8
PAIRS = [tableau for tableau in TABLEAUS if tableau.name in ("dop853", "tsit5")]
named = pytest.mark.parametrize("tableau", PAIRS, ids=lambda tableau: tableau.name)


def attempt(tableau, proposed, *, t=0.5, largest=10.0, previous=1.0, growth=LARGEST_GROWTH, y=Y, c=C):
    """Return the outputs of an attempt: state, size, check, and what is remembered."""
    kernel = attempt_kernel(RHS, tableau, dense=False, carried=False)
    memory = [0.0, 0.0, proposed, math.log2(previous), growth]
    return np.array(interpret(kernel, {"t": t, "y": [*y, *memory], "c": c, "s": [largest, 1.0, RTOL, ATOL]}))


def error_of(tableau, h, t=0.5, scale=1.0):
    """Return the error norm of a step, as single runs have it, with all slopes multiplied by `scale`."""
    packed = packed_tableau(tableau)
    work, slopes = np.zeros((packed.first + packed.total, N)), np.zeros((packed.total, N))
    work[0], work[ALLOWED] = Y, ATOL
    for i in range(tableau.end + 1):
        point = Y + h * tableau.A[i] @ slopes
        slopes[i] = interpret(RHS, {"t": t + tableau.c[i] * h, "y": point, "c": C})
    work[1] = Y + h * tableau.A[tableau.end] @ slopes
    work[packed.first :] = scale * slopes
    return float(error_norm(packed, h, work, 0, 1, RTOL, N))


@named
@pytest.mark.parametrize("previous", [SMALLEST_PREVIOUS, 1.0])
@pytest.mark.parametrize("retried", [False, True])
def test_attempts_decide_as_step_control_does(tableau, previous, retried):
    seen, exponent = set(), 1.0 / (tableau.error_order + 1)
    for h in np.geomspace(0.02, 2.0, 25):
        error = error_of(tableau, h)
        outcome = control.error_test(error)
        found = attempt(tableau, h, previous=previous, growth=control.growth_limit(retried))
        seen.add(outcome)
        factor = control.reduction(outcome, error, exponent)
        if outcome == control.ACCEPTED:
            factor = control.growth(error, previous, retried, exponent)
        assert found[N] == (h if outcome == control.ACCEPTED else 0.0)
        assert found[N + 1] == 0.0
        assert found[N + PROPOSAL_AT] == pytest.approx(factor * h, rel=2e-3)
        assert found[N + GROWTH_AT] == control.growth_limit(outcome != control.ACCEPTED)
        assert np.array_equal(found[:N], Y) == (outcome != control.ACCEPTED)
        kept = max(error, SMALLEST_PREVIOUS) if outcome == control.ACCEPTED else previous
        assert 2.0 ** found[N + PROPOSAL_AT + 1] == pytest.approx(kept, rel=2e-3)
    assert seen == {control.ACCEPTED, Status.STEP_TOO_SMALL}


@named
@pytest.mark.parametrize(
    ("proposed", "t", "rest"),
    [
        (0.01, 0.5, 10.0),
        (0.01, 0.5, 0.002),
        (0.01 * (1.0 - 0.9e-9), 0.5, 0.01),
        (0.01 * (1.0 - 1.1e-9), 0.5, 0.01),
        (1e-30, 4.0, 10.0),
        (1e-30, 0.0, 10.0),
    ],
)
def test_the_size_of_an_attempt_is_that_of_the_next_step(tableau, proposed, t, rest):
    size, _ = control.next_step(proposed, t, t + rest, math.inf)
    found = attempt(tableau, proposed, t=t, largest=abs(t + rest - t))
    assert found[N] == size


@named
def test_an_attempt_that_is_not_finite_is_repeated_blindly(tableau):
    found = attempt(tableau, 0.25, c=[math.nan, 2.0, 4.0])
    assert (found[N], found[N + PROPOSAL_AT]) == (0.0, REDUCTION_BLIND * 0.25)
    assert found[N + 1] != 0.0
    assert control.attempt_test(0.0, True, found[N + PROPOSAL_AT], True, 0.5, 1.0) == control.REJECTED


@named
def test_the_error_of_a_step_is_a_number_however_small_its_slopes_are(tableau):
    # the square of the second estimate of dop853 underflows after that of the first, its hundredth before
    errors = [error_of(tableau, 0.3, scale=scale) for scale in 0.7 ** np.arange(1000.0, 1100.0)]
    assert errors[0] > 0.0 and errors[-1] == 0.0
    assert np.all(np.diff(errors) <= 0.0)


def decay(rate):
    """Return y' = rate (sin t - y) + cos t, of which sin t is a solution that the others come near."""
    loads = Load("time", "t", None), Load("u", "y", 0)
    body = (
        Assignment("sine", "sin", ("time",)),
        Assignment("slope", "cos", ("time",)),
        Assignment("lack", "sub", ("sine", "u")),
        Assignment("pull", "mul", ("lack", rate)),
        Assignment("rate", "add", ("pull", "slope")),
    )
    return Kernel("rhs", ("t", "y", "c"), loads, body, ("rate",))


def test_bounded_steps_are_right_between_their_ends():
    """At the limit of stability the estimate of dop853 vanishes for some size of a step, and its error does not."""
    (dop853,) = (tableau for tableau in PAIRS if tableau.name == "dop853")
    rate, t, off, accepted = 50.0, 0.5, 1e-3, {False: [], True: []}
    theta = np.linspace(0.0, 1.0, 21)
    for bound in accepted:
        kernel = attempt_kernel(decay(rate), bounded(dop853) if bound else dop853, dense=True, carried=False)
        for h in np.linspace(0.02, 0.2, 240):
            memory = [0.0, 0.0, h, 0.0, LARGEST_GROWTH]
            given = {"t": t, "y": [math.sin(t) + off, *memory], "c": [], "s": [10.0, 1.0, RTOL, ATOL]}
            found = np.array(interpret(kernel, given))
            if found[1] != 0.0:
                accepted[bound].append(h)
            if found[1] != 0.0 and bound:
                motion = np.sin(t + theta * h) + off * np.exp(-rate * theta * h)
                polynomial = np.polynomial.polynomial.polyval(theta, found[1 + 2 + 3 :])
                assert np.max(np.abs(polynomial - motion)) <= 2.0 * POLYNOMIAL_ERROR * (RTOL * abs(found[0]) + ATOL)
    assert max(accepted[False]) > 0.11 > 0.08 > max(accepted[True])


def test_pairs_without_stages_of_their_own_between_the_ends_are_not_bounded():
    (tsit5,) = (tableau for tableau in PAIRS if tableau.name == "tsit5")
    assert bounded(tsit5) is tsit5
    with pytest.raises(ValueError, match="no stage estimates the error of the dense output"):
        replace(tsit5, bounded=True)
