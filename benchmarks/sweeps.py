"""Sweeps: time of a case against error for every backend and peer; unequal cases; share of peak."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from batches import BATCHES, SAMPLE, Batch, sample_states
from cases import END
from contenders import absolute
from measure import interleaved
from peak import flops_of_step, peak_flops
from peer_sweeps import HEYOKA_LANES, Solver, casadi_sweep, diffrax_sweep, heyoka_sweep, scipy_sweep
from peers import installed

import dalembert as da

__all__ = ["CASES", "THREADS", "coverage", "measure_sweeps", "own_sweep", "unequal_cases"]

Record = dict[str, Any]
CASES = (16_384, 2048, 256)
"""Cases of a sweep, and those of a contender that is too slow for so many, or for the next number too."""
THREADS = 2
_PATIENCE = 3


# -- contenders ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class SweepContender:
    """A solver of many cases.

    Attributes
    ----------
    label : str
    prepare : callable
        (batch, rtol) -> what is timed, after one run.
    limit : float
        What one call may take [s]. A slower one is run with fewer cases, at this tolerance and tighter ones.
    few : bool
        Whether it is so slow that it begins with the smallest number of cases.
    every : int
        At every how many tolerances it is run.
    """

    label: str
    prepare: Callable[[Batch, float], Solver]
    limit: float
    few: bool = False
    every: int = 1


def own_sweep(batch: Batch, method: str, threads: int, rtol: float, backend: str = "llvm") -> Solver:
    """Return our sweep by a method."""
    model = da.compile_model(batch.problem.build(), backend=backend)
    options = {"method": method, "rtol": rtol, "atol": absolute(rtol), "threads": threads}

    def run() -> Any:
        return model.sweep((0.0, END), batch.initial, batch.parameters, **options)

    done = run()
    if not done.success.all():
        raise RuntimeError(f"{batch.problem.name}, {method} at rtol {rtol:g}: {done.failures()[0]}")
    names = (*model.layout.coordinates, *model.layout.rates)
    return run, lambda: np.stack([done.final[name][:SAMPLE] for name in names], axis=1), int(done.steps.sum())


_OWN_METHODS = {"llvm": ("taylor", "dop853", "tsit5"), "numba": ("taylor", "dop853"), "jax": ("auto",)}
"""Methods of a backend; of others its default, with few cases."""


def _own(backends: Sequence[str], slowest: float) -> Iterator[SweepContender]:
    for backend in backends:
        slow = backend not in _OWN_METHODS
        for method in _OWN_METHODS.get(backend, ("auto",)):
            for threads in (THREADS, 1) if (backend, method) == ("llvm", "taylor") else (1,) if slow else (THREADS,):
                yield SweepContender(
                    f"dalembert {backend} {method}, {_threads(threads)}",
                    lambda batch, rtol, m=method, n=threads, b=backend: own_sweep(batch, m, n, rtol, b),
                    _PATIENCE * slowest if backend == "jax" else slowest,
                    few=slow,
                    every=3 if backend == "jax" else 1,
                )


def _peers(slowest: float) -> Iterator[SweepContender]:
    if (heyoka := installed("heyoka")) is not None:
        for lanes, threads in (*((lanes, THREADS) for lanes in HEYOKA_LANES), (HEYOKA_LANES[0], 1)):
            yield SweepContender(
                f"heyoka taylor, fast_math, batches of {lanes}, {_threads(threads)}",
                lambda batch, rtol, k=lanes, n=threads: heyoka_sweep(heyoka, batch, n, rtol, k),
                slowest,
            )
    if installed("diffrax") is not None:
        for method in ("Tsit5", "Dopri8"):
            yield SweepContender(
                f"diffrax {method}, tuples, lax.map of 1,024, {_threads(THREADS)}",
                lambda batch, rtol, m=method: diffrax_sweep(batch, m, rtol),
                _PATIENCE * slowest,
                every=2,
            )
    yield SweepContender("SciPy dop853, numba rhs, 1 thread", scipy_sweep, slowest, few=True)
    if (casadi := installed("casadi")) is not None:
        yield SweepContender(
            f"CasADi cvodes, Adams, map, {_threads(THREADS)}",
            lambda batch, rtol: casadi_sweep(casadi, batch, THREADS, rtol),
            slowest,
            few=True,
        )


def _threads(count: int) -> str:
    return "1 thread" if count == 1 else f"{count} threads"


# -- measurements -------------------------------------------------------------------------------


def measure_sweeps(
    backends: Sequence[str],
    tolerances: Sequence[float],
    *,
    rounds: int,
    slowest: float,
    say: Callable[[str], None] = print,
    counts: Sequence[int] = CASES,
) -> list[Record]:
    """Return one record a scene, contender and tolerance.

    Parameters
    ----------
    backends : sequence of str
    tolerances : sequence of float
        rtol, loosest first.
    rounds : int
        See `measure.interleaved`.
    slowest : float
        What one call may take [s]; backends and peers on JAX may take `_PATIENCE` times as long.
    say : callable
        Takes progress as text.
    counts : sequence of int
        Numbers of cases, largest first. A contender that is too slow for one of them takes the next; with the smallest
        one, it is not run at tighter tolerances.
    """
    records = []
    for name, build in BATCHES.items():
        batches = {count: build(count) for count in counts}
        exact = sample_states(batches[counts[0]])
        tasks: dict[tuple[str, float], tuple[int, Solver]] = {}
        for contender in (*_own(backends, slowest), *_peers(slowest)):
            for rtol, count, solver in _within_limit(contender, tolerances[:: contender.every], batches):
                tasks[contender.label, rtol] = count, solver
        timings = interleaved(
            {key: solver[0] for key, (_, solver) in tasks.items()}, rounds=rounds, seconds_each=4 * slowest
        )
        for (label, rtol), (count, (_, sample, steps)) in tasks.items():
            timing = timings[label, rtol]
            records.append(
                {
                    "scene": name,
                    "label": label,
                    "rtol": rtol,
                    "cases": count,
                    "us": {k: round(v / count, 4) for k, v in timing.microseconds().items()},
                    "error": float(np.abs(sample() - exact).max()),
                    "steps": steps,
                    "peak_share": _share(batches[count], label, rtol, steps, timing.median),
                }
            )
        say(f"  {name}: {len(tasks)} contenders and tolerances")
    return records


def _within_limit(
    contender: SweepContender, tolerances: Sequence[float], batches: Mapping[int, Batch]
) -> Iterator[tuple[float, int, Solver]]:
    """Yield tolerance, number of cases and solver, with as many cases as the contender's limit allows."""
    counts = list(batches)
    left = counts[-1:] if contender.few else counts
    for rtol in tolerances:
        solver = contender.prepare(batches[left[0]], rtol)
        while (slow := _seconds(solver) > contender.limit) and len(left) > 1:
            left = left[1:]
            solver = contender.prepare(batches[left[0]], rtol)
        yield rtol, left[0], solver
        if slow:
            return


