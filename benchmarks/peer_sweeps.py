"""Sweeps by other solvers: heyoka's batches, diffrax over lanes, SciPy and CasADi case by case."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from batches import SAMPLE, Batch
from cases import END
from contenders import absolute
from numpy.typing import NDArray
from peers import (
    CVODES,
    HEYOKA,
    DiffraxSetting,
    Options,
    casadi_integrator,
    compiled_rhs,
    diffrax_solve,
    heyoka_system,
)

__all__ = ["HEYOKA_LANES", "SWEEP_SETTINGS", "DiffraxSweep", "Solver", "casadi_sweep", "diffrax_sweep"]
__all__ += ["heyoka_ensemble", "heyoka_sweep", "scipy_sweep"]

FloatArray = NDArray[np.float64]
Solver = tuple[Callable[[], Any], Callable[[], FloatArray], int | None]
"""What is timed, what gives (q, q_dot) of the sample at the end, and the number of steps."""

HEYOKA_LANES = (8, 16, 32)
"""Sizes of batches that are fastest at one tolerance or another; `recommended_simd_size()` is 4 or 8."""


SCALARS = DiffraxSetting(scalars=True)


@dataclass(frozen=True)
class DiffraxSweep:
    """How diffrax is called for many cases.

    Attributes
    ----------
    each : DiffraxSetting
    lanes : int or None
        Cases of a turn of `jax.lax.map`; None for one `jax.vmap` of all.
    threads : int
        Python threads, each with its share of the cases.
    """

    each: DiffraxSetting = SCALARS
    lanes: int | None = 1024
    threads: int = 2


SWEEP_SETTINGS = {
    "heyoka": "`taylor_adaptive_batch` with `fast_math=True`, an integrator for each thread",
    "diffrax": "state a tuple of scalars, `ForwardMode()`, `throw=False`, `lax.map` in batches of 1,024, two threads",
    "SciPy": "`ode` on a right-hand side compiled by numba, case after case",
    "CasADi": "`integrator.map` over two threads, Adams' formulas with functional iteration",
}
"""The setting of each peer for sweeps, in words."""
DIFFRAX_SWEEP = DiffraxSweep()


def heyoka_sweep(heyoka: Any, batch: Batch, threads: int, rtol: float, lanes: int, options: Options = HEYOKA) -> Solver:
    """Return heyoka's sweep in batches of `lanes` cases."""
    start, p = batch.y.T.copy(), batch.p.T.copy()
    out, share = np.empty_like(start), len(batch.y) // threads
    if share % lanes:
        raise ValueError(f"{len(batch.y)} cases do not fill batches of {lanes} on {threads} threads")
    system = heyoka_system(heyoka, batch.problem)
    integrators = [
        heyoka.taylor_adaptive_batch(system, start[:, :lanes].copy(), pars=p[:, :lanes].copy(), tol=rtol, **options)
        for _ in range(threads)
    ]

    def part(number: int) -> None:
        integrator = integrators[number]
        state, pars = integrator.state, integrator.pars  # views
        for i in range(number * share, (number + 1) * share, lanes):
            integrator.set_time(0.0)
            state[:], pars[:] = start[:, i : i + lanes], p[:, i : i + lanes]
            integrator.propagate_until(END)
            out[:, i : i + lanes] = state

    def run() -> None:
        _in_threads(part, threads)

    run()
    return run, lambda: np.array([batch.scene_state(i, out[:, i]) for i in range(SAMPLE)]), None


