"""Records of inputs: values at knots, and the polynomials between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError, ValueInputError, unknown_name
from ..frozen import frozen
from ..ir.program import WIDTH, Layout
from ..methods.step_constants import SMALLEST_OF_TIME
from ..scene.symbol_table import InputSymbol
from ..values import array_of, traced_note

KINDS = ("hold", "linear", "cubic")
"""Interpolations between the values at the knots."""

EXTRAPOLATE = ("error", "hold", "linear")
"""Rules for values outside of the knots."""

_SMOOTHNESS = {"hold": -1, "linear": 0, "cubic": 2}
"""Number of continuous derivatives of each kind; -1 where values jump."""

_WIDEST, _STEEPEST = 1e100, 1e300
"""Largest distance of knots, and largest coefficient of a polynomial between them."""


@final
@frozen(eq=False)
class Samples:
    """A record of an input, made by `samples`.

    Attributes
    ----------
    t : ndarray (n_t,)
        The knots [s].
    values : ndarray (n_t,) or (n_case, n_t)
    kind : str
        One of `KINDS`.
    extrapolate : str
        One of `EXTRAPOLATE`.
    slopes : ndarray or None
        Derivatives at the knots of the kind "cubic", of the shape of the values.
    checked : bool
        Whether the arrays hold what `samples` requires; else JAX may trace them, and slopes are None.
    function : bool
        Whether they were taken from a function of time that a user gave.
    """

    t: FloatArray
    values: FloatArray
    kind: str
    extrapolate: str
    slopes: FloatArray | None
    checked: bool = True
    function: bool = False

    @property
    def cases(self) -> int | None:
        """For how many cases there are values, None for one row that serves all."""
        return None if self.values.ndim == 1 else len(self.values)

    @property
    def first(self) -> int:
        """Number of the first piece; piece k begins at knot k."""
        return 0 if self.extrapolate == "error" else -1

    @property
    def last(self) -> int:
        """Number of the last piece."""
        return len(self.t) - (2 if self.extrapolate == "error" and self.kind != "hold" and len(self.t) > 1 else 1)

    @property
    def smoothness_inside(self) -> int:
        """How often the values between the first knot and the last have a continuous derivative."""
        return _SMOOTHNESS[self.kind]

    @property
    def smoothness_everywhere(self) -> int:
        """How often the values have a continuous derivative, wherever a run goes."""
        outside = {"error": 2, "hold": 0, "linear": 1}[self.extrapolate]
        return min(self.smoothness_inside, outside)

    def reaches(self, low: float, high: float) -> bool:
        """Whether there are values between two times, up to rounding."""
        near = SMALLEST_OF_TIME * max(abs(low), abs(high))
        return self.extrapolate != "error" or bool(self.t[0] - near <= low and high <= self.t[-1] + near)

    def smoothness(self, low: float, high: float) -> int:
        """Return how often the values between two times have a continuous derivative."""
        outside = self.extrapolate != "error" and (low < self.t[0] or high > self.t[-1])
        return self.smoothness_everywhere if outside else self.smoothness_inside

    def pieces(self, t: FloatArray, *, after: bool | NDArray[np.bool_] = True) -> NDArray[np.intp]:
        """Return the numbers of the pieces (k,) at times (k,): at a knot, that which follows, or that before it."""
        follows = np.searchsorted(self.t, t, side="right") - 1
        if not np.all(after):
            follows = np.where(after, follows, np.searchsorted(self.t, t, side="left") - 1)
        return np.asarray(np.clip(follows, self.first, self.last), dtype=np.intp)

    def coefficients(self, piece: NDArray[np.intp], case: NDArray[np.intp] | int = 0) -> FloatArray:
        """Return knot and coefficients (k, WIDTH) of pieces (k,) for cases (k,)."""
        n, v = len(self.t), self.values if self.values.ndim == 2 else self.values[np.newaxis]
        row = np.broadcast_to(np.asarray(case if self.values.ndim == 2 else 0), piece.shape)
        at = np.clip(piece, 0, n - 1)
        out = np.zeros((len(piece), WIDTH))
        out[:, 0], out[:, 1] = self.t[at], v[row, at]
        if self.kind == "hold" or n == 1:
            return out
        inside = (piece >= 0) & (piece < n - 1)
        left = np.clip(piece, 0, n - 2)
        width = self.t[left + 1] - self.t[left]
        slope = (v[row, left + 1] - v[row, left]) / width
        if self.slopes is None:
            out[:, 2] = slope if self.extrapolate == "linear" else np.where(inside, slope, 0.0)
            return out
        d = self.slopes if self.slopes.ndim == 2 else self.slopes[np.newaxis]
        bend = (d[row, left] + d[row, left + 1] - 2.0 * slope) / width
        out[:, 2] = d[row, at] if self.extrapolate == "linear" else np.where(inside, d[row, at], 0.0)
        out[:, 3] = np.where(inside, (slope - d[row, left]) / width - bend, 0.0)
        out[:, 4] = np.where(inside, bend / width, 0.0)
        return out

    def __repr__(self) -> str:
        of = "" if self.cases is None else f" for {self.cases} cases"
        return f"<samples at {len(self.t)} knots{of}, {self.kind}>"


def samples(t: Any, values: Any, kind: str = "linear", extrapolate: str = "error") -> Samples:
    """Return a record of an input, for ``inputs={u: samples(t, values)}`` of a run.

    Steps end at its knots, so that they cost no accuracy. The arrays are copied once; runs read the copy in place.

    Parameters
    ----------
    t : array_like (n_t,)
        Knots [s], increasing, in the time of the run.
    values : array_like (n_t,) or (n_case, n_t)
        Values at the knots: for all cases, or in sweeps one row a case.
    kind : str
        "hold" keeps the value of the last knot, that of a knot included; "linear" interpolates; "cubic" is SciPy's
        ``CubicSpline`` (not-a-knot), twice differentiable as a prescribed position and a holonomic constraint need it.
    extrapolate : str
        What values are outside of the knots: "error" rejects runs that need some, "hold" keeps the first and the last,
        "linear" continues with the slopes at the ends.

    Inside of ``jax.jit``, ``jax.grad`` and ``jax.vmap``, for the solve functions of models in JAX, both arrays may be
    traced. A record is a pytree there, whose leaves are the two arrays; what is traced is not checked.

    Raises
    ------
    ValueInputError
        For knots that do not increase, numbers that are not finite, and arrays of the wrong shape.
    OptionError
        For a kind or an extrapolation that does not exist.

    Examples
    --------
    A force on the pendulum of `dalembert.Scene` that grows for a second and fades for another::

        u = dynamicsymbols("u")
        scene.add_inputs(u)
        scene.add_loads((P, u * N.x))
        driven, push = da.compile_model(scene), da.samples([0, 1, 2], [0, 5, 0], kind="linear")
        driven.simulate((0, 2), {theta: 0, theta.diff(): 0}, {m: 1, l: 1, g: 9.81}, inputs={u: push})
    """
    choices: tuple[tuple[str, Any, tuple[str, ...]], ...] = (
        ("kind", kind, KINDS),
        ("extrapolate", extrapolate, EXTRAPOLATE),
    )
    for what, name, known in choices:
        if not isinstance(name, str) or name not in known:
            raise OptionError(unknown_name(what, str(name), known))
    knots, table = _array("t", t), _array("values", values)
    if knots.ndim != 1 or not len(knots):
        raise ValueInputError(f"samples: t must have shape (n_t,) with one knot at least, not {knots.shape}")
    if table.ndim not in (1, 2) or table.shape[-1] != len(knots) or not len(table):
        raise ValueInputError(
            f"samples: values must have shape ({len(knots)},), one value a knot, or (n_case, {len(knots)}), one row a"
            f" case, not {table.shape}"
        )
    concrete = all(isinstance(array, np.ndarray) for array in (knots, table))
    if isinstance(knots, np.ndarray) and len(knots) > 1 and not np.all(knots[1:] > knots[:-1]):
        i = int(np.flatnonzero(~(knots[1:] > knots[:-1]))[0])
        raise ValueInputError(
            f"samples: t must increase from knot to knot; t[{i}] = {knots[i]:g} is followed by {knots[i + 1]:g}. Sort"
            " the knots, and keep one value for each time"
        )
    if len(knots) == 1 and kind != "hold":
        raise ValueInputError(f"samples: one knot gives no values of kind {kind!r}; give two at least, or kind='hold'")
    if concrete and kind != "hold":
        _refuse_coefficients(knots, table, kind)
    slopes = _spline_slopes(knots, table) if kind == "cubic" and concrete else None
    return Samples(knots, table, kind, extrapolate, slopes, concrete)


def _refuse_coefficients(t: FloatArray, values: FloatArray, kind: str) -> None:
    """Reject knots and values (n_case, n_t) whose polynomials between the knots have no doubles as coefficients.

    Raises
    ------
    ValueInputError
    """
    degree = 3 if kind == "cubic" else 1
    with np.errstate(over="ignore", divide="ignore"):
        widths = np.diff(t)
        steepest = 8.0 * max(abs(np.max(values)), abs(np.min(values))) / np.min(widths) ** degree
    if np.max(widths) <= _WIDEST and steepest <= _STEEPEST:
        return
    raise ValueInputError(
        f"samples: between knots {np.min(widths):g} to {np.max(widths):g} apart, coefficients of kind {kind!r} leave"
        f" the range of floating-point numbers; the knots must be at most {_WIDEST:g} apart, and the largest value over"
        f" the least distance{' cubed' if degree == 3 else ''} at most {_STEEPEST / 8.0:g}. Choose other units, or"
        " kind='hold'"
    )


def checked_samples(name: str, record: Samples) -> Samples:
    """Return the record of an input as `samples` makes it, for runs that JAX does not trace.

    Raises
    ------
    ValueInputError
        As for `samples`, and for what JAX traces.
    """
    if record.checked:
        return record
    found = samples(record.t, record.values, record.kind, record.extrapolate)
    if not found.checked:
        raise ValueInputError(
            f"the samples of input {name!r} are traced by JAX, and numbers are required here: give them to the solve"
            ' function of model.solve_fn(...), backend="jax"'
        )
    return found


def _array(name: str, given: Any) -> Any:
    """Return a copy of an array of finite numbers; a traced value becomes an array of JAX."""
    try:
        array = np.array(array_of(given), dtype=float, order="C")
    except ValueError as reason:
        if traced_note(reason):
            from ..jax.runs.precision import traced_array

            return traced_array(given)
        raise ValueInputError(f"samples: {name} {reason}") from None
    if not np.all(np.isfinite(array)):
        where = ", ".join(map(str, np.argwhere(~np.isfinite(array))[0]))
        raise ValueInputError(f"samples: every number of {name} must be finite; {name}[{where}] is not")
    array.flags.writeable = False
    return array


def _spline_slopes(t: FloatArray, values: FloatArray) -> FloatArray:
    """Return the derivatives at the knots of the spline with a continuous third derivative at the outermost knots."""
    from scipy.interpolate import CubicSpline

    slopes = np.ascontiguousarray(CubicSpline(t, values, axis=-1)(t, 1))
    slopes.flags.writeable = False
    return slopes


# Checks of the values that runs are given for inputs.


def refuse_samples(symbol: InputSymbol, record: Samples, low: float, high: float) -> None:
    """Reject samples that are too short for a run between two times, or not smooth enough for where the input stands.

    Raises
    ------
    ValueInputError
    """
    name, knots = symbol.name, f"t = {record.t[0]:g} to {record.t[-1]:g}"
    if not record.reaches(low, high):
        raise ValueInputError(
            f"the samples of input {name!r} are too short: their knots go from {knots}, and the run from t = {low:g} to"
            f" {high:g}. Give samples of the whole span, or extrapolate='hold' or 'linear'"
        )
    if record.smoothness(low, high) >= symbol.smoothness:
        return
    refuse_kind(symbol, record)
    raise ValueInputError(
        f"the samples of input {name!r} continue beyond their knots ({knots}) by extrapolate={record.extrapolate!r},"
        f" where their rate jumps, and {symbol.where} depends on them: velocities would jump. Give samples of the"
        " whole span, or extrapolate='linear'"
    )


def refuse_kind(symbol: InputSymbol, record: Samples) -> None:
    """Reject samples of a kind that is not smooth enough for where the input stands.

    Raises
    ------
    ValueInputError
    """
    if record.smoothness_inside >= symbol.smoothness:
        return
    enough = "'cubic'" if symbol.smoothness > 0 else "'linear' or 'cubic'"
    what = "jump" if record.kind == "hold" else "have kinks"
    raise ValueInputError(
        f"the samples of input {symbol.name!r} are of kind {record.kind!r}, which {what}, and {symbol.where} depends on"
        f" them: velocities would jump at every knot. Give them with kind={enough}"
    )


def unknown_input(layout: Layout, name: str, key: str, names: Sequence[str]) -> str:
    """Return the message for a key among the inputs that is not an input."""
    if name in layout.held:
        return f"{key!r} is set by a controller of the scene: leave it out of inputs=, or take the controller out"
    if name in layout.parameters:
        return f"{key!r} is a parameter, which is constant: give its value among the parameters, not the inputs"
    if name in layout.initial:
        return (
            f"{key!r} is determined by the motion, and no input: give its value at the start among the initial values"
        )
    if not names:
        return f"unknown input {key!r}: the scene has no inputs; declare given functions of time with scene.add_inputs"
    return unknown_name("input", key, names)
