"""Run the hard cases of `tests/hard_cases` and write docs/hard_cases.md.

``python benchmarks/report_hard_cases.py`` runs two rows at a time and takes some ten minutes; ``--quick`` leaves the
long runs at a hundredth of their length and writes to build/ instead. ``--only NAME ...`` prints the rows of some
cases, ``long`` the long runs, and writes nothing. What it measures is deterministic but for the times.
"""

from __future__ import annotations

import argparse
import inspect
import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from exact import ROOT  # puts tests/ on the path
from hard_case_pictures import draw_motions
from measure import machine
from report_contacts import contact_section
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


@dataclass(frozen=True)
class Entry:
    """One run: its error, the drift of its first integrals, seconds, or why there is none."""

    error: float = np.nan
    drift: float = np.nan
    seconds: float = np.nan
    why: str = ""


def entries(case: HardCase, formulation: str) -> dict[str, Entry]:
    """Return one entry a method."""
    try:
        model = case.compile(formulation)
    except da.errors.FormulationError as error:
        return {"": Entry(why=str(error).split(": ", 1)[1].split(". Use")[0])}
    found = {}
    for method in model.methods:
        rtol = max(case.rtol, TOLERANCE[method]) if case.rtol > 1e-13 else TOLERANCE[method]
        budget = 200_000 if case.may_fail else 2_000_000
        options = {"method": method, "rtol": rtol, "atol": rtol / 100, "max_steps": budget}
        try:
            short = (0.0, SHORT * case.times()[0])
            model.simulate(short, case.initial, case.parameters, t_eval=short, dense=False, **options)  # compiles
            run = case.simulate(model, all_of_them=True, **options)
        except da.errors.DalembertError as error:
            found[method] = Entry(why=type(error).__name__)
            continue
        if run.success:
            found[method] = Entry(case.error(run), case.change(run), run.stats.run_seconds)
        else:
            found[method] = Entry(why=run.status.name)
    return found


def number(value: float) -> str:
    """Return a figure with one digit."""
    return "0" if value == 0.0 else f"{value:.0e}"


def cells(results: dict[str, dict[str, Entry]], field: str) -> str:
    """Return the figures of a case, a line a formulation, methods side by side."""
    lines = []
    for formulation, found in results.items():
        if "" in found:
            lines.append(f"{formulation}: -")
            continue
        scale = 1e3 if field == "seconds" else 1.0
        texts = [entry.why or number(scale * getattr(entry, field)) for entry in found.values()]
        texts = [f"{float(x):.3g}" if field == "seconds" and x[0].isdigit() else x for x in texts]
        lines.append(f"{formulation}: " + " / ".join(texts))
    return "<br>".join(lines)


def case_row(name: str) -> tuple[str, set[str]]:
    """Return the row of a case, and the reasons of formulations that cannot serve it."""
    case = hard_case(name)
    results, reasons = {}, set()
    free = not (case.scene.holonomic_constraints or case.scene.nonholonomic_constraints)
    for formulation in FORMULATIONS:
        if free and formulation != "minimal":
            continue
        found = entries(case, formulation)
        results[formulation if not free else "all"] = found
        reasons |= {f"{formulation}: {found[''].why}"} if "" in found else set()
        print(f"{name}, {formulation}: {found}", flush=True)
    hard = " ".join((inspect.getdoc(CASES[name]) or "").split())
    quantity = case.quantity or ", ".join(map(str, case.observed))
    times = ", ".join(f"{t:g}" for t in case.times(all_of_them=True))
    figures = (cells(results, field) for field in ("error", "drift", "seconds"))
    return f"| **{name}**. {hard} | {quantity}; t = {times} | {case.source} | " + " | ".join(figures) + " |", reasons


@dataclass(frozen=True)
class LongRun:
    """A row of the table of long runs, and a curve: its label, times, and the largest change of the energy so far."""

    row: str
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
    row = (
        f"| {name} | {shown} | {end:.0e} | {run.stats.steps:,} | {run.status.name} | {number(float(energy.max()))} |"
        f" {number(rest)} | {number(float(positions))} | {number(float(rates))} | {run.stats.run_seconds:.1f} |"
    )
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


