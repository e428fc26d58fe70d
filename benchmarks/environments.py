"""Steps a second of a batch of cart-poles, by `model.functions.step` in a loop of an environment.

``python benchmarks/environments.py`` prints a table for a JAX program in single precision: resets included, a random
control each step, steps of 0.02 s by the classical method of order 4, and the error of one step beside the speed.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from sympy import symbols
from sympy.physics.mechanics import Particle, Point, ReferenceFrame, dynamicsymbols

import dalembert as da

__all__ = ["cart_pole", "environment", "main"]

PARAMETERS = {"M": 1.0, "m": 0.1, "l": 0.5, "g": 9.81}
DT = 0.02
"""Time between controls [s]."""


def cart_pole() -> Any:
    """Return a mass on a rod that is hinged to a cart, which an input pushes; compiled."""
    x, theta, u = dynamicsymbols("x theta u")
    M, m, l, g = symbols("M m l g", positive=True)
    N, O = ReferenceFrame("N"), Point("O")
    A = N.orientnew("A", "Axis", (theta, N.z))
    C = O.locatenew("C", x * N.x)
    P = C.locatenew("P", l * A.y)
    scene = da.Scene("cart_pole", frame=N, origin=O, coordinates=[x, theta])
    scene.add_bodies(Particle("cart", C, M), Particle("bob", P, m))
    scene.apply_uniform_gravity(-g * N.y)
    scene.add_inputs(u)
    scene.add_loads((C, u * N.x))
    return da.compile_model(scene, backend="jax")


def environment(model: Any) -> tuple[Callable[[Any], Any], Callable[..., tuple[Any, Any, Any]]]:
    """Return the functions reset(key) -> y and step(y, u, key) -> y, reward, done of one environment."""

    def reset(key: Any) -> Any:
        return 0.1 * jax.random.uniform(key, (4,), minval=-1.0)

    def step(y: Any, u: Any, key: Any) -> tuple[Any, Any, Any]:
        y = model.functions.step(y, {"u": u}, DT, PARAMETERS)
        done = (jnp.abs(y[0]) > 2.4) | (jnp.abs(y[1]) > 0.21)
        return jnp.where(done, reset(key), y), 1.0 - done, done

    return reset, step


def speed(model: Any, count: int, steps: int) -> float:
    """Return the environment steps of a second of `count` environments side by side."""
    reset, step = environment(model)

    def one(y: Any, key: Any) -> tuple[Any, Any]:
        u = 10.0 * jnp.sign(jax.random.uniform(key, (count,), minval=-1.0))
        y, reward, _ = jax.vmap(step, (0, 0, None))(y, u, key)
        return y, jnp.sum(reward)

    @jax.jit
    def run(key: Any) -> Any:
        first, rest = jax.random.split(key)
        y = jax.vmap(reset)(jax.random.split(first, count))
        return jax.lax.scan(one, y, jax.random.split(rest, steps))

    key, best = jax.random.PRNGKey(0), np.inf
    for number in range(6):
        begin = time.perf_counter()
        jax.block_until_ready(run(key))
        if number:
            best = min(best, time.perf_counter() - begin)
    return count * steps / best


def error(model: Any) -> float:
    """Return the error of one step, against a run at a tolerance of 1e-12."""
    start = {"x": 0.0, "theta": 0.1, "x_dot": 0.2, "theta_dot": -0.3}
    run = model.simulate((0.0, DT), start, PARAMETERS, inputs={"u": 10.0}, rtol=1e-12)
    found = model.functions.step(jnp.asarray(run.y[0]), {"u": 10.0}, DT, PARAMETERS)
    return float(np.abs(np.asarray(found, float) - run.y[-1]).max())


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--counts", nargs="+", type=int, default=[64, 1024, 16_384])
    given = parser.parse_args(arguments)
    model = cart_pole()
    print(f"Device: {jax.devices()[0].device_kind}. Error of one step: {error(model):.1e}.\n")
    print("| environments | million steps a second |\n|---|---|")
    for count in given.counts:
        print(f"| {count:,} | {speed(model, count, max(200, 2_000_000 // count)) / 1e6:.2f} |", flush=True)


if __name__ == "__main__":
    main()
