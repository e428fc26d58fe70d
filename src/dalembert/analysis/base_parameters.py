"""Base parameters: the combinations of inertial parameters that motions determine, by the rank of a regressor.

The columns of a regressor depend on each other (M. Gautier, W. Khalil, IEEE Transactions on Robotics and Automation 6
(1990) 368-373). A QR decomposition with column pivoting shows how many are independent; of these the first are taken,
and the others are their combinations (M. Gautier, Journal of Robotic Systems 8 (1991) 485-506).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from ..arrays import FloatArray
from ..errors import ValueInputError, list_names, nesting_named
from ..frozen import frozen
from ..values import array_of

_DIGITS = 1e-9
"""Factors of combinations from which on they are no rounding."""


@final
@frozen(eq=False)
class BaseParameters:
    """The combinations of parameters that a regressor determines: W @ pi = W[..., columns] @ (matrix @ pi).

    Attributes
    ----------
    names : tuple of str
        The combinations as text, factors rounded to six digits.
    parameters : tuple of str
        Names of pi.
    columns : tuple of int
        Places of the independent columns of W.
    matrix : ndarray (n_b, n_pi)
    undetermined : tuple of str
        Parameters of which W does not depend at all.
    condition : float
        Condition number of the independent columns, each divided by its length.
    """

    names: tuple[str, ...]
    parameters: tuple[str, ...]
    columns: tuple[int, ...]
    matrix: FloatArray
    undetermined: tuple[str, ...]
    condition: float

    def reduce(self, W: Any) -> FloatArray:
        """Return the independent columns (..., n_b) of a regressor (..., n_pi)."""
        return np.asarray(W, dtype=float)[..., list(self.columns)]

    def values(self, pi: Any) -> FloatArray:
        """Return the base parameters (n_b,) of parameters, (n_pi,) or a mapping from their names."""
        given = [pi[name] for name in self.parameters] if hasattr(pi, "keys") else pi
        return self.matrix @ np.asarray(given, dtype=float)

    def __repr__(self) -> str:
        return f"<BaseParameters: {len(self.names)} of {len(self.parameters)}, condition {self.condition:.3g}>"


@nesting_named
def base_parameters(W: Any, names: Sequence[str], *, tolerance: float = 1e-8) -> BaseParameters:
    """Return the combinations of parameters that motions determine.

    Parameters
    ----------
    W : array_like (..., n_pi)
        A regressor at many different states, such as random ones: those of `model.regressor`, stacked. States that
        contradict constraints make more columns independent than there are: take simulated or ideal ones, and use the
        result for measured ones.
    names : sequence of str
        Of its columns.
    tolerance : float
        Part of a column of length one that may be left by the others before it is independent of them.

    Returns
    -------
    BaseParameters

    Raises
    ------
    ValueInputError
        For another number of names, values that are not finite, and a regressor that is zero.

    Examples
    --------
    ::

        values = {"m": 1.0, "l": 0.5, "g": 9.81}
        q, qdot, qddot = np.random.default_rng(0).uniform(-1, 1, (3, 50, 1))  # random states
        W, names = model.regressor(0, q, qdot, qddot, values)
        base = da.base_parameters(W, names)
        for name in base.names:
            print(name)
    """
    rows = stacked(W, names)
    small = triangle_of(rows)
    sizes = np.linalg.norm(small, axis=0)
    used = np.flatnonzero(sizes > tolerance * np.max(sizes, initial=0.0) * 1e-4)
    if not len(used):
        raise ValueInputError("W is zero: nothing moves in these states")
    scaled = small[:, used] / sizes[used]
    chosen = _independent(scaled, tolerance)
    rank = len(chosen)
    matrix = np.zeros((rank, len(names)))
    found = np.linalg.lstsq(scaled[:, chosen], scaled, rcond=None)[0]
    matrix[:, used] = found * sizes[used] / sizes[used[chosen], np.newaxis]
    matrix[:, used] = np.where(np.abs(found) < _DIGITS, 0.0, matrix[:, used])
    matrix[:, used[chosen]] = np.eye(rank)
    values = np.linalg.svd(scaled[:, chosen], compute_uv=False)
    columns = tuple(int(i) for i in used[chosen])
    texts = tuple(_text(row, names, column) for row, column in zip(matrix, columns, strict=True))
    left = tuple(name for i, name in enumerate(names) if i not in set(used.tolist()))
    return BaseParameters(texts, tuple(names), columns, matrix, left, float(values[0] / values[-1]))


def _independent(columns: FloatArray, tolerance: float) -> NDArray[Any]:
    """Return the places of independent columns of length one: the first ones, where they show the rank."""
    _, triangle, order = qr(columns, mode="economic", pivoting=True)
    chosen = np.sort(order[: int(np.sum(np.abs(np.diag(triangle)) > tolerance))])
    first = np.flatnonzero(np.abs(np.diag(_padded(triangle_of(columns)))) > tolerance)
    return first if len(first) == len(chosen) else chosen


def _padded(triangle: FloatArray) -> FloatArray:
    """Return a triangle with as many rows as columns."""
    return np.pad(triangle, ((0, triangle.shape[1] - len(triangle)), (0, 0)))


def triangle_of(rows: FloatArray) -> FloatArray:
    """Return the triangle R of rows = Q R."""
    return np.asarray(np.linalg.qr(rows, mode="r"))


def stacked(W: Any, names: Sequence[str]) -> FloatArray:
    """Return a regressor as rows (k, n_pi).

    Raises
    ------
    ValueInputError
    """
    try:
        array = array_of(W)
    except ValueError as reason:
        raise ValueInputError(f"W {reason}") from None
    if array.ndim < 2 or array.shape[-1] != len(names):
        raise ValueInputError(
            f"W must have shape (..., {len(names)}), a column for each of the {len(names)} names, not {array.shape}"
        )
    if not np.all(np.isfinite(array)):
        raise ValueInputError("W has values that are not finite")
    twice = sorted({name for name in names if list(names).count(name) > 1})
    if twice:
        raise ValueInputError(f"names has {list_names(twice)} more than once")
    return array.reshape(-1, array.shape[-1])


def _text(row: FloatArray, names: Sequence[str], first: int) -> str:
    """Return a combination as text, the parameter of its own column first."""
    text = names[first]
    for place in np.flatnonzero(row).tolist():
        if place != first:
            factor = abs(row[place])
            times = "" if abs(factor - 1.0) < _DIGITS else f"{factor:.6g} "
            text += f" {'-' if row[place] < 0 else '+'} {times}{names[place]}"
    return text
