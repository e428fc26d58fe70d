"""A process of tests that crashes or hangs ends the run within seconds, by the name of the test."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
LIMIT = "faulthandler_timeout = 600"
TESTS = {
    "crash": {"end": "import ctypes; ctypes.string_at(0)", "other": "import time; time.sleep(5)"},
    "hang": {"end": "import time; time.sleep(200)", "other": "pass"},
}


@pytest.mark.parametrize("kind", TESTS)
def test_runs_end_by_name(tmp_path, kind):
    """A crash ends them while the other process goes on with a test, for which pytest-xdist waits ten seconds."""
    settings = (HERE.parent / "pyproject.toml").read_text()
    assert LIMIT in settings
    settings = settings.replace(LIMIT, "faulthandler_timeout = 2") if kind == "hang" else settings
    (tmp_path / "pyproject.toml").write_text(settings)
    (tmp_path / "tests").mkdir()
    for name in ("conftest.py", "quick_kernels.py", "repeated_rows.py"):
        shutil.copy(HERE / name, tmp_path / "tests")
    for name, does in TESTS[kind].items():
        (tmp_path / "tests" / f"test_{name}.py").write_text(f"def test_{name}(): {does}\n")
    outer = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-n", "2", "-p", "xdist", "-p", "no:cacheprovider"],
        cwd=tmp_path,
        env=outer | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},  # those take seconds to import
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=100,
    )
    assert run.returncode == 1, run.stdout
    last = run.stdout.splitlines()[-1]
    assert "a process crashed" in last and "test_end.py::test_end" in last
