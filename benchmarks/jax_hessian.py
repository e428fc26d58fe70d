"""Second derivatives in JAX: time and memory of Hessians of the sleigh, by every number that its motion depends on.

``python benchmarks/jax_hessian.py`` prints one table in Markdown. Each row is a process of its own: eleven numbers are
three parameters, five components of the state and three times. Seconds are those of the processor.
"""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np
from tables import markdown_table

CALLS = 50
WAYS = ("hessian", "jacfwd of jacfwd", "jacrev of jacfwd")


def measure(way: str) -> None:
    """Print seconds of the first call, of another, and the temporary memory of a call [MiB]."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import dalembert as da

    model = da.compile_model(da.scenes.chaplygin_sleigh(), backend="jax")
    start = {"x": 0.0, "y": 0.0, "theta": 0.2, "x_dot": 0.98, "theta_dot": 2.0}
    p = {"m": 1.0, "b": 0.3, "I_C": 0.5}
    solve = model.solve_fn(method="tsit5", rtol=1e-8, max_steps=256)
    n_p = len(model.layout.parameters)

    def value(z):
        parameters, state, times = z[:n_p], z[n_p:-3], z[-3:]
        return (solve(times, state, parameters).q ** 2).sum()

    at = np.concatenate([model.parameter_vector(p), model.state(start, p), [0.1, 0.6, 1.3]])
    nested = {
        "hessian": jax.hessian,
        "jacfwd of jacfwd": lambda f: jax.jacfwd(jax.jacfwd(f)),
        "jacrev of jacfwd": lambda f: jax.jacrev(jax.jacfwd(f)),
    }[way]
    function = jax.jit(nested(value))
    begin = time.process_time()
    compiled = function.lower(at).compile()
    first = time.process_time() - begin
    memory = compiled.memory_analysis().temp_size_in_bytes / 2**20
    jax.block_until_ready(compiled(at))
    again = np.inf
    for _ in range(7):
        begin = time.process_time()
        for _ in range(CALLS):  # time of other threads is counted late
            jax.block_until_ready(compiled(at))
        again = min(again, (time.process_time() - begin) / CALLS)
    print(f"{len(at)} {first:.1f} {1e3 * again:.1f} {memory:.1f}")


def main() -> None:
    """Measure each way in a process of its own, and print."""
    if len(sys.argv) > 1:
        measure(sys.argv[1])
        return
    rows = []
    for way in WAYS:
        done = subprocess.run([sys.executable, __file__, way], capture_output=True, text=True, check=True)
        rows.append([way, *done.stdout.split()])
    print(
        markdown_table(
            ["Hessian of the sleigh", "numbers", "compilation [s]", "a call [ms]", "temporary memory [MiB]"], rows
        )
    )


if __name__ == "__main__":
    main()
