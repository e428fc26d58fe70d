"""Tables of data as functions in SymPy expressions: `table`."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import Any, ClassVar, final

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from ..errors import ExpressionError, OptionError, ValueInputError, list_names
from ..ir.tables import Table, registered, value
from ..ir.tables import array_value as array_value

TABLE = "table_value"
"""Name of `dalembert.ir.tables.array_value` in generated text."""

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
    """Return a curve of data as a function of an expression.

    It may stand in loads, potentials, constraints, positions, outputs and events, wherever an expression may.

    Parameters
    ----------
    x : SymPy expression
        Argument of the curve: coordinates, rates, time, parameters.
    knots : array_like (n,)
        Where the curve is known, increasing, in the units of `x`.
    values : array_like (n,)
        The curve there: numbers, and expressions in parameters where the values are to be given to runs, swept, or
        differentiated by (at most 64 of them). The curve is linear in its values: one with expressions is the sum of
        these, each times the table that is 1 at its knot.
    kind : str
        ``"linear"`` interpolates; ``"cubic"`` is the cubic spline that SciPy calls not-a-knot, and needs 4 knots;
        ``"hold"`` keeps the value of the last knot that is not above x.
    extrapolate : str
        Continuation outside of the knots: ``"error"``, where a run ends with the status ``OUTSIDE_TABLE``;
        ``"hold"``, the value at the end; ``"linear"``, the line through the end with the slope there.
    name : str
        Name of the curve in messages and the textbook view.

    Returns
    -------
    sympy.Expr
        A function of `x`, which SymPy can differentiate by `x`.

    Raises
    ------
    OptionError
        For another kind or extrapolation.
    ValueInputError
        For knots that are not increasing, numbers that are not finite, wrong shapes, too few knots.
    ExpressionError
        Where `x` is not an expression.

    Examples
    --------
    A spring, whose force was measured, that turns a body of the frame B back::

        torque = da.table(theta, [-2, -1, 0, 1, 2], [-9, -3, 0, 3, 9], kind="cubic")
        scene.add_loads((B, -torque * N.z))
    """
    if kind not in _KINDS:
        raise OptionError(f"table {name!r}: unknown kind {kind!r}; known: {list_names(_KINDS)}")
    if extrapolate not in _EXTRAPOLATE:
        raise OptionError(f"table {name!r}: unknown extrapolate {extrapolate!r}; known: {list_names(_EXTRAPOLATE)}")
    where, (heights, weighed) = _numbers(knots, "knots", name), _heights(values, name)
    _check(where, heights, kind, name)
    try:
        argument = None if isinstance(x, str | bytes) else sp.sympify(x)
    except (sp.SympifyError, TypeError, ValueError, AttributeError):
        argument = None
    if not isinstance(argument, sp.Expr):
        raise ExpressionError(f"table {name!r}: {x!r} is not a SymPy expression; give what the curve is a function of")

    def curve(label: str, numbers: NDArray[np.float64]) -> sp.Expr:
        return TableFunction(argument, Curve(registered(_table(label, where, numbers, kind, extrapolate))))

    if not weighed:
        return curve(name, heights)
    units = np.eye(len(where))
    parts = [weight * curve(f"{name}[{i}]", units[i]) for i, weight in weighed.items()]
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


@final
class Curve(sp.AtomicExpr):  # type: ignore[misc]
    """The numbers of a table in a SymPy expression, with the order of the derivative that is meant."""

    is_commutative: ClassVar[bool] = True
    is_real: ClassVar[bool] = True
    __slots__ = ("order", "table")
    order: int
    table: Table

    def __new__(cls, table: Table, order: int = 0) -> Curve:
        """Return the derivative of an order of a table."""
        made: Curve = sp.AtomicExpr.__new__(cls)
        made.table, made.order = registered(table), order
        return made

    def _hashable_content(self) -> tuple[Any, ...]:
        return (self.table.name, self.table.key, self.order)

    def __getnewargs__(self) -> tuple[Any, ...]:
        return (self.table, self.order)

    def __getstate__(self) -> None:
        return None

    @property
    def derivative(self) -> Curve | None:
        """The derivative, None where it is zero between the knots."""
        return None if self.order >= self.table.degree else Curve(self.table, self.order + 1)

    def sort_key(self, order: Any = None) -> Any:
        """Return the sort key for SymPy."""
        return (
            self.class_key(),
            (1, (f"{self.table.name} {self.order} {self.table.key}",)),
            sp.S.One.sort_key(),
            sp.S.One,
        )

    def _sympystr(self, printer: Any) -> str:
        return self.table.name + "'" * self.order

    def _latex(self, printer: Any) -> str:
        return sp.latex(sp.Symbol(self.table.name)) + "'" * self.order


@final
class TableFunction(sp.Function):  # type: ignore[misc]
    """A table, or a derivative of it, of an expression; its second argument is the `Curve`."""

    nargs = 2
    is_real: ClassVar[bool] = True

    @property
    def curve(self) -> Curve:
        """The numbers."""
        found: Curve = self.args[1]
        return found

    def fdiff(self, argindex: int = 1) -> Any:
        """Return the derivative by the argument."""
        slope = self.curve.derivative if argindex == 1 else None
        return sp.S.Zero if slope is None else TableFunction(self.args[0], slope)

    def _eval_evalf(self, prec: int) -> Any:
        x = self.args[0].evalf()
        if not x.is_Float and not x.is_Integer:
            return None
        return sp.Float(value(float(x), self.curve.table.key, self.curve.order))

    def call(self, x: str) -> str:
        """Return the text of a call of `TABLE`, with the text of the argument."""
        return f"{TABLE}({x}, {self.curve.table.key}, {self.curve.order})"

    def _numpycode(self, printer: Any) -> str:
        return self.call(printer._print(self.args[0]))

    def _sympystr(self, printer: Any) -> str:
        return f"{printer._print(self.args[1])}({printer._print(self.args[0])})"

    def _latex(self, printer: Any, exp: str | None = None) -> str:
        name = self.curve._latex(printer) + ("" if exp is None else f"^{{{exp}}}")
        return rf"{name}{{\left({printer._print(self.args[0])} \right)}}"


def outside(node_value: float, table: Table) -> bool:
    """Return whether a table has no value at x."""
    place = bisect_right(table.edges.tolist(), node_value)
    return table.bounded and place in (0, len(table.edges))
