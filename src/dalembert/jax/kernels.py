"""Generated kernels as traceable functions from arrays to an array."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from ..codegen.printers import JAX_STEPS, Printer
from ..codegen.rendering import render
from ..ir.kernel import Kernel
from . import functions
from .runs.kernels import Function


def compile_kernel(kernel: Kernel, printer: Printer = JAX_STEPS, in_branches: frozenset[str] | None = None) -> Function:
    """Return a kernel that is no part of a generated module as a function of its arguments, giving its outputs.

    `in_branches` as for `Printer.lines`.
    """
    variables = {
        "arguments": ", ".join(kernel.arguments),
        "lines": printer.lines(kernel, in_branches),
        "outputs": printer.outputs(kernel),
    }
    namespace: dict[str, Any] = {"jnp": jnp, "fn": functions}
    exec(render("jax/kernel.py.j2", variables), namespace)
    function: Function = namespace["kernel"]
    return function
