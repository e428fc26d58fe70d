"""Values of the inputs of a run: numbers, or records with knots."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import FloatArray
from ..errors import OptionError, UnknownNameError, ValueInputError, list_names
from ..frozen import frozen
from ..ir.program import DEGREE, WIDTH, KnotSides, Layout, coefficient_places, hidden_parameters
from ..options import RunOptions, SimulateOptions, StepOptions, SweepOptions, tighter
from ..scene.symbol_table import InputSymbol
from ..stops.feedback import Feedback
from ..stops.function_samples import SampledSpan, at_instants, note_of, sampled
from ..stops.input_records import InputRecords
from ..stops.samples import KINDS, Samples, checked_samples, refuse_samples, unknown_input
from ..values import array_of


@final
@frozen(eq=False)
class GivenInputs:
    """Values of all inputs of a scene.

    Attributes
    ----------
    symbols : tuple of InputSymbol
        The inputs.
    values : mapping of str to float, ndarray (n_case,) or Samples
        In the order of the scene.
    shift : ndarray (k,) or (1,)
        Time [s] at which the time of the run, or of each case, is zero.
    cases : ndarray (n,) or None
        Rows of records and shifts that belong to the cases; None where row i is that of case i.
    """

    symbols: tuple[InputSymbol, ...]
    values: Mapping[str, float | FloatArray | Samples]
    shift: FloatArray
    cases: NDArray[np.intp] | None = None

    @property
    def sampled(self) -> bool:
        """Whether any input has knots."""
        return any(isinstance(value, Samples) for value in self.values.values())

    @property
    def note(self) -> str:
        """How many samples there are of inputs that are functions of time, "" without any."""
        return note_of(self.values)

    def counted_from(self, start: Any) -> GivenInputs:
        """Return the same values for runs in the time since a start, or that of each case."""
        return replace(self, shift=self.shift + np.atleast_1d(np.asarray(start, dtype=float)))

    def refuse_span(self, t0: Any, t1: Any) -> None:
        """Reject records that are too short for runs from t0 to t1 (k,), or not smooth enough for where they stand.

        Raises
        ------
        ValueInputError
        """
        first, last = (self.shift + np.asarray(t, dtype=float) for t in (t0, t1))
        fine = np.isfinite(first) & np.isfinite(last)
        if not np.any(fine):
            return
        low = float(np.min(np.where(fine, np.minimum(first, last), np.inf)))
        high = float(np.max(np.where(fine, np.maximum(first, last), -np.inf)))
        for symbol in self.symbols:
            value = self.values[symbol.name]
            if isinstance(value, Samples):
                refuse_samples(symbol, value, low, high)

    def records(self, layout: Layout, sides: KnotSides | None = None) -> InputRecords | None:
        """Return the inputs that have knots, None without any; `sides` is `Program.knot_sides`."""
        named = [(name, value) for name, value in self.values.items() if isinstance(value, Samples)]
        if not named:
            return None
        places = coefficient_places(layout.parameters, tuple(name for name, _ in named))
        rows = None if self.cases is None else np.ascontiguousarray(self.cases, np.int64)
        return InputRecords(tuple(value for _, value in named), places, self.shift, rows, sides)

    def part(self, cases: NDArray[np.intp]) -> GivenInputs:
        """Return the values of some cases."""
        return replace(self, cases=cases if self.cases is None else self.cases[cases])

    def columns(self, t: FloatArray, cases: NDArray[np.intp], after: bool | NDArray[np.bool_]) -> dict[str, FloatArray]:
        """Return the parameters (k,) of the inputs that have knots, by name, at times (k,) of cases (k,)."""
        found: dict[str, FloatArray] = {}
        for name, value in self.values.items():
            if isinstance(value, Samples):
                rows = self._rows(name, t, cases if self.cases is None else self.cases[cases], after=after)
                found |= {hidden: rows[:, i].copy() for i, hidden in enumerate(hidden_parameters(name))}
        return found

    def parameters(self, parameters: Mapping[Any, Any], t: float, *, after: bool = True) -> dict[Any, Any]:
        """Return the parameters of one run with those of the inputs at a time of the run.

        At a knot they are those that follow in time; where not `after`, those before it.
        """
        found = dict(parameters)
        for name in self.values:
            row = self._rows(name, np.array([t]), after=after)[0]
            found |= dict(zip(hidden_parameters(name), row.tolist(), strict=True))
        return found

    def case_parameters(self, parameters: Mapping[Any, Any], starts: FloatArray, ends: FloatArray) -> dict[Any, Any]:
        """Return the parameters of many cases with those of the inputs at the starts (k,) or (1,) of the cases."""
        found = dict(parameters)
        for name, value in self.values.items():
            names = hidden_parameters(name)
            if not isinstance(value, Samples):
                found |= dict.fromkeys(names, 0.0) | {names[1]: value}
                continue
            counts = {len(starts), len(ends), len(self.shift), value.cases or 1} - {1}
            if len(counts) > 1:
                raise ValueInputError(
                    f"input {name!r} has values for {value.cases} cases, and t_span has"
                    f" {max(len(starts), len(ends))}; give one row a case, or one for all"
                )
            count = counts.pop() if counts else 1
            begin, after = np.broadcast_to(starts, count), np.broadcast_to(ends >= starts, count)
            rows = self._rows(name, begin, np.arange(count), after=after)
            found |= {hidden: rows[:, i].copy() for i, hidden in enumerate(names)}
        return found

    def rows(self, t: float, *, after: bool = True) -> FloatArray:
        """Return knot and coefficients (n_u, WIDTH) of all inputs at a time of one run."""
        return np.concatenate([self._rows(name, np.array([t]), after=after) for name in self.values])

    def write(self, layout: Layout, p: FloatArray, t: FloatArray) -> None:
        """Write the parameters of the inputs at times (k,) of one run into parameters or constants (k, n)."""
        for name in self.values:
            place = layout.parameters.index(hidden_parameters(name)[0])
            p[:, place : place + WIDTH] = self._rows(name, t)

    def _rows(
        self,
        name: str,
        t: FloatArray,
        case: NDArray[np.intp] | int = 0,
        *,
        after: bool | NDArray[np.bool_] = True,
    ) -> FloatArray:
        """Return knot and coefficients (k, WIDTH) of an input at times (k,) of one run, or of as many cases."""
        value = self.values[name]
        if isinstance(value, Samples):
            start = self.shift if len(self.shift) == 1 else self.shift[case]
            rows = value.coefficients(value.pieces(t + start, after=after), case)
            rows[:, 0] -= start
            return rows
        rows = np.zeros((len(t), WIDTH))
        rows[:, 1] = value
        return rows


def read_inputs(
    layout: Layout,
    symbols: Sequence[InputSymbol],
    given: Mapping[Any, Any] | None,
    span: SampledSpan | FloatArray | None = None,
    *,
    many: bool = False,
) -> GivenInputs | None:
    """Return the values that a user gave to the inputs of a scene, None for a scene without inputs.

    Parameters
    ----------
    layout : Layout
        Of the scene.
    symbols : sequence of InputSymbol
        Its inputs.
    given : mapping or None
        Names or symbols -> numbers, `Samples` or functions of time.
    span : SampledSpan, ndarray (k,) or None
        Where functions are sampled: along a run, or at times that are all that counts. Without it they are rejected.
    many : bool
        Whether arrays of numbers, and records, one a case, are allowed.

    Raises
    ------
    UnknownNameError
        For missing and unknown names, all of them at once.
    ValueInputError
        For values that are neither finite numbers nor samples, and for functions that samples do not follow.
    OptionError
        For functions where none are sampled, and those of the state.
    """
    if not symbols and not given:
        return None
    table: Any = {} if given is None else given
    if not isinstance(table, Mapping):
        raise ValueInputError(
            f"inputs must be a mapping of names or symbols to numbers, samples or functions of time, not {given!r}"
        )
    names = [each.name for each in symbols]
    values: dict[str, Any] = {}
    unknown, wrong = [], []
    for key, value in table.items():
        name = layout.aliases.get(str(key), str(key))
        if name not in names:
            unknown.append(unknown_input(layout, name, str(key), names))
        elif name in values:
            unknown.append(f"input {name!r} is given twice")
        try:
            values[name] = value if _is_function(value) else _value(name, value, many)
        except ValueInputError as reason:
            wrong.append(str(reason))
    missing = [name for name in names if name not in {layout.aliases.get(str(key), str(key)) for key in table}]
    if missing:
        unknown.append(
            f"missing inputs: {list_names(missing)}. Give each a number, which is constant in time, or a record:"
            f" inputs={{{missing[0]!r}: dalembert.samples(times, values)}}"
        )
    if unknown:
        raise UnknownNameError("\n".join(unknown))
    if wrong:
        raise ValueInputError("; ".join(wrong))
    values = {
        each.name: _of_function(each, value, span) if _is_function(value) else value
        for each, value in ((each, values[each.name]) for each in symbols)
    }
    return GivenInputs(tuple(symbols), values, np.zeros(1))


def run_span(given: Any, starts: Any, ends: Any, options: RunOptions) -> SampledSpan | None:
    """Return where the inputs that are functions are sampled for runs from starts to ends, numbers or (k,).

    None where no given one is. Runs beside others, from which errors are estimated, have the same samples.
    """
    if given is None or not has_functions(given):
        return None
    rtol, atol = options.rtol, options.atol
    if isinstance(options, SimulateOptions) and options.error_estimate:
        rtol, atol = tighter(options).rtol, tighter(options).atol
    if isinstance(options, SweepOptions) and options.error_estimate:
        rtol, atol = tighter(options).rtol, tighter(options).atol
    return SampledSpan.of(starts, ends, rtol, atol, options.max_step if isinstance(options, StepOptions) else np.inf)


def has_functions(given: Any) -> bool:
    """Whether any value of a mapping of inputs is a function of time."""
    return isinstance(given, Mapping) and any(_is_function(value) for value in given.values())


def _value(name: str, value: Any, many: bool) -> float | FloatArray | Samples:
    if isinstance(value, Samples):
        value = checked_samples(name, value)
        if value.cases is not None and not many:
            raise ValueInputError(
                f"input {name!r} has values for {value.cases} cases and this is one run; give values of shape"
                f" ({len(value.t)},), those of a case, or use model.sweep"
            )
        return value
    if isinstance(value, Feedback):
        raise OptionError(
            f"input {name!r} is a function of the state, which traced runs alone take: call it with the solve function"
            ' of model.solve_fn(...), backend="jax"; or make it a da.Controller(function=...), sampled in time'
        )
    try:
        found = np.array(array_of(value))
    except ValueError as reason:
        raise ValueInputError(
            f"input {name!r} = {value!r} {reason}; give a number, or dalembert.samples(times, values, kind) with a kind"
            f" of {list_names(map(repr, KINDS))}"
        ) from None
    if found.ndim == 0:
        if not math.isfinite(float(found)):
            raise ValueInputError(f"input {name!r} = {float(found)!r} is not finite")
        return float(found)
    if not many or found.ndim > 1:
        allowed = "a number, an array with one number a case" if many else "a number"
        raise ValueInputError(
            f"input {name!r} has shape {found.shape}; give {allowed}, or dalembert.samples(times, values) for a"
            " function of time"
        )
    return found


def _is_function(value: Any) -> bool:
    """Whether a value is a function of time."""
    return callable(value) and not isinstance(value, Samples | Feedback)


def _of_function(symbol: InputSymbol, value: Any, span: SampledSpan | FloatArray | None) -> Samples:
    """Return samples of a function of time."""
    if span is None:
        raise OptionError(
            f"input {symbol.name!r} is a function of time, which is not sampled here: give a number, or"
            " dalembert.samples(times, values, kind)"
        )
    return sampled(symbol, value, span) if isinstance(span, SampledSpan) else at_instants(symbol, value, span)


# Inputs about one instant: their values and rates as entries of the parameters.


def input_places(layout: Layout) -> list[int]:
    """Return where among the parameters the value of each input stands; its rate follows, then half its second rate."""
    return [place + 1 for place in coefficient_places(layout.parameters, layout.inputs)]


def expanded_at(layout: Layout, p: FloatArray, t: float) -> FloatArray:
    """Return parameters (n_p,) with inputs that are the same functions of time and have their knots at t.

    Derivatives of inputs by their coefficients are then those by values and rates at t.
    """
    p = p.copy()
    for place in input_places(layout):
        elapsed, found = t - p[place - 1], p[place : place + DEGREE + 1].copy()
        for i in range(DEGREE):
            for k in range(DEGREE - 1, i - 1, -1):
                found[k] += elapsed * found[k + 1]
        p[place - 1 : place - 1 + WIDTH] = np.concatenate([[t], found])
    return p


def held_at(layout: Layout, p: FloatArray, t: float) -> FloatArray:
    """Return parameters (n_p,) with inputs that keep their values at t."""
    p = expanded_at(layout, p, t)
    for place in input_places(layout):
        p[place + 1 : place + DEGREE + 1] = 0.0
    return p
