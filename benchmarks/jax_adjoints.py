"""Gradients of the jax backend: time, memory and accuracy, in one run and in segments, and those of diffrax beside.

``python benchmarks/jax_adjoints.py`` prints one table in Markdown: gradients of the squares of the last coordinates by
all parameters. Each row is a process of its own. Seconds are those of the processor.
"""

from __future__ import annotations

import subprocess
import sys
import time
from typing import Any

import numpy as np
from jax_speed import GRADIENTS
from tables import markdown_table

OWN = ("one run", "in segments")
PEERS = ("RecursiveCheckpointAdjoint", "BacksolveAdjoint")
SCENES = {"sleigh": 10.0, "planar chain of 4": 1.0}
RTOL, ATOL, MOST = 1e-8, 1e-10, 4096
SEGMENTS = 16


def _own(model: Any, rtol: float, span: float, y: Any) -> Any:
    """Return the last state, a function of the parameters, by `solve_fn`."""
    solve = model.solve_fn(method="tsit5", rtol=rtol, atol=0.01 * rtol, max_steps=MOST)
    return lambda p: solve(np.array([0.0, span]), y, p).y[-1]


def _in_segments(model: Any, span: float, y: Any) -> Any:
    """Return the same by one run after the other, each of which is made again when it is differentiated."""
    import jax

    solve = model.solve_fn(method="tsit5", rtol=RTOL, atol=ATOL, max_steps=MOST // SEGMENTS)

    def last(p: Any) -> Any:
        @jax.checkpoint
        def segment(y: Any, t: Any) -> Any:
            return solve(jax.numpy.stack([t, t + span / SEGMENTS]), y, p).y[-1], None

        return jax.lax.scan(segment, jax.numpy.asarray(y), span / SEGMENTS * np.arange(SEGMENTS))[0]

    return last


def _peer(model: Any, adjoint: str, span: float, y: Any) -> Any:
    """Return the same by diffrax on the model's vector field."""
    import diffrax

    def last(p: Any) -> Any:
        return diffrax.diffeqsolve(
            diffrax.ODETerm(model.vector_field),
            diffrax.Tsit5(),
            0.0,
            span,
            None,
            y,
            p,
            stepsize_controller=diffrax.PIDController(rtol=RTOL, atol=ATOL),
            adjoint=getattr(diffrax, adjoint)(),
            max_steps=MOST,
        ).ys[-1]

    return last


def measure(scene: str, adjoint: str) -> None:
    """Print seconds of a compilation, of a gradient, its temporary memory [KiB], and its relative error."""
    import jax

    jax.config.update("jax_enable_x64", True)
    model, initial, parameters = GRADIENTS[scene]()
    span, y, p = SCENES[scene], model.state(initial, parameters), model.parameter_vector(parameters)
    exact = jax.jit(jax.grad(lambda p: (_own(model, 1e-12, span, y)(p) ** 2).sum()))(p)
    if adjoint in PEERS:
        last = _peer(model, adjoint, span, y)
    else:
        last = _in_segments(model, span, y) if adjoint == OWN[1] else _own(model, RTOL, span, y)
    begin = time.process_time()
    gradient = jax.jit(jax.grad(lambda p: (last(p) ** 2).sum())).lower(p).compile()
    first = time.process_time() - begin
    error = np.max(np.abs(np.asarray(gradient(p)) - exact)) / np.max(np.abs(exact))
    again = np.inf
    for _ in range(30):
        begin = time.process_time()
        for _ in range(5):
            jax.block_until_ready(gradient(p))
        again = min(again, (time.process_time() - begin) / 5)
    memory = gradient.memory_analysis().temp_size_in_bytes / 1024
    print(f"{first:.1f} {1e6 * again:.0f} {memory:.1f} {error:.0e}")


def main() -> None:
    """Measure each adjoint of each scene in a process of its own, and print."""
    if len(sys.argv) > 1:
        measure(*sys.argv[1:])
        return
    rows = []
    for scene in SCENES:
        for adjoint in (*OWN, *PEERS):
            done = subprocess.run(
                [sys.executable, __file__, scene, adjoint], capture_output=True, text=True, check=True
            )
            name = f"diffrax {adjoint}" if adjoint in PEERS else adjoint
            rows.append([scene, name, *done.stdout.split()])
    heads = ["scene", "gradient", "compilation [s]", "time [us]", "temporary memory [KiB]", "error"]
    print(markdown_table(heads, rows))


if __name__ == "__main__":
    main()
