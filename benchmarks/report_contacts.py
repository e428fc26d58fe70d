"""Friction and contacts among the data of the hard cases.

``python benchmarks/report_contacts.py`` prints them; ``--save`` puts them into the data and writes the pages again.
"""

from __future__ import annotations

import argparse
import inspect
import math
from typing import Any

import numpy as np
from exact import ROOT  # noqa: F401  (puts tests/ on the path)
from hard_case_pages import DATA, dump, load, number, rounded, write
from sympy import Symbol, sin
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from dalembert.methods.status import Status
from hard_cases.contact_case import contact_reference
from hard_cases.contacts import CONTACT_CASES, contact_motion, corner_plate

__all__ = ["contact_data"]

TIME = dynamicsymbols._t
PLATE = {"m": 1.0, "l": 1.0, "h": 0.5, "g": 9.81, "mu": 0.8}
START = {"x": -0.5 / math.tan(0.5), "theta": 0.5, "theta_dot": 0.0, "x_dot": 0.0}


def _cases() -> dict[str, dict[str, Any]]:
    cases = {}
    for name, build in CONTACT_CASES.items():
        case = contact_motion(name)
        motion = case.motion
        model = motion.compile("auto")
        run = motion.simulate(model)
        agreed = [dict(phase.modes) for phase in run.phases] == case.modes()
        cases[name] = {
            "hard": " ".join((inspect.getdoc(build) or "").split()),
            "source": motion.source,
            "phases": len(case.phases),
            "transitions": rounded(case.transition_error(run)) if agreed else "other phases",
            "error": rounded(motion.error(run)) if run.success else run.status.name,
            "violation": rounded(float(np.max(np.abs(run.constraint_violation), initial=0.0))),
        }
        print(name, cases[name], flush=True)
    return cases


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
    return number(abs((run["energy"][-1] - run["energy"][0] - push - work) / work))


def _stuck() -> str:
    """Return how far a plate moves that is stuck for 1e4 s under a push of 4 N, and of 4 + 2 sin(t) N."""
    moved = []
    for force in (4, 4 + 2 * sin(TIME)):
        run = da.compile_model(corner_plate(force)).simulate((0, 1e4), START, PLATE)
        moved.append(number(float(np.max(np.abs(run.q - run.q[0])))))
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
    return number(max(abs(low - 4 / 3), abs(high - 4 / 3)))


def _smooth() -> list[list[str]]:
    """Return the rows of the smooth law: slip speed eps, error at 2.2 s and at 8 s, steps, method."""
    entry = contact_reference("plate_push_pull")
    exact = [float(entry["rows"][i]["state"][0]) for i in (1, 3)]
    model = da.compile_model(corner_plate(4 + 7 * sin(3 * TIME), regularization=Symbol("eps", positive=True)))
    rows = []
    for eps in (1e-2, 1e-3, 1e-4, 1e-5):
        run = model.simulate((0, 8), START, {**PLATE, "eps": eps}, t_eval=[2.2, 8.0], rtol=1e-9, atol=1e-11)
        errors = [number(abs(a - b)) for a, b in zip(run["theta"], exact, strict=False)]
        rows.append([f"{eps:.0e}", *errors, f"{run.stats.steps:,}", run.stats.method])
    return rows


def contact_data() -> dict[str, Any]:
    """Run everything and return its part of the data."""
    head = ["eps, m/s", "error at 2.2 s", "error at 8 s", "steps", 'method of "auto"']
    return {
        "contacts": _cases(),
        "checks": {"energy": _energy(), "stuck": _stuck(), "critical": _critical()},
        "table_smooth": {"head": head, "rows": _smooth()},
    }


def main() -> None:
    """Print the data, or put them where the pages are made from."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", action="store_true", help=f"write {DATA.name} and the pages again")
    found = contact_data()
    if not parser.parse_args().save:
        print(dump(found))
        return
    known = load()
    data = known | found | {"checks": known["checks"] | found["checks"]}
    DATA.write_text(dump(data), encoding="utf-8")
    write(data)


if __name__ == "__main__":
    main()
