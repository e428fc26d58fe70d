import shutil
from pathlib import Path

import dalembert.integrators
from dalembert.codegen.generator_digest import digest_of, generator_digest

SOURCES = Path(dalembert.integrators.__file__).parent


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
    assert generator_digest().endswith(digest_of(copy))
    stages = copy / "llvm" / "pipeline.py"
    stages.write_text(stages.read_text() + "# edited\n")
    assert not generator_digest().endswith(digest_of(copy))
