"""The cache of generated modules: where it is, when it is hit, and what it survives."""

import os
import shutil
import subprocess
import sys
import warnings

import numpy as np
import pytest

import dalembert as da
from dalembert.codegen.cache import ENVIRONMENT_VARIABLE, directory, load_in_memory
from dalembert.errors import CacheWarning

Q, QDOT = np.array([0.0, 0.0, 0.3]), np.array([0.9, 0.3, 1.7])
P = {"m": 1.0, "b": 0.3, "I_C": 0.5}
START = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    path = tmp_path / "cache"
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, str(path))
    return path


def use(**options):
    """Compile the sleigh, call a kernel, run it with machine code; return what came out."""
    model = da.compile_model(da.scenes.chaplygin_sleigh(), **options)
    trajectory = model.simulate((0, 1), START, P, method="taylor")
    assert trajectory.success
    return np.concatenate([model.accelerations(0.0, Q, QDOT, P), trajectory.q[-1]])


def use_numba():
    """Do so with numba, and call a kernel as a function of numba; return what came out."""
    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="numba")
    c, out = np.empty(model.layout.constants), np.empty(9)
    model.kernels.prepare(model.parameter_vector(P), c)
    model.kernels.mass_matrix(0.0, np.concatenate([Q, QDOT]), c, out)
    return np.concatenate([use(backend="numba"), out])


@pytest.fixture(scope="module")
def compiled_by_numba(tmp_path_factory):
    """Return a cache in which everything is, and what comes out of it."""
    path = tmp_path_factory.mktemp("numba") / "cache"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(ENVIRONMENT_VARIABLE, str(path))
        return path, use_numba()


@pytest.fixture(scope="module")
def expected():
    return use(cache=False)


def files(folder, pattern="*"):
    return sorted(path for path in folder.rglob(pattern) if path.is_file())


def stamps(folder):
    return {path: (path.stat().st_mtime_ns, path.stat().st_size) for home in homes(folder) for path in files(home)}


def homes(folder):
    """Return the folders of generated modules: not those of lowered kernels, loops and templates."""
    others = ("kernels_", "loops_", "templates")
    return [path for path in sorted(folder.iterdir()) if not path.name.startswith(others)]


def test_environment_variable_says_where_the_cache_is(folder, monkeypatch):
    assert directory() == folder
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, "~/somewhere")
    assert "~" not in str(directory())
    monkeypatch.delenv(ENVIRONMENT_VARIABLE)
    assert "dalembert" in str(directory())


def test_code_is_kept_in_one_folder_a_model(folder, expected, compiled_by_numba):
    np.testing.assert_array_equal(use(), expected)
    for cache, suffixes in ((folder, {".o"}), (compiled_by_numba[0], {".nbo", ".nbc"})):
        (home,) = homes(cache)
        assert home.name.startswith("chaplygin_sleigh_")
        assert {path.suffix for path in files(home)} == suffixes


def test_second_compilation_rewrites_nothing(folder, expected):
    use()
    before = stamps(folder)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(use(), expected)
    assert stamps(folder) == before


def test_second_process_rewrites_nothing(folder, expected):
    use()
    before = stamps(folder)
    (result,) = run_processes(1)
    np.testing.assert_array_equal(result, expected)
    assert stamps(folder) == before


def test_other_formulations_and_outputs_have_folders_of_their_own(folder):
    use()
    use(formulation="projected")
    use(outputs=["X"])
    assert len(homes(folder)) == 3


def test_without_cache_nothing_is_written(folder, expected):
    np.testing.assert_array_equal(use(cache=False), expected)
    assert not folder.exists()


def test_numpy_keeps_nothing(folder):
    da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy")
    assert not folder.exists()


SPOILS = {
    "emptied": lambda data: b"",
    "cut short": lambda data: data[: len(data) // 2],
    "cut by a byte": lambda data: data[:-1],
    "garbage": lambda data: b"\x80\x04garbage" * 50,
    "one byte changed": lambda data: (
        data[: len(data) // 2] + bytes([data[len(data) // 2] ^ 0xFF]) + data[len(data) // 2 + 1 :]
    ),
}


@pytest.mark.parametrize("spoil", SPOILS)
def test_damaged_code_of_numba_is_rebuilt_with_a_warning(folder, compiled_by_numba, spoil):
    """Machine code of steps and kernels, and pickles of the functions that people call."""
    cache, expected = compiled_by_numba
    shutil.copytree(cache, folder)
    spoiled = [files(folder, name)[0] for name in ("taylor*.nbo", "prepare*.nbc")]
    for path in spoiled:
        path.write_bytes(SPOILS[spoil](path.read_bytes()))
    with pytest.warns(CacheWarning, match="damaged and is rebuilt") as caught:
        result = use_numba()
    assert all(any(path.name in str(warning.message) for warning in caught) for path in spoiled)
    np.testing.assert_array_equal(result, expected)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(use_numba(), expected)


@pytest.mark.parametrize("spoil", SPOILS)
def test_damaged_machine_code_is_rebuilt_with_a_warning(folder, expected, spoil):
    use()
    (path,) = files(folder, "taylor*.o")
    path.write_bytes(SPOILS[spoil](path.read_bytes()))
    with pytest.warns(CacheWarning, match="damaged and is rebuilt"):
        result = use()
    np.testing.assert_array_equal(result, expected)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(use(), expected)


@pytest.mark.parametrize("where", ["a file stands in the way", "the folder is a file"])
def test_cache_that_cannot_be_written_does_not_stand_in_the_way(tmp_path, monkeypatch, expected, where):
    obstacle = tmp_path / "obstacle"
    obstacle.write_text("in the way")
    path = obstacle / "cache" if where.startswith("a file") else obstacle
    monkeypatch.setenv(ENVIRONMENT_VARIABLE, str(path))
    with pytest.warns(CacheWarning, match="obstacle"):
        result = use()
    np.testing.assert_array_equal(result, expected)
    assert obstacle.read_text() == "in the way"


SCRIPT = """
import sys
import numpy as np
import dalembert as da
sys.path.insert(0, {tests!r})
from codegen.test_cache import use
print(*use().tolist())
"""


def run_processes(count):
    """Return what `count` processes find, started together."""
    tests = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    command = [sys.executable, "-W", "error::dalembert.errors.CacheWarning", "-c", SCRIPT.format(tests=tests)]
    runs = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(count)]
    outcomes = [run.communicate() for run in runs]
    assert [run.returncode for run in runs] == [0] * count, outcomes
    return [np.array(list(map(float, out.split()))) for out, _ in outcomes]


def test_processes_share_an_empty_cache(folder, expected):
    for result in run_processes(2):
        np.testing.assert_array_equal(result, expected)
    assert len(homes(folder)) == 1
    assert not files(folder, "*.part")


def test_modules_in_memory_show_their_lines_in_tracebacks():
    module = load_in_memory("feed", "def f():\n    return 1 / 0\n")
    with pytest.raises(ZeroDivisionError) as caught:
        module.f()
    assert "return 1 / 0" in str(caught.getrepr())
