"""Physical consistency of inertial parameters, and an identification that keeps it.

The ten parameters of a body are those of a distribution of mass where its pseudo-inertia J = [[S, h], [h^T, m]], with
S = tr(I)/2 - I, is positive definite (P. M. Wensing, S. Kim, J.-J. E. Slotine, IEEE Robotics and Automation Letters 3
(2018) 60-67). J = L U U^T L^T, with L of a first guess and U upper triangular with exponentials on its diagonal, is so
for all values of the ten entries of U (C. Rucker, P. M. Wensing, IEEE Robotics and Automation Letters 7 (2022)
9191-9198).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, final

import numpy as np
from scipy.optimize import least_squares

from ..arrays import FloatArray
from ..errors import UnknownNameError, ValueInputError, list_names, nesting_named
from ..frozen import frozen
from ..mechanics.regressor import TEN
from ..values import option
from .base_parameters import base_parameters, triangle_of
from .identification import Record, identify, noise_sizes

_ORDER = np.array([[4, 5, 6], [5, 7, 8], [6, 8, 9]])
"""Places of the moments of inertia among the ten parameters."""

_UPPER = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (2, 3))
"""Entries of U beside the common factor."""


@final
@frozen(eq=False)
class BodyInertia:
    """Mass, mass centre and inertia of a body from ten parameters.

    Attributes
    ----------
    mass : float
    centre : ndarray (3,)
        From the reference point; not a number for a mass of zero.
    inertia : ndarray (3, 3)
        About the mass centre.
    least : float
        The least second moment of mass about a plane through the mass centre [kg m^2]: half of what the largest
        principal moment lacks to the sum of the others.
    """

    mass: float
    centre: FloatArray
    inertia: FloatArray
    least: float

    @property
    def consistent(self) -> bool:
        """Whether a distribution of mass has these parameters."""
        return self.mass > 0.0 and self.least >= 0.0

    @classmethod
    def of(cls, ten: FloatArray) -> BodyInertia:
        """Return the inertia with ten parameters (10,)."""
        mass, first, about = float(ten[0]), ten[1:4], ten[_ORDER]
        with np.errstate(divide="ignore", invalid="ignore"):
            centre = first / mass
        inertia = about - (first @ centre * np.eye(3) - np.outer(first, centre))
        if not np.all(np.isfinite(inertia)):
            return cls(mass, centre, about, np.nan)
        second = np.trace(inertia) / 2 * np.eye(3) - inertia
        return cls(mass, centre, inertia, float(np.linalg.eigvalsh(second)[0]))


@nesting_named
def body_inertias(values: Mapping[str, float]) -> dict[str, BodyInertia]:
    """Return the inertias of the bodies that have all ten parameters in a mapping, by their names.

    Parameters
    ----------
    values : mapping of str to float
        As `model.inertial_parameters` returns it.

    Examples
    --------
    ::

        values = model.inertial_parameters({"m": 1.0, "l": 0.5, "g": 9.81})
        bad = [name for name, body in da.body_inertias(values).items() if not body.consistent]
    """
    return {name: BodyInertia.of(np.array([values[f"{name}.{what}"] for what in TEN])) for name in _bodies(values)}


def _bodies(names: Iterable[str]) -> list[str]:
    """Return the bodies of which all ten parameters are among some names."""
    known = set(names)
    heads = dict.fromkeys(name.rpartition(".")[0] for name in names)
    return [head for head in heads if all(f"{head}.{what}" in known for what in TEN)]


def _pseudo_inertia(ten: FloatArray) -> FloatArray:
    about = ten[_ORDER]
    out = np.empty((4, 4))
    out[:3, :3] = np.trace(about) / 2 * np.eye(3) - about
    out[:3, 3] = out[3, :3] = ten[1:4]
    out[3, 3] = ten[0]
    return out


def _ten_of(pseudo: FloatArray) -> FloatArray:
    """Return the ten parameters (..., 10) of symmetric matrices (..., 4, 4), in which they are linear."""
    second = pseudo[..., :3, :3]
    about = np.trace(second, axis1=-2, axis2=-1)[..., np.newaxis, np.newaxis] * np.eye(3) - second
    upper = np.triu_indices(3)
    return np.concatenate([pseudo[..., 3, 3:], pseudo[..., :3, 3], about[..., upper[0], upper[1]]], axis=-1)


@final
@frozen(eq=False)
class _Parts:
    """The meaning of the unknowns: ten parameters of bodies with factors L (4, 4), and other positive parameters.

    `bodies` and `others` are places among the parameters.
    """

    bodies: tuple[tuple[tuple[int, ...], FloatArray], ...]
    others: tuple[int, ...]
    start: FloatArray

    def at(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the parameters (n_pi,) at unknowns (n_pi,), and their derivatives (n_pi, n_pi)."""
        values, slopes = self.start.copy(), np.zeros((len(x), len(x)))
        for number, (places, factor) in enumerate(self.bodies):
            own = slice(10 * number, 10 * number + 10)
            whole, *rest = x[own]
            upper, tangents = np.eye(4), np.zeros((10, 4, 4))
            for k, ((i, j), value) in enumerate(zip(_UPPER, rest, strict=True)):
                upper[i, j] = np.exp(value) if i == j else value
                tangents[k + 1, i, j] = upper[i, j] if i == j else 1.0
            upper, tangents = np.exp(whole) * upper, np.exp(whole) * tangents
            tangents[0] = upper
            left = factor @ upper
            half = factor @ tangents @ left.T
            values[list(places)] = _ten_of(left @ left.T)
            slopes[np.ix_(places, range(own.start, own.stop))] = _ten_of(half + half.transpose(0, 2, 1)).T
        first = 10 * len(self.bodies)
        for k, place in enumerate(self.others, first):
            values[place] = self.start[place] * np.exp(x[k])
            slopes[place, k] = values[place]
        return values, slopes


