"""Traced runs on whatever device JAX has: one run, batches and gradients, in single and double precision.

``python benchmarks/jax_gpu.py`` prints everything as Markdown: for each scene and precision the time of one run, of
batches of 100 to 1,000,000 cases and of gradients by initial state and parameters, with the error beside it, and the
same by diffrax on the model's own `vector_field`, with the same method, tolerances and cases. Errors are against runs
at a tolerance of 1e-12 in double precision on the CPU, and against their gradients.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from chains import planar_chain

import dalembert as da

__all__ = ["SCENES", "main", "measure"]

SAMPLE = 8
"""Cases of a batch that are compared with a reference."""
TOLERANCES = {"float32": (1e-5, 1e-7), "float64": (1e-8, 1e-10)}
SIZES = (100, 1_000, 10_000, 100_000, 1_000_000)
GRADIENTS = (1, 100, 1_000, 10_000, 100_000)
SOLVERS = {"tsit5": diffrax.Tsit5(), "dopri8": diffrax.Dopri8()}
HEADS = (
    "| scene | precision | task | cases | by | first call [s] | time of a case [us] | steps | error |\n"
    + "|---" * 9
    + "|"
)
_LONGEST = 1.0
"""Seconds that a task may be repeated for."""


@dataclass(frozen=True)
class Scene:
    """A scene, with a motion of it until a time [s], and a bound of its steps."""

    build: Callable[[], da.Scene]
    parameters: Mapping[str, float]
    initial: Mapping[str, float]
    end: float = 5.0
    max_steps: int = 256


def _chain(n: int) -> Scene:
    kinds = {"m": 1.2, "l": 0.8, "Ix": 0.01, "Iy": 0.05, "Iz": 0.05}
    values = {f"{letter}{i}": value for letter, value in kinds.items() for i in range(n)}
    initial = {f"q{i}": 0.3 + 0.1 * i for i in range(n)} | {f"q{i}_dot": 0.2 for i in range(n)}
    return Scene(partial(planar_chain, n), {"g": 9.81, **values}, initial, end=1.0)


SCENES = {
    "sleigh": Scene(
        da.scenes.chaplygin_sleigh,
        {"m": 1.0, "b": 0.3, "I_C": 0.5},
        {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0},
    ),
    "sphere": Scene(
        da.scenes.rolling_sphere,
        {"m": 1.3, "r": 0.5, "g": 9.81},
        {"x": 0.0, "y": 0.0, "psi": 0.1, "theta": 1.2, "phi": 0.3, "psi_dot": 0.4, "theta_dot": 0.3, "phi_dot": 1.1},
    ),
    "chain of 4": _chain(4),
}


@dataclass(frozen=True)
class Cases:
    """Compiled scene, its motion, and states and parameters of cases near it."""

    scene: Scene
    model: Any
    y: Any
    p: Any

    @staticmethod
    def of(scene: Scene) -> Cases:
        """Return a scene compiled."""
        model = da.compile_model(scene.build(), backend="jax", formulation="minimal")
        parameters = {name: scene.parameters[name] for name in model.layout.parameters}
        return Cases(scene, model, model.state(scene.initial, parameters), model.parameter_vector(parameters))

    def spread(self, count: int) -> tuple[Any, Any]:
        """Return states (count, n_y) and parameters (count, n_p): the first is the motion, others up to 5 % from it."""
        random = np.random.default_rng(1)
        shares = 0.05 * random.uniform(-1.0, 1.0, (count, len(self.y) + len(self.p)))
        shares[0] = 0.0
        y, p = np.split(np.concatenate([self.y, self.p]) * (1.0 + shares), [len(self.y)], axis=1)
        return y, p


def reference(cases: Cases, y: Any, p: Any) -> tuple[Any, Any]:
    """Return exact states (k, n_y) at the end, and gradients of `value` by states and parameters."""
    solve = cases.model.solve_fn(method="dopri8", rtol=1e-12, atol=1e-13, max_steps=4096, max_step=0.05)
    with jax.enable_x64(True), jax.default_device(jax.devices("cpu")[0]):
        end = jax.jit(jax.vmap(lambda y, p: solve(jnp.array([0.0, cases.scene.end]), y, p).y[-1]))(y, p)
        gradient = jax.grad(lambda y, p: value(solve(jnp.array([0.0, cases.scene.end]), y, p).y[-1]), argnums=(0, 1))
        return np.asarray(end), jax.tree.map(np.asarray, jax.jit(jax.vmap(gradient))(y, p))


def value(end: Any) -> Any:
    """Return a number to differentiate."""
    return jnp.sum(jnp.cos(end))


def own(cases: Cases, method: str, rtol: float, atol: float) -> Callable[[Any, Any], tuple[Any, Any]]:
    """Return the function of a state and parameters to the state at the end, by `solve_fn`."""
    solve = cases.model.solve_fn(method=method, rtol=rtol, atol=atol, max_steps=cases.scene.max_steps)
    return lambda y, p: (solve(jnp.array([0.0, cases.scene.end]), y, p).y[-1], jnp.zeros(()))


def peer(cases: Cases, method: str, rtol: float, atol: float) -> Callable[[Any, Any], tuple[Any, Any]]:
    """Return the same by diffrax on the vector field."""

    def run(y: Any, p: Any) -> tuple[Any, Any]:
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(cases.model.vector_field),
            SOLVERS[method],
            0.0,
            cases.scene.end,
            None,
            y,
            p,
            stepsize_controller=diffrax.PIDController(rtol=rtol, atol=atol),
            max_steps=cases.scene.max_steps,
            throw=False,
        )
        return found.ys[-1], found.stats["num_steps"]

    return run


def timed(task: Callable[[], Any]) -> tuple[float, float, Any]:
    """Return the seconds of the first call, the least of later ones, and the result."""
    begin = time.perf_counter()
    result = jax.block_until_ready(task())
    first, best, total = time.perf_counter() - begin, np.inf, 0.0
    while total < _LONGEST or not np.isfinite(best):
        begin = time.perf_counter()
        jax.block_until_ready(task())
        seconds = time.perf_counter() - begin
        best, total = min(best, seconds), total + seconds
    return first, best, result


def _error(found: Any, exact: Any) -> float:
    """Return the largest error of arrays, each over the largest number in its exact value but at least 1."""
    pairs = zip(jax.tree.leaves(found), jax.tree.leaves(exact), strict=True)
    return max(float(np.max(np.abs(np.asarray(a, float) - b)) / max(1.0, np.max(np.abs(b)))) for a, b in pairs)


def measure(
    names: Sequence[str],
    precisions: Sequence[str],
    methods: Sequence[str],
    sizes: Sequence[int],
    gradients: Sequence[int],
    say: Callable[[str], None],
    peers: bool = True,
) -> None:
    """Measure everything, and say each row of the table as soon as it is known."""
    for name in names:
        cases = Cases.of(SCENES[name])
        exact = reference(cases, *cases.spread(SAMPLE))
        for precision in precisions:
            with jax.enable_x64(precision == "float64"):
                tolerances = TOLERANCES[precision]
                for method in methods:
                    runs = {f"`{method}`": own(cases, method, *tolerances)}
                    if peers and method in SOLVERS:
                        runs[f"diffrax {type(SOLVERS[method]).__name__}"] = peer(cases, method, *tolerances)
                    for by, run in runs.items():
                        for task, counts in {"run": (1, *sizes), "gradient": gradients}.items():
                            for count in counts:
                                say(
                                    _row(
                                        f"{name} | {precision} | {task} | {count:,} | {by}",
                                        cases,
                                        run,
                                        task,
                                        count,
                                        exact,
                                    )
                                )


def _row(title: str, cases: Cases, run: Callable[..., Any], task: str, count: int, exact: tuple[Any, Any]) -> str:
    """Return a row of the table; what the device has no memory for says so."""
    gradient = jax.grad(lambda y, p: value(run(y, p)[0]), argnums=(0, 1))
    one = run if task == "run" else (lambda y, p: (gradient(y, p), jnp.zeros(())))
    y, p = (jnp.asarray(v) for v in cases.spread(max(count, SAMPLE)))
    y, p = (y[0], p[0]) if count == 1 else (y[:count], p[:count])
    function = jax.jit(one if count == 1 else jax.vmap(one))
    try:
        first, best, (found, steps) = timed(lambda: function(y, p))
    except jax.errors.JaxRuntimeError as failed:
        if "RESOURCE_EXHAUSTED" not in str(failed):
            raise
        return f"| {title} | | out of memory | | |"
    sample = jax.tree.map(lambda v: np.asarray(v[None] if count == 1 else v[:SAMPLE]), found)
    wanted = jax.tree.map(lambda v: v[: 1 if count == 1 else SAMPLE], exact[0] if task == "run" else exact[1])
    most = int(jnp.max(steps))
    return f"| {title} | {first:.1f} | {1e6 * best / count:.4g} | {most or ''} | {_error(sample, wanted):.1e} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=list(SCENES))
    parser.add_argument("--precisions", nargs="+", default=list(TOLERANCES), choices=list(TOLERANCES))
    parser.add_argument("--methods", nargs="+", default=["tsit5", "dopri8"], choices=[*SOLVERS, "taylor"])
    parser.add_argument("--sizes", nargs="*", type=int, default=list(SIZES), help="cases of a batch")
    parser.add_argument(
        "--gradients", nargs="*", type=int, default=list(GRADIENTS), help="cases of a batch of gradients"
    )
    parser.add_argument("--no-diffrax", action="store_true", help="leave diffrax out")
    given = parser.parse_args(arguments)
    print(f"Device: {jax.devices()[0].device_kind}; JAX {jax.__version__}, diffrax {diffrax.__version__}.\n")
    print(HEADS, flush=True)
    say = partial(print, flush=True)
    measure(
        given.scenes, given.precisions, given.methods, given.sizes, given.gradients, say, peers=not given.no_diffrax
    )


if __name__ == "__main__":
    main()
