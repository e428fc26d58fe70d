"""Angles: inputs of a kernel that enter it through sines and cosines only, and so modulo a turn."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from ...ir.kernel import Assignment, Kernel
from ...ir.program import Program
from ..passes import EliminateDeadCode


def turning(body: Sequence[Assignment], inputs: Iterable[str], outputs: Iterable[object]) -> frozenset[str]:
    """Return those of `inputs` that straight-line code uses, but only in sines, cosines and tangents of their sums."""
    used: dict[str, list[Assignment]] = {}
    for line in body:
        for arg in line.args:
            if isinstance(arg, str):
                used.setdefault(arg, []).append(line)
    ends = {name for name in outputs if isinstance(name, str)}
    found: set[str] = set()
    names = list(inputs)
    for name in (*(line.target for line in reversed(body)), *names):
        periodic = (
            line.op in ("sin", "cos", "tan") or (line.op in ("add", "sub", "neg") and line.target in found)
            for line in used.get(name, ())
        )
        if name in used and name not in ends and all(periodic):
            found.add(name)
    return frozenset(found & set(names))


def angles_in(kernel: Kernel, first: int = 0) -> frozenset[int]:
    """Return which components of y the outputs of a kernel from `first` on depend on modulo a turn."""
    places = {load.target: load.index for load in kernel.loads if load.array == "y" and load.index is not None}
    kernel = EliminateDeadCode()(replace(kernel, outputs=kernel.outputs[first:]))
    return frozenset(places[name] for name in turning(kernel.body, places, kernel.outputs))


def angles_of(program: Program) -> tuple[int, ...]:
    """Return which components of the state the motion of a program depends on modulo a turn."""
    found = angles_in(program.kernel("rhs"))
    for name in ("project_position", "project_velocity"):
        if name in program:
            kernel = program.kernel(name)
            found -= {load.index for load in kernel.loads if load.array == "y"} - angles_in(kernel)
    return tuple(sorted(found))
