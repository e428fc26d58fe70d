"""The jax backend against diffrax used by hand: sweeps, single runs, gradients, and compile times.

``python benchmarks/jax_speed.py`` prints ratios; `measure` returns them for `run.py`. The peer is what a JAX user would
write: equations reduced by hand, ``diffeqsolve`` by Tsit5, ``vmap`` over cases, ``jit``. Contenders are compared at
equal error: the time of the peer is read between its runs at several tolerances, on logarithmic axes. Errors are
against a run of the numba backend at 1e-13.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import unequal_sphere as sphere
from chains import planar_chain
from measure import interleaved

import dalembert as da

__all__ = ["measure", "text"]

END = 10.0
SLEIGH = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": float(np.cos(0.2)), "theta_dot": 2.0}


@dataclass(frozen=True)
class Family:
    """Cases of one scene: what varies, and the same cases by hand.

    Attributes
    ----------
    parameters : callable
        Number of cases -> parameters, arrays among them.
    peer : callable
        (number of cases, jnp) -> right-hand side (t, y, args), start (n_y,), args (k, n_args).
    coordinates : int
        How many components of the state, the first ones, are coordinates and are compared.
    """

    scene: Callable[[], da.Scene]
    initial: Mapping[str, float]
    parameters: Callable[[int], dict[str, Any]]
    peer: Callable[[int, Any], tuple[Callable[..., Any], Any, Any]]
    coordinates: int


def _sleighs(count: int) -> dict[str, Any]:
    return {"m": 1.0, "b": np.linspace(0.1, 0.5, count), "I_C": 0.5}


def _sleigh_peer(count: int, jnp: Any) -> tuple[Callable[..., Any], Any, Any]:
    def rhs(_: Any, y: Any, p: Any) -> Any:
        theta, v, omega = y[2], y[3], y[4]
        return jnp.stack([v * jnp.cos(theta), v * jnp.sin(theta), omega, p[0] * omega**2, -p[1] * v * omega])

    b = np.linspace(0.1, 0.5, count)
    return rhs, jnp.array([0.0, 0.0, 0.2, 1.0, 2.0]), jnp.stack([b, b / 0.5], axis=1)


def _spheres(count: int) -> dict[str, Any]:
    return sphere.PARAMETERS | {"J_3": np.linspace(0.15, 0.22, count)}


def _sphere_peer(count: int, jnp: Any) -> tuple[Callable[..., Any], Any, Any]:
    def rhs(_: Any, y: Any, p: Any) -> Any:
        return jnp.stack(sphere.hand_written(y, p, jnp))

    p, ones = sphere.PARAMETERS, np.ones(count)
    fixed = (p["m"] * p["r"] ** 2, p["r"], p["J_1"], p["J_2"])
    args = jnp.stack([*(value * ones for value in fixed), np.linspace(0.15, 0.22, count)], axis=1)
    return rhs, jnp.asarray(sphere.hand_written_start(np)), args


FAMILIES = {
    "sleigh": Family(da.scenes.chaplygin_sleigh, SLEIGH, _sleighs, _sleigh_peer, 3),
    "unequal sphere": Family(sphere.unequal_sphere, sphere.INITIAL, _spheres, _sphere_peer, 5),
}


def _peer(family: Family, count: int, rtol: float) -> Callable[[], Any]:
    """Return the peer at a tolerance: final states (k, n_y), or (n_y,) of one case."""
    import diffrax
    import jax
    import jax.numpy as jnp

    rhs, start, args = family.peer(count, jnp)

    def one(p: Any) -> Any:
        return diffrax.diffeqsolve(
            diffrax.ODETerm(rhs),
            diffrax.Tsit5(),
            0.0,
            END,
            None,
            start,
            p,
            stepsize_controller=diffrax.PIDController(rtol=rtol, atol=rtol / 100),
            adjoint=diffrax.ForwardMode(),
            max_steps=None,
        ).ys[-1]

    many = jax.jit(jax.vmap(one) if count > 1 else lambda p: one(p[0])[None])
    return lambda: jax.block_until_ready(many(args))


def _own_sweep(family: Family, model: Any, count: int, rtol: float) -> Callable[[], Any]:
    options = {"rtol": rtol, "atol": rtol / 100}
    return lambda: model.sweep((0.0, END), family.initial, family.parameters(count), **options)


def _own_single(family: Family, model: Any, rtol: float) -> Callable[[], Any]:
    """Return a run as a JAX program has it: a jitted `solve_fn` from the state, by Tsit5 as the peer's."""
    import jax

    solve = model.solve_fn(method="tsit5", mode="forward", rtol=rtol, atol=rtol / 100)
    parameters = {name: float(np.ravel(value)[0]) for name, value in family.parameters(1).items()}
    y, p = model.state(family.initial, parameters), model.parameter_vector(parameters)
    times = np.array([0.0, END])
    run = jax.jit(lambda y, p: solve(times, y, p).y[-1])
    return lambda: jax.block_until_ready(run(y, p))


