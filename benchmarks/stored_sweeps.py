"""Stored sweeps: throughput by workers against a plain sweep, cost of a task, ten million cases, and a plan.

``python benchmarks/stored_sweeps.py`` prints; ``--save`` writes the tables of docs/distributed.md, ``--quick`` takes
fewer cases. Workers are processes of a LocalCluster on this machine.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from measure import machine
from report import fill_page
from sympy import cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols
from tables import describe_machine, markdown_table

import dalembert as da

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "distributed.md"
MARKERS = ("<!-- distributed: begin (written by benchmarks/stored_sweeps.py) -->", "<!-- distributed: end -->")
SLEIGH = {"x": 0, "y": 0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
WORKERS = (1, 2, 4)
SCHEDULER = 1e-3
"""Seconds that the scheduler of dask takes for a task, at most, as its documentation says."""
BANDWIDTH = 1e9
"""Bytes a second that a shared file system takes from all nodes together, assumed."""
CORES = 32
"""Cores of a node, assumed."""

Work = tuple[Any, Mapping[str, Any], Mapping[str, Any], float]


def sleigh(count: int) -> Work:
    """Return model, initial values, parameters and span of sleighs."""
    model = da.compile_model(da.scenes.chaplygin_sleigh())
    return model, SLEIGH, {"m": 1, "b": np.linspace(0.1, 0.5, count), "I_C": 0.5}, 10.0


def double_pendulum(count: int) -> Work:
    """Return the same of double pendulums, which take some tens of microseconds a case."""
    a, b = dynamicsymbols("a b")
    m, l, g = symbols("m l g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", l * sin(a) * N.x - l * cos(a) * N.y)
    Q = P.locatenew("Q", l * sin(b) * N.x - l * cos(b) * N.y)
    scene = da.Scene("double_pendulum", frame=N, origin=O, coordinates=[a, b])
    scene.add_bodies(Particle("upper", P, m), Particle("lower", Q, m))
    scene.apply_uniform_gravity(-g * N.y)
    start = {"a": np.linspace(0.5, 2.5, count), "b": 0.3, "a_dot": 0, "b_dot": 0}
    return da.compile_model(scene), start, {"m": 1, "l": 1, "g": 9.81}, 20.0


def seconds_of(run: Any, repeat: int = 2) -> float:
    """Return the least seconds of some runs."""
    found = []
    for _ in range(repeat):
        begin = time.perf_counter()
        run()
        found.append(time.perf_counter() - begin)
    return min(found)


def throughput(name: str, work: Work, chunk: int, folder: Path) -> list[list[str]]:
    """Return rows: cases a second and core, of a plain sweep, a stored one, and clusters of workers."""
    from distributed import Client, LocalCluster

    model, start, parameters, end = work
    count = max(len(v) for v in {**start, **parameters}.values() if np.ndim(v))
    span = (0.0, end)
    plain = seconds_of(lambda: model.sweep(span, start, parameters, threads=1))
    rows = [[f"{name}: plain sweep, 1 thread", f"{1e6 * plain / count:.2f}", "100 %"]]

    def stored(client: Any = None, threads: int | None = 1) -> None:
        path = folder / "s.zarr"
        shutil.rmtree(path, ignore_errors=True)
        model.sweep(span, start, parameters, to=path, chunk=chunk, client=client, threads=threads)

    taken = seconds_of(stored)
    rows.append(
        [f"{name}: stored, this process, 1 thread", f"{1e6 * taken / count:.2f}", f"{100 * plain / taken:.0f} %"]
    )
    for workers in WORKERS:
        with (
            LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster,
            Client(cluster) as client,
        ):
            stored(client)  # every worker compiles once
            taken = seconds_of(lambda: stored(client))
        cores = min(workers, 2)
        share = f"{100 * plain / (taken * cores):.0f} %"
        rows.append([f"{name}: cluster, {workers} workers", f"{1e6 * taken * cores / count:.2f}", share])
    return rows


def task_seconds(folder: Path) -> float:
    """Return the seconds of a task of one case beyond its work, in a cluster of one worker."""
    from distributed import Client, LocalCluster

    model, start, parameters, end = sleigh(200)
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        model.sweep((0, end), start, parameters, to=folder / "warm.zarr", chunk=10, client=client)
        begin = time.perf_counter()
        model.sweep((0, end), start, parameters, to=folder / "tasks.zarr", chunk=1, client=client)
        return (time.perf_counter() - begin) / 200


def many(count: int, folder: Path) -> tuple[float, float, float, float]:
    """Return seconds, bytes of the store, growth of memory [bytes], and seconds of a map made of the store."""
    model, _, _, _ = sleigh(2)
    cases = da.random_cases(count, 1, b=da.uniform(0.1, 0.5), theta_dot=da.uniform(1.0, 3.0))
    start = {key: value for key, value in SLEIGH.items() if key != "theta_dot"}
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begin = time.perf_counter()
    stored = model.sweep((0, 10), start, {"m": 1, "I_C": 0.5}, grid=cases, to=folder / "many.zarr")
    seconds = time.perf_counter() - begin
    growth = 1024.0 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    size = float(sum(path.stat().st_size for path in (folder / "many.zarr").rglob("*") if path.is_file()))
    begin = time.perf_counter()
    import dask.array as array

    edges = [np.linspace(0.1, 0.5, 201), np.linspace(1.0, 3.0, 201)]
    columns = [stored[name].data for name in ("b", "theta_dot_given", "x")]
    array.histogramdd(columns[:2], bins=edges, weights=columns[2])[0].compute()
    return seconds, size, growth, time.perf_counter() - begin


def plan(us_a_case: float, bytes_a_case: float, task: float) -> list[list[str]]:
    """Return what large sweeps take by this machine's figures, and where the bottleneck lies."""
    rows = []
    for cases in (1e9, 1e12):
        for nodes in (10, 100, 1000):
            compute = cases * us_a_case * 1e-6 / (nodes * CORES)
            tasks = max(cases * bytes_a_case / (128 << 20), cases * us_a_case * 1e-6 / 4.0)
            parts = {
                "computing": compute,
                "the scheduler": tasks * SCHEDULER,
                "the store": cases * bytes_a_case / BANDWIDTH,
                "workers, between tasks": tasks * task / (nodes * CORES),
            }
            worst = max(parts, key=lambda name: parts[name])
            cells = [f"{parts[name]:.3g}" for name in parts]
            rows.append([f"{cases:.0e} cases, {nodes} nodes", *cells, worst])
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print, and save if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", action="store_true")
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args(arguments)
    scale = 10 if options.quick else 1
    folder = Path(tempfile.mkdtemp(prefix="stored-"))
    try:
        rows = throughput("sleigh", sleigh(2_000_000 // scale), 200_000 // scale, folder)
        rows += throughput("double pendulum", double_pendulum(300_000 // scale), 50_000 // scale, folder)
        task = task_seconds(folder)
        count = 10_000_000 // scale
        seconds, size, growth, drawn = many(count, folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    us = float(rows[-3][1])
    text = "\n\n".join(
        [
            f"Measured on {describe_machine(machine())}.",
            markdown_table(["", "us of a case and core", "of the plain sweep"], rows),
            f"A task of one case takes {1e3 * task:.1f} ms with one worker: sending it, its sweep, and writing a dozen"
            " files. Chunks of seconds make that less than 1 %.",
            f"{count:,} sleighs with random parameters: {seconds:.0f} s with both cores, {size / 1e9:.2f} GB of store,"
            f" {growth / 1e6:.0f} MB more memory. A map of 200 by 200 fields made of the store with dask:"
            f" {drawn:.1f} s.",
            "A plan past this machine, of double pendulums: seconds by what they are spent on, and the bottleneck."
            f" Nodes with {CORES} cores like these, {1e3 * SCHEDULER:g} ms a task in the scheduler, a store that takes"
            f" {BANDWIDTH / 1e9:g} GB/s.",
            markdown_table(
                ["", "computing", "scheduler", "store", "workers between tasks", "bottleneck"],
                plan(us, size / count, task),
            ),
        ]
    )
    print(text)
    if options.save:
        fill_page(PAGE, MARKERS, text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
