"""Stored sweeps: throughput by workers against a plain sweep, cost of a task, ten million cases, and a plan.

``python benchmarks/stored_sweeps.py`` prints; ``--save`` writes the tables of docs/distributed.md, ``--quick`` takes
fewer cases. Workers are processes of a LocalCluster on this machine.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
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
PENDULUM = "double pendulum"
SETTINGS = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.worker.memory.monitor-interval": "1s",
    "distributed.deploy.lost-worker-timeout": "10 minutes",
    "distributed.nanny.pre-spawn-environ": {
        "MALLOC_TRIM_THRESHOLD_": 1 << 30,
        "MALLOC_MMAP_THRESHOLD_": 1 << 30,
        "OMP_NUM_THREADS": 1,
    },
}
"""Settings of dask with which its processes take next to nothing for themselves, and keep memory for later."""
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
    """Return the same of double pendulums, which take some ten microseconds a case."""
    a, b = dynamicsymbols("a b")
    m, l, g = symbols("m l g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    P = O.locatenew("P", l * sin(a) * N.x - l * cos(a) * N.y)
    Q = P.locatenew("Q", l * sin(b) * N.x - l * cos(b) * N.y)
    scene = da.Scene("double_pendulum", frame=N, origin=O, coordinates=[a, b])
    scene.add_bodies(Particle("upper", P, m), Particle("lower", Q, m))
    scene.apply_uniform_gravity(-g * N.y)
    start = {"a": np.linspace(0.5, 2.5, count), "b": 0.3, "a_dot": 0, "b_dot": 0}
    return da.compile_model(scene), start, {"m": 1, "l": 1, "g": 9.81}, 8.0


@dataclass(frozen=True)
class Cost:
    """CPU seconds of all processes that took part in a run, and its seconds by the clock."""

    cpu: float
    wall: float


def cost_of(run: Any, client: Any = None) -> Cost:
    """Return what a run costs: of this process, which has the scheduler too, and of the workers of a client."""
    workers = (lambda: sum(client.run(time.process_time).values())) if client else (lambda: 0.0)
    before, begin, own = workers(), time.perf_counter(), time.process_time()
    run()
    wall, own = time.perf_counter() - begin, time.process_time() - own
    return Cost(own + workers() - before, wall)


def least(costs: Sequence[Cost]) -> Cost:
    """Return the least CPU seconds, and the least seconds by the clock, of some runs."""
    return Cost(min(c.cpu for c in costs), min(c.wall for c in costs))


def stored(work: Work, chunk: int | None, folder: Path, client: Any = None, threads: int | None = 1) -> Any:
    """Return what runs a sweep into a new store."""
    model, start, parameters, end = work

    def run() -> None:
        shutil.rmtree(folder / "s.zarr", ignore_errors=True)
        model.sweep((0.0, end), start, parameters, to=folder / "s.zarr", chunk=chunk, client=client, threads=threads)

    return run


def size_of(work: Work) -> int:
    """Return the number of cases."""
    _, start, parameters, _ = work
    return max(len(v) for v in {**start, **parameters}.values() if np.ndim(v))


def throughput(
    works: Mapping[str, tuple[Work, int]], folder: Path, repeat: int
) -> tuple[list[list[str]], dict[str, Cost]]:
    """Return rows, and costs by the names of their runs: plain sweeps, stored ones, clusters, all in alternation."""
    found: dict[str, list[Cost]] = {}
    shares: dict[str, list[tuple[float, float]]] = {}

    def measure(name: str, work: Work, run: Any, cores: int, client: Any = None) -> None:
        model, start, parameters, end = work
        run()  # compiles
        for _ in range(repeat):
            plain = cost_of(lambda: model.sweep((0.0, end), start, parameters, threads=1))
            cost = cost_of(run, client)
            found.setdefault(f"{name.split(':')[0]}: plain sweep, 1 thread", []).append(plain)
            found.setdefault(name, []).append(cost)
            shares.setdefault(name, []).append((plain.cpu / cost.cpu, plain.wall / (cost.wall * cores)))

    for name, (work, chunk) in works.items():
        measure(f"{name}: stored, 1 thread", work, stored(work, chunk, folder), 1)
        measure(f"{name}: stored, 2 threads", work, stored(work, chunk, folder, threads=2), 2)
    for workers in WORKERS:
        with cluster_of(workers) as client:
            for name, (work, chunk) in works.items():
                run = stored(work, chunk, folder, client)
                measure(f"{name}: cluster, {workers} workers", work, run, min(workers, 2), client)
    rows = []
    for name in sorted(found, key=lambda text: (list(works).index(text.split(":")[0]), "plain" not in text)):
        work, _ = works[name.split(":")[0]]
        cost = least(found[name])
        cells = [f"{100 * max(s[k] for s in shares[name]):.0f} %" for k in (0, 1)] if name in shares else ["", ""]
        rows.append([name, f"{1e6 * cost.cpu / size_of(work):.2f}", *cells])
    return rows, {name: least(costs) for name, costs in found.items()}


@contextmanager
def cluster_of(workers: int) -> Iterator[Any]:
    """Yield the client of a cluster of processes of one thread, with the settings of docs/distributed.md."""
    import dask
    from distributed import Client, LocalCluster

    with (
        dask.config.set(SETTINGS),
        LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        yield client


def task_cost(client: Any, folder: Path) -> Cost:
    """Return what a task of one case costs beyond its work."""
    run, once = stored(sleigh(61), 1, folder, client), stored(sleigh(61), 61, folder, client)
    run()
    one, few = (least([cost_of(each, client) for _ in range(2)]) for each in (run, once))
    return Cost((one.cpu - few.cpu) / 60, (one.wall - few.wall) / 60)


def many(count: int, folder: Path) -> dict[str, float]:
    """Return what a process needed for so many random sleighs, which ran them alone, and for a map of them."""
    command = [sys.executable, __file__, "--alone", f"{count}", f"{folder}"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def alone(count: int, folder: Path) -> dict[str, float]:
    """Return seconds, bytes of the store, the most memory of the process [bytes], and seconds of a map."""
    model, _, _, _ = sleigh(2)
    cases = da.random_cases(count, 1, b=da.uniform(0.1, 0.5), theta_dot=da.uniform(1.0, 3.0))
    start = {key: value for key, value in SLEIGH.items() if key != "theta_dot"}
    found: list[Any] = []

    def run() -> None:
        found.append(model.sweep((0, 10), start, {"m": 1, "I_C": 0.5}, grid=cases, to=folder / "many.zarr"))

    cost = cost_of(run)
    memory = 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    size = float(sum(path.stat().st_size for path in (folder / "many.zarr").rglob("*") if path.is_file()))
    begin = time.perf_counter()
    import dask.array as array

    edges = [np.linspace(0.1, 0.5, 201), np.linspace(1.0, 3.0, 201)]
    columns = [found[0][name].data for name in ("b", "theta_dot_given", "x")]
    array.histogramdd(columns[:2], bins=edges, weights=columns[2])[0].compute()
    drawn = time.perf_counter() - begin
    shutil.rmtree(folder / "many.zarr")
    return {"cpu": cost.cpu, "wall": cost.wall, "size": size, "memory": memory, "map": drawn}


def checked(
    costs: Mapping[str, Cost], works: Mapping[str, tuple[Work, int]], task: Cost, client: Any, folder: Path
) -> list[list[str]]:
    """Return rows of CPU seconds that the plan says and that were measured, of runs by which it was not fitted."""
    rows = []
    for name, (work, chunk) in works.items():
        a_case = costs[f"{name}: stored, 1 thread"].cpu / size_of(work)
        for part in (chunk // 5, chunk // 25):
            tasks = -(-size_of(work) // part)
            planned = size_of(work) * a_case + tasks * task.cpu
            run = stored(work, part, folder, client)
            measured = least([cost_of(run, client) for _ in range(2)])
            told = [f"{planned:.2f}", f"{measured.cpu:.2f}", f"{planned / measured.cpu:.2f}"]
            rows.append([f"{name}: {tasks} tasks of {part:,} cases", *told])
    return rows


def plan(seconds_a_case: float, bytes_a_case: float, task: float) -> list[list[str]]:
    """Return what large sweeps take by this machine's figures, and where the bottleneck lies."""
    rows = []
    for cases in (1e9, 1e12):
        for nodes in (10, 100, 1000):
            compute = cases * seconds_a_case / (nodes * CORES)
            tasks = max(cases * bytes_a_case / (128 << 20), cases * seconds_a_case / 4.0)
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
    parser.add_argument("--repeat", type=int, default=2, help="runs of each kind")
    parser.add_argument(
        "--many", type=float, default=1e7, help="random sleighs of the large sweep; 70 bytes of disk each"
    )
    parser.add_argument("--alone", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.alone:
        print(json.dumps(alone(int(options.alone[0]), Path(options.alone[1]))))
        return 0
    scale, count = (10, 1_000_000) if options.quick else (1, int(options.many))
    folder = Path(tempfile.mkdtemp(prefix="stored-"))
    works = {
        "sleigh": (sleigh(1_600_000 // scale), 400_000 // scale),
        PENDULUM: (double_pendulum(300_000 // scale), 75_000 // scale),
    }
    try:
        rows, costs = throughput(works, folder, 1 if options.quick else options.repeat)
        with cluster_of(1) as client:
            task = task_cost(client, folder)
            checks = checked(costs, works, task, client, folder)
        large = many(count, folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    text = written(rows, costs, works, task, checks, count, large)
    print(text)
    if options.save:
        fill_page(PAGE, MARKERS, text)
    return 0


def written(
    rows: list[list[str]],
    costs: Mapping[str, Cost],
    works: Mapping[str, tuple[Work, int]],
    task: Cost,
    checks: list[list[str]],
    count: int,
    large: Mapping[str, float],
) -> str:
    """Return the text of the page."""
    a_case = costs[f"{PENDULUM}: stored, 1 thread"].cpu / size_of(works[PENDULUM][0])
    return "\n\n".join(
        [
            f"Measured on {describe_machine(machine())}. Times are CPU times of all processes together, the scheduler"
            " and the client among them, because other programs ran; every stored run follows a plain one, and the"
            " shares are the best of the pairs. By the clock, shares are of a plain run in one thread per core taken,"
            " of which there were two at most.",
            markdown_table(["", "us of CPU a case", "of the plain sweep", "by the clock"], rows),
            f"A task of one case takes {1e3 * task.cpu:.1f} ms of CPU, {1e3 * task.wall:.1f} ms by the clock with one"
            " worker: sending it, its sweep, and writing a dozen files. Chunks of seconds make that less than 1 %.",
            f"{count:,} sleighs with random parameters, in a process of their own: {large['cpu']:.0f} s of CPU,"
            f" {large['wall']:.0f} s by the clock, {large['size'] / 1e9:.2f} GB of store,"
            f" {large['memory'] / 1e6:.0f} MB of memory at most, Python and packages among them. A map of 200 by"
            f" 200 fields made of the store with dask: {large['map']:.1f} s.",
            "What the plan below says, cases times their cost in one thread and tasks times theirs, against runs by"
            " one worker with smaller chunks [CPU s]:",
            markdown_table(["", "planned", "measured", "ratio"], checks),
            f"A plan past this machine, of double pendulums of {1e6 * a_case:.0f} us: seconds by what they are spent"
            f" on, and the bottleneck. Nodes with {CORES} cores like these, {1e3 * SCHEDULER:g} ms a task in the"
            f" scheduler, a store that takes {BANDWIDTH / 1e9:g} GB/s.",
            markdown_table(
                ["", "computing", "scheduler", "store", "workers between tasks", "bottleneck"],
                plan(a_case, large["size"] / count, task.wall),
            ),
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
