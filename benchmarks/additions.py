"""What events, reductions and samples add to a sweep: nanoseconds of a step of a case, and of a case besides.

``python benchmarks/additions.py [--write]`` prints a table in Markdown, or writes it into docs/speed.md. Sweeps of two
lengths are timed by processor time on one thread. Their difference is the cost of a step, and what is left is that of a
case. Where each step or case has an event or a sample more, the rest of the table says what one of them takes.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from batches import BATCHES
from measure import machine
from report import describe_machine, fill_page
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da

CASES, SHORT, LONG, ROUNDS, RTOL = 1024, 10.0, 40.0, 100, 1e-9
SCENES = ("sphere", "unequal sphere")
MANY = 201
PAGE = Path(__file__).parents[1] / "docs" / "speed.md"
MARKS = ("<!-- additions: benchmarks/additions.py --write -->", "<!-- end of additions -->")
WORK: dict[str, Mapping[str, Any]] = {
    "nothing": {},
    "an event that does not occur": {"events": [da.Event(dynamicsymbols("x") - 1e5, name="far")]},
    "a maximum": {"reduce": {"largest": da.maximum("x")}},
    "a mean": {"reduce": {"mean": da.mean("x")}},
}


def least(calls: Mapping[Any, Callable[[], Any]]) -> dict[Any, float]:
    """Return the least processor time of each call [s]; they are made in turn."""
    best = dict.fromkeys(calls, np.inf)
    for _ in range(ROUNDS):
        for name, call in calls.items():
            begin = process_time()
            call()
            best[name] = min(best[name], process_time() - begin)
    return best


def costs(scene: str) -> dict[str, tuple[float, float]]:
    """Return, by kind of work, nanoseconds of a step and of a case besides; of "a sample", those of one."""
    batch = BATCHES[scene](CASES)
    model = da.compile_model(batch.problem.build())

    def sweep(end: float, options: Mapping[str, Any]) -> da.Sweep:
        given = {"rtol": RTOL, "atol": RTOL / 100, "threads": 1, "method": "taylor", **options}
        return model.sweep((0.0, end), batch.initial, batch.parameters, **given)

    work = {(name, end): partial(sweep, end, options) for name, options in WORK.items() for end in (SHORT, LONG)}
    work |= {n: partial(sweep, SHORT, {"t_eval": np.linspace(0.0, SHORT, n)}) for n in (2, MANY)}
    steps = {key: float(np.mean(call().steps)) for key, call in work.items()}
    times = {key: time / CASES * 1e9 for key, time in least(work).items()}
    found = {}
    for name in WORK:
        step = (times[name, LONG] - times[name, SHORT]) / (steps[name, LONG] - steps[name, SHORT])
        found[name] = step, times[name, SHORT] - step * steps[name, SHORT]
    found["a sample"] = (times[MANY] - times[2]) / (MANY - 2), 0.0
    return found


def table() -> list[str]:
    """Return the lines of the table."""
    found = {scene: costs(scene) for scene in SCENES}
    lines = [f"| sweep with | {' | | '.join(SCENES)} | |", "|---|--:|--:|--:|--:|"]
    for name in WORK:
        cells = (f"{found[scene][name][0]:.0f} ns a step | {found[scene][name][1]:.0f} ns a case" for scene in SCENES)
        lines.append(f"| {name} | {' | '.join(cells)} |")
    samples = (f"{found[scene]['a sample'][0]:.0f} ns each | " for scene in SCENES)
    return [*lines, f"| samples | {'| '.join(samples)}|"]


def main() -> None:
    """Print the table, or write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write the table into docs/speed.md")
    where = machine()
    lines = [*table(), "", f"{CASES:,} cases, rtol {RTOL:g}, one thread, {describe_machine(where)}"]
    print("\n".join(lines))
    if parser.parse_args().write:
        fill_page(PAGE, MARKS, "\n".join(lines))


if __name__ == "__main__":
    main()
