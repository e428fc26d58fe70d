"""Cases of a stored sweep, in parts, and their digest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from hashlib import blake2b
from typing import Any, final

import numpy as np

from ..errors import ValueInputError
from ..frozen import frozen
from ..ir.program import Layout
from ..results.cases import CaseSampler, CaseSet, Grid, case_set
from ..results.labels import given_name
from ..stops.samples import Samples

Given = tuple[tuple[Any, Any], Mapping[Any, Any], Mapping[Any, Any], Mapping[Any, Any] | None]
"""Span, initial values, parameters and inputs of a sweep, as a user gave them."""

_HASHED = 1 << 20
"""Values that are hashed at a time."""


@final
@frozen(eq=False)
class CasePart:
    """Arguments of `CompiledModel.sweep` for some cases, before them `leaders`, which decide for all.

    What a sweep decides once for all cases, it decides by the first that can start, and the like. With these before
    every chunk the decisions are those of one sweep of all cases.
    """

    leaders: int

    t_span: tuple[Any, Any]
    initial: dict[Any, Any]
    parameters: dict[Any, Any]
    inputs: dict[Any, Any] | None


@final
@frozen(eq=False)
class Request:
    """The cases of a stored sweep.

    Attributes
    ----------
    span, initial, parameters, inputs : mapping
        As given; values with a length are one a case.
    cases : CaseSet or None
    count : int
        Number of cases.
    shape : tuple of int
        Of the results: the lengths of the axes of a grid, or the number of cases.
    dims : tuple of str
        Names of these axes.
    initials : tuple of str
        Names that initial values may have.
    """

    span: Mapping[str, Any]
    initial: Mapping[Any, Any]
    parameters: Mapping[Any, Any]
    inputs: Mapping[Any, Any] | None
    cases: CaseSet | None
    count: int
    shape: tuple[int, ...]
    dims: tuple[str, ...]
    initials: tuple[str, ...]

    @property
    def row(self) -> int:
        """Cases that share a place on the first axis."""
        return int(np.prod(self.shape[1:], dtype=int))

    def part(self, first: int, last: int, leaders: Sequence[int]) -> CasePart:
        """Return the arguments for the cases `leaders`, followed by the cases from number `first` up to `last`."""
        return self.completed(self.given(first, last, leaders), first, last, leaders)

    def given(self, first: int, last: int, leaders: Sequence[int]) -> CasePart:
        """Return the arguments without those that grids and random cases determine."""
        some = _ranges(first, last, leaders)
        initial, parameters = (
            {key: _rows(value, some) for key, value in given.items()} for given in (self.initial, self.parameters)
        )
        begin, end = (_rows(self.span[which], some) for which in ("start", "end"))
        inputs = None
        if self.inputs is not None:
            inputs = {key: _rows(value, some) for key, value in self.inputs.items()}
        return CasePart(len(leaders), (begin, end), initial, parameters, inputs)

    def completed(self, part: CasePart, first: int, last: int, leaders: Sequence[int]) -> CasePart:
        """Return the arguments with those that grids and random cases determine."""
        some, varied = _ranges(first, last, leaders), dict[str, Any]()
        if isinstance(self.cases, CaseSampler):
            pieces = [self.cases.part(*each) for each in some]
            varied = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
        elif self.cases is not None:
            numbers = np.concatenate([np.arange(*each) for each in some])
            places = np.unravel_index(numbers, self.shape)
            varied = {name: axis[k] for (name, axis), k in zip(self.cases.axes.items(), places, strict=True)}
        started = {name: values for name, values in varied.items() if name in self.initials}
        others = {name: values for name, values in varied.items() if name not in self.initials}
        return replace(part, initial={**part.initial, **started}, parameters={**part.parameters, **others})

    def without_arrays(self) -> Request:
        """Return the request without the arrays that `given` returns."""
        return replace(self, span={}, initial={}, parameters={}, inputs=None)

    def digest(self) -> str:
        """Return a digest of all cases."""
        seal = blake2b(digest_size=16)
        for group in (self.span, self.initial, self.parameters, self.inputs or {}):
            for key, value in sorted(group.items(), key=lambda pair: str(pair[0])):
                seal.update(repr(str(key)).encode())
                _hash(seal, value)
        if isinstance(self.cases, CaseSampler):
            seal.update(repr((self.cases, dict(self.cases.distributions))).encode())
        elif self.cases is not None:
            for name, axis in self.cases.axes.items():
                seal.update(repr(name).encode())
                _hash(seal, axis)
        return seal.hexdigest()


def request_of(layout: Layout, given: Given, cases: Any) -> Request:
    """Return the cases of a stored sweep.

    Parameters
    ----------
    layout : Layout
        Of the model.
    given : tuple
        Span, initial values, parameters and inputs, as `CompiledModel.sweep` takes them.
    cases : CaseSet or None
        As it takes ``grid=``.

    Raises
    ------
    ValueInputError
        For values of different lengths, and for what is no set of cases.
    """
    t_span, initial, parameters, inputs = given
    cases = None if cases is None else case_set(cases)
    span = dict(zip(("start", "end"), t_span, strict=True))
    lengths: dict[str, int] = {}
    for group in (span, initial, parameters, inputs or {}):
        lengths |= {str(key): n for key, value in group.items() if (n := _length(value)) is not None and n != 1}
    if isinstance(cases, CaseSampler):
        lengths["cases"] = cases.count
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} has {n}" for name, n in lengths.items())
        raise ValueInputError(f"arrays over the cases must have one length: {listed}")
    shape: tuple[int, ...] = (next(iter(lengths.values()), 1),)
    dims: tuple[str, ...] = ("case",)
    if isinstance(cases, Grid):
        shape, dims = cases.shape, tuple(map(given_name, cases.axes))
        if lengths and set(lengths.values()) != {int(np.prod(shape))}:
            listed = ", ".join(f"{name} has {n}" for name, n in lengths.items())
            raise ValueInputError(
                f"arrays beside a grid of {int(np.prod(shape))} cases must have that length: {listed}"
            )
    return Request(span, initial, parameters, inputs, cases, int(np.prod(shape)), shape, dims, layout.initial)


def _ranges(first: int, last: int, leaders: Sequence[int]) -> tuple[tuple[int, int], ...]:
    return (*((k, k + 1) for k in leaders), (first, last))


def _length(value: Any) -> int | None:
    """Return the number of cases that values are given for; None for one value of all cases."""
    if isinstance(value, Samples):
        return value.cases
    try:
        shape = value.shape if hasattr(value, "shape") else np.shape(value)
    except ValueError:  # rows of several lengths, for which the sweep raises an error
        return None
    return int(shape[0]) if shape else None


def _rows(value: Any, some: Sequence[tuple[int, int]]) -> Any:
    """Return the values of ranges of cases; of arrays that are read in parts, only these are read."""
    length = _length(value)
    if length is None or length == 1:
        return value
    if isinstance(value, Samples):
        rows = np.concatenate([np.arange(*each) for each in some])
        slopes = None if value.slopes is None else value.slopes[rows]
        return replace(value, values=value.values[rows], slopes=slopes)
    array = value if hasattr(value, "shape") else np.asarray(value)
    return np.concatenate([np.asarray(array[slice(*each)]) for each in some])


def _hash(seal: Any, value: Any) -> None:
    if isinstance(value, Samples):
        for part in (value.t, value.values):
            _hash(seal, part)
        seal.update(repr((value.kind, value.extrapolate)).encode())
        return
    length = _length(value)
    if length is None:
        seal.update(repr(float(value)).encode())
        return
    array = value if hasattr(value, "shape") else np.asarray(value)
    seal.update(repr((length, str(array.dtype))).encode())
    for first in range(0, length, _HASHED):
        seal.update(np.ascontiguousarray(array[first : first + _HASHED]).tobytes())
