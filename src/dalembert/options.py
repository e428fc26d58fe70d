"""Options of a compilation and of a simulation, declared once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

__all__ = ["CompileOptions"]


@final
@dataclass(frozen=True)
class CompileOptions:
    """How a scene is compiled; the arguments of `dalembert.compile_model`.

    Attributes
    ----------
    backend : str
        A name in `dalembert.codegen.BACKENDS`.
    formulation : str
        A name in `dalembert.reduction.FORMULATIONS`, or "auto".
    outputs : tuple
        Names or SymPy expressions to record.
    cache : bool
        Whether generated modules and compiled code may be kept on disk.
    """

    backend: str = "numba"
    formulation: str = "auto"
    outputs: tuple[Any, ...] = ()
    cache: bool = True
