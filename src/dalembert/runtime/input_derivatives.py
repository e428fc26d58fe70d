"""Names of values of inputs by which runs are differentiated, and the weights of these values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..errors import OptionError, UnknownNameError
from ..integrators.samples import Samples, samples
from ..reduction.input_weights import input_of, weight_of
from ..scene.symbol_table import SymbolTable
from .input_values import GivenInputs

__all__ = ["value_names", "with_weights_of"]

_MOST = 2000
"""Largest number of values of inputs to differentiate by: each is another column of equations."""


def value_names(inputs: GivenInputs, symbols: SymbolTable, wrt: Sequence[str]) -> list[str]:
    """Return names of the variables of differentiation, with "u[0]", "u[1]", ... in place of an input u with samples.

    Raises
    ------
    OptionError
        For more values of inputs than are differentiated by.
    UnknownNameError
        For values that an input does not have.
    """
    found: list[str] = []
    for name in wrt:
        stem = input_of(name, symbols)
        value = None if stem is None else inputs.values[stem]
        known = [f"{stem}[{i}]" for i in range(len(value.t))] if isinstance(value, Samples) else [str(stem)]
        if stem is None or name in known:
            found.append(name)
        elif name == stem:
            found += known
        else:
            raise UnknownNameError(
                f"{name!r} is no value of the input {stem!r}, which has "
                + (f"{known[0]!r} to {known[-1]!r}" if len(known) > 1 else f"one, {known[0]!r}")
            )
    count = sum(input_of(name, symbols) is not None for name in found)
    if count > _MOST:
        raise OptionError(
            f"derivatives by {count} values of inputs, of which there are {_MOST} at most: name some of them, such as"
            f" {next(name for name in found if input_of(name, symbols))!r}; or take the gradient of a number by all of"
            ' them with the solve function of model.solve_fn(...), backend="jax"'
        )
    return found


def with_weights_of(inputs: GivenInputs, symbols: SymbolTable, wrt: Sequence[str]) -> GivenInputs:
    """Return inputs and, beside them, the weights of those of their values by which a run is differentiated."""
    weights: dict[str, float | Samples] = {}
    for name in wrt:
        stem = input_of(name, symbols)
        if stem is None:
            continue
        value = inputs.values[stem]
        if not isinstance(value, Samples):
            weights[weight_of(name)] = 1.0
            continue
        place = int(name.partition("[")[2][:-1])
        unit = np.zeros(len(value.t))
        unit[place] = 1.0
        weights[weight_of(name)] = samples(value.t, unit, value.kind, value.extrapolate)
    return replace(inputs, values={**inputs.values, **weights}) if weights else inputs
