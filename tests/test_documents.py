"""The Python of the documents runs as it is written, block by block, and prints what stands below it."""

import contextlib
import importlib
import inspect
import io
import pkgutil
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import dalembert as da
from dalembert.results.sweep import Sweep
from dalembert.results.trajectory import Trajectory

pytestmark = pytest.mark.usefixtures("quick_xla")

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SHOWN = re.compile(r"^```python\n(?P<code>.*?)^```$(?:\n\n```text\n(?P<output>.*?)^```$)?", re.MULTILINE | re.DOTALL)
PEERS = re.compile(r"^```py\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INSIDE = sorted((ROOT / "docs" / "inside").glob("*.md"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *INSIDE]
LINKED = [*PAGES, ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs" / "examples").glob("*.md"))]
DESIGN = ROOT / "docs" / "design.md"
INDENTED = re.compile(r"^( +)```python\n(.*?)^ +```$", re.MULTILINE | re.DOTALL)


def blocks(page):
    return BLOCK.findall(page.read_text())


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page)], ids=lambda page: page.name)
def test_code_runs_as_written(page):
    if (script := page.with_suffix(".py")).exists():
        quoted = {line.strip() for block in blocks(page) for line in block.splitlines()}
        assert quoted <= {line.strip() for line in script.read_text().splitlines()}
        return
    names = {}
    for number, block in enumerate(SHOWN.finditer(page.read_text()), 1):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(block["code"], f"{page.name}, block {number}", "exec"), names)
        if block["output"] is not None:
            assert printed.getvalue() == block["output"], f"{page.name}, block {number}"
    assert all(np.all(run.success) for run in names.values() if isinstance(run, Trajectory | Sweep))


PEER_PAGES = [page for page in PAGES if page.name.startswith("from_") and PEERS.search(page.read_text())]


@pytest.mark.parametrize("page", PEER_PAGES, ids=lambda page: page.name)
def test_code_of_other_packages_gives_the_same_motion(page):
    """Pages for those who come from another package show its code as ``py``: it runs where that is installed."""
    text, ends = page.read_text(), []
    for block in (BLOCK.search(text)[1], PEERS.search(text)[1]):
        for package in re.findall(r"^(?:import|from) (\w+)", block, re.M):
            pytest.importorskip(package)
        names = {}
        exec(compile(block, page.name, "exec"), names)
        ends.append(names["end"])
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-7)


@pytest.mark.parametrize(
    "page", [page for page in PAGES if INDENTED.search(page.read_text())], ids=lambda page: page.name
)
def test_code_in_lists_is_python(page):
    """Such fragments take names from the sentences around them."""
    for indent, code in INDENTED.findall(page.read_text()):
        compile(re.sub(f"^{indent}", "", code, flags=re.MULTILINE), page.name, "exec")


def test_tutorial_shows_what_each_stage_prints():
    """Every stage of the pipeline is called, and every block that prints has its output below it."""
    shown = list(SHOWN.finditer((ROOT / "docs" / "tutorial.md").read_text()))
    assert all((block["output"] is not None) == bool(re.search(r"^ *print\(", block["code"], re.M)) for block in shown)
    code = "".join(block["code"] for block in shown)
    stages = ("read", "derive", "HybridAutomaton.of", "reduce", "lower", "backend.render", "backend.load", "simulate")
    for stage in stages:
        assert f"{stage}(" in code, stage


