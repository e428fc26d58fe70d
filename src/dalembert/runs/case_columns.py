"""Columns of values of the cases of a sweep: their reading, and the names of what is given, found once."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ..arrays import Column, FloatArray, arrays_of
from ..errors import UnknownNameError, ValueInputError, unknown_name
from ..ir.program import Layout
from ..starts.symbol_assumptions import ROUNDING, contradicts, excluded, limits_of, refuse_contradictions
from ..values import EXACT, array_of

Columns = dict[str, Column]
"""Values by name."""


def columns_of(
    kind: str, given: Mapping[Any, Any], known: Sequence[str], aliases: Mapping[str, str]
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


def common_length(
    layout: Layout, lengths: set[int], parameters: Columns, initial: Columns, span: Mapping[str, FloatArray]
) -> int:
    """Return the number of cases: the length of all arrays that hold more than one number, whose `lengths` are given.

    Raises
    ------
    ValueInputError
        Where they have several.
    """
    if len(lengths) > 1:
        known = {*layout.given, *initial, *span}  # others are parameters of inputs
        found = {
            f"{kind} {name}" if name in known else f"input {name.rpartition(' of ')[2]}": len(values)
            for kind, table in (("parameter", parameters), ("initial", initial), ("t_span", span))
            for name, values in arrays_of(table).items()
            if len(values) != 1
        }
        listed = "; ".join(f"{name}: {length}" for name, length in found.items())
        raise ValueInputError(f"the arrays of a sweep must have one length, that of its cases; given are {listed}")
    return lengths.pop() if lengths else 1


_MOST_KEPT = 64
"""Tuples of keys that are remembered."""


@final
class ColumnReader:
    """Reads mappings of one kind, whose keys are resolved once for each tuple of them; errors are of `columns_of`.

    Parameters
    ----------
    kind : str
        What they are, for messages.
    known : sequence of str
        Names that may be given.
    layout : Layout
    rounding : float
        Size of numbers whose sign says nothing.
    """

    def __init__(self, kind: str, known: Sequence[str], layout: Layout, rounding: float) -> None:
        self._kind, self._known, self._rounding = kind, known, rounding
        self._aliases, self._assumptions = layout.aliases, layout.assumptions
        self._limits = {name: limits_of(declared, rounding) for name, declared in self._assumptions.items()}
        self._resolved: dict[tuple[Any, ...], tuple[str, ...]] = {}

    def __call__(self, given: Mapping[Any, Any], lengths: set[int]) -> Columns:
        """Return the columns of a mapping, as `columns_of` does, and add their `lengths` where these are not 1."""
        if type(given) is not dict and not isinstance(given, Mapping):
            return self._read(given, lengths)
        keys = tuple(given)
        names = self._resolved.get(keys)
        if names is None:
            found = self._read(given, lengths)
            if len(self._resolved) >= _MOST_KEPT:
                self._resolved.clear()
            self._resolved[keys] = tuple(found)
            return found
        columns: Columns = {}
        for name, value in zip(names, given.values(), strict=True):
            if type(value) is float:
                columns[name] = value
            elif type(value) is np.float64 or (type(value) is int and -EXACT < value < EXACT):
                columns[name] = float(value)
            elif type(value) is np.ndarray and value.dtype is _DOUBLE and value.ndim == 1:
                columns[name] = value.copy()
                if len(value) != 1:
                    lengths.add(len(value))
            else:
                return self._read(given, lengths)
        return columns

    def _read(self, given: Mapping[Any, Any], lengths: set[int]) -> Columns:
        columns = columns_of(self._kind, given, self._known, self._aliases)
        lengths |= {len(values) for values in columns.values() if len(values) != 1}
        return {**columns}

    def refused(self, columns: Columns) -> NDArray[np.bool_] | None:
        """Return which cases (k,) have values that their symbols exclude, None where there are none.

        Raises
        ------
        ValueInputError
            For values of all cases that their symbols exclude.
        """
        whole, one = None, {}
        for name, (least, largest, others) in self._limits.items():
            value = columns.get(name)
            if value is None:
                continue
            if not isinstance(value, float):
                if value.size > 1:
                    found = contradicts(self._assumptions[name], value, self._rounding)
                    whole = found if whole is None else whole | found
                if value.size != 1:
                    continue
                value = value.item()
            if not least <= value <= largest or (others and math.isfinite(value) and excluded(others, value)):
                one[name] = value
        if one:  # or not finite
            refuse_contradictions(
                self._assumptions, {name: one[name] for name in columns if name in one}, self._rounding
            )
        return whole if whole is not None and np.any(whole) else None


_DOUBLE = np.dtype(np.float64)


@final
class CaseReaders:
    """Readers of initial values and parameters of the cases of one program."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.initial = ColumnReader("initial value", layout.initial, layout, ROUNDING)
        self.parameters = ColumnReader("parameter", layout.parameters, layout, 0.0)

    def refused(self, initial: Columns, parameters: Columns) -> NDArray[np.bool_] | None:
        """Return which cases (k,) have values that their symbols exclude, None where there are none.

        Values for all cases are rejected at once.
        """
        by_parameters, by_initial = self.parameters.refused(parameters), self.initial.refused(initial)
        if by_parameters is None or by_initial is None:
            return by_initial if by_parameters is None else by_parameters
        return by_parameters | by_initial


_READERS: dict[int, CaseReaders] = {}
"""Readers by the identity of their layout, which each keeps, so that no other can have it."""


def case_readers(layout: Layout) -> CaseReaders:
    """Return the readers for a layout."""
    found = _READERS.get(id(layout))
    if found is None:
        if len(_READERS) >= _MOST_KEPT:
            _READERS.clear()
        found = _READERS[id(layout)] = CaseReaders(layout)
    return found
