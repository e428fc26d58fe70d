"""Run the hard cases of `tests/hard_cases`: benchmarks/results/hard_cases.json, from which `hard_case_pages` writes.

``python benchmarks/report_hard_cases.py`` runs two cases at a time and takes some ten minutes; ``--quick`` leaves the
long runs at a hundredth of their length and writes everything to build/ instead. ``--only NAME ...`` prints the entries
of some cases, ``long`` the long runs, and writes nothing. What it measures is deterministic but for the times.
"""

from __future__ import annotations

import argparse
import inspect
import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from exact import ROOT  # puts tests/ on the path
from hard_case_pages import DATA, dump, number, rounded, table, write
from hard_case_pictures import draw_motions
from measure import machine
from report_contacts import contact_data
from stiff import stiff_methods
from symmetric import kept_integrals, symmetric_methods

import dalembert as da
from dalembert.reduction import FORMULATIONS
from hard_cases import CASES, hard_case
from hard_cases.case import HardCase
from hard_cases.machines import bicycle_linearized, bicycle_parameters, bicycle_scene

TOLERANCE = {"taylor": 1e-16, "dop853": 1e-15, "tsit5": 1e-11, "radau": 1e-9}
"""The tightest tolerance that each method makes use of."""

SHORT = 1e-6
"""Share of the first time up to which a run goes that only compiles."""

HELD = ("minimal", "projected")
LONG = (
    ("sleigh, b = 0", 1e5, HELD),
    ("sleigh, b = 0", 1e4, ("augmented",)),
    ("sphere with unequal moments", 1e5, HELD),
    ("free body near its unstable axis", 1e5, HELD),
    ("free body near its unstable axis", 1e4, ("augmented",)),
    ("pendulum, Cartesian (IFToMM A01)", 1e5, ("projected",)),
    ("pendulum, Cartesian (IFToMM A01)", 1e4, ("augmented",)),
    ("double pendulum, Cartesian", 1e5, ("projected",)),
    ("double pendulum, angles", 1e5, ("minimal",)),
    ("rolling disk", 1e5, ("minimal",)),
    ("slider-crank", 1e4, ("projected",)),
    ("slider-crank", 1e3, ("augmented",)),
)


def figures(case: HardCase, formulation: str) -> dict[str, Any]:
    """Return error, drift and milliseconds by method, or why there are none."""
    try:
        model = case.compile(formulation)
    except da.errors.FormulationError as error:
        return {"why": str(error).split(": ", 1)[1].split(". Use")[0]}
    found: dict[str, Any] = {}
    for method in model.methods:
        rtol = max(case.rtol, TOLERANCE[method]) if case.rtol > 1e-13 else TOLERANCE[method]
        budget = 200_000 if case.may_fail else 2_000_000
        options = {"method": method, "rtol": rtol, "atol": rtol / 100, "max_steps": budget}
        try:
            short = (0.0, SHORT * case.times()[0])
            model.simulate(short, case.initial, case.parameters, t_eval=short, dense=False, **options)  # compiles
            run = case.simulate(model, all_of_them=True, **options)
        except da.errors.DalembertError as error:
            found[method] = {"why": type(error).__name__}
            continue
        if run.success:
            values = {"error": case.error(run), "drift": case.change(run), "ms": 1e3 * run.stats.run_seconds}
            found[method] = {name: rounded(value) for name, value in values.items()}
        else:
            found[method] = {"why": run.status.name}
    return found


def case_entry(name: str) -> dict[str, Any]:
    """Return what the data have of a case."""
    case = hard_case(name)
    free = not (case.scene.holonomic_constraints or case.scene.nonholonomic_constraints)
    results = {"all": figures(case, "minimal")} if free else {name: figures(case, name) for name in FORMULATIONS}
    print(f"{name}: {results}", flush=True)
    return {
        "hard": " ".join((inspect.getdoc(CASES[name]) or "").split()),
        "quantity": case.quantity or ", ".join(map(str, case.observed)),
        "times": case.times(all_of_them=True),
        "source": case.source,
        "formulations": results,
    }


@dataclass(frozen=True)
class LongRun:
    """A row of the table of long runs, and a curve: its label, times, and the largest change of the energy so far."""

    row: list[str]
    label: str
    times: np.ndarray
    energy: np.ndarray


