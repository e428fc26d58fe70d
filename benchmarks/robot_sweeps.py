"""A sweep of a robot of 29 joints: time of a case against error, beside programs for mechanics.

Needs, beside the library, any of these packages; those that are missing are left out:

    pip install pin example-robot-data mujoco drake exudyn
    python benchmarks/robot_sweeps.py                   # prints the table
    python benchmarks/robot_sweeps.py --write           # also writes docs/many_bodies_measured.md

The humanoid G1, its pelvis fixed, falls from random angles of its joints for a quarter of a second. dalembert takes the
cases side by side in lanes, in one call of `model.sweep`. The others run one case after the other, each from a model
that was made before: none of them has lanes, and what a call from Python costs is little beside such a run. All run in
one thread. Times are seconds of the processor, the least of several calls; the error is the largest of all cases,
against Pinocchio's accelerations integrated at 1e-13.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import metadata
from typing import Any

import numpy as np
from exact import ROOT  # puts tests/ on the path
from measure import machine
from mechanism_peers import TOLERANCES, Contender, Robot, Vector, robot_contenders, robot_file, robot_reference
from mechanisms import Mechanism, curve, has_distribution
from report import describe_machine, fill_page
from robots import files

import dalembert as da

CASES = 64
END = 0.25
SPREAD = 0.3
"""Largest angle of a joint at the start [rad]."""
WANTED = (1e-4, 1e-6, 1e-8)
PAGE = ROOT / "docs" / "many_bodies_measured.md"
MARKS = "<!-- table of a sweep: benchmarks/robot_sweeps.py --write -->", "<!-- end of the table of a sweep -->"
Points = list[tuple[float, float, float]]


def robots() -> list[Robot]:
    """Return the cases."""
    path = robot_file(next(path for path in files() if path.name == "g1_29dof_rev_1_0.urdf"))
    joints = [q.func.__name__ for q in da.Scene.from_urdf(path).coordinates]
    starts = np.random.default_rng(1).uniform(-SPREAD, SPREAD, (CASES, len(joints)))
    return [Robot(path, dict(zip(joints, map(float, a), strict=True)), dict.fromkeys(joints, 0.0), END) for a in starts]


def own(cases: Sequence[Robot]) -> Iterator[Contender]:
    """Yield dalembert in lanes, and one case after the other."""
    model = da.compile_model(da.Scene.from_urdf(cases[0].path, joint_loads=False), cache=False)
    joints = list(cases[0].angles)
    starts = {name: np.array([case.angles[name] for case in cases]) for name in joints}
    starts |= {f"{name}_dot": np.zeros(len(cases)) for name in joints}

    def together(tolerance: float) -> Callable[[], Vector]:
        def run() -> Vector:
            found = model.sweep((0.0, END), starts, {}, rtol=tolerance, atol=tolerance, threads=1)
            return np.array([found[name] for name in joints]).T

        return run

    together(TOLERANCES[0])()  # compiles

    def in_turn(tolerance: float) -> Callable[[], Vector]:
        options: dict[str, Any] = {"t_eval": [END], "rtol": tolerance, "atol": tolerance, "dense": False}

        def run() -> Vector:
            motions = [model.simulate((0.0, END), case.start_by_name, {}, **options) for case in cases]
            return np.array([[motion[name][-1] for name in joints] for motion in motions])

        return run

    yield Contender("dalembert, in lanes", TOLERANCES, together)
    yield Contender("dalembert, one by one", TOLERANCES, in_turn)


def others(cases: Sequence[Robot]) -> Iterator[Contender]:
    """Yield the programs that are installed, which run one case after the other."""
    for each in zip(*map(robot_contenders, cases), strict=True):
        yield Contender(each[0].name, each[0].settings, lambda setting, each=each: _all_of(each, setting))


def _all_of(contenders: Sequence[Contender], setting: float) -> Callable[[], Vector]:
    runs = [contender.make(setting) for contender in contenders]
    return lambda: np.array([run() for run in runs])


def measured() -> dict[str, Points]:
    """Return the points of settings, seconds of all cases, and errors of every program."""
    cases = robots()
    reference = np.array([robot_reference(case) for case in cases])
    contenders = [*own(cases), *others(cases)]
    mechanism = Mechanism("sweep", "G1 humanoid, 29 joints", "angles of the joints", reference, contenders)
    found = {}
    for contender in contenders:
        found[contender.name] = list(curve(mechanism, contender))
        print(contender.name, [f"{1e3 * s / CASES:.3g} ms: {e:.1e}" for _, s, e in found[contender.name]], flush=True)
    return found


def table(found: Mapping[str, Points]) -> str:
    """Return milliseconds of a case to the wanted errors, and how many times those in lanes, in Markdown."""
    lines = [
        f"| milliseconds of a case, to an error of | {' | '.join(f'{wanted:.0e}' for wanted in WANTED)} |",
        "|---|" + "--:|" * len(WANTED),
    ]
    first = next(iter(found.values()))
    for name, points in found.items():
        cells = [_cell(_least(points, wanted), _least(first, wanted), points is first) for wanted in WANTED]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _least(points: Points, wanted: float) -> float | None:
    return min((seconds for _, seconds, error in points if error <= wanted), default=None)


def _cell(seconds: float | None, of_lanes: float | None, lanes: bool) -> str:
    if seconds is None:
        return ""
    ratio = "" if lanes or of_lanes is None else f" ({float(f'{seconds / of_lanes:.2g}'):g}x)"
    return f"{1e3 * seconds / CASES:.3g}{ratio}"


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write the table into docs/many_bodies_measured.md")
    options = parser.parse_args()
    text = table(measured())
    print(text)
    if options.write:
        names = [name for name in ("pin", "mujoco", "drake", "exudyn") if has_distribution(name)]
        peers = ", ".join(f"{name} {metadata.version(name)}" for name in names)
        fill_page(PAGE, MARKS, f"{text}\n\nMeasured on {describe_machine(machine())}; {peers}.")


if __name__ == "__main__":
    sys.exit(main())
