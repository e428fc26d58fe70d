"""Constraints whose coefficients all vanish at the parameters of a run: what errors that they cause say of them."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..errors import list_names
from ..ir.interpret import interpret_rows
from ..ir.program import Program

__all__ = ["vanished_text"]

_POINTS = 4
"""Random configurations at which the constraint Jacobian is evaluated."""


def vanished_text(program: Program, c: FloatArray) -> str:
    """Return a sentence on the constraints whose rows are zero in every configuration at constants c; "" without any.

    Constants that are not finite count as unknown.
    """
    layout = program.layout
    count, n = len(layout.constraints), len(layout.coordinates)
    if not count:
        return ""
    x = np.random.default_rng(0).uniform(0.4, 1.3, (_POINTS, 2 * n + len(layout.states)))
    with np.errstate(all="ignore"):
        rows = interpret_rows(program.kernel("constraint_jacobian"), np.zeros(_POINTS), x, c)
    zero = np.all(rows.reshape(_POINTS, count, n) == 0.0, axis=(0, 2))
    labels = [label for label, vanished in zip(layout.constraints, zero, strict=True) if vanished]
    if not labels:
        return ""
    constrains, them = (
        ("it constrains", "the constraint") if len(labels) == 1 else ("they constrain", "the constraints")
    )
    return (
        f"All coefficients of {list_names(labels)} vanish at these parameters, so that {constrains}"
        f" nothing. Give the factor that vanishes another value, or remove {them} from the scene"
    )
