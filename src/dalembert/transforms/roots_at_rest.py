"""Roots that vanish in motions from rest, where rates are finite and power series do not exist."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..ir.interpret import interpret_rows
from ..ir.kernel import Assignment
from ..ir.program import Program

__all__ = ["roots_vanish_at_rest"]

_SAMPLES = 4


def roots_vanish_at_rest(program: Program) -> bool:
    """Return whether a root is zero, and all rates are finite, where all speeds are zero or the whole state is.

    Drag in proportion to a speed times a velocity is such a force: its rates at rest have one-sided derivatives only.
    Roots are square roots, and powers with exponents that are not whole.
    """
    roots = [line.target for line in program.kernel("rhs").body if line.op == "sqrt" or _is_root(line)]
    if not roots:
        return False
    rhs, layout = program.kernel("rhs"), program.layout
    random = np.random.default_rng(0)
    t, c = random.uniform(0.5, 1.5, _SAMPLES), random.uniform(0.5, 1.5, (_SAMPLES, layout.constants))
    resting = random.uniform(0.5, 1.5, (_SAMPLES, len(layout.state)))
    resting[:, [name not in layout.coordinates for name in layout.state]] = 0.0
    states = np.vstack([resting, np.zeros_like(resting)])
    kernel = replace(rhs, outputs=(*roots, *rhs.outputs))
    values = interpret_rows(kernel, np.tile(t, 2), states, np.tile(c, (2, 1)))
    found = np.all(np.isfinite(values), axis=1) & np.any(values[:, : len(roots)] == 0.0, axis=1)
    return bool(np.any(np.all(found.reshape(2, _SAMPLES), axis=1)))


def _is_root(line: Assignment) -> bool:
    exponent = line.args[-1]
    return line.op == "pow" and (isinstance(exponent, str) or exponent != round(exponent))
