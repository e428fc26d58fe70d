"""Engine of a model: that of its backend, or one that cuts runs where functions of time break."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..codegen.base import Engine
from ..ir.program import Program

if TYPE_CHECKING:
    from ..integrators.chaining import Landing
    from .sampling import Sampling

__all__ = ["segmented"]


def segmented(
    engine: Engine, program: Program, landing: Landing | None = None, sampling: Sampling | None = None
) -> Engine:
    """Return an engine that ends steps where functions of time break, or the engine itself where it does so.

    `landing` gives the state with which a run goes on from a break of a condition; None leaves it as it is.
    `sampling` is what controllers do at their instants.
    """
    if program.conditions is None and sampling is None and (engine.follows_inputs or not program.layout.inputs):
        return engine
    from .segments import SegmentedEngine

    return SegmentedEngine(engine, program, landing, sampling)
