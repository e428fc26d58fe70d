"""Motions by jax are those by numba, for every ready scene and every formulation that explicit methods integrate."""

import numpy as np
import pytest

import dalembert as da
from dalembert.reduction import FORMULATIONS
from runtime.test_sensitivity import MOTIONS

pytest.importorskip("jax")
pytest.importorskip("diffrax")

T = np.linspace(0.0, 0.5, 6)
EXPLICIT = [name for name in FORMULATIONS if name != "ggl"]  # which only numba's radau integrates


@pytest.mark.parametrize("formulation", EXPLICIT)
@pytest.mark.parametrize("scene", da.scenes.ALL)
def test_motions_are_those_of_numba(scene, formulation):
    parameters, initial, outputs = MOTIONS[scene]
    runs = []
    for backend, method in (("numba", "taylor"), ("jax", "tsit5")):
        model = da.compile_model(
            da.scenes.ALL[scene](), backend=backend, formulation=formulation, outputs=list(outputs)
        )
        run = model.simulate((0.0, 0.5), initial, parameters, method=method, rtol=1e-11, atol=1e-12, t_eval=T)
        assert run.success
        runs.append(np.column_stack([run.q, run.qdot, *(run[name] for name in outputs)]))
    np.testing.assert_allclose(runs[1], runs[0], rtol=1e-9, atol=1e-9)
