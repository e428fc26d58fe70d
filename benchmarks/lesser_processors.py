"""Processes in which every program finds a lesser processor, so that all compile for the same instructions.

``python benchmarks/lesser_processors.py`` prints which processor LLVM finds in such processes. They need Linux, a C
compiler, and a processor on which the instruction CPUID can be made to fault (Intel, also in most virtual machines).
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

__all__ = ["CANNOT_HIDE", "LESSER", "output_on"]

LESSER = ("x86-64-v2", "x86-64-v3")
SOURCE = Path(__file__).with_name("hidden_instructions.c")
CANNOT_HIDE = 3
"""Exit status of a process whose processor cannot hide instructions."""
NAME = "from llvmlite import binding; print(binding.get_host_cpu_name())"


def output_on(target: str, command: Sequence[str]) -> str:
    """Return the standard output of Python's `command` in a process for a target.

    Raises
    ------
    subprocess.CalledProcessError
        The process failed; with the status `CANNOT_HIDE` where instructions cannot be hidden.
    """
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "hidden_instructions.so"
        compiler = os.environ.get("CC", "cc")
        subprocess.run([compiler, "-O2", "-shared", "-fPIC", "-o", str(library), str(SOURCE)], check=True)
        hidden = {"DALEMBERT_TARGET": target, "LD_PRELOAD": str(library)}
        done = subprocess.run(
            [sys.executable, *command], env=os.environ | hidden, stdout=subprocess.PIPE, text=True, check=True
        )
    return done.stdout


if __name__ == "__main__":
    for each in LESSER:
        print(each, output_on(each, ["-c", NAME]).strip(), sep=": ")
