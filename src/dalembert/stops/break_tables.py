"""The table of conditions on time of one run, for the search for breaks in exports, and the kernels that it needs."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from ..ir.conditions import NARROW, WHOLE, ZERO, Conditions
from ..ir.kernel import Kernel
from ..subset.arguments import NO_CODE, AddressTable, AddressVector, IntVector, Matrix, OwnedAddress, Record, Vector
from ..transforms.interval_kernels import interval_kernel, traced_kernel
from .interval_roots import FIRST_PARTS, MOST_CUTS, kinds_of_numbers

KINDS = (ZERO, WHOLE, NARROW)
"""Kinds of conditions, by the numbers that the search has for them."""
IS_ZERO, IS_WHOLE, IS_NARROW = range(3)

MOST_BREAKS = 1000
"""Largest number of breaks of an exported run, from a start or a place where it continues to the end."""


class BreakSearch(Record):
    """State of the search.

    Number of breaks, the next one of the run, and its start and end; roots so far of a condition, intervals that cannot
    be told from a root, and whether they have a ``cluster``, with its ends; the ``last`` root of a narrow condition
    (NaN: none), how short it is there, and its distance from the one before; and 1 where there are too many.
    """

    count: int
    next: int
    begin: float
    end: float
    found: int
    stuck: int
    cluster: int
    low: float
    high: float
    last: float
    size: float
    gap: float
    over: int


class BreakTable(NamedTuple):
    """Conditions on time and parameters, and the breaks of a run.

    Attributes
    ----------
    search : BreakSearch
    kinds, nested : (k,)
        See `KINDS`; 1 for functions that contain others that are decided.
    values, bounds, sharpness : AddressVector
        Kernels of (t, p): each function, its bounds (`dalembert.transforms.interval_kernels.interval_kernel`), and the
        sharpness of narrow ones.
    tests : AddressVector
        Kernels of `dalembert.stops.interval_roots.kinds_of`, for zeros and for whole numbers.
    place : int
        Parameter at whose value conditions are decided, -1 for none.
    parameters : (1, n_p)
    times, edges : (MOST_BREAKS,)
        The breaks; those of conditions before a nested one.
    ends, cuts : (FIRST_PARTS + MOST_CUTS + 1,)
        Ends of the intervals that are left, the next one last, and how often each was cut.
    levels : (MOST_CUTS + 1,)
        Number of intervals that were cut so often.
    memory : (5, 8)
        Is overwritten.
    before : (n_c, 1) or (0, 1)
        Constants of the last step, behind which others may count; nothing where they do not change.
    """

    search: BreakSearch
    kinds: IntVector
    nested: IntVector
    values: AddressVector
    bounds: AddressVector
    sharpness: AddressVector
    tests: AddressVector
    place: int
    parameters: Matrix
    times: Vector
    edges: Vector
    ends: Vector
    cuts: IntVector
    levels: IntVector
    memory: Matrix
    before: Matrix


def no_breaks() -> BreakTable:
    """Return a table without conditions."""
    none, nothing, codes = np.zeros(0, np.int64), np.zeros(0), AddressTable()
    room = np.zeros((0, 1))
    return BreakTable(
        *(BreakSearch(), none, none, codes, codes, codes, codes, -1),
        *(room, nothing, nothing, nothing, none, none, room, room),
    )


_VALUE, _BOUNDS, _SHARPNESS, _TEST = "value_{}", "bounds_{}", "sharpness_{}", "test_{}"


def break_kernels(conditions: Conditions) -> dict[str, tuple[Kernel, str]]:
    """Return the kernels that the search needs, of (t, p), by their names, each with what it computes.

    Functions have no tables.
    """
    found: dict[str, tuple[Kernel, str]] = {}
    for kind in sorted({int(kind == WHOLE) for kind in conditions.kinds}):
        test = traced_kernel(partial(kinds_of_numbers, KINDS[kind]), "test", 8)
        found[_TEST.format(kind)] = test, "Whether an interval may hold roots, of a monotone function or not"
    for i, (function, sharp) in enumerate(zip(conditions.functions, conditions.sharpness, strict=True)):
        found[_VALUE.format(i)] = function, f"Function {i + 1} of time, about whose roots steps end"
        found[_BOUNDS.format(i)] = interval_kernel(function), "Its bounds over an interval, and those of its rate"
        if sharp is not None:
            found[_SHARPNESS.format(i)] = sharp, "Inverse square of the time within which it has a pulse"
    return found


def breaks_of(conditions: Conditions, code: Mapping[str, OwnedAddress], parameters: int, constants: int) -> BreakTable:
    """Return the table of conditions, for the code of `break_kernels` and so many parameters and constants."""
    places = range(len(conditions.functions))
    values, bounds, sharpness = (
        AddressTable(code.get(name.format(i), NO_CODE) for i in places) for name in (_VALUE, _BOUNDS, _SHARPNESS)
    )
    tests = AddressTable(code.get(_TEST.format(kind), NO_CODE) for kind in (IS_ZERO, IS_WHOLE))
    kinds = np.array([KINDS.index(kind) for kind in conditions.kinds], np.int64)
    left = FIRST_PARTS + MOST_CUTS + 1
    return BreakTable(
        search=BreakSearch(),
        kinds=kinds,
        nested=np.array(conditions.nested, np.int64),
        values=values,
        bounds=bounds,
        sharpness=sharpness,
        tests=tests,
        place=-1 if conditions.place is None else conditions.place,
        parameters=np.zeros((1, parameters)),
        times=np.zeros(MOST_BREAKS),
        edges=np.zeros(MOST_BREAKS if any(conditions.nested) else 0),
        ends=np.zeros(left),
        cuts=np.zeros(left, np.int64),
        levels=np.zeros(MOST_CUTS + 1, np.int64),
        memory=np.zeros((5, 8)),
        before=np.zeros((constants if conditions.decides else 0, 1)),
    )
