import os
import shutil
import subprocess
import sys
from pathlib import Path

import dalembert.integrators
from dalembert.integrators.digest import digest_of, integrator_digest

SOURCES = Path(dalembert.integrators.__file__).parent

RUN = """
import sys
from dalembert.integrators.numba import explicit
loop = explicit._compiled_loop()
print(sum(loop.stats.cache_hits.values()), sum(loop.stats.cache_misses.values()))
"""


def test_digest_sees_names_and_contents(tmp_path):
    (tmp_path / "a.py").write_text("x = 1\n")
    first = digest_of(tmp_path)
    (tmp_path / "a.py").write_text("x = 2\n")
    second = digest_of(tmp_path)
    (tmp_path / "a.py").rename(tmp_path / "b.py")
    assert len({first, second, digest_of(tmp_path)}) == 3


def test_digest_covers_the_helpers_of_the_loop(tmp_path):
    copy = tmp_path / "integrators"
    shutil.copytree(SOURCES, copy, ignore=shutil.ignore_patterns("__pycache__"))
    assert digest_of(copy) == integrator_digest()
    stages = copy / "numba" / "stages.py"
    stages.write_text(stages.read_text() + "# edited\n")
    assert digest_of(copy) != integrator_digest()


def test_disk_cache_is_used_and_notices_an_edit_of_a_helper(tmp_path):
    package = tmp_path / "dalembert"
    shutil.copytree(SOURCES, package / "integrators", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(SOURCES.parent / "errors.py", package)
    (package / "__init__.py").touch()  # a folder without one would give way to an installed dalembert
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def hits_and_misses():
        done = subprocess.run(
            [sys.executable, "-c", RUN],
            capture_output=True,
            text=True,
            check=True,
            env=environment,
            cwd=tmp_path,
        )
        return tuple(map(int, done.stdout.split()))

    assert hits_and_misses() == (0, 1)
    assert hits_and_misses() == (1, 0)
    helper = package / "integrators" / "numba" / "control.py"
    helper.write_text(helper.read_text() + "\nEDITED = True\n")
    assert hits_and_misses() == (0, 1)
