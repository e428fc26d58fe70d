"""Columns of a sweep as given: spans, parameters and initial values, one value for all cases or one a case."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import FloatArray
from ..errors import UnknownNameError, ValueInputError, unknown_name
from ..ir.program import Layout
from ..results.cases import CaseSet, case_set
from ..values import array_of, traced_note


def spans_of(t_span: Any) -> tuple[FloatArray, FloatArray]:
    """Return starts and ends, (k,) or (1,), of the cases of a sweep.

    Raises
    ------
    ValueInputError
        For what are no numbers or arrays.
    """
    try:
        first, last = (np.array(array_of(t), ndmin=1, order="C") for t in t_span)
    except (TypeError, ValueError) as error:
        message = f"t_span must be start and end, numbers or arrays, not {t_span!r}{traced_note(error)}"
        raise ValueInputError(message) from None
    return first, last


def columns_of(
    kind: str, given: Mapping[Any, Any], known: tuple[str, ...], aliases: Mapping[str, str]
) -> dict[str, FloatArray]:
    """Return arrays (k,) or (1,) by name; numbers that are not finite are left for the status of their case.

    They are copies: results are evaluated from them later, whatever the caller does with the arrays given.
    """
    if not isinstance(given, Mapping):
        raise ValueInputError(f"{kind}s must be a mapping of names or symbols to numbers or arrays, not {given!r}")
    columns: dict[str, FloatArray] = {}
    unknown, wrong = [], []
    for key, value in given.items():
        name = aliases.get(str(key), str(key))
        if name not in known:
            unknown.append(unknown_name(kind, str(key), known))
            continue
        if name in columns:
            unknown.append(f"{kind} {name!r} is given twice")
        try:
            plain = type(value) is float or type(value) is np.float64
            columns[name] = np.array((value,)) if plain else np.array(array_of(value), ndmin=1, order="C")
        except ValueError as reason:
            wrong.append(f"{name} = {value!r} {reason}")
            continue
        if columns[name].ndim != 1:
            wrong.append(f"{name} has shape {columns[name].shape}; one value a case is needed")
    if unknown:
        raise UnknownNameError("\n".join(unknown))
    if wrong:
        raise ValueInputError("; ".join(wrong))
    return columns


def with_grid(
    layout: Layout, grid: CaseSet, initial: Mapping[Any, Any], parameters: Mapping[Any, Any]
) -> tuple[dict[Any, Any], dict[Any, Any]]:
    """Return initial values and parameters with the columns of a grid, each where it belongs."""
    grid = case_set(grid)
    initial, parameters = dict(initial), dict(parameters)
    for name, column in grid.columns().items():
        home = parameters if name in layout.parameters else initial
        if name not in (*layout.parameters, *layout.initial):
            raise UnknownNameError(unknown_name("axis", name, (*layout.given, *layout.initial)))
        if any(layout.aliases.get(str(key), str(key)) == name for key in home):
            raise ValueInputError(f"{name!r} is an axis of the grid and is given beside it; give it once")
        home[name] = column
    return initial, parameters
