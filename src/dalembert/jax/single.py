"""Single precision: which programs and methods a traced run serves in it, and at which tolerances."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import OptionError, PrecisionWarning, list_names, warn_caller
from ..ir.kernel import Kernel
from ..ir.program import Program
from ..options import SolveOptions, at_least
from ..stops.samples import Samples
from ..transforms.recurrences import recurrences
from .runs.precision import SINGLE, Precision, is_traced

_SMALLEST, _LARGEST = 1e-12, 1e30
"""Sizes of numbers in equations that single precision serves: thresholds of ranks and of tables lie beyond."""

_REMEDY = 'set jax.config.update("jax_enable_x64", True), or call inside "with jax.enable_x64(True):"'
_HALF = 2.0**-24
_MOVED = 1e-4
"""Share of the distance between knots by which rounding may move them without a warning."""

_UNUSED = ("energy", "knots", "near_knots", "knot_sides")


def with_tolerances(options: SolveOptions, precision: Precision) -> SolveOptions:
    """Return options with the requested tolerances, raised to the smallest that the precision allows."""
    rtol = precision.rtol if options.rtol is None else max(options.rtol, precision.least_rtol)
    atol = precision.atol if options.atol is None else at_least(options.atol, precision.least_atol)
    return replace(options, rtol=rtol, atol=atol)


def warn_below_single(options: SolveOptions) -> None:
    """Warn of tolerances below what single precision gives."""
    asked = {"rtol": (options.rtol, SINGLE.least_rtol), "atol": (options.atol, SINGLE.least_atol)}
    below = {name: pair for name, pair in asked.items() if pair[0] is not None and pair[0] < pair[1]}
    if below:
        wanted = " and ".join(f"{name} = {value:g}" for name, (value, _) in below.items())
        taken = " and ".join(f"{name} = {least:g}" for name, (_, least) in below.items())
        warn_caller(
            f"{wanted} asks for less than single precision gives, in which this process computes; the run takes"
            f" {taken}. For more digits {_REMEDY}",
            PrecisionWarning,
        )


def warn_of_rounded_knots(given: Mapping[str, Any]) -> None:
    """Warn of records of inputs whose knots lie so close that single precision moves them, where they are known."""
    for name, record in given.items():
        if not isinstance(record, Samples) or is_traced(record.t) or len(record.t) < 2:
            continue
        knots = np.asarray(record.t, dtype=float)
        rounding, spacing = _HALF * float(np.max(np.abs(knots))), float(np.min(np.diff(knots)))
        if rounding > _MOVED * spacing:
            warn_caller(
                f"single precision rounds the knots of input {name!r} by up to {rounding:.1g} s, and they lie"
                f" {spacing:.1g} s apart: count time from nearer by, or, for more digits, {_REMEDY}",
                PrecisionWarning,
            )


def require_single(program: Program, method: str) -> None:
    """Refuse what single precision does not serve.

    Raises
    ------
    OptionError
        For equations with numbers that vanish beside rounding or overflow, and for Taylor steps that need more than
        the last terms of the series of the state.
    """
    kernels = [kernel for kernel in program if kernel.name not in _UNUSED]
    found = {value: kernel.name for kernel in kernels for value in _beyond(kernel)}
    if program.stops_at_tables:
        raise OptionError(f"runs of scenes with tables take steps to knots, which need double precision: {_REMEDY}")
    if found:
        places = list_names(f"{value!r} in {name}" for value, name in sorted(found.items()))
        raise OptionError(
            f"the equations of this scene ({program.formulation!r}) hold numbers that single precision does not"
            f" resolve beside others ({places}): where they decide which constraints depend on each other, the run"
            f' would be wrong. Take another formulation, such as "minimal", other units, or double precision: {_REMEDY}'
        )
    if method == "taylor":
        known = recurrences(program.kernel("rhs"), step_growth_limited=program.nonanalytic)
        if known.controlled or known.poles or known.step_growth_limited or known.nonsmooth:
            raise OptionError(
                "steps of 'taylor' are controlled by more than the series of the state in this scene (powers, kinks or"
                f' jumps), which needs double precision: take method="dopri8" or "tsit5", or {_REMEDY}'
            )


def _beyond(kernel: Kernel) -> list[float]:
    """Return the numbers in a kernel whose size single precision does not serve."""
    numbers = (arg for line in kernel.body for arg in line.args if not isinstance(arg, str))
    kept = (float(number) for number in numbers if number != 0.0 and math.isfinite(number))
    return [number for number in kept if not _SMALLEST <= abs(number) <= _LARGEST]
