"""Sizes of coordinates and rates in any unit, by which residuals, steps and distances are measured.

The rule is that of `dalembert.reduction.start_limits`: the size of an angle, or of a component of a quaternion, is one.
That of other coordinates is the largest of them, and at least the radius of gyration where there are angles; one where
that is no more than rounding leaves. Rates have the sizes of their coordinates times the speed of the whole motion.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..ir.interpret import mass_matrices
from ..ir.program import Program

_ROUNDED, AT_REST, _SLOW = 1e-12, 1e-8, 1e-4
"""Those of `dalembert.reduction.start_limits`."""


def _angles(program: Program) -> NDArray[np.bool_]:
    """Return which coordinates (n_q,) have no unit."""
    layout = program.layout
    return np.array([name in layout.angles for name in layout.coordinates], dtype=np.bool_)


def _radii(program: Program, t: FloatArray, x: FloatArray, c: FloatArray) -> FloatArray:
    """Return radii of gyration (k,) at coordinates and rates x (k, 2 n_q), zero without a mass or an inertia."""
    angles = _angles(program)
    masses = np.diagonal(mass_matrices(program, t, x, c), axis1=1, axis2=2)
    inertia, mass = np.sum(masses[:, angles], axis=1), np.sum(masses[:, ~angles], axis=1)
    with np.errstate(all="ignore"):
        radius = np.sqrt(np.where(inertia > 0.0, inertia, 0.0) / np.where(mass > 0.0, mass, np.inf))
    return np.where(np.isfinite(radius), radius, 0.0)


def gyration_sizes(program: Program, t: FloatArray, x: FloatArray, c: FloatArray) -> FloatArray:
    """Return the sizes of coordinates (n_q,) beside an angle of one, at the first of some x (k, 2 n_q).

    That of lengths is the radius of gyration. It is one where there are only lengths, or only angles: what is
    compared then has one unit.
    """
    angles = _angles(program)
    sizes = np.ones(len(angles))
    if len(t) and np.any(angles) and not np.all(angles):
        where = program, t[:1], x[:1], c if c.ndim == 1 else c[:1]
        radius = float(_radii(*where)[0])
        return np.where(angles, 1.0, radius) if radius > 0.0 else coordinate_sizes(*where)[0]
    return sizes


def distance_sizes(program: Program, t: float, x: FloatArray, c: FloatArray) -> FloatArray:
    """Return the sizes of coordinates (n_q,) for distances from coordinates and rates x (2 n_q,).

    Those of `gyration_sizes`; the largest of all lengths where there are only lengths.
    """
    where = program, np.array([t]), x[np.newaxis], c
    return gyration_sizes(*where) if program.layout.angles else coordinate_sizes(*where)[0]


def coordinate_sizes(program: Program, t: FloatArray, x: FloatArray, c: FloatArray) -> FloatArray:
    """Return the sizes of coordinates (k, n_q) at times t (k,) and coordinates and rates x (k, 2 n_q)."""
    angles = _angles(program)
    sizes = np.ones((len(t), len(angles)))
    if np.all(angles):
        return sizes
    largest = np.max(np.abs(x[:, : len(angles)][:, ~angles]), axis=1)
    if np.any(angles):
        largest = np.fmax(largest, _radii(program, t, x, c))
    sizes[:, ~angles] = np.where(largest > _ROUNDED, largest, 1.0)[:, np.newaxis]
    return sizes


def least_speed(rates: FloatArray, sizes: FloatArray) -> float:
    """Return the least speed that counts, in sizes of coordinates (n_q,) in a unit of time, beside rates (n_q,).

    It is a share of the speed of the whole motion, and of one at rest.
    """
    speed = float(np.sum(np.abs(rates) / sizes))
    return _SLOW * (speed if speed > AT_REST else 1.0)
