import dataclasses
import subprocess
import sys

import numpy as np
import pytest
from scipy.integrate import DOP853 as SCIPY_DOP853

from dalembert.methods.step_constants import POLYNOMIAL_ERROR
from dalembert.methods.tableau import density, elementary_weights, node_count, trees_of_order
from dalembert.methods.tableaus import DOP853, TABLEAUS, TSIT5

tableaus = pytest.mark.parametrize("tableau", TABLEAUS, ids=lambda tableau: tableau.name)


def test_rooted_trees_are_all_there():
    assert [len(trees_of_order(order)) for order in range(1, 8)] == [1, 1, 2, 4, 9, 20, 48]
    assert all(node_count(tree) == 5 for tree in trees_of_order(5))
    assert sorted(density(tree) for tree in trees_of_order(4)) == [4, 8, 12, 24]


def test_names_are_unique():
    assert len({tableau.name for tableau in TABLEAUS}) == len(TABLEAUS)


@tableaus
def test_data_are_immutable_and_cited(tableau):
    assert tableau.source
    with pytest.raises(ValueError, match="read-only"):
        tableau.A[1, 0] = 0.0


@tableaus
@pytest.mark.parametrize("name", ["c", "A", "error", "P"])
def test_any_wrong_coefficient_is_refused(tableau, name):
    array = getattr(tableau, name)
    for index in zip(*np.nonzero(array), strict=True):
        wrong = array.copy()
        wrong[index] += 1e-9
        with pytest.raises(ValueError, match=f"tableau '{tableau.name}' is wrong"):
            dataclasses.replace(tableau, **{name: wrong})


@tableaus
def test_dense_output_joins_smoothly(tableau):
    powers = np.arange(1, tableau.degree + 1)
    last_slope = np.zeros(tableau.n_total)
    last_slope[tableau.end] = 1.0
    np.testing.assert_allclose(tableau.P[:, 0], np.eye(tableau.n_total)[0], atol=1e-14)
    np.testing.assert_allclose(tableau.P @ powers, last_slope, atol=2e-12)


def test_only_tsit5_needs_the_end_for_its_error():
    assert TSIT5.fsal and not DOP853.fsal


def test_dop853_is_scipys():
    np.testing.assert_array_equal(DOP853.A[:12, :12], SCIPY_DOP853.A)
    np.testing.assert_array_equal(DOP853.A[13:], SCIPY_DOP853.A_EXTRA)
    np.testing.assert_array_equal(DOP853.b[:12], SCIPY_DOP853.B)
    np.testing.assert_array_equal(DOP853.error[:, :13], [SCIPY_DOP853.E5, SCIPY_DOP853.E3])


def test_import_needs_no_backend():
    code = (
        "import numpy, sys; import dalembert.errors; before = set(sys.modules);"
        "import dalembert.methods.tableaus, dalembert.steps.problem;"
        "print({'numba', 'scipy', 'jax', 'sympy'} & (set(sys.modules) - before))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


# -- dense output between the ends of a step ----------------------------------------------


def largest_share_between(tableau):
    """Return the largest error of the polynomial over the error estimate, of stable steps of y' = z y."""
    theta, stages = np.linspace(0.0, 1.0, 41), len(tableau.c)
    weights = theta[:, np.newaxis] ** np.arange(1, tableau.degree + 1) @ tableau.P.T
    found = 0.0
    for angle in np.linspace(np.pi / 2, np.pi, 61):
        for z in np.linspace(0.5, 8.0, 120) * np.exp(1j * angle):
            slopes = z * np.linalg.solve(np.eye(stages) - z * tableau.A, np.ones(stages))
            if abs(1.0 + tableau.b @ slopes) <= 1.0:
                first, *more = np.abs(tableau.error @ slopes)
                estimate = first**2 / np.hypot(first, 0.1 * more[0]) if more else first
                found = max(found, np.abs(1.0 + weights @ slopes - np.exp(theta * z)).max() / estimate)
    return found


def test_where_steps_are_stable_their_estimate_bounds_the_polynomials_of_tsit5():
    assert largest_share_between(TSIT5) < 3.0 < POLYNOMIAL_ERROR
    assert largest_share_between(DOP853) > 100.0 * POLYNOMIAL_ERROR


def test_the_stages_of_tsit5_have_one_estimate_of_order_four():
    """Another one, for points between the ends, would need another stage."""
    trees = [tree for order in range(1, 5) for tree in trees_of_order(order)]
    conditions = np.array([elementary_weights(tree, TSIT5.A) for tree in trees])
    assert np.linalg.matrix_rank(conditions, tol=1e-9) == TSIT5.n_total - 1
    np.testing.assert_allclose(conditions @ TSIT5.error[0], 0.0, atol=1e-14)
