"""Friction and contacts: steps a second of sweeps and runs with modes, and the cost of a decision by contacts.

``python benchmarks/contact_speed.py`` prints the tables: a scene with friction against the same without; decisions of 2
to 12 contacts with the search for a mode against trying every combination; first and later runs of scenes of 4 to 12
contacts, whose modes one program serves, against one program for each mode; and first and later runs against the number
of contacts. ``python benchmarks/contact_speed.py counts`` prints the last table alone.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import exact  # noqa: F401 - puts tests/ on the path
import numpy as np
from measure import Timing, interleaved
from sympy import sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from dalembert.codegen.llvm.loops import loop_named
from dalembert.contacts.contact_cases import contact_cases
from dalembert.contacts.selection.mode_candidates import ALL
from dalembert.methods.status import Status
from dalembert.phases import mode_models
from dalembert.phases.decisions import LOOP
from hard_cases.contacts import corner_plate
from hard_cases.many_contacts import (
    boxes,
    boxes_at_rest,
    feet,
    feet_at_rest,
    legged,
    legged_at_rest,
    standing,
    standing_at_rest,
)

__all__ = ["HEAD", "contacts_rows", "contacts_text", "decisions_text", "measure_contacts", "measure_decisions", "tasks"]
__all__ += ["counts_text", "measure_counts", "measure_programs", "programs_text"]

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


def _pile(count: int) -> da.Scene:
    """Return points on each other on a rough floor, the lowest of which is pushed."""
    m, g, mu, push = symbols("m g mu push", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    places = [dynamicsymbols(f"x{i} y{i}") for i in range(count)]
    scene = da.Scene(f"pile of {count}", frame=N, origin=O, coordinates=[q for place in places for q in place])
    at = [O.locatenew(f"P{i}", x * N.x + y * N.y) for i, (x, y) in enumerate(places)]
    below: tuple[Any, Any] = (0 * TIME, 0 * TIME)
    for i, (x, y) in enumerate(places):
        normal, force = da.unknowns(f"R{i} F{i}")
        up = force * N.x + normal * N.y
        scene.add_bodies(Particle(f"point{i}", at[i], m))
        scene.add_joints(da.Joint(f"up{i}", body=f"point{i}", at=at[i], force=up))
        if i > 0:
            scene.add_joints(da.Joint(f"down{i}", body=f"point{i - 1}", at=at[i - 1], force=-up))
        scene.add_contacts(da.UnilateralContact(normal, gap=y - below[1], name=f"c{i}"))
        slip = x.diff(TIME) - below[0].diff(TIME)
        scene.add_friction(da.CoulombFriction(normal, force, slip=slip, mu=mu, name=f"c{i}"))
        below = x, y
    scene.add_loads((at[0], push * N.x))
    scene.apply_uniform_gravity(-g * N.y)
    return scene


def measure_decisions(counts: Sequence[int] = (2, 4, 8, 12), most: float = 1e5) -> list[Record]:
    """Return records of decisions about piles at rest: combinations, milliseconds with the search and with all tried.

    The lowest point is pushed so that it slips and all others stick. All combinations are tried up to `most` of them.
    """
    records = []
    for count in counts:
        model = da.compile_model(_pile(count))
        values = {"m": 1.0, "g": 10.0, "mu": 0.5, "push": 40.0 * count}
        p = np.array([[values[name] for name in model.layout.parameters]])
        x, decisions = np.zeros((1, 4 * count)), model.modes.decisions
        numbers, spent = decisions.values(np.zeros(1), x, p), {}
        for name, limit in (("search", 0), ("all", ALL)):
            if name == "all" and 4.0**count > most:
                continue
            for _ in range(5):
                cases = contact_cases(np.zeros(1), x.copy(), p, np.ones(1), count)
                arguments = decisions.arguments(cases, numbers, np.zeros(1, np.int64), (0.0, 0.0))
                arguments.candidates.found.most = limit
                begin = time.perf_counter()
                loop_named(LOOP)(arguments)
                spent[name] = min(spent.get(name, math.inf), time.perf_counter() - begin)
            if cases.status[0] != Status.SUCCESS:
                raise RuntimeError(f"{count} contacts: {Status(int(cases.status[0])).name}")
        records.append({"contacts": count, "combinations": 4**count, "ms": {k: 1e3 * v for k, v in spent.items()}})
    return records


def decisions_text(records: Sequence[Record]) -> str:
    """Return the table of decisions as text."""
    lines = [f"{'contacts':>8}{'combinations':>14}{'ms of the search':>18}{'ms of all of them':>19}"]
    for r in records:
        tried = f"{r['ms']['all']:.3f}" if "all" in r["ms"] else "-"
        lines.append(f"{r['contacts']:>8}{r['combinations']:>14,}{r['ms']['search']:>18.3f}{tried:>19}")
    return "\n".join(lines)


def measure_programs() -> list[Record]:
    """Return records of first runs, which compile what they need, and of second runs, of scenes of many contacts.

    In seconds of the processor, with one program for all modes and with one for each; a stack of six boxes only with
    one, because the run with one for each takes hours. Loops that belong to no scene are compiled before.
    """
    scenes: dict[str, tuple[Callable[[], da.Scene], tuple[Any, Any], float]] = {
        "four sprung legs in a plane": (lambda: feet(4), feet_at_rest(4), 1.0),
        "four sprung legs in space": (standing, standing_at_rest(), 0.6),
        "stack of two boxes": (lambda: boxes(2), boxes_at_rest(2), 1.5),
        "stack of six boxes": (lambda: boxes(6), boxes_at_rest(6), 1.2),
    }
    start, p = feet_at_rest(2)
    da.compile_model(feet(2), cache=False).simulate((0.0, 0.1), start, p)
    records, usual = [], mode_models.why_separate
    for name, (make, (start, p), end) in scenes.items():
        for separate in (False, True) if name != "stack of six boxes" else (False,):
            mode_models.why_separate = (lambda *about: "asked for") if separate else usual
            scene, begin = make(), time.process_time()
            model = da.compile_model(scene, cache=False)
            run, first = model.simulate((0.0, end), start, p), time.process_time() - begin
            if not run.success:
                raise RuntimeError(f"{name}: {run.message}")
            again = []
            for _ in range(5):
                begin = time.process_time()
                model.simulate((0.0, end), start, p)
                again.append(time.process_time() - begin)
            about = {"scene": name, "contacts": len(model.contacts), "separate": separate, "phases": len(run.phases)}
            programs = len({*model.modes.compiled} - {model.modes.open_mode})
            records.append({**about, "programs": programs, "first": first, "second": min(again)})
    mode_models.why_separate = usual
    return records


def programs_text(records: Sequence[Record]) -> str:
    """Return the table of first and later runs as text."""
    lines = [f"{'':<30}{'contacts':>9}{'phases':>8}{'programs':>10}{'s, first run':>14}{'ms, second':>12}"]
    for r in records:
        counts = f"{r['contacts']:>9}{r['phases']:>8}{r['programs']:>10}"
        lines.append(f"{r['scene']:<30}{counts}{r['first']:>14.1f}{1e3 * r['second']:>12.1f}")
    return "\n".join(lines)


SPRUNG, LEGGED = "point on sprung legs in space", "trunk on legs of three joints"


def measure_counts(
    sprung: Sequence[int] = (1, 2, 3, 4, 6, 8, 12), legged_by: Sequence[int] = (1, 2, 4)
) -> list[Record]:
    """Return records of first and second runs against the number of contacts, in seconds of the processor.

    Points on sprung legs are pushed to and fro for 0.3 s, so that feet slip; trunks that move freely stand for 0.1 s on
    legs of three joints, whose torques a controller sets 500 times a second. All feet are rough.
    """
    start, p = standing_at_rest(1)
    da.compile_model(standing(1), cache=False).simulate((0.0, 0.01), start, p)  # loops that belong to no scene
    tasks: list[tuple[str, int, Callable[[int], da.Scene], tuple[Any, Any], float]] = []
    tasks += [(SPRUNG, count, standing, standing_at_rest(count), 0.3) for count in sprung]
    tasks += [(LEGGED, count, legged, legged_at_rest(count), 0.1) for count in legged_by]
    records = []
    for name, count, make, (start, p), end in tasks:
        begin = time.process_time()
        model = da.compile_model(make(count), cache=False)
        run, first = model.simulate((0.0, end), start, p, rtol=1e-6, atol=1e-8), time.process_time() - begin
        begin = time.process_time()
        model.simulate((0.0, end), start, p, rtol=1e-6, atol=1e-8)
        second = time.process_time() - begin
        about = {"scene": name, "contacts": count, "phases": len(run.phases), "steps": run.stats.steps}
        records.append({**about, "status": run.status.name, "first": first, "second": second})
        print(records[-1], file=sys.stderr, flush=True)
    return records


def counts_text(records: Sequence[Record]) -> str:
    """Return the table of runs against the number of contacts as text."""
    lines = [f"{'':<32}{'contacts':>9}{'phases':>8}{'steps':>7}{'s, first run':>14}{'ms, second':>12}  status"]
    for r in records:
        counts = f"{r['contacts']:>9}{r['phases']:>8}{r['steps']:>7}"
        lines.append(f"{r['scene']:<32}{counts}{r['first']:>14.1f}{1e3 * r['second']:>12.0f}  {r['status']}")
    return "\n".join(lines)


if __name__ == "__main__" and sys.argv[1:] == ["counts"]:
    print(counts_text(measure_counts()))
elif __name__ == "__main__":
    print(contacts_text(measure_contacts(10_000, 5)))
    print(decisions_text(measure_decisions()))
    print(programs_text(measure_programs()))
    print(counts_text(measure_counts()))