def _timed(task: Callable[[], Any]) -> tuple[float, Any]:
    begin = time.perf_counter()
    result = task()
    return time.perf_counter() - begin, result


def sweeps(name: str, count: int, tolerances: Sequence[float], say: Callable[[str], None]) -> dict[str, Any]:
    """Return seconds and errors of a sweep of `count` cases, and how much longer the peer takes at equal error."""
    family = FAMILIES[name]
    reference = da.compile_model(family.scene())
    names = reference.layout.coordinates
    exact = reference.sweep((0.0, END), family.initial, family.parameters(count), rtol=1e-13, atol=1e-15)
    q = np.stack([exact.final[c] for c in names], axis=1)
    model = da.compile_model(family.scene(), backend="jax")
    tasks: dict[tuple[str, float], Callable[[], Any]] = {}
    rows: dict[tuple[str, float], dict[str, float]] = {}
    for solver in ("own", "peer"):
        for rtol in tolerances:
            key = solver, rtol
            own = solver != "peer"
            tasks[key] = _own_sweep(family, model, count, rtol) if own else _peer(family, count, rtol)
            first, end = _timed(tasks[key])
            found = np.stack([end.final[c] for c in names], axis=1) if own else np.asarray(end)[:, : family.coordinates]
            rows[key] = {"first": first, "error": float(np.abs(found - q).max())}
    for key, timing in interleaved(tasks, rounds=5, seconds_each=2.0).items():
        rows[key]["seconds"] = timing.median
    peers = [rows["peer", rtol] for rtol in tolerances]
    result = {}
    for rtol in tolerances:
        own_row = rows["own", rtol]
        ratio = _at_error(peers, own_row["error"]) / own_row["seconds"]
        say(
            f"  {count} x {name}, rtol {rtol:g}: {own_row['seconds']:.3f} s, error {own_row['error']:.1e}; "
            f"the peer takes {ratio:.1f} times as long at that error (first call {own_row['first']:.1f} s, "
            f"the peer's {rows['peer', rtol]['first']:.1f} s)"
        )
        result[f"{rtol:g}"] = {**own_row, "ratio": ratio}
    return {"cases": count, "own": result, "peer": {f"{r:g}": rows["peer", r] for r in tolerances}}


def _at_error(rows: Sequence[dict[str, float]], error: float) -> float:
    """Return the seconds at an error, between runs on logarithmic axes; beyond them, those of the nearest run."""
    pairs = sorted((np.log(row["error"]), np.log(row["seconds"])) for row in rows)
    return float(np.exp(np.interp(np.log(error), *zip(*pairs, strict=True))))


def single(name: str, tolerances: Sequence[float], say: Callable[[str], None]) -> dict[str, Any]:
    """Return seconds of one trajectory by `solve_fn` and by the peer, both Tsit5 at the same tolerance."""
    family = FAMILIES[name]
    model = da.compile_model(family.scene(), backend="jax")
    result = {}
    for rtol in tolerances:
        tasks = {"own": _own_single(family, model, rtol), "peer": _peer(family, 1, rtol)}
        for task in tasks.values():
            task()
        timings = interleaved(tasks, rounds=15, seconds_each=1.0)
        own, peer = timings["own"].median, timings["peer"].median
        say(f"  one {name}, rtol {rtol:g}: {1e3 * own:.2f} ms, the peer {1e3 * peer:.2f} ms")
        result[f"{rtol:g}"] = {"own": own, "peer": peer}
    return result


