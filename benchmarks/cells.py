"""Sweeps of 1,024, 16,384 and 262,144 cases on one and two threads, beside heyoka's fastest batches.

``python benchmarks/cells.py [PART ...]`` measures scenes or targets, saves them in benchmarks/results/cells.json, and
writes the tables of all that is saved into docs/benchmarks.md. A cell says how many times as long heyoka takes at
errors of 1e-6, 1e-9 and 1e-12, by the least of the times measured in turn, after 20 sweeps of each model: the first 16
check their cases by code that is not compiled, which takes some 0.5 ms. heyoka's batches are the fastest of
`peer_sweeps.HEYOKA_LANES` for up to 16,384 cases; for more, those that are fastest there. Rows with a target run a
process that compiles dalembert for a lesser processor (``DALEMBERT_TARGET``); heyoka compiles for the processor at hand
all the same.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from batches import BATCHES, sample_states
from equal_error import TARGETS, time_at
from measure import interleaved, machine
from peer_sweeps import HEYOKA_LANES, Solver, heyoka_sweep
from peers import installed
from report import describe_machine, fill_page
from sweeps import own_sweep

SIZES, LARGE = (1_024, 16_384), 262_144
TOLERANCES, WARM = (1e-5, 1e-6, 1e-7, 1e-9, 1e-10, 1e-12, 1e-13), 20
LESSER = ("x86-64-v2", "x86-64-v3")
PAGE = Path(__file__).parents[1] / "docs" / "benchmarks.md"
RESULTS = Path(__file__).parent / "results" / "cells.json"
MARKS = ("<!-- cells: benchmarks/cells.py -->", "<!-- end of cells -->")
Times = dict[tuple[int, float], tuple[float, float]]
"""(lanes of heyoka's batches or 0 for dalembert, rtol) -> (error, microseconds of a case)."""


def times(name: str, count: int, threads: int, lanes: Sequence[int], rounds: int) -> Times:
    """Return errors and times of both programs."""
    batch = BATCHES[name](count)
    exact = sample_states(batch)
    solvers: dict[tuple[int, float], Solver] = {}
    heyoka = installed("heyoka")
    for rtol in TOLERANCES:
        solvers[0, rtol] = own_sweep(batch, "auto", threads, rtol)
        solvers |= {(k, rtol): heyoka_sweep(heyoka, batch, threads, rtol, k) for k in lanes}
    for run, _, steps in solvers.values():
        for _ in range(WARM if count == SIZES[0] and steps is not None else 0):
            run()
    found = interleaved({key: run for key, (run, _, _) in solvers.items()}, rounds=rounds, seconds_each=5.0)
    return {
        key: (float(np.abs(state() - exact).max()), 1e6 * found[key].least / count)
        for key, (_, state, _) in solvers.items()
    }


def fastest(found: Times) -> list[float | None]:
    """Return the least times of heyoka at `TARGETS`, over the sizes of batches."""
    sizes = {lanes for lanes, _ in found if lanes}
    curves = [[found[key] for key in found if key[0] == lanes] for lanes in sizes]
    at = [[time for curve in curves if (time := time_at(curve, target)) is not None] for target in TARGETS]
    return [min(each, default=None) for each in at]


def cell(found: Times) -> str:
    """Return the ratios at `TARGETS`, and the time of dalembert at the second of them."""
    own = [time_at([value for key, value in found.items() if key[0] == 0], target) for target in TARGETS]
    pairs = zip(fastest(found), own, strict=True)
    shares = ["-" if a is None or b is None else f"{a / b:.1f}" for a, b in pairs]
    return f"{', '.join(shares)} ({own[1]:.2f} us)" if own[1] is not None else ", ".join(shares)


def best_lanes(found: Times) -> int:
    """Return the size of heyoka's batches that is the fastest at the second of `TARGETS`."""
    sizes = sorted({lanes for lanes, _ in found if lanes})
    return min(sizes, key=lambda k: time_at([v for key, v in found.items() if key[0] == k], TARGETS[1]) or np.inf)


def row(name: str, threads: int) -> list[str]:
    """Return the cells of a scene; the largest for two threads alone."""
    found = [times(name, count, threads, HEYOKA_LANES, rounds=5) for count in SIZES]
    last = cell(times(name, LARGE, threads, (best_lanes(found[-1]),), rounds=2)) if threads > 1 else ""
    return [*map(cell, found), last]


def on_target(target: str) -> dict[str, str]:
    """Return cells of 16,384 cases on one thread, of a process for a target."""
    done = subprocess.run(
        [sys.executable, __file__, "--rows"],
        env=os.environ | {"DALEMBERT_TARGET": target},
        capture_output=True,
        text=True,
        check=True,
    )
    found: dict[str, str] = json.loads(done.stdout.splitlines()[-1])
    return found


def page() -> str:
    """Return the tables of what has been saved."""
    saved = json.loads(RESULTS.read_text(encoding="utf-8"))
    lines = [f"| cases | threads | {' | '.join(f'{count:,}' for count in (*SIZES, LARGE))} |", "|---|---|" + "---|" * 3]
    lines += [f"| {name.replace(', ', ' | ')} | {' | '.join(cells)} |" for name, cells in saved["rows"].items()]
    lines += ["", f"| 16,384 cases, one thread | {' | '.join(BATCHES)} |", "|---|" + "---|" * len(BATCHES)]
    for target, cells in saved["targets"].items():
        lines.append(f"| compiled for {target} | {' | '.join(cells[name] for name in BATCHES)} |")
    return "\n".join([*lines, "", saved["machine"]])


def main() -> None:
    """Measure what is asked for, save it, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", help='names of scenes, or "targets"; all by default')
    parser.add_argument("--rows", action="store_true", help="print the cells of 16,384 cases on one thread as JSON")
    options = parser.parse_args()
    if options.rows:
        print(json.dumps({name: cell(times(name, SIZES[1], 1, HEYOKA_LANES[1:2], rounds=3)) for name in BATCHES}))
        return
    known = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {"rows": {}, "targets": {}}
    known["machine"] = describe_machine(machine())
    parts = options.parts or [*BATCHES, "targets"]
    for name in parts:
        if name == "targets":
            known["targets"] = {target: on_target(target) for target in LESSER}
        else:
            known["rows"] |= {f"{name}, {threads}": row(name, threads) for threads in (1, 2)}
        RESULTS.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")
        fill_page(PAGE, MARKS, page())


if __name__ == "__main__":
    main()
