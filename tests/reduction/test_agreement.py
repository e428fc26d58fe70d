"""Every formulation of every ready scene agrees with every other, in single runs and in sweeps."""

from functools import cache
from itertools import combinations

import numpy as np
import pytest

import dalembert as da
from analysis.test_sensitivity import MOTIONS
from dalembert.reduction import FORMULATIONS

T = np.linspace(0.0, 0.5, 6)
BOUND = {"baumgarte": 1e-8, "ggl": 1e-8, "augmented": 1e-8}
"""Of those that do not hold the constraints to rounding, at tolerances of 1e-10."""


@cache
def motion(scene, formulation):
    """Return coordinates, rates and outputs at the times, and coordinates at the end of a sweep of three cases."""
    parameters, initial, outputs = MOTIONS[scene]
    model = da.compile_model(da.scenes.ALL[scene](), formulation=formulation, outputs=list(outputs))
    options = {"method": model.methods[0], "rtol": 1e-10, "atol": 1e-11}
    run = model.simulate((0.0, 0.5), initial, parameters, t_eval=T, **options)
    assert run.success, run.message
    name = next(iter(parameters))
    varied = {**parameters, name: parameters[name] * np.array([1.0, 1.1, 1.0])}
    sweep = model.sweep((0.0, 0.5), initial, varied, t_eval=T, **options)
    assert np.all(sweep.status == 0)
    cases = np.stack([sweep[x] for x in (*model.layout.coordinates, *model.layout.rates)], axis=-1)
    return np.column_stack([run.q, run.qdot, *(run[x] for x in outputs)]), cases


@pytest.mark.parametrize("pair", list(combinations(FORMULATIONS, 2)), ids="-".join)
@pytest.mark.parametrize("scene", da.scenes.ALL)
def test_formulations_agree(scene, pair):
    (single, cases), (other, others) = (motion(scene, name) for name in pair)
    bound = sum(BOUND.get(name, 1e-9) for name in pair)
    np.testing.assert_allclose(single, other, rtol=bound, atol=bound)
    np.testing.assert_allclose(cases, others, rtol=bound, atol=bound)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("scene", da.scenes.ALL)
def test_sweeps_agree_with_single_runs(scene, formulation):
    single, cases = motion(scene, formulation)
    bound = BOUND.get(formulation, 1e-9)
    for case in (cases[0], cases[2]):
        np.testing.assert_allclose(case, single[:, : case.shape[1]], rtol=bound, atol=bound)
