"""Inputs about one instant: their values and rates as entries of the parameters."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..ir.input_parameters import DEGREE, WIDTH, coefficient_places
from ..ir.program import Layout

__all__ = ["expanded_at", "held_at", "input_places"]


def input_places(layout: Layout) -> list[int]:
    """Return where among the parameters the value of each input stands; its rate follows, then half its second rate."""
    return [place + 1 for place in coefficient_places(layout.parameters, layout.inputs)]


def expanded_at(layout: Layout, p: FloatArray, t: float) -> FloatArray:
    """Return parameters (n_p,) with inputs that are the same functions of time and have their knots at t.

    Derivatives of inputs by their coefficients are then those by values and rates at t.
    """
    p = p.copy()
    for place in input_places(layout):
        elapsed, found = t - p[place - 1], p[place : place + DEGREE + 1].copy()
        for i in range(DEGREE):
            for k in range(DEGREE - 1, i - 1, -1):
                found[k] += elapsed * found[k + 1]
        p[place - 1 : place - 1 + WIDTH] = np.concatenate([[t], found])
    return p


def held_at(layout: Layout, p: FloatArray, t: float) -> FloatArray:
    """Return parameters (n_p,) with inputs that keep their values at t."""
    p = expanded_at(layout, p, t)
    for place in input_places(layout):
        p[place + 1 : place + DEGREE + 1] = 0.0
    return p
