"""Times at which conditions on time change, in traced programs."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ..arrays import FloatArray
from ..ir.conditions import Conditions
from ..stops.breakpoints import break_times_of_cases
from .host_calls import on_host


def traced_breaks(conditions: Conditions, p: Any, t: Any, most: int) -> tuple[Any, Any]:
    """Return the breaks (most,) of a run along times t (n_t,) of parameters p (n_p,), and which move with parameters.

    Breaks are times since t[0] in the order of the run, infinite behind the last. More than a run may take steps are
    left out, as it ends before. Derivatives do not pass.
    """
    times, moved = on_host(partial(_breaks, conditions, most), ((most,), (most,)), p, t[0], t[-1])
    return times, moved


def _breaks(
    conditions: Conditions, most: int, rows: FloatArray, begin: FloatArray, end: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return breaks (k, most) of runs with parameters (k, n_p) from `begin` to `end` (k,), and 1 where they move."""
    times = np.repeat(np.where(end >= begin, np.inf, -np.inf)[:, np.newaxis], most, axis=1)
    moved = np.zeros_like(times)
    starts, found = break_times_of_cases(conditions, rows, begin, end)
    moving = _moving(conditions)
    others = break_times_of_cases(moving, rows, begin, end) if moving.functions else (0 * starts, found[:0])
    for i in range(len(rows)):
        own, some = (values[first[i] : first[i + 1]] for first, values in ((starts, found), others))
        own = own[:most]
        times[i, : len(own)] = own - begin[i]
        moved[i, : len(own)] = np.isclose(own[:, np.newaxis], some, rtol=1e-14, atol=0.0).any(axis=1)
    return times, moved


def _moving(conditions: Conditions) -> Conditions:
    """Return the conditions whose changes depend on parameters, and those within which they are nested."""
    own = [
        any(load.array == "p" and load.index != conditions.place for load in function.loads)
        for function in conditions.functions
    ]
    around = [moves and nested for moves, nested in zip(own, conditions.nested, strict=True)]
    kept = [i for i, moves in enumerate(own) if moves or any(around[i:])]
    return replace(
        conditions,
        functions=tuple(conditions.functions[i] for i in kept),
        kinds=tuple(conditions.kinds[i] for i in kept),
        nested=tuple(conditions.nested[i] for i in kept),
        sharpness=tuple(conditions.sharpness[i] for i in kept),
    )