def long_run(name: str, end: float, formulation: str) -> LongRun:
    """Run by Taylor steps for long: changes of first integrals and violations of constraints."""
    case = hard_case(name)
    times = np.concatenate([[0.0], np.geomspace(end / 1000, end, 25)])
    model = case.compile(formulation)
    run = model.simulate(
        (0, end),
        case.initial,
        case.parameters,
        t_eval=times,
        **{"method": "taylor", "rtol": 1e-16, "atol": 1e-18, "max_steps": 100_000_000, "dense": False},
    )
    size = max(abs(run["energy"][0]), float(np.max(run["kinetic_energy"])))
    energy = np.abs(run["energy"] - run["energy"][0]) / size
    others = [run[x] for x in case.conserved if x != "energy"]
    rest = max((float(np.max(np.abs(x - x[0]) / max(1.0, abs(x[0])))) for x in others), default=0.0)
    positions = np.max(np.abs(run.constraint_violation[:, : model.layout.holonomic]), initial=0.0)
    rates = np.max(np.abs(run.velocity_violation), initial=0.0)
    print(name, formulation, run.status.name, flush=True)
    shown = formulation if model.layout.constraints else "all"
    row = [name, shown, f"{end:.0e}", f"{run.stats.steps:,}", run.status.name]
    row += [number(float(x)) for x in (energy.max(), rest, positions, rates)] + [f"{run.stats.run_seconds:.1f}"]
    drift = np.maximum(np.maximum.accumulate(energy)[1:], 1e-17)
    return LongRun(row, f"{name}, {formulation}", times[1:], drift)


def draw(runs: Sequence[LongRun], path: Path) -> None:
    """Draw the drift of the energy over time, with the square root of the number of roundings beside it."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(8, 5))
    for run in runs:
        axes.loglog(run.times, run.energy, "--" if "augmented" in run.label else "-", label=run.label)
    t = np.geomspace(1e2, 1e5, 10)
    axes.loglog(t, 1.1e-16 * np.sqrt(10 * t), "k:", label="1e-16 sqrt(10 t)")
    axes.axhline(1e-12, color="k", linewidth=0.5)
    axes.set_xlabel("time")
    axes.set_ylabel("largest relative change of the energy so far")
    axes.legend(fontsize=6)
    figure.tight_layout()
    figure.savefig(path, dpi=120, metadata={"Software": None})


def bicycle() -> dict[str, str]:
    """Return what the accelerations and the eigenvalues of the bicycle agree to."""
    from hard_cases.case import reference
    from hard_cases.machines import COORDINATES

    model = da.compile_model(bicycle_scene(), backend="numpy", formulation="projected")
    entry = reference("basu_mandal_nonlinear_bicycle")
    given = {key: float(value) for key, value in entry["initial_conditions"].items()}
    q, qdot = ([given[f"{name}{end}"] for name in COORDINATES] for end in ("", "d"))
    expected = [float(entry["values"]["table1_own_20_digits"][f"{name}dd"]) for name in COORDINATES]
    accelerations = np.max(np.abs(model.accelerations(0.0, q, qdot, bicycle_parameters()) - expected))
    table = reference("whipple_bicycle_eigenvalues")["values"]["table"]
    worst = 0.0
    for speed in range(11):
        theirs = np.sort_complex([complex(float(a), float(b)) for a, b in table[str(speed)]["mine"]])
        worst = max(worst, float(np.max(np.abs(np.sort_complex(bicycle_linearized(model, speed)) - theirs))))
    return {"bicycle_accelerations": number(float(accelerations)), "bicycle_eigenvalues": number(worst)}


def _machine() -> str:
    known = machine()
    versions = ", ".join(f"{name} {version}" for name, version in known["versions"].items())
    return f"{known['cores']} cores, {known['cpu']}, Python {known['python']}; {versions}"


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="short long runs, written to build/")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="print the entries of these cases, and write nothing")
    options = parser.parse_args()
    folder = ROOT / ("build" if options.quick else "docs")
    unknown = [name for name in options.only or () if name not in (*CASES, "long")]
    if unknown:
        parser.error(f"no such case: {', '.join(unknown)}. There are: {', '.join((*CASES, 'long'))}")
    share = 0.01 if options.quick else 1.0
    jobs = [(name, share * end, formulation) for name, end, of in LONG for formulation in of]
    names = [name for name in CASES if not options.only or name in options.only]
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        long_runs = [pool.submit(long_run, *job) for job in jobs if not options.only or "long" in options.only]
        cases = dict(zip(names, pool.map(case_entry, names), strict=True))
        long = [run.result() for run in long_runs]
    if options.only:
        print(dump({"cases": cases, "long": [run.row for run in long]}))
        return
    folder.mkdir(exist_ok=True)
    draw(long, folder / "hard_cases_drift.png")
    draw_motions(folder / "hard_cases_motions.png")
    head = [
        "case",
        "formulation",
        "time",
        "steps",
        "status",
        "energy",
        "other integrals",
        "positions",
        "velocities",
        "s",
    ]
    contacts = contact_data()
    data = {
        "machine": _machine(),
        "tolerances": TOLERANCE,
        "cases": cases,
        **contacts,
        "checks": contacts["checks"] | bicycle(),
        "table_long": {"head": head, "rows": [run.row for run in long]},
        "table_stiff": table(stiff_methods()),
        "table_symmetric": table(symmetric_methods()),
        "table_kept": table(kept_integrals()),
    }
    (folder / "hard_cases.json" if options.quick else DATA).write_text(dump(data), encoding="utf-8")
    write(data, folder)


if __name__ == "__main__":
    main()
