"""Options of XLA for compiling long straight-line code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax

LARGEST_FUSED = 1000
"""Operations of a step up to which XLA is left to fuse them. It repeats in one fused loop for each component of the
state what these have in common, and LLVM takes more than proportionally long over a long loop: 640 operations in five
components compile in 0.5 s and run three times faster than unfused; 2,559 in eight do not compile within a minute,
and unfused in 2.5 s. Runge-Kutta attempts are faster unfused from the start (measured on CPU)."""


def compiled(function: Callable[..., Any], operations: int) -> Any:
    """Return `function` jitted; on CPU, XLA fuses nothing in it where it holds more than `LARGEST_FUSED` operations."""
    long = operations > LARGEST_FUSED and jax.default_backend() == "cpu"
    return jax.jit(function, compiler_options={"xla_disable_hlo_passes": "fusion"} if long else None)
