"""Stored sweeps: throughput by workers against a plain sweep, cost of a task, ten million cases, and a plan.

``python benchmarks/stored_sweeps.py`` prints; ``--save`` writes stored_*.csv and docs/stored_measured.md, ``--quick``
takes fewer cases. Workers are processes of a LocalCluster on this machine. With ``--repeat 3`` it takes some five
minutes on two free cores.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
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
from saved_tables import save
from stored_many import PAGE, SLEIGH, many
from stored_start import start_rows
from sympy import cos, sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols
from tables import describe_machine, markdown_table

import dalembert as da

MARKERS = ("<!-- distributed: begin (written by benchmarks/stored_sweeps.py) -->", "<!-- distributed: end -->")
WORKERS, CORES_HERE = (1, 2, 4), 2
"""Workers of clusters, and the cores that they and plain sweeps may share."""
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
Rows = list[list[str]]


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


@dataclass(frozen=True)
class Stored:
    """What runs a sweep into a new store, and what it costs, without the removal of the store before."""

    work: Work
    chunk: int | None
    folder: Path
    client: Any = None
    threads: int = 1

    def cost(self) -> Cost:
        """Return the cost of one run."""
        model, start, parameters, end = self.work
        path = self.folder / "s.zarr"
        shutil.rmtree(path, ignore_errors=True)
        options = {"chunk": self.chunk, "client": self.client, "threads": self.threads}
        return cost_of(lambda: model.sweep((0.0, end), start, parameters, to=path, **options), self.client)


def first_case(work: Work) -> tuple[Any, dict[str, float], dict[str, float]]:
    """Return model, initial values and parameters of the first case."""
    model, *given, _ = work
    start, parameters = ({name: float(np.ravel(v)[0]) for name, v in each.items()} for each in given)
    return model, start, parameters


def size_of(work: Work) -> int:
    """Return the number of cases."""
    _, start, parameters, _ = work
    return max(len(v) for v in {**start, **parameters}.values() if np.ndim(v))


def throughput(works: Mapping[str, tuple[Work, int]], folder: Path, repeat: int) -> tuple[Rows, dict[str, Cost]]:
    """Return rows, and costs by the names of their runs; each stored one follows a plain one on as many cores."""
    found: dict[str, list[Cost]] = {}
    shares: dict[str, list[tuple[float, float]]] = {}

    def measure(name: str, case: str, run: Stored, cores: int) -> None:
        model, start, parameters, end = run.work
        run.cost()  # compiles
        for _ in range(repeat):
            plain = cost_of(lambda: model.sweep((0.0, end), start, parameters, threads=cores))
            cost = run.cost()
            found.setdefault(f"{case}: plain sweep, {_counted(cores, 'thread')}", []).append(plain)
            found.setdefault(name, []).append(cost)
            shares.setdefault(name, []).append((plain.cpu / cost.cpu, plain.wall / cost.wall))

    for case, (work, chunk) in works.items():
        for threads in range(1, CORES_HERE + 1):
            name = f"{case}: stored, {_counted(threads, 'thread')}"
            measure(name, case, Stored(work, chunk, folder, threads=threads), threads)
    for workers in WORKERS:
        with cluster_of(workers) as client:
            for case, (work, chunk) in works.items():
                name = f"{case}: cluster, {_counted(workers, 'worker')}"
                measure(name, case, Stored(work, chunk, folder, client), min(workers, CORES_HERE))
    rows = []
    for name in sorted(found, key=lambda text: (list(works).index(text.split(":")[0]), "plain" not in text)):
        work, _ = works[name.split(":")[0]]
        told = [1e6 * least(found[name]).cpu / size_of(work), size_of(work) / least(found[name]).wall / 1e6]
        cells = [
            f"{100 * statistics.median(s[k] for s in shares[name]):.0f} %" if name in shares else "" for k in (0, 1)
        ]
        rows.append([name, *(f"{value:.3g}" for value in told), *cells])
    return rows, {name: least(costs) for name, costs in found.items()}


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" + "s" * (count > 1)


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
    one, once = (Stored(sleigh(61), chunk, folder, client) for chunk in (1, 61))
    one.cost()
    many, few = (least([each.cost() for _ in range(2)]) for each in (one, once))
    return Cost((many.cpu - few.cpu) / 60, (many.wall - few.wall) / 60)


def case_cost(name: str, works: Mapping[str, tuple[Work, int]], costs: Mapping[str, Cost], task: Cost) -> float:
    """Return CPU seconds of a case by one worker, without those of its task."""
    work, chunk = works[name]
    return costs[f"{name}: cluster, 1 worker"].cpu / size_of(work) - task.cpu / chunk


def checked(
    costs: Mapping[str, Cost], works: Mapping[str, tuple[Work, int]], task: Cost, client: Any, folder: Path
) -> Rows:
    """Return rows of CPU seconds that the plan says and that were measured, of runs by which it was not fitted."""
    rows = []
    for name, (work, chunk) in works.items():
        a_case = case_cost(name, works, costs, task)
        for part in (chunk // 5, chunk // 25):
            tasks = -(-size_of(work) // part)
            planned = size_of(work) * a_case + tasks * task.cpu
            run = Stored(work, part, folder, client)
            measured = least([run.cost() for _ in range(2)])
            told = [f"{planned:.2f}", f"{measured.cpu:.2f}", f"{planned / measured.cpu:.2f}"]
            rows.append([f"{name}: {tasks} tasks of {part:,} cases", *told])
    return rows


def plan(seconds_a_case: float, bytes_a_case: float, task: float) -> Rows:
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
    options = parser.parse_args(arguments)
    scale, count = (10, 1_000_000) if options.quick else (1, int(options.many))
    folder = Path(tempfile.mkdtemp(prefix="stored-"))
    works = {
        "sleigh": (sleigh(3_200_000 // scale), 400_000 // scale),
        PENDULUM: (double_pendulum(480_000 // scale), 60_000 // scale),
    }
    try:
        rows, costs = throughput(works, folder, 1 if options.quick else options.repeat)
        with cluster_of(1) as client:
            task = task_cost(client, folder)
            checks = checked(costs, works, task, client, folder)
        starts = start_rows({"sleigh": first_case(sleigh(2)), PENDULUM: first_case(double_pendulum(2))})
        large = many(count, folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    a_case = case_cost(PENDULUM, works, costs, task)
    text = written(a_case, task, checks)
    heads = {
        "stored_throughput": "|us of CPU a case|million cases a second|of the plain sweep, CPU|by the clock",
        "stored_starts": "|program [kB]|imports|from the program|from the scene|empty cache|cached",
        "stored_checks": "|planned|measured|ratio",
        "stored_plan": "|computing|scheduler|store|workers between tasks|bottleneck",
    }
    found = rows, starts, checks, plan(a_case, large["size"] / count, task.wall)
    tables = {name: markdown_table(heads[name].split("|"), each) for name, each in zip(heads, found, strict=True)}
    print(text, *tables.values(), sep="\n\n")
    if options.save:
        fill_page(PAGE, MARKERS, text)
        for name, table in tables.items():
            save(name, table)
    return 0


def written(a_case: float, task: Cost, checks: Rows) -> str:
    """Return the sentences of the page."""
    ratios = [float(row[-1]) for row in checks]
    return (
        f"Measured on {describe_machine(machine())}.\n\n"
        f"A task of one case takes {1e3 * task.cpu:.1f} ms of CPU, {1e3 * task.wall:.1f} ms by the clock with one"
        " worker: it is sent, swept, and written to a dozen files. With chunks of seconds this is less than 1 %.\n\n"
        "Predict the CPU time of a sweep: the number of cases times the cost of a case, plus the number of tasks times"
        f" the cost of a task. This gave {min(ratios):.2f} to {max(ratios):.2f} of what runs with smaller chunks took."
        f" The plan below is for double pendulums of {1e6 * a_case:.0f} us on nodes with {CORES} cores like these, with"
        f" {1e3 * SCHEDULER:g} ms a task in the scheduler and a store that takes {BANDWIDTH / 1e9:g} GB/s."
    )


if __name__ == "__main__":
    sys.exit(main())
