"""Friction and contacts: steps a second of sweeps and runs with modes, against the same scene without friction.

``python benchmarks/contacts.py`` prints the table.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import exact  # noqa: F401 - puts tests/ on the path
import numpy as np
from measure import Timing, interleaved
from sympy import sin
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from hard_cases.contacts import corner_plate

__all__ = ["HEAD", "contacts_rows", "contacts_text", "measure_contacts", "tasks"]

Record = dict[str, Any]
TIME = dynamicsymbols._t
END, TOLERANCE = 8.0, {"rtol": 1e-9, "atol": 1e-11}
PLATE = {"m": 1.0, "l": 1.0, "h": 0.5, "g": 9.81}
START = {"x": -0.5 / math.tan(0.5), "theta": 0.5, "theta_dot": 0.0, "x_dot": 0.0}
WITH, WITHOUT = "plate on its corner, with friction", "the same without friction"
SLOWLY = "plate on its corner, with friction, pushed slowly"


def _free_plate() -> da.Scene:
    """Return the plate without friction, pushed so gently that it swings about its equilibrium."""
    scene = da.scenes.corner_plate()
    A, _ = scene.loads[0]
    scene.loads = ((A, (4 + sin(3 * TIME)) * scene.frame.x),)
    return scene


def tasks(count: int) -> tuple[dict[str, Callable[[], Any]], dict[str, Callable[[], Any]]]:
    """Return sweeps of `count` plates, and single runs, by name."""
    slow = da.compile_model(corner_plate(4 + 7 * sin(TIME / 2)))
    rough = da.compile_model(corner_plate(4 + 7 * sin(3 * TIME)))
    free = da.compile_model(_free_plate())
    mu, length = np.linspace(0.7, 0.9, count), np.linspace(1.0, 1.01, count)

    def swept(model: Any, parameters: dict[str, Any]) -> Callable[[], Any]:
        return lambda: model.sweep((0.0, END), START, {**PLATE, **parameters}, **TOLERANCE)

    def single(model: Any, parameters: dict[str, Any]) -> Callable[[], Any]:
        return lambda: model.simulate((0.0, END), START, {**PLATE, **parameters}, dense=False, **TOLERANCE)

    sweeps = {WITH: swept(rough, {"mu": mu}), SLOWLY: swept(slow, {"mu": mu}), WITHOUT: swept(free, {"l": length})}
    runs = {WITH: single(rough, {"mu": 0.8}), SLOWLY: single(slow, {"mu": 0.8}), WITHOUT: single(free, {})}
    return sweeps, runs


def measure_contacts(count: int, rounds: int) -> list[Record]:
    """Return records of `count` plates that are pushed and pulled over 8 s: time, steps, phases, steps a second.

    With friction, mu varies from 0.7 to 0.9, and most of the motions stick and slip fifteen times; pushed slowly, they
    have fewer and longer phases. Without friction, the length varies by one percent.
    """
    sweeps, runs = tasks(count)
    done = {name: task() for name, task in sweeps.items()}  # compiles
    alone = {name: task() for name, task in runs.items()}
    for name, result in done.items():
        if not result.success.all():
            raise RuntimeError(f"{name}: {result.failures()[0]}")
    records = []
    for kind, timed, results in (("sweep", sweeps, done), ("run", runs, alone)):
        timings = interleaved(timed, rounds=rounds, seconds_each=0.0)
        for name, timing in timings.items():
            result = results[name]
            steps = int(result.steps.sum()) if kind == "sweep" else result.stats.steps
            phases = getattr(result, "phases", None)
            mean = 1.0 if phases is None else float(np.mean(phases)) if kind == "sweep" else float(len(phases))
            records.append(_record(name, kind, count if kind == "sweep" else 1, timing, steps, mean))
    return records


def _record(name: str, kind: str, cases: int, timing: Timing, steps: int, phases: float) -> Record:
    return {
        "scene": name,
        "kind": kind,
        "cases": cases,
        "us": timing.microseconds(),
        "steps": steps,
        "phases": phases,
        "steps_per_second": steps / timing.median,
    }


def contacts_rows(records: Sequence[Record]) -> list[list[str]]:
    """Return the rows of a table: milliseconds, steps and phases of a case, steps a second and their share."""
    rows = []
    for r in records:
        free = next(x for x in records if x["kind"] == r["kind"] and x["scene"] == WITHOUT)
        share = r["steps_per_second"] / free["steps_per_second"]
        rows.append(
            [
                f"{r['scene']}, {'one run' if r['kind'] == 'run' else _cases(r)}",
                f"{r['us']['median'] / 1e3:.3g} [{r['us']['low'] / 1e3:.3g}, {r['us']['high'] / 1e3:.3g}]",
                f"{r['steps'] / r['cases']:.0f}",
                f"{r['phases']:.1f}",
                f"{r['steps_per_second']:.3g}",
                f"{100 * share:.0f}%",
            ]
        )
    return rows


def _cases(record: Record) -> str:
    return f"{record['cases']:,} cases"


HEAD = ["", "ms of a call", "steps of a case", "phases of a case", "steps a second", "throughput of steps"]


def contacts_text(records: Sequence[Record]) -> str:
    """Return the table as text."""
    rows = [HEAD, *contacts_rows(records)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEAD))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)


if __name__ == "__main__":
    print(contacts_text(measure_contacts(10_000, 5)))
