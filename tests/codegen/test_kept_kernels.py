"""Long kernels on disk: read in place of lowering, equal to what lowering makes, and rebuilt where they are damaged."""

import os
import subprocess
import sys

import pytest

import dalembert as da
from dalembert.codegen.cache import ENVIRONMENT_VARIABLE
from dalembert.codegen.kept_kernels import _packed, _unpacked
from dalembert.errors import CacheWarning
from dalembert.ir.kernel import Kernel
from dalembert.transforms import lower_kernels
from dalembert.transforms.pipelines import PassRecord
from hard_cases import hard_case


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    path = tmp_path / "cache"
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, str(path))
    lower_kernels.LOWERED.clear()
    yield path
    lower_kernels.LOWERED.clear()


def compiled(**options):
    """Return the text of the program of a double pendulum, and its passes, as a new process would make them."""
    lower_kernels.LOWERED.clear()
    stages = da.compile_model(hard_case("double pendulum, angles").scene, backend="numpy", **options).stages
    return str(stages.program), [(p.name, p.before, p.after) for p in stages.passes], stages.passes


def kept(folder):
    return sorted(folder.glob("kernels_*/*.kernel"))


def test_kernels_that_are_kept_are_not_lowered_again(folder, monkeypatch):
    program, passes, _ = compiled()
    names = kept(folder)
    assert names
    lowered = lower_kernels._lowered

    def again(graph, name, *rest):
        assert name != "rhs", "a kernel that is kept was lowered again"
        return lowered(graph, name, *rest)

    monkeypatch.setattr(lower_kernels, "_lowered", again)
    read, same, records = compiled()
    assert (read, same) == (program, passes) and kept(folder) == names
    assert any(record.seconds == 0.0 for record in records)


def test_without_a_cache_nothing_is_kept_or_read(folder):
    expected = compiled(cache=False)[:2]
    assert not kept(folder)
    compiled()
    for path in kept(folder):
        path.write_bytes(b"not read")
    assert compiled(cache=False)[:2] == expected
    assert all(path.read_bytes() == b"not read" for path in kept(folder))


def test_damaged_files_are_rebuilt(folder):
    expected = compiled()[:2]
    path, contents = kept(folder)[0], [path.read_bytes() for path in kept(folder)]
    path.write_bytes(contents[0][:-1] + bytes([contents[0][-1] ^ 1]))
    with pytest.warns(CacheWarning, match=rf"{path.name} was damaged and is rebuilt"):
        assert compiled()[:2] == expected
    assert [path.read_bytes() for path in kept(folder)] == contents


def test_models_that_are_derived_later_keep_kernels_as_well(folder):
    case = hard_case("double pendulum, angles")
    model = da.compile_model(case.scene)
    before = len(kept(folder))
    model.simulate((0, 0.1), case.initial, case.parameters, project_invariants=True)
    assert len(kept(folder)) > before


KERNEL = """kernel rhs(t, y, c)
  now = t
  x = y[12]
  z = x * 0.1
  w = fma(z, -1e-300, now)
  u = z / (-2.5)
  out[0] = w
  out[1] = 0.30000000000000004
  out[2] = u"""


def test_all_of_a_kernel_is_kept():
    kernel = Kernel.parse(KERNEL)
    records = [PassRecord("eliminate dead code", 0.0, {"rhs": 5}, {"rhs": 3}), PassRecord("other", 0.0, {}, {})]
    read, same = _unpacked(_packed((kernel, records)))
    assert read == kernel and same == records and str(read) == str(kernel) and read.digest == kernel.digest


def test_kernels_have_the_same_files_in_every_process(folder):
    """Hashes of strings, which differ from process to process, have no part in the names of files."""
    names = []
    for seed in ("1", "2"):
        own = folder.with_name(f"cache{seed}")
        text = "import dalembert as da; da.compile_model(da.scenes.rolling_sphere(), backend='numpy')"
        environment = {**os.environ, ENVIRONMENT_VARIABLE: str(own), "PYTHONHASHSEED": seed}
        subprocess.run([sys.executable, "-c", text], env=environment, check=True)
        names.append([path.name for path in kept(own)])
    assert names[0] == names[1] != []
