"""Random scenes against the reference: ``python -m fuzz 0:2000`` from the folder ``tests``, or ``make fuzz``."""

from __future__ import annotations

import argparse
import json
import os
import queue
import selectors
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

from fuzz.summary import ORDER, summary

__all__ = ["main"]

LIMIT = 120.0
"""Seconds after which a scene hangs; those on all backends and formulations have three times as long."""
LIFE = 150
"""Scenes after which a worker is started anew, for its memory."""


def main() -> int:
    """Run the seeds that have no result yet; return 1 if anything was found."""
    options = _options()
    first, last = (int(part) for part in options.seeds.split(":"))
    folder = Path(options.out)
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "results.jsonl"
    done = _results(file)
    if options.again:
        done = {seed: row for seed, row in done.items() if row["outcome"] not in options.again.split(",")}
    seeds = [seed for seed in range(first, last) if seed not in done]
    if seeds and not options.report:
        print(f"{len(seeds)} of {last - first} scenes are left; results go to {file}", flush=True)
        _run(seeds, file, options.jobs, options.limit)
    rows = [row for seed, row in sorted(_results(file).items()) if first <= seed < last]
    print(summary(rows))
    return int(any(ORDER[row["outcome"]] >= ORDER["HANG"] for row in rows))


def _options() -> Any:
    parser = argparse.ArgumentParser(prog="fuzz", description=__doc__)
    parser.add_argument("seeds", nargs="?", default="0:200", help="first and last seed, as 0:2000")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--limit", type=float, default=LIMIT, help="seconds a scene")
    parser.add_argument("--out", default="build/fuzz", help="folder of the results")
    parser.add_argument("--again", default="", help="outcomes whose seeds are run again, such as WRONG,HANG")
    parser.add_argument("--report", action="store_true", help="only summarise what there is")
    return parser.parse_args()


def _results(file: Path) -> dict[int, dict[str, Any]]:
    """Return the last result of every seed; lines that a kill cut short are left out."""
    from fuzz.generator import VERSION

    rows: dict[int, dict[str, Any]] = {}
    if file.exists():
        for line in file.read_text().splitlines():
            try:
                row = json.loads(line)
            except ValueError:
                continue
            if row.get("version") == VERSION:
                rows[row["seed"]] = row
    return rows


def _run(seeds: list[int], file: Path, jobs: int, limit: float) -> None:
    """Run seeds in workers, each of which is replaced when it hangs or dies."""
    waiting: queue.SimpleQueue[int] = queue.SimpleQueue()
    for seed in seeds:
        waiting.put(seed)
    lock, begin, count = threading.Lock(), time.perf_counter(), 0

    def record(row: dict[str, Any]) -> None:
        nonlocal count
        with lock, file.open("a") as out:
            out.write(json.dumps(row) + "\n")
            count += 1
            if ORDER[row["outcome"]] >= ORDER["HANG"]:
                bad = "; ".join(f"{path}: {text[1][:150]}" for path, text in row["paths"].items() if text[0].isupper())
                print(f"{row['seed']}: {row['outcome']} {bad or row['verdict'][:300]}", flush=True)
            if count % 100 == 0:
                print(f"{count} of {len(seeds)} scenes in {time.perf_counter() - begin:.0f} s", flush=True)

    def serve() -> None:
        worker, age = None, 0
        while True:
            try:
                seed = waiting.get_nowait()
            except queue.Empty:
                break
            if worker is None or age >= LIFE:
                _end(worker)
                worker, age = _Worker(), 0
            age += 1
            row = worker.examine(seed, limit * (3 if seed % 10 == 0 else 1))
            if row["outcome"] in ("HANG", "CRASH"):
                _end(worker)
                worker = None
            record(row)
        _end(worker)

    threads = [threading.Thread(target=serve) for _ in range(jobs)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


class _Worker:
    """A process that examines one seed after the other."""

    def __init__(self) -> None:
        command = [sys.executable, "-X", "faulthandler", "-m", "fuzz.worker"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self._errors: list[bytes] = []
        assert self._process.stderr is not None
        threading.Thread(target=self._listen, args=(self._process.stderr,), daemon=True).start()

    def _listen(self, pipe: Any) -> None:
        for line in pipe:
            self._errors = [*self._errors[-20:], line]

    def examine(self, seed: int, limit: float) -> dict[str, Any]:
        """Return the result of a seed, or that the worker hung or died."""
        from fuzz.generator import VERSION

        process, begin = self._process, time.perf_counter()
        assert process.stdin is not None and process.stdout is not None
        row: dict[str, Any] = {"seed": seed, "version": VERSION, "verdict": "", "paths": {}}
        try:
            process.stdin.write(f"{seed}\n".encode())
            process.stdin.flush()
        except BrokenPipeError:
            return row | {"outcome": "CRASH", "verdict": "the worker died between scenes", "seconds": 0.0}
        with selectors.DefaultSelector() as selector:
            selector.register(process.stdout, selectors.EVENT_READ)
            ready = selector.select(limit)
        seconds = round(time.perf_counter() - begin, 1)
        if not ready:
            return row | {"outcome": "HANG", "verdict": f"no result after {limit:g} s", "seconds": seconds}
        line = process.stdout.readline()
        if not line.endswith(b"\n"):
            code = process.wait()
            last = b"".join(self._errors[-8:]).decode(errors="replace")
            return row | {"outcome": "CRASH", "verdict": f"exit status {code}: {last}", "seconds": seconds}
        found: dict[str, Any] = json.loads(line)
        return found

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()


def _end(worker: _Worker | None) -> None:
    if worker is not None:
        worker.close()


if __name__ == "__main__":
    sys.exit(main())
