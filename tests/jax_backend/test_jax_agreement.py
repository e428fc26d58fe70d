"""Equations by jax are those by numpy, and motions those by numba, for every ready scene and every formulation that
explicit methods integrate."""

from functools import cache

import numpy as np
import pytest

import dalembert as da
from analysis.test_sensitivity import MOTIONS
from dalembert.ir.interpret import interpret
from dalembert.reduction import FORMULATIONS

jax = pytest.importorskip("jax")
pytest.importorskip("diffrax")

pytestmark = pytest.mark.usefixtures("quick_xla")

T = np.linspace(0.0, 0.5, 6)
EXPLICIT = [name for name in FORMULATIONS if name != "ggl"]  # which only numba's radau integrates
QUICK = {"xla_backend_optimization_level": 0}
SCENES = pytest.mark.parametrize("scene", da.scenes.ALL)


@cache
def compiled(scene, formulation, backend):
    outputs = list(MOTIONS[scene][2])
    return da.compile_model(da.scenes.ALL[scene](), backend=backend, formulation=formulation, outputs=outputs)


@pytest.mark.parametrize("formulation", EXPLICIT)
@SCENES
def test_rates_and_accelerations_are_those_of_numpy(scene, formulation):
    parameters = MOTIONS[scene][0]  # gains are no parameters of a scene
    model, reference = (compiled(scene, formulation, backend).engine for backend in ("jax", "numpy"))
    program = compiled(scene, formulation, "numpy").stages.program
    c = np.array(
        interpret(program.kernel("prepare"), {"p": [parameters.get(name, 5.0) for name in program.layout.parameters]})
    )
    t, y = (
        np.linspace(0.0, 1.0, 9),
        np.random.default_rng(11).uniform(0.5, 1.2, (9, 2 * len(program.layout.coordinates))),
    )
    kernels = {"rhs": y[:, : len(program.layout.state)], "accelerations": y}

    def both(t, states):
        return {name: jax.vmap(model.kernels[name], (0, 0, None))(t, states[name], c) for name in states}

    with jax.enable_x64(True):
        found = jax.jit(both, compiler_options=QUICK)(t, kernels)
    for name, states in kernels.items():
        np.testing.assert_allclose(found[name], reference.evaluate(name, t, states, c), rtol=1e-12, atol=1e-12)


def _chosen(scene, formulation):
    """Return a row of the matrix of motions: each scene and each formulation once, the sleigh in two, else `matrix`."""
    once = dict(zip(da.scenes.ALL, EXPLICIT, strict=True)), {"chaplygin_sleigh": "projected"}
    marks = [] if any(chosen.get(scene) == formulation for chosen in once) else [pytest.mark.matrix]
    return pytest.param(scene, formulation, marks=marks)


@pytest.mark.parametrize(
    ("scene", "formulation"), [_chosen(scene, formulation) for scene in da.scenes.ALL for formulation in EXPLICIT]
)
def test_motions_are_those_of_numba(scene, formulation):
    parameters, initial, outputs = MOTIONS[scene]
    runs = []
    for backend, method in (("llvm", "taylor"), ("jax", "tsit5")):
        model = compiled(scene, formulation, backend)
        run = model.simulate((0.0, 0.5), initial, parameters, method=method, rtol=1e-11, atol=1e-12, t_eval=T)
        assert run.success
        runs.append(np.column_stack([run.q, run.qdot, *(run[name] for name in outputs)]))
    np.testing.assert_allclose(runs[1], runs[0], rtol=1e-9, atol=1e-9)
