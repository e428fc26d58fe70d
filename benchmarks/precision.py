"""Speed against error: every backend, formulation and method, and peers, against references."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from cases import PROBLEMS
from contenders import Contender, own
from measure import interleaved
from peers import peers

__all__ = ["measure_contenders", "work_precision"]

Record = dict[str, Any]


def work_precision(
    backends: Sequence[str],
    tolerances: Sequence[float],
    *,
    formulations: Sequence[str],
    methods: Mapping[str, int],
    rounds: int,
    seconds_each: float,
    slowest: float,
    names: Sequence[str] = tuple(PROBLEMS),
    with_peers: bool = True,
    say: Callable[[str], None] = print,
) -> list[Record]:
    """Return one record a case, contender and tolerance.

    Parameters
    ----------
    backends, formulations : sequence of str
        What to compare; a formulation that cannot serve on a backend is left out. Backends other than llvm take the
        first one only.
    tolerances : sequence of float
        rtol, loosest first.
    methods : mapping of str to int
        How many methods of a backend, in its own order; all of one that is not named.
    rounds, seconds_each
        See `measure.interleaved`.
    slowest : float
        A contender that takes longer for one run [s] is not run at tighter tolerances.
    names : sequence of str
        Names of the problems.
    with_peers : bool
        Whether peers are measured too.
    say : callable
        Takes progress as text.
    """
    records: list[Record] = []
    for name in names:
        problem, begin = PROBLEMS[name], time.perf_counter()
        contenders = []
        for backend in backends:
            wanted = formulations if backend == "llvm" else formulations[:1]
            contenders += own(problem, backend, wanted, methods.get(backend))
        contenders += list(peers(problem)) if with_peers else []
        records += measure_contenders(name, contenders, tolerances, rounds, seconds_each, slowest)
        say(f"  {name}: {len(contenders)} contenders, {time.perf_counter() - begin:.0f} s")
    return records


def measure_contenders(
    scene: str,
    contenders: Sequence[Contender],
    tolerances: Sequence[float],
    rounds: int,
    seconds_each: float,
    slowest: float,
) -> list[Record]:
    """Return the records of contenders of one case, measured in turn with each other."""
    prepared = {}
    for contender in contenders:
        for rtol in tolerances:
            ready = contender.prepare(rtol)
            prepared[contender, rtol] = ready
            begin = time.perf_counter()
            ready.run()
            if time.perf_counter() - begin > slowest:
                break
    tasks = {(key, "run"): ready.run for key, ready in prepared.items()}
    tasks |= {(key, "call"): ready.call for key, ready in prepared.items() if ready.call is not None}
    timings = interleaved(tasks, rounds=rounds, seconds_each=seconds_each)
    return [
        {
            "scene": scene,
            "label": contender.label,
            "solver": contender.solver,
            "formulation": contender.formulation,
            "method": contender.method,
            "rtol": rtol,
            "error": ready.error,
            "steps": ready.steps,
            "evaluations": ready.evaluations,
            "run_us": timings[(contender, rtol), "run"].microseconds(),
            "call_us": timings[(contender, rtol), "call"].microseconds() if ready.call else None,
            "rounds": timings[(contender, rtol), "run"].rounds,
        }
        for (contender, rtol), ready in prepared.items()
    ]
