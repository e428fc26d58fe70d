"""Double precision for what runs inside, without touching the user's JAX configuration."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import jax

__all__ = ["double_precision"]


@contextlib.contextmanager
def double_precision() -> Iterator[None]:
    """Trace and run in 64 bits, in this thread only; JAX keys what it compiled by this setting.

    NaN is a status of ours, so that a user's ``jax_debug_nans`` does not apply inside.
    """
    with jax.enable_x64(True), jax.debug_nans(False):
        yield
