"""The demo: the scenes of the text from symbols to checked trajectories, in two minutes. Pictures in build/demo.

Run by `make demo`; takes no arguments.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from typing import Any

os.environ.setdefault("MPLBACKEND", "Agg")

import figures
import numpy as np
from contenders import available_backends
from exact import END, ROOT, SLEIGH, SPHERE, Case, final_error, spatial_angular_velocity
from measure import machine
from pendulum import DRIFT_STEPS, STEP, drift
from precision import work_precision
from startup import first_trajectory, import_seconds
from tables import describe_machine, precision_text, startup_text

import dalembert as da
from dalembert.ir.kernel import describe_counts

PICTURES = ROOT / "build" / "demo"
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
FORMULATIONS = ("minimal", "projected")


def main() -> None:
    """Run the demo."""
    begin = time.perf_counter()
    say(f"dalembert {da.__version__}: {describe_machine(machine())}")
    backends, missing = available_backends()
    for line in missing:
        say(line)
    show_scene("The Chaplygin sleigh (example 13.4.6)", SLEIGH, ("X", "Y"))
    show_scene("The rolling sphere (example 13.4.3)", SPHERE, ("F_u", "F_v"))
    show_corner_plate()
    show_edge_plate()
    show_motions()
    show_drift()
    show_precision(backends)
    show_startup(backends)
    heading(f"Done in {time.perf_counter() - begin:.0f} s")
    say("pictures: " + ", ".join(str(path.relative_to(ROOT)) for path in sorted(PICTURES.iterdir())))


def say(text: str = "") -> None:
    """Print at once, also into a pipe."""
    print(text, flush=True)


def heading(text: str) -> None:
    """Print a heading."""
    say(f"\n== {text}")


def show_scene(title: str, case: Case, reactions: Sequence[str]) -> None:
    """Derive a scene, print what was found, simulate it and compare with its exact solution."""
    heading(title)
    scene = da.scenes.ALL[case.scene]()
    model = da.compile_model(scene, backend="llvm", outputs=reactions)
    say(model.explain())
    rhs = model.stages.program.kernel("rhs")
    say(f"\nequations found, {describe_counts(rhs)}; the right-hand side, one line an operation:")
    say("\n".join(f"  {line}" for line in str(rhs).splitlines()))
    say(f"model.source is what runs: {len(model.source.splitlines()):,} lines of LLVM assembly")
    motion = model.simulate((0, END), case.initial, case.parameters, rtol=1e-12, atol=1e-14)
    say(f"\n{END:g} s at rtol 1e-12: {motion.stats.steps} steps of {motion.stats.method}. {motion.message}")
    error, violation = final_error(case, motion.q[-1], motion.qdot[-1]), np.abs(motion.constraint_violation).max()
    say(f"  largest error at the end against the exact solution  {error:.1e}")
    say(f"  largest constraint violation                         {violation:.1e}")
    largest = ", ".join(f"|{name}| <= {np.abs(motion[name]).max():.2g} N" for name in reactions)
    say(f"  reactions along the motion                           {largest}")


def show_corner_plate() -> None:
    """Let a plate rub on a corner, and show how it slips and sticks."""
    heading("The plate against a corner, with Coulomb friction (example 13.4.2)")
    model = da.compile_model(da.scenes.corner_plate(friction=True), outputs=["N_Q", "F_Q"])
    start = {"x": -0.5 / np.tan(0.6), "theta": 0.6, "theta_dot": 1.0}
    mu = 0.8
    motion = model.simulate((0, 2), start, {"m": 1, "l": 1, "h": 0.5, "g": 9.81, "F_A": 4, "mu": mu}, rtol=1e-12)
    for phase in motion.phases:
        say(f"  {phase.t0:.12f} s to {phase.t1:.12f} s: {phase.modes['corner']}")
    slips = motion.mode("corner") == "slip"
    share = np.abs(motion["F_Q"]) / (mu * motion["N_Q"])
    say(f"  |F_Q| / (mu N_Q): 1 to {np.abs(share[slips] - 1).max():.1e} in slip, {share[~slips].max():.3f} in stick")
    say(f"  largest constraint violation {np.abs(motion.constraint_violation).max():.1e}")


def show_edge_plate() -> None:
    """Let a plate fall that slides on its edge, and show what is conserved."""
    heading("The plate with a sliding edge (example 13.4.4)")
    model = da.compile_model(da.scenes.edge_plate(), outputs=["Z"])
    start = {"x": 0, "y": 0, "psi": 0.3, "theta": 1.2, "x_dot": 0.5, "y_dot": 0, "psi_dot": 0, "theta_dot": 0}
    moments = {"A": 0.1, "B": 0.2, "C": 0.3, "F": 0.05}
    motion = model.simulate((0, 0.5), start, {"m": 1, "h": 0.5, "g": 9.81, **moments}, rtol=1e-12)
    for name, values in motion.invariants.items():
        say(f"  {name} is conserved to {np.ptp(values) / max(1.0, np.abs(values[0])):.1e}")
    say(f"  the plane bears {motion['Z'].min():.2f} to {motion['Z'].max():.2f} N")


def show_motions() -> None:
    """Draw the motions of sleigh and sphere and the energy error of every formulation."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    runs: dict[str, Any] = {}
    for name, case in (("sleigh", SLEIGH), ("sphere", SPHERE)):
        for formulation in FORMULATIONS:
            model = da.compile_model(da.scenes.ALL[case.scene](), formulation=formulation)
            motion = model.simulate((0, END), case.initial, case.parameters, rtol=1e-9, atol=1e-11)
            runs[f"{name}, {formulation}"] = motion
    figures.energy_picture(runs, PICTURES / "energy.png", "energy error at rtol 1e-9")
    figures.sleigh_picture(runs["sleigh, minimal"], SLEIGH.parameters["b"], PICTURES / "sleigh.png")
    runs["sleigh, minimal"].animate(fps=5, speed=2).save(PICTURES / "sleigh.gif", dpi=60)
    fine = runs["sphere, minimal"](np.linspace(0, END, 400))
    figures.sphere_picture(fine, spatial_angular_velocity(fine.q, fine.qdot), PICTURES / "sphere.png")


