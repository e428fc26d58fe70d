"""Kernels that tests compile quickly compute the bits of those that users have."""

import ctypes

import numpy as np
import pytest

import dalembert as da
from dalembert.arrays import aligned
from dalembert.codegen.llvm import assembly, backend
from dalembert.codegen.llvm.assembly import load_object
from dalembert.codegen.llvm.target import target
from hard_cases import hard_case
from quick_kernels import compiled_quickly


def results(code, kernel, lanes, arrays):
    out = aligned(len(kernel.outputs), lanes)
    pointers = [array.ctypes.data for array in (*arrays, out)]
    function = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * len(pointers))
    load_object(code).address("k").function(function)(*pointers)
    return out


@pytest.mark.parametrize("lanes", [1, "native"])
@pytest.mark.parametrize("name", ["Andrews' squeezing mechanism", "Routh sphere"])
def test_bits_are_those_of_usual_options(name, lanes):
    lanes = target().lanes if lanes == "native" else lanes
    model = hard_case(name).compile("auto")
    kernel = model.stages.program.kernel("rhs")
    text = assembly.assembly([("k", kernel)], lanes)
    usual = backend.object_code(None, "k", lambda: text)
    with compiled_quickly():
        quickly = backend.object_code(None, "k", lambda: text)
    assert usual != quickly
    random = np.random.default_rng(0)
    for _ in range(20):
        arrays = [aligned(500, lanes) for _ in kernel.arguments]
        for array in arrays:
            array[:] = random.uniform(0.1, 1.0, array.shape)
        exact = results(usual, kernel, lanes, arrays)
        np.testing.assert_array_equal(results(quickly, kernel, lanes, arrays), exact)
        assert np.isfinite(exact).any()


def test_code_on_disk_has_names_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setenv("DALEMBERT_CACHE_DIR", str(tmp_path))
    kernel = da.compile_model(da.scenes.chaplygin_sleigh()).stages.program.kernel("rhs")
    text = assembly.assembly([("k", kernel)], 1)
    folder = tmp_path / "module"
    usual = backend.object_code(folder, "k", lambda: text)
    with compiled_quickly():
        assert backend.object_code(folder, "k", lambda: text) != usual
    assert backend.object_code(folder, "k", lambda: pytest.fail("compiled again")) == usual
    assert len([*folder.iterdir()]) == 2
