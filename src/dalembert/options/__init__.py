"""Options of compilation and of all kinds of runs: names, defaults and checks."""

from .checked_once import simulate_options, sweep_options
from .other_calls import ORIENTATIONS, CompileOptions, SensitivityOptions, StoreOptions, TrimOptions
from .runs import (
    MAX_STEPS,
    TIGHTER,
    TRACED_MAX_STEPS,
    PrepareOptions,
    RunOptions,
    SimulateOptions,
    SolveOptions,
    StepOptions,
    SweepOptions,
    tighter,
)
from .tolerances import (
    DEFAULT_TOLERANCES,
    NamedTolerances,
    at_least,
    atol_attribute,
    atol_text,
    component_tolerances,
    known_components,
    tolerances,
    within,
)

__all__ = [
    "DEFAULT_TOLERANCES",
    "MAX_STEPS",
    "ORIENTATIONS",
    "TIGHTER",
    "TRACED_MAX_STEPS",
    "CompileOptions",
    "NamedTolerances",
    "PrepareOptions",
    "RunOptions",
    "SensitivityOptions",
    "SimulateOptions",
    "SolveOptions",
    "StepOptions",
    "StoreOptions",
    "SweepOptions",
    "TrimOptions",
    "at_least",
    "atol_attribute",
    "atol_text",
    "component_tolerances",
    "known_components",
    "simulate_options",
    "sweep_options",
    "tighter",
    "tolerances",
    "within",
]
