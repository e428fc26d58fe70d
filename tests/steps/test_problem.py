import numpy as np
import pytest

from dalembert.errors import OptionError
from dalembert.methods.status import Status
from dalembert.steps.dense_output import PiecewisePolynomial
from dalembert.steps.problem import IntegrationProblem


def problem(**changes):
    arguments = {"t0": 0.0, "t1": 1.0, "y0": np.ones(2), "constants": np.zeros(0), **changes}
    return IntegrationProblem(**arguments)


def test_every_status_has_a_message():
    assert len({status.message for status in Status}) == len(Status)


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"rtol": -1.0}, ["rtol"]),
        ({"rtol": 0.0, "atol": 0.0}, ["rtol", "atol"]),
        ({"atol": np.nan}, ["atol"]),
        ({"t1": np.inf}, ["t1"]),
        ({"first_step": 0.0, "max_step": -1.0, "max_steps": 0}, ["first_step", "max_step", "max_steps"]),
        ({"t_eval": np.array([0.5, 0.2])}, ["sorted"]),
        ({"t_eval": np.array([0.5, 1.2])}, ["t_eval", "between"]),
        ({"t_eval": np.array([np.nan])}, ["t_eval"]),
        ({"t_eval": np.array([0.2, 0.5]), "t1": -1.0}, ["t_eval"]),
        ({"t_eval": np.array([-0.5, -0.2]), "t1": -1.0}, ["sorted"]),
        ({"y0": np.ones((2, 2))}, ["y0"]),
    ],
)
def test_faults_are_all_named(changes, names):
    with pytest.raises(OptionError) as caught:
        problem(**changes)
    assert all(name in str(caught.value) for name in names)


def test_backward_and_zero_spans_are_allowed():
    problem(t1=-1.0, t_eval=np.array([0.0, -0.5, -0.5, -1.0]))
    problem(t1=0.0, t_eval=np.array([0.0]))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_piecewise_polynomial(sign):
    knots = sign * np.array([0.0, 1.0, 3.0])
    dense = PiecewisePolynomial(knots, np.array([[[0.0], [1.0], [0.0]], [[1.0], [0.0], [8.0]]]))
    np.testing.assert_array_equal(
        dense(sign * np.array([2.0, 0.0, 0.25, 1.0, 3.0])), [[3.0], [0.0], [0.25], [1.0], [9.0]]
    )
    assert dense(np.zeros(0)).shape == (0, 1)
    with pytest.raises(OptionError, match="between"):
        dense(np.array([sign * 3.1]))
