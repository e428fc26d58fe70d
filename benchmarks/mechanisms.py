"""Whole motions of five mechanisms: time against error, beside programs for mechanics.

Needs, beside the library, any of these packages; those that are missing are left out:

    pip install pin example-robot-data mujoco drake exudyn pydy cython setuptools
    python benchmarks/mechanisms.py                     # prints the table
    python benchmarks/mechanisms.py --write             # also writes README.md and the picture
    python benchmarks/mechanisms.py arm squeezer        # some mechanisms

Every program runs one motion from Python, at settings from loose to tight, and the error of what is observed at the end
is taken against a reference that is not ours: published digits, a closed form, or Pinocchio's accelerations integrated
at 1e-13. A time is the least of several calls, once everything is compiled, in seconds of the processor: all run in one
thread, and other work of the machine does not count. The table has the least time of each program to an error of 1e-6.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import mechanism_loops as loops
import numpy as np
from exact import ROOT  # puts tests/ on the path
from figures import PROGRAM_COLOURS
from measure import machine
from mechanism_peers import TOLERANCES, Contender, Robot, installed, robot_contenders, robot_file, robot_reference
from numpy.typing import NDArray
from report import describe_machine, fill_page
from robots import files
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da
from hard_cases.loops import ANDREWS_START, andrews, andrews_parameters, andrews_scene

Vector = NDArray[np.float64]
WANTED = 1e-6
PATIENCE = 5.0
"""Seconds of one run beyond which no tighter setting of a program is tried."""
RESULTS = ROOT / "benchmarks" / "results" / "mechanisms.json"
PICTURE = ROOT / "docs" / "pictures" / "mechanisms.png"
MARKS = "<!-- mechanisms: begin (written by benchmarks/mechanisms.py) -->", "<!-- mechanisms: end -->"


@dataclass(frozen=True)
class Mechanism:
    """A motion: what it is, what is observed at its end, the exact value of that, and who runs it."""

    name: str
    title: str
    observed: str
    reference: Vector
    contenders: Sequence[Contender]
    first: float = field(default=0.0)
    """Seconds from the empty scene to the first motion by dalembert, of a process that has imported it."""


def _own(
    build: Callable[[], da.Scene], start: Mapping[str, float], p: Mapping[str, float], end: float, names: Sequence[str]
) -> tuple[Contender, float]:
    """Return dalembert as a contender, and the seconds from the scene to the first motion."""
    begin = perf_counter()
    model = da.compile_model(build(), cache=False)
    model.simulate((0.0, end), start, p, t_eval=[end])
    first = perf_counter() - begin

    def make(tolerance: float) -> Callable[[], Vector]:
        options: dict[str, Any] = {"t_eval": [end], "rtol": tolerance, "atol": tolerance, "dense": False}

        def run() -> Vector:
            motion = model.simulate((0.0, end), start, p, **options)
            return np.array([motion[name][-1] for name in names])

        return run

    return Contender("dalembert", TOLERANCES, make), first


def _robot(name: str, title: str, path: Path, angle: float, rate: float, end: float) -> Mechanism:
    """Return the motion of a robot with a fixed base from random angles and rates up to the given sizes."""
    path = robot_file(path)
    build = lambda: da.Scene.from_urdf(path, joint_loads=False)  # noqa: E731
    joints = [q.func.__name__ for q in build().coordinates]
    rng = np.random.default_rng(1)
    angles, rates = (dict(zip(joints, rng.uniform(-size, size, len(joints)), strict=True)) for size in (angle, rate))
    robot = Robot(path, angles, rates, end)
    own, first = _own(build, robot.start_by_name, {}, end, joints)
    reference = robot_reference(robot)
    return Mechanism(name, title, "angles of the joints", reference, [own, *robot_contenders(robot)], first)


def _named(name: str) -> Path:
    return next(path for path in files() if path.name == name)


def _chain_file(n: int) -> Path:
    """Return a URDF file of a chain of n equal rods in a vertical plane."""
    links = ['<link name="l0"/>']
    for i in range(1, n + 1):
        place = '<origin xyz="0.25 0 0"/><mass value="1"/>'
        moments = '<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/>'
        links.append(f'<link name="l{i}"><inertial>{place}{moments}</inertial></link>')
        free = '<limit lower="-1e9" upper="1e9" effort="0" velocity="1e9"/>'
        at = f'<origin xyz="{0.5 if i > 1 else 0} 0 0"/><axis xyz="0 1 0"/>{free}'
        links.append(f'<joint name="q{i}" type="revolute"><parent link="l{i - 1}"/><child link="l{i}"/>{at}</joint>')
    path = ROOT / "build" / f"chain{n}.urdf"
    path.parent.mkdir(exist_ok=True)
    path.write_text(f'<robot name="chain{n}">{"".join(links)}</robot>')
    return path


def _squeezer() -> Mechanism:
    p, end, names = andrews_parameters(), 0.03, list(ANDREWS_START)
    start = {**ANDREWS_START, **{f"{name}_dot": 0.0 for name in names}}
    own, first = _own(andrews_scene, start, p, end, names)
    others = []
    if installed("pydy") and installed("Cython"):
        make = loops.squeezer_sympy(andrews_scene(), p, ANDREWS_START, end)
        others.append(Contender("PyDy, SciPy's DOP853", TOLERANCES, make))
    if installed("exudyn"):
        steps = (100, 300, 1000, 3000, 10_000, 30_000)
        others.append(Contender("Exudyn, trapezoidal", steps, loops.squeezer_exudyn(p, ANDREWS_START, end)))
    reference = np.array([float(x) for x in andrews().values[end][:7]])
    title = "Andrews' squeezer: 7 bars, 3 loops"
    return Mechanism("squeezer", title, "angles of the bars", reference, [own, *others], first)


def _block_scene() -> da.Scene:
    x = dynamicsymbols("x")
    m, k, most = symbols("m k F", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    P, T = O.locatenew("P", x * N.x), da.unknowns("T")
    scene = da.Scene("block", frame=N, origin=O, coordinates=[x])
    scene.add_bodies(Particle("block", P, m))
    scene.add_loads((P, -k * x * N.x))
    scene.add_joints(da.Joint("floor", body="block", at=P, force=T * N.x))
    scene.add_friction(da.CoulombFriction(normal=most, tangential=T, mu=1, name="floor"))
    return scene


def _block() -> Mechanism:
    mass, stiffness, friction, x, end = 1.0, 100.0, 5.0, 1.03, 4.0
    own, first = _own(_block_scene, {"x": x, "x_dot": 0.0}, {"m": mass, "k": stiffness, "F": friction}, end, ["x"])
    others, values = [], (mass, stiffness, friction, x, end)
    if installed("mujoco"):
        steps = (1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5)
        others.append(Contender("MuJoCo, implicitfast", steps, loops.block_mujoco(*values)))
    if installed("exudyn"):
        steps = (1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5)
        others.append(Contender("Exudyn, generalized alpha", steps, loops.block_exudyn(*values)))
    reference = np.array([loops.block_position(mass, stiffness, friction, x)])
    return Mechanism("block", "Block, spring, dry friction", "where it comes to rest", reference, [own, *others], first)


MECHANISMS: dict[str, Callable[[], Mechanism]] = {
    "arm": lambda: _robot("arm", "UR5 arm, 6 joints", _named("ur5_robot.urdf"), 1.0, 1.0, 1.0),
    "humanoid": lambda: _robot("humanoid", "G1 humanoid, 29 joints", _named("g1_29dof_rev_1_0.urdf"), 0.3, 0.0, 0.25),
    "chain": lambda: _robot("chain", "Chain of 50 rods", _chain_file(50), 0.1, 0.0, 1.0),
    "squeezer": _squeezer,
    "block": _block,
}


def curve(mechanism: Mechanism, contender: Contender) -> Iterator[tuple[float, float, float]]:
    """Yield setting, seconds and error, up to an error that is all rounding, or a run that takes too long."""
    least = float("inf")
    worse = 0
    for setting in contender.settings:
        run = contender.make(setting)
        try:
            found = run()
        except (RuntimeError, ValueError):  # a program that gives up at this setting
            continue
        error = float(np.max(np.abs(found - mechanism.reference) / np.maximum(1.0, np.abs(mechanism.reference))))
        if not error < 1.0:  # it gives nothing at this setting
            continue
        seconds = _least(run)
        yield setting, seconds, error
        worse = worse + 1 if error >= least else 0
        least = min(least, error)
        if error < 1e-11 or seconds > PATIENCE or worse == 2:
            return


def has_distribution(distribution: str) -> bool:
    """Whether a distribution is installed."""
    try:
        return bool(metadata.version(distribution))
    except metadata.PackageNotFoundError:
        return False


def _least(run: Callable[[], Any]) -> float:
    """Return the least seconds of five calls, of fewer where they take long."""
    best, spent = float("inf"), 0.0
    for _ in range(5):
        begin = process_time()
        run()
        seconds = process_time() - begin
        best, spent = min(best, seconds), spent + seconds
        if spent > 2.0:
            break
    return best


def measured(names: Sequence[str]) -> dict[str, Any]:
    """Return curves of the mechanisms by the names of programs, as JSON takes them."""
    peers = {
        name: metadata.version(name) for name in ("pydy", "pin", "mujoco", "drake", "exudyn") if has_distribution(name)
    }
    found: dict[str, Any] = {"machine": machine(), "peers": peers, "mechanisms": {}}
    for name in names:
        mechanism = MECHANISMS[name]()
        curves = {}
        for contender in mechanism.contenders:
            curves[contender.name] = list(curve(mechanism, contender))
            print(
                name, contender.name, [f"{1e3 * s:.3g} ms: {e:.1e}" for _, s, e in curves[contender.name]], flush=True
            )
        found["mechanisms"][name] = {
            "title": mechanism.title,
            "observed": mechanism.observed,
            "first": mechanism.first,
            "curves": curves,
        }
    return found


PROGRAMS = tuple(PROGRAM_COLOURS)


def table(found: Mapping[str, Any]) -> str:
    """Return the times to the wanted error as a table in Markdown."""
    lines = [f"| time to an error of {WANTED:.0e} | {' | '.join(PROGRAMS)} |", "| --- |" + " ---: |" * len(PROGRAMS)]
    for entry in found["mechanisms"].values():
        own = _time(entry["curves"]["dalembert"])
        cells = []
        for program in PROGRAMS:
            points = [point for name, p in entry["curves"].items() if name.split(",")[0] == program for point in p]
            cells.append(_cell(points, own))
        lines.append(f"| {entry['title']} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _time(points: Sequence[Sequence[float]]) -> float | None:
    return min((seconds for _, seconds, error in points if error <= WANTED), default=None)


def _cell(points: Sequence[Sequence[float]], own: float | None) -> str:
    if not points:
        return "-"
    seconds = _time(points)
    if seconds is None:
        _, seconds, error = min(points, key=lambda point: point[2])
        return f"{error:.1e} in {_milliseconds(seconds)}"
    ratio = "" if own is None or seconds is own or seconds == own else f" ({float(f'{seconds / own:.2g}'):g}x)"
    return f"{_milliseconds(seconds)}{ratio}"


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms"


def draw(found: Mapping[str, Any]) -> None:
    """Write the picture: error against time, a panel a mechanism; second methods of a program are broken lines."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    entries = list(found["mechanisms"].values())
    figure, panels = plt.subplots(2, 3, figsize=(10, 6), layout="constrained", sharey=True)
    for panel, entry in zip(panels.flat, entries, strict=False):
        shown: list[str] = []
        for name, points in entry["curves"].items():
            program = name.split(",")[0]
            times, errors = ([point[i] for point in points] for i in (1, 2))
            style: dict[str, Any] = {"lw": 2.2, "zorder": 5} if program == "dalembert" else {"lw": 1.2}
            style |= {"color": PROGRAM_COLOURS[program], "label": program, "ms": 3}
            panel.loglog(1e3 * np.array(times), errors, "s--" if program in shown else "o-", **style)
            shown.append(program)
        panel.set(title=entry["title"], xlabel="time of a run [ms]", ylim=(1e-12, 10))
        panel.grid(alpha=0.3)
    for panel in panels[:, 0]:
        panel.set_ylabel("error at the end")
    handles: dict[str, Any] = {}
    for panel in panels.flat:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    spare = panels.flat[len(entries)]
    spare.axis("off")
    spare.legend(handles.values(), handles.keys(), loc="center", frameon=False, fontsize=11)
    figure.savefig(PICTURE, dpi=110)


def write(found: Mapping[str, Any]) -> None:
    """Put the table into the README, and draw the picture."""
    draw(found)
    firsts = ", ".join(f"{entry['first']:.1f} s ({name})" for name, entry in found["mechanisms"].items())
    peers = ", ".join(f"{name} {version}" for name, version in found["peers"].items())
    note = (
        f"From an empty scene to its first motion, dalembert takes {firsts}. Measured on"
        f" {describe_machine(found['machine'])}; {peers}."
    )
    fill_page(ROOT / "README.md", MARKS, f"{table(found)}\n\n{note}")


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[*MECHANISMS, []], help="mechanisms; all by default")
    parser.add_argument("--write", action="store_true", help="write the table into the README, and the picture")
    parser.add_argument("--from-results", action="store_true", help="take the figures of the last run")
    options = parser.parse_args()
    if options.from_results:
        found = json.loads(RESULTS.read_text(encoding="utf-8"))
    else:
        found = measured(options.names or list(MECHANISMS))
        if not options.names:
            RESULTS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(table(found))
    if options.write:
        write(found)


if __name__ == "__main__":
    sys.exit(main())
