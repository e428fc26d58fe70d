"""The instruction set that numba compiles for."""

from __future__ import annotations

import numba

from ...errors import OptionError
from ...once import once
from ..llvm.target import target

__all__ = ["configure_numba", "serves_target"]


@once
def configure_numba() -> None:
    """Set the processor of ``DALEMBERT_TARGET`` for numba, unless numba has another setting or has compiled already.

    Raises
    ------
    OptionError
        Where numba's compilation is disabled.
    """
    chosen = target()
    if numba.config.DISABLE_JIT:
        raise OptionError(
            'NUMBA_DISABLE_JIT is set, so that numba compiles nothing: unset it, or take backend="numpy", which is'
            " plain Python"
        )
    if numba.config.CPU_NAME is None and chosen.name != "native":
        numba.config.CPU_NAME, numba.config.CPU_FEATURES = chosen.cpu, chosen.features


def serves_target() -> bool:
    """Return whether numba compiles for the processor of `target`, which is in the names of cached files."""
    _, processor, _ = numba.core.registry.cpu_target.target_context.codegen().magic_tuple()
    return bool(processor == target().cpu)
