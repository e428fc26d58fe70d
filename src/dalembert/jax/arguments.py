"""Arguments of traced functions: arrays, values by name, and records of inputs, checked where they are known."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jax.lax.linalg import tridiagonal_solve

from ..errors import OptionError, UnknownNameError, ValueInputError, list_names, unknown_name
from ..ir.program import WIDTH, Layout, hidden_parameters
from ..once import once
from ..scene.symbol_table import InputSymbol
from ..stops.feedback import Feedback
from ..stops.samples import Samples
from ..values import times_of
from .runs.derivatives import instantiate
from .runs.mesh_axes import stack
from .runs.precision import precision_of


def parameters_of(layout: Layout, p: Any, numbers: Mapping[str, Any], given: Container[str] = ()) -> Any:
    """Return parameters (n_p,) from an array, or from values by name, those of inputs among them.

    Inputs have the `numbers` by name, or are `given` as functions of time, or have numbers among the parameters.
    """
    shown = (*layout.given, *layout.inputs)
    named = _with_inputs(layout, p, numbers, given)
    p = vector("parameter", named, layout.parameters, layout.aliases, layout.defaults, shown)
    for name in layout.inputs:
        if name in numbers or name in given:
            row = jnp.zeros(WIDTH).at[1].set(_number(name, numbers.get(name, 0.0)))
            p = p.at[layout.parameters.index(hidden_parameters(name)[0]) + jnp.arange(WIDTH)].set(row)
    return p


def times(t: Any) -> Any:
    """Return the times as an array, checked where they are known."""
    traced = any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(t))
    times = jnp.atleast_1d(jnp.asarray(t, dtype=float)) if traced else times_of("t", t)
    if times.ndim != 1 or not len(times):
        raise ValueInputError(f"t must be times (n_t,), the first of which is the start, not of shape {times.shape}")
    if traced:
        return times
    steps = np.diff(times)
    if not np.all(np.isfinite(times)) or not (np.all(steps >= 0.0) or np.all(steps <= 0.0)):
        raise ValueInputError(f"t must be finite times in increasing order, or in decreasing order, not {t!r}")
    return jnp.asarray(times)


def _number(name: str, value: Any) -> Any:
    """Return the value of an input that is constant in time."""
    try:
        number = jnp.asarray(value, dtype=float)
    except (TypeError, ValueError):
        number = None
    if number is None or number.ndim:
        raise ValueInputError(
            f"input {name!r} must be a number, dalembert.samples(times, values), or a function of time and state,"
            f" dalembert.feedback(f, theta), not {value!r}"
        )
    return number


def _with_inputs(layout: Layout, values: Any, numbers: Mapping[str, Any], given: Container[str]) -> Any:
    """Return parameters by name with those that stand for inputs, whose values may be among them.

    Raises
    ------
    UnknownNameError
        For inputs without values, and for those that have two.
    OptionError
        For samples and functions, which are no parameters.
    """
    if not isinstance(values, Mapping) or not layout.inputs:
        return values
    table = by_name("parameter", values, layout.aliases)
    elsewhere = [name for name in layout.inputs if name in numbers or name in given]
    twice = [name for name in elsewhere if name in table]
    missing = [name for name in layout.inputs if name not in table and name not in elsewhere]
    if twice:
        raise UnknownNameError(f"given among the parameters and as inputs={{...}}: {list_names(twice)}. Give each once")
    if missing:
        raise UnknownNameError(
            f"missing inputs: {list_names(missing)}. Give each a number or samples: solve(t, initial, p,"
            f" inputs={{{missing[0]!r}: 0.0}})"
        )
    for name in layout.inputs:
        value = table.pop(name, 0.0)
        if isinstance(value, Samples | Feedback) or callable(value):
            what = "samples" if isinstance(value, Samples) else "a function"
            raise OptionError(
                f"input {name!r} has {what}, and parameters are constant in time: give it as solve(t, initial, p,"
                f" inputs={{{name!r}: ...}})"
            )
        knot, constant, *others = hidden_parameters(name)
        table |= {knot: 0.0, constant: value, **dict.fromkeys(others, 0.0)}
    return table


def by_name(kind: str, values: Mapping[Any, Any], aliases: Mapping[str, str]) -> dict[str, Any]:
    """Return values by name from a mapping of names or symbols.

    Raises
    ------
    UnknownNameError
        For a name that is given twice.
    """
    table: dict[str, Any] = {}
    for key, value in values.items():
        name = aliases.get(str(key), str(key))
        if name in table:
            raise UnknownNameError(f"{kind} {name!r} is given twice")
        table[name] = value
    return table


def vector(
    kind: str,
    values: Any,
    names: tuple[str, ...],
    aliases: Mapping[str, str],
    defaults: Mapping[str, float] | None = None,
    shown: tuple[str, ...] | None = None,
) -> Any:
    """Return an array of values by name or symbol, or of an array in their order; some may have defaults.

    The texts of symbols have `aliases`, their names. Messages list the names `shown`.
    """
    if not isinstance(values, Mapping):
        array = jnp.asarray(values, dtype=float)
        if array.shape != (len(names),):
            raise OptionError(f"{kind}s must have shape ({len(names)},), for {list_names(names)}, not {array.shape}")
        return array
    table = {**(defaults or {}), **by_name(kind, values, aliases)}
    wrong = [unknown_name(kind, name, shown or names) for name in table if name not in names]
    missing = [name for name in names if name not in table]
    if missing:
        wrong.append(f"missing {kind}s: {list_names(missing)}")
    if wrong:
        raise UnknownNameError("\n".join(wrong))
    return stack([jnp.asarray(table[name], dtype=float) for name in names]) if names else jnp.zeros(0)


COLUMNS = {"hold": (1, 2), "linear": (0, 3), "cubic": (0, 5)}
"""Begin and stop of the hidden parameters of an input that polynomials of a kind set; the others are zero."""


@once
def register_samples() -> None:
    """Register records of inputs as pytrees, whose leaves are knots and values."""
    jax.tree_util.register_pytree_node(
        Samples,
        lambda record: ((record.t, record.values), (record.kind, record.extrapolate)),
        lambda kinds, arrays: Samples(*arrays, *kinds, None, False),
    )


def knots_of(symbol: InputSymbol, record: Samples) -> Any:
    """Return the knots (n,) of a record; derivatives pass as far as those of the steps are those of the motion.

    Steps end where knots are, and their sizes are not differentiated: a run with a knot moved by d is off by the jump
    of the rates there times d, by that of their first derivative times its square, and so on.
    """
    smooth = record.smoothness_everywhere - (symbol.smoothness + 1)
    orders = 0 if smooth < 0 else 2 if smooth > 0 else 1
    knots = jnp.asarray(record.t, dtype=float)
    return knots if orders == 2 else _moving((symbol.name, record.kind, orders), knots)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _moving(what: tuple[str, str, int], knots: Any) -> Any:
    """Return knots, by which a run is differentiated as often as `what` says, behind a name and a kind."""
    return knots


@partial(_moving.defjvp, symbolic_zeros=True)
def _(what: tuple[str, str, int], values: Any, tangents: Any) -> tuple[Any, Any]:
    name, kind, orders = what
    if isinstance(tangents[0], SymbolicZero):
        return values[0], instantiate(tangents[0])
    if orders == 0:
        raise OptionError(
            f"derivatives by the knots of input {name!r}, samples of kind {kind!r}, are not those of the motion, whose"
            " rates jump at knots: differentiate by the values alone, with the knots as they are, as in"
            f" jax.grad(lambda values: ... da.samples(t, values, {kind!r}) ...), or take a smoother kind"
        )
    return _moving(what, values[0]), _once(what, tangents[0], values[0])


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _once(what: tuple[str, str, int], change: Any, knots: Any) -> Any:
    """Return changes of knots as they are, which do not change with the knots."""
    return change


@partial(_once.defjvp, symbolic_zeros=True)
def _(what: tuple[str, str, int], values: Any, tangents: Any) -> tuple[Any, Any]:
    if not isinstance(tangents[1], SymbolicZero):
        raise OptionError(
            f"second derivatives by the knots of input {what[0]!r}, samples of kind {what[1]!r}, are not those of the"
            " motion, whose rates have kinks at knots: differentiate by the values, or take kind='cubic'"
        )
    return values[0], instantiate(tangents[0])


def polynomials(knots: Any, record: Samples) -> Any:
    """Return the polynomials (n + 1, width) before, between and behind knots, as `Samples.coefficients` has them.

    Of the five numbers of a polynomial they are those of `COLUMNS`.
    """
    n, v = len(knots), jnp.asarray(record.values, dtype=float)
    piece = jnp.clip(jnp.arange(-1, n), record.first, record.last)
    at = jnp.clip(piece, 0, n - 1)
    out = jnp.zeros((n + 1, WIDTH)).at[:, 0].set(knots[at]).at[:, 1].set(v[at])
    columns = slice(*COLUMNS[record.kind])
    if record.kind == "hold" or n == 1:
        return out[:, columns]
    goes_on = record.extrapolate == "linear"
    inside = (piece >= 0) & (piece < n - 1)
    left = jnp.clip(piece, 0, n - 2)
    width = knots[left + 1] - knots[left]
    slope = (v[left + 1] - v[left]) / width
    if record.kind == "linear":
        return out.at[:, 2].set(jnp.where(goes_on | inside, slope, 0.0))[:, columns]
    d = _spline_slopes(knots, v)
    bend = (d[left] + d[left + 1] - 2.0 * slope) / width
    out = out.at[:, 2].set(jnp.where(goes_on | inside, d[at], 0.0))
    out = out.at[:, 3].set(jnp.where(inside, (slope - d[left]) / width - bend, 0.0))
    return out.at[:, 4].set(jnp.where(inside, bend / width, 0.0))[:, columns]


def _spline_slopes(t: Any, v: Any) -> Any:
    """Return the slopes (n,) of the cubic spline whose third derivative is continuous at the outermost inner knots."""
    n, h = len(t), jnp.diff(t)
    slope = jnp.diff(v) / h
    if n == 2:
        return jnp.stack([slope[0], slope[0]])
    if n == 3:  # a parabola
        bend = (slope[1] - slope[0]) / (h[0] + h[1])
        return jnp.stack([slope[0] - bend * h[0], slope[0] + bend * h[0], slope[1] + bend * h[1]])
    first, last = h[0] + h[1], h[-1] + h[-2]
    begin = ((h[0] + 2.0 * first) * h[1] * slope[0] + h[0] ** 2 * slope[1]) / first
    end = (h[-1] ** 2 * slope[-2] + (2.0 * last + h[-1]) * h[-2] * slope[-1]) / last
    inner = 3.0 * (h[1:] * slope[:-1] + h[:-1] * slope[1:])
    one = jnp.ones(1)
    below = jnp.concatenate([0.0 * one, h[1:], last * one])
    main = jnp.concatenate([h[1] * one, 2.0 * (h[:-1] + h[1:]), h[-2] * one])
    above = jnp.concatenate([first * one, h[:-1], 0.0 * one])
    right = jnp.concatenate([begin * one, inner, end * one])
    return tridiagonal_solve(below, main, above, right[:, jnp.newaxis])[:, 0]


def out_of_reach(symbol: InputSymbol, record: Samples, t: Any) -> tuple[Any, Any]:
    """Return whether the knots of a record are in no order, and whether a run along times t goes beyond them.

    Beyond is also where the record continues, but not as smoothly as the input stands.
    """
    knots, t = (jax.lax.stop_gradient(jnp.asarray(value, dtype=float)) for value in (record.t, t))
    lost = ~(jnp.all(knots[1:] > knots[:-1]) & jnp.all(jnp.isfinite(knots)))
    if record.extrapolate != "error" and record.smoothness_everywhere >= symbol.smoothness:
        return lost, jnp.asarray(False)
    low, high = jnp.minimum(t[0], t[-1]), jnp.maximum(t[0], t[-1])
    near = precision_of(knots).smallest_of_time * jnp.maximum(jnp.abs(low), jnp.abs(high))
    return lost, (low < knots[0] - near) | (high > knots[-1] + near)


def with_knots(records: Sequence[Samples], t: Any, breaks: Any, moved: Any) -> tuple[Any, Any]:
    """Return the breaks (n,) of a run along times t (n_t,) with those at the knots of records, and which are moved.

    Breaks are times since t[0], in the order of the run, infinite behind the last.
    """
    still = jax.lax.stop_gradient
    start, end = still(t[0]), still(t[-1])
    direction = jnp.where(end >= start, 1.0, -1.0)
    knots = jnp.concatenate([still(jnp.asarray(record.t, dtype=float)) for record in records])
    # XLA would take seconds to sort many constants while it compiles.
    knots = jax.lax.optimization_barrier(knots)  # type: ignore[no-untyped-call]
    close = precision_of(knots).smallest_of_time * jnp.abs(knots)
    inside = (direction * (knots - start) > close) & (direction * (end - knots) > close)
    times = jnp.where(inside, direction * (knots - start), jnp.inf)
    flags = jnp.zeros(len(times))
    if len(breaks):
        times = jnp.concatenate([direction * breaks, times])
        flags = jnp.concatenate([moved, flags])
    times, flags = _sorted(times, flags)
    # One break for those that rounding does not tell apart; it moves where one of them does.
    close = precision_of(knots).smallest_of_time * jnp.maximum(jnp.abs(start), jnp.abs(end))
    again = jnp.append(False, jnp.diff(times) <= close)
    flags = jnp.maximum(flags, jnp.append(jnp.where(again, flags, 0.0)[1:], 0.0))
    times, flags = _sorted(jnp.where(again, jnp.inf, times), jnp.where(again, 0.0, flags))
    return direction * times, flags


def _sorted(times: Any, flags: Any) -> tuple[Any, Any]:
    first, second = jax.lax.sort((times, flags), num_keys=1)
    return first, second
