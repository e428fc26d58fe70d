"""The jax backend: single runs beside diffrax used by hand, gradients, and compile times.

`singles` is for every run of the benchmarks, `measure` for full ones; ``python benchmarks/jax_speed.py`` prints
what that measures, with ``--compile`` compile times alone.
Sweeps of this backend stand beside those of the others in `sweeps`.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from cases import END, PROBLEMS, Problem
from chains import planar_chain
from contenders import Contender, Prepared, absolute
from measure import interleaved
from peers import peers
from precision import measure_contenders

import dalembert as da

__all__ = ["NAMES", "TOLERANCES", "measure", "singles", "text"]

NAMES = ("sleigh", "unequal sphere")
METHODS = ("taylor", "tsit5", "dopri8")
TOLERANCES = (1e-5, 1e-9, 1e-12)


def _own(problem: Problem, model: Any, method: str, rtol: float) -> Prepared:
    """Return a run as a JAX program has it: a jitted `solve_fn` from the state to the state."""
    import jax

    solve = model.solve_fn(method=method, rtol=rtol, atol=absolute(rtol))
    times = np.array([0.0, END])
    with jax.enable_x64(True):
        y, p = (
            jax.numpy.asarray(v)
            for v in (model.state(problem.initial, problem.parameters), model.parameter_vector(problem.parameters))
        )
        motion = jax.jit(solve)(times, y, p)
        error = problem.error(np.asarray(motion.q[-1]), np.asarray(motion.qdot[-1]))
        compiled = jax.jit(lambda y, p: solve(times, y, p).y[-1])
        compiled(y, p)

    def run() -> Any:
        with jax.enable_x64(True):
            return compiled(y, p).block_until_ready()

    return Prepared(run, None, error)


def singles(
    names: Sequence[str], tolerances: Sequence[float], rounds: int, seconds_each: float, say: Callable[[str], None]
) -> list[dict[str, Any]]:
    """Return a record a scene, method and tolerance: one trajectory by `solve_fn`, and by diffrax used by hand."""
    records: list[dict[str, Any]] = []
    for name in names:
        problem = PROBLEMS[name]
        model = da.compile_model(problem.build(), backend="jax")
        contenders = [
            Contender("dalembert jax solve_fn", "", method, partial(_own, problem, model, method)) for method in METHODS
        ]
        contenders += [peer for peer in peers(problem) if peer.solver == "diffrax"]
        records += measure_contenders(name, contenders, tolerances, rounds, seconds_each, math.inf)
        say(f"  {name}: one trajectory by solve_fn and by diffrax")
    return records


def _timed(task: Callable[[], Any]) -> tuple[float, Any]:
    begin = time.perf_counter()
    result = task()
    return time.perf_counter() - begin, result


def _chain(rods: int) -> tuple[Any, dict[str, float], dict[str, float]]:
    """Return a chain of rods with parameters by chance, and where it starts."""
    model = da.compile_model(planar_chain(rods), backend="jax")
    names = model.layout.parameters
    values = np.random.default_rng(3).uniform(0.5, 1.5, len(names))
    initial = {name: 0.3 for name in model.layout.coordinates} | dict.fromkeys(model.layout.rates, 0.1)
    return model, initial, dict(zip(names, values, strict=True))


def _sleigh() -> tuple[Any, Mapping[str, float], Mapping[str, float]]:
    problem = PROBLEMS["sleigh"]
    return da.compile_model(problem.build(), backend="jax"), problem.initial, problem.parameters


GRADIENTS = {
    "planar chain of 4": partial(_chain, 4),
    "planar chain of 6": partial(_chain, 6),
    "sleigh": _sleigh,
}


def gradients(say: Callable[[str], None]) -> list[dict[str, Any]]:
    """Return a record a scene: seconds of a run, and of the gradient of a final position by all parameters."""
    return [_gradient(name, *build(), say) for name, build in GRADIENTS.items()]


def _gradient(
    name: str, model: Any, initial: Mapping[str, float], parameters: Mapping[str, float], say: Callable[[str], None]
) -> dict[str, Any]:
    import jax

    y, p = model.state(initial, parameters), model.parameter_vector(parameters)
    solve = model.solve_fn(method="tsit5", rtol=1e-8, atol=1e-10)
    times = np.array([0.0, 1.0])

    def position(p: Any) -> Any:
        return solve(times, y, p).q[-1, 0]

    run, gradient = jax.jit(position), jax.jit(jax.value_and_grad(position))
    tasks = {"run": lambda: jax.block_until_ready(run(p)), "gradient": lambda: jax.block_until_ready(gradient(p))}
    firsts = {key: _timed(task)[0] for key, task in tasks.items()}
    timings = interleaved(tasks, rounds=15, seconds_each=1.0)
    ratio = timings["gradient"].median / timings["run"].median
    compiling = {count: _spent(partial(_compile_gradient, solve, count, y, p)) for count in (2, 5)}
    say(
        f"  {name}, gradient by {len(p)} parameters: {ratio:.1f} times the run of "
        f"{1e3 * timings['run'].median:.2f} ms (first calls {firsts['run']:.1f} s and {firsts['gradient']:.1f} s);"
        f" compiled in {compiling[2]:.1f} s of CPU, with five times in {compiling[5]:.1f}"
    )
    return {
        "compiling": compiling,
        "name": name,
        "parameters": len(p),
        "run": timings["run"].median,
        "ratio": ratio,
        "first": firsts,
    }


def _compile_gradient(solve: Any, count: int, y: Any, p: Any) -> None:
    """Compile the gradient by parameters and start of a run with so many times."""
    import jax

    times = np.linspace(0.0, 1.0, count)
    gradient = jax.grad(lambda p, y: (solve(times, y, p).q ** 2).sum(), argnums=(0, 1))
    jax.jit(gradient).lower(p, y).compile()


def _spent(task: Callable[[], Any]) -> float:
    """Return the CPU seconds of a task, of all threads."""
    begin = time.process_time()
    task()
    return time.process_time() - begin


def compile_times(sizes: Sequence[int], say: Callable[[str], None]) -> list[dict[str, float]]:
    """Return CPU seconds of the first evaluation, run, and jitted `solve_fn`, by operations of the right-hand side."""
    import jax

    rows = []
    for n in sizes:
        model = da.compile_model(planar_chain(n), backend="jax")
        parameters = dict.fromkeys(model.layout.parameters, 1.0)
        initial = dict.fromkeys((*model.layout.coordinates, *model.layout.rates), 0.1)
        operations = len(model.stages.program.kernel("rhs").body)
        state = np.full(n, 0.1)
        evaluation = _spent(lambda model=model, q=state, p=parameters: model.accelerations(0.0, q, q, p))
        run = _spent(lambda model=model, i=initial, p=parameters: model.simulate((0, 0.01), i, p, method="tsit5"))
        with jax.enable_x64(True):
            traced = jax.jit(model.solve_fn(initial, method="tsit5"))
            times = np.array([0.0, 0.01])
            solve = _spent(lambda f=traced, t=times, i=initial, p=parameters: jax.block_until_ready(f(t, i, p)))
        say(
            f"  {operations} operations: first evaluation {evaluation:.1f} s, first simulate {run:.1f} s,"
            f" jitted solve_fn {solve:.1f} s of CPU"
        )
        rows.append({"operations": operations, "evaluation": evaluation, "simulate": run, "solve_fn": solve})
    return rows


def compile_table(rows: Sequence[Mapping[str, float]]) -> str:
    """Return CPU seconds to compile as the table of ``docs/jax_measurements.md``."""
    heads = "| operations of the right-hand side | first evaluation | first `simulate` | `jax.jit` of `solve_fn` |"
    lines = [heads, "|---|---|---|---|"]
    lines += [
        f"| {row['operations']:,} | {row['evaluation']:.1f} | {row['simulate']:.1f} | {row['solve_fn']:.1f} |"
        for row in rows
    ]
    return "\n".join(lines)


def measure(quick: bool, say: Callable[[str], None] = print) -> dict[str, Any]:
    """Return everything, ready for JSON."""
    import jax

    with jax.enable_x64(True):
        return {
            "device": jax.devices()[0].platform,
            "gradients": gradients(say),
            "compile": compile_times((4, 10) if quick else (4, 10, 20), say),
        }


def text(result: Mapping[str, Any]) -> str:
    """Return a result as lines of Markdown."""
    lines = [
        f"- Gradient of the {row['name']} by {row['parameters']} parameters: {row['ratio']:.1f} times the run."
        for row in result["gradients"]
    ]
    lines += ["", "CPU seconds to compile, planar chains by `tsit5`:", "", compile_table(result["compile"])]
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer sizes")
    parser.add_argument("--compile", action="store_true", help="only the times to compile")
    arguments = parser.parse_args()
    if arguments.compile:
        print(compile_table(compile_times((4, 10) if arguments.quick else (4, 10, 20), lambda _: None)))
    else:
        print(text(measure(arguments.quick)))
