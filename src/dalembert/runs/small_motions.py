"""Motions that are small against `atol`: warnings, and `atol="auto"`, which takes one that serves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import FloatArray
from ..errors import PrecisionWarning, warn_caller
from ..options import NamedTolerances, SimulateOptions, SweepOptions, atol_text
from ..values import number
from .case_settings import with_grid
from .component_tolerances import (
    FEW,
    ROUNDING,
    SHARE,
    case_components,
    case_sizes,
    component_sizes,
    decides,
    serving_atol,
    serving_components,
    warn_of_components,
)

if TYPE_CHECKING:
    from ..model.model import CompiledModel
    from ..results.sweep import Sweep
    from ..results.trajectory import Trajectory

_MOST_RUNS = 40
"""Runs of a sweep with `atol="auto"`, at most: each serves the cases of one decade of sizes."""
_MOST_TRIES = 4
"""The same for one motion, whose size is known better after each."""


def simulate_at_scale(
    run: Callable[[SimulateOptions], Trajectory], initial: Mapping[Any, Any], options: SimulateOptions
) -> Trajectory:
    """Return a motion of which `atol` is "auto", with one that serves, or one for each component.

    A start beyond rounding decides, and else the largest component of a run at the default.
    """
    found = _at_one_scale(run, initial, options)
    atol = tried = serving_components(found, initial, options.rtol)
    for _ in range(_MOST_TRIES):
        if atol is None:
            break
        other = run(replace(options, atol=atol))
        if found.success and not other.success:
            return _better(found, other, atol)
        found, tried = _chosen(other, "components of different sizes", atol), atol
        atol = serving_components(found, initial, options.rtol)
        atol = None if atol == tried else atol
    return found


def _at_one_scale(
    run: Callable[[SimulateOptions], Trajectory], initial: Mapping[Any, Any], options: SimulateOptions
) -> Trajectory:
    """Return a motion with one tolerance that serves its largest component."""
    size, default = _start_size(initial), options.atol
    if size > ROUNDING:
        if not decides(default, options.rtol, size):
            return run(options)
        atol = serving_atol(options.rtol, size)
        found, other = run(replace(options, atol=atol)), None
        if not found.success:
            other = run(options)
        return _chosen(found, f"a start of {size:.2g}", atol) if other is None else _better(other, found, atol)
    found, atol = run(options), default
    for _ in range(_MOST_TRIES):
        size = max(_largest(part.y) for part in found.parts)
        if not size > 0.0 or not decides(atol, options.rtol, size):
            break
        atol = serving_atol(options.rtol, size)
        other = run(replace(options, atol=atol))
        if found.success and not other.success:
            return _better(found, other, atol)
        found = _chosen(other, f"a motion of {size:.2g}", atol)
    return found


def _chosen(run: Trajectory, what: str, atol: float) -> Trajectory:
    """Return a run, with the tolerance that it took in its note."""
    run.stats = replace(
        run.stats, note="; ".join(filter(None, (run.stats.note, f'atol = {atol_text(atol)} by "auto", for {what}')))
    )
    return run


def _better(found: Trajectory, failed: Trajectory, atol: float) -> Trajectory:
    """Return the run at the default where it succeeded, with a warning, and else the one that failed at `atol`."""
    if not found.success:
        return failed
    note = _kept(found.stats.atol, atol, "the run")
    found.stats = replace(found.stats, note="; ".join(filter(None, (found.stats.note, note))))
    return found


def sweep_at_scale(
    model: CompiledModel,
    run: Callable[[Mapping[Any, Any], Mapping[Any, Any], SweepOptions], Sweep],
    given: tuple[Mapping[Any, Any], Mapping[Any, Any]],
    options: SweepOptions,
) -> Sweep:
    """Return the results of many cases of which `atol` is "auto", each with one that serves it.

    The cases that are small run again, those of one decade of sizes together.
    """
    options = replace(options, fits_atol=False)
    found = run(*given, options)
    count, default = len(found), options.atol
    used, begin = np.full(count, default), _start_sizes(found)
    if options.grid is not None:
        given = with_grid(model.layout, options.grid, *given)
    notes: list[str] = []
    for _ in range(_MOST_RUNS):
        sizes = np.where(begin > ROUNDING, begin, _sizes(found))
        small = (sizes > 0.0) & decides(used, options.rtol, sizes)
        if not np.any(small):
            break
        atol = serving_atol(options.rtol, float(np.min(sizes[small])))
        some = small & (sizes < 10.0 * atol / (SHARE * options.rtol) * (1.0 + 1e-12))
        initial = {name: np.where(some, np.asarray(values, float), np.nan) for name, values in given[0].items()}
        other = run(initial, given[1], replace(options, grid=None, progress=False, atol=atol))
        lost = some & found.success & ~other.success
        better = some & ~lost
        begin[lost], used[some] = 0.0, np.where(lost[some], 0.0, atol)  # 0: looked at
        if np.any(better):
            found.with_cases(better, other)
            notes.append(f"{atol:g} for {np.count_nonzero(better)}")
        if np.any(lost):
            number_lost = np.count_nonzero(lost)
            notes.append(_kept(default, atol, f"{number_lost} {'case' if number_lost == 1 else 'cases'}"))
    _serve_components(found, run, given, options, (used, notes))
    if notes:
        found.stats = replace(
            found.stats, note="; ".join(filter(None, (found.stats.note, f'atol by "auto": {", ".join(notes)} cases')))
        )
    return found


def _serve_components(
    found: Sweep,
    run: Callable[[Mapping[Any, Any], Mapping[Any, Any], SweepOptions], Sweep],
    given: tuple[Mapping[Any, Any], Mapping[Any, Any]],
    options: SweepOptions,
    about: tuple[FloatArray, list[str]],
) -> None:
    """Run the cases again, in place, whose components are of so different sizes that each needs its own tolerance.

    `about` are the tolerances that cases took, and notes, which this adds to.
    """
    used, notes = about
    for some, atol in case_components(found, used, options.rtol, _MOST_RUNS):
        initial = {name: np.where(some, np.asarray(values, float), np.nan) for name, values in given[0].items()}
        other = run(initial, given[1], replace(options, grid=None, progress=False, atol=atol))
        lost = some & found.success & ~other.success
        if np.any(some & ~lost):
            found.with_cases(some & ~lost, other)
            notes.append(f"{atol_text(atol)} for {np.count_nonzero(some & ~lost)}")
        if np.any(lost):
            notes.append(_kept(float(np.min(used[lost])), atol, f"{np.count_nonzero(lost)} cases"))


def _start_size(initial: Mapping[Any, Any]) -> float:
    """Return the largest of the given initial values; 0.0 where they are not numbers, which the run says."""
    try:
        return max((abs(number(value)) for value in initial.values()), default=0.0)
    except (AttributeError, ValueError):
        return 0.0


def _kept(default: float, atol: float, what: str) -> str:
    """Warn that what a run at another tolerance does not reach keeps the default; return the note."""
    wanted = f"atol = {atol_text(atol)}, which its size asks for"
    note = f"{what} kept atol = {atol_text(default)}, because with {wanted}, it fails"
    warn_caller(f'atol="auto": {note}. Choose units in which the motion is larger', PrecisionWarning)
    return note


def warn_of_small_motion(run: Trajectory, rtol: float, atol: float) -> None:
    """Warn of a run of which no component of the state becomes large against `atol`, or not one that was left out."""
    if isinstance(atol, NamedTolerances):
        warn_of_components(component_sizes(run), rtol, atol)
        return
    last = run.parts[-1].y
    # most runs end here, in half a microsecond
    if not len(last) or max(map(abs, last[-1].tolist()), default=0.0) >= FEW * atol:
        return
    largest = max(_largest(part.y) for part in run.parts)
    if largest >= FEW * atol or not largest > ROUNDING:
        return
    # from rest, steps let the rounding of forces grow up to `atol`
    if _largest(run.parts[0].y[:1]) > ROUNDING or largest > atol:
        _warn_of_size(f"no coordinate or rate of this motion exceeds {largest:.2g}", largest, rtol, atol)


def _largest(y: FloatArray) -> float:
    """Return the largest component of states (k, n)."""
    return float(np.max(np.abs(y), initial=0.0))


def _start_sizes(sweep: Sweep) -> FloatArray:
    """Return the largest given initial value of each case (n_case,)."""
    sizes = np.zeros(len(sweep))
    for values in sweep.initial.values():
        sizes = np.maximum(sizes, np.abs(values))
    return sizes


def _sizes(sweep: Sweep) -> FloatArray:
    """Return the largest component of the state of each case at its end and its samples; NaN where it failed."""
    sizes = np.max(np.abs(sweep.y), axis=1, initial=0.0)
    samples = sweep.samples
    return sizes if samples is None else np.maximum(sizes, np.nanmax(np.abs(samples), axis=(1, 2), initial=0.0))


def warn_of_small_cases(sweep: Sweep, rtol: float, atol: float) -> None:
    """Warn of the cases of a sweep that start, and end, with no component of the state large against `atol`."""
    if isinstance(atol, NamedTolerances):
        warn_of_components(case_sizes(sweep), rtol, atol)
        return
    for value in sweep.given[0].values():
        number_for_all = value if isinstance(value, float) else value.item() if value.size == 1 else 0.0
        if FEW * atol <= abs(number_for_all):
            return  # no case starts small
    sizes = _start_sizes(sweep)
    if not np.any((sizes > ROUNDING) & (sizes < FEW * atol)):
        return
    sizes = np.maximum(sizes, np.max(np.abs(sweep.y), axis=1, initial=0.0))  # NaN, of cases that failed, is not small
    small = (sizes > ROUNDING) & (sizes < FEW * atol)
    if np.any(small):
        largest, number_small = float(np.max(sizes[small])), np.count_nonzero(small)
        cases = "one case" if number_small == 1 else f"{number_small} cases"
        _warn_of_size(
            f"no coordinate or rate exceeds {largest:.2g} at the start and the end of {cases}", largest, rtol, atol
        )


def _warn_of_size(what: str, largest: float, rtol: float, atol: float) -> None:
    """Warn of a motion of a size, and say which tolerance serves it."""
    warn_caller(
        f"{what}, and atol = {atol:g} allows errors of a large share of that. Pass a smaller one, such as"
        f' atol={SHARE * rtol * largest:.0e}, or atol="auto", or choose units in which the motion is larger',
        PrecisionWarning,
    )
