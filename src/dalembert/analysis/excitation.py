"""Motions that excite inertial parameters: the best conditioned of many random Fourier series.

J. Swevers, C. Ganseman, D. B. Tukel, J. De Schutter, H. Van Brussel, IEEE Transactions on Robotics and Automation 13
(1997) 730-740.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, final

import numpy as np

from ..arrays import FloatArray
from ..errors import CapabilityError, OptionError, nesting_named
from ..frozen import frozen
from ..values import option, whole
from .base_parameters import base_parameters

if TYPE_CHECKING:
    from ..model.model import CompiledModel

_GRID = 400
"""Instants at which a motion is held within its limits."""

_AT_ONCE = 20
"""Motions whose regressors are evaluated together."""


@final
@frozen(eq=False)
class FourierMotion:
    """Coordinates as Fourier series of time.

    Attributes
    ----------
    period : float
        [s].
    mean : ndarray (n_q,)
    cosines, sines : ndarray (n_q, h)
    condition : float
        Condition number of the base regressor along it.
    """

    period: float
    mean: FloatArray
    cosines: FloatArray
    sines: FloatArray
    condition: float = np.inf

    def __call__(self, t: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return coordinates, rates and second rates, (n_q,) at a time or (k, n_q) at times (k,)."""
        speeds = 2 * np.pi / self.period * np.arange(1, self.cosines.shape[1] + 1)
        angles = np.multiply.outer(np.asarray(t, dtype=float), speeds)
        c, s = np.cos(angles), np.sin(angles)
        a, b = self.cosines.T, self.sines.T
        q = self.mean + c @ a + s @ b
        return q, (c * speeds) @ b - (s * speeds) @ a, -(c * speeds**2) @ a - (s * speeds**2) @ b


@nesting_named
def design_excitation(
    model: CompiledModel,
    p: Any,
    *,
    limits: Any,
    rates: Any = np.inf,
    period: float = 10.0,
    harmonics: int = 5,
    cases: int = 100,
    samples: int = 100,
    loads: Iterable[Any] = (),
    seed: int = 0,
) -> FourierMotion:
    """Return the best conditioned of many random motions, whose starts and ends are at the same state.

    Each is as large as its limits allow. That of the smallest condition number of the independent columns of the
    regressor, each divided by its length, is returned.

    Parameters
    ----------
    model : CompiledModel
        Without constraints; where there are some, sweep inputs (`model.sweep`) and compare `base_parameters`.
    p : mapping or array_like
        Parameters.
    limits : array_like (n_q, 2) or (2,)
        Least and largest values of the coordinates.
    rates : array_like (n_q,) or float
        Largest rates.
    period : float
        [s].
    harmonics, cases, samples, seed : int
        Terms of the series, number of motions, instants of each, and seed of their coefficients.
    loads : iterable
        As for `model.regressor`.

    Raises
    ------
    OptionError
    CapabilityError
        For models with constraints.

    Examples
    --------
    ::

        motion = da.design_excitation(model, {"m": 1.0, "l": 0.5, "g": 9.81}, limits=(-1.0, 1.0), rates=2.0, cases=20)
    """
    if model.layout.constraints:
        raise CapabilityError(
            f"{model.name!r} has constraints, which a series for every coordinate does not satisfy: give the model"
            " inputs with such series, sweep their coefficients, and compare da.base_parameters(W, names).condition"
        )
    size = len(model.layout.coordinates)
    ends, most = _bounds(limits, rates, size)
    counts = {"harmonics": harmonics, "cases": cases, "samples": samples, "seed": seed}
    harmonics, cases, samples, seed = (whole(name, value) for name, value in counts.items())
    if min(harmonics, cases, samples) < 1 or not option("period", period) > 0.0:
        raise OptionError("period, harmonics, cases and samples must be positive")
    rng = np.random.default_rng(seed)
    motions = [_random_motion(rng, ends, most, float(period), harmonics) for _ in range(cases)]
    t, best = np.arange(samples) * (period / samples), motions[0]
    columns: tuple[int, ...] = ()
    loads = tuple(loads)
    for first in range(0, cases, _AT_ONCE):
        several = motions[first : first + _AT_ONCE]
        states = [np.concatenate(parts) for parts in zip(*(motion(t) for motion in several), strict=True)]
        q, qdot, qddot = states
        W, names = model.regressor(np.tile(t, len(several)), q, qdot, qddot, p, loads=loads)
        columns = columns or base_parameters(W, names).columns
        for motion, rows in zip(several, np.split(W[..., columns], len(several)), strict=True):
            condition = _condition(rows.reshape(-1, len(columns)))
            if condition < best.condition:
                best = FourierMotion(motion.period, motion.mean, motion.cosines, motion.sines, condition)
    return best


def _condition(rows: FloatArray) -> float:
    sizes = np.linalg.norm(rows, axis=0)
    if not np.all(sizes > 0.0):
        return np.inf
    return float(np.linalg.cond(rows / sizes))


def _bounds(limits: Any, rates: Any, size: int) -> tuple[FloatArray, FloatArray]:
    try:
        ends = np.broadcast_to(np.asarray(limits, dtype=float), (size, 2))
        most = np.broadcast_to(np.asarray(rates, dtype=float), (size,))
    except (TypeError, ValueError):
        raise OptionError(
            f"limits must be pairs of numbers, ({size}, 2) or (2,), and rates {size} numbers or one"
        ) from None
    if not (np.all(np.isfinite(ends)) and np.all(ends[:, 0] < ends[:, 1]) and np.all(most > 0.0)):
        raise OptionError("limits must be finite, the lower below the upper, and rates positive")
    return ends, most


def _random_motion(
    rng: np.random.Generator, ends: FloatArray, most: FloatArray, period: float, harmonics: int
) -> FourierMotion:
    """Return a motion of random coefficients that reaches limits of its values or rates."""
    a, b = rng.normal(size=(2, len(ends), harmonics))
    unit = FourierMotion(period, np.zeros(len(ends)), a, b)
    q, qdot, _ = unit(np.arange(_GRID) * (period / _GRID))
    low, high = q.min(axis=0), q.max(axis=0)
    scale = np.minimum((ends[:, 1] - ends[:, 0]) / (high - low), most / np.abs(qdot).max(axis=0))
    room = np.maximum(ends[:, 1] - ends[:, 0] - scale * (high - low), 0.0)
    mean = ends[:, 0] - scale * low + room * rng.uniform(size=len(ends))
    return FourierMotion(period, mean, scale[:, np.newaxis] * a, scale[:, np.newaxis] * b)
