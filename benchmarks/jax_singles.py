"""Single runs in a JAX program at equal error: jitted `solve_fn` beside diffrax on the model's own vector field.

``python benchmarks/jax_singles.py`` prints one table in Markdown: microseconds of processor time a run, medians of
rounds in which all contenders of a scene take turns, at errors of 1e-6 and 1e-9. diffrax has its best setting: state
in one array, `ForwardMode()`, `throw=False`, and the faster of its Tsit5 and Dopri8.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from cases import PROBLEMS
from equal_error import time_at
from jax_speed import _chain
from tables import markdown_table

import dalembert as da

METHODS = ("taylor", "tsit5", "dopri8")
PEERS = ("Tsit5", "Dopri8")
TOLERANCES = (1e-5, 1e-7, 1e-9, 1e-11)
ERRORS = (1e-6, 1e-9)
ROUNDS, CALLS = 9, 100


def _ready(name: str) -> tuple[Any, Mapping[str, float], Mapping[str, float]]:
    problem = PROBLEMS[name]
    return da.compile_model(problem.build(), backend="jax"), problem.initial, problem.parameters


SCENES: dict[str, tuple[Callable[[], Any], float]] = {
    **{name: (partial(_ready, name), 10.0) for name in ("sleigh", "sphere", "unequal sphere")},
    **{f"planar chain of {rods}": (partial(_chain, rods), 1.0) for rods in range(2, 7)},
}


def _own(model: Any, method: str, rtol: float, span: float) -> Callable[[Any, Any], Any]:
    import jax

    solve = model.solve_fn(method=method, rtol=rtol, atol=0.01 * rtol)
    return jax.jit(lambda y, p: solve(np.array([0.0, span]), y, p).y[-1])


def _peer(model: Any, solver: str, rtol: float, span: float) -> Callable[[Any, Any], Any]:
    import diffrax
    import jax

    def run(y: Any, p: Any) -> Any:
        return diffrax.diffeqsolve(
            diffrax.ODETerm(model.vector_field),
            getattr(diffrax, solver)(),
            0.0,
            span,
            None,
            y,
            p,
            stepsize_controller=diffrax.PIDController(rtol=rtol, atol=0.01 * rtol),
            adjoint=diffrax.ForwardMode(),
            max_steps=100_000,
            throw=False,
        ).ys[-1]

    return jax.jit(run)


def _microseconds(run: Callable[[], Any]) -> float:
    begin = time.process_time()
    for _ in range(CALLS):
        run().block_until_ready()
    return 1e6 * (time.process_time() - begin) / CALLS


def measure(scene: str) -> list[str]:
    """Return a row of the table: times of our methods and of diffrax's better solver at `ERRORS`, and their ratios."""
    import jax.numpy as jnp

    build, span = SCENES[scene]
    model, initial, parameters = build()
    y, p = jnp.asarray(model.state(initial, parameters)), jnp.asarray(model.parameter_vector(parameters))
    exact = _own(model, "dopri8", 1e-13, span)(y, p)
    runs = {(name, rtol): _own(model, name, rtol, span) for name in METHODS for rtol in TOLERANCES}
    runs |= {(name, rtol): _peer(model, name, rtol, span) for name in PEERS for rtol in TOLERANCES}
    errors = {key: float(np.max(np.abs(run(y, p) - exact))) for key, run in runs.items()}
    taken: dict[tuple[str, float], list[float]] = {key: [] for key in runs}
    for _ in range(ROUNDS):
        for key, run in runs.items():
            taken[key].append(_microseconds(partial(run, y, p)))
    times = {
        name: [time_at([(errors[name, r], statistics.median(taken[name, r])) for r in TOLERANCES], e) for e in ERRORS]
        for name in (*METHODS, *PEERS)
    }
    row = [scene]
    for i in range(len(ERRORS)):
        reached = [found for name in PEERS if (found := times[name][i]) is not None]
        best = min(reached, default=None)
        row += [_text(times[name][i]) for name in METHODS] + [_text(best)]
        own = [found for name in METHODS if (found := times[name][i]) is not None]
        row.append(_text(best / min(own)) if best is not None and own else "-")
    return row


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def table() -> str:
    """Return the table."""
    import jax

    jax.config.update("jax_enable_x64", True)
    heads = [f"{name}, {error:g}" for error in ERRORS for name in (*METHODS, "diffrax", "diffrax over our best")]
    return markdown_table(["scene", *heads], [measure(scene) for scene in SCENES])


if __name__ == "__main__":
    print(table())