def bicycle() -> str:
    """Return what the bicycle's eigenvalues agree to."""
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
    return (
        f"The nine accelerations of the full model (9 coordinates, 6 constraints) at the state of Basu-Mandal et al.\n"
        f"(Proc. R. Soc. A 463 (2007) 1983, table 1) differ from 20-digit values by {number(accelerations)}. The 44\n"
        "eigenvalues at 0 to 10 m/s (Meijaard et al., the same volume, table 2), by `model.linearize`, differ by\n"
        f"{number(worst)}."
    )


TEMPLATE = """# Hard cases

Written by `benchmarks/report_hard_cases.py` from a run ({machine}).
The scenes, their reference values and bounds are in `tests/hard_cases`, and every case is a test there.

Errors are the largest over the observed quantities and times, relative to max(1, size). Drift is the largest change of
a first integral, the energy relative to its size or the largest kinetic energy. Figures stand for the methods
{methods}, at rtol = {tolerances} (Andrews: 1e-10); times are milliseconds of a call of
`simulate` once compiled, with another process at work on the second core. Where a run ends otherwise, its status stands
in place of the figure. A scene without constraints is the same in all formulations.

| case and why it is hard | reference quantity | source | error | drift | ms |
| --- | --- | --- | --- | --- | --- |
{rows}

![Six of the motions](hard_cases_motions.png)

Formulations that cannot serve, with the reason that `compile_model` gives:

{reasons}

{contacts}
## Whipple bicycle

{bicycle}

## Long runs

Taylor steps at rtol = 1e-16; the energy relative to its size or to the largest kinetic energy, other first integrals to
max(1, size), constraints in the units of the scene.

| case | formulation | time | steps | status | energy | other integrals | positions | velocities | s |
| --- | --- | ---: | ---: | --- | ---: | ---: | ---: | ---: | ---: |
{long}

![Drift of the energy](hard_cases_drift.png)

Where these figures come from: time and state are summed with compensation, and the recurrences divide by the order
with one rounding. Before, the phase of a harmonic oscillator was off by 6e-10 and its energy by 1.5e-12 after 1e5
time units; now by 2e-14 and 3e-14. What is left grows like the square root of the number of steps, as independent
roundings do, or with time where a sum stays near 1, below which doubles are twice as dense (the length of the pendulum,
the blade of the sleigh): that grows with the square of the step, so that steps at the floor are shorter than truncation
asks for. `projected` holds the constraints to rounding; `augmented` drifts.

A number of 1e5 rad carries fewer digits of the angle than one of 1 rad. Angles that matter modulo a turn therefore
lose the turns that they have made while Taylor steps go on, and get them back where they are recorded; energies,
outputs and violations are computed of what is left. Before, the slider-crank changed its energy by 1e-10 over 1e4 time
units, the double pendulum in angles by 1e-11 over 1e5.

Where the loops of the four-bar lose rank, no run leaves on another branch and ends with success. Runs of `augmented`,
`baumgarte` and `ggl` are searched for minima of the least singular value of the constraints, whatever they record. In
sweeps the Gram determinant is watched for falls through 1e-3, 1e-6 and so on, and the cases where it does are searched
alone: of 40 speeds of the first crank the same 34 end there in all three, by Taylor steps, `dop853` and `tsit5`, or
`radau` in `ggl`, at 1e-5, 1e-6 and 1e-9. `projected` passes where a step leaps over the place. Where steps end right
beside it, the projection would take a part of the velocity, and with it of the energy; a first correction of more than
a quarter of the velocities is refused, and the run ends with the status of a singular configuration.

## Sums with compensation

Single Taylor runs sum time and state with compensation; sweeps, prepared calls and Runge-Kutta steps do not. Over 1e4
time units at the floor the energy of the Cartesian pendulum (97,000 Taylor steps) is off by 2e-13 alone and in a sweep,
that of the double pendulum in angles (290,000 steps) by 4e-14 alone and by 3e-12 in a sweep. `dop853`, which has no
compensation in either, is off by 1e-12 after 1.1 million steps of the one, and by 3e-12 after 1.9 million of the other.
Lanes would pay for it at every step; long runs at the floor belong in `simulate`.

## Bodies that turn freely

A unit quaternion is singular nowhere, and in `minimal` its speeds are the angular velocity: the constraint e.e = 1
costs a few products after each step, and the graph knows of it, so that a sphere that rolls has constant speeds again
(25 flops an evaluation, 394 in `projected`). Every case above with a quaternion is served by `minimal` since, with
fewer steps and errors smaller by up to four decades (fast heavy top). Angles in such a scene need not be given up:
`compile_model(scene, orientation="quaternion")` lets quaternions take their place and gives them back as outputs. The
same motion in angles ends at theta = 0 with the status `SINGULAR_COORDINATES`, by every method, and the message names
the angle, its value, and this remedy.

## Stiff methods

SciPy's BDF and Radau IIA, and RODAS (Rosenbrock, order 4), run the same plain kernels; the compiled `radau` stands
beside them. Where the stiff modes are
dead (governor), BDF reaches an error with about as many evaluations as Radau IIA; where they oscillate (spring), with
some three times as many, for its higher orders are not stable there. It would save little and is not part of the
library's own methods; the numpy backend offers it. RODAS is level with Radau IIA at an error of 1e-5 (governor), and
takes some three times the evaluations at 1e-6 (spring) and 1e-9 (governor), with a Jacobian (J) and factors at every
step besides, where `radau` keeps both; nor does it serve `ggl`. It is not part of the library.

{stiff}

## Symmetric and variational methods

They were measured and are not part of the library:

{symmetric}

A method of this kind keeps the energy near its start for as long as it is asked to, but at an error of its order and
step; tight Taylor steps do so at the level of rounding, with far fewer evaluations and a phase that is better by three
decades and more.

## First integrals kept

`simulate` and `sweep` take `project_invariants=True`, or names from `trajectory.invariants`: after every accepted step
the state is corrected along the gradients of these first integrals, in the metric of the kinetic energy and together
with the constraints (`minimal` and `projected`). Without / with:

{kept}

It pays at loose tolerances where the error of the energy becomes one of the period: in the pendulum and the
slider-crank, of one degree of freedom, it takes one to two decades off the error at the end. With more degrees of
freedom the rest of the error stays, and half of it or less is gained (top); in chaos the energy is right and the motion
as wrong as before (double pendulum). At tight tolerances there is nothing to gain for the top or the double pendulum:
tightening Taylor steps from 1e-6 to 1e-12 costs few further steps or none and gains more than any correction does. The
last column is of runs of milliseconds on a busy machine: repeated, its entries move by up to a factor of two, so that
it bounds the cost of a correction and does not resolve it. The first run compiles the model once more.
"""


