"""Batches in a JAX program at equal error: `jax.vmap` of `solve_fn` beside diffrax on the model's own equations.

``python benchmarks/jax_batches.py [--cases N] [--rounds N] [SCENE ...]`` prints one table in Markdown: microseconds of
processor time a case, medians of rounds in which all contenders of a scene take turns on the same cases, at errors of
1e-6 and 1e-9 (the largest of all cases). diffrax has its best setting: state a tuple of scalars, constants computed
once a case, `ForwardMode()`, `throw=False`, and the fastest of its Tsit5 and Dopri8 under `jax.vmap` of all cases and
`jax.lax.map` in batches.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from equal_error import time_at
from jax_singles import ERRORS, METHODS, PEERS, SCENES, TOLERANCES
from tables import markdown_table

LANES = (None, 64, 256)
"""Cases of a turn of `lax.map`; None for `vmap` of all."""


def _own(model: Any, method: str, rtol: float, span: float) -> Callable[[Any, Any], Any]:
    import jax

    solve = model.solve_fn(method=method, rtol=rtol, atol=0.01 * rtol)
    return jax.jit(jax.vmap(lambda y, p: solve(np.array([0.0, span]), y, p).y[-1]))


def _peer(model: Any, solver: str, lanes: int | None, span: float) -> Callable[[Any, Any, Any], Any]:
    """Return diffrax's runs of all cases, as a function of states, parameters and tolerance."""
    import diffrax
    import jax
    import jax.numpy as jnp

    from dalembert.jax.modules import compile_kernel

    program = model.stages.program
    rates, constants = (compile_kernel(program.kernel(name)) for name in ("rhs", "prepare"))

    def field(t: Any, y: Any, c: Any) -> Any:
        return tuple(jnp.asarray(rate, float) for rate in rates(t, y, c))

    def run(y: Any, p: Any, rtol: Any) -> Any:
        solved = diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            getattr(diffrax, solver)(),
            0.0,
            span,
            None,
            tuple(y),
            tuple(jnp.asarray(constant, float) for constant in constants(p)),
            stepsize_controller=diffrax.PIDController(rtol=rtol, atol=0.01 * rtol),
            adjoint=diffrax.ForwardMode(),
            max_steps=100_000,
            throw=False,
        )
        return jnp.stack([component[-1] for component in solved.ys])

    if lanes is None:
        return jax.jit(jax.vmap(run, (0, 0, None)))
    return jax.jit(lambda y, p, rtol: jax.lax.map(lambda case: run(*case, rtol), (y, p), batch_size=lanes))


def _microseconds(run: Callable[[], Any], cases: int) -> float:
    begin = time.process_time()
    run().block_until_ready()
    return 1e6 * (time.process_time() - begin) / cases


def measure(scene: str, cases: int, rounds: int) -> list[str]:
    """Return a row of the table: our methods and diffrax's best setting at `ERRORS`, and their ratios."""
    import jax.numpy as jnp

    build, span = SCENES[scene]
    model, initial, parameters = build()
    spread = np.random.default_rng(5).uniform(0.9, 1.1, (2, cases, 1))
    y = jnp.asarray(model.state(initial, parameters) * spread[0])
    p = jnp.asarray(model.parameter_vector(parameters) * spread[1])
    exact = _own(model, "dopri8", 1e-13, span)(y, p)
    runs: dict[tuple[str, float], Callable[[], Any]] = {
        (name, rtol): partial(_own(model, name, rtol, span), y, p) for name in METHODS for rtol in TOLERANCES
    }
    peers = {f"{name}, {lanes or 'all'}": _peer(model, name, lanes, span) for name in PEERS for lanes in LANES}
    runs |= {(name, rtol): partial(run, y, p, rtol) for name, run in peers.items() for rtol in TOLERANCES}
    errors = {key: float(np.max(np.abs(run() - exact))) for key, run in runs.items()}
    taken: dict[tuple[str, float], list[float]] = {key: [] for key in runs}
    for _ in range(rounds):
        for key, run in runs.items():
            taken[key].append(_microseconds(run, cases))
    row = [scene]
    for error in ERRORS:
        times = {
            name: time_at([(errors[name, r], statistics.median(taken[name, r])) for r in TOLERANCES], error)
            for name in (*METHODS, *peers)
        }
        row += [_text(times[name]) for name in METHODS]
        best = min((found, name) for name in peers if (found := times[name]) is not None)
        own = min(found for name in METHODS if (found := times[name]) is not None)
        row += [f"{_text(best[0])} ({best[1]})", f"{best[0] / own:.1f}"]
    return row


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def table(scenes: Sequence[str], cases: int, rounds: int) -> str:
    """Return the table."""
    import jax

    jax.config.update("jax_enable_x64", True)
    heads = [f"{name}, {error:g}" for error in ERRORS for name in (*METHODS, "diffrax", "diffrax over our best")]
    rows = []
    for scene in scenes:
        rows.append(measure(scene, cases, rounds))
        print("  ", *rows[-1], sep=" | ", flush=True)
    return markdown_table(["scene", *heads], rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=f"of {', '.join(SCENES)}; all if none is given")
    parser.add_argument("--cases", type=int, default=1024)
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    print(table(given.scenes or list(SCENES), given.cases, given.rounds))
