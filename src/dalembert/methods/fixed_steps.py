"""Explicit Runge-Kutta methods of steps of fixed size, and how often a step corrects its state onto the constraints."""

from __future__ import annotations

from typing import NamedTuple

from .step_constants import LINEAR_CORRECTIONS


class FixedTableau(NamedTuple):
    """A method without error estimate.

    Attributes
    ----------
    rows : tuple of tuple of float
        Weights of earlier slopes in each stage.
    weights : tuple of float
        Weights of the slopes in the step.
    nodes : tuple of float
        Times of the stages, in steps.
    """

    rows: tuple[tuple[float, ...], ...]
    weights: tuple[float, ...]
    nodes: tuple[float, ...]


CLASSICAL = FixedTableau(
    ((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)),
    (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0),
    (0.0, 0.5, 0.5, 1.0),
)
"""The classic method of order 4 (W. Kutta, Zeitschrift fuer Mathematik und Physik 46 (1901) 435-453)."""

EULER = FixedTableau(((),), (1.0,), (0.0,))
"""Order 1."""

CORRECTIONS = {"project_position": 3, "project_velocity": LINEAR_CORRECTIONS}
"""Number of times that each correction is applied, always, where a step does not count them: from the end of a step the
first one leaves the square of the step's error, and the last removes rounding."""
