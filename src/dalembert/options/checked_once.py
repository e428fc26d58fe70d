"""Options of runs that are checked once for each list of values: such a list is mostly that of the call before."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from .runs import SimulateOptions, SweepOptions, is_no_events, repeated

_NAMES: dict[type[Any], tuple[str, ...]] = {
    SimulateOptions: (
        "method",
        "rtol",
        "atol",
        "max_step",
        "max_steps",
        "first_step",
        "dense",
        "error_estimate",
        "project_invariants",
    ),
    SweepOptions: (
        "method",
        "rtol",
        "atol",
        "max_step",
        "max_steps",
        "threads",
        "error_estimate",
        "project_invariants",
    ),
}
"""Names of the values of which a list is known."""


def _new(kind: Any, values: tuple[Any, ...]) -> Any:
    return kind(**dict(zip(_NAMES[kind], values, strict=True)))


@lru_cache(maxsize=256, typed=True)
def _made(kind: Any, *values: Any) -> Any:
    return repeated(_new(kind, values))


@lru_cache(maxsize=256)
def _made_for_sweeps(plain: tuple[Any, ...], types: tuple[Any, ...], key: _Watched) -> SweepOptions:
    """Return options of many cases with what is watched and sampled; `types` are those of plain values."""
    reduce: Any = key.reduce
    if key.named is not None:
        reduce = dict(zip(key.named, reduce, strict=True))
    times = None if key.times is None else np.frombuffer(key.times)
    options: SweepOptions = _new(SweepOptions, plain)
    return repeated(replace(options, events=key.events, reduce=reduce, t_eval=times))


class _Watched(NamedTuple):
    """Key of the events, reductions and times of a sweep: two calls with equal keys have equal options.

    Attributes
    ----------
    events : tuple
        Events, as given.
    reduce : tuple or None
        Reductions.
    named : tuple of str or None
        Their names; None where they were given as a sequence.
    times : bytes or None
        Times to record, as the bytes of their array.
    types : tuple of type
        Types of what was given, which tell apart what Python takes for equal, such as 1 and True.
    """

    events: tuple[Any, ...]
    reduce: tuple[Any, ...] | None
    named: tuple[str, ...] | None
    times: bytes | None
    types: tuple[Any, ...]


_MOST_TIMES = 1024
"""Times to record up to which options are kept."""


def _watched(events: Any, reduce: Any, t_eval: Any) -> _Watched | None:
    """Return the key of what is watched and sampled; None where it is not of the usual types."""
    named, times = None, None
    if type(reduce) is dict and all(type(name) is str for name in reduce):
        named, reduce = tuple(reduce), tuple(reduce.values())
    if type(t_eval) is np.ndarray and t_eval.dtype == np.float64 and t_eval.ndim == 1 and t_eval.size <= _MOST_TIMES:
        times, t_eval = t_eval.tobytes(), None
    if t_eval is not None or type(events) not in (list, tuple) or type(reduce) not in (list, tuple, type(None)):
        return None
    reduce = None if reduce is None else tuple(reduce)
    types = tuple([(type(item), type(getattr(item, "expression", None))) for item in (*events, *(reduce or ()))])
    return _Watched(tuple(events), reduce, named, times, types)


def _checked(kind: Any, values: tuple[Any, ...]) -> Any:
    try:
        return _made(kind, *values)
    except TypeError:  # a value without a hash
        return _new(kind, values)


def simulate_options(
    *plain: Any, t_eval: Any, events: Any, inputs: Any = None, progress: Any = False
) -> SimulateOptions:
    """Return options of one trajectory, checked once for each list of values.

    Parameters
    ----------
    *plain
        method, rtol, atol, max_step, max_steps, first_step, dense, error_estimate and project_invariants.
    t_eval, events, inputs, progress
        As for `SimulateOptions`; nothing is kept of them.
    """
    options: SimulateOptions = _checked(SimulateOptions, plain)
    if t_eval is None and inputs is None and progress is False and is_no_events(events):
        return options
    if inputs is None and progress is False and is_no_events(events):
        return options.at_times(t_eval)
    return replace(options, t_eval=t_eval, events=events, inputs=inputs, progress=progress)


def sweep_options(*plain: Any, grid: Any, t_eval: Any, progress: Any, events: Any, reduce: Any) -> SweepOptions:
    """Return options of many cases, checked once for each list of values.

    Parameters
    ----------
    *plain
        method, rtol, atol, max_step, max_steps, threads, error_estimate and project_invariants.
    grid, t_eval, progress, events, reduce
        As for `SweepOptions`; nothing is kept of a grid and of a bar.
    """
    usual = grid is None and progress is False
    if usual and t_eval is None and reduce is None and is_no_events(events):
        options: SweepOptions = _checked(SweepOptions, plain)
        return options
    key = _watched(events, reduce, t_eval) if usual else None
    if key is not None:
        with suppress(TypeError):  # a value without a hash
            return _made_for_sweeps(plain, tuple(map(type, plain)), key)
    given = {"grid": grid, "t_eval": t_eval, "progress": progress, "events": events, "reduce": reduce}
    options = _checked(SweepOptions, plain)
    return replace(options, **given)
