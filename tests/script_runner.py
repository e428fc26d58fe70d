"""Runs scripts that draw: ``python tests/script_runner.py``, a path and a tabulator and the path of a log in each line.

Each runs in a fork of this process, which has imported what all of them import first, and what it writes goes to its
log. Its exit status is printed.
"""

import os
import runpy
import sys
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt

import dalembert as da

STYLE = Path(__file__).parents[1] / "docs" / "figures.mplstyle"


def run(script: str, log: str) -> None:
    """Run a script in this process, which must end after that."""
    with open(log, "wb") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    runpy.run_path(script, run_name="__main__")
    assert plt.get_fignums(), "no picture"


def main() -> None:
    """Fork for each line."""
    da.compile_model(da.scenes.chaplygin_sleigh(), backend="numpy")
    plt.style.use(STYLE)
    for line in sys.stdin:
        child = os.fork()
        if not child:
            return run(*line.rstrip("\n").split("\t"))
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


if __name__ == "__main__":
    main()
