"""Options of compilation and of all kinds of runs: names, defaults and checks."""

from .compilation import ORIENTATIONS, CompileOptions
from .derivatives import SensitivityOptions, TrimOptions
from .runs import (
    DEFAULT_TOLERANCES,
    MAX_STEPS,
    TRACED_MAX_STEPS,
    PrepareOptions,
    RunOptions,
    SimulateOptions,
    SolveOptions,
    StepOptions,
    SweepOptions,
    simulate_options,
    tighter,
)
from .stores import StoreOptions

__all__ = [
    "DEFAULT_TOLERANCES",
    "MAX_STEPS",
    "ORIENTATIONS",
    "TRACED_MAX_STEPS",
    "CompileOptions",
    "PrepareOptions",
    "RunOptions",
    "SensitivityOptions",
    "SimulateOptions",
    "SolveOptions",
    "StepOptions",
    "StoreOptions",
    "SweepOptions",
    "TrimOptions",
    "simulate_options",
    "tighter",
]
