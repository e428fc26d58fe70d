"""Rigid contacts with Coulomb's law against springs, dampers and smooth friction: error against time of one run.

A point on four sprung legs is pushed to and fro, so that feet slip and stick. Beside rigid contacts, the same scene has
loads in their place: springs with critical damping that only push, of stiffness k, and friction
mu N v / sqrt(v^2 + eps^2). Errors are of all positions at the end, against rigid contacts at a tight tolerance.

``python benchmarks/smooth_contacts.py`` prints the table of docs/contacts_measured.md, in seconds of the processor.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import exact  # noqa: F401 - puts tests/ on the path
import numpy as np

import dalembert as da
from hard_cases.many_contacts import standing, standing_at_rest

__all__ = ["END", "LAWS", "measure", "places", "text"]

Record = dict[str, Any]
END = 0.6
LAWS = (
    (1e4, 1e-2, 1e-6),
    (1e5, 3e-3, 1e-6),
    (1e6, 1e-3, 1e-6),
    (1e8, 1e-4, 1e-6),
    (1e10, 1e-5, 1e-7),
    (1e12, 1e-6, 1e-7),
)
"""Stiffness [N/m] and slip speed [m/s] of smooth laws, and tolerance."""


def places(run: da.Trajectory) -> np.ndarray:
    """Return where the point and its feet are at the end [m]."""
    return np.array([run[name][-1] for name in ("x", "y", "z", *(f"{b}{i}" for i in range(4) for b in "xyz"))])


def measure(laws: Sequence[tuple[float, float, float]] = LAWS, rounds: int = 10) -> list[Record]:
    """Return records of runs with rigid contacts and with smooth laws."""
    start, p = standing_at_rest(4)
    rigid, soft = da.compile_model(standing(4)), da.compile_model(standing(4, soft=True))
    exactly = places(rigid.simulate((0.0, END), start, p, rtol=1e-12, atol=1e-14))
    tasks = [(rigid, {}, rtol) for rtol in (1e-4, 1e-6, 1e-8)]
    tasks += [(soft, {"k_floor": k, "eps": eps}, rtol) for k, eps, rtol in laws]
    records = []
    for model, law, rtol in tasks:
        spent = []
        for _ in range(rounds + 1):
            begin = time.process_time()
            run = model.simulate((0.0, END), start, p | law, rtol=rtol, atol=rtol, dense=False)
            spent.append(time.process_time() - begin)
        if not run.success:
            raise RuntimeError(f"{law}: {run.message}")
        error = float(np.max(np.abs(places(run) - exactly)))
        about = {"rtol": rtol, "method": run.stats.method, "steps": run.stats.steps}
        records.append({**law, **about, "error": error, "seconds": min(spent)})
    return records


def text(records: Sequence[Record]) -> str:
    """Return the table in Markdown."""
    lines = ["| contact | rtol | method | steps | time | error |", "|---|---|---|---|---|---|"]
    for r in records:
        law = f"k = {r['k_floor']:.0e} N/m, eps = {r['eps']:.0e} m/s" if "eps" in r else "rigid"
        cells = law, f"{r['rtol']:.0e}", r["method"], r["steps"], f"{1e3 * r['seconds']:.2g} ms", f"{r['error']:.0e} m"
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(text(measure()))
