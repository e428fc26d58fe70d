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