@pytest.mark.parametrize("page", LINKED, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target, anchor in re.findall(r"\]\(([^)#:\s]*)(?:#([\w-]+))?\)", page.read_text()):
        other = page.parent / target if target else page
        assert other.exists(), target
        if anchor:
            heads = re.findall(r"^#+ (.*)$", other.read_text(), re.MULTILINE)
            assert anchor in {re.sub(r"[^\w -]", "", head).lower().replace(" ", "-") for head in heads}, anchor


def test_the_site_builds_without_a_warning(tmp_path):
    """The gallery is not executed here: `test_gallery` does that.

    Without searches for garbage it takes three quarters of the time.
    """
    pytest.importorskip("sphinx")
    shutil.rmtree(ROOT / "docs" / "generated", ignore_errors=True)  # pages of scripts that are gone
    build = "import gc, runpy; gc.disable(); runpy.run_module('sphinx', run_name='__main__')"
    command = [sys.executable, "-c", build, "-q", "-W", "--keep-going", "-D", "plot_gallery=0"]
    done = subprocess.run([*command, ROOT / "docs", tmp_path / "site"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    site = tmp_path / "site"
    assert "compile_model" in (site / "reference.html").read_text()
    assert "site.css" in (site / "index.html").read_text()


def _sources():
    """Return the text of every module and package by its name within the package."""
    root = Path(da.__file__).parent
    texts = {path.relative_to(root).with_suffix("").as_posix().replace("/", "."): path for path in root.rglob("*.py")}
    return {name.removesuffix(".__init__"): path.read_text() for name, path in texts.items()}


def _exists(name, sources):
    """Return whether a dotted name is a module, or something that a module or a class of the package has."""
    first, *rest = name.removeprefix("dalembert.").split(".")
    having = [text for text in sources.values() if f"\nclass {first}" in text]
    if any(re.search(rf"^class {first}\b", text, re.M) and re.search(rf"\b{rest[0]}\b", text) for text in having):
        return True
    for end in range(len(rest) + 1, 0, -1):
        head, below = ".".join([first, *rest][:end]), [first, *rest][end:]
        found = [text for module, text in sources.items() if module == head or module.endswith(f".{head}")]
        if found:
            return not below or any(re.search(rf"\b{below[0]}\b", text) for text in found)
    return False


def test_names_on_the_design_pages_exist():
    """A dotted name there is that of a module, or of something that a module or class of the package has."""
    pages = "\n".join(page.read_text() for page in (DESIGN, *INSIDE))
    text = re.sub(r"^```.*?^```$", "", pages, flags=re.M | re.S)
    names = {name for name in re.findall(r"`(\w+(?:\.\w+)+)`", text) if not name.endswith((".py", ".md", ".json"))}
    sources = _sources()
    others = {"da", "model", "stages", "functools"}
    missing = sorted(name for name in names if name.split(".")[0] not in others and not _exists(name, sources))
    assert len(names) > 100
    assert not missing


def _decisions():
    """Return the names in the second column of the table of decisions."""
    section = DESIGN.read_text().split("## Decisions\n")[1].split("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("|")][2:]
    found = set()
    for row in rows:
        module = ""
        for name in re.findall(r"`([\w.]+)`", row.split("|")[2]):
            if "." in name or name == "options":
                module = name
                found.add(name)
            else:
                found.add(f"{module}.{name}")
    return found


def test_the_reading_order_is_short():
    """A dozen files of ordinary length explain the whole."""
    section = DESIGN.read_text().split("## Reading order\n")[1]
    files = re.findall(r"^\d+\. `([\w/]+\.py)`: ", section, re.M)
    assert 8 <= len(files) <= 12
    for file in files:
        assert len((ROOT / "src" / "dalembert" / file).read_text().splitlines()) <= 330, file


def test_pages_of_the_inside_are_short():
    words = {page: len(page.read_text().split()) for page in (DESIGN, *INSIDE)}
    assert words.pop(DESIGN) < 1000
    assert all(count <= 350 for count in words.values()), words
    packages = {path.name for path in (ROOT / "src" / "dalembert").iterdir()}
    assert {page.stem for page in INSIDE} <= {name.removesuffix(".py") for name in packages}


def test_the_table_of_decisions_names_what_there_is():
    assert len(_decisions()) > 50
    for name in _decisions():
        pkgutil.resolve_name(f"dalembert.{name}")


@pytest.mark.parametrize("module", ["steps.step_control", "steps.projection", "events.event_rules"])
def test_the_table_of_decisions_has_every_one_of(module):
    known = importlib.import_module(f"dalembert.{module}")
    public = {
        name
        for name, value in inspect.getmembers(known, inspect.isroutine)
        if value.__module__ == known.__name__ and name[0] != "_"
    }
    assert public == {name.rpartition(".")[2] for name in _decisions() if name.startswith(f"{module}.")}