def show_drift() -> None:
    """Compare what holds the constraint of a pendulum in Cartesian coordinates over many steps."""
    heading(f"Drift: a pendulum with x**2 + y**2 = L**2, {DRIFT_STEPS:,} steps of {STEP:g} s")
    runs = {name: drift(name) for name in ("projected", "augmented")}
    say(f"{'':12}{'steps':>9}{'position violation':>21}{'velocity violation':>21}{'energy error / mgL':>21}{'run':>10}")
    for name, motion in runs.items():
        position, velocity = np.abs(motion.constraint_violation).max(), np.abs(motion.velocity_violation).max()
        energy = np.abs(motion["energy"] - motion["energy"][0]).max() / 9.81
        row = f"{name:12}{motion.stats.steps:9,}{position:21.1e}{velocity:21.1e}{energy:21.1e}"
        say(row + f"{1e3 * motion.stats.run_seconds:7.0f} ms")
    title = f"Pendulum in Cartesian coordinates, {runs['projected'].stats.method} with steps of {STEP:g} s"
    figures.drift_picture(runs, PICTURES / "drift.png", title)


def show_precision(backends: Sequence[str]) -> None:
    """Measure speed against error for every backend, formulation and method."""
    heading("Speed against error: 10 s of motion, one trajectory")
    records = work_precision(
        backends,
        TOLERANCES,
        formulations=FORMULATIONS,
        methods={"numba": 2, "numpy": 1, "jax": 1},
        rounds=5,
        seconds_each=0.1,
        slowest=0.05,
        names=("sleigh", "sphere"),
        say=say,
    )
    say(
        "run: the integration alone, by model.prepare(); call: simulate() as called, with its checks and its Trajectory"
    )
    say("error: the largest of all coordinates and rates at the end, against the exact solution\n")
    say(precision_text(records))
    figures.work_precision(records, PICTURES / "work_precision.png")


def show_startup(backends: Sequence[str]) -> None:
    """Measure the first trajectory in new processes, with empty caches and with what that left."""
    heading("Start-up: the sleigh's first trajectory in a new process, seconds")
    say("first process: empty caches, the library's own integrator loop included; second: what that left behind\n")
    say(startup_text({backend: first_trajectory(backend) for backend in backends}))
    seconds = import_seconds(3)
    say("\nimports alone: " + ", ".join(f"{name} {value:.2f} s" for name, value in seconds.items()))


if __name__ == "__main__":
    main()
