"""Sequences of three rotations about axes of coordinates, and their quaternions.

With i, j, k the axes and q_i(a) the quaternion of a rotation by a about i, the product q_i(psi) q_j(theta) q_i(phi) is

    (cos(theta/2) cos(s), cos(theta/2) sin(s), sin(theta/2) cos(d), +-sin(theta/2) sin(d))

along 1, i, j and the third axis, where s and d are half the sum and half the difference of psi and phi, and the sign
is that of the three axes. Three different axes are led back to this by a turn of pi/2 about j.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations, product
from typing import Any, final

import numpy as np
import sympy as sp

from ..frozen import frozen
from .expressions.identity import vanishes

_TRIALS = ((0.37, 0.81, -0.59), (1.93, -0.45, 0.71))


@final
@frozen
class AngleSequence:
    """Rotations by three angles about axes 0, 1 or 2 of the frame that each before has made.

    Attributes
    ----------
    angles : tuple of dynamicsymbols
        In the order of the rotations.
    axes : tuple of int
    signs : tuple of int
        1, or -1 for a rotation about the opposite of the axis.
    """

    angles: tuple[Any, Any, Any]
    axes: tuple[int, int, int]
    signs: tuple[int, int, int]

    @property
    def proper(self) -> bool:
        """Whether the first and last axis are the same; the singularity is then at theta = 0 and pi."""
        return self.axes[0] == self.axes[2]

    def quaternion(self, half: Sequence[tuple[Any, Any]]) -> list[Any]:
        """Return (e0, e1, e2, e3) from the cosines and sines of half the angles, of anything with + and *."""
        total: list[Any] | None = None
        for (cosine, sine), axis, sign in zip(half, self.axes, self.signs, strict=True):
            turn = [cosine, cosine * 0, cosine * 0, cosine * 0]
            turn[1 + axis] = sine * sign
            total = turn if total is None else _times(total, turn)
        assert total is not None
        return total

    def of_quaternion(self, e: Sequence[Any]) -> list[Any]:
        """Return the angles as expressions of a unit quaternion.

        The second lies between 0 and pi, or between -pi/2 and pi/2 for three different axes, times its sign. Where
        the first and the last turn about the same line, both are half of what they are together.
        """
        i, j, _ = self.axes
        k = 3 - i - j
        sense = 1 if (j - i) % 3 == 1 else -1
        if not self.proper:
            e = _times(list(e), [1, *(1 if axis == j else 0 for axis in range(3))])  # the factor 1/sqrt(2) cancels
        a, b, c, d = e[0], e[1 + i], e[1 + j], sense * e[1 + k]
        together, apart = sp.atan2(b, a), sp.atan2(d, c)
        second = 2 * sp.atan2(sp.sqrt(c**2 + d**2), sp.sqrt(a**2 + b**2))
        first, third = together + apart, together - apart
        if not self.proper:
            second, third = second - sp.pi / 2, -sense * third
        return [sign * angle for sign, angle in zip(self.signs, (first, second, third), strict=True)]


def _times(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    return [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]


def recognised(matrix: Any, angles: Sequence[Any]) -> AngleSequence | None:
    """Return the sequence whose matrix, from components on the first frame to those on the last, this is."""
    values = [np.array(matrix.subs(dict(zip(angles, trial, strict=True))), dtype=object) for trial in _TRIALS]
    if any(getattr(x, "free_symbols", set()) for value in values for x in value.ravel()):
        return None
    numbers = [value.astype(float) for value in values]
    for order in permutations(range(3)):
        for axes in product(range(3), repeat=3):
            if axes[0] == axes[1] or axes[1] == axes[2]:
                continue
            for signs in product((1, -1), repeat=3):
                trials = ([trial[place] for place in order] for trial in _TRIALS)
                if all(np.allclose(_numeric(axes, signs, t), m) for t, m in zip(trials, numbers, strict=True)):
                    sequence = AngleSequence(tuple(angles[place] for place in order), axes, signs)  # type: ignore[arg-type]
                    if all(vanishes(entry) for entry in matrix - _symbolic(sequence)):
                        return sequence
    return None


def _numeric(axes: Sequence[int], signs: Sequence[int], angles: Sequence[float]) -> Any:
    total = np.eye(3)
    for axis, sign, angle in zip(axes, signs, angles, strict=True):
        total = _about(axis, np.cos(angle), sign * np.sin(angle), np) @ total
    return total


def _symbolic(sequence: AngleSequence) -> Any:
    total = sp.eye(3)
    for axis, sign, angle in zip(sequence.axes, sequence.signs, sequence.angles, strict=True):
        total = _about(axis, sp.cos(angle), sign * sp.sin(angle), sp) * total
    return total


def _about(axis: int, cosine: Any, sine: Any, kind: Any) -> Any:
    """Return the matrix from components before a rotation about an axis to those after it."""
    rows = [[cosine * 0] * 3 for _ in range(3)]
    j, k = (axis + 1) % 3, (axis + 2) % 3
    rows[axis][axis] = 1
    rows[j][j] = rows[k][k] = cosine
    rows[j][k], rows[k][j] = sine, -sine
    return np.array(rows) if kind is np else sp.Matrix(rows)
