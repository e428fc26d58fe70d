"""Sweeps of 1,024, 16,384 and 262,144 cases on one and two threads, beside heyoka's fastest batches.

``python benchmarks/cells.py [PART ...]`` measures scenes or targets, saves them in benchmarks/results/cells.json, and
writes the tables of all that is saved into docs/benchmarks.md. A cell says how many times as long heyoka takes at
errors of 1e-6, 1e-9 and 1e-12, by the least of the times measured in turn, after 20 sweeps of each model: the first 16
check their cases by code that is not compiled, which takes some 0.5 ms. Sweeps are called for 20 ms in a row.
heyoka's batches are the fastest of `peer_sweeps.HEYOKA_LANES` for up to 16,384 cases; for more, those that are fastest
there. Rows with a target run a process that finds a lesser processor (`lesser_processors`), so that both programs
compile for it.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from batches import BATCHES, sample_states
from cases import PROBLEMS
from contenders import own
from equal_error import TARGETS, time_at
from lesser_processors import LESSER, output_on
from measure import interleaved, machine
from peer_sweeps import HEYOKA_LANES, Solver, heyoka_sweep
from peers import heyoka_run, installed
from report import describe_machine, fill_page
from sweeps import own_sweep

SIZES, LARGE = (1_024, 16_384), 262_144
TOLERANCES, WARM = (1e-5, 1e-6, 1e-7, 1e-9, 1e-10, 1e-12, 1e-13), 20
IN_A_ROW, LESSER_LANES = 0.02, (4, 8, 16)
"""Seconds for which a sweep is called in a row, and batches of heyoka that are fastest on lesser processors."""
PAGE = Path(__file__).parents[1] / "docs" / "benchmarks.md"
RESULTS = Path(__file__).parent / "results" / "cells.json"
MARKS = ("<!-- cells: benchmarks/cells.py -->", "<!-- end of cells -->")
Times = dict[tuple[int, float], tuple[float, float]]
"""(lanes of heyoka's batches, 1 for its single runs, 0 for dalembert; rtol) -> (error, microseconds of a case)."""


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
    runs = {key: run for key, (run, _, _) in solvers.items()}
    found = interleaved(runs, rounds=rounds, seconds_each=5.0, seconds=IN_A_ROW)
    return {
        key: (float(np.abs(state() - exact).max()), 1e6 * found[key].least / count)
        for key, (_, state, _) in solvers.items()
    }


def single_times(name: str) -> Times:
    """Return errors and times of single runs of both programs."""
    problem, heyoka = PROBLEMS[name], installed("heyoka")
    ours = next(each for each in own(problem, "llvm", ("minimal",)) if each.method == "taylor")
    runs = {(0, rtol): ours.prepare(rtol) for rtol in TOLERANCES}
    runs |= {(1, rtol): heyoka_run(heyoka, problem, rtol) for rtol in TOLERANCES}
    found = interleaved({key: each.run for key, each in runs.items()}, rounds=15, seconds_each=1.0)
    return {key: (each.error, 1e6 * found[key].least) for key, each in runs.items()}


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


def on_target(target: str) -> dict[str, dict[str, str]]:
    """Return the cells of `one_thread`, of a process for a target."""
    found: dict[str, dict[str, str]] = json.loads(output_on(target, [__file__, "--rows"]).splitlines()[-1])
    return found


def one_thread() -> dict[str, dict[str, str]]:
    """Return cells of single runs, and of sweeps of 16,384 cases on one thread, by scene."""
    found = {"single runs": {name: cell(single_times(name)) for name in BATCHES}}
    sweeps = {name: cell(times(name, SIZES[1], 1, LESSER_LANES, rounds=3)) for name in BATCHES}
    return found | {"16,384 cases, one thread": sweeps}


def page() -> str:
    """Return the tables of what has been saved."""
    saved = json.loads(RESULTS.read_text(encoding="utf-8"))
    lines = [f"| cases | threads | {' | '.join(f'{count:,}' for count in (*SIZES, LARGE))} |", "|---|---|" + "---|" * 3]
    lines += [f"| {name.replace(', ', ' | ')} | {' | '.join(cells)} |" for name, cells in saved["rows"].items()]
    lines += ["", f"| instructions | | {' | '.join(BATCHES)} |", "|---|---|" + "---|" * len(BATCHES)]
    for target, kinds in saved["targets"].items():
        for kind, cells in kinds.items():
            lines.append(f"| {target} | {kind} | {' | '.join(cells[name] for name in BATCHES)} |")
    return "\n".join([*lines, "", saved["machine"]])


def main() -> None:
    """Measure what is asked for, save it, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", help='names of scenes, or "targets"; all by default')
    parser.add_argument("--rows", action="store_true", help="print cells of one thread as JSON")
    options = parser.parse_args()
    if options.rows:
        print(json.dumps(one_thread()))
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
