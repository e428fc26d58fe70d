"""Registry of backends: [Program] -> [RenderedModule] -> [Engine]."""

from __future__ import annotations

from collections.abc import Callable

from ..errors import OptionError, unknown_name
from .base import Backend, RenderedModule
from .engine import Engine

__all__ = ["BACKENDS", "Backend", "Engine", "RenderedModule", "backend_named"]


def _llvm() -> Backend:
    from .llvm.backend import LLVMBackend

    return LLVMBackend()


def _numba() -> Backend:
    from .numba.backend import NumbaBackend

    return NumbaBackend()


def _numpy() -> Backend:
    from .numpy.backend import NumpyBackend

    return NumpyBackend()


def _jax() -> Backend:
    from ..jax.backend import JaxBackend

    return JaxBackend()


BACKENDS: dict[str, Callable[[], Backend]] = {"llvm": _llvm, "numba": _numba, "jax": _jax, "numpy": _numpy}
"""Every backend by name; each is imported on first use."""


def backend_named(name: object) -> Backend:
    """Return a backend; ``OptionError`` for an unknown name, ``MissingExtraError`` where its package is missing."""
    if not isinstance(name, str) or name not in BACKENDS:
        raise OptionError(unknown_name("backend", str(name), BACKENDS))
    return BACKENDS[name]()
