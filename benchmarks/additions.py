"""What events, reductions, samples, inputs and friction add to a sweep: nanoseconds of a step, and of a case besides.

``python benchmarks/additions.py [--write]`` prints tables in Markdown, or writes them into docs/speed.md. Sweeps of two
lengths are timed by processor time on one thread. Their difference is the cost of a step, and what is left is that of a
case. Where each step or case has an event or a sample more, the rest of the table says what one of them takes. The
second table is of a block on a spring: it slips one way, or swings, where each turn is a decision on friction.
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
from sympy import sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

CASES, SHORT, LONG, ROUNDS, RTOL = 1024, 10.0, 40.0, 60, 1e-9
SCENES = ("sphere", "unequal sphere")
MANY = 201
OPTIONS: dict[str, Any] = {"rtol": RTOL, "atol": RTOL / 100, "threads": 1, "method": "taylor"}
PAGE = Path(__file__).parents[1] / "docs" / "speed.md"
MARKS = ("<!-- additions: benchmarks/additions.py --write -->", "<!-- end of additions -->")
WORK: dict[str, Mapping[str, Any]] = {
    "nothing": {},
    "an event that does not occur": {"events": [da.Event(dynamicsymbols("x") - 1e5, name="far")]},
    "a maximum": {"reduce": {"largest": da.maximum("x")}},
    "a mean": {"reduce": {"mean": da.mean("x")}},
}


BLOCK = {"m": 1.0, "k": 8.0}


def block(force: str) -> da.CompiledModel:
    """Return a block on a nonlinear spring under a force: a "parameter", an "input", or also "friction"."""
    s, u, (m, k, F, P), T = dynamicsymbols("s"), dynamicsymbols("u"), symbols("m k F P"), da.unknowns("T")
    N, O = ReferenceFrame("N"), Point("O")
    where = O.locatenew("B", s * N.x)
    found = da.Scene(f"block, {force}", frame=N, origin=O, coordinates=[s])
    found.add_bodies(Particle("block", where, m))
    found.add_loads((where, ((u if force == "input" else F) - k * sin(s)) * N.x))
    if force == "input":
        found.add_inputs(u)
    if force == "friction":
        found.add_joints(da.Joint("clamp", body="block", at=where, force=T * N.x))
        found.add_friction(da.CoulombFriction(normal=P, tangential=T, mu=0.001, name="clamp"))
    return da.compile_model(found)


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
        return model.sweep((0.0, end), batch.initial, batch.parameters, **{**OPTIONS, **options})

    work = {(name, end): partial(sweep, end, options) for name, options in WORK.items() for end in (SHORT, LONG)}
    work |= {n: partial(sweep, SHORT, {"t_eval": np.linspace(0.0, SHORT, n)}) for n in (2, MANY)}
    times = {key: time / CASES * 1e9 for key, time in least(work).items()}
    found = {name: step_and_case(work, times, name) for name in WORK}
    found["a sample"] = (times[MANY] - times[2]) / (MANY - 2), 0.0
    return found


def step_and_case(
    work: Mapping[Any, Callable[[], da.Sweep]], times: Mapping[Any, float], name: str
) -> tuple[float, float]:
    """Return nanoseconds of a step and of a case besides, from the times of a short sweep and a long one."""
    short, long = (float(np.mean(work[name, end]().steps)) for end in (SHORT, LONG))
    step = (times[name, LONG] - times[name, SHORT]) / (long - short)
    return step, times[name, SHORT] - step * short


def costs_of_forces() -> list[tuple[str, str, str]]:
    """Return lines of the table of the block: its force, the time of a step, and of a case besides or of a turn."""
    plain, driven, rough = (block(force) for force in ("parameter", "input", "friction"))
    swings = {"s": np.linspace(0.5, 1.0, CASES), "s_dot": 0.0}
    runs = {**swings, "s_dot": 5.0}
    knots = np.arange(LONG + 1.0)
    record = da.samples(knots, np.random.default_rng(0).normal(size=(CASES, len(knots))))

    def sweep(model: da.CompiledModel, initial: Mapping[str, Any], p: Mapping[str, float], end: float, **o: Any) -> Any:
        return model.sweep((0.0, end), initial, {**BLOCK, **p}, **OPTIONS, **o)

    rows = {
        "a constant force": partial(sweep, plain, swings, {"F": 0.0}),
        "an input, one number": partial(sweep, driven, swings, {}, inputs={"u": 0.0}),
        "an input, a record of each case with a knot a second": partial(
            sweep, driven, swings, {}, inputs={"u": record}
        ),
        "friction, slipping one way": partial(sweep, rough, runs, {"F": 1.0, "P": 2.0}),
        "friction, swinging": partial(sweep, rough, swings, {"F": 0.0, "P": 2.0}),
    }
    work = {(name, end): partial(run, end=end) for name, run in rows.items() for end in (SHORT, LONG)}
    times = {key: time / CASES * 1e9 for key, time in least(work).items()}
    found = {name: step_and_case(work, times, name) for name in rows}
    *others, swinging = rows
    lines = [(name, f"{found[name][0]:.0f} ns a step", f"{found[name][1]:.0f} ns a case") for name in others]
    one = {name: float(value if np.ndim(value) == 0 else value[0]) for name, value in swings.items()}
    run = [
        rough.simulate((0, end), one, {**BLOCK, "F": 0, "P": 2}, rtol=RTOL, atol=RTOL / 100) for end in (SHORT, LONG)
    ]
    turns = len(run[1].phases) - len(run[0].phases)
    further = np.mean(work[swinging, LONG]().steps) - np.mean(work[swinging, SHORT]().steps)
    turn = (times[swinging, LONG] - times[swinging, SHORT] - further * found[others[0]][0]) / turns
    return [*lines, (f"{swinging}, beyond the steps without", f"{turn:.0f} ns a turn", "")]


def table() -> list[str]:
    """Return the lines of both tables."""
    found = {scene: costs(scene) for scene in SCENES}
    lines = [f"| sweep with | {' | | '.join(SCENES)} | |", "|---|--:|--:|--:|--:|"]
    for name in WORK:
        cells = (f"{found[scene][name][0]:.0f} ns a step | {found[scene][name][1]:.0f} ns a case" for scene in SCENES)
        lines.append(f"| {name} | {' | '.join(cells)} |")
    samples = (f"{found[scene]['a sample'][0]:.0f} ns each | " for scene in SCENES)
    lines += [f"| samples | {'| '.join(samples)}|", "", "| block with | | |", "|---|--:|--:|"]
    return [*lines, *(f"| {' | '.join(cells)} |" for cells in costs_of_forces())]


def main() -> None:
    """Print the tables, or write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write the tables into docs/speed.md")
    where = machine()
    lines = [*table(), "", f"{CASES:,} cases, rtol {RTOL:g}, one thread, {describe_machine(where)}"]
    print("\n".join(lines))
    if parser.parse_args().write:
        fill_page(PAGE, MARKS, "\n".join(lines))


if __name__ == "__main__":
    main()
