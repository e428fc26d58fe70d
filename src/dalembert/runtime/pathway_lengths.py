"""Actuators whose pathway has length zero where a run ended."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..integrators.problem import Solution
from ..integrators.segments import Constants, constants_at
from ..ir.interpret import interpret_rows
from ..methods.status import Status
from ..reduction.event_functions import event_functions
from ..scene.actuators import straight_parts

if TYPE_CHECKING:
    from .model import CompiledModel

__all__ = ["lost_directions"]

_NOTHING = 1e-12
"""Share of its largest length in a run at which a part of a pathway counts as zero."""


def lost_directions(model: CompiledModel, solution: Solution, c: Constants) -> str:
    """Return which pathways of actuators have the length zero where the rates of a run are not finite, "" for none."""
    scene = model.stages.scene
    if solution.status != Status.NON_FINITE or not scene.actuators or not len(solution.t):
        return ""
    parts = straight_parts(scene)
    lengths = [length for _, _, length in parts]
    kernel = event_functions(scene, model.stages.reduced, lengths, "pathway", moving=False).values
    found = np.abs(interpret_rows(kernel, solution.t, solution.y, constants_at(c, solution.t)))
    lost = [
        f"{name} has no direction, because {ends} are at the same place"
        for (name, ends, _), length, largest in zip(parts, found[-1], np.max(found, axis=0), strict=True)
        if length <= _NOTHING * largest
    ]
    return f"at t = {solution.t[-1]:.6g} {'; '.join(lost)}" if lost else ""
