"""Programs of traced runs: in elapsed time, and in single precision."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import OptionError, PrecisionWarning, list_names, warn_caller
from ..ir.kernel import Assignment, Kernel, Load, Operand
from ..ir.program import Program
from ..options import SolveOptions, at_least
from ..stops.samples import Samples
from ..transforms.pipelines import STEP_PASSES
from ..transforms.taylor.recurrences import recurrences
from .runs.precision import SINGLE, Precision, is_traced

_TIMED = ("rhs", "knots", "near_knots", "knot_sides", "project_position", "project_velocity")


def in_elapsed_time(program: Program) -> Program:
    """Return a program whose rates and projections take the time since the start of a run.

    Where they depend on the time itself, or conditions do, its start is one more constant behind the others; else
    nothing changes. Where there are conditions, the constants are the parameters.
    """
    kernels = [kernel for kernel in program if kernel.name in _TIMED]
    layout = program.layout
    start = layout.constants or len(layout.parameters)
    if program.conditions is not None:
        start = len(layout.parameters)
        kernels = [_of_parameters(kernel, program.kernel("prepare")) for kernel in kernels]
    elif not any(load.array == "t" for kernel in kernels for load in kernel.loads):
        return program
    counted = tuple(_counted(kernel, start) for kernel in kernels)
    return replace(program, kernels=counted, layout=replace(layout, constants=start + 1))


def expansion_in_elapsed_time(program: Program) -> Kernel:
    """Return the kernel of coordinates and rates with the constants of `in_elapsed_time`, the start always the last."""
    kernel, layout = program.kernel("expand"), program.layout
    if program.conditions is not None:
        return _counted(_of_parameters(kernel, program.kernel("prepare")), len(layout.parameters))
    return _counted(kernel, layout.constants or len(layout.parameters))


def _of_parameters(kernel: Kernel, prepare: Kernel) -> Kernel:
    """Return a kernel that takes the parameters in place of the constants which `prepare` makes of them."""
    taken = {*kernel.arguments, *(load.target for load in kernel.loads), *(line.target for line in kernel.body)}
    names: dict[Operand, Operand] = {}
    for name in (*(load.target for load in prepare.loads), *(line.target for line in prepare.body)):
        names[name] = _unused(f"own_{name}", taken)
        taken.add(str(names[name]))
    loads = [Load(str(names[load.target]), "c", load.index) for load in prepare.loads]
    body = [
        Assignment(str(names[line.target]), line.op, tuple(names.get(arg, arg) for arg in line.args))
        for line in prepare.body
    ]
    given: dict[Operand, Operand] = {}
    for load in kernel.loads:
        if load.array == "c":
            output = prepare.outputs[load.index or 0]
            given[load.target] = names.get(output, output)
    loads += [load for load in kernel.loads if load.array != "c"]
    body += [Assignment(line.target, line.op, tuple(given.get(arg, arg) for arg in line.args)) for line in kernel.body]
    outputs = tuple(given.get(output, output) for output in kernel.outputs)
    whole = Kernel(kernel.name, kernel.arguments, tuple(loads), tuple(body), outputs)
    return STEP_PASSES(whole)


def _counted(kernel: Kernel, start: int) -> Kernel:
    """Return a kernel whose time is what has passed since the time in constant `start`."""
    taken = {*kernel.arguments, *(load.target for load in kernel.loads), *(line.target for line in kernel.body)}
    elapsed, begin = (_unused(name, taken) for name in ("elapsed", "begin"))
    loads, sums = [], []
    for load in kernel.loads:
        if load.array == "t":
            loads += [Load(elapsed, "t", None), Load(begin, "c", start)]
            sums.append(Assignment(load.target, "add", (begin, elapsed)))
        else:
            loads.append(load)
    return replace(kernel, loads=tuple(loads), body=(*sums, *kernel.body))


def _unused(name: str, taken: set[str]) -> str:
    while name in taken:
        name += "_"
    return name


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
    """Reject what single precision does not support.

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
    """Return the numbers in a kernel whose size single precision does not support."""
    numbers = (arg for line in kernel.body for arg in line.args if not isinstance(arg, str))
    kept = (float(number) for number in numbers if number != 0.0 and math.isfinite(number))
    return [number for number in kept if not _SMALLEST <= abs(number) <= _LARGEST]
