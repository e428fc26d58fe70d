"""Sweeps: time of a case against error, heyoka's batches and diffrax's vmap beside; unequal cases; share of peak."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from batches import BATCHES, SAMPLE, Batch, sample_states
from cases import END
from contenders import absolute
from measure import interleaved
from numpy.typing import NDArray
from peak import flops_of_step, peak_flops
from peers import heyoka_system, installed

import dalembert as da

__all__ = ["CASES", "FEWER", "THREADS", "coverage", "heyoka_sweep", "measure_sweeps", "own_sweep", "unequal_cases"]

FloatArray = NDArray[np.float64]
Record = dict[str, Any]
CASES, FEWER, THREADS = 16_384, 512, 2
"""Cases of a sweep; those of a peer that is too slow for so many; threads."""
_PATIENCE = 5


# -- contenders ---------------------------------------------------------------------------------

Solver = tuple[Callable[[], Any], Callable[[], FloatArray], int | None]
"""What is timed, what gives (q, q_dot) of the sample at the end, and the number of steps."""


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


def heyoka_sweep(heyoka: Any, batch: Batch, threads: int, rtol: float, lanes: int | None = None) -> Solver:
    """Return heyoka's sweep in batches of `lanes` cases; without it, of its recommended size."""
    lanes = lanes or heyoka.recommended_simd_size()
    start, p = batch.y.T.copy(), batch.p.T.copy()
    count, out = len(batch.y), np.empty_like(start)
    integrators = [
        heyoka.taylor_adaptive_batch(
            heyoka_system(heyoka, batch.problem), start[:, :lanes].copy(), pars=p[:, :lanes].copy(), tol=rtol
        )
        for _ in range(threads)
    ]

    def part(number: int) -> None:
        integrator, each = integrators[number], count // lanes // threads * lanes
        for i in range(number * each, (number + 1) * each, lanes):
            integrator.set_time(0.0)
            integrator.state[:], integrator.pars[:] = start[:, i : i + lanes], p[:, i : i + lanes]
            integrator.propagate_until(END)
            out[:, i : i + lanes] = integrator.state

    def run() -> None:
        workers = [threading.Thread(target=part, args=(number,)) for number in range(threads)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()

    run()
    return run, lambda: np.array([batch.scene_state(i, out[:, i]) for i in range(SAMPLE)]), None


def _diffrax(diffrax: Any, batch: Batch, method: str, rtol: float) -> Solver:
    import jax
    import jax.numpy as jnp

    reduced = batch.problem.reduced

    def solve(y: Any, p: Any) -> Any:
        return diffrax.diffeqsolve(
            diffrax.ODETerm(lambda t, y, p: jnp.stack(reduced.rhs(y, p, (jnp.sin, jnp.cos)))),
            getattr(diffrax, method)(),
            t0=0.0,
            t1=END,
            dt0=None,
            y0=y,
            args=p,
            stepsize_controller=diffrax.PIDController(rtol=rtol, atol=absolute(rtol)),
            saveat=diffrax.SaveAt(t1=True),
            max_steps=1_000_000,
        ).ys[0]

    with jax.enable_x64(True):
        compiled = jax.jit(jax.vmap(solve))
        y, p = jnp.asarray(batch.y), jnp.asarray(batch.p)
        end = np.asarray(compiled(y, p))

    def run() -> Any:
        with jax.enable_x64(True):
            return compiled(y, p).block_until_ready()

    return run, lambda: np.array([batch.scene_state(i, end[i]) for i in range(SAMPLE)]), None


def _contenders(batch: Batch) -> dict[str, Callable[[float], Solver]]:
    found: dict[str, Callable[[float], Solver]] = {}
    for threads in (THREADS, 1):
        for method in ("taylor", "dop853", "tsit5")[: 3 if threads == THREADS else 1]:
            label = f"dalembert llvm {method}, {_threads(threads)}"
            found[label] = lambda rtol, m=method, n=threads: own_sweep(batch, m, n, rtol)
    if installed("jax") is not None and installed("diffrax") is not None:
        found["dalembert jax auto"] = lambda rtol: own_sweep(batch, "auto", 1, rtol, "jax")
    if (heyoka := installed("heyoka")) is not None:
        for threads in (THREADS, 1):
            found[f"heyoka batch, {_threads(threads)}"] = lambda rtol, n=threads: heyoka_sweep(heyoka, batch, n, rtol)
    if (diffrax := installed("diffrax")) is not None:
        for method in ("Tsit5", "Dopri8"):
            found[f"diffrax vmap {method}"] = lambda rtol, m=method: _diffrax(diffrax, batch, m, rtol)
    return found


def _threads(count: int) -> str:
    return "1 thread" if count == 1 else f"{count} threads"


# -- measurements -------------------------------------------------------------------------------


def measure_sweeps(
    tolerances: Sequence[float],
    *,
    rounds: int,
    slowest: float,
    say: Callable[[str], None] = print,
    count: int = CASES,
    fewer: int | None = None,
) -> list[Record]:
    """Return one record a scene, contender and tolerance; one slower than `slowest` [s] is not run tighter.

    The jax backend may take `_PATIENCE` times as long, at every third tolerance: it is compared at equal error too.
    But diffrax, whose time of a case hardly depends on their number, is: with `fewer` cases, at every other tolerance.
    """
    records = []
    for name, build in BATCHES.items():
        batch = build(count)
        exact = sample_states(batch)
        tasks: dict[tuple[str, float], Solver] = {}
        for label, prepare in _contenders(batch).items():
            on_jax = label.startswith("dalembert jax")
            for rtol in tolerances[::3] if on_jax else tolerances:
                tasks[label, rtol] = solver = prepare(rtol)
                if _seconds(solver) > (_PATIENCE * slowest if on_jax else slowest):
                    break
        counts = dict.fromkeys(tasks, count)
        for (label, rtol), solver in _of_fewer(build, fewer, tasks, tolerances, slowest).items():
            tasks[label, rtol], counts[label, rtol] = solver, fewer or count
        timings = interleaved({key: task[0] for key, task in tasks.items()}, rounds=rounds, seconds_each=4 * slowest)
        for (label, rtol), (_, sample, steps) in tasks.items():
            timing = timings[label, rtol]
            records.append(
                {
                    "scene": name,
                    "label": label,
                    "rtol": rtol,
                    "cases": counts[label, rtol],
                    "us": {k: round(v / counts[label, rtol], 4) for k, v in timing.microseconds().items()},
                    "error": float(np.abs(sample() - exact).max()),
                    "steps": steps,
                    "peak_share": _share(batch, label, rtol, steps, timing.median),
                }
            )
        say(f"  {name}: {len(tasks)} contenders and tolerances")
    return records


def _seconds(solver: Solver) -> float:
    begin = time.perf_counter()
    solver[0]()
    return time.perf_counter() - begin


def _of_fewer(
    build: Callable[[int], Batch],
    fewer: int | None,
    done: Mapping[tuple[str, float], Solver],
    tolerances: Sequence[float],
    slowest: float,
) -> dict[tuple[str, float], Solver]:
    """Return diffrax's solvers of fewer cases for every other tolerance that it was too slow for."""
    found: dict[tuple[str, float], Solver] = {}
    if fewer is None:
        return found
    for label, prepare in _contenders(build(fewer)).items():
        left = [rtol for rtol in tolerances if (label, rtol) not in done]
        for rtol in left[::2] if label.startswith("diffrax") else []:
            found[label, rtol] = solver = prepare(rtol)
            if _seconds(solver) > 4 * slowest:
                break
    return found


def _share(batch: Batch, label: str, rtol: float, steps: int | None, seconds: float) -> float | None:
    """Return what part of the machine's multiply-add peak a Taylor sweep reaches."""
    if steps is None or "taylor" not in label:
        return None
    flops = flops_of_step(da.compile_model(batch.problem.build()), rtol)
    return round(steps * flops / seconds / peak_flops(THREADS if str(THREADS) in label else 1), 3)


def unequal_cases(count: int = CASES, rtol: float = 1e-9) -> list[Record]:
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
