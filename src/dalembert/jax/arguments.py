"""Arguments of traced functions: arrays, or values by name, checked where they are known."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..errors import OptionError, UnknownNameError, ValueInputError, list_names, unknown_name
from ..ir.program import WIDTH, Layout, hidden_parameters
from ..stops.feedback import Feedback
from ..stops.samples import Samples
from ..values import times_of
from .runs.mesh_axes import stack


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