def _machine() -> str:
    known = machine()
    versions = ", ".join(f"{name} {version}" for name, version in known["versions"].items())
    return f"{known['cores']} cores, {known['cpu']}, Python {known['python']}; {versions}"


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="short long runs, written to build/")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="print the rows of these cases, and write nothing")
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
        cases = list(pool.map(case_row, names))
        long = [run.result() for run in long_runs]
    rows, reasons = [row for row, _ in cases], {}
    for name, (_, why) in zip(names, cases, strict=True):
        for reason in sorted(why):
            reasons.setdefault(reason.split(" = 0 ")[-1], []).append(name)
    if options.only:
        print(*rows, *(run.row for run in long), sep="\n")
        return
    folder.mkdir(exist_ok=True)
    draw(long, folder / "hard_cases_drift.png")
    draw_motions(folder / "hard_cases_motions.png")
    text = TEMPLATE.format(
        machine=_machine(),
        methods=" / ".join(TOLERANCE),
        tolerances=" / ".join(f"{x:g}" for x in TOLERANCE.values()),
        rows="\n".join(rows),
        reasons="\n".join(f"- a constraint {reason}: {', '.join(names)}" for reason, names in reasons.items()),
        contacts=contact_section(),
        bicycle=bicycle(),
        long="\n".join(run.row for run in long),
        stiff=stiff_methods(),
        symmetric=symmetric_methods(),
        kept=kept_integrals(),
    )
    (folder / "hard_cases.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