def gradients(say: Callable[[str], None]) -> dict[str, Any]:
    """Return seconds of a run, and of the gradient of a final position with respect to all of some 20 parameters."""
    import jax

    model = da.compile_model(planar_chain(6), backend="jax")
    names = model.layout.parameters
    generator = np.random.default_rng(3)
    p = generator.uniform(0.5, 1.5, len(names))
    initial = {name: 0.3 for name in model.layout.coordinates} | dict.fromkeys(model.layout.rates, 0.1)
    y = model.state(initial, dict(zip(names, p, strict=True)))
    solve = model.solve_fn(method="tsit5", rtol=1e-8, atol=1e-10)
    times = np.array([0.0, 1.0])

    def position(p: Any) -> Any:
        return solve(times, y, p).q[-1, 0]

    run, gradient = jax.jit(position), jax.jit(jax.value_and_grad(position))
    tasks = {"run": lambda: jax.block_until_ready(run(p)), "gradient": lambda: jax.block_until_ready(gradient(p))}
    firsts = {key: _timed(task)[0] for key, task in tasks.items()}
    timings = interleaved(tasks, rounds=15, seconds_each=1.0)
    ratio = timings["gradient"].median / timings["run"].median
    say(
        f"  gradient with respect to {len(names)} parameters: {ratio:.1f} times the run of "
        f"{1e3 * timings['run'].median:.2f} ms (first calls {firsts['run']:.1f} s and {firsts['gradient']:.1f} s)"
    )
    return {"parameters": len(names), "run": timings["run"].median, "ratio": ratio, "first": firsts}


def compile_times(sizes: Sequence[int], say: Callable[[str], None]) -> list[dict[str, float]]:
    """Return seconds of the first evaluation and of the first run against the operations of the right-hand side."""
    rows = []
    for n in sizes:
        model = da.compile_model(planar_chain(n), backend="jax")
        parameters = dict.fromkeys(model.layout.parameters, 1.0)
        initial = dict.fromkeys((*model.layout.coordinates, *model.layout.rates), 0.1)
        operations = len(model.stages.program.kernel("rhs").body)
        state = np.full(n, 0.1)
        evaluation = _timed(lambda model=model, q=state, p=parameters: model.accelerations(0.0, q, q, p))[0]
        run = _timed(lambda model=model, i=initial, p=parameters: model.simulate((0, 0.01), i, p, method="tsit5"))[0]
        say(f"  {operations} operations: first evaluation {evaluation:.1f} s, first simulate {run:.1f} s")
        rows.append({"operations": operations, "evaluation": evaluation, "simulate": run})
    return rows


def measure(quick: bool, say: Callable[[str], None] = print) -> dict[str, Any]:
    """Return everything, ready for JSON."""
    import jax

    with jax.enable_x64(True):
        tolerances = (1e-6, 1e-9) if quick else (1e-4, 1e-6, 1e-8, 1e-10)
        count = 2048 if quick else 16_384
        return {
            "device": jax.devices()[0].platform,
            "sweeps": {name: sweeps(name, count, tolerances, say) for name in FAMILIES},
            "single": {name: single(name, tolerances[:2], say) for name in FAMILIES},
            "gradient": gradients(say),
            "compile": compile_times((4, 10) if quick else (4, 10, 20, 40), say),
        }


def text(result: Mapping[str, Any]) -> str:
    """Return a result as lines of Markdown."""
    lines = []
    for name, table in result["sweeps"].items():
        ratios = ", ".join(f"{row['ratio']:.1f} at {row['error']:.0e}" for row in table["own"].values())
        lines.append(
            f"- {table['cases']:,} x {name}: `vmap` of diffrax's Tsit5 on equations reduced by hand takes, at equal"
            f" error, this many times as long as the sweep: {ratios}."
        )
    for name, table in result["single"].items():
        pairs = ", ".join(f"{1e3 * row['own']:.2f} and {1e3 * row['peer']:.2f}" for row in table.values())
        lines.append(f"- One {name}, milliseconds by `solve_fn` and by hand, both Tsit5: {pairs}.")
    gradient = result["gradient"]
    lines.append(f"- Gradient for {gradient['parameters']} parameters: {gradient['ratio']:.1f} times the run.")
    sizes = ", ".join(f"{row['operations']}: {row['simulate']:.1f} s" for row in result["compile"])
    lines.append(f"- First `simulate` against operations of the right-hand side: {sizes}.")
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer cases and tolerances")
    print(text(measure(parser.parse_args().quick)))