def _seconds(solver: Solver) -> float:
    begin = time.perf_counter()
    solver[0]()
    return time.perf_counter() - begin


def _share(batch: Batch, label: str, rtol: float, steps: int | None, seconds: float) -> float | None:
    """Return what part of the machine's multiply-add peak a Taylor sweep reaches."""
    if steps is None or not label.startswith("dalembert llvm taylor"):
        return None
    flops = flops_of_step(da.compile_model(batch.problem.build()), rtol)
    return round(steps * flops / seconds / peak_flops(THREADS if str(THREADS) in label else 1), 3)


def unequal_cases(count: int = CASES[0], rtol: float = 1e-9) -> list[Record]:
    """Return microseconds of a step where cases differ much, and the ratio of throughput to that of equal ones."""
    batch = BATCHES["sleigh"](count)
    random = np.random.default_rng(2)
    model = da.compile_model(batch.problem.build())
    spins = {**batch.initial, "theta_dot": np.geomspace(0.1, 50, count)[random.permutation(count)]}
    ends = END * np.geomspace(0.05, 1, count)[random.permutation(count)]
    plain = {name: float(np.mean(value)) for name, value in batch.parameters.items()}
    kinds: dict[str, tuple[Any, Any, Any]] = {
        "equal": (END, {name: float(np.mean(value)) for name, value in batch.initial.items()}, plain),
        "random parameters and speeds": (END, batch.initial, batch.parameters),
        "durations spread 20 to 1": (ends, batch.initial, batch.parameters),
        "spins from 0.1 to 50": (END, spins, batch.parameters),
    }
    # A parameter given for every case keeps the equal cases from being one case.
    kinds["equal"] = (END, kinds["equal"][1], {**plain, "m": np.full(count, plain["m"])})
    steps: dict[str, int] = {}

    def task(kind: str) -> Callable[[], Any]:
        end, initial, parameters = kinds[kind]

        def run() -> Any:
            done = model.sweep((0.0, end), initial, parameters, method="taylor", rtol=rtol, atol=absolute(rtol))
            steps[kind] = int(done.steps.sum())
            return done

        run()
        return run

    timings = interleaved({kind: task(kind) for kind in kinds}, rounds=15, seconds_each=2.0)
    each = {kind: 1e6 * timings[kind].median / steps[kind] for kind in kinds}
    return [
        {"kind": kind, "us_per_step": round(value, 5), "throughput": round(each["equal"] / value, 3)}
        for kind, value in each.items()
    ]


def coverage(count: int = 200) -> list[Record]:
    """Return in how many cases the estimated error lies within a factor 10 of the true one."""
    batch = BATCHES["sleigh"](count)
    exact = sample_states(batch, count)
    model = da.compile_model(batch.problem.build())
    names = (*model.layout.coordinates, *model.layout.rates)
    records = []
    for rtol in (1e-6, 1e-9):
        done = model.sweep(
            (0.0, END), batch.initial, batch.parameters, rtol=rtol, atol=absolute(rtol), error_estimate=True
        )
        estimated = np.max([np.abs(done.error_estimate[name]) for name in names], axis=0)
        true = np.abs(np.stack([done.final[name] for name in names], axis=1) - exact).max(axis=1)
        within = (estimated <= 10 * true) & (true <= 10 * estimated)
        records.append({"scene": "sleigh", "rtol": rtol, "cases": count, "within": float(within.mean())})
    return records
