"""Kinds of runs of one driven case, which must agree with its single run: `other_runs`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, final

import numpy as np

import dalembert as da
from fuzz.contacts.compare import BRIEF, RTOL
from fuzz.contacts.invariants import merged
from fuzz.contacts.moreau_jean import Array
from fuzz.driven.families import Driven
from fuzz.driven.scenes import event, model, parameters_of, samples_of, start_of

__all__ = ["Problem", "other_runs"]

SAME = 1e-6
"""Of states and reductions of single runs and sweeps, over their sizes."""
DENSE = 4001
"""Times at which a single run is looked at for its extrema and its mean."""
ABOVE = 0.05
"""How far above its start the first coordinate is to pass."""


@final
class Problem:
    """A case with its scene, its model, and what its runs are given."""

    def __init__(self, driven: Driven) -> None:
        self.driven = driven
        self.setting, self.model = model(driven)
        self.span = (0.0, driven.case.span)
        self.start, self.parameters = start_of(driven), parameters_of(driven, self.model)
        samples = samples_of(driven)
        self.options: dict[str, Any] = {"inputs": samples} if samples else {}
        if driven.kick is not None:
            self.options["events"] = [event(driven.kick, self.setting.scene)]

    def simulated(self, rtol: float) -> Any:
        """Return a single run."""
        return self.model.simulate(self.span, self.start, self.parameters, rtol=rtol, atol=rtol * 1e-2, **self.options)

    def swept(self, count: int, **more: Any) -> Any:
        """Return a sweep over the start of the first coordinate, which every second case shares."""
        name = next(iter(self.start))
        starts = self.start | {name: self.start[name] + 0.01 * (np.arange(count) % 2)}
        return self.model.sweep(
            self.span, starts, self.parameters, rtol=RTOL[1], atol=RTOL[1] * 1e-2, threads=1, **self.options, **more
        )

    def ends(self, sweep: Any) -> Array:
        """Return the coordinates and rates (k, 2 n) in which the cases of a sweep end."""
        return np.array([sweep[name] for name in (*self.model.layout.coordinates, *self.model.layout.rates)]).T


def other_runs(problem: Problem, run: Any) -> Iterator[str]:
    """Yield by what sweeps, a prepared run, and one with a Python controller differ from a single run."""
    plain = problem.swept(3)
    ends, alone = problem.ends(plain), problem.ends(problem.swept(1))
    if not (np.array_equal(ends[0], ends[2]) and np.array_equal(ends[0], alone[0])):
        yield f"sweep: equal cases end {ends[2] - ends[0]} and {alone[0] - ends[0]} apart"
    yield from _differences("sweep", problem, run, plain, ends[0])
    first, last = problem.setting.scene.coordinates[0], problem.setting.scene.coordinates[-1]
    kept = {"top": da.maximum(first), "low": da.minimum(last), "mean": da.mean(first), "end": da.final(last)}
    kept["passes"] = da.first_crossing(first - next(iter(problem.start.values())) - ABOVE)
    reduced = problem.swept(3, reduce=kept)
    yield from _differences("reduced sweep", problem, run, reduced, None)
    yield from _reduced({key: value[0] for key, value in reduced.reduced.items()}, problem, run)
    if problem.driven.kick is None:
        yield from _prepared(problem, ends[0])
    if problem.driven.law is not None:
        yield from _with_python(problem, run)


def _differences(what: str, problem: Problem, run: Any, sweep: Any, end: Array | None) -> Iterator[str]:
    """Yield by what the first case of a sweep differs from a single run.

    Steps that follow reductions, too, are others: bodies that bounce on each other take other hops before they rest.
    """
    ours = np.concatenate([run.q[-1], run.qdot[-1]])
    brief = 0 if end is not None else sum(phase.t1 - phase.t0 < BRIEF for phase in run.phases)
    if sweep.status[0] != run.status or abs(sweep.phases[0] - len(run.phases)) > brief:
        yield f"{what}: status {sweep.status[0]}, {sweep.phases[0]} phases of {len(run.phases)}"
    elif end is not None and np.max(np.abs(end - ours)) > SAME * max(1.0, float(np.max(np.abs(ours)))):
        yield f"{what}: ends off by {np.max(np.abs(end - ours)):.2e}"
    if problem.driven.kick is not None:
        record, seen = run.events["kick"], sweep.events["kick"]
        if seen.count[0] != len(record) or (len(record) and abs(seen.first[0] - record.t[0]) > SAME):
            yield f"{what}: {seen.count[0]} kicks of {len(record)}, the first at {seen.first[0]}"


def _reduced(reduced: dict[str, float], problem: Problem, run: Any) -> Iterator[str]:
    """Yield which reductions of a sweep are not those of the single run."""
    times = np.unique(np.concatenate([np.linspace(*problem.span, DENSE), run.t]))
    q, step = run(times).q, problem.span[1] / (DENSE - 1)
    small = SAME * max(1.0, float(np.max(np.abs(run.q))))
    coarse = small + float(np.max(np.abs(np.diff(q, axis=0))))  # between two times
    expected = {
        "top": (np.max(q[:, 0]), coarse),
        "low": (np.min(q[:, -1]), coarse),
        "mean": (np.trapezoid(q[:, 0], times) / problem.span[1], coarse),
        "end": (run.q[-1, -1], small),
    }
    for key, (value, allowed) in expected.items():
        if not abs(reduced[key] - value) <= allowed:
            yield f"reduced sweep: {key} = {reduced[key]}, of the single run {value}"
    above = q[:, 0] - q[0, 0] >= ABOVE
    changes = np.flatnonzero(above[1:] != above[:-1])
    passes = times[changes[0] + 1] if len(changes) else np.nan
    if not (np.isnan(passes) and np.isnan(reduced["passes"])) and not abs(passes - reduced["passes"]) <= 1.01 * step:
        yield f"reduced sweep: first crossing = {reduced['passes']}, of the single run before {passes}"


def _prepared(problem: Problem, end: Array) -> Iterator[str]:
    """Yield by what a prepared run differs from a sweep; its bits are the same."""
    prepared = problem.model.prepare(problem.span, rtol=RTOL[1], atol=RTOL[1] * 1e-2, **problem.options)
    begins = {name: record.values[0] for name, record in problem.driven.records if record.sampled}
    inputs = {"inputs": begins} if begins else {}
    state = problem.model.state(problem.start, problem.parameters, **inputs)
    final = prepared(state, problem.model.parameter_vector(problem.parameters))[: len(end)]
    if not np.array_equal(final, end):
        yield f"prepared run: ends {np.max(np.abs(final - end)):.2e} from the sweep"


def _with_python(problem: Problem, run: Any) -> Iterator[str]:
    """Yield by what a run whose controller is a Python function differs."""
    law = problem.driven.law
    assert law is not None

    def act(t: float, q: Any, qdot: Any, states: Any, parameters: Any) -> tuple[list[float], list[float]]:
        own = next(iter(states.values()), 0.0)
        after = {"integral": own + law.error(q), "count": own + 1.0}.get(law.kind)
        return [law.value(q, qdot, own)], [] if after is None else [after]

    _, made = model(problem.driven, act)
    known = {name: value for name, value in problem.parameters.items() if name in made.layout.parameters}
    other = made.simulate(problem.span, problem.start, known, rtol=RTOL[1], atol=RTOL[1] * 1e-2)
    ours, theirs = run.variables[-1], other.variables[-1]
    if other.status != run.status or merged(other) != merged(run):
        yield f"Python controller: {other.status.name}, {len(other.phases)} phases of {len(run.phases)}"
    elif np.max(np.abs(theirs - ours)) > SAME * max(1.0, float(np.max(np.abs(ours)))):
        yield f"Python controller: ends off by {np.max(np.abs(theirs - ours)):.2e}"
