"""Double precision for what runs inside, without touching the user's JAX configuration."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import jax

__all__ = ["double_precision"]


def double_precision() -> contextlib.AbstractContextManager[Any]:
    """Trace and run in 64 bits, in this thread only; JAX keys what it compiled by this setting.

    NaN is a status of ours, so that a user's ``jax_debug_nans`` does not apply inside.
    """
    if not jax.config.jax_debug_nans:  # type: ignore[attr-defined]
        return jax.enable_x64(True)
    return _without_debugging()


@contextlib.contextmanager
def _without_debugging() -> Iterator[None]:
    with jax.enable_x64(True), jax.debug_nans(False):
        yield
