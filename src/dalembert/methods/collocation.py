"""Radau IIA of order 5 as collocation, with all coefficients derived from its three nodes.

Source: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, sections IV.5 (the method) and IV.8 (the
transformation of the Newton systems, the error estimate).
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray

ORDER, ERROR_ORDER = 5, 3
NODES: FloatArray = np.array([(4.0 - np.sqrt(6.0)) / 10.0, (4.0 + np.sqrt(6.0)) / 10.0, 1.0])
"""Nodes c: zeros of the Radau polynomial; a step ends at its last stage."""

_POWERS = NODES[:, np.newaxis] ** np.arange(1, 4)
INVERSE_POWERS: FloatArray = np.linalg.inv(_POWERS).astype(np.float64)
"""From increments at the nodes to the coefficients of theta, theta^2 and theta^3 of the collocation polynomial."""

_FINE = np.linspace(0.0, 1.0, 2001)
BETWEEN = float(np.max(np.abs(_FINE * np.prod(_FINE - NODES[:, np.newaxis], axis=0))))
"""Largest value of theta (theta - c_1) (theta - c_2) (theta - c_3): what a term of degree four adds in between."""

METHOD: FloatArray = (_POWERS / np.arange(1, 4)) @ np.linalg.inv(NODES[:, np.newaxis] ** np.arange(3))
"""Matrix A: integrals from 0 to each node of the Lagrange polynomials of the nodes."""

REAL = 3.0 + 3.0 ** (2.0 / 3.0) - 3.0 ** (1.0 / 3.0)
COMPLEX = complex(3.0 + (3.0 ** (1.0 / 3.0) - 3.0 ** (2.0 / 3.0)) / 2.0, -(3.0 ** (5.0 / 6.0) + 3.0 ** (7.0 / 6.0)) / 2)
"""Eigenvalues of A^-1, one real and a pair; the pair acts on W_2 + i W_3 as this one of the two."""

ERROR_WEIGHTS: FloatArray = np.linalg.solve(_POWERS.T, [-1.0, 0.0, 0.0]).astype(np.float64)
"""h f(y_0) plus these times the increments vanishes for polynomials up to degree 3: the estimate of order 3."""


END_SLOPES: FloatArray = np.linalg.inv(METHOD)[2]
"""From increments at the nodes to h times the slope of the collocation polynomial at the end."""


def _mode(eigenvalue: complex) -> list[complex]:
    """Return the eigenvector of A^-1, one at the last node: what is normal to two rows of A^-1 - eigenvalue."""
    a, b = (np.linalg.inv(METHOD) - eigenvalue * np.eye(3))[:2].tolist()
    normal = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    return [entry / normal[2] for entry in normal]


_PAIR = np.array(_mode(COMPLEX.conjugate()))
FROM_MODES: FloatArray = np.column_stack([np.real(_mode(REAL)), _PAIR.real, _PAIR.imag])
TO_MODES: FloatArray = np.linalg.inv(FROM_MODES).astype(np.float64)
"""T and T^-1: A^-1 = T diag(REAL, [[a, b], [-b, a]]) T^-1 with COMPLEX = a - i b."""
