"""One random case: the package against the Moreau-Jean reference and against itself, by `examine`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np

from dalembert.methods.status import Status
from fuzz.contacts.families import Case
from fuzz.contacts.invariants import TOLERANCE, merged, rows_at, violations
from fuzz.contacts.moreau_jean import Array, integrated
from fuzz.contacts.scenes import compiled, setting
from fuzz.contacts.uniqueness import motions

__all__ = ["BRIEF", "RTOL", "SAMPLES", "STEPS", "Report", "compare_phases", "compare_states", "examine"]

SAMPLES = 8
STEPS = 2500
"""Steps of the coarse reference between two samples; the fine one has four times as many."""
UNSURE = 2e-3
"""Difference of the two references, over the sizes of the motion, from which on nothing is compared."""
FLOOR = 1e-4
RTOL = (1e-6, 1e-8, 1e-10)
Gaps = Callable[[float, Array, Array], Array]
"""From a time, positions and velocities to gaps (k,)."""
Reference = Callable[[int], tuple[Array, Array]]
"""From a number of steps between two samples to positions and velocities (SAMPLES + 1, n)."""
PARADOXES = (Status.CONTACT_IMPOSSIBLE, Status.CONTACT_AMBIGUOUS)
BRIEF = 1e-3
"""A phase shorter than this [s] may be missing at another tolerance: slip that grazes zero does so up to its root."""


@final
@dataclass(eq=False)
class Report:
    """What came of a case: outcome, what was found, and how far the run and the references are apart.

    `tie`: only phases shorter than `BRIEF` differ between tolerances.
    """

    outcome: str = "agree"
    found: list[str] = field(default_factory=list)
    error: float = 0.0
    doubt: float = 0.0
    phases: int = 0
    tie: bool = False
    differs_from: float | None = None
    """Time of the first sample that differs from the references."""

    def wrong(self, text: str) -> None:
        """Note a defect."""
        self.outcome = "WRONG"
        self.found.append(text)


def examine(case: Case, steps: int = STEPS) -> Report:
    """Return the report of a case; the coarse reference takes `steps` between two samples."""
    which, model, report = setting(case.scene), compiled(case.scene), Report()
    p = np.array([case.parameters[name] for name in which.parameters])
    parameters = {name: case.parameters[name] for name in model.layout.parameters}
    q = np.array([case.initial[name] for name in which.coordinates], float)
    v = np.array([case.initial[f"{name}_dot"] for name in which.coordinates], float)
    runs = [_run(model, case, parameters, rtol) for rtol in RTOL]
    run = runs[1]
    statuses = [r.status.name for r in runs]
    report.phases = len(run.phases)
    if len(set(statuses)) > 1:
        report.wrong(f"statuses at three tolerances: {statuses}")
    if not run.success:
        _refusal(report, case.scene, p, run)
    for rtol, each in zip(RTOL, runs, strict=True):
        for text in violations(which, p, each, max(TOLERANCE, 100.0 * rtol)):
            report.wrong(f"{text}, rtol {rtol:g}")
    if run.success:
        problem = which.system, p, q, v, case.span
        compare_states(report, run, case.span, lambda count: integrated(*problem, SAMPLES, count)[:2], steps)
        _set_aside_where_several(report, case, p, run)
        compare_phases(report, runs, lambda t, q, v: rows_at(which.system, t, q, v, p).gap)
        _compare_sweep(report, model, case, parameters, run)
    return report


def _refusal(report: Report, name: str, p: Array, run: Any) -> None:
    """Note that a run was refused, and whether trial of all modes confirms that it has no one motion."""
    last = run.q[-1], run.qdot[-1]
    found = motions(name, p, run.t_end, *last) if run.status in PARADOXES else None
    sure = found is not None and (len(found) > 1 if run.status is Status.CONTACT_AMBIGUOUS else not found)
    words = "-" if found is None else [modes for modes, _ in found]
    if not report.found:
        report.outcome = "refused rightly" if sure else "FALSE REFUSAL"
    report.found.append(f"{run.status.name} at {run.t_end:.6g}, trial finds {words}: {run.message[-200:]}")


def _set_aside_where_several(report: Report, case: Case, p: Array, run: Any) -> None:
    """Set a difference to the references aside where, in a phase before it, the laws allow a second motion.

    What rests stays at rest as long as the laws allow that; time stepping may leave for the other motion before.
    """
    if report.differs_from is None or report.found[1:]:
        return
    for t in np.linspace(0.0, report.differs_from, 401)[1:]:
        at = run(np.array([t]))
        several = motions(case.scene, p, float(t), at.q[0], at.qdot[0])
        if several is not None and len(several) > 1:
            report.outcome = "set aside"
            report.found.append(f"from {t:.4g} on the laws allow {[modes for modes, _ in several]}")
            return


def _run(model: Any, case: Case, parameters: dict[str, float], rtol: float) -> Any:
    return model.simulate((0.0, case.span), case.initial, parameters, rtol=rtol, atol=rtol * 1e-2)


def compare_states(report: Report, run: Any, span: float, reference: Reference, steps: int) -> None:
    """Compare the run with references at two step sizes; where it differs, at smaller ones, too, before it is wrong.

    There is always a third reference then: two may agree by chance in a motion that neither of them resolves. Where
    the third is as wrong by the first two as the run is, its agreement with the run says nothing.
    """
    times, each, settled = np.linspace(0.0, span, SAMPLES + 1), steps, True
    sampled = run(times)
    ours = sampled.q, sampled.qdot
    coarse, fine = (reference(count) for count in (each, 4 * each))
    text, sure = _difference(report, ours, times, coarse, fine)
    while text is not None and each < 64 * steps and (each == steps or report.error <= 1000.0 * report.doubt + FLOOR):
        each *= 4
        finer = reference(4 * each)
        other, place = _difference(Report(), finer, times, coarse, fine)
        settled = other is None or place > sure
        coarse, fine = fine, finer
        text, sure = _difference(report, ours, times, coarse, fine)
    if text is not None:
        report.wrong(text)
        report.differs_from = float(times[sure])
    elif report.outcome == "agree" and not (settled and sure == SAMPLES):
        report.outcome = "set aside"
        where = f"after {sure} of {SAMPLES} samples" if settled else f"from one with {4 * each} steps a sample"
        report.found.append(f"the references differ {where}")


def _difference(
    report: Report, ours: tuple[Array, Array], times: Array, coarse: tuple[Array, Array], fine: tuple[Array, Array]
) -> tuple[str | None, int]:
    """Return how positions and velocities (SAMPLES + 1, n) differ from the references, and in which sample.

    Where they do not, that is the number of samples at which the references agree.
    """
    (q_0, v_0), (q_1, v_1), (q, v) = ours, coarse, fine
    size_q, size_v = max(0.1, float(np.max(np.abs(q)))), max(0.1, float(np.max(np.abs(v))))
    report.error = report.doubt = 0.0
    for i, t in enumerate(times[1:], start=1):
        doubts = _distance(q_1[i], q[i]) / size_q, _distance(v_1[i], v[i]) / size_v
        errors = _distance(q_0[i], q[i]) / size_q, _distance(v_0[i], v[i]) / size_v
        if doubts[0] > UNSURE:
            return None, i - 1
        for what, doubt, error in zip(("positions", "velocities"), doubts, errors, strict=True):
            if doubt > UNSURE:
                continue  # an impact is near
            report.doubt, report.error = max(report.doubt, doubt), max(report.error, error)
            if error > 10.0 * doubt + FLOOR:
                return f"{what} at {t:.4g}: off by {error:.2e}, references by {doubt:.2e}", i
    return None, SAMPLES


def _distance(a: Array, b: Array) -> float:
    return float(np.max(np.abs(a - b)))


def compare_phases(report: Report, runs: list[Any], gaps: Gaps | None = None) -> None:
    """Compare phases at three tolerances; `gaps` of contacts follow from a time, positions and velocities."""
    modes = [merged(run) for run in runs]
    lasting = [merged(run, BRIEF) for run in runs]
    same = lasting[0] == lasting[1] == lasting[2] or _share_alike(lasting, runs)
    same = same or (gaps is not None and all(_touch_alike(each, runs[2], gaps) for each in runs[:2]))
    report.tie = same and not modes[0] == modes[1] == modes[2]
    if not same:
        text = "; ".join(f"{len(m)} at {rtol:g}" for m, rtol in zip(modes, RTOL, strict=True))
        first = next((i for i, m in enumerate(zip(*modes, strict=False)) if len(set(m)) > 1), min(map(len, modes)))
        report.wrong(f"phases: {text}, first in phase {first}")


def _share_alike(lasting: list[list[tuple[str, ...]]], runs: list[Any]) -> bool:
    """Return whether phases differ only in which of two contacts is said to stick, and the motions do not.

    Of two feet at rest on one line, one alone need hold the body.
    """
    alike = [[sorted(modes) for modes in each] for each in lasting]
    if not alike[0] == alike[1] == alike[2]:
        return False
    t = np.linspace(0.0, min(run.t_end for run in runs), 101)
    speeds = [run(t).qdot for run in runs]
    size = max(0.1, float(np.max(np.abs(speeds[2]))))
    return all(float(np.max(np.abs(each - speeds[2]))) <= TOLERANCE * size for each in speeds[:2])


def _touch_alike(run: Any, other: Any, gaps: Gaps) -> bool:
    """Return whether two motions are the same, and phases differ only in contacts whose gaps are zero by tolerance.

    A body that comes back to rest at the wall from which it was pulled touches it or not, by rounding.
    """
    edges = np.unique([phase.t1 for each in (run, other) for phase in each.phases])
    times = np.linspace(0.0, min(run.t_end, other.t_end), 1001)
    times = times[np.min(np.abs(times[:, None] - edges), axis=1) > BRIEF]
    ours, theirs = run(times), other(times)
    for name in ("q", "qdot"):
        size = max(0.1, float(np.max(np.abs(getattr(theirs, name)))))
        if np.max(np.abs(getattr(ours, name) - getattr(theirs, name))) > TOLERANCE * size:
            return False
    size = TOLERANCE * max(0.1, float(np.max(np.abs(other.q))))
    for i, t in enumerate(times):
        modes = [next(phase.modes for phase in each.phases if t <= phase.t1).values() for each in (run, other)]
        differ = {k: {a, b} for k, (a, b) in enumerate(zip(*modes, strict=True)) if a != b}
        if any(pair != {"open", "closed"} for pair in differ.values()):
            return False
        if any(abs(gaps(t, part.q[i], part.qdot[i])[k]) > size for part in (ours, theirs) for k in differ):
            return False
    return True


def _compare_sweep(report: Report, model: Any, case: Case, parameters: dict[str, float], run: Any) -> None:
    """Compare a sweep with the single run."""
    name = next(iter(case.initial))
    values = case.initial | {name: np.full(3, case.initial[name])}
    sweep = model.sweep((0.0, case.span), values, parameters, rtol=RTOL[1], atol=RTOL[1] * 1e-2, threads=1)
    names = (*model.layout.coordinates, *model.layout.rates)
    ends = np.array([sweep[n] for n in names]).T
    ours = np.concatenate([run.q[-1], run.qdot[-1]])
    for i in range(3):
        if sweep.status[i] != run.status or sweep.phases[i] != len(run.phases):
            report.wrong(f"sweep: status {sweep.status[i]}, {sweep.phases[i]} phases of {len(run.phases)}")
            return
        if _distance(ends[i], ours) > 1e-6 * max(1.0, float(np.max(np.abs(ours)))):
            report.wrong(f"sweep: ends off by {_distance(ends[i], ours):.2e}")
            return
