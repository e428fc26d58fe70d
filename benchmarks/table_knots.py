"""Tables of the state: what it costs to end steps at their knots, against events at the knots and no table at all.

``python benchmarks/table_knots.py`` prints one table in Markdown: milliseconds of processor time of single runs by the
Taylor method, with the number of knots that they pass, steps a second of sweeps in one thread, and how many times as
long sweeps take whose tables have parameters as values.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from sympy import Expr, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols
from tables import markdown_table

import dalembert as da

x = dynamicsymbols("x")
START = {x: 1.0, x.diff(): 0.0}
TIGHT = {"rtol": 1e-9, "atol": 1e-11}
PERIODS = 8


def on_spring(name: str, force: Expr) -> Any:
    """Return the model of a mass of 1 kg on a spring with a force."""
    N, O = ReferenceFrame("N"), Point("O")
    where = O.locatenew("P", x * N.x)
    scene = da.Scene(name, frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("p", where, 1))
    scene.add_loads((where, -force * N.x))
    return da.compile_model(scene)


def bent(places: Any) -> Any:
    """Return the forces of a spring of stiffness 1 that bends a little at each of some places."""
    return places + 0.02 * np.sin(9.0 * np.arange(len(places))) / len(places)


def spring(knots: int) -> Any:
    """Return a mass on a spring of stiffness 1; with knots, its characteristic is a table with a bend at each."""
    places = np.linspace(-1.5, 1.5, knots)
    return on_spring(f"spring_{knots}", da.table(x, places, bent(places), kind="linear") if knots else x)


def with_parameters(kind: str) -> float:
    """Return how many times as long a sweep takes where the 25 values of a table are parameters."""
    places, names = np.linspace(-1.5, 1.5, 25), symbols("f:25")
    span, cases = (0.0, 2.0 * np.pi * PERIODS), {x: np.linspace(0.5, 1.4, 4096), x.diff(): 0.0}
    seconds = []
    for values, given in ((bent(places), {}), (names, dict(zip(names, bent(places), strict=True)))):
        model = on_spring(f"spring_{kind}", da.table(x, places, values, kind=kind))
        own, _ = least(
            lambda model=model, given=given: model.sweep(span, cases, given, threads=1, method="taylor", **TIGHT), 3
        )
        seconds.append(own)
    return seconds[1] / seconds[0]


def least(run: Callable[[], Any], times: int = 7) -> tuple[float, Any]:
    """Return the least processor time of a call, and what it returned."""
    found, seconds = run(), np.inf
    for _ in range(times):
        begin = time.process_time()
        found = run()
        seconds = min(seconds, time.process_time() - begin)
    return seconds, found


def main() -> None:
    """Measure and print."""
    span, rows = (0.0, 2.0 * np.pi * PERIODS), []
    smooth = spring(0)
    for knots in (9, 101, 1001):
        places = np.linspace(-1.5, 1.5, knots)
        model = spring(knots)
        passed = 2 * PERIODS * int(np.sum(np.abs(places) < 1.0))
        own, run = least(lambda model=model: model.simulate(span, START, {}, method="taylor", **TIGHT))
        cells = [f"{passed:,}", f"{1e3 * own:.2f}", f"{run.stats.steps:,}"]
        if knots <= 101:
            events = [x - float(place) for place in places if abs(place) < 1.0]
            watched, _ = least(
                lambda events=events: smooth.simulate(span, START, {}, method="taylor", events=events, **TIGHT), 3
            )
            cells.append(f"{1e3 * watched:.2f}")
        else:
            cells.append("-")
        rows.append([f"single run, {knots:,} knots", *cells])
    print(markdown_table(["", "knots passed", "ms", "steps", "ms with events at the knots of a spring"], rows))
    cases = {x: np.linspace(0.5, 1.4, 4096), x.diff(): 0.0}
    speeds = []
    for model in (smooth, spring(101)):
        seconds, sweep = least(lambda model=model: model.sweep(span, cases, {}, threads=1, method="taylor", **TIGHT))
        speeds.append(sweep.stats.steps / seconds)
    print(f"\nsweep, one thread: {speeds[1] / 1e6:.1f} million steps a second with 101 knots,", end=" ")
    print(f"{speeds[1] / speeds[0]:.2f} of the throughput per step of the same sweep without a table")
    ratios = ", ".join(f"{kind} {with_parameters(kind):.1f}" for kind in ("linear", "cubic"))
    print(f"sweep with 25 values as parameters, over the same with numbers: {ratios}")


if __name__ == "__main__":
    main()