def heyoka_ensemble(heyoka: Any, batch: Batch, threads: int, rtol: float, lanes: int) -> Solver:
    """Return heyoka's sweep by `ensemble_propagate_until_batch`, which copies an integrator for every batch."""
    start, p = batch.y.T.copy(), batch.p.T.copy()
    out = np.empty_like(start)
    integrator = heyoka.taylor_adaptive_batch(
        heyoka_system(heyoka, batch.problem), start[:, :lanes].copy(), pars=p[:, :lanes].copy(), tol=rtol, **HEYOKA
    )

    def begin(copy: Any, i: int) -> Any:
        copy.set_time(0.0)
        copy.state[:], copy.pars[:] = (v[:, i * lanes : (i + 1) * lanes] for v in (start, p))
        return copy

    def run() -> None:
        done = heyoka.ensemble_propagate_until_batch(
            integrator, END, len(batch.y) // lanes, begin, algorithm="thread", max_workers=threads
        )
        for i, (copy, *_) in enumerate(done):
            out[:, i * lanes : (i + 1) * lanes] = copy.state

    run()
    return run, lambda: np.array([batch.scene_state(i, out[:, i]) for i in range(SAMPLE)]), None


def _in_threads(part: Callable[[int], Any], threads: int) -> None:
    workers = [threading.Thread(target=part, args=(number,)) for number in range(threads)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()


def diffrax_sweep(batch: Batch, method: str, rtol: float, setting: DiffraxSweep = DIFFRAX_SWEEP) -> Solver:
    """Return diffrax's sweep."""
    import jax
    import jax.numpy as jnp

    each = setting.each
    solve = diffrax_solve(batch.problem, method, rtol, each)

    def together(y: Any, p: Any) -> Any:
        if setting.lanes is None:
            return jax.vmap(solve)(y, p)[0]
        return jax.lax.map(lambda case: solve(*case), (y, p), batch_size=setting.lanes)[0]

    compiled = jax.jit(together)

    def shared(values: FloatArray, number: int) -> Any:
        part = np.array_split(values, setting.threads)[number]
        return tuple(map(jnp.asarray, part.T)) if each.scalars else jnp.asarray(part)

    with jax.enable_x64(True):
        parts = [(shared(batch.y, number), shared(batch.p, number)) for number in range(setting.threads)]
    ends: list[Any] = [None] * setting.threads

    def part(number: int) -> None:
        with jax.enable_x64(True):  # a setting of the thread
            ends[number] = jax.block_until_ready(compiled(*parts[number]))

    def run() -> None:
        if setting.threads == 1:
            part(0)
        else:
            _in_threads(part, setting.threads)

    def sample() -> FloatArray:
        first = np.stack(ends[0], axis=1) if each.scalars else np.asarray(ends[0])
        return np.array([batch.scene_state(i, first[i]) for i in range(SAMPLE)])

    part(0)  # compiled before two threads ask for it
    run()
    return run, sample, None


def scipy_sweep(batch: Batch, rtol: float, method: str = "dop853") -> Solver:
    """Return SciPy's runs of all cases, one after the other."""
    from scipy.integrate import ode

    solver = ode(compiled_rhs(batch.problem.reduced))
    solver.set_integrator(method, rtol=rtol, atol=absolute(rtol), nsteps=1_000_000)
    parameters, out = [tuple(row) for row in batch.p.tolist()], np.empty_like(batch.y)

    def run() -> None:
        for i, p in enumerate(parameters):
            solver.set_f_params(p).set_initial_value(batch.y[i], 0.0)
            out[i] = solver.integrate(END)

    run()
    return run, lambda: np.array([batch.scene_state(i, out[i]) for i in range(SAMPLE)]), None


def casadi_sweep(casadi: Any, batch: Batch, threads: int, rtol: float, options: Options = CVODES) -> Solver:
    """Return CasADi's sweep over threads."""
    integrator = casadi_integrator(casadi, batch.problem, rtol, options).map(len(batch.y), "thread", threads)
    start, p = casadi.DM(batch.y.T), casadi.DM(batch.p.T)

    def run() -> Any:
        return integrator(x0=start, p=p)["xf"]

    end = np.asarray(run()).T
    return run, lambda: np.array([batch.scene_state(i, end[i]) for i in range(SAMPLE)]), None
