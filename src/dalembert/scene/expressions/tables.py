"""Tables of data as functions in SymPy expressions: `table`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from ...errors import ExpressionError, OptionError, ValueInputError, list_names
from ...ir.surfaces import Surface
from ...ir.tables import Table, registered
from .table_functions import Curve, TableFunction

_KINDS = {"hold": 1, "linear": 2, "cubic": 4}
"""Kinds, with the number of knots that each needs."""

_EXTRAPOLATE = ("error", "hold", "linear")

_MOST_EXPRESSIONS = 64
"""Number of values of a table that may be expressions."""

_SLACK = 1e-12
"""Share of the range by which rounding may lead beyond the knots of a table that has no values there."""


def table(
    x: Any, knots: Any, values: Any, kind: str = "linear", extrapolate: str = "error", *, name: str = "f"
) -> sp.Expr:
    """Return a curve of data as a function of an expression, or a surface of data as a function of two.

    It may stand in loads, potentials, constraints, positions, outputs and events, wherever an expression may.

    Parameters
    ----------
    x : SymPy expression, or a pair of expressions
        Argument of the curve: coordinates, rates, time, parameters. A pair (x, y) gives a surface.
    knots : array_like (n,), or a pair of array_like (n,) and (m,)
        Where the curve is known, increasing, in the units of `x`; for a surface the lines of its grid, as SciPy's
        ``RegularGridInterpolator`` takes them.
    values : array_like (n,) or (n, m)
        The curve or surface there: numbers, and expressions in parameters where the values are to be given to runs,
        swept, or differentiated by (at most 64 of them). The curve is linear in its values: one with expressions is
        the sum of these, each times the table that is 1 at its knot.
    kind : str
        ``"linear"`` interpolates; ``"cubic"`` is the cubic spline that SciPy calls not-a-knot, and needs 4 knots;
        ``"hold"`` keeps the value of the last knot that is not above x. A surface is that along either axis; a cubic
        one is SciPy's ``RectBivariateSpline`` with its defaults.
    extrapolate : str
        Continuation outside of the knots: ``"error"``, where a run ends with the status ``OUTSIDE_TABLE``;
        ``"hold"``, the value at the end; ``"linear"``, the line through the end with the slope there; for a surface
        along either axis.
    name : str
        Name of the curve in messages and the textbook view.

    Returns
    -------
    sympy.Expr
        A function of `x`, which SymPy can differentiate by `x` (of a pair: by both).

    Raises
    ------
    OptionError
        For another kind or extrapolation.
    ValueInputError
        For knots that are not increasing, numbers that are not finite, wrong shapes, too few knots.
    ExpressionError
        Where `x` is neither an expression nor a pair of them.

    Examples
    --------
    A spring, whose force was measured, that turns a body of the frame B back::

        torque = da.table(theta, [-2, -1, 0, 1, 2], [-9, -3, 0, 3, 9], kind="cubic")
        scene.add_loads((B, -torque * N.z))

    The torque of an engine over speed and throttle, the throttle u an input of the scene::

        u = dynamicsymbols("u")
        scene.add_inputs(u)
        engine = da.table((theta.diff(), u), ([0, 200, 400], [0, 1]), [[0, 90], [-10, 140], [-30, 100]])
        scene.add_loads((B, engine * N.z))
    """
    if kind not in _KINDS:
        raise OptionError(f"table {name!r}: unknown kind {kind!r}; known: {list_names(_KINDS)}")
    if extrapolate not in _EXTRAPOLATE:
        raise OptionError(f"table {name!r}: unknown extrapolate {extrapolate!r}; known: {list_names(_EXTRAPOLATE)}")
    if isinstance(x, tuple | list):
        return _surface(x, knots, values, kind, extrapolate, name)
    where, (heights, weighed) = _numbers(knots, "knots", name), _heights(values, name)
    _check(where, heights, kind, name)
    argument = _argument(x, name)

    def curve(label: str, numbers: NDArray[np.float64]) -> sp.Expr:
        return TableFunction(argument, Curve(registered(_table(label, where, numbers, kind, extrapolate))))

    return _weighed(curve, heights, {(i,): weight for i, weight in weighed.items()}, name)


def _surface(x: Sequence[Any], knots: Any, values: Any, kind: str, extrapolate: str, name: str) -> sp.Expr:
    """Return a surface: along either axis it is what a curve of its kind is, and so linear in the values."""
    try:
        lines = list(knots)
    except TypeError:
        lines = []
    if len(x) != 2 or len(lines) != 2:
        raise ValueInputError(
            f"table {name!r}: {len(x)} arguments and {len(lines)} rows of knots; a surface has two of both:"
            " da.table((x, y), (knots_x, knots_y), values), with values[i][j] at knots_x[i] and knots_y[j]"
        )
    arguments = [_argument(each, name) for each in x]
    where = [_numbers(line, f"knots of argument {i}", name) for i, line in enumerate(lines, 1)]
    try:
        given = np.array(values.tolist() if isinstance(values, sp.MatrixBase) else values, dtype=object)
    except ValueError:
        given = np.empty(0)
    if given.shape != (len(where[0]), len(where[1])):
        raise ValueInputError(
            f"table {name!r}: the values have the shape {given.shape}, and the knots are"
            f" {len(where[0])} by {len(where[1])}; give one row of values for each knot of the first argument"
        )
    heights, weighed = _heights(given.ravel(), name)
    parts = [_axis(f"{name} (argument {i})", line, kind, extrapolate, name) for i, line in enumerate(where, 1)]
    axes = parts[0][0], parts[1][0]

    def surface(label: str, numbers: NDArray[np.float64]) -> sp.Expr:
        cells = np.einsum("iap,jbq,pq->ijab", parts[0][1], parts[1][1], numbers, optimize=True)
        return TableFunction(*arguments, Curve(registered(Surface(label, axes, cells))))

    places: dict[tuple[int, ...], sp.Expr] = {divmod(i, given.shape[1]): weight for i, weight in weighed.items()}
    return _weighed(surface, heights.reshape(given.shape), places, name)


def _axis(
    label: str, knots: NDArray[np.float64], kind: str, extrapolate: str, name: str
) -> tuple[Table, NDArray[np.float64]]:
    """Return the pieces of an axis, and the coefficients (m, degree + 1, n) of the curves that are 1 at one knot."""
    _check(knots, knots, kind, name)
    units = [_table(label, knots, unit, kind, extrapolate) for unit in np.eye(len(knots))]
    first, outer = units[0], np.where(np.isnan(units[0].coefficients[:, :1]), np.nan, 0.0)
    axis = Table(label, first.edges, first.origins, outer, first.smoothness, first.first, first.last)
    return registered(axis), np.stack([unit.coefficients for unit in units], axis=-1)


def _argument(x: Any, name: str) -> sp.Expr:
    try:
        argument = None if isinstance(x, str | bytes) else sp.sympify(x)
    except (sp.SympifyError, TypeError, ValueError, AttributeError):
        argument = None
    if not isinstance(argument, sp.Expr):
        raise ExpressionError(f"table {name!r}: {x!r} is not a SymPy expression; give what the curve is a function of")
    return argument


def _weighed(
    curve: Callable[[str, NDArray[np.float64]], sp.Expr],
    heights: NDArray[np.float64],
    weighed: dict[tuple[int, ...], sp.Expr],
    name: str,
) -> sp.Expr:
    """Return a curve whose values are numbers and, at some places, expressions."""
    if not weighed:
        return curve(name, heights)
    parts = []
    for place, weight in weighed.items():
        unit = np.zeros_like(heights)
        unit[place] = 1.0
        parts.append(weight * curve(f"{name}[{', '.join(map(str, place))}]", unit))
    return sp.Add(*parts, *([curve(name, heights)] if np.any(heights) else []))


def _numbers(given: Any, what: str, name: str) -> NDArray[np.float64]:
    try:
        found = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueInputError(f"table {name!r}: the {what} are not numbers; give an array of numbers") from None
    if found.ndim != 1:
        raise ValueInputError(f"table {name!r}: the {what} have the shape {found.shape}; give one row of numbers, (n,)")
    wrong = np.flatnonzero(~np.isfinite(found))
    if len(wrong):
        raise ValueInputError(
            f"table {name!r}: number {wrong[0]} of the {what} is {found[wrong[0]]}; leave out what is not finite"
        )
    return found


def _heights(given: Any, name: str) -> tuple[NDArray[np.float64], dict[int, sp.Expr]]:
    """Return values as numbers, with 0 in place of expressions, and the expressions by their places."""
    listed = list(given) if isinstance(given, Sequence | np.ndarray) and not isinstance(given, str | bytes) else []
    found = {i: value for i, value in enumerate(listed) if isinstance(value, sp.Expr) and not value.is_number}
    if len(found) > _MOST_EXPRESSIONS:
        raise ValueInputError(
            f"table {name!r}: {len(found)} of the values are expressions, and {_MOST_EXPRESSIONS} at most may be, since"
            " each adds to the work of every step: give numbers for the others, or fewer knots"
        )
    return _numbers(
        [0.0 if i in found else value for i, value in enumerate(listed)] if found else given, "values", name
    ), found


def _check(knots: NDArray[np.float64], values: NDArray[np.float64], kind: str, name: str) -> None:
    if len(knots) != len(values):
        raise ValueInputError(f"table {name!r}: {len(knots)} knots and {len(values)} values; give one value a knot")
    if len(knots) < _KINDS[kind]:
        raise ValueInputError(
            f"table {name!r}: {len(knots)} knots; {kind!r} needs {_KINDS[kind]} or more, other kinds need"
            f" {', '.join(f'{n} ({k})' for k, n in _KINDS.items() if k != kind)}"
        )
    wrong = np.flatnonzero(np.diff(knots) <= 0.0)
    if len(wrong):
        i = int(wrong[0])
        raise ValueInputError(
            f"table {name!r}: the knots are not increasing: knot {i} is {float(knots[i])!r} and knot"
            f" {i + 1} is {float(knots[i + 1])!r}; sort them, and keep one value a knot"
        )


def _table(name: str, knots: NDArray[np.float64], values: NDArray[np.float64], kind: str, extrapolate: str) -> Table:
    """Return the piecewise polynomial of a curve: a piece below the knots, those between, a piece above."""
    n, first, last = len(knots), float(knots[0]), float(knots[-1])
    if kind == "hold":
        inner, starts, edges = values.reshape(n, 1), knots, knots
    else:
        inner, starts, edges = _between(knots, values, kind), knots[:-1], knots
    width = max(inner.shape[1], 2 if extrapolate == "linear" and kind != "hold" else 1)
    rows = np.zeros((len(inner) + (1 if kind == "hold" else 2), width))
    origins = np.concatenate([[first], starts, [] if kind == "hold" else [last]])
    rows[1 : 1 + len(inner), : inner.shape[1]] = inner
    rows[0, 0], slopes = values[0], (0.0, 0.0)
    if kind != "hold":
        rows[-1, 0] = values[-1]
        at = inner[-1], last - starts[-1]
        slopes = inner[0, 1], float(np.polynomial.polynomial.polyval(at[1], np.polynomial.polynomial.polyder(at[0])))
    if extrapolate == "linear" and kind != "hold":
        rows[0, 1], rows[-1, 1] = slopes
    if extrapolate == "error":
        slack = _SLACK * (last - first) + 64.0 * np.spacing(max(abs(first), abs(last)))
        if kind == "hold":
            rows, origins = np.vstack([rows, rows[-1:]]), np.append(origins, last)
            edges = np.append(knots, last + slack)
            edges[0] = first - slack
        else:
            edges = knots.copy()
            edges[0], edges[-1] = first - slack, last + slack
        rows[[0, -1]] = np.nan
    return Table(name, edges, origins, rows, _smoothness(kind, extrapolate, values), first, last)


def _between(knots: NDArray[np.float64], values: NDArray[np.float64], kind: str) -> NDArray[np.float64]:
    """Return the coefficients between the knots (n - 1, degree + 1), lowest power first."""
    if kind == "linear":
        return np.column_stack([values[:-1], np.diff(values) / np.diff(knots)])
    from scipy.interpolate import CubicSpline

    return np.ascontiguousarray(CubicSpline(knots, values).c[::-1].T)


def _smoothness(kind: str, extrapolate: str, values: NDArray[np.float64]) -> int:
    if kind == "hold":
        return -1
    if kind == "linear":
        return 0
    return {"error": 2, "linear": 1, "hold": 0}[extrapolate]
