"""[Kernel] -> traced functions whose code XLA compiles in blocks.

XLA on CPU merges element-by-element operations into one loop for each array that comes out, and repeats in each what
they have in common: time to compile and to run grows faster than the code. Here a long kernel is cut into blocks of
`BLOCK` operations, each of which hangs on a condition that is always true and that XLA cannot know, so that what one
block hands to the next is computed once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from ...ir.branches import only_in_branches
from ...ir.program import Assignment, Kernel, Load
from ..printers import JAX, Printer
from .kernels import Function, compile_kernel

__all__ = ["BLOCK", "LARGEST_WHOLE", "blocked"]

BLOCK = 12
"""Operations of a block: few enough that little is repeated in it (measured on right-hand sides of chains)."""

LARGEST_WHOLE = 100
"""Operations up to which a kernel is one piece."""

Conditional = Callable[[Any], Function]


def blocked(kernel: Kernel, printer: Printer = JAX) -> Conditional:
    """Return a function from a condition, which must be true, to the function (t, y, c) of a kernel."""
    whole = compile_kernel(kernel, printer)
    if len(kernel.body) <= LARGEST_WHOLE:
        return lambda go: whole
    chosen = only_in_branches(kernel)
    blocks = [(part.loads, part.outputs, compile_kernel(part, printer, chosen)) for part in _parts(kernel)]
    places = {"t": 0, "y": 1, "c": 2}

    def run(go: Any, *arguments: Any) -> tuple[Any, ...]:
        known: dict[Any, Any] = {}
        for load in kernel.loads:
            array = arguments[places[load.array]]
            known[load.target] = array if load.index is None else array[load.index]
        for loads, outputs, function in blocks:
            inputs = tuple(jnp.asarray(known[load.target], dtype=float) for load in loads)
            known |= zip(outputs, _held(go, function, inputs), strict=True)
        return tuple(known.get(output, output) for output in kernel.outputs)

    return lambda go: lambda t, y, c: run(go, t, y, c)


def _held(go: Any, function: Function, inputs: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the outputs of a block, computed under a condition."""

    def block(*values: Any) -> tuple[Any, ...]:
        return tuple(jnp.asarray(output, dtype=float) for output in function(values))

    shapes = jax.eval_shape(block, *inputs)
    found: tuple[Any, ...] = lax.cond(go, block, lambda *_: tuple(jnp.zeros(s.shape) for s in shapes), *inputs)
    return found


def _parts(kernel: Kernel) -> list[Kernel]:
    """Return a kernel in parts of one argument x, which holds what a part reads, giving what later parts read."""
    lines = [kernel.body[i : i + BLOCK] for i in range(0, len(kernel.body), BLOCK)]
    last = {arg: number for number, part in enumerate(lines) for line in part for arg in line.args}
    last |= dict.fromkeys(kernel.outputs, len(lines))
    return [_part(kernel.name, number, part, last) for number, part in enumerate(lines)]


def _part(name: str, number: int, lines: tuple[Assignment, ...], last: dict[Any, int]) -> Kernel:
    own = {line.target for line in lines}
    read = dict.fromkeys(arg for line in lines for arg in line.args if isinstance(arg, str) and arg not in own)
    loads = tuple(Load(value, "x", i) for i, value in enumerate(read))
    outputs = tuple(line.target for line in lines if last.get(line.target, -1) > number)
    return Kernel(f"{name}_{number}", ("x",), loads, lines, outputs)
