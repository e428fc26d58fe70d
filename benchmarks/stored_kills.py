"""Stored sweeps whose workers and clients are killed, and whose stores are cut: what is there in the end.

``python benchmarks/stored_kills.py`` prints; ``--save`` writes it into docs/stored_measured.md, ``--quick`` kills
less often. Kills are SIGKILL, spread over each run by what it has done so far.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from report import fill_page
from stored_many import PAGE, SLEIGH

import dalembert as da

MARKERS = ("<!-- kills: begin (written by benchmarks/stored_kills.py) -->", "<!-- kills: end -->")
CHUNK, SPAN = 5, (0.0, 5.0)
NAMES = ("x", "y", "theta", "x_dot", "theta_dot", "energy", "status", "steps", "b")


def parameters(chunks: int) -> dict[str, Any]:
    """Return the parameters of so many chunks of sleighs."""
    return {"m": 1, "b": np.linspace(0.1, 0.5, chunks * CHUNK), "I_C": 0.5}


def sweep(path: Path, chunks: int, client: Any = None) -> Any:
    """Return the results of the sweep that all runs here are about."""
    model = da.compile_model(da.scenes.chaplygin_sleigh())
    return model.sweep(SPAN, SLEIGH, parameters(chunks), to=path, chunk=CHUNK, client=client)


def done(path: Path) -> int:
    """Return how many chunks have a mark in a store."""
    marks = path / "progress" / "done" / "c"
    return len(os.listdir(marks)) if marks.exists() else 0


def check(stored: Any, chunks: int) -> None:
    """Compare a store with one plain sweep: every case once, to the bit."""
    plain = da.compile_model(da.scenes.chaplygin_sleigh()).sweep(SPAN, SLEIGH, parameters(chunks)).to_xarray()
    for name in NAMES:
        if not np.array_equal(stored[name].to_numpy(), plain[name].to_numpy()):
            raise RuntimeError(f"{name} of the store is not that of one sweep")


def kill_workers(path: Path, chunks: int, kills: int, rng: random.Random) -> float:
    """Return the seconds of one run by two workers, of which a random one is killed again and again."""
    import dask
    from distributed import Client, LocalCluster

    dask.config.set({"distributed.deploy.lost-worker-timeout": "10 minutes"})  # starting again may take a while
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:

        def kill() -> None:
            for number in range(1, kills + 1):
                while done(path) < number * chunks // (kills + 2) or not (pids := workers()):
                    time.sleep(0.02)
                killed.append(rng.choice(pids))
                os.kill(killed[-1], signal.SIGKILL)

        def workers() -> list[int]:
            running = [each for each in cluster.workers.values() if each.worker_address in cluster.scheduler.workers]
            return [each.pid for each in running if each.pid and each.pid not in killed]

        killed: list[int] = []
        killer, begin = threading.Thread(target=kill, daemon=True), time.perf_counter()
        killer.start()
        stored = sweep(path, chunks, client)
        seconds = time.perf_counter() - begin
    if len(killed) < kills:
        raise RuntimeError(f"the run was over after {len(killed)} of {kills} kills")
    check(stored, chunks)
    return seconds


def kill_clients(path: Path, chunks: int, kills: int) -> float:
    """Return the seconds of a sweep whose client is killed again and again; every second one has a cluster."""
    from distributed import LocalCluster

    begin = time.perf_counter()
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        for number in range(1, kills + 1):
            address = cluster.scheduler_address if number % 2 else ""
            process = subprocess.Popen([sys.executable, __file__, "--client", f"{path}", f"{chunks}", address])
            while done(path) < number * chunks // (kills + 1):
                if process.poll() is not None:
                    raise RuntimeError("a client came to its end before it was killed")
                time.sleep(0.02)
            process.kill()
            process.wait()
    stored = sweep(path, chunks)
    seconds = time.perf_counter() - begin
    check(stored, chunks)
    return seconds


def cut_files(path: Path, chunks: int, times: int, files: int, rng: random.Random) -> None:
    """Cut or remove random files of a store, and let the same call complete it."""
    for _ in range(times):
        for file in rng.sample(sorted(p for p in path.rglob("*") if p.is_file()), files):
            if rng.random() < 0.2 and file != path / "zarr.json":
                file.unlink()
            else:
                file.write_bytes(file.read_bytes()[: rng.randrange(max(1, file.stat().st_size))])
        check(sweep(path, chunks), chunks)


def main(arguments: Sequence[str] | None = None) -> int:
    """Kill, print, and save if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", action="store_true")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--client", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.client:
        from distributed import Client

        path, chunks, address = options.client
        sweep(Path(path), int(chunks), Client(address) if address else None)
        return 0
    workers, clients, chunks, cuts = (3, 2, 60, 2) if options.quick else (20, 10, 300, 5)
    folder, rng = Path(tempfile.mkdtemp(prefix="kills-")), random.Random(1)
    try:
        first = kill_workers(folder / "workers.zarr", chunks, workers, rng)
        second = kill_clients(folder / "clients.zarr", chunks, clients)
        cut_files(folder / "clients.zarr", chunks, cuts, 30, rng)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    text = (
        f"{chunks} chunks of {CHUNK} sleighs. One run by two workers, of which a random one was killed {workers} times"
        f" (`kill -9`): {first:.0f} s. A sweep whose client was killed {clients} times, every second one the client of"
        f" a cluster: {second:.0f} s. {cuts} times 30 random files of the store were cut at a random byte, or removed,"
        " those that describe it among them. Each time every case was there, once, with the bits of one plain sweep."
    )
    print(text)
    if options.save:
        fill_page(PAGE, MARKERS, text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
