"""Options of runs that are checked once for each list of values: such a list is mostly that of the call before."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

from .runs import SimulateOptions, SweepOptions, is_no_events

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


@lru_cache(maxsize=256, typed=True)
def _made(kind: Any, *values: Any) -> Any:
    return kind(**dict(zip(_NAMES[kind], values, strict=True)))


def _checked(kind: Any, values: tuple[Any, ...]) -> Any:
    try:
        return _made(kind, *values)
    except TypeError:  # a value without a hash
        return _made.__wrapped__(kind, *values)


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
    return replace(options, t_eval=t_eval, events=events, inputs=inputs, progress=progress)


def sweep_options(*plain: Any, grid: Any, t_eval: Any, progress: Any, events: Any, reduce: Any) -> SweepOptions:
    """Return options of many cases, checked once for each list of values.

    Parameters
    ----------
    *plain
        method, rtol, atol, max_step, max_steps, threads, error_estimate and project_invariants.
    grid, t_eval, progress, events, reduce
        As for `SweepOptions`; nothing is kept of them.
    """
    options: SweepOptions = _checked(SweepOptions, plain)
    if grid is None and t_eval is None and progress is False and reduce is None and is_no_events(events):
        return options
    return replace(options, grid=grid, t_eval=t_eval, progress=progress, events=events, reduce=reduce)
