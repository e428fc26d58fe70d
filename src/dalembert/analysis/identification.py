"""Identification of base parameters by weighted least squares, with standard errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, final

import numpy as np

from ..arrays import FloatArray
from ..errors import UnknownNameError, ValueInputError, list_names, nesting_named, unknown_name
from ..frozen import frozen
from ..values import array_of
from .base_parameters import BaseParameters, base_parameters, stacked, triangle_of
from .regressor import LOADS


@final
@frozen(eq=False)
class Identification:
    """Base parameters from measurements.

    Attributes
    ----------
    base : BaseParameters
        Which combinations they are.
    values, errors : ndarray (n_b,)
        Estimates and their standard errors.
    covariance : ndarray (n_b, n_b)
    residuals : ndarray (n_u,)
        Root mean square of what is left of each row, in its unit.
    """

    base: BaseParameters
    values: FloatArray
    errors: FloatArray
    covariance: FloatArray
    residuals: FloatArray

    def __repr__(self) -> str:
        pairs = zip(self.base.names, self.values, self.errors, strict=True)
        return "\n".join(f"{value:12.5g} +- {error:8.2g}  {name}" for name, value, error in pairs)


@final
@frozen(eq=False)
class Record:
    """A weighted record: W pi = measured in rows that have noise of size one.

    Attributes
    ----------
    W : ndarray (k, r, n)
    measured : ndarray (k, r)
    names : tuple of str
        Of the columns that are not known.
    sigma : ndarray (r,) or None
        The sizes of the noise, where they are given.
    """

    W: FloatArray
    measured: FloatArray
    names: tuple[str, ...]
    sigma: FloatArray | None

    @classmethod
    def of(cls, W: Any, names: Sequence[str], measured: Any, known: Mapping[str, float] | None, sigma: Any) -> Record:
        """Return a record from what a user gave, without the columns of parameters that are known.

        Raises
        ------
        ValueInputError, UnknownNameError
        """
        rows = stacked(W, names)
        shape = np.shape(W)[:-1] if np.ndim(W) > 2 else (len(rows), 1)
        values = _numbers("measured", measured)
        own = np.shape(W)[:-1]
        if values.shape not in (shape, own):
            raise ValueInputError(f"measured must have the shape {own} of the rows of W, not {values.shape}")
        factors = {**({LOADS: 1.0} if LOADS in names else {}), **(known or {})}
        strange = [unknown_name("parameter", name, names) for name in factors if name not in names]
        if strange:
            raise UnknownNameError("known: " + "\n".join(strange))
        given = np.array([factors.get(name, 0.0) for name in names], dtype=float)
        if not np.all(np.isfinite(given)):
            raise ValueInputError("known has values that are not finite")
        left = [i for i, name in enumerate(names) if name not in factors]
        y = (values.ravel() - rows @ given).reshape(-1, shape[-1])
        table = rows[:, left].reshape(*y.shape, len(left))
        return cls(table, y, tuple(names[i] for i in left), None if sigma is None else _sizes(sigma, shape[-1]))


def _numbers(name: str, given: Any) -> FloatArray:
    try:
        array = array_of(given)
    except ValueError as reason:
        raise ValueInputError(f"{name} {reason}") from None
    if not np.all(np.isfinite(array)):
        raise ValueInputError(f"{name} has values that are not finite")
    return array


def _sizes(sigma: Any, count: int) -> FloatArray:
    array = _numbers("sigma", sigma)
    if array.shape not in ((), (count,)) or not np.all(array > 0.0):
        raise ValueInputError(f"sigma must be a positive number, or one for each of the {count} rows, not {sigma!r}")
    return np.array(np.broadcast_to(array, (count,)))


@nesting_named
def identify(
    W: Any,
    names: Sequence[str],
    measured: Any,
    *,
    base: BaseParameters | None = None,
    known: Mapping[str, float] | None = None,
    sigma: Any = None,
) -> Identification:
    """Return base parameters from measured loads, by weighted least squares.

    Standard errors come from what is left of the samples (of H. White, Econometrica 48 (1980) 817-838, with the rows
    of one sample together: K.-Y. Liang, S. L. Zeger, Biometrika 73 (1986) 13-22). They hold for noise of any size in
    each row and for rows that depend on each other; the noise of different samples must be independent, and that of W
    small, as it is of filtered positions.

    Parameters
    ----------
    W, names
        Regressor (k, n_u, n_pi) at k samples and the names of its columns, from `model.regressor`.
    measured : array_like (k, n_u)
        Loads of its rows: inputs, or generalised forces; zeros where the inputs were given to `model.regressor`.
    base : BaseParameters, optional
        The combinations that are estimated; those of W by default. W with noise may have too many, see
        `base_parameters`.
    known : mapping of str to float, optional
        Parameters that are known. The factor 1 of "loads" is.
    sigma : float or array_like (n_u,), optional
        Standard deviation of the noise of each row. By default that of what is left, from an estimate without weights.

    Returns
    -------
    Identification

    Raises
    ------
    ValueInputError
        For shapes that do not fit, a base of other parameters, and a record that does not determine all of the base.
    UnknownNameError
        For names in `known` that W does not have.

    Examples
    --------
    ::

        p = {"m": 1.0, "l": 0.5, "g": 9.81}
        q, qdot, qddot = np.random.default_rng(0).uniform(-1, 1, (3, 50, 1))
        W, names = model.regressor(0, q, qdot, qddot, p)
        measured = model.inverse_dynamics(0, q, qdot, qddot, p)  # or a record
        print(da.identify(W, names, measured))
    """
    record = Record.of(W, names, measured, known, sigma)
    if base is None:
        base = base_parameters(record.W, record.names)
    elif base.parameters != record.names:
        raise ValueInputError(
            f"base is of other parameters than W: {list_names(base.parameters)}, not {list_names(record.names)}"
        )
    table, y = base.reduce(record.W), record.measured
    sizes = record.sigma
    if sizes is None:
        sizes = noise_sizes(y - table @ _solved(table, y, np.ones(y.shape[1])), table.shape[-1])
    values = _solved(table, y, sizes)
    left = y - table @ values
    covariance = _covariance(table / sizes[:, np.newaxis], left / sizes)
    spread = np.sqrt(np.mean(left**2, axis=0))
    return Identification(base, values, np.sqrt(np.diag(covariance)), covariance, spread)


def noise_sizes(left: FloatArray, unknowns: int) -> FloatArray:
    """Return the size of noise of each row (r,) from what is left (k, r), never zero."""
    free = max(1.0 - unknowns / left.size, 1.0 / left.size)
    sizes = np.sqrt(np.mean(left**2, axis=0) / free)
    least = 1e-12 * np.max(sizes, initial=0.0)
    return np.where(sizes > least, sizes, least if least > 0.0 else 1.0)


def _solved(table: FloatArray, y: FloatArray, sizes: FloatArray) -> FloatArray:
    """Return the least squares of table (k, r, n) and y (k, r) with noise of some sizes (r,).

    Raises
    ------
    ValueInputError
        For a record that does not determine the unknowns.
    """
    rows = (table / sizes[:, np.newaxis]).reshape(-1, table.shape[-1])
    lengths = np.linalg.norm(rows, axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    values, _, rank, _ = np.linalg.lstsq(rows / lengths, (y / sizes).ravel(), rcond=1e-12)
    if rank < rows.shape[1]:
        raise ValueInputError(
            f"the record determines {rank} of {rows.shape[1]} base parameters: it has too few samples, or moves too"
            " little. Give a longer record of a richer motion, or base=None for what it does determine"
        )
    return np.asarray(values / lengths)


def _covariance(table: FloatArray, left: FloatArray) -> FloatArray:
    """Return the covariance of estimates from weighted rows (k, r, n) with residuals (k, r)."""
    samples, n = len(table), table.shape[-1]
    triangle = triangle_of(table.reshape(-1, n))
    slopes = np.linalg.solve(triangle.T, np.einsum("kri,kr->ki", table, left).T)
    count = left.size
    factor = samples / max(samples - 1, 1) * (count - 1) / max(count - n, 1)
    half = np.linalg.solve(triangle, slopes)
    return np.asarray(factor * half @ half.T)