def _parts(names: Sequence[str], start: Mapping[str, float]) -> _Parts:
    """Return the unknowns of parameters with first guesses.

    Raises
    ------
    UnknownNameError, ValueInputError
    """
    missing = [name for name in names if name not in start]
    if missing:
        raise UnknownNameError(f"start has no values of {list_names(missing)}; model.inertial_parameters gives all")
    guess, bodies = np.array([start[name] for name in names], dtype=float), _bodies(names)
    places = {head: tuple(names.index(f"{head}.{what}") for what in TEN) for head in bodies}
    taken = {place for own in places.values() for place in own}
    others = tuple(i for i in range(len(names)) if i not in taken)
    faults = [
        f"{head!r} is no body: its mass is {each.mass:g}, its least second moment {each.least:.3g}"
        for head, each in ((head, BodyInertia.of(guess[list(own)])) for head, own in places.items())
        if not (each.mass > 0.0 and each.least > 0.0)
    ]
    faults += [f"{names[i]} = {guess[i]:g} is not positive" for i in others if not guess[i] > 0.0]
    if faults:
        raise ValueInputError("start: " + "; ".join(faults) + ". Start from consistent values")
    factors = tuple((own, np.asarray(np.linalg.cholesky(_pseudo_inertia(guess[list(own)])))) for own in places.values())
    return _Parts(factors, others, guess)


@nesting_named
def identify_bodies(
    W: Any,
    names: Sequence[str],
    measured: Any,
    start: Mapping[str, float],
    *,
    known: Mapping[str, float] | None = None,
    sigma: Any = None,
    spread: float = 1.0,
) -> dict[str, float]:
    """Return inertial parameters of which all bodies are consistent, from measured loads and a first guess.

    The sum of squares of what is left, in sizes of the noise, and of the unknowns over `spread` is least. The unknowns
    are logarithms of factors and shears of the mass of each body, zero at the guess: what the record does not determine
    stays there. Other parameters, such as coefficients of friction, stay positive.

    Parameters
    ----------
    W, names, measured, known, sigma
        As for `identify`.
    start : mapping of str to float
        The guess, such as ``model.inertial_parameters(p)`` with values of a drawing.
    spread : float
        Standard deviation of the unknowns: 1 stands for a guess that may be wrong by a factor e.

    Returns
    -------
    dict of str to float
        Values of all names.

    Raises
    ------
    ValueInputError
        For a guess that is not consistent, and as `identify`.
    UnknownNameError
        For names without a guess.

    Examples
    --------
    ::

        p = {"m": 1.0, "l": 0.5, "g": 9.81}
        q, qdot, qddot = np.random.default_rng(0).uniform(-1, 1, (3, 50, 1))
        W, names = model.regressor(0, q, qdot, qddot, p)
        measured = model.inverse_dynamics(0, q, qdot, qddot, p)  # or a record
        guess = model.inertial_parameters({**p, "m": 1.3})
        found = da.identify_bodies(W, names, measured, guess)
    """
    record, weight = Record.of(W, names, measured, known, sigma), 1.0 / option("spread", spread)
    if not weight > 0.0:
        raise ValueInputError(f"spread must be positive, not {spread!r}")
    parts = _parts(record.names, start)
    sizes = record.sigma
    if sizes is None:
        base = base_parameters(record.W, record.names)
        left = identify(record.W, record.names, record.measured, base=base).residuals
        sizes = noise_sizes(np.broadcast_to(left, record.measured.shape), len(base.names))
    rows = (record.W / sizes[:, np.newaxis]).reshape(-1, len(record.names))
    joined = np.column_stack([rows, (record.measured / sizes).ravel()])
    small = triangle_of(joined)
    table, y = small[:, :-1], small[:, -1]
    count = len(record.names)

    def left_of(x: FloatArray) -> FloatArray:
        return np.concatenate([table @ parts.at(x)[0] - y, weight * x])

    def slopes_of(x: FloatArray) -> FloatArray:
        return np.vstack([table @ parts.at(x)[1], weight * np.eye(count)])

    found = least_squares(left_of, np.zeros(count), slopes_of, method="trf", xtol=1e-12, ftol=1e-12, gtol=1e-10)
    values = parts.at(found.x)[0]
    fixed = {name: float((known or {}).get(name, 1.0)) for name in names}
    return fixed | dict(zip(record.names, values.tolist(), strict=True))
