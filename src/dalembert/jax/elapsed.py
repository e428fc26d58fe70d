"""Rates, projections, limits and sides at knots in elapsed time, for traced runs: [Program] -> [Program].

They count time from the start of a run: differences of times that are far from zero are exact, the times themselves are
not. Where conditions on time are decided along the way, what depends on these is no constant of a run, and rates and
projections compute it themselves.
"""

from __future__ import annotations

from dataclasses import replace

from ..ir.kernel import Assignment, Kernel, Load, Operand
from ..ir.program import Program
from ..transforms.pipelines import STEP_PASSES

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
