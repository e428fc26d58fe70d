"""Generated JAX modules, rendered and loaded; kernels as traceable functions; functions that JAX compiles once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import diffrax
import jax
import jax.numpy as jnp

from ..codegen.base import RenderedModule
from ..codegen.cache import digest_of, load_in_memory
from ..codegen.printers import JAX, JAX_STEPS, Printer
from ..codegen.rendering import program_variables, render
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..once import once
from ..version import __version__
from . import functions
from .runs.run_constants import ArrayKernels, Function


def rendered_module(program: Program) -> RenderedModule:
    """Return the module of a program."""
    source = render("jax/module.py.j2", program_variables(program, JAX))
    versions = f"{__version__} {jax.__version__} {diffrax.__version__}"
    return RenderedModule("jax", program, lambda: source, digest_of("jax", versions, source))


def loaded(rendered: RenderedModule) -> Mapping[str, Any]:
    """Return the functions of a rendered module by name; XLA compiles in memory, so that nothing is kept on disk."""
    return load_in_memory(rendered.digest, rendered.source).__dict__


@once
def kernels_of(program: Program) -> ArrayKernels:
    """Return the kernels of a program, rendered and loaded once."""
    return ArrayKernels(program, loaded(rendered_module(program)))


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


class KeyedFunction:
    """Base class of functions that are equal where their keys are, so that what JAX compiled for one serves the other.

    Parameters
    ----------
    *key
        Hashable values, from which the function can be made again unless a class says otherwise.
    """

    def __init__(self, *key: Any) -> None:
        self._key, self._hash = key, hash((type(self).__name__, key))

    def __eq__(self, other: object) -> bool:
        return self is other or (type(self) is type(other) and self._key == getattr(other, "_key", None))

    def __hash__(self) -> int:
        return self._hash

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), self._key
