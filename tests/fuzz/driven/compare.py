"""One driven case: the package against the Moreau-Jean reference and against itself, by `examine`."""

from __future__ import annotations

from typing import Any

import numpy as np

from dalembert.methods.status import Status
from fuzz.contacts.compare import RTOL, SAMPLES, STEPS, Report, compare_phases, compare_states
from fuzz.contacts.invariants import TOLERANCE, violations
from fuzz.contacts.moreau_jean import Array
from fuzz.contacts.scenes import Setting
from fuzz.driven.equations import driven as system_of
from fuzz.driven.equations import packed
from fuzz.driven.families import Driven, Law
from fuzz.driven.records import Record
from fuzz.driven.reference import instants, reference
from fuzz.driven.runs import Problem, other_runs

__all__ = ["examine"]


def examine(driven: Driven, steps: int = STEPS) -> Report:
    """Return the report of a case; the coarse reference takes `steps` between two samples."""
    problem, report, case = Problem(driven), Report(), driven.case
    which = problem.setting
    runs = [problem.simulated(rtol) for rtol in RTOL]
    run, statuses = runs[1], [each.status.name for each in runs]
    report.phases = len(run.phases)
    if len(set(statuses)) > 1:
        report.wrong(f"statuses at three tolerances: {statuses}")
    if not run.success:
        endless = run.status is Status.EVENTS_ACCUMULATE and driven.kick is not None
        report.outcome = "set aside" if endless else "FALSE REFUSAL"
        report.found.append(f"{run.status.name} at {run.t_end:.6g}: {run.message[-200:]}")
        return report
    for rtol, each in zip(RTOL, runs, strict=True):
        for text in _laws(driven, which, each, max(TOLERANCE, 100.0 * rtol)):
            report.wrong(f"{text}, rtol {rtol:g}")
    times = np.linspace(0.0, case.span, SAMPLES + 1)

    def references(each: int) -> tuple[Array, Array]:
        return reference(driven, which.system, which.parameters, each * SAMPLES).at(times)

    compare_states(report, run, case.span, references, steps)
    compare_phases(report, runs)
    for text in other_runs(problem, run):
        report.wrong(text)
    return report


def _laws(driven: Driven, which: Setting, run: Any, tolerance: float) -> list[str]:
    """Return what a run violates of the laws of contacts, and of those of its controller."""
    records, breaks, found = dict(driven.records), [], []
    for _, record in driven.records:
        breaks += record.knots
    if driven.law is not None:
        times = np.array(instants(driven))
        part = run(times)
        held, wanted = part[driven.law.sets], _commands(driven.law, part)
        wrong = np.abs(held - wanted) > tolerance * (1.0 + np.max(np.abs(wanted)))
        if np.any(wrong):
            i = int(np.argmax(wrong))
            found.append(f"{driven.law.sets} = {held[i]:.6g}, its law gives {wanted[i]:.6g} at {times[i]:.6g}")
        records[driven.law.sets] = Record("hold", tuple(times.tolist()), tuple(held.tolist()))
        breaks += times.tolist()
    kicks = run.events["kick"].t if driven.kick is not None else ()
    p = packed(which.system, which.parameters, driven.case.parameters, records)
    plain = Setting(system_of(which.system), which.scene, which.parameters, which.contacts)
    return found + violations(plain, p, run, tolerance, breaks, kicks)


def _commands(law: Law, part: Any) -> Array:
    """Return what a law gives (k,) with the states of a run at its instants."""
    own, found = 0.0, []
    for number, (q, v) in enumerate(zip(part.q, part.qdot, strict=True)):
        found.append(law.value(q, v, number if law.kind == "count" else own))
        own += law.error(q)
    return np.array(found)
