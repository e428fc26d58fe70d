"""The scripts of the gallery run, say what they ask, and draw a picture."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SCRIPTS = sorted((ROOT / "docs" / "gallery").glob("*.py"))


@pytest.fixture(scope="module")
def runner():
    """Return a process that runs scripts (`script_runner`), in which their warnings are errors."""
    environment = {**os.environ, "PYTHONWARNINGS": "error::UserWarning"}
    command = [sys.executable, Path(__file__).with_name("script_runner.py")]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, **pipes, text=True, env=environment, cwd=ROOT) as process:
        yield process


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_script_runs_and_draws(script, runner, tmp_path):
    log = tmp_path / "log"
    print(script, log, sep="\t", file=runner.stdin, flush=True)
    status = runner.stdout.readline().strip()
    assert status == "0", f"exit status {status}: {log.read_text() if log.exists() else 'nothing was run'}"


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_script_asks_a_question(script):
    title, rule = script.read_text().splitlines()[1:3]
    assert title.endswith("?")
    assert re.fullmatch("=+", rule) and len(rule) == len(title)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_script_fits_the_page_and_leaves_its_style_to_the_site(script):
    text = script.read_text(encoding="utf-8")
    assert [line for line in text.splitlines() if len(line) > 79] == []  # longer lines must be scrolled
    assert not re.search(r"figsize|rcParams|layout=|plt\.style", text)


def test_figures_have_the_shape_of_a_thumbnail():
    style = dict(re.findall(r"^([\w.]+): (.*)$", (ROOT / "docs" / "figures.mplstyle").read_text("utf-8"), re.M))
    width, height = map(float, style["figure.figsize"].split(","))
    wide, high = re.search(
        r'"thumbnail_size": \((\d+), (\d+)\)', (ROOT / "docs" / "conf.py").read_text("utf-8")
    ).groups()
    assert width / height == pytest.approx(int(wide) / int(high))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_page_of_several_figures_chooses_its_cover(script):
    text = script.read_text(encoding="utf-8")
    if len(re.findall(r"plt\.subplots\(|\.animate\(", text)) > 1:
        assert len(re.findall(r"^# sphinx_gallery_thumbnail_number = (?:\d+|-1)$", text, re.M)) == 1
