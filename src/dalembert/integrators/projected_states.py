"""Interpolated states projected onto the constraints."""

from __future__ import annotations

from ..arrays import FloatArray
from ..ir.interpret import interpret_rows
from ..ir.program import Program
from .segments import Constants, constants_at

__all__ = ["projected"]


def projected(program: Program, c: Constants, t: FloatArray, y: FloatArray) -> FloatArray:
    """Return interpolated states (k, n_y) at times t (k,) on the constraints, where the formulation projects."""
    c = constants_at(c, t)
    for kernel in ("project_position", "project_velocity"):
        if kernel in program:
            for _ in range(2):
                y = y + interpret_rows(program.kernel(kernel), t, y, c)
    return y
