"""What a notebook and a terminal show, and the pages of the documentation."""

import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

import dalembert as da
from textbook.helpers import point

ROOT = Path(__file__).parents[2]
HEADINGS = [
    "Constraints",
    "Kinematic screws",
    "Action screws and ideal joints",
    "Power coefficients",
    "Kinetic energy, all constraints ignored",
    "Lagrange equations",
    "Reactions",
    "Equations of motion, unknowns eliminated",
    "First integrals",
]


@pytest.fixture(scope="module")
def view():
    return da.lagrange(da.scenes.chaplygin_sleigh())


def test_report_follows_the_order_of_the_text(view):
    report = view.report()
    assert [section.title for section in report.sections] == HEADINGS
    lines = str(report).splitlines()
    assert [line for line in lines if line in HEADINGS] == HEADINGS
    assert max(map(len, lines)) < 400


def test_report_as_text(view):
    text = str(view)
    assert "N = 0" in text
    assert "x'' = " in text
    assert "Lagrange equation of theta: I_C*theta'' - b*m*sin(theta)*x'' + b*m*cos(theta)*y'' = N" in text


def test_report_as_markdown(view):
    markdown = view._repr_markdown_()
    assert r"\begin{Bmatrix}" in markdown
    assert r"\ddot{\theta}" in markdown
    assert markdown.count("$$") % 2 == 0


def test_screw_is_shown_in_a_notebook(view):
    screw = view.kinematic_screw("sleigh")
    assert screw._repr_latex_().startswith(r"$\displaystyle \begin{Bmatrix}")
    assert str(screw) == "{ theta'*N.z ; x'*N.x + y'*N.y + b*theta'*S.y } at G"


def test_screws_add_and_do_not_change(view):
    C = point(view.scene, "C")
    x, y, theta = view.coordinates
    whole = view.kinematic_screw("sleigh", C)
    total = 0
    for q in (x, y, theta):
        part = view.partial_kinematic_screw("sleigh", q, C)
        total = total + q.diff() * part.moment
    assert (total - whole.moment).to_matrix(view.scene.frame).is_zero_matrix
    with pytest.raises(AttributeError):
        whole.point = C
    assert (whole + whole).resultant == 2 * whole.resultant


def test_two_processes_give_the_same_report(view):
    """The order of symbols must not depend on the process."""
    code = "import dalembert as da; print(da.lagrange(da.scenes.chaplygin_sleigh()).report())"
    other = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={
            "PYTHONPATH": str(ROOT / "src"),
            "PYTHONHASHSEED": "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1",
        },
    ).stdout
    assert other == f"{view.report()}\n"


def test_textbook_is_imported_only_when_asked_for():
    code = "import sys, dalembert as da; assert 'dalembert.textbook' not in sys.modules; da.lagrange"
    subprocess.run([sys.executable, "-c", code], check=True, env={"PYTHONPATH": str(ROOT / "src")})
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        da.nonsense  # noqa: B018
    assert importlib.import_module("dalembert.textbook").Screw is da.Screw


def test_the_textbook_route_does_not_use_the_compiled_one():
    for file in (ROOT / "src" / "dalembert" / "textbook").glob("*.py"):
        text = file.read_text()
        assert "..ir" not in text
        assert "..mechanics" not in text
        assert "..reduction" not in text
