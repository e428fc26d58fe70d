"""What a user gets from the sdist and the wheel, and what `import dalembert` costs."""

import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from dataclasses import dataclass
from pathlib import Path

import pytest

import dalembert

ROOT = Path(__file__).resolve().parent.parent
HEAVY = ("jax", "matplotlib", "numba", "scipy", "xarray")
LATER = ("dalembert.compiler", "dalembert.mechanics", "dalembert.reduction", "dalembert.runs", "dalembert.results")

SIMULATE_INSTALLED_WHEEL = """
import sys
from pathlib import Path

installed, checkout_src = sys.argv[1:]
sys.path[:] = [installed, *(p for p in sys.path if p != checkout_src)]

import dalembert as da

assert Path(da.__file__).is_relative_to(installed), da.__file__
model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="llvm")
initial = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
trajectory = model.simulate((0, 1), initial, {"m": 1, "b": 0.3, "I_C": 0.5})
assert trajectory.success, trajectory.message
assert trajectory.t[-1] == 1
"""

TIME_IMPORT = """
import sys
from time import perf_counter

start = perf_counter()
import dalembert
seconds = perf_counter() - start
print(seconds, *(name for name in sys.argv[1:] if name in sys.modules))
"""


def run(*command: str | Path, cwd: Path, **environment: str) -> str:
    result = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=os.environ | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
    )
    assert result.returncode == 0, result.stdout
    return result.stdout


@dataclass(frozen=True)
class Distributions:
    sdist: Path
    wheel_from_sdist: Path
    wheel_from_checkout: Path


@pytest.fixture(scope="module")
def distributions(tmp_path_factory: pytest.TempPathFactory) -> Distributions:
    from_sdist = tmp_path_factory.mktemp("from_sdist")
    from_checkout = tmp_path_factory.mktemp("from_checkout")
    build = (sys.executable, "-m", "build", "--no-isolation")
    # Without --wheel, build makes the sdist from the checkout and then the wheel from that sdist.
    run(*build, "--outdir", from_sdist, ROOT, cwd=from_sdist)
    run(*build, "--wheel", "--outdir", from_checkout, ROOT, cwd=from_checkout)
    (sdist,) = from_sdist.glob("*.tar.gz")
    (wheel_from_sdist,) = from_sdist.glob("*.whl")
    (wheel_from_checkout,) = from_checkout.glob("*.whl")
    return Distributions(sdist, wheel_from_sdist, wheel_from_checkout)


def names_in_sdist(sdist: Path) -> set[str]:
    with tarfile.open(sdist) as archive:
        return {member.name.partition("/")[2] for member in archive.getmembers() if member.isfile()}


def contents_of_wheel(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def templates_in_checkout() -> dict[str, bytes]:
    folder = ROOT / "codegen_templates"
    files = (path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def test_the_templates_are_in_the_sdist_and_in_the_wheel(distributions: Distributions) -> None:
    templates = templates_in_checkout()
    assert templates
    assert {f"codegen_templates/{name}" for name in templates} <= names_in_sdist(distributions.sdist)
    prefix = "dalembert/codegen/templates/"
    packaged = {
        name.removeprefix(prefix): content
        for name, content in contents_of_wheel(distributions.wheel_from_sdist).items()
        if name.startswith(prefix)
    }
    assert packaged == templates


def test_the_wheel_is_the_same_from_the_sdist_and_from_the_checkout(distributions: Distributions) -> None:
    wheel = contents_of_wheel(distributions.wheel_from_sdist)
    assert wheel == contents_of_wheel(distributions.wheel_from_checkout)
    assert "dalembert/py.typed" in wheel


def test_an_installed_wheel_compiles_and_simulates(distributions: Distributions, tmp_path: Path) -> None:
    installed = tmp_path / "installed"
    pip = (sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--no-compile")
    run(*pip, "--target", installed, distributions.wheel_from_sdist, cwd=tmp_path)
    # -I keeps the working directory and PYTHONPATH out; a fresh cache makes the wheel render its templates.
    python = (sys.executable, "-I", "-c", SIMULATE_INSTALLED_WHEEL)
    run(*python, installed, ROOT / "src", cwd=tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"))


def test_import_leaves_heavy_dependencies_alone(tmp_path: Path) -> None:
    """What makes importing slow is not imported; `make demo` prints the seconds."""
    _, *imported = run(sys.executable, "-c", TIME_IMPORT, *HEAVY, *LATER, cwd=tmp_path).split()
    assert imported == []


def test_public_names_are_all_there_and_no_others() -> None:
    assert {name for name in dir(dalembert) if getattr(dalembert, name) is not None} == {*dalembert.__all__}
    with pytest.raises(AttributeError, match="module 'dalembert' has no attribute 'compile'"):
        dalembert.compile  # noqa: B018


def test_the_version_is_one():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    cited = re.search(r'^version: "(.+)"$', (ROOT / "CITATION.cff").read_text(), re.M)
    assert project == dalembert.__version__ == cited[1]
    changes = re.findall(r"^## (?:Unreleased \()?([\d.]+)", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert project in changes and changes == sorted(changes, reverse=True)
