import shutil
from pathlib import Path

import dalembert.loops
from dalembert.codegen.rendering import digest_of, generator_digest, template_directory

SOURCES = Path(dalembert.loops.__file__).parent


def test_digest_sees_names_and_contents(tmp_path):
    (tmp_path / "a.py").write_text("x = 1\n")
    first = digest_of(tmp_path)
    (tmp_path / "a.py").write_text("x = 2\n")
    second = digest_of(tmp_path)
    (tmp_path / "a.py").rename(tmp_path / "b.py")
    assert len({first, second, digest_of(tmp_path)}) == 3


def test_digest_covers_the_helpers_of_the_loop(tmp_path):
    copy = tmp_path / "loops"
    shutil.copytree(SOURCES, copy, ignore=shutil.ignore_patterns("__pycache__"))
    assert digest_of(copy) in generator_digest()
    stages = copy / "lane_loop.py"
    stages.write_text(stages.read_text() + "# edited\n")
    assert digest_of(copy) not in generator_digest()


def test_digest_covers_the_templates(tmp_path, monkeypatch):
    copy = tmp_path / "templates"
    shutil.copytree(template_directory(), copy)
    monkeypatch.setattr("dalembert.codegen.rendering.template_directory", lambda: copy)
    first = generator_digest.__wrapped__()
    assert first == generator_digest()
    template = copy / "numpy" / "module.py.j2"
    template.write_text(template.read_text() + "# edited\n")
    assert generator_digest.__wrapped__() != first
