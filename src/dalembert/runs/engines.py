"""Engine of a model: that of its backend, or one that cuts runs where functions of time break."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from ..codegen.engine import Engine
from ..ir.program import Program
from ..pipeline import Compiled
from ..reduction.sampling_kernels import sampling_kernels
from ..reduction.starting import Start
from .impulses import landing_of

if TYPE_CHECKING:
    from ..stops.stops import Landing
    from .sampling import Sampling


def engine_of(compiled: Compiled, start: Callable[[Iterable[str]], Start]) -> Engine:
    """Return the engine of a compiled scene; `start` gives the kernel from given initial values to the state."""
    stages, sampling = compiled.stages, None
    kernels = sampling_kernels(stages.reduced)
    if kernels is not None:
        from .sampling import Sampling

        sampling = Sampling.of(stages.program, kernels)
    landing = landing_of(stages.equations, stages.program, start)
    return segmented(compiled.engine, stages.program, landing, sampling)


def segmented(
    engine: Engine, program: Program, landing: Landing | None = None, sampling: Sampling | None = None
) -> Engine:
    """Return an engine that ends steps where functions of time break, or the engine itself where it does so.

    `landing` gives the state after a break of a condition; None leaves it as it is.
    `sampling` is what controllers do at their instants.
    """
    if program.conditions is None and sampling is None and (engine.passes_stops or not program.layout.inputs):
        return engine
    from .segments import SegmentedEngine

    return SegmentedEngine(engine, program, landing, sampling)
