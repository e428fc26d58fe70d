"""Numbers of a scene that change in time: `Record`, as pieces of cubic polynomials and as it is given to a model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
from scipy.interpolate import CubicSpline
from sympy import Max, Piecewise, symbols
from sympy.physics.mechanics import dynamicsymbols

import dalembert as da
from fuzz.contacts.moreau_jean import Array

__all__ = ["KINDS", "PIECES", "Record"]

KINDS = {"hold": -1, "ramps": 0, "linear": 0, "cubic": 1, "steps": -1}
"""Kinds of records, and how many continuous derivatives they have; -1 where they jump."""
PIECES = 4
"""Pieces of a function of time."""


@final
@dataclass(frozen=True)
class Record:
    """A number over time.

    Attributes
    ----------
    kind : str
        Samples ("hold", "linear", "cubic"), or a function of time: "steps", which jump and rise, or "ramps".
    knots : tuple of float
        Where pieces begin [s].
    values : tuple of float
        At the knots.
    slopes : tuple of float
        Of the pieces of a function of time.
    """

    kind: str
    knots: tuple[float, ...]
    values: tuple[float, ...]
    slopes: tuple[float, ...] = ()

    @property
    def sampled(self) -> bool:
        """Whether it is an input with samples, no function of time."""
        return self.kind in ("hold", "linear", "cubic")

    def pieces(self) -> Array:
        """Return the coefficients (k, 4) of 1, s, s^2, s^3 in each piece, with s the time from its knot."""
        found = np.zeros((len(self.knots), 4))
        found[:, 0] = self.values
        if self.kind == "cubic":
            found[:-1] = CubicSpline(self.knots, self.values).c[::-1].T
        elif self.kind == "linear":
            found[:-1, 1] = np.diff(self.values) / np.diff(self.knots)
        elif not self.sampled:
            found[:, 1] = self.slopes
        return found

    def words(self, place: int, moved: int) -> list[float]:
        """Return what `equations.driven` reads: the place of the number, the contacts that it moves, the pieces."""
        return [float(place), float(moved), float(len(self.knots)), *self.knots, *self.pieces().ravel().tolist()]

    def samples(self) -> Any:
        """Return the samples of an input."""
        return da.samples(self.knots, self.values, self.kind)

    def expression(self, name: str) -> Any:
        """Return the function of time as users write it, with symbols for its numbers."""
        t = dynamicsymbols._t
        knots, values, slopes = (symbols(f"{name}_{letter}:{PIECES}", real=True) for letter in "tvs")
        if self.kind == "ramps":
            bends = (slopes[i] * Max(t - knots[i], 0) for i in range(1, PIECES))
            return values[0] + slopes[0] * t + sum(bends)
        parts = [values[i] + slopes[i] * (t - knots[i]) for i in range(PIECES)]
        return Piecewise(*((parts[i], t < knots[i + 1]) for i in range(PIECES - 1)), (parts[-1], True))

    def parameters(self, name: str) -> dict[str, float]:
        """Return the numbers of `expression`."""
        found = {f"{name}_s{i}": slope for i, slope in enumerate(self.slopes)}
        found |= {f"{name}_t{i}": knot for i, knot in enumerate(self.knots) if i > 0}
        if self.kind == "ramps":
            bends = np.diff(self.slopes, prepend=0.0)
            return (
                found | {f"{name}_s{i}": float(bend) for i, bend in enumerate(bends)} | {f"{name}_v0": self.values[0]}
            )
        return found | {f"{name}_v{i}": value for i, value in enumerate(self.values)} | {f"{name}_t0": self.knots[0]}
