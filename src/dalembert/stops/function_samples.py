"""Samples of inputs that are given as Python functions of time: [function, span] -> [samples of kind "cubic"].

A function is sampled before the run, with one rule on every backend and by every method. Knots are added where the
spline through them is not that function: its error is measured at times between the knots, with the polynomials that
the run reads.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NoReturn, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError, PrecisionWarning, ValueInputError, warn_caller
from ..frozen import frozen
from ..scene.symbol_table import InputSymbol
from ..values import number
from .samples import Samples, samples

_SHARE = 0.1
"""Largest error of samples between knots, as a share of the relative tolerance of the run."""

_ROUNDING = 1e-14
"""Least relative error that is required: functions and polynomials are rounded."""

_LEAST, _PROBES, _MOST = 8, 1024, 1 << 18
"""Least number of intervals, and most parts of one; least number of times to look at; largest number of knots."""

_GOLDEN = 0.6180339887498949
"""Fraction whose multiples, modulo 1, are spread evenly: no period of a function fits times placed by it."""

_CHECKS = (0.5, 0.21, 0.77)
"""Where the error of a new interval is measured."""

_MARGIN = 4.0
"""Factor by which errors are to be less than allowed after intervals are divided, for those that come from others."""

_STEEPEST = 8.0
"""Largest slope of x^2 (1 - x)^2 on [0, 1], the error of a spline, as a share of its largest value, and a reserve."""

_ALIKE = 0.9, 2.5
"""Widths of neighbours that are divided with an interval, as shares of its width."""

_ROUGHEST = 1e-6
"""Largest error of the rates of samples, as a share of the largest rate, that is put down to rounded values."""

_NARROW = 64.0 * np.finfo(float).eps
"""Width of an interval, as a share of the latest time, that is not divided further."""

_REMEDY = (
    "Give it as dalembert.samples(times, values, kind), of kind 'hold' or 'linear' with a knot at each jump, or write"
    " it into the scene as an expression of time (Piecewise, Heaviside, sign), at whose breaks steps end"
)


@final
@frozen
class SampledSpan:
    """The times for which functions are sampled, and how well.

    Attributes
    ----------
    low, high : float
        The times [s], not decreasing.
    rtol : float
        Relative tolerance of the run; the absolute one where that is zero.
    max_step : float
        Largest distance of times that are looked at [s].
    """

    low: float
    high: float
    rtol: float
    max_step: float = np.inf

    @classmethod
    def of(cls, starts: Any, ends: Any, rtol: float, atol: float, max_step: float = np.inf) -> SampledSpan | None:
        """Return what runs from starts to ends, numbers or (k,), need; None where no time is finite."""
        times = np.concatenate([np.ravel(starts), np.ravel(ends)]).astype(float)
        times = times[np.isfinite(times)]
        if not len(times):
            return None
        return cls(float(times.min()), float(times.max()), rtol if rtol > 0.0 else atol, max_step)


def sampled(symbol: InputSymbol, function: Callable[[float], Any], span: SampledSpan) -> Samples:
    """Return samples of a function of time that follow it within a share of the tolerance of a run.

    The error between knots is at most 0.1 `rtol` times the largest value that was met; where velocities follow the
    input, that of its slope at most 0.1 `rtol` times the largest slope. What happens between the times that are looked
    at, 1024 at least and one in every `max_step`, is not seen.

    Parameters
    ----------
    symbol : InputSymbol
        The input.
    function : callable
        t -> the value of the input, a number.
    span : SampledSpan

    Raises
    ------
    ValueInputError
        For values that are no finite numbers, errors of the function, and functions that samples do not follow.
    OptionError
        For functions that are not called with a time alone.
    """
    if span.low == span.high:
        return at_instants(symbol, function, np.array([span.low]))
    value = _Values(symbol.name, function)
    count = _PROBES if not span.max_step > 0.0 else max(_PROBES, min(_MOST, (span.high - span.low) / span.max_step))
    numbers = np.arange(int(np.ceil(count)))
    looked = span.low + (numbers + (numbers + 1) * _GOLDEN % 1.0) / len(numbers) * (span.high - span.low)
    knots = np.linspace(span.low, span.high, _LEAST + 1)
    times, values = looked, value.at(looked)
    at_knots, new, reach = value.at(knots), _between(knots, np.arange(len(knots) - 1)), 1
    while True:
        times, values = np.concatenate([times, new]), np.concatenate([values, value.at(new)])
        record = samples(knots, at_knots, kind="cubic")
        errors, allowed, place = _errors(symbol, record, times, values, span.rtol)
        if np.all(errors <= allowed):
            _warn_of_rounding(symbol, record, allowed / np.diff(knots)[place] ** (symbol.smoothness >= 0), span.rtol)
            return replace(record, function=True)
        parts = _parts(symbol, knots, errors / allowed, place, reach)
        reach *= 2
        narrow = (parts > 1) & (np.diff(knots) <= _NARROW * np.max(np.abs(knots)))
        if np.any(narrow) or np.sum(parts) >= _MOST:
            worst = int(np.argmax(np.where(narrow[place] if np.any(narrow) else True, errors, -np.inf)))
            faults = float(times[worst]), float(errors[worst]), float(allowed[worst]), len(knots)
            _refuse(symbol, *faults, narrow=bool(np.any(narrow)))
        knots, first, added = _divided(knots, parts)
        at_knots = np.insert(at_knots, first, value.at(added))
        changed = np.flatnonzero(np.repeat(parts > 1, parts))
        new = _between(knots, changed)


def _parts(
    symbol: InputSymbol, knots: FloatArray, errors: FloatArray, place: NDArray[np.intp], reach: int
) -> NDArray[np.intp]:
    """Return into how many parts intervals are divided; errors (k,), at these places, are shares of the allowed.

    So many neighbours as `reach` on either side that are about as wide are divided too: the error of a spline spreads.
    """
    width, worst = np.diff(knots), np.zeros(len(knots) - 1)
    np.maximum.at(worst, place, errors)
    order = 3 if symbol.smoothness >= 0 else 4
    parts = np.where(worst > 1.0, np.clip(np.ceil((_MARGIN * worst) ** (1.0 / order)), 2, _LEAST), 1).astype(np.intp)
    for i in np.flatnonzero(worst > 1.0):
        around = slice(max(i - reach, 0), i + reach + 1)
        alike = (width[around] > _ALIKE[0] * width[i]) & (width[around] < _ALIKE[1] * width[i])
        parts[around] = np.where(alike, np.maximum(parts[around], 2), parts[around])
    return parts


def _divided(knots: FloatArray, parts: NDArray[np.intp]) -> tuple[FloatArray, NDArray[np.intp], FloatArray]:
    """Return knots of intervals divided into parts (k,), and the new ones (n,), each behind its place before."""
    interval = np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(interval)) - np.repeat(np.cumsum(parts) - parts, parts)
    inside = number > 0
    share = number[inside] / parts[interval[inside]]
    first = interval[inside] + 1
    added = knots[first - 1] + share * (knots[first] - knots[first - 1])
    return np.insert(knots, first, added), first, added


def at_instants(symbol: InputSymbol, function: Callable[[float], Any], t: FloatArray) -> Samples:
    """Return the values of a function at some times (k,), for what is computed at these times alone.

    Raises
    ------
    ValueInputError
        As for `sampled`, and where the rate of the input is needed, too.
    """
    if symbol.smoothness >= 0:
        raise ValueInputError(
            f"input {symbol.name!r} is a function, and {symbol.where} depends on it: at one time its rates are needed,"
            " too. Give dalembert.samples(times, values, 'cubic') of times around it"
        )
    times = np.unique(t[np.isfinite(t)])
    times = times if len(times) else np.zeros(1)
    return replace(samples(times, _Values(symbol.name, function).at(times), "hold", "hold"), function=True)


def _between(knots: FloatArray, intervals: NDArray[np.intp]) -> FloatArray:
    """Return times at which the errors of some intervals are measured, (n,)."""
    begin, end = knots[intervals], knots[intervals + 1]
    return np.concatenate([begin + share * (end - begin) for share in _CHECKS])


def _errors(
    symbol: InputSymbol, record: Samples, t: FloatArray, values: FloatArray, rtol: float
) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
    """Return errors of samples at times (k,), the largest that are allowed, and the intervals of the times."""
    place = record.pieces(t)
    knot, *c = record.coefficients(place).T
    h, width = t - knot, np.diff(record.t)[place]
    assert record.slopes is not None
    size = max(np.max(np.abs(values)), np.max(np.abs(record.values)))
    steepest, relative = np.max(np.abs(record.slopes)), max(_SHARE * rtol, _ROUNDING)
    slope = np.abs(c[1] + h * (2.0 * c[2] + h * 3.0 * c[3]))
    allowed = np.full(len(t), relative * size)
    rounding = np.finfo(float).eps * (8.0 * size + 2.0 * np.abs(t) * slope)
    if symbol.smoothness >= 0:  # rates are needed
        slopes = steepest * width / _STEEPEST
        allowed, rounding = np.minimum(allowed, relative * slopes), np.minimum(rounding, _ROUGHEST * slopes)
    errors = np.abs(c[0] + h * (c[1] + h * (c[2] + h * c[3])) - values)
    return errors, allowed + rounding, place


def _warn_of_rounding(symbol: InputSymbol, record: Samples, allowed: FloatArray, rtol: float) -> None:
    """Warn where rounding leaves samples, or the rates that are needed of them, less accurate than the tolerance.

    The errors `allowed` are those between the knots (k,), the largest of each interval.
    """
    assert record.slopes is not None
    what, size, errors = f"input {symbol.name!r}", np.max(np.abs(record.values)), allowed
    if symbol.smoothness >= 0:
        what, size, errors = f"the rate of {what}", np.max(np.abs(record.slopes)), _STEEPEST * allowed
    share = float(np.max(errors)) / size if size else 0.0
    if share > max(2.0 * rtol, _ROUNDING):
        warn_caller(
            f"{what} is known to {share:.1g} of its largest value, because it is that of samples of a function, whose"
            f" times and values are rounded. Loosen rtol to {share:.0e}, or write the function into the scene as an"
            " expression of time",
            PrecisionWarning,
        )


def _refuse(symbol: InputSymbol, t: float, error: float, allowed: float, count: int, *, narrow: bool) -> NoReturn:
    """Reject a function that samples do not follow.

    Raises
    ------
    ValueInputError
    """
    slope = ", or its slope does" if symbol.smoothness >= 0 else ", or is too steep"
    why = (
        f"it jumps there{slope}" if narrow else f"more than {_MOST} are not taken: it is noise, or oscillates too fast"
    )
    raise ValueInputError(
        f"the function of input {symbol.name!r} is not followed by samples: at t = {t:.15g} they are off by"
        f" {error:.3g}, with {count} of them, and {allowed:.1g} is allowed by rtol; {why}. {_REMEDY}"
    )


class _Values:
    """A user's function, whose values are checked."""

    def __init__(self, name: str, function: Callable[[float], Any]) -> None:
        self._name, self._function = name, function
        try:
            inspect.signature(function).bind(0.0)
        except TypeError as reason:
            raise OptionError(
                f"the function of input {name!r} is called as f(t), with the time alone, and does not take that:"
                f" {reason}. A function of time and state is a da.Controller(function=...), sampled in time, or an"
                ' input of the solve function of model.solve_fn(...), backend="jax"'
            ) from None
        except ValueError:  # a builtin, whose arguments are not known
            pass

    def at(self, times: FloatArray) -> FloatArray:
        """Return the values (k,) at times (k,).

        Raises
        ------
        ValueInputError
            Where the function raises an error, or returns what is no finite number.
        """
        found = np.empty(len(times))
        for i, t in enumerate(times.tolist()):
            try:
                given = self._function(t)
            except Exception as error:
                raise ValueInputError(
                    f"the function of input {self._name!r} raised {type(error).__name__} at t = {t!r}: {error}. It is"
                    " called as f(t), with a time of the run, and returns a number"
                ) from error
            try:
                found[i] = number(given)
            except ValueError as reason:
                raise ValueInputError(
                    f"the function of input {self._name!r} returned {given!r} at t = {t!r}, which {reason}; it must"
                    " return a number"
                ) from None
            if not np.isfinite(found[i]):
                raise ValueInputError(
                    f"the function of input {self._name!r} returned {given!r} at t = {t!r}, which is not finite"
                )
        return found


def note_of(values: Mapping[str, Any]) -> str:
    """Return at how many times the inputs that are functions were sampled, "" without any."""
    records = {name: value for name, value in values.items() if isinstance(value, Samples) and value.function}
    return "; ".join(
        f"input {name!r} is a function, sampled at {len(record.t)} times" for name, record in records.items()
    )
