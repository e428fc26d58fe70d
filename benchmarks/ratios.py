"""The speed of a checkout as ratios to yardsticks timed in the same run: what a redesign must not make worse.

``python benchmarks/ratios.py`` prints a table beside the ratios kept in benchmarks/results/ratios.json; ``--save``
writes them there. A ratio is our time over that of the yardstick: heyoka for runs and sweeps (the fastest of its
batches of 16, 32 and 64 cases), SymPy's KanesMethod for derivations, a prepared run for the cost of a call, the
frictionless plate for contacts, an import of SymPy and NumPy for a cold start. Smaller is better. Measure on a quiet
machine; the ratios of two checkouts are compared by running each in turn.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from batches import BATCHES
from cases import END, PROBLEMS, Problem
from chains import kane_planar_chain, planar_chain
from contenders import own
from exact import ROOT
from measure import forget, interleaved, machine
from peer_sweeps import heyoka_sweep
from peers import heyoka_system, installed
from startup import first_trajectory
from sweeps import CASES, THREADS, own_sweep

import dalembert as da
from contacts import WITH, WITHOUT, measure_contacts

__all__ = ["FILE", "ratios"]

FILE = ROOT / "benchmarks" / "results" / "ratios.json"
SCENES, TOLERANCES, BATCH_SIZES = ("sleigh", "unequal sphere"), (1e-6, 1e-9, 1e-12), (16, 32, 64)
ROUNDS = 15


def _heyoka_run(heyoka: Any, problem: Problem, rtol: float) -> Callable[[], Any]:
    """Return a run at heyoka's defaults: a yardstick stays as it was when the ratios were first kept."""
    start, pars = problem.reduced.start, list(problem.reduced.parameters)
    integrator = heyoka.taylor_adaptive(heyoka_system(heyoka, problem), start.tolist(), tol=rtol, pars=pars)

    def run() -> Any:
        integrator.time = 0.0
        integrator.state[:] = start
        return integrator.propagate_until(END)

    run()
    return run


def _single_runs(heyoka: Any) -> Mapping[str, float]:
    """Return prepared runs by `taylor` over heyoka's, and a call of `simulate` over a prepared run."""
    found = {}
    for name in SCENES:
        mine = next(c for c in own(PROBLEMS[name], "llvm", ("minimal",)) if c.method == "taylor")
        for rtol in TOLERANCES:
            ours = mine.prepare(rtol)
            tasks = {"run": ours.run, "call": ours.call}
            if heyoka is not None:
                tasks["heyoka"] = _heyoka_run(heyoka, PROBLEMS[name], rtol)
            timing = interleaved(tasks, rounds=ROUNDS, seconds_each=1.0)
            if heyoka is not None:
                found[f"run of the {name}, rtol {rtol:g}, over heyoka"] = timing["run"].median / timing["heyoka"].median
            found[f"simulate() of the {name}, rtol {rtol:g}, over a prepared run"] = (
                timing["call"].median / timing["run"].median
            )
    return found


def _sweeps(heyoka: Any) -> Mapping[str, float]:
    """Return sweeps by `taylor` on two threads over heyoka's fastest batches."""
    found = {}
    for name in SCENES if heyoka else ():
        batch = BATCHES[name](CASES[0])
        for rtol in TOLERANCES:
            tasks: dict[Any, Callable[[], Any]] = {"own": own_sweep(batch, "taylor", THREADS, rtol)[0]}
            tasks |= {lanes: heyoka_sweep(heyoka, batch, THREADS, rtol, lanes, {})[0] for lanes in BATCH_SIZES}
            timing = interleaved(tasks, rounds=ROUNDS, seconds_each=2.0)
            best = min(timing[lanes].median for lanes in BATCH_SIZES)
            found[f"sweep of the {name}, rtol {rtol:g}, over heyoka"] = timing["own"].median / best
    return found


def _contacts() -> Mapping[str, float]:
    """Return the time of a step with contacts over that of a step without."""
    records = {(r["scene"], r["kind"]): r["steps_per_second"] for r in measure_contacts(2000, ROUNDS)}
    return {f"step with contacts, {kind}": records[WITHOUT, kind] / records[WITH, kind] for kind in ("sweep", "run")}


def _seconds(task: Callable[[], Any]) -> float:
    forget()
    begin = time.perf_counter()
    task()
    return time.perf_counter() - begin


def _derivations() -> Mapping[str, float]:
    """Return the time from a scene to a model, without the cache on disk, over SymPy's KanesMethod of four links."""
    tasks = {name: partial(_compiled, build) for name, build in da.scenes.ALL.items()}
    tasks |= {f"chain of {n} links": partial(_compiled, partial(planar_chain, n)) for n in (4, 8)}
    times: dict[str, list[float]] = {name: [] for name in ("Kane", *tasks)}
    for _ in range(3):
        for name, task in {"Kane": partial(kane_planar_chain, 4), **tasks}.items():
            times[name].append(_seconds(task))
    yardstick = statistics.median(times["Kane"])
    return {f"compile_model of {name}, over KanesMethod": statistics.median(times[name]) / yardstick for name in tasks}


def _compiled(build: Callable[[], da.Scene]) -> Any:
    return da.compile_model(build(), cache=False)


def _starts() -> Mapping[str, float]:
    """Return first calls with empty caches, and in a second process, over an import of SymPy and NumPy."""
    command = [sys.executable, "-c", "import sympy, numpy"]
    yardstick = statistics.median(_seconds(partial(subprocess.run, command, check=True)) for _ in range(5))
    found = {}
    for what in ("simulate", "sweep"):
        for process, record in first_trajectory("llvm", 3, what).items():
            found[f"first {what}, {process}, over an import"] = record["process"] / yardstick
    return found


def ratios() -> dict[str, float]:
    """Return all ratios by name."""
    heyoka = installed("heyoka")
    found: dict[str, float] = {}
    for part in (partial(_single_runs, heyoka), partial(_sweeps, heyoka), _contacts, _derivations, _starts):
        new = part()
        for name, value in new.items():
            print(f"{name}: {value:.3g}", flush=True)
        found |= {name: round(value, 4) for name, value in new.items()}
    return found


def main() -> None:
    """Measure, and print beside what is kept or keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--save", action="store_true", help="write to benchmarks/results/ratios.json")
    save = parser.parse_args().save
    found = {"machine": machine(), "ratios": ratios()}
    if save or not FILE.exists():
        FILE.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        return
    kept = json.loads(FILE.read_text(encoding="utf-8"))["ratios"]
    print(f"\n{'now':>8}  {'kept':>8}  {'now/kept':>8}")
    for name, value in found["ratios"].items():
        old = kept.get(name)
        line = f"{value:8.3g}  " + ("       -         -" if old is None else f"{old:8.3g}  {value / old:8.2f}")
        print(f"{line}  {name}")


if __name__ == "__main__":
    main()
