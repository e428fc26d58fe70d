"""Every ready scene in every formulation by every method, on the numba backend as on the default one."""

import pytest

import dalembert as da
from codegen.ready_scenes import CONTACTS, assert_agreement
from dalembert.codegen import backend_named
from dalembert.reduction import FORMULATIONS

pytestmark = pytest.mark.matrix
METHODS = tuple(backend_named("numba").methods)


@pytest.mark.parametrize("run", ["simulate", "sweep"])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("scene", da.scenes.ALL)
def test_numba_agrees_with_llvm(scene, formulation, method, run):
    assert_agreement(scene, formulation, run, method=method)


@pytest.mark.parametrize("run", ["simulate", "sweep"])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scene", CONTACTS)
def test_numba_agrees_with_llvm_in_scenes_with_contacts(scene, method, run):
    assert_agreement(scene, "auto", run, method=method)
