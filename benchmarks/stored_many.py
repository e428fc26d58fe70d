"""A stored sweep of very many random sleighs in a process of its own: time, disk and memory, and a map of them.

``python benchmarks/stored_many.py`` prints; ``--save`` writes it into docs/stored_measured.md. A hundred million
cases need 7 GB of disk.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from measure import machine
from report import fill_page
from tables import describe_machine

import dalembert as da

__all__ = ["PAGE", "SLEIGH", "many", "told"]

PAGE = Path(__file__).resolve().parents[1] / "docs" / "stored_measured.md"
MARKERS = ("<!-- many: begin (written by benchmarks/stored_many.py) -->", "<!-- many: end -->")
SLEIGH = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
LIMIT = 1 << 30
"""Bytes of memory that a hundred million cases may take."""


def many(count: int, folder: Path) -> dict[str, float]:
    """Return what a process needed for so many random sleighs, which ran them alone, and for a map of them."""
    command = [sys.executable, __file__, "--alone", f"{count}", f"{folder}"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def alone(count: int, folder: Path) -> dict[str, float]:
    """Return seconds, bytes of the store, the most memory of the process [bytes], and seconds of a map."""
    model = da.compile_model(da.scenes.chaplygin_sleigh())
    cases = da.random_cases(count, 1, b=da.uniform(0.1, 0.5), theta_dot=da.uniform(1.0, 3.0))
    start = {key: value for key, value in SLEIGH.items() if key != "theta_dot"}
    begin, own = time.perf_counter(), time.process_time()
    found: Any = model.sweep((0, 10), start, {"m": 1, "I_C": 0.5}, grid=cases, to=folder / "many.zarr")
    wall, cpu = time.perf_counter() - begin, time.process_time() - own
    memory = most_memory()
    size = float(sum(path.stat().st_size for path in (folder / "many.zarr").rglob("*") if path.is_file()))
    begin = time.perf_counter()
    import dask.array as array

    edges = [np.linspace(0.1, 0.5, 201), np.linspace(1.0, 3.0, 201)]
    columns = [found[name].data for name in ("b", "theta_dot_given", "x")]
    array.histogramdd(columns[:2], bins=edges, weights=columns[2])[0].compute()
    drawn = time.perf_counter() - begin
    shutil.rmtree(folder / "many.zarr")
    return {"cpu": cpu, "wall": wall, "size": size, "memory": memory, "map": drawn}


def most_memory() -> float:
    """Return the most memory that this process had [bytes].

    ``getrusage`` counts that of the process which started this one, too.
    """
    status = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return 1024.0 * next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))


def told(count: int, large: Mapping[str, float]) -> str:
    """Return the sentences about so many cases."""
    return (
        f"{count:,} sleighs with random parameters, in a process of their own: {large['cpu']:.0f} s of CPU,"
        f" {large['wall']:.0f} s by the clock, {large['size'] / 1e9:.2f} GB of store, {large['memory'] / 1e6:.0f} MB of"
        " memory at most, Python and packages among them. A map of 200 by 200 fields made of the store with dask:"
        f" {large['map']:.1f} s."
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print, and save if asked; the status is 1 where it took more memory than it may."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", action="store_true")
    parser.add_argument("--cases", type=float, default=1e8)
    parser.add_argument("--alone", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.alone:
        print(json.dumps(alone(int(options.alone[0]), Path(options.alone[1]))))
        return 0
    folder, count = Path(tempfile.mkdtemp(prefix="stored-")), int(options.cases)
    try:
        large = many(count, folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    text = f"{told(count, large)} Measured on {describe_machine(machine())}."
    print(text)
    if options.save:
        fill_page(PAGE, MARKERS, text)
    return int(large["memory"] >= LIMIT)


if __name__ == "__main__":
    sys.exit(main())
