"""[Program] -> [Program]: rates and projections in the time that has passed since the start of a run.

Differences of times that are far from zero are exact, the times themselves are not: a run that counts from its start
keeps all digits of its steps.
"""

from __future__ import annotations

from dataclasses import replace

from ...ir.program import Assignment, Kernel, Load, Program

__all__ = ["in_elapsed_time"]

_TIMED = ("rhs", "project_position", "project_velocity")


def in_elapsed_time(program: Program) -> Program:
    """Return a program whose rates and projections take the time since the start of a run.

    Where they depend on the time itself, its start is one more constant behind the others; else nothing changes.
    """
    kernels = [kernel for kernel in program if kernel.name in _TIMED]
    if not any(load.array == "t" for kernel in kernels for load in kernel.loads):
        return program
    layout = program.layout
    start = layout.constants or len(layout.parameters)
    counted = tuple(_counted(kernel, start) for kernel in kernels)
    return replace(program, kernels=counted, layout=replace(layout, constants=start + 1))


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
