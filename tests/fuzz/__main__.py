"""Random scenes against the reference: ``python -m fuzz 0:2000`` from the folder ``tests``, or ``make fuzz``."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

from fuzz.summary import ORDER, summary
from fuzz.workers import examine_all

__all__ = ["main"]

LIMIT = 120.0
"""Seconds after which a scene hangs; those on all backends and formulations have three times as long."""


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
    """Run seeds in workers and append their results to a file."""
    from fuzz.generator import VERSION

    begin, count = time.perf_counter(), 0

    def record(task: str, answer: dict[str, Any]) -> None:
        nonlocal count
        row: dict[str, Any] = {"seed": int(task), "version": VERSION, "verdict": "", "paths": {}} | answer
        with file.open("a") as out:
            out.write(json.dumps(row) + "\n")
        count += 1
        if ORDER[row["outcome"]] >= ORDER["HANG"]:
            bad = "; ".join(f"{path}: {text[1][:150]}" for path, text in row["paths"].items() if text[0].isupper())
            print(f"{row['seed']}: {row['outcome']} {bad or row['verdict'][:300]}", flush=True)
        if count % 100 == 0:
            print(f"{count} of {len(seeds)} scenes in {time.perf_counter() - begin:.0f} s", flush=True)

    tasks = [str(seed) for seed in seeds]
    examine_all("fuzz.worker", tasks, jobs, lambda task: limit * (3 if int(task) % 10 == 0 else 1), record)


if __name__ == "__main__":
    sys.exit(main())
