"""Inputs with knots: speed against SciPy stopped at every knot, against diffrax, and against the same sweep without.

Traced runs (``solve_fn``) and their gradients by all values stand beside them.

``python benchmarks/inputs.py [--knots N] [--cases N]`` prints two tables in Markdown: one run through many knots, with
the time a knot and the error at the end; and a sweep in which every case has its own record, with the time a step.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from sympy import sin, symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

SPAN, PER_KNOT = 2000.0, 0.01
FEW = 2_000
"""Knots of the runs by peers and of the comparison of errors: they take too long for all."""
RTOL, ATOL = 1e-9, 1e-11
x, u = dynamicsymbols("x u")
m, k = symbols("m k", positive=True)
START, P = {x: 0.2, x.diff(): 0.1}, {m: 1.3, k: 2.0}

Rates = Callable[[float, Any, float], list[float]]


def scene(driven: bool) -> da.Scene:
    """Return a damped mass on a nonlinear spring, with or without a given force."""
    N, O = ReferenceFrame("N"), Point("O")
    where = O.locatenew("P", x * N.x)
    found = da.Scene("driven" if driven else "free", frame=N, origin=O, coordinates=[x])
    found.add_bodies(Particle("p", where, m))
    found.add_loads((where, ((u if driven else 0) - k * sin(x) - x.diff() / 5) * N.x))
    if driven:
        found.add_inputs(u)
    return found


def rates(t: float, y: Any, force: float) -> list[float]:
    """Return the rates of the same motion, as a person writes them."""
    return [y[1], (force - 2.0 * np.sin(y[0]) - 0.2 * y[1]) / 1.3]


def quickest(run: Callable[[], Any], times: int = 5) -> tuple[float, Any]:
    """Return the least processor time of a call, and what it returned."""
    found, least = run(), np.inf
    for _ in range(times):
        begin = time.process_time()
        found = run()
        least = min(least, time.process_time() - begin)
    return least, found


def stopped(knots: Any, values: Any, rtol: float, atol: float) -> Any:
    """Return the final state by SciPy, stopped at every knot of a held force."""
    from scipy.integrate import solve_ivp

    y = np.array([0.2, 0.1])
    for a, b, force in zip(knots[:-1], knots[1:], values[:-1], strict=True):
        y = solve_ivp(rates, (a, b), y, method="DOP853", rtol=rtol, atol=atol, args=(force,)).y[:, -1]
    return y


def diffrax_run(knots: Any, values: Any) -> Callable[[], Any] | None:
    """Return a compiled run by diffrax that steps to every knot, None where diffrax is not installed."""
    try:
        import diffrax
        import jax
        import jax.numpy as jnp
    except ImportError:
        return None
    jax.config.update("jax_enable_x64", True)
    held, times = jnp.asarray(values), jnp.asarray(knots)

    def field(t: Any, y: Any, args: Any) -> Any:
        force = held[jnp.clip(jnp.searchsorted(times, t, side="right") - 1, 0, len(held) - 1)]
        return jnp.array([y[1], (force - 2.0 * jnp.sin(y[0]) - 0.2 * y[1]) / 1.3])

    control = diffrax.ClipStepSizeController(diffrax.PIDController(rtol=RTOL, atol=ATOL), jump_ts=times[1:-1])

    @jax.jit
    def run() -> Any:
        return diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            diffrax.Dopri8(),
            knots[0],
            knots[-1],
            0.001,
            jnp.array([0.2, 0.1]),
            stepsize_controller=control,
            max_steps=20 * len(knots),
            saveat=diffrax.SaveAt(t1=True),
        ).ys[-1]

    return lambda: np.asarray(run())


def traced_rows(knots: Any, values: Any, exact: Any) -> list[tuple[str, float, str, str]]:
    """Return rows of traced runs of the same motion, and of their gradients by all values; none without JAX."""
    try:
        import jax
    except ImportError:
        return []
    jax.config.update("jax_enable_x64", True)
    model, rows = da.compile_model(scene(driven=True), backend="jax"), []
    times, p = [knots[0], knots[-1]], {"m": 1.3, "k": 2.0}
    for method in ("tsit5", "dopri8", "taylor"):
        solve = model.solve_fn(method=method, rtol=RTOL, atol=ATOL, max_steps=16 * len(knots))

        def end(values: Any, solve: Any = solve) -> Any:
            return solve(times, [0.2, 0.1], p, inputs={u: da.samples(knots, values, "hold")}).y[-1]

        run, slope = jax.jit(end), jax.jit(jax.grad(lambda values, end=end: end(values)[0]))
        seconds, found = quickest(lambda run=run: jax.block_until_ready(run(values)))
        gradient, _ = quickest(lambda slope=slope: jax.block_until_ready(slope(values)), 2)
        note = f"gradient by all values {gradient / (len(knots) - 1) * 1e6:.1f}"
        error = f"{np.max(np.abs(np.asarray(found) - exact)):.1e}"
        rows.append((f"dalembert, traced, {method}, hold", seconds / (len(knots) - 1), error, note))
    return rows


def one_run(count: int) -> None:
    """Print a table of one run through many knots of a held force."""
    model = da.compile_model(scene(driven=True))
    knots = np.arange(count + 1) * (SPAN / count if count * PER_KNOT >= SPAN else PER_KNOT)
    values = np.random.default_rng(0).normal(size=count + 1)
    few, some = knots[: FEW + 1], values[: FEW + 1]
    exact = stopped(few, some, 1e-13, 1e-15)
    rows = []
    for method in ("taylor", "dop853"):
        for kind in ("hold", "linear", "cubic"):
            inputs = {u: da.samples(knots, values, kind)}
            run = model.prepare((0.0, float(knots[-1])), inputs=inputs, method=method, rtol=RTOL, atol=ATOL)
            state, p = np.array([0.2, 0.1]), model.parameter_vector(P)
            seconds, _ = quickest(lambda run=run, state=state, p=p: run(state, p))
            options = {"method": method, "rtol": RTOL, "atol": ATOL, "t_eval": [knots[-1]], "dense": False}
            single, _ = quickest(
                lambda inputs=inputs, options=options: model.simulate(
                    (0.0, knots[-1]), START, P, inputs=inputs, **options
                )
            )
            short = {u: da.samples(few, some, kind)}
            error = model.simulate((0.0, few[-1]), START, P, inputs=short, method=method, rtol=RTOL, atol=ATOL).y[-1]
            error = f"{np.max(np.abs(error - exact)):.1e}" if kind == "hold" else ""
            rows.append(
                (f"dalembert, {method}, {kind}", single / count, error, f"prepared {seconds / count * 1e6:.2f}")
            )
    rows += traced_rows(few, some, exact)
    seconds, found = quickest(lambda: stopped(few, some, RTOL, ATOL), 1)
    rows.append(("SciPy DOP853, stopped at knots", seconds / FEW, f"{np.max(np.abs(found - exact)):.1e}", ""))
    peer = diffrax_run(few, some)
    if peer is not None:
        seconds, found = quickest(peer, 2)
        rows.append(("diffrax Dopri8, jump_ts", seconds / FEW, f"{np.max(np.abs(found - exact)):.1e}", ""))
    best = min(each for _, each, *_ in rows)
    print(f"\n{count:,} knots in {knots[-1]:g} s; error after {few[-1]:g} s\n")
    print("| run | microseconds a knot | ratio | error | |\n| --- | ---: | ---: | ---: | --- |")
    for name, each, error, note in rows:
        print(f"| {name} | {each * 1e6:.2f} | {each / best:.1f}x | {error} | {note} |")


def many(cases: int, knots: int = 500) -> None:
    """Print a table of a sweep in which each case has its own record, and the same without."""
    driven, free = da.compile_model(scene(driven=True)), da.compile_model(scene(driven=False))
    times = np.linspace(0.0, 20.0, knots)
    values = np.random.default_rng(1).normal(size=(cases, knots))
    start = {x: np.linspace(0.1, 0.5, cases), x.diff(): 0.1}
    print(f"\nA sweep of {cases:,} cases, each with its own record of {knots} samples, on one thread\n")
    print("| method, rtol | samples | nanoseconds a step | throughput a step | largest error |")
    print("| --- | --- | ---: | ---: | ---: |")
    for method in ("taylor", "dop853"):
        for rtol in (1e-6, 1e-9):
            options = {"method": method, "rtol": rtol, "atol": 1e-2 * rtol, "threads": 1}
            seconds, run = quickest(lambda o=options: free.sweep((0.0, 20.0), start, P, **o), 3)
            base = seconds / run.stats.steps
            print(f"| {method}, {rtol:g} | none | {base * 1e9:.0f} | 100 % | |")
            for kind in ("hold", "linear", "cubic"):
                inputs = {u: da.samples(times, values, kind)}
                seconds, run = quickest(
                    lambda o=options, i=inputs: driven.sweep((0.0, 20.0), start, P, inputs=i, **o), 3
                )
                each, error = seconds / run.stats.steps, 0.0
                for i in (0, cases - 1):
                    one = {x: start[x][i], x.diff(): 0.1}
                    alone = driven.simulate(
                        (0.0, 20.0), one, P, inputs={u: da.samples(times, values[i], kind)}, rtol=1e-12, atol=1e-14
                    )
                    error = max(error, abs(float(alone["x"][-1] - run.final["x"][i])))
                print(f"| | {kind} | {each * 1e9:.0f} | {100 * base / each:.0f} % | {error:.1e} |")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--knots", type=int, default=200_000)
    parser.add_argument("--cases", type=int, default=10_000)
    asked = parser.parse_args()
    one_run(asked.knots)
    many(asked.cases)
