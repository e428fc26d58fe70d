"""The section on friction and contacts of docs/hard_cases.md.

``python benchmarks/report_contacts.py`` prints it; ``--save`` puts it into the page that is there.
"""

from __future__ import annotations

import argparse
import inspect
import math
from typing import Any

import numpy as np
from exact import ROOT  # puts tests/ on the path
from sympy import Symbol, sin
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status
from hard_cases.contact_case import contact_reference
from hard_cases.contacts import CONTACT_CASES, contact_motion, corner_plate

__all__ = ["HEADING", "contact_section"]

TIME = dynamicsymbols._t
HEADING, NEXT = "## Friction and contacts", "## Whipple bicycle"
PLATE = {"m": 1.0, "l": 1.0, "h": 0.5, "g": 9.81, "mu": 0.8}
START = {"x": -0.5 / math.tan(0.5), "theta": 0.5, "theta_dot": 0.0, "x_dot": 0.0}


def _number(value: float) -> str:
    return "0" if value == 0.0 else f"{value:.0e}"


def _rows() -> list[str]:
    rows = []
    for name, build in CONTACT_CASES.items():
        case = contact_motion(name)
        motion = case.motion
        model = motion.compile("auto")
        run = motion.simulate(model)
        hard = " ".join((inspect.getdoc(build) or "").split())
        agreed = [dict(phase.modes) for phase in run.phases] == case.modes()
        transitions = _number(case.transition_error(run)) if agreed else "other phases"
        violation = _number(float(np.max(np.abs(run.constraint_violation), initial=0.0)))
        error = _number(motion.error(run)) if run.success else run.status.name
        cells = [f"**{name}**. {hard}", motion.source, str(len(case.phases)), transitions, error, violation]
        rows.append("| " + " | ".join(cells) + " |")
        print(rows[-1], flush=True)
    return rows


def _energy() -> str:
    """Return how the work of friction agrees with what the energy lost, relative to it."""
    model = da.compile_model(corner_plate(4 + 7 * sin(3 * TIME)), outputs=["F_Q", "N_Q"])
    run = model.simulate((0, 8), START, PLATE, rtol=1e-14, atol=1e-16)
    nodes, weights = np.polynomial.legendre.leggauss(20)
    work = push = 0.0
    for phase in run.phases:
        edges = np.linspace(phase.t0, phase.t1, 2 + int((phase.t1 - phase.t0) / 0.02))
        half = np.diff(edges)[:, None] / 2
        motion = run((edges[:-1, None] + half + half * nodes).ravel())
        slip = motion["x_dot"] * np.cos(motion["theta"])
        force = 4 + 7 * np.sin(3 * motion.t)
        work += float(np.sum((motion["F_Q"] * slip).reshape(len(half), -1) @ weights * half[:, 0]))
        push += float(np.sum((force * motion["x_dot"]).reshape(len(half), -1) @ weights * half[:, 0]))
    return _number(abs((run["energy"][-1] - run["energy"][0] - push - work) / work))


def _stuck() -> str:
    """Return how far a plate moves that is stuck for 1e4 s under a push of 4 N, and of 4 + 2 sin(t) N."""
    moved = []
    for force in (4, 4 + 2 * sin(TIME)):
        run = da.compile_model(corner_plate(force)).simulate((0, 1e4), START, PLATE)
        moved.append(_number(float(np.max(np.abs(run.q - run.q[0])))))
    return " and ".join(moved)


def _critical() -> str:
    """Return the bracket of the critical friction of the rod at tan(theta) = 2, as its distance from 4/3."""
    model = da.compile_model(da.scenes.sliding_rod())
    start = {"x": 0.0, "y": 0.0, "theta": math.atan(2), "x_dot": -1.0, "y_dot": 0.0, "theta_dot": 0.0}

    def status(mu: float) -> Any:
        return model.simulate((0, 1e-6), start, {"m": 1.0, "l": 1.0, "g": 9.81, "mu": mu}, rtol=1e-10).status

    low, high = 1.0, 2.0
    for _ in range(45):
        middle = (low + high) / 2
        low, high = (low, middle) if status(middle) is Status.CONTACT_IMPOSSIBLE else (middle, high)
    return _number(max(abs(low - 4 / 3), abs(high - 4 / 3)))


def _smooth() -> list[str]:
    """Return the rows of the smooth law: slip speed eps, error at 2.2 s and at 8 s, steps, method."""
    entry = contact_reference("plate_push_pull")
    exact = [float(entry["rows"][i]["state"][0]) for i in (1, 3)]
    model = da.compile_model(corner_plate(4 + 7 * sin(3 * TIME), regularization=Symbol("eps", positive=True)))
    rows = []
    for eps in (1e-2, 1e-3, 1e-4, 1e-5):
        run = model.simulate((0, 8), START, {**PLATE, "eps": eps}, t_eval=[2.2, 8.0], rtol=1e-9, atol=1e-11)
        errors = " | ".join(_number(abs(a - b)) for a, b in zip(run["theta"], exact, strict=False))
        rows.append(f"| {eps:.0e} | {errors} | {run.stats.steps:,} | {run.stats.method} |")
    return rows


def contact_section() -> str:
    """Run everything and return the section."""
    rows, smooth = "\n".join(_rows()), "\n".join(_smooth())
    return f"""{HEADING}

Coulomb's law as a set-valued law, with modes ([friction.md](friction.md)); `formulation="auto"`, the Taylor method at
rtol = 1e-14. Errors of transitions are the largest of the starts of all phases, over max(1, time); errors and
violations as above. Every case is a test in `tests/hard_cases/test_contacts.py`, more are in
`tests/system/test_friction.py`.

| case and why it is hard | source | phases | error of transitions | error | violation |
| --- | --- | ---: | ---: | ---: | ---: |
{rows}

The work of friction on the plate pushed and pulled, by Gauss quadrature within each phase, differs from the energy lost
by {_energy()} of itself. Stuck for 1e4 s under a push of 4 N, or of 4 + 2 sin(t) N, the plate moves by {_stuck()}.
Painleve's paradox of the sliding rod begins at mu = 4/3; found by bisection over the status, to 2e-14, it differs by
{_critical()}.

The smooth law F = -mu N slip / sqrt(slip^2 + eps^2) on the plate pushed and pulled, its error in theta against the law
itself; it creeps where the law sticks:

| eps, m/s | error at 2.2 s | error at 8 s | steps | method of "auto" |
| ---: | ---: | ---: | ---: | --- |
{smooth}
"""


def main() -> None:
    """Print the section, or put it into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", action="store_true", help="put the section into docs/hard_cases.md")
    section = contact_section()
    if not parser.parse_args().save:
        print(section)
        return
    page = ROOT / "docs" / "hard_cases.md"
    text = page.read_text(encoding="utf-8")
    before, after = text.split(NEXT, 1)
    page.write_text(f"{before.split(HEADING)[0]}{section}\n{NEXT}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
